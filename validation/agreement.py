#!/usr/bin/env python3
"""Compare camera paths with bidirectional paths on every shipped scene that both can sample: image totals and pixels.

Two integrators render each scene at 32 x 32 pixels in rounds of independent seeds, until the combined relative error of the
image's totals (M00, each wavelength) is below --goal, or until --seconds have passed for that scene. The next round goes to the
integrator that reduces the combined variance more per second. If projectors illuminate mirrors or glass, plain paths miss light;
`caustics` replaces them.

The errors of totals come from the spread over seeds, not from the errors that renders report. The reported errors are tested with
pixels: z² of the pixels whose error is below 20 % in both integrators, with one additional seed.

    python3 validation/agreement.py [--scenes sss_statue/scene.toml] [--goal 0.003] [--seconds 120] [--planted]

A scene fails if M00 of a wavelength, or another element, deviates by 5 errors (Student's t for the number of seeds, mapped to a
Gaussian). A scene is *unsure* if the goal was not reached. --planted reduces one integrator's projector power by 2 %. Each scene
that reaches the goal must detect this error.
"""

import argparse
import math
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import numpy as np
    import zarr

    import comparison

ROOT = environment.ROOT
SIZE = 32
# Rounds before the first error estimate, and seconds per round.
FIRST, ROUND_S = 8, 2.0
SCENES = {
    "gold_mirror/scene.toml": "path",
    "coins_mirror/diffuse.toml": "path",
    "crystals/diffuse.toml": "path",
    "disco_ball/diffuse.toml": "path",
    "sss_statue/diffuse.toml": "path",
    "fruits/diffuse.toml": "path",
    "fruits/scene.toml": "path",
    "sss_statue/scene.toml": "path",
    "coins_mirror/scene.toml": "caustics",
    "disco_ball/scene.toml": "caustics",
    "crystals/scene.toml": "caustics",
    "mirror_room/scene.toml": "caustics",
}
LIMIT, PLANTED = 5.0, 0.98


def edited(scene, integrator, dim):
    """Return the scene text for one integrator, with one slice."""
    text = scene.read_text()
    text = text[: text.index("[[slices]]")]
    text = re.sub(r"(?m)^(integrator|manifold|tile) *=.*\n", "", text)
    text, count = re.subn(r"(?m)^resolution = .*$", f"resolution = [{SIZE}, {SIZE}]", text)
    assert count == 2, "a camera and a projector"
    if dim != 1:
        scaled = lambda m: "irradiance = [" + ", ".join(str(float(v) * dim) for v in m[1].split(",")) + "]"
        text, count = re.subn(r"(?m)^irradiance = \[(.*)\]$", scaled, text)
        assert count == 1, "an irradiance"
    text = text.replace("[render]", f'[render]\nintegrator = "{integrator}"\ntile = 8', 1)
    return text + '[[slices]]\nname = "m"\npolarization = "mueller"\n'


class Side:
    """Renders of a scene with one integrator."""

    def __init__(self, scene, integrator, dim, folder, first_seed):
        self.integrator, self.folder, self.seed = integrator, folder, first_seed
        # The file is in the folder of the original, because its mesh paths are relative to that folder.
        self.file = scene.with_name(f".agreement-{scene.stem}-{integrator}-{os.getpid()}.toml")
        self.text = edited(scene, integrator, dim)
        self.means, self.variances, self.seconds = [], 0.0, 0.0
        self.spp = 8
        spent = 0.0
        while spent < ROUND_S / 4 and self.spp < 4096:
            self.spp *= 2
            *_, spent = self.render()
        self.spp = max(8, int(self.spp * ROUND_S / spent))

    def render(self):
        self.file.write_text(self.text)
        store = self.folder / f"{self.integrator}.zarr"
        command = [environment.sunstone(), "render", self.file, "--spp", str(self.spp), "--seed", str(self.seed)]
        try:
            subprocess.run([*command, "-o", store, "--force", "--no-figures"], check=True, capture_output=True)
        finally:
            self.file.unlink()
        self.seed += 1
        group = zarr.open(store, mode="r")
        mean, error = (np.asarray(group["m"][f], np.float64).reshape(SIZE * SIZE, 16, -1) for f in ("mean", "std_error"))
        return mean, error, group.attrs["wall_time_s"]

    def round(self):
        mean, error, spent = self.render()
        self.means.append(mean)
        self.variances = self.variances + error**2
        self.seconds += spent

    def image(self):
        """Return the means of pixels, and the errors that renders report."""
        return np.mean(self.means, axis=0), np.sqrt(self.variances) / len(self.means)

    def totals(self):
        """Return the totals of elements and wavelengths, and the errors of these totals from the spread over seeds."""
        return comparison.mean_and_error([m.sum(axis=0) for m in self.means])


def compare(scene, integrators, goal, seconds, dim):
    """Render until the goal is met or the time is over; return the row of the table."""
    with tempfile.TemporaryDirectory() as temporary:
        path = ROOT / "scenes" / scene
        a, b = (Side(path, name, d, Path(temporary), 1000 * k + 1) for k, (name, d) in enumerate(zip(integrators, (1, dim))))
        begun = time.monotonic()
        for side in [a, b] * FIRST:
            side.round()
        while True:
            (total_a, error_a), (total_b, error_b) = a.totals(), b.totals()
            m00 = total_a[0]
            error = np.hypot(error_a[0], error_b[0]) / m00
            if error.max() <= goal or time.monotonic() - begun > seconds:
                break
            # Reduction of the combined variance per second of render time, for each integrator.
            gain = [((side_error[0] / m00) ** 2).max() / s.seconds for s, side_error in ((a, error_a), (b, error_b))]
            [a, b][int(gain[1] > gain[0])].round()
        sure = error.max() <= goal
        seeds = [len(a.means), len(b.means)]
        sigma = np.hypot(error_a, error_b)
        dof = sigma**4 / np.maximum(error_a**4 / (seeds[0] - 1) + error_b**4 / (seeds[1] - 1), 1e-300)
        t = (total_b - total_a) / np.maximum(sigma, 1e-7 * m00)
        z = np.abs(comparison.gaussian_from_t(t, np.maximum(dof, 1)))
        (x, dx), (y, dy) = a.image(), b.image()
        x, dx, y, dy = (v[:, 0] for v in (x, dx, y, dy))
        known = (x > 0) & (dx < 0.2 * x) & (dy < 0.2 * y)
        pixels = (y - x)[known] / np.hypot(dx, dy)[known]
        return dict(
            scene=scene, integrators=integrators, samples=[n * s.spp * SIZE**2 for n, s in zip(seeds, (a, b))], seeds=seeds, sure=sure,
            difference=(total_b[0] / m00 - 1), error=error, z_total=float(z[0].max()), z_elements=float(z[1:].max()),
            other=float((np.abs(total_b - total_a)[1:] / m00).max()), pixels=int(known.sum()),
            chi2=float((pixels**2).mean()) if known.any() else math.nan, z_pixel=float(np.abs(pixels).max(initial=0.0)),
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="+", default=list(SCENES))
    parser.add_argument("--goal", type=float, default=0.003)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--planted", action="store_true", help="make one side 2 %% darker, which must be detected")
    options = parser.parse_args()
    failed = []
    for scene in options.scenes:
        integrators = (SCENES[scene], "bidirectional")
        r = compare(scene, integrators, options.goal, options.seconds, PLANTED if options.planted else 1)
        totals = ", ".join(f"{100 * d:+.2f} ± {100 * e:.2f}" for d, e in zip(r["difference"], r["error"]))
        print(
            f"{scene}: {r['integrators'][1]} - {r['integrators'][0]}, {totals} % of M00 (largest |z| {r['z_total']:.1f}); other elements "
            f"{100 * r['other']:.2f} % of M00 (|z| {r['z_elements']:.1f}); {r['pixels']} pixels, z² {r['chi2']:.2f}, |z| {r['z_pixel']:.1f}; "
            f"{r['seeds']} seeds, {r['samples'][0] / 1e6:.1f} and {r['samples'][1] / 1e6:.1f} M samples{'' if r['sure'] else ': unsure'}",
            flush=True,
        )
        off = max(r["z_total"], r["z_elements"]) > LIMIT
        if off != options.planted and (r["sure"] or off):
            failed.append(scene)
    if failed:
        sys.exit(f"{'not detected in' if options.planted else 'differ'}: {', '.join(failed)}")


if __name__ == "__main__":
    main()

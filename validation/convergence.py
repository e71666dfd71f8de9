#!/usr/bin/env python3
"""How long each integrator takes until the median lit pixel of a scene is known to 5 %.

Every scene of scenes/ that is meant for bidirectional paths is rendered by each integrator, its conventional image alone.
The relative standard error of a pixel falls with the square root of time, so a short render says how long a longer one
takes. A pixel is lit if the bidirectional render finds at least 1 % of the image's bright light there (99th percentile).
An integrator that does not find all light never gets there, however small its errors: the lit pixels' light together must
be the bidirectional image's within 2 % (and five standard errors), and the median pixel's within 10 %, or "never" is said.

    python3 validation/convergence.py [--scenes disco_ball milky_tank] [--seconds 60] [--record]

With --record, which wants all scenes, the numbers go to results/convergence.json (result_file.py).
"""

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import environment
import result_file

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import numpy as np
    import zarr

ROOT = environment.ROOT
SCENES = ["disco_ball", "milky_tank", "coins_mirror", "sss_statue", "crystals", "fruits"]
GOAL = 0.05


def render(scene, integrator, spp, folder):
    """The mean and relative error of every pixel and wavelength, and the seconds they took."""
    text = scene.read_text()
    text = re.sub(r"(?m)^integrator *=.*\n", "", text)
    text = re.sub(r"(?m)^manifold *=.*\n", "", text)
    text = text.replace("[render]", f'[render]\nintegrator = "{integrator}"', 1)
    # Beside the original, whose meshes are named relative to it.
    file = scene.with_name(f".convergence-{integrator}.toml")
    file.write_text(text)
    try:
        store = folder / f"{integrator}-{spp}.zarr"
        subprocess.run(
            [environment.sunstone(), "render", file, "--spp", str(spp), "--slices", "conventional", "-o", store, "--force"],
            check=True,
            capture_output=True,
        )
    finally:
        file.unlink()
    group = zarr.open(store, mode="r")
    image = group["conventional"]
    mean, error = (np.asarray(image[name]).squeeze() for name in ("mean", "std_error"))
    return mean, error, group.attrs["wall_time_s"]


def measure(scene, integrator, seconds, folder):
    """A render of about so many seconds."""
    spp = 8
    mean, error, took = render(scene, integrator, spp, folder)
    if took < seconds:
        spp = max(spp + 1, int(spp * seconds / max(took, 0.05)))
        mean, error, took = render(scene, integrator, min(spp, 1 << 16), folder)
    return mean, error, took, spp


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--record", action="store_true", help="write results/convergence.json")
    options = parser.parse_args()
    if options.record and set(options.scenes) != set(SCENES):
        sys.exit("--record wants all scenes")
    rows = []
    print(f"time until the median lit pixel is known to {GOAL:.0%} (128 x 128 pixels, all cores)")
    print(f"{'scene':14} {'integrator':14} {'spp':>6} {'took s':>8} {'error':>8} {'to goal s':>10} {'light found':>12}")
    for name in options.scenes:
        scene = ROOT / "scenes" / name / "scene.toml"
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            found = {}
            for integrator in ("bidirectional", "caustics", "path"):
                if integrator == "caustics" and re.search(r"(?m)^interior", scene.read_text()):
                    # With media all paths are traced from both ends.
                    continue
                mean, error, took, spp = measure(scene, integrator, options.seconds, folder)
                image = mean.mean(axis=-1)
                if integrator == "bidirectional":
                    lit = image > 0.01 * np.percentile(image, 99)
                    reference, unsure = mean, error
                relative = np.median(error[lit] / np.maximum(mean[lit], 1e-30))
                share = float(np.median(mean[lit] / reference[lit]))
                whole = float(mean[lit].sum() / reference[lit].sum())
                spread = float(np.hypot(np.linalg.norm(error[lit]), np.linalg.norm(unsure[lit])))
                uncertain = spread / float(reference[lit].sum())
                missing = abs(whole - 1) - 5 * uncertain
                complete = bool(integrator == "bidirectional" or (abs(share - 1) < 0.1 and missing < 0.02))
                seconds = took * (relative / GOAL) ** 2 if complete else None
                row = dict(scene=name, integrator=integrator, spp=spp, took_s=took, median_relative_error=float(relative))
                row.update(seconds_to_goal=seconds, median_share_of_light=share, share_of_all_light=whole)
                rows.append({key: plain(value) for key, value in row.items()})
                found[integrator] = seconds
                goal = f"{seconds:10.1f}" if seconds is not None else f"{'never':>10}"
                print(f"{name:14} {integrator:14} {spp:6} {took:8.1f} {relative:8.4f} {goal} {whole:12.4f}", flush=True)
            if found["path"] is not None:
                print(f"{'':14} bidirectional takes {found['bidirectional'] / found['path']:.2f} of path's time")
    if options.record:
        measures = [*result_file.TRACER, "validation/convergence.py", *(f"scenes/{name}" for name in SCENES)]
        result_file.write("convergence", __file__, measures, numbers(rows), rows=rows)


def plain(value):
    """A number as JSON knows it; null for none."""
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not np.isfinite(value) else value


def numbers(rows):
    """What goes to the result file."""
    out = {"goal": result_file.once(GOAL, "", "a setting")}
    for row in rows:
        key = f"{row['scene']}_{row['integrator']}"
        out[key] = result_file.once(row["seconds_to_goal"], "s", f"from one run of {row['took_s']:.0f} s; null: never")
        out[f"{key}_light"] = result_file.once(row["share_of_all_light"], "of the light that is found", "one run")
    return out


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Compare the cost of equal errors: stratified and independent samples, and Sunstone and Mitsuba.

The mean squared error of a render is that of its pixels against a long render of the same program (`--reference` samples per
pixel with another seed), over all pixels and `--seeds` seeds, relative to the squared mean of the image.

1. Stratified against independent samples of Sunstone (`--replicates 1`, and as many replicates as samples), at equal samples and
   at equal time: the variance of independent samples over that of stratified ones, and this ratio times the ratio of seconds.
   Cases: for the Cornell box of speed.py its image, all 16 elements and a time-resolved row; the images of the mirror room and
   the fruits. (In scenes with media, such as the fruits, only the subpaths from the camera are stratified.)
2. Sunstone against Mitsuba's full-Mueller integrator (speed.py), both as in speed.py, M00 of the image: error times time of
   Mitsuba, with its best sampler, over that of Sunstone; at 550 nm, which Sunstone renders alone too, and for the three
   wavelengths that Sunstone renders together and Mitsuba one by one. Mitsuba's `orthogonal` sampler renders more samples than requested; the actual number counts.

Times are those of speed.py: Sunstone's of the whole process with all files written (in memory if /dev/shm exists), Mitsuba's of
rendering alone.

    python3 validation/equal_error.py [--seeds 3] [--reference 2560] [--record]
"""

import argparse
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import environment
import result_file

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import drjit as dr
    import mitsuba as mi
    import numpy as np
    import zarr

    import speed

    speed.dr, speed.mi, speed.np = dr, mi, np

WAVELENGTHS = [450, 550, 660]
SAMPLERS = ["independent", "stratified", "multijitter", "orthogonal", "ldsampler"]
ROW = '[[slices]]\nname = "row"\ncamera = { rows = [128] }\ntime = { start_ps = 20000, bin_ps = 234.4, bins = 64 }\n'
SIXTEEN = '[[slices]]\nname = "sixteen"\npolarization = "mueller"\n'
IMAGE = '[[slices]]\nname = "image"\n'


def only(scene, slices):
    """Return the text of a scene with other slices and without figures."""
    blocks = re.split(r"(?m)^(?=\[\[)", scene.read_text())
    return "".join(b for b in blocks if not b.startswith(("[[slices]]", "[[figures]]"))) + slices


def render(file, name, spp, seed, replicates, folder):
    """Return the means of a slice, and the seconds of the render."""
    store = folder / "out.zarr"
    program = [environment.sunstone(), "render", file, "-o", store, "--force", "--no-figures", "--spp", spp]
    begun = time.perf_counter()
    subprocess.run([*map(str, program), "--seed", str(seed), "--replicates", str(replicates)], check=True, capture_output=True)
    took = time.perf_counter() - begun
    return np.asarray(zarr.open(store, mode="r")[name]["mean"], dtype=np.float64).squeeze(), took


def error(images, reference):
    """Return the relative mean squared error. All elements of matrices have equal weight, relative to M00."""
    scale = reference[..., 0, 0, :] if reference.ndim == 5 else reference
    return float(np.mean([(image - reference) ** 2 for image in images]) / np.mean(scale) ** 2)


def check_error():
    """Check that images of known error give that error, and that ten percent more is detected."""
    rng = np.random.default_rng(1)
    reference = rng.uniform(1, 3, (64, 64, 3))
    of = lambda sigma: error([reference + sigma * rng.standard_normal(reference.shape) for _ in range(3)], reference)
    base = of(0.1)
    if abs(base / (0.01 / np.mean(reference) ** 2) - 1) > 0.04 or not 1.05 < of(0.1 * 1.1**0.5) / base < 1.15:
        sys.exit("the function `error` does not return the known error")


def stratified(folder, seeds, reference_spp):
    """Return ratios of independent to stratified samples: of variance, and of variance times time."""
    scenes = environment.ROOT / "scenes"
    cases = [
        ("cornell_image", speed.SCENE, IMAGE, "image", [16, 64]),
        ("cornell_16_elements", speed.SCENE, SIXTEEN, "sixteen", [64]),
        ("cornell_row_over_time", speed.SCENE, ROW, "row", [64]),
        ("mirror_room", scenes / "mirror_room/scene.toml", IMAGE, "image", [64]),
        ("fruits", scenes / "fruits/scene.toml", IMAGE, "image", [64]),
    ]
    out = {}
    for name, scene, slices, slice_name, counts in cases:
        # The file is in the folder of the original, because its mesh paths are relative to that folder.
        file = scene.with_name(f".equal-error-{name}.toml")
        file.write_text(only(scene, slices))
        try:
            reference, _ = render(file, slice_name, reference_spp, 1000, 1, folder)
            for spp in counts:
                found = {}
                for what, replicates in (("stratified", 1), ("independent", spp)):
                    renders = [render(file, slice_name, spp, seed, replicates, folder) for seed in range(1, seeds + 1)]
                    found[what] = error([r[0] for r in renders], reference), min(r[1] for r in renders)
                (e, t), (f, u) = found["stratified"], found["independent"]
                out[f"{name}_{spp}"] = f / e
                out[f"{name}_{spp}_equal_time"] = f * u / (e * t)
                print(f"{name:24} {spp:4} samples: {f / e:6.2f} times less variance, {f * u / (e * t):6.2f} at equal time", flush=True)
        finally:
            file.unlink()
    return out


def mitsuba(scene, sampler, spp, seed):
    """Return M00 of one render, its seconds and its samples per pixel."""
    made = mi.load_dict({"type": sampler, "sample_count": spp})
    really = made.sample_count()
    film = []
    took = speed.timed(lambda: film.append(speed.full_mueller(scene, really, seed, made)))
    film = np.array(film[0], dtype=np.float64).reshape(speed.RESOLUTION, speed.RESOLUTION, speed.BINS, 16)
    return film[..., 0].sum(axis=-1) / really, took, really


def scenes_of_mitsuba(folder, reference_spp):
    """Return, for each wavelength, Mitsuba's scene of the Cornell box and a long render of this scene."""
    out = {}
    for wavelength in WAVELENGTHS:
        scene = mi.load_file(speed.export(folder / f"mono-{wavelength}", "--wavelength", str(wavelength)))
        # Rendered in parts, because a wavefront of all samples would exceed the memory.
        parts = [mitsuba(scene, "independent", 64, 1000 + k)[0] for k in range(max(1, reference_spp // 64))]
        out[wavelength] = scene, np.mean(parts, axis=0)
    return out


def mitsuba_cost(scene, reference, sampler, spp, seeds):
    """Return error, seconds and samples of renders with a sampler."""
    mitsuba(scene, sampler, spp, 999)
    renders = [mitsuba(scene, sampler, spp, seed) for seed in range(1, seeds + 1)]
    return error([r[0] for r in renders], reference), min(r[1] for r in renders), renders[0][2]


def one_wavelength(scene, k):
    """Return the text of the Cornell box with wavelength k alone."""
    text, lists = re.subn(r"(albedo = )\[([^]]*)\]", lambda m: m[1] + m[2].split(",")[k], scene)
    text, found = re.subn(r"(wavelengths_nm = )\[.*\]", rf"\1[{WAVELENGTHS[k]}]", text)
    if not lists or found != 1:
        sys.exit("the Cornell box has no lists of albedos or wavelengths")
    return text


def against_mitsuba(folder, seeds, reference_spp):
    """Return error times time of Mitsuba over that of Sunstone: of one wavelength, and of all three, which Mitsuba renders one by
    one.
    """
    mi.set_variant(speed.MONO)
    scenes = scenes_of_mitsuba(folder, reference_spp)
    out = {}
    files = [speed.SCENE.with_name(f".equal-error-{name}.toml") for name in ("complete", "one")]
    try:
        complete = speed.SCENE.read_text() + IMAGE
        for file, text in zip(files, (complete, one_wavelength(complete, 1))):
            file.write_text(text)
        references = [render(file, "image", reference_spp, 1000, 1, folder)[0] for file in files]
        for spp in (16, 64):
            renders = [[render(file, "image", spp, seed, 1, folder) for seed in range(1, seeds + 1)] for file in files]
            took, took_one = (min(r[1] for r in rs) for rs in renders)
            mine = [error([r[0][..., k] for r in renders[0]], references[0][..., k]) for k in range(len(WAVELENGTHS))]
            mine_one = error([r[0] for r in renders[1]], references[1])
            best = None
            for sampler in SAMPLERS:
                e, t, really = mitsuba_cost(*scenes[WAVELENGTHS[1]], sampler, spp, seeds)
                cost = e * t / (mine_one * took_one)
                print(f"{spp:4} samples: Mitsuba, {sampler:12} {really:4} samples, error {e:.3e} (ours {mine_one:.3e}), "
                      f"{t:.2f} s (ours {took_one:.2f} s): {cost:5.2f} times the time for an equal error", flush=True)
                best = min(best or (cost, sampler), (cost, sampler))
            each = [mitsuba_cost(*scenes[w], best[1], spp, seeds) for w in WAVELENGTHS]
            # Mitsuba's time is divided among the wavelengths so that all three errors equal Sunstone's.
            all_three = sum(e * t / m for (e, t, _), m in zip(each, mine)) / took
            print(f"{spp:4} samples: Mitsuba's best sampler, {best[1]}, takes {best[0]:.2f} times as long for an equal error of one "
                  f"wavelength, {all_three:.2f} times for equal errors of three")
            out[f"mitsuba_{spp}"], out[f"mitsuba_{spp}_all_wavelengths"] = best[0], all_three
    finally:
        for file in files:
            file.unlink(missing_ok=True)
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--reference", type=int, default=2560)
    parser.add_argument("--record", action="store_true", help="write results/equal_error.json")
    options = parser.parse_args()
    check_error()
    with tempfile.TemporaryDirectory(dir=environment.in_memory()) as temporary:
        folder = Path(temporary)
        numbers = stratified(folder, options.seeds, options.reference)
        numbers |= against_mitsuba(folder, options.seeds, options.reference)
    if options.record:
        measures = [*result_file.TRACER, "scenes/mirror_room", "scenes/fruits", "validation/equal_error.py", "validation/speed.py"]
        numbers = {key: result_file.once(value, "times", f"{options.seeds} seeds") for key, value in numbers.items()}
        result_file.write("equal_error", __file__, measures, numbers, {"mitsuba": mi.__version__})


if __name__ == "__main__":
    main()

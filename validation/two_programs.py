#!/usr/bin/env python3
"""Compare the renders of two versions of the program on all shipped scene files, with independent seeds.

Use this script after a change that alters results by rounding or by another order of samples, but not their expected values.

    python validation/two_programs.py OLD NEW [--seconds 1.5] [--seeds 6] [--planted]

Each scene file is rendered at 48 x 48 pixels. The totals over the image of all elements and wavelengths are compared with Student's
t. Their errors come from the spread over seeds. The script fails if a comparison is less probable than 0.001 over the number of all
comparisons. --planted scales the second program's renders by 0.98: the table shows which scenes detect this error. The last column
is the fraction of pixels that differ by more than 1e-4 of the largest value if both programs use the same seed.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import numpy as np
    import zarr

    import comparison

SCENES = environment.ROOT / "scenes"
SIZE, PLANTED, SIGNIFICANCE = 48, 0.98, 1e-3


def edited(path):
    """Return the scene's text with few pixels and one slice, or None if the file is not a scene with a camera."""
    text = path.read_text()
    if not all(part in text for part in ("[[slices]]", "[camera]", "[render]")):
        return None
    text = re.sub(r"(?m)^tile *=.*\n", "", text[: text.index("[[slices]]")])
    text = re.sub(r"(?m)^resolution = .*$", f"resolution = [{SIZE}, {SIZE}]", text)
    return text.replace("[render]", "[render]\ntile = 8", 1) + '[[slices]]\nname = "m"\npolarization = "mueller"\n'


def render(program, scene, spp, seed, folder):
    """Return the means (pixels, elements, wavelengths) and the render time."""
    store = folder / "out.zarr"
    words = [program, "render", scene, "--spp", spp, "--seed", seed, "-o", store, "--force", "--no-figures"]
    subprocess.run([str(word) for word in words], check=True, capture_output=True)
    group = zarr.open(store, mode="r")
    return np.asarray(group["m"]["mean"], float).reshape(SIZE * SIZE, 16, -1), group.attrs["wall_time_s"]


def compare(path, options, folder):
    """Render with both programs; return the probabilities of the comparisons after printing a row."""
    # The file is in the folder of the original, because its mesh paths are relative to that folder.
    scene = path.with_name(f".two-programs-{path.stem}.toml")
    scene.write_text(edited(path))
    try:
        _, seconds = render(options.old, scene, 16, 1, folder)
        spp = max(16, min(16384, 2 ** int(np.log2(16 * options.seconds / max(seconds, 1e-3)))))
        totals = []
        for k, program in enumerate((options.old, options.new)):
            images = [render(program, scene, spp, 100 * (k + 1) + seed, folder)[0] for seed in range(options.seeds)]
            totals.append(comparison.mean_and_error([image.sum(axis=0) for image in images]))
        same = [render(program, scene, 32, 7, folder)[0] for program in (options.old, options.new)]
    finally:
        scene.unlink()
    (old, old_error), (new, new_error) = totals
    difference, error = new * (PLANTED if options.planted else 1) - old, np.hypot(old_error, new_error)
    noisy = error > 0
    z = comparison.gaussian_from_t(difference[noisy] / error[noisy], 2 * (options.seeds - 1))
    p = np.array([comparison.two_sided(x) for x in z])
    apart = np.abs(same[0] - same[1]).max(axis=(1, 2)) > 1e-4 * np.abs(same[0]).max()
    print(f"{str(path.relative_to(SCENES)):28} {spp:5} {np.abs(z).max():7.2f} {p.min():8.2g} {p.size:4} "
          f"{np.abs(difference[0] / old[0]).max():9.1e} {(error[0] / old[0]).max():8.1e} {apart.mean():7.3f}", flush=True)
    return p


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--seconds", type=float, default=1.5, help="time of each render")
    parser.add_argument("--seeds", type=int, default=6, help="renders of each program")
    parser.add_argument("--planted", action="store_true", help="scale the second program's renders")
    options = parser.parse_args()
    print(f"{'scene':28} {'spp':>5} {'max |z|':>7} {'least p':>8} {'':4} {'M00':>9} {'error':>8} {'differ':>7}")
    with tempfile.TemporaryDirectory() as folder:
        paths = [path for path in sorted(SCENES.glob("*/*.toml")) if not path.name.startswith(".") and edited(path)]
        all_p = np.concatenate([compare(path, options, Path(folder)) for path in paths])
    bound = SIGNIFICANCE / all_p.size
    passed = all_p.min() > bound
    print(f"{all_p.size} comparisons of {len(paths)} scenes: least p {all_p.min():.2g}, bound {bound:.2g}, {'agree' if passed else 'DIFFER'}")
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""Compare the renders of two versions of the program on all shipped scene files, with independent seeds.

Use this script after a change that alters results by rounding or by another order of samples, but not their expected values.

    python validation/two_programs.py OLD NEW [--seconds 1.5] [--seeds 6] [--replicates 32] [--planted]

Each scene file is rendered at 48 x 48 pixels. The totals over the image of all elements and wavelengths are compared with Student's
t. Their errors come from the spread over seeds. The script fails if a comparison is less probable than 0.001 over the number of all
comparisons. --planted scales the second program's renders by 0.98: the table shows which scenes detect this error, and the script
fails if none does. The last column is the fraction of pixels that differ by more than 1e-4 of the largest value if both programs use the same seed.
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


def edited(text):
    """Return the text of a scene file with few pixels and one slice."""
    text = re.sub(r"(?m)^tile *=.*\n", "", text[: text.index("[[slices]]")])
    text = re.sub(r"(?m)^resolution = .*$", f"resolution = [{SIZE}, {SIZE}]", text)
    return text.replace("[render]", "[render]\ntile = 8", 1) + '[[slices]]\nname = "m"\npolarization = "mueller"\n'


def render(program, scene, spp, seed, options, folder):
    """Return the means (pixels, elements, wavelengths) and the render time."""
    store = folder / "out.zarr"
    words = [program, "render", scene, "--spp", spp, "--seed", seed, "--replicates", options.replicates]
    words += ["-o", store, "--force", "--no-figures"]
    subprocess.run([str(word) for word in words], check=True, capture_output=True)
    group = zarr.open(store, mode="r")
    return np.asarray(group["m"]["mean"], float).reshape(SIZE * SIZE, 16, -1), group.attrs["wall_time_s"]


def compare(path, text, options, folder):
    """Render a scene with both programs, and print a row; return the differences of the totals as unit Gaussians."""
    # The file is in the folder of the original, because its mesh paths are relative to that folder.
    scene = path.with_name(f".two-programs-{path.stem}.toml")
    scene.write_text(edited(text))
    try:
        _, seconds = render(options.old, scene, 16, 1, options, folder)
        spp = max(16, min(16384, 2 ** int(np.log2(16 * options.seconds / max(seconds, 1e-3)))))
        totals = []
        for k, program in enumerate((options.old, options.new)):
            images = [render(program, scene, spp, 100 * (k + 1) + seed, options, folder)[0] for seed in range(options.seeds)]
            totals.append(comparison.mean_and_error([image.sum(axis=0) for image in images]))
        same = [render(program, scene, 32, 7, options, folder)[0] for program in (options.old, options.new)]
    finally:
        scene.unlink()
    (old, old_error), (new, new_error) = totals
    new *= PLANTED if options.planted else 1
    z, variance, _ = comparison.z_scores(new, new_error, old, old_error, options.seeds, old.max(), options.seeds)
    greatest = np.abs(z).max()
    apart = np.abs(same[0] - same[1]).max(axis=(1, 2)) > 1e-4 * np.abs(same[0]).max()
    print(f"{str(path.relative_to(SCENES)):28} {spp:5} {greatest:7.2f} {comparison.two_sided(greatest):8.2g} {z.size:4} "
          f"{np.abs(new[0] / old[0] - 1).max():9.1e} {(np.sqrt(variance[0]) / old[0]).max():8.1e} {apart.mean():7.3f}", flush=True)
    return z.ravel()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--seconds", type=float, default=1.5, help="time of each render")
    parser.add_argument("--seeds", type=int, default=6, help="renders of each program")
    parser.add_argument("--replicates", type=int, default=32, help="groups of stratified samples; 1 has most effect")
    parser.add_argument("--planted", action="store_true", help="scale the second program's renders")
    options = parser.parse_args()
    print(f"{'scene':28} {'spp':>5} {'max |z|':>7} {'least p':>8} {'':4} {'M00':>9} {'error':>8} {'differ':>7}")
    with tempfile.TemporaryDirectory() as folder:
        texts = {path: path.read_text() for path in sorted(SCENES.glob("*/*.toml"))}
        texts = {path: text for path, text in texts.items() if all(part in text for part in ("[[slices]]", "[camera]", "[render]"))}
        z = np.concatenate([compare(path, text, options, Path(folder)) for path, text in texts.items()])
    least, bound = comparison.two_sided(np.abs(z).max()), SIGNIFICANCE / z.size
    agree = least > bound
    print(f"{z.size} comparisons of {len(texts)} scenes: least p {least:.2g}, bound {bound:.2g}, {'agree' if agree else 'DIFFER'}")
    return 0 if agree != options.planted else 1


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""Render the images of scenes/README.md: every shipped scene at 512 × 512 pixels; print the render time of each scene.

Two seeds are rendered, and each is denoised with the other's errors (`sunstone denoise`), as the titles of the images state.
Only the slices that the images show are rendered.

    python3 tools/gallery.py [SCENE ...] [--scale 1.0]

--scale multiplies the number of samples. Requires `cargo build --release`; standard library only.
"""

import argparse
import re
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SIZE = 512
# Samples per seed, and the images to keep.
FOUR = ["photo", "epipolar", "nonepipolar", "mueller"]
SCENES = {
    "mirror_room": (128, ["photo", "mueller_nonepipolar"]),
    "gold_mirror": (64, ["mueller"]),
    "disco_ball": (128, FOUR),
    "coins_mirror": (256, FOUR),
    "fruits": (128, FOUR),
    "milky_tank": (192, FOUR),
    "sss_statue": (192, FOUR),
    "crystals": (128, FOUR),
}


def blocks(text):
    """Return the tables of a scene file."""
    return re.split(r"(?m)^(?=\[\[|\[camera\])", text)


def wanted(text, pictures):
    """Return the scene at another size, with only the named images and their slices."""
    named = lambda block: re.search(r'(?m)^name = "([^"]+)"', block)
    figures = [b for b in blocks(text) if b.startswith("[[figures]]") and named(b)[1] in pictures]
    shown = {m for b in figures for m in re.findall(r'slice = "([^"]+)"', b)}
    out = ""
    for block in blocks(text):
        if block.startswith("[camera]"):
            block = re.sub(r"resolution = \[\d+, \d+\]", f"resolution = [{SIZE}, {SIZE}]", block, count=1)
        if block.startswith("[[figures]]") and named(block)[1] not in pictures:
            continue
        if block.startswith("[[slices]]") and named(block)[1] not in shown:
            continue
        out += block
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--scale", type=float, default=1.0)
    options = parser.parse_args()
    sunstone = ROOT / "target/release/sunstone"
    for name in options.scenes or SCENES:
        samples, pictures = SCENES[name]
        samples = max(8, round(samples * options.scale))
        folder = ROOT / "scenes" / name
        # The file is in the folder of the original, because its mesh paths are relative to that folder.
        file = folder / ".gallery.toml"
        file.write_text(wanted((folder / "scene.toml").read_text(), pictures))
        with tempfile.TemporaryDirectory() as temporary:
            run = lambda *words: subprocess.run([sunstone, *map(str, words)], cwd=temporary, check=True, capture_output=True)
            try:
                begun = time.perf_counter()
                for seed in (1, 2):
                    run("render", file, "--spp", samples, "--seed", seed, "-o", f"{seed}.zarr", "--no-figures")
                took = time.perf_counter() - begun
            finally:
                file.unlink()
            run("denoise", "1.zarr", "2.zarr", "-o", "figures.zarr")
            run("figure", "figures.zarr")
            made = {p.stem: p for p in Path(temporary).glob("figures.figures/*.png")}
            (folder / "figures").mkdir(exist_ok=True)
            for picture in pictures:
                shutil.copy(made[picture], folder / "figures" / f"{picture}.png")
        print(f"{name}: {SIZE} × {SIZE} pixels, 2 × {samples} samples, {took:.0f} s and {time.perf_counter() - begun - took:.0f} s to denoise and draw", flush=True)


if __name__ == "__main__":
    main()

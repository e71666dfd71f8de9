#!/usr/bin/env python3
"""Measure the speed of the explorer (`sunstone view`) in Chromium: the first image of a new server, the numbers of a clicked pixel, and
the image after a change of the polarization state.

The store is the mirror room with rough gold on all diffuse surfaces, so that all elements of the Mueller matrices have values: 512 x 512
pixels, three wavelengths; a slice with Mueller matrices, and a slice with Mueller matrices in 120 time bins. The measurements are those of
src/view/page/browser/speed.spec.ts, which needs Node, and the packages that `npm ci` in src/view/page installs.

    python3 validation/view_speed.py [--samples 40] [--resolution 512] [--bins 120] [--record]

With --record the numbers go to results/view_speed.json.
"""

import argparse
import json
import os
import re
import subprocess
import tempfile
from pathlib import Path

import environment
import result_file

ROOT = environment.ROOT
PAGE = ROOT / "src/view/page"
GOLD = 'rough_conductor = { metal = "gold", alpha = 0.5 }'
#: Names of the measurements in the specification, and keys of the result file.
KEYS = {
    "navigation to first image": ("first_image", "ms"),
    "click to numbers": ("click", "ms"),
    "state change, colour": ("state_colour", "ms"),
    "state change, intensity": ("state_intensity", "ms"),
    "state change, dolp": ("state_dolp", "ms"),
    "largest memory of the server in MB": ("memory", "MB"),
}


def store(folder, options):
    """Render the store; return its path."""
    scenes = ROOT / "scenes/mirror_room"
    text = (scenes / "scene.toml").read_text()
    text = re.sub(r"diffuse\.albedo = \[[^\]]*\]", GOLD, text[: text.index("# Slices of T")])
    text = text.replace("resolution = [256, 256]", f"resolution = [{options.resolution}, {options.resolution}]", 1)
    text = text.replace('file = "', f'file = "{scenes}/')
    text += '[[slices]]\nname = "polarimetric"\npolarization = "mueller"\n'
    text += '[[slices]]\nname = "cube"\npolarization = "mueller"\n'
    text += f"time = {{ start_ps = 10000, bin_ps = {12000 / options.bins}, bins = {options.bins} }}\n"
    scene, out = folder / "scene.toml", folder / "room.zarr"
    scene.write_text(text)
    words = ["render", scene, "--spp", str(options.samples), "--no-figures", "-o", out]
    subprocess.run([environment.sunstone(), *words], check=True, capture_output=True)
    return out


def measure(path, slice_name):
    """Return the measurements of a slice: lists of 20 values by name."""
    env = {**os.environ, "VIEW_SPEED": str(path), "VIEW_SLICE": slice_name, "SUNSTONE": str(environment.sunstone())}
    subprocess.run(["npx", "playwright", "test", "speed"], cwd=PAGE, env=env, check=True, stdout=subprocess.DEVNULL)
    return json.loads((ROOT / "target/view/speed.json").read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--samples", type=int, default=40)
    parser.add_argument("--resolution", type=int, default=512)
    parser.add_argument("--bins", type=int, default=120)
    parser.add_argument("--record", action="store_true", help="write results/view_speed.json")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        path = store(Path(temporary), options)
        size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file()) / 1e9
        numbers = {"size": result_file.once(size, "GB")}
        print(f"store of {size:.2f} GB")
        for name in ("polarimetric", "cube"):
            for text, values in measure(path, name).items():
                print(f"{name:14} {text:40} median {sorted(values)[len(values) // 2]:8.1f}, {min(values):.1f} to {max(values):.1f}")
                if text in KEYS:
                    key, unit = KEYS[text]
                    numbers[f"{name}_{key}"] = result_file.rounds(values, unit, spread=f"{len(values)} times")
    if options.record:
        measures = ["src/view", "src/store/probe", "validation/view_speed.py"]
        result_file.write("view_speed", __file__, measures, numbers)


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Test whether light from inside a crystal with rough faces contributes to -(3,3).

Renders the quartz of scenes/crystals/faces.toml and glass of its mean index (the same crystal with n_o = n_e = 1.5505) with
several seeds. For the pixels that show only the crystal, prints -(3,3) minus the contribution of a single surface reflection,
over the intensity of all other light; for all light and for epipolar light.

    python3 validation/crystal_faces.py [--seeds 5] [--spp 128] [--sunstone target/release/sunstone]

Requires numpy and xarray with zarr. A single reflection contributes -(3,3) equal to its intensity times a factor from the closed
form at the pixel's half angle. Here the half angle is within 15 degrees and the factor is taken as 1, with an error below 0.003.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

SCENES = Path(__file__).resolve().parent.parent / "scenes/crystals"
GLASS = "quartz.crystal = { n_o = 1.5505, n_e = 1.5505, axis = [1, 0, 0], roughness = 0.3 }"
# Bits of the label: facets only.
GLOSSY = 4


def scenes(folder):
    """Return both scenes, rotated by 21 degrees about the optic axis, without variants."""
    text = (SCENES / "faces.toml").read_text()
    text = text[: text.index("[vary.")].replace("rotate_deg = [0, 0, 0]", "rotate_deg = [21, 0, 0]")
    for name in ("quartz.ply", "pattern.png"):
        (folder / name).write_bytes((SCENES / name).read_bytes())
    lines = text.splitlines()
    glass = [GLASS if line.startswith("quartz.crystal") else line for line in lines]
    assert glass != lines
    for name, scene in (("quartz", lines), ("glass", glass)):
        (folder / f"{name}.toml").write_text("\n".join(scene) + "\n")


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--seeds", type=int, default=5)
    p.add_argument("--spp", type=int, default=128)
    p.add_argument("--sunstone", default="target/release/sunstone")
    args = p.parse_args()
    import numpy as np
    import xarray

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scenes(folder)

        def sunstone(*words):
            subprocess.run([args.sunstone, *map(str, words)], check=True, capture_output=True)

        print("| | other light over the surface's | -(3,3) of other light over its intensity | over the surface's light |")
        print("|---|---|---|---|")
        for scene in ("quartz", "glass"):
            sunstone("layers", folder / f"{scene}.toml", "-o", folder / "layers.npz")
            layers = np.load(folder / "layers.npz")
            names = list(layers["object_names"])
            mask = (layers["object"] == names.index("crystal")) & (layers["coverage"] == 1.0)
            rows = {"all light": [], "epipolar light": []}
            for seed in range(1, args.seeds + 1):
                store = folder / f"{scene}{seed}.zarr"
                sunstone("render", folder / f"{scene}.toml", "--spp", args.spp, "--seed", seed, "-o", store)

                def total(group):
                    mean = xarray.open_zarr(store, group=group)["mean"].astype("f8").sum("wavelength")
                    return mean.where(xarray.DataArray(mask, dims=("y", "x")), 0.0).sum(("y", "x"))

                surface = float(total("paths").sel(label=GLOSSY, bounces=1))
                for light, group in zip(rows, ("polarimetric", "epipolar")):
                    m = total(group).values
                    rows[light].append((m[0, 0] / surface - 1.0, (-m[3, 3] - surface) / (m[0, 0] - surface), -m[3, 3] / surface - 1.0))
            for light, found in rows.items():
                found = np.array(found)
                mean, error = found.mean(0), found.std(0, ddof=1) / np.sqrt(len(found))
                cells = [f"{a:.4f} ± {b:.4f}" for a, b in zip(mean, error)]
                print(f"| {scene}, {light} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()

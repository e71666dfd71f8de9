#!/usr/bin/env python3
"""Draw the figure files of scenes/figures at full size, and write the small copies that scenes/figures/README.md shows.

    .venv/bin/python tools/figures.py [NAME ...] [--renders FOLDER] [--format pdf]

The full pictures are written to out/figures. The copies are 1600 pixels wide. Finished renders are kept and
used again, so that only what changed is rendered, and an interrupted command continues where it stopped. `sunstone figure` prints
the time of each render. Requires `cargo build --release` and the packages of validation/requirements.txt.
"""

import argparse
import shutil
import subprocess
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "scenes/figures"
WIDTH = 1600


def copy_small(source, target):
    """Write a copy of a picture that is at most WIDTH pixels wide. An animation is copied as it is."""
    if source.suffix == ".apng":
        shutil.copyfile(source, target)
        return
    picture = Image.open(source).convert("RGB")
    if picture.width > WIDTH:
        picture = picture.resize((WIDTH, round(picture.height * WIDTH / picture.width)), Image.Resampling.LANCZOS)
    picture.save(target, optimize=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=sorted(file.stem for file in FIGURES.glob("*.toml")))
    parser.add_argument("--renders", type=Path, default=ROOT / "out/apply/renders")
    parser.add_argument("--format", choices=["png", "pdf"], default="png", help="pdf: no copies")
    options = parser.parse_args()
    folder = ROOT / "out/figures"
    folder.mkdir(parents=True, exist_ok=True)
    for name in options.names:
        file = FIGURES / f"{name}.toml"
        ending = "apng" if "\nanimation = true" in file.read_text() else options.format
        drawn = folder / f"{name}.{ending}"
        command = [ROOT / "target/release/sunstone", "figure", file, "--renders", options.renders, "-o", drawn]
        subprocess.run([str(word) for word in command], check=True)
        if ending != "pdf":
            copy_small(drawn, FIGURES / drawn.name)


if __name__ == "__main__":
    main()

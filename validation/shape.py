#!/usr/bin/env python3
"""Compare the joint method of `sunstone apply shape` with every other method, on arrangements that no method was chosen on.

The test variants are twelve arrangements from number 1002: two for each pair of statue and material. The errors are standard errors
over the arrangements. Differences are computed on the same renders.

    python validation/shape.py [--levels 64x32 64x128 256x32] [--renders FOLDER] [--write docs/applications/shape.json]

A level is the number of pixels, and the number of samples per pixel. The tables are printed in Markdown. --write adds the scores of
every arrangement to a file.
"""

import argparse
import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import numpy as np

# Even variants are translucent. Six successive ones are all materials of one statue. Variants 12 to 22 were test variants before.
TRAIN = {64: "0-10/2,24-40/2", 256: "24-34/2"}
TEST = "1002-1024/2"
JOINT = "joint"
METRICS = {"normals, mean error": 2, "normals, mean error where the scan has normals": 2, "depth, mean error": 3, "coverage": 3}


def scores(level, renders, folder):
    """Run the application and return, for each metric and method, the score of each arrangement."""
    pixels, spp = level.split("x")
    program = [environment.sunstone(), "apply", "shape", "--preview", "--pixels", pixels, "--spp", spp, "--seeds", 1]
    program += ["--train", TRAIN[int(pixels)], "--test", TEST, "--reference", JOINT, "--renders", renders, "-o", folder]
    program += ["--scenes", environment.ROOT / "scenes"]
    printed = subprocess.run([str(word) for word in program], check=True, stdout=subprocess.PIPE, text=True).stdout
    print("\n".join(line for line in printed.splitlines() if line.startswith("note: joint")))
    found = {}
    with open(folder / "scores.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["metric"] in METRICS:
                value = float(row["value"]) if row["value"] else None
                found.setdefault(row["metric"], {}).setdefault(row["method"], {})[row["variant"]] = value
    return found


def cell(values, digits):
    """Return the mean and its standard error as text, or an empty text without values."""
    if None in values:
        return ""
    return f"{np.mean(values):.{digits}f} ± {np.std(values, ddof=1) / len(values) ** 0.5:.{digits}f}"


def table(found):
    """Print a Markdown table of the means, and of the joint method minus each method."""
    print("| method | " + " | ".join(f"{m} | joint minus this" for m in METRICS) + " |\n" + "|---" * (2 * len(METRICS) + 1) + "|")
    for method in found["coverage"]:
        cells = [method]
        for metric, digits in METRICS.items():
            joint, own = ([found[metric][m][v] for v in sorted(found[metric][m])] for m in (JOINT, method))
            cells.append(cell(own, digits))
            difference = [None] if None in own else list(np.subtract(joint, own))
            cells.append("" if method == JOINT else cell(difference, digits + 1))
        print("| " + " | ".join(cells) + " |")
    print()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--levels", nargs="+", default=["64x32", "64x128"], help="pixels x samples per pixel")
    parser.add_argument("--renders", type=Path, default=environment.ROOT / "out/apply/renders")
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    options.renders.mkdir(parents=True, exist_ok=True)
    for level in options.levels:
        with tempfile.TemporaryDirectory() as folder:
            found = scores(level, options.renders, Path(folder))
        print(f"\n{level} (pixels x samples per pixel), {len(found['coverage'][JOINT])} arrangements:\n")
        table(found)
        if options.write:
            before = json.loads(options.write.read_text()) if options.write.exists() else {}
            options.write.write_text(json.dumps(before | {level: found}, indent=1) + "\n")


if __name__ == "__main__":
    main()

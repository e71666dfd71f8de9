#!/usr/bin/env python3
"""Compare the joint methods of `sunstone apply scattering` with every baseline, on arrangements that no method was chosen on.

The methods are trained on 15 variants (three arrangements in five concentrations of milk), and tested on 24 variants from number
1003 (eight arrangements in three concentrations). A score is averaged over concentrations and seeds. The errors are standard errors
over the arrangements, because scores of one arrangement are correlated. A joint method is compared with baselines that have the
same spatial help: the method without means over 3 x 3 pixels with those without, the method with means with those with means.
Rows that end in `same scene` are fitted to the truth of the test variant, and are compared with the joint method fitted so.

    python validation/scattering.py [--levels 16x3 96x1] [--renders FOLDER] [--write docs/applications/scattering.json]

A level is the number of samples per pixel, and the number of seeds. The tables are printed in Markdown. --write writes the scores
of every arrangement.
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

TRAIN, TEST, CONCENTRATIONS = "1-5,13-17,25-29", "1003-1049/2", 6
JOINT, MEANS, SAME = "joint: space, polarization, time", ", 3 × 3", ", same scene"
NEW = ("W, b", "time-gated", "joint")
METRICS = ("PSNR", "SSIM")


def scores(spp, seeds, renders, folder):
    """Run the application and return, for each metric and method, the mean score of each arrangement."""
    program = [environment.sunstone(), "apply", "scattering", "--preview", "--spp", spp, "--seeds", seeds, "--train", TRAIN]
    program += ["--test", TEST, "--renders", renders, "-o", folder, "--scenes", environment.ROOT / "scenes"]
    subprocess.run([str(word) for word in program], check=True, stdout=subprocess.DEVNULL)
    found = {}
    with open(folder / "scores.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["metric"] in METRICS:
                of_method = found.setdefault(row["metric"], {}).setdefault(row["method"], {})
                of_method.setdefault(int(row["variant"]) // CONCENTRATIONS, []).append(float(row["value"]))
    return {metric: {m: [float(np.mean(a[k])) for k in sorted(a)] for m, a in methods.items()} for metric, methods in found.items()}


def estimate(values):
    """Return the mean and its standard error."""
    return np.mean(values), np.std(values, ddof=1) / len(values) ** 0.5


def table(found):
    """Print a Markdown table, and return the baselines that are ahead by more than two standard errors."""
    ahead = []
    print("| method | PSNR [dB] | joint minus this | SSIM | joint minus this |\n|---|---|---|---|---|")
    for method in found["PSNR"]:
        cells = [method]
        reference = JOINT + next((end for end in (MEANS, SAME) if method.endswith(end)), "")
        for metric, digits in zip(METRICS, (2, 3)):
            mine, own = found[metric][reference], found[metric][method]
            mean, error = estimate(own)
            difference, uncertain = estimate(np.subtract(mine, own))
            cells.append(f"{mean:.{digits}f} ± {error:.{digits}f}")
            cells.append("" if method == reference else f"{difference:.{digits}f} ± {uncertain:.{digits}f}")
            if not method.startswith(NEW) and not method.endswith(SAME) and difference < -2 * uncertain:
                ahead.append(f"{method} ({metric})")
        print("| " + " | ".join(cells) + " |")
    print()
    return ahead


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--levels", nargs="+", default=["16x3", "96x1"], help="samples per pixel x seeds")
    parser.add_argument("--renders", type=Path, default=environment.ROOT / "out/apply/renders")
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    options.renders.mkdir(parents=True, exist_ok=True)
    found, ahead = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for level in options.levels:
            spp, seeds = level.split("x")
            found[level] = scores(spp, seeds, options.renders, Path(folder) / level)
            print(f"\n{spp} samples per pixel, {seeds} seeds, {len(found[level]['PSNR'][JOINT])} arrangements:\n")
            ahead += [f"{level}: {one}" for one in table(found[level])]
    print("baselines ahead by more than two standard errors:", "; ".join(ahead) or "none")
    if options.write:
        options.write.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Measure the time of `sunstone learn` for 16 captures, and the difference of its error from the lowest possible error.

The bound is σ²·1600/K for K captures of a sensor that is insensitive to polarization, summed over the 16 elements. The learned
scheme's error on the unseen materials of the cross-validation is compared with this bound. Exits with 1 if the error is more than
1 % above the bound. With --record the numbers go to results/learning.json (result_file.py). Standard library only.
"""

import argparse
import csv
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import environment
import result_file

CAPTURES, NOISE, BAR = 16, 5e-4, 1.01


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--record", action="store_true", help="write results/learning.json")
    options = parser.parse_args()
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "loss.csv"
        output = ["-o", Path(folder) / "s.toml", "--csv", table]
        command = [environment.sunstone(), "learn", "-k", CAPTURES, "--sensor", "intensity", "--noise", NOISE, *output]
        for _ in range(options.rounds):
            begun = time.perf_counter()
            subprocess.run([*map(str, command)], check=True, capture_output=True)
            seconds.append(time.perf_counter() - begun)
        with table.open() as lines:
            error = next(float(row["squared_error_unseen"]) for row in csv.DictReader(lines) if row["scheme"].startswith("L-"))
    over = error / (NOISE**2 * 1600 / CAPTURES)
    numbers = {
        "seconds": result_file.rounds(seconds, "s", spread=f"{len(seconds)} rounds, whole command"),
        "over_bound": result_file.once(over, "squared error over the bound", "none: the seed decides"),
    }
    low, high = min(seconds), max(seconds)
    print(f"{CAPTURES} captures learned in {numbers['seconds']['median']:.2f} s ({low:.2f} to {high:.2f}); "
          f"squared error {over:.6f} of the bound")
    if options.record:
        result_file.write("learning", __file__, [*result_file.POLARIMETRY, "src/pbrdf", "validation/learning.py"], numbers)
    sys.exit(0 if over < BAR else 1)


if __name__ == "__main__":
    main()

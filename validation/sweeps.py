#!/usr/bin/env python3
"""Measure how the scores of applications decrease with fewer photons, leaking polarizers and poor calibration.

Each application runs through capture chains with several seeds at preview size. The cost of a score is the score on captured slices minus
a reference on the same renders: rendered slices (photons), polarizers without leakage (extinction), exact optics (calibration). Standard
errors treat variants and seeds as crossed random effects (Searle, Casella & McCulloch 1992, section 4.3).

    python validation/sweeps.py [APPLICATION ...] [--sweeps photons extinction calibration] [--seeds 5] [--renders FOLDER]
        [--write docs/applications/sweeps.json]
    python validation/sweeps.py --read docs/applications/sweeps.json

The tables are printed in Markdown. --write adds the results to a file, and --read prints the tables of such a file.
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

ELEMENT, JOINT = "the named element", "joint: space, polarization, time"
DEGREES, MILLIMETRES, FRACTION = ("deg", 0.2, 2), ("mm", 0.1, 2), ("", 0.01, 3)  # unit, permissible loss, digits


def isolation(tasks, element=ELEMENT, joint=JOINT):
    """Return the rows of an application that isolates kinds of light: the area of an element and of the joint method."""
    return [(f"{task}: area", method, FRACTION) for task in tasks for method in (element, joint)]


# Metric, method, and unit of each row.
ROWS = {
    "crystals": [("retardance, median error", method, DEGREES) for method in ("all light", "epipolar")],
    "crystals-faces": [("correlation with one reflection at the true normals", method, FRACTION)
                       for method in ("-(3,3), epipolar", "(1,1), epipolar")],
    "transient": [("correlation, inverting", "(3,3) of the bin", FRACTION),
                  ("area under the curve, inverting", "(3,3) of the bin", FRACTION),
                  ("area under the curve, inverting", "(3,3)/(0,0) of the bin", FRACTION),
                  ("correlation, keeping", "(3,3) of the bin", FRACTION)],
    "multibounce-coins": isolation(["one reflection by metal", "two reflections by metal", "mirror to table"]),
    "multibounce": isolation(["gloss of walls", "walls without gloss", "interreflection of walls", "walls and ball to floor",
                              "ball along one diagonal", "ball along the other"]),
    "multibounce-statue": isolation(["direct light", "light by way of the mirror", "metal, direct", "metal in the mirror"],
                                    "any element at a time", "joint: polarization, time"),
    "analysis": isolation(["one matt", "several matt", "mirror and matt", "one specular", "several specular"],
                          "space, time, polarization"),
    "shape": [("normals, mean error", "epipolar micro phase shift + polarization", DEGREES),
              ("depth, mean error", "epipolar micro phase shift + polarization", MILLIMETRES),
              ("normals, mean error", "joint", DEGREES), ("depth, mean error", "joint", MILLIMETRES),
              ("normals, mean error", "polarization", DEGREES)],
}
# Chain, parameter with values, and place of the reference among the captured results (None: the rendered slices).
SWEEPS = {
    "photons": ("sweep.toml", "photons=10,100,1000", None),
    "extinction": ("sweep.toml", "extinction=3,10,100,inf", -1),
    "calibration": ("poor.toml", "calibration", -1),
}


def estimate(table):
    """Return the mean of a table (variants x seeds) and its standard error with crossed random effects."""
    table = np.array(table)[np.isfinite(table).all(1)]
    v, s = table.shape
    mean, of_variants, of_seeds = table.mean(), table.mean(1), table.mean(0)
    a = s * ((of_variants - mean) ** 2).sum() / (v - 1)
    if s == 1:
        return mean, (a / v) ** 0.5
    b = v * ((of_seeds - mean) ** 2).sum() / (s - 1)
    rest = ((table - of_variants[:, None] - of_seeds + mean) ** 2).sum() / ((v - 1) * (s - 1))
    return mean, (max(a + b - rest, rest) / (v * s)) ** 0.5


def run(name, sweep, options):
    """Run one sweep, and return for each row the label, score, cost and their errors of every capture."""
    chain, values, reference = SWEEPS[sweep]
    with tempfile.TemporaryDirectory() as folder:
        command = [environment.sunstone(), "apply", name, "--preview", "--seeds", options.seeds, "--renders", options.renders]
        command += ["--capture", environment.ROOT / "rigs/chains" / chain, "--sweep", values, "--scenes", environment.ROOT / "scenes"]
        subprocess.run([str(word) for word in [*command, "-o", folder]], check=True, stdout=subprocess.DEVNULL)
        scores = {}
        with open(Path(folder) / "scores.csv", newline="") as file:
            for row in csv.DictReader(file):
                score = float(row["value"]) if row["value"] else float("nan")
                of_row = scores.setdefault((row["metric"], row["method"]), {}).setdefault(row["captured"], {})
                of_row.setdefault(row["variant"], {})[row["seed"]] = score
    found = []
    for metric, method, _ in ROWS[name]:
        tables = {label: [list(v.values()) for v in of.values()] for label, of in scores[metric, method].items()}
        captured = [label for label in tables if label]
        against = "" if reference is None else captured[reference]
        points = []
        for label in ["", *captured]:
            costs = np.subtract(tables[label], tables[against])
            points.append([label, *estimate(tables[label]), *estimate(costs)])
        found.append({"metric": metric, "method": method, "against": against, "points": points})
    return {"seeds": options.seeds, "rows": found}


def short(label):
    """Return the name of a capture without the part that all captures of a sweep have in common."""
    return label.split(", ")[-1] if label else "as rendered"


def table(sweep, found):
    """Print a Markdown table of one sweep."""
    of = {name: sweeps[sweep] for name, sweeps in found.items() if sweep in sweeps}
    if not of:
        return
    labels = [p[0] for p in next(iter(of.values()))["rows"][0]["points"]]
    print(f"\n{sweep}:\n\n| application | seeds | score, method | " + " | ".join(map(short, labels)) + " |")
    print("|---" * (3 + len(labels)) + "|")
    for name, result in of.items():
        for row, (_, _, (unit, _, digits)) in zip(result["rows"], ROWS[name], strict=True):
            cells = []
            for label, mean, error, cost, uncertain in row["points"]:
                text = f"{mean:.{digits}f}"
                own = label in ("", row["against"])
                cells.append(f"{text} ± {error:.{digits}f}" if own else f"{text} ({cost:+.{digits}f} ± {uncertain:.{digits}f})")
            unit = f" [{unit}]" if unit else ""
            print(f"| `{name}` | {result['seeds']} | {row['metric']}{unit}, {row['method']} | " + " | ".join(cells) + " |")


def required(found):
    """Print the smallest tested values that suffice for each row."""
    print("\n| application | score, method | electrons per reading | extinction ratio | calibration |\n|---|---|---|---|---|")
    for name, sweeps in found.items():
        for i, (metric, method, (unit, allowed, _)) in enumerate(ROWS[name]):
            cells = []
            for sweep in ("photons", "extinction"):
                if sweep not in sweeps:
                    cells.append("")
                    continue
                row = sweeps[sweep]["rows"][i]
                tried = [p for p in row["points"] if p[0] not in ("", row["against"])]
                enough = [short(p[0]) for p in tried if loss(p, unit, row) <= allowed]
                cells.append(enough[0] if enough else f"> {short(tried[-1][0])}")
            cells.append(calibration(sweeps["calibration"]["rows"][i], unit, allowed) if "calibration" in sweeps else "")
            print(f"| `{name}` | {metric}{f' [{unit}]' if unit else ''}, {method} | " + " | ".join(cells) + " |")


def loss(point, unit, row):
    """Return the loss of a score. For areas below 1/2, a loss is the absolute change."""
    cost = point[3]
    score = next(p[1] for p in row["points"] if p[0] == row["against"])
    below_half = row["metric"].endswith("area") and score < 0.5
    return abs(cost) if below_half else (cost if unit else -cost)


def calibration(row, unit, allowed):
    """Return whether calibration is needed: whether the cost of nominal components exceeds the permissible loss."""
    nominal = next(p for p in row["points"] if "nominal" in p[0])
    excess = loss(nominal, unit, row) - allowed
    return "unsure" if abs(excess) <= 2 * nominal[4] else "needed" if excess > 0 else "not needed"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("applications", nargs="*", default=list(ROWS), help=", ".join(ROWS))
    parser.add_argument("--sweeps", nargs="+", default=list(SWEEPS), choices=list(SWEEPS))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--renders", type=Path, default=environment.ROOT / "out/apply/renders")
    parser.add_argument("--write", type=Path)
    parser.add_argument("--read", type=Path)
    options = parser.parse_args()
    options.renders.mkdir(parents=True, exist_ok=True)
    found = json.loads(options.read.read_text()) if options.read else {}
    for name in [] if options.read else options.applications:
        for sweep in options.sweeps:
            result = run(name, sweep, options)
            found.setdefault(name, {})[sweep] = result
            if options.write:
                stored = json.loads(options.write.read_text()) if options.write.exists() else {}
                stored.setdefault(name, {})[sweep] = result
                options.write.write_text(json.dumps(stored, indent=1) + "\n")
    for sweep in SWEEPS:
        table(sweep, found)
    required(found)


if __name__ == "__main__":
    main()

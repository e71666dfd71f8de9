#!/usr/bin/env python3
"""Compare the joint methods of applications with every baseline, on arrangements that no method was chosen on.

Methods are trained on 15 variants or more, and tested on variants from number 1000, which are rendered only after the methods are
frozen in a commit. A score is averaged over seeds and over the variants of one arrangement. The errors are standard errors over
arrangements, because scores of one arrangement are correlated. A joint method is compared with methods that have the same spatial
help: the method without means over 3 x 3 pixels with those without, the method with means with those with means. Rows that end in
`same scene` are fitted to the truth of the test variant, and are compared with the joint method fitted so.

    python validation/joint.py scattering [--levels 16x3 96x1] [--renders FOLDER] [--write docs/applications/scattering.json]
    python validation/joint.py analysis multibounce multibounce-coins multibounce-statue --write docs/applications/isolation.json
    python validation/joint.py shape --levels 32x1x64 --write docs/applications/shape.json

A level is the number of samples per pixel, the number of seeds, and optionally the number of pixels of the longer side (16x1x256).
The tables are printed in Markdown. --write writes the scores of every arrangement, and --read prints the tables of such a file.
"""

import argparse
import csv
import json
import statistics
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import environment

MEANS, SAME = ", 3 × 3", ", same scene"
TRAIN, TEST = "0-9,20-24", "1000-1007"


@dataclass
class Comparison:
    """An application, its variants, its joint method and the metrics: names, or ends of names."""

    joint: str
    metrics: tuple
    train: str = TRAIN
    test: str = TEST
    concentrations: int = 1  # consecutive variants of one arrangement
    levels: tuple = ("32x1",)
    ours: tuple = ("joint",)  # beginnings of the names of methods that are no baselines
    groups: dict = field(default_factory=dict)  # names of groups of arrangements, with their indices


# Methods of isolation that use a single element, with the heads of their columns.
NAMED = {"the named element": "named", "(3,3) at a time": "named"}
ONE = dict.fromkeys(
    ("space, time, polarization", "any element of space and polarization", "any element at a time"), "one element"
)
ISOLATION = Comparison("joint: space, polarization, time", (": area", ": correlation", ": error"))
COMPARISONS = {
    "scattering": Comparison("joint: space, polarization, time", ("PSNR", "SSIM"), "1-5,13-17,25-29", "1003-1049/2", 6,
                             ("16x3", "96x1", "512x1"), ("W, b", "time-gated", "joint")),
    "analysis": ISOLATION,
    "multibounce": ISOLATION,
    "multibounce-coins": ISOLATION,
    "transient": Comparison("joint: polarization, time", ("area under the curve, inverting", "area under the curve, keeping", "correlation, inverting",
                                                          "correlation, keeping")),
    "multibounce-statue": Comparison("joint: polarization, time", ISOLATION.metrics),
    "metamerism": Comparison("joint: colour, space, polarization", ("area under the curve",), levels=("16x1",)),
    # Even variants are translucent. Six successive ones are all materials of one statue. Variants 12 to 22 were test variants before.
    "shape": Comparison("joint", ("normals, mean error", "normals, mean error where the scan has normals", "depth, mean error", "coverage"),
                        "0-10/2,24-40/2", "1002-1024/2", levels=("32x1x64", "128x1x64", "32x1x256"),
                        groups={"doll": (0, 1, 2, 6, 7, 8), "dragon": (3, 4, 5, 9, 10, 11)}),
}
# Learning at 256 pixels uses one training variant for each pair of statue and material.
TRAIN_AT = {"256": {"shape": "24-34/2"}}


def scores(name, level, renders, folder):
    """Run an application and return, for each metric and method, the mean score of each arrangement."""
    of = COMPARISONS[name]
    spp, seeds, *pixels = level.split("x")
    train = TRAIN_AT.get(pixels[0] if pixels else "", {}).get(name, of.train)
    program = [environment.sunstone(), "apply", name, "--preview", "--spp", spp, "--seeds", seeds, "--train", train]
    program += [word for number in pixels for word in ("--pixels", number)]
    program += ["--test", of.test, "--renders", renders, "-o", folder, "--scenes", environment.ROOT / "scenes"]
    subprocess.run([str(word) for word in program], check=True, stdout=subprocess.DEVNULL)
    found = {}
    with open(folder / "scores.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["metric"].endswith(of.metrics):
                of_method = found.setdefault(row["metric"], {}).setdefault(row["method"], {})
                of_method.setdefault(int(row["variant"]) // of.concentrations, []).append(float(row["value"] or "nan"))
    mean = lambda values: round(statistics.fmean(values), 5)
    means = {metric: {m: [mean(a[k]) for k in sorted(a)] for m, a in methods.items()} for metric, methods in found.items()}
    # A method without any value, such as a depth by polarization alone, has no row.
    return {metric: {m: a for m, a in methods.items() if any(v == v for v in a)} for metric, methods in means.items()}


def estimate(values):
    """Return the mean and its standard error. Arrangements without a score (NaN) are ignored."""
    kept = [v for v in values if v == v]
    if len(kept) < 2:
        return float("nan"), float("nan")
    return statistics.fmean(kept), statistics.stdev(kept) / len(kept) ** 0.5


def table(of, found, metrics):
    """Print a Markdown table, and return the baselines that are ahead by more than two standard errors."""
    ahead = []
    print("| method | " + " | ".join(f"{metric} | joint minus this" for metric in metrics) + " |")
    print("|---" * (2 * len(metrics) + 1) + "|")
    methods = dict.fromkeys(method for metric in metrics for method in found[metric])
    for method in methods:
        cells = [method]
        reference = of.joint + next((end for end in (MEANS, SAME) if method.endswith(end)), "")
        for metric in metrics:
            digits = 2 if metric == "PSNR" else 3
            if method not in found[metric]:  # for example, no element is named for the task
                cells += ["", ""]
                continue
            mine, own = found[metric][reference], found[metric][method]
            mean, error = estimate(own)
            difference, uncertain = estimate([a - b for a, b in zip(mine, own, strict=True)])
            cells.append(f"{mean:.{digits}f} ± {error:.{digits}f}")
            cells.append("" if method == reference else f"{difference:.{digits}f} ± {uncertain:.{digits}f}")
            worse = difference if "error" in metric else -difference
            if not method.startswith(of.ours) and not method.endswith(SAME) and worse > 2 * uncertain:
                ahead.append(f"{method} ({metric})")
        print("| " + " | ".join(cells) + " |")
    print()
    return ahead


def compact(of, found):
    """Print one row for each kind of light: areas, image errors, and the joint method minus the best method of the row."""
    single = [name for name in NAMED | ONE if any(name in methods for methods in found.values())]
    linear = [f"linear: {one}" for one in ("polarization", "space", "time", "intensity")]
    linear = [name for name in linear if any(name in methods for methods in found.values())]
    heads = [(NAMED | ONE)[name] for name in single] + [name.removeprefix("linear: ") for name in linear]
    heads += ["joint", "joint minus the best of these", "with 3 × 3", "image error: one element", "joint"]
    print("| light | " + " | ".join(heads) + " |\n|" + "---|" * (len(heads) + 1))
    show = lambda pair: "{:.3f} ± {:.3f}".format(*pair)
    difference = lambda a, b: estimate([x - y for x, y in zip(a, b, strict=True)])
    one = next(name for name in single if name in ONE)
    ahead = []
    for light in (metric.removesuffix(": area") for metric in found if metric.endswith(": area")):
        areas, errors = found[f"{light}: area"], found[f"{light}: error"]
        others = [name for name in single + linear if name in areas]
        gains = []
        for joint, rivals in ((of.joint, others), (of.joint + MEANS, [name + MEANS for name in linear])):
            best = max(rivals, key=lambda name: estimate(areas[name])[0])
            gain = difference(areas[joint], areas[best])
            gains.append(show(gain))
            if gain[0] < -2 * gain[1]:
                ahead.append(f"{best} ({light})")
        cells = [show(estimate(areas[name])) if name in areas else "" for name in [*single, *linear, of.joint]] + gains
        cells += [show(estimate(errors[name])) for name in (one, of.joint)]
        print("| " + " | ".join([light, *cells]) + " |")
    print()
    return ahead


def tables(of, found):
    """Print the tables of an application: one row for each kind of light, or one row for each method."""
    if of.metrics == ISOLATION.metrics:
        return compact(of, found)
    kinds = [[metric for metric in found if metric.endswith(kind)] for kind in of.metrics]
    groups = kinds if any(len(kind) > 1 for kind in kinds) else [[metric for kind in kinds for metric in kind]]
    ahead = [one for metrics in groups for one in table(of, found, metrics)]
    for name, indices in of.groups.items():
        part = {metric: {m: [v[i] for i in indices] for m, v in methods.items()} for metric, methods in found.items()}
        print(f"{name} alone, {len(indices)} arrangements:\n")
        ahead += [f"{name}: {one}" for metrics in groups for one in table(of, part, metrics)]
    return ahead


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("applications", nargs="+", choices=COMPARISONS, metavar="application", help=", ".join(COMPARISONS))
    parser.add_argument("--levels", nargs="+", help="samples per pixel x seeds")
    parser.add_argument("--renders", type=Path, default=environment.ROOT / "out/apply/renders")
    parser.add_argument("--write", type=Path)
    parser.add_argument("--read", type=Path, help="file of --write")
    options = parser.parse_args()
    known = json.loads(options.read.read_text()) if options.read else {}
    options.renders.mkdir(parents=True, exist_ok=True)
    found, ahead = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for name in options.applications:
            of = COMPARISONS[name]
            for level in options.levels or of.levels:
                own = known.get(name, known)[level] if options.read else scores(name, level, options.renders, Path(folder) / f"{name}_{level}")
                found.setdefault(name, {})[level] = own
                count = len(own[next(iter(own))][of.joint])
                print(f"\n{name}, level {level}, {count} arrangements:\n")
                ahead += [f"{name}, {level}: {one}" for one in tables(of, own)]
    print("baselines ahead by more than two standard errors:", "; ".join(ahead) or "none")
    if options.write:
        written = found[options.applications[0]] if len(found) == 1 else found
        options.write.write_text(json.dumps(written, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()

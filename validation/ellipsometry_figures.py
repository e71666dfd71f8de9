#!/usr/bin/env python3
"""Write one result file from the tables that ellipsometry_figures.sh leaves in results/ellipsometry: the number of captures that
each scheme needs.

That script calls this one at its end. Standard library only.
"""

import csv

import result_file

TABLES = result_file.RESULTS / "ellipsometry"
SCENES = ["gold_mirror", "mirror_room"]


def table(name):
    """Return the rows of a table, with numbers converted."""
    with (TABLES / f"{name}.csv").open() as lines:
        return [{k: number(v) for k, v in row.items()} for row in csv.DictReader(lines)]


def number(text):
    """Convert text to a number if possible."""
    try:
        return float(text)
    except ValueError:
        return text


def fewest(rows, scheme, error):
    """Return the smallest number of captures of a learned scheme whose error on unseen materials is below `error`."""
    good = [int(r["captures"]) for r in rows if r["scheme"] == scheme and r["rms_element_unseen"] < error]
    return min(good) if good else None


def numbers():
    """Return the content of the result file."""
    out, trials = {}, {scene: table(scene) for scene in SCENES}
    for scene, rows in trials.items():
        for row in rows:
            key = row["scheme"].lower().replace("-", "_").replace(" ", "_")
            out[f"{scene}_{key}"] = result_file.estimate(row["rmse"], row["rmse_std_error"], "rms of an element, T00 = 1")
    # Least squares of a rank-16 scheme has the same error for all materials.
    drr = {int(r["captures"]): r["predicted_rmse"] for r in trials["mirror_room"] if r["scheme"].startswith("DRR ")}
    for captures, error in drr.items():
        out[f"drr_{captures}"] = result_file.once(error, "rms of an element, T00 = 1", "none: a closed form")
    for frames, name in (("plane", "loss_plane"), ("any", "loss")):
        rows = table(name)
        for sensor, scheme in (("", "L-QRPR"), ("array_", "L-QRPR-P")):
            for estimator, title in (("", "least squares"), ("prior_", "prior")):
                for captures in (25, 36):
                    found = fewest(rows, f"{scheme}, {title}", drr[captures])
                    key = f"{frames}_{sensor}{estimator}beats_drr_{captures}"
                    out[key] = result_file.once(found, "captures", "fewest of those tried, errors of unseen materials")
        learned = next(r for r in rows if r["scheme"] == "L-QRPR, least squares" and r["captures"] == 16)
        spread = "5-fold cross-validation over materials"
        out[f"{frames}_l_qrpr_16"] = result_file.once(learned["rms_element_unseen"], "rms of an element, T00 = 1", spread)
    return out


def main():
    measures = [*result_file.POLARIMETRY, "src/pbrdf", "pbrdf/stand_ins.toml", "validation/ellipsometry_figures.sh"]
    result_file.write("ellipsometry_figures", __file__, measures, numbers())


if __name__ == "__main__":
    main()

"""Result files: what was measured, at which commit, on which machine, when, and with which spread over rounds.

Every script of this folder that measures something writes one such JSON file to results/, and readme.py checks README.md and
docs/ against them. A file contains

    format     1
    script     that wrote it, relative to the project's root
    measures   folders and files whose change makes the numbers outdated, relative to the project's root
    commit     of the measured tree; dirty: whether one of `measures` differed from it when the script started
    date       UTC
    machine    processor, cores, memory_gb, system
    note       optional remarks (from the variable SUNSTONE_RESULT_NOTE)
    versions   of the other programs
    numbers    name: number
    rows       tables as the script prints them, if any

A number has `unit`, `spread` (what varies between least and greatest), `median`, `best` (the least, or the greatest if `better`
is "higher"), `least`, `greatest` and `rounds`, the values themselves. A number without rounds has one value as median and best,
and null as least and greatest; `spread` gives the reason: one run, or an estimate with its `error`. For ratios, `best` is the
ratio of both best values. Null is a number that was not reached (an integrator that never finds all light).

Standard library only: readme.py runs without installed packages.
"""

import json
import math
import os
import platform
import statistics
import subprocess
from datetime import datetime, timezone
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "validation/results"
FORMAT = 1

# Parts of the program that trace light, store it and read scene files. Importers of other formats are excluded: of 80 commits
# that made convergence.json outdated, 22 had touched only those.
TRACER = ["src/optics", "src/tensor", "src/store", "src/transport", "src/scene/build", "src/sunstone/render.rs"]
POLARIMETRY = ["src/optics", "src/polarimetry"]


def rounds(values, unit, better="lower", spread=None):
    """Return a number measured in several rounds, interleaved with those of the quantities it is compared with."""
    values = [significant(v) for v in values]
    best = min(values) if better == "lower" else max(values)
    return {
        "unit": unit,
        "better": better,
        "spread": spread or f"{len(values)} interleaved rounds",
        "median": significant(statistics.median(values)),
        "best": best,
        "least": min(values),
        "greatest": max(values),
        "rounds": values,
    }


def ratio(over, under, better="higher"):
    """Return the ratio of two lists of rounds in seconds, round by round, because both values of a round share the state of the
    machine.

    `best` is the ratio of the smallest values of both.
    """
    number = rounds([a / b for a, b in zip(over, under, strict=True)], "", better, f"{len(over)} ratios of paired rounds")
    return number | {"best": significant(min(over) / min(under))}


def once(value, unit, spread="one run"):
    """Return a number of one run; None if the goal was not reached."""
    value = None if value is None or not math.isfinite(value) else significant(value)
    return {"unit": unit, "spread": spread, "median": value, "best": value, "least": None, "greatest": None}


def estimate(value, error, unit):
    """Return a number with its standard error."""
    return once(value, unit, "standard error") | {"error": significant(error)}


def significant(value, digits=6):
    """Round to significant digits; whole numbers remain whole numbers."""
    return value if isinstance(value, int) else float(f"{float(value):.{digits}g}")


def machine():
    """Describe this machine."""
    processor, memory = platform.processor(), None
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
        memory = round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1)
    except (OSError, StopIteration, ValueError):
        pass
    return {"processor": processor, "cores": os.cpu_count(), "memory_gb": memory, "system": platform.system()}


def git(*arguments, root=ROOT):
    """Return the output of git, or None if it fails."""
    done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True)
    return done.stdout.rstrip() if done.returncode == 0 else None


# The state of the tree when the script starts, because the measured program is built before. Edits during a long measurement
# do not change what is measured.
COMMIT = git("rev-parse", "HEAD")
CHANGED = [line[3:].split(" -> ")[-1].strip('"').rstrip("/") for line in (git("status", "--porcelain", "--untracked-files=all") or "").splitlines()]


def write(name, script, measures, numbers, versions=None, rows=None, note=None):
    """Write results/<name>.json; `script` is the calling script's __file__."""
    script = Path(script).resolve().relative_to(ROOT).as_posix()
    wrong = [m for m in measures if not (ROOT / m).exists()]
    assert not wrong, f"{script} measures paths that do not exist: {wrong}"
    head = {
        "format": FORMAT,
        "script": script,
        "measures": measures,
        "commit": COMMIT,
        "dirty": any(changed == m or changed.startswith(f"{m}/") for m in [*measures, "Cargo.toml", "Cargo.lock"] for changed in CHANGED),
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "machine": machine(),
        "note": note or os.environ.get("SUNSTONE_RESULT_NOTE"),
        "versions": versions or {},
    }
    save(name, head, numbers, rows)


def save(name, head, numbers, rows=None):
    """Write the file with one number per line, for readable differences."""
    line = lambda value: json.dumps(value, ensure_ascii=False, allow_nan=False)
    text = json.dumps(head, indent=1, ensure_ascii=False)[:-2] + ',\n "numbers": {\n  '
    text += ",\n  ".join(f"{line(key)}: {line(value)}" for key, value in numbers.items()) + "\n }"
    if rows is not None:
        text += ',\n "rows": [\n  ' + ",\n  ".join(map(line, rows)) + "\n ]"
    RESULTS.mkdir(parents=True, exist_ok=True)
    path = RESULTS / f"{name}.json"
    # The file is replaced atomically.
    (part := path.with_suffix(".part")).write_text(text + "\n}\n")
    part.replace(path)
    print(f"wrote {path.relative_to(ROOT)}")


def read(name):
    """Return a result file; raise FileNotFoundError if it does not exist."""
    return json.loads((RESULTS / f"{name}.json").read_text())

#!/usr/bin/env python3
"""Measure how cost grows: processor time per sample, and memory, of bidirectional renders at several sizes and sample counts.

Every row is one render of a shipped scene with all its slices but another resolution (the rows and blocks of slices are scaled
accordingly). Seconds are user plus system time of the whole process. Memory is the process's largest resident size. Requirements:
the longest time per sample of a scene is within 1.15 of its shortest, and memory is at most 600 MB.

    python3 validation/growth.py [--most 40] [--judge]

--most skips renders of more than this number of million samples; --judge fails if a requirement is not met.
"""

import argparse
import os
import re
import sys
import tempfile
from pathlib import Path

import environment

ROWS = [
    ("coins_mirror", 128, 64),
    ("coins_mirror", 512, 32),
    ("coins_mirror", 512, 128),
    ("coins_mirror", 1024, 32),
    ("coins_mirror", 1024, 128),
    ("milky_tank", 128, 32),
    ("milky_tank", 512, 32),
]
MOST_RATIO, MOST_MB = 1.15, 600


def scaled(scene, size):
    """Return the scene at another resolution of its camera."""
    text = scene.read_text()
    camera = text.index("[camera]")
    old = int(re.compile(r"resolution = \[(\d+),").search(text, camera)[1])
    factor = size // old
    assert size == factor * old, f"{scene} has {old} pixels a row"
    text = text[:camera] + re.sub(r"resolution = \[\d+, \d+\]", f"resolution = [{size}, {size}]", text[camera:], count=1)
    return re.sub(r"(camera = \{ rows = \[)(\d+)\]", lambda m: f"{m[1]}{int(m[2]) * factor}]", text)


def cost(scene, size, spp, folder):
    """Return microseconds of processor time per sample, and megabytes."""
    file = scene.with_name(f".growth-{size}.toml")
    file.write_text(scaled(scene, size))
    try:
        program = [environment.sunstone(), "render", file, "--integrator", "bidirectional", "--spp", spp, "-o", folder / f"{size}-{spp}.zarr", "--no-figures"]
        program = [str(p) for p in program]
        child = os.fork()
        if child == 0:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            os.dup2(1, 2)
            os.execv(program[0], program)
        _, code, used = os.wait4(child, 0)
        if code:
            sys.exit(f"the render of {scene} failed")
    finally:
        file.unlink()
    return 1e6 * (used.ru_utime + used.ru_stime) / (size * size * spp), used.ru_maxrss / 1024


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--most", type=float, default=200.0)
    parser.add_argument("--judge", action="store_true")
    options = parser.parse_args()
    found = {}
    for name, size, spp in ROWS:
        if size * size * spp > options.most * 1e6:
            continue
        with tempfile.TemporaryDirectory() as temporary:
            us, mb = cost(environment.ROOT / "scenes" / name / "scene.toml", size, spp, Path(temporary))
        found.setdefault(name, []).append((us, mb))
        print(f"{name:14} {size:5}² × {spp:3}: {us:7.2f} µs a sample, {mb:5.0f} MB", flush=True)
    missed = False
    for name, rows in found.items():
        times, most = [us for us, _ in rows], max(mb for _, mb in rows)
        print(f"{name:14} longest over shortest time per sample {max(times) / min(times):.3f}, at most {most:.0f} MB")
        missed |= max(times) > MOST_RATIO * min(times) or most > MOST_MB
    if options.judge and missed:
        sys.exit("a requirement is not met")


if __name__ == "__main__":
    main()

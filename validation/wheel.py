#!/usr/bin/env python3
"""Measure the overhead of Python over the command: the same render by both, and the reconstruction of a megapixel's 36 captures.

For renders, the script measures the processor time of the whole process, including Python's start and imports, because other
programs affect this time least. Rounds are interleaved. For reconstructions, it compares a call with the whole command with its
files in memory. It also measures the seconds of `import pysunstone`, and the bytes of the wheel in target/wheels.

    python3 validation/wheel.py [--rounds 9] [--record]

Requires the package pysunstone in .venv (pip install ./python). With --record the numbers go to results/wheel.json.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import environment
import result_file

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import numpy as np

SCENE = environment.ROOT / "scenes/mirror_room/scene.toml"
SPP = 64
IMPORT = "import time; begun = time.perf_counter(); import pysunstone; print(time.perf_counter() - begun)"
RENDER = "import sys, pysunstone as ps; ps.Scene.load(sys.argv[1]).render(sys.argv[2], spp=int(sys.argv[3]), threads=1)"


def processor_time(words):
    """Return the processor seconds of a command."""
    process = subprocess.Popen(list(map(str, words)), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{words[0]} failed")
    return used.ru_utime + used.ru_stime


def renders(folder, rounds):
    """Return the processor seconds of Python and of the command."""
    pairs = []
    for _ in range(rounds):
        one = processor_time([sys.executable, "-P", "-c", RENDER, SCENE, folder / "python", SPP])
        words = ["render", SCENE, "--spp", SPP, "--threads", 1, "--no-figures", "-o", folder / "command"]
        pairs.append((one, processor_time([environment.sunstone(), *words])))
        for name in ("python", "command"):
            shutil.rmtree(folder / name)
    return zip(*pairs, strict=True)


def reconstructions(folder, rounds):
    """Return the seconds of `design_matrix` and `reconstruct` on 36 captures of 1224 x 1024 pixels, and of the command."""
    import pysunstone as ps

    captures = np.random.default_rng(0).random((36, 1024, 1224), dtype=np.float32)
    np.save(folder / "captures.npy", captures)
    scheme = ps.Scheme.drr(36)
    (folder / "scheme.toml").write_text(scheme.to_toml())
    pairs = []
    for n in range(rounds):
        begun = time.perf_counter()
        ps.design_matrix(scheme)
        found = ps.reconstruct(captures, scheme)
        one = time.perf_counter() - begun
        begun = time.perf_counter()
        words = ["reconstruct", folder / "captures.npy", "--scheme", folder / "scheme.toml", "-o", folder / f"{n}.npy"]
        subprocess.run(list(map(str, [environment.sunstone(), *words])), check=True, capture_output=True)
        pairs.append((one, time.perf_counter() - begun))
        if not np.array_equal(found, np.load(folder / f"{n}.npy")):
            sys.exit("the matrices of the command and of Python differ")
        (folder / f"{n}.npy").unlink()
    return zip(*pairs, strict=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--record", action="store_true", help="write results/wheel.json")
    options = parser.parse_args()
    numbers = {}
    with tempfile.TemporaryDirectory(dir=environment.in_memory()) as temporary:
        folder = Path(temporary)
        for name, measure, unit in (("render", renders, "s of processor time"), ("reconstruct", reconstructions, "s")):
            ours, command = measure(folder, options.rounds)
            numbers[f"{name}_python"] = result_file.rounds(ours, unit)
            numbers[f"{name}_command"] = result_file.rounds(command, unit)
            numbers[f"{name}_over_command"] = result_file.ratio(ours, command, "lower")
        words = [sys.executable, "-P", "-c", IMPORT]
        imports = [float(subprocess.run(words, check=True, capture_output=True).stdout) for _ in range(options.rounds)]
        numbers["import"] = result_file.rounds(imports, "s")
    for wheel in (environment.ROOT / "target/wheels").glob("pysunstone-*.whl"):
        numbers["bytes"] = result_file.once(wheel.stat().st_size, "bytes", "one file")
    for name, number in numbers.items():
        print(f"{name:24} {number['median']:g} {number['unit']}, least {number['least']}, greatest {number['greatest']}")
    if options.record:
        measures = [*result_file.TRACER, "src/polarimetry", "python", "src/cli", "scenes/mirror_room", "validation/wheel.py"]
        result_file.write("wheel", __file__, measures, numbers, {"numpy": np.__version__})


if __name__ == "__main__":
    main()

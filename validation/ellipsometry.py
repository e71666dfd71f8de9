#!/usr/bin/env python3
"""Compare captures and their least-squares reconstruction with PyPI `polanalyser`, and time both in one run.

Both programs use the same signs, so no value is transformed: `polanalyser.retarder(δ, θ)` is R(-θ) M R(θ) with M[2][3] = +sin δ,
M[3][2] = -sin δ and a middle block [[cos 2θ, sin 2θ], [-sin 2θ, cos 2θ]] of R(θ), as in CONVENTIONS.md.

The script compares design matrices (bound 1e-12) of built-in schemes and of random angles and retardances. Then it compares
reconstructions of mixtures of Jones matrices from noisy intensities (bound 1e-9 of a pixel's largest element; 1e-4 for float32
and uint16 files).

Then it times the reconstruction of 36 float32 images: the whole command, with its files in memory if there is a tmpfs, and the
computation time that the command reports. The computation time is compared with `polanalyser.calcMueller` on the array in memory,
the time of the whole command with calcMueller from file to file. Passes of NumPy over the array and the files are also timed. The
command's memory must stay below 200 MB, also for four times as many pixels.

Exits with 1 if a value is above its bound. `--power` applies errors to Sunstone's inputs or outputs, the smallest 0.1° of frame
and 0.1 % of intensity, and checks that all rows detect all of them. With --record the times and the memory go to
results/ellipsometry.json (result_file.py).
"""

import argparse
import importlib.util
import math
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from importlib import metadata
from pathlib import Path

import environment
import result_file

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import numpy as np
    from speed import high_water

    # Only this module: the whole package also imports OpenCV, which is not needed for Mueller matrices.
    package = importlib.util.find_spec("polanalyser").submodule_search_locations[0]
    spec = importlib.util.spec_from_file_location("polanalyser_mueller", Path(package) / "mueller.py")
    polanalyser = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(polanalyser)

DESIGN, DOUBLE, SINGLE = 1e-12, 1e-9, 1e-4
HEIGHT, WIDTH = 150, 200
ROWS, COLUMNS, CAPTURES = 1024, 1224, 36
# The target for file to file is a fifth of polanalyser's time, which only a quiet machine reaches; the bound is a third.
MEMORY, RATIO, PASSES, FILES = 200, 5, 2, 3
BUILT_IN = {
    "DRR 36": ["drr", "-k", "36"],
    "DRR 25": ["drr", "-k", "25"],
    "QRPR 20": ["qrpr", "-k", "20"],
    "QRPR array 8": ["qrpr", "-k", "8", "--sensor", "polarizer-array"],
}
ARRAY = [0, 45, 90, 135]


class Scheme:
    """Ideal elements of a scheme file, in the order in which light passes them: (kind, angles, retardances), degrees."""

    def __init__(self, generator, analyzer, array):
        self.generator, self.analyzer, self.array = generator, analyzer, array

    @classmethod
    def load(cls, path):
        """Load a scheme file."""
        text = tomllib.loads(path.read_text())
        assert "coaxial" not in text and text.get("source", [1, 0, 0, 0]) == [1, 0, 0, 0], "an ideal scheme"

        def side(name):
            elements = text.get(name, [])
            known = {"name", "kind", "angle_deg", "retardance_deg"}
            assert all(set(e) <= known for e in elements), "ideal elements"
            return [(e["kind"], e["angle_deg"], e.get("retardance_deg", 90)) for e in elements]

        return cls(side("generator"), side("analyzer"), text["sensor"]["kind"] == "polarizer_array")

    def save(self, path):
        """Write the scheme file."""
        lines = ['name = "check"', f'sensor = {{ kind = "{"polarizer_array" if self.array else "intensity"}" }}']
        number = lambda v: str(np.asarray(v, float).tolist())
        for side, elements in [("generator", self.generator), ("analyzer", self.analyzer)]:
            for kind, angle, retardance in elements:
                lines += [f"[[{side}]]", f'kind = "{kind}"', f"angle_deg = {number(angle)}"]
                lines += [f"retardance_deg = {number(retardance)}"] if kind == "retarder" else []
        path.write_text("\n".join(lines) + "\n")

    def turned(self, degrees):
        """Return the scheme with all elements rotated, except the sensor's own polarizers."""
        turn = lambda elements: [(kind, np.add(angle, degrees), delta) for kind, angle, delta in elements]
        return Scheme(turn(self.generator), turn(self.analyzer), self.array)

    def swapped(self):
        """Return the scheme with generator and analyzer exchanged and light reversed; with a polarizer array, only the retarders.
        """
        if self.array:
            (p, q2), (q3,) = self.generator, self.analyzer
            return Scheme([p, q3], [q2], True)
        return Scheme(self.analyzer[::-1], self.generator[::-1], False)

    def matrices(self):
        """Return polanalyser's generators and analyzers, one per measurement, (M, 4, 4)."""
        settings = [v for e in self.generator + self.analyzer for v in e[1:]]
        captures = np.broadcast_shapes(*(np.shape(v) for v in settings) or (1,))[0]

        def side(elements, k):
            m = np.eye(4)
            for kind, *values in elements:
                angle, delta = (math.radians(v if np.ndim(v) == 0 else v[k]) for v in values)
                m = (polanalyser.polarizer(angle) if kind == "polarizer" else polanalyser.retarder(delta, angle)) @ m
            return m

        ends = [polanalyser.polarizer(math.radians(a)) for a in ARRAY] if self.array else [np.eye(4)]
        pairs = [(side(self.generator, k), end @ side(self.analyzer, k)) for k in range(captures) for end in ends]
        return np.moveaxis(np.array(pairs), 1, 0)

    def design(self):
        """Return polanalyser's design matrix, (M, 4, 4)."""
        psg, psa = self.matrices()
        return psa[:, 0, :, None] * psg[:, None, :, 0]


def mixtures(count, rng):
    """Return realizable Mueller matrices: mixtures of three Jones matrices."""
    pauli = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])
    jones = rng.normal(size=(3, count, 2, 2)) + 1j * rng.normal(size=(3, count, 2, 2))
    jones *= np.array([1.0, 0.4, 0.2])[:, None, None, None]
    return np.einsum("aij,knjl,blm,knim->nab", pauli, jones, pauli, jones.conj(), optimize=True).real / 2


def random_scheme(rng, retardances, array):
    """Return random settings of two polarizers and two retarders."""
    captures = 12 if array else 30
    angle = lambda: rng.uniform(-720, 720, captures)
    delta = lambda: rng.uniform(0, 360, captures) if retardances else 90
    generator = [("polarizer", angle(), 0), ("retarder", angle(), delta())]
    analyzer = [("retarder", angle(), delta())] + ([] if array else [("polarizer", angle(), 0)])
    return Scheme(generator, analyzer, array)


def run(*arguments):
    """Run Sunstone and return its output."""
    done = subprocess.run([environment.sunstone(), *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, done.args))}:\n{done.stderr}")
    return done.stderr


def design(folder, scheme):
    """Return Sunstone's design matrix, (M, 4, 4)."""
    scheme.save(folder / "s.toml")
    run("scheme", "matrix", folder / "s.toml", "-o", folder / "a.npy")
    a = np.load(folder / "a.npy")
    assert a.ndim == 2 and a.shape[1] == 16 and a.dtype == np.float64, f"{a.shape} {a.dtype}"
    return a.reshape(-1, 4, 4)


def reconstruct(folder, scheme, intensities):
    """Return Sunstone's Mueller matrices."""
    scheme.save(folder / "s.toml")
    np.save(folder / "i.npy", intensities)
    run("reconstruct", folder / "i.npy", "--scheme", folder / "s.toml", "-o", folder / "m.npy")
    m = np.load(folder / "m.npy")
    want = np.float64 if intensities.dtype == np.float64 else np.float32
    assert m.dtype == want and m.shape[:2] == (HEIGHT, WIDTH), f"{m.shape} {m.dtype}"
    return m


# Effect of each error on the scheme that Sunstone receives, and on the matrices that it returns.
SAME = lambda x: x
SIGNS = (1, 1, 1, -1)
ERRORS = {
    "0.1°": (lambda s: s.turned(0.1), SAME),
    "swapped": (lambda s: s.swapped(), SAME),
    "s3": (SAME, lambda m: m * np.outer(SIGNS, SIGNS)),
    "transposed": (SAME, lambda m: m.swapaxes(-1, -2)),
    "0.1 %": (SAME, lambda m: 1.001 * m),
}
# Design matrices and reconstructions of seven schemes; of the four built-in ones also from two kinds of files.
COMPARED = 7 + 7 + 2 * len(BUILT_IN)


def rows(folder, rng):
    """Yield the comparisons: name, bound, ours (given an error's two changes), theirs, scale."""
    schemes = {}
    for name, arguments in BUILT_IN.items():
        run("scheme", *arguments, "-o", folder / "built_in.toml")
        schemes[name] = Scheme.load(folder / "built_in.toml")
    randoms = {
        "random angles": random_scheme(rng, False, False),
        "random retarders": random_scheme(rng, True, False),
        "random array": random_scheme(rng, True, True),
    }
    for name, scheme in (schemes | randoms).items():
        ours = lambda change, after, s=scheme: after(design(folder, change(s)))
        yield f"{name}, design", DESIGN, ours, scheme.design(), 1.0
    truth = mixtures(HEIGHT * WIDTH, rng).reshape(HEIGHT, WIDTH, 4, 4)
    for name, scheme in (schemes | randoms).items():
        psg, psa = scheme.matrices()
        exact = np.einsum("ka,yxab,kb->kyx", psa[:, 0], truth, psg[:, :, 0], optimize=True)
        noisy = exact + rng.normal(scale=0.01 * exact.mean(), size=exact.shape)
        inputs = [("", DOUBLE, noisy)]
        if name in BUILT_IN:
            counts = (np.clip(noisy / exact.max(), 0, 1) * 65535).astype(np.uint16)
            inputs += [(" float32", SINGLE, noisy.astype(np.float32)), (" uint16", SINGLE, counts)]
        for kind, bound, values in inputs:
            shape = (-1, len(ARRAY), HEIGHT, WIDTH) if scheme.array else values.shape
            ours = lambda change, after, s=scheme, i=values.reshape(shape): after(reconstruct(folder, change(s), i))
            theirs = polanalyser.calcMueller(values, psg, psa)
            scale = np.abs(theirs).max(axis=(-1, -2), keepdims=True)
            yield f"{name}, M{kind}", bound, ours, theirs, scale


def compare(folder, power):
    """Print the table; return true if a row is wrong."""
    rng = np.random.default_rng(1)
    columns = ERRORS if power else {"largest difference": (SAME, SAME)}
    print(f"{'scheme and array':24} {'bound':>7}" + "".join(f" {name:>20}" for name in columns))
    failed, count = False, 0
    for name, bound, ours, theirs, scale in rows(folder, rng):
        count += 1
        line = f"{name:24} {bound:7.0e}"
        for change in columns.values():
            got = ours(*change)
            assert got.shape == theirs.shape, f"{got.shape} {theirs.shape}"
            difference = (np.abs(got - theirs) / scale).max()
            wrong = not difference < bound
            failed |= wrong != power
            verdict = (" detected" if wrong else " MISSED") if power else ""
            line += f" {f'{difference:.3e}{verdict}':>20}"
        print(line)
    if count != COMPARED:
        print(f"{count} rows instead of {COMPARED}")
    return failed or count != COMPARED


def timed(action, *outputs):
    """Return the seconds of an action whose outputs do not exist before."""
    for path in outputs:
        path.unlink(missing_ok=True)
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def peak(command):
    """Return the largest resident memory of a command, megabytes of 1e6 bytes."""
    running = subprocess.Popen([*map(str, command)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    most = 0
    while running.poll() is None:
        most = max(most, high_water(running.pid))
        time.sleep(0.001)
    if running.returncode:
        sys.exit(f"{' '.join(map(str, command))} failed with exit code {running.returncode}")
    return most * 1.048576


def speed(folder, pixels, record):
    """Print times and memory, and record them on request. Return true if they are above their bounds."""
    height = max(1, pixels // COLUMNS)
    rng = np.random.default_rng(2)
    image = rng.random((CAPTURES, height, COLUMNS), dtype=np.float32)
    run("scheme", *BUILT_IN["DRR 36"], "-o", folder / "s.toml")
    psg, psa = Scheme.load(folder / "s.toml").matrices()
    command = lambda file: ["reconstruct", folder / file, "--scheme", folder / "s.toml", "-o", folder / "m.npy"]
    np.save(folder / "i.npy", image)
    copy = np.zeros_like(image)
    inverse = np.linalg.pinv((psa[:, 0, :, None] * psg[:, None, :, 0]).reshape(CAPTURES, 16)).astype(np.float32)
    stacked = image.reshape(CAPTURES, -1)
    result = np.zeros((height, COLUMNS, 4, 4), np.float32)
    reported = []

    def whole():
        text = run("-v", *command("i.npy"))
        reported.append(float(re.search(r"([0-9.]+) s of computation", text).group(1)))

    def files():
        m = polanalyser.calcMueller(np.load(folder / "i.npy"), psg, psa)
        np.save(folder / "theirs.npy", m.astype(np.float32, order="C"))

    def alone():
        np.load(folder / "i.npy")
        np.save(folder / "theirs.npy", result)

    actions = {
        "sunstone, whole command": whole,
        "polanalyser, in memory": lambda: polanalyser.calcMueller(image, psg, psa),
        "polanalyser, whole": files,
        "numpy, reading and writing": alone,
        "numpy, float32 product": lambda: inverse @ stacked,
        "numpy, sum of the input": lambda: image.sum(),
        "numpy, copy of the input": lambda: np.copyto(copy, image),
    }
    outputs = folder / "m.npy", folder / "theirs.npy"
    # Rounds are interleaved, because the machine's speed drifts; the best time of each program counts.
    rounds = [{name: timed(action, *outputs) for name, action in actions.items()} for _ in range(5)]
    best = {name: min(r[name] for r in rounds) for name in actions}
    best["sunstone, computation"] = min(reported)
    theirs = polanalyser.calcMueller(image, psg, psa)
    whole()
    reported.pop()
    off = np.abs(np.load(folder / "m.npy") - theirs).max() / np.abs(theirs).max()
    size = f"{CAPTURES} x {height} x {COLUMNS} float32 ({image.nbytes / 1e6:.0f} MB)"
    print(f"\n{size}, files in {folder.parent}; largest relative difference {off:.1e}")
    mine = best["sunstone, whole command"]
    for name, seconds in sorted(best.items(), key=lambda item: item[1]):
        rate = image.nbytes / seconds / 1e9
        print(f"{name:26} {seconds:9.4f} s  {rate:7.2f} GB/s  {seconds / mine:7.2f} x the whole command")
    del theirs, copy, result
    failed = not off < SINGLE
    # Both compute from data in memory. Sunstone reads the file in pieces and computes each piece right after it: its time is the
    # sum over threads divided by their number.
    ratio = best["polanalyser, in memory"] / best["sunstone, computation"]
    files = best["polanalyser, whole"] / mine
    passes = best["sunstone, computation"] / best["numpy, sum of the input"]
    if pixels >= ROWS * COLUMNS:
        failed |= not (ratio >= RATIO and passes <= PASSES)
        print(f"computing, polanalyser takes {ratio:.1f} x Sunstone's time; bound {RATIO}")
        print(f"Sunstone computes in {passes:.2f} x the time of one pass over the input (numpy's sum); bound {PASSES}")
        failed |= not files >= FILES
        print(f"from file to file, polanalyser takes {files:.1f} x; bound {FILES}")
    used = {1: peak([environment.sunstone(), *command("i.npy")])}
    large = np.lib.format.open_memmap(folder / "i4.npy", "w+", np.float32, (CAPTURES, 4 * height, COLUMNS))
    for k in range(4):
        large[:, k * height : (k + 1) * height] = image
    del large
    used[4] = peak([environment.sunstone(), *command("i4.npy")])
    for times, megabytes in used.items():
        failed |= not megabytes < MEMORY
        print(f"memory at {times} x the pixels: {megabytes:.0f} MB; bound {MEMORY} MB")
    if record:
        seconds = {name: [r[name] for r in rounds] for name in actions} | {"sunstone, computation": reported}
        measures = [*result_file.POLARIMETRY, "src/cli/reconstruct.rs", "validation/ellipsometry.py"]
        versions = {"polanalyser": metadata.version("polanalyser"), "numpy": np.__version__}
        result_file.write("ellipsometry", __file__, measures, numbers(seconds, used), versions)
    return failed


def numbers(seconds, used):
    """Return the content of the result file: seconds and ratios of paired rounds, megabytes."""
    out = {
        key: result_file.rounds(seconds[name], "s")
        for key, name in (
            ("computing", "sunstone, computation"),
            ("whole", "sunstone, whole command"),
            ("polanalyser_computing", "polanalyser, in memory"),
            ("polanalyser_whole", "polanalyser, whole"),
            ("sum_of_input", "numpy, sum of the input"),
        )
    }
    out["computing_ratio"] = result_file.ratio(seconds["polanalyser, in memory"], seconds["sunstone, computation"])
    out["whole_ratio"] = result_file.ratio(seconds["polanalyser, whole"], seconds["sunstone, whole command"])
    out["passes"] = result_file.ratio(seconds["sunstone, computation"], seconds["numpy, sum of the input"], "lower")
    out["memory"] = result_file.once(used[1], "MB", "one run, its greatest resident memory")
    out["memory_4"] = result_file.once(used[4], "MB", "one run, its greatest resident memory")
    return out


def store(pixels):
    """Return a folder for files of this number of pixels: in memory if there is enough memory."""
    memory = environment.in_memory()
    need = 5 * pixels * 4 * (CAPTURES + 16) * 1.2
    return memory if memory and shutil.disk_usage(memory).free > need else None


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--power", action="store_true", help="check that planted errors are detected")
    full = ROWS * COLUMNS
    text = f"number of pixels for timing, 0 for none (default {full}; with fewer, ratios of times are printed but not judged)"
    parser.add_argument("--speed", type=int, nargs="?", const=full, default=full, metavar="PIXELS", help=text)
    parser.add_argument("--record", action="store_true", help="write results/ellipsometry.json (at the full number of pixels)")
    a = parser.parse_args()
    if a.record and (a.power or a.speed != full):
        sys.exit("--record requires the full number of pixels")
    with tempfile.TemporaryDirectory(dir=store(a.speed)) as folder:
        failed = compare(Path(folder), a.power)
        if a.speed and not a.power:
            failed |= speed(Path(folder), a.speed, a.record)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()

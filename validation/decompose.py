#!/usr/bin/env python3
"""Compare the Lu–Chipman decomposition with PyPI `muellerkit`, and time both on the same array in one run.

Matrices are random mixtures of three Jones matrices, which are realizable by construction; some have a depolarizer of negative
determinant in front. All three factors, diattenuation, retardance and depolarization are compared. Prints a table and exits with
1 if a row is above its bound of 1e-8. `--power` applies errors to Sunstone's arrays (off by twice the bound; the sign of s3;
transposed) and to its input matrices (1 % of intensity, a frame rotated by 0.5°, two matrices exchanged), one at a time. It
checks that every row detects each error that changes muellerkit's own arrays by more than the bound. Times are those of all
arrays and of the four scalars alone, in interleaved rounds. With --record they go to results/decompose.json (result_file.py).
"""

import argparse
import re
import subprocess
import sys
import tempfile
import time
from importlib import metadata
from pathlib import Path

import environment
import result_file

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import muellerkit
    import numpy as np

BOUND = 1e-8
ROUNDS = 5
SCALARS = "polarizance,diattenuation,retardance,depolarization"


def mixtures(count, rng):
    """Return Mueller matrices of mixtures of three Jones matrices."""
    pauli = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])
    jones = rng.normal(size=(3, count, 2, 2)) + 1j * rng.normal(size=(3, count, 2, 2))
    jones *= np.array([1.0, 0.4, 0.2])[:, None, None, None]
    m = np.einsum("aij,knjl,blm,knim->nab", pauli, jones, pauli, jones.conj(), optimize=True).real / 2
    m[:: 10] = np.diag([1, -0.3, -0.2, -0.25]) @ m[:: 10]
    return m


def ours(m, folder):
    """Return Sunstone's arrays, and the seconds of the decomposition alone."""
    np.save(folder / "m.npy", m)
    seconds = run(folder)
    return dict(np.load(folder / "p.npz")), seconds


def run(folder, *options):
    """Decompose m.npy; return the seconds of the decomposition alone."""
    command = [environment.sunstone(), "-v", "decompose", folder / "m.npy", "-o", folder / "p.npz", *options]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return float(re.search(r"matrices in ([0-9.]+) s", done.stderr + done.stdout).group(1))


def speed(m, count, folder, record):
    """Time Sunstone on `count` matrices and muellerkit on `m`, in interleaved rounds."""
    np.save(folder / "m.npy", np.tile(m, (-(-count // len(m)), 1, 1))[:count])
    # Seconds per million matrices.
    seconds = {"all_arrays": [], "scalars": [], "muellerkit": []}
    for _ in range(ROUNDS):
        seconds["all_arrays"].append(run(folder) / count * 1e6)
        seconds["scalars"].append(run(folder, "--only", SCALARS) / count * 1e6)
        seconds["muellerkit"].append(theirs(m)[1] / len(m) * 1e6)
    rate = lambda values: result_file.rounds([1 / s for s in values], "million matrices/s", "higher")
    out = {key: rate(values) for key, values in seconds.items()}
    out["ratio"] = result_file.ratio(seconds["muellerkit"], seconds["all_arrays"])
    for key, number in out.items():
        print(f"{key:12} {number['median']:8.3g} (best {number['best']:.3g}) {number['unit']}")
    if record:
        measures = [*result_file.POLARIMETRY, "src/cli/decompose.rs", "validation/decompose.py"]
        result_file.write("decompose", __file__, measures, out, {"muellerkit": metadata.version("muellerkit")})


def theirs(m):
    """Return the same arrays from muellerkit, and its seconds."""
    start = time.perf_counter()
    factors = muellerkit.decompose_depolarizer_retarder_diattenuator(m)
    seconds = time.perf_counter() - start
    found = muellerkit.extract_parameters(*factors)
    return {
        "m_delta": factors[0],
        "m_r": factors[1],
        "m_d": factors[2],
        "diattenuation": found.diattenuation,
        "depolarization": found.total_depolarization,
        "retardance": found.total_retardance,
    }, seconds


def difference(name, a, b, m):
    """Return the largest difference of two arrays of one name, divided by M00 if the arrays scale with the matrices m."""
    scale = np.abs(m[:, 0, 0]) if name in ("m_d", "product") else np.ones(len(m))
    return (np.abs(a - b).reshape(len(m), -1).max(axis=1) / scale).max()


def product(arrays):
    """Return the product of the factors."""
    return arrays["m_delta"] @ arrays["m_r"] @ arrays["m_d"]


BOUNDS = {"product": 1e-10}
TURN = 0.5


def turned(m):
    """Return matrices in frames rotated by TURN degrees."""
    c, s = np.cos(2 * np.radians(TURN)), np.sin(2 * np.radians(TURN))
    r = np.array([[1, 0, 0, 0], [0, c, s, 0], [0, -s, c, 0], [0, 0, 0, 1]])
    return r @ m @ r.T


def exchanged(m):
    """Exchange the first two matrices."""
    return np.concatenate([m[1::-1], m[2:]])


# Errors in the input matrices, and the minimum number of rows that must be able to detect them.
GIVEN = {
    "1 % of intensity": (lambda m: 1.01 * m, 2),
    f"frame turned by {TURN}°": (turned, 4),
    "two exchanged": (exchanged, 7),
}
# Errors in the resulting arrays.
GIVES = {
    "s3": lambda a: a * np.outer([1, 1, 1, -1], [1, 1, 1, -1]) if a.ndim == 3 else None,
    "transposed": lambda a: a.swapaxes(-1, -2) if a.ndim == 3 else None,
}


def power(m, got, want, folder):
    """Apply every error; return true if a row that can detect one does not."""
    failed, able = False, dict.fromkeys(GIVEN, 0)
    for error, (change, floor) in GIVEN.items():
        changed, _ = ours(change(m), folder)
        changed["product"] = product(changed)
        shown = theirs(change(m))[0]
        shown["product"] = product(shown)
        for name, value in want.items():
            bound = BOUNDS.get(name, BOUND)
            if difference(name, shown[name], value, m) <= 2 * bound:
                print(f"{error:20} {name:16} cannot detect it")
                continue
            able[error] += 1
            found = not difference(name, changed[name], value, m) < bound
            failed |= not found
            print(f"{error:20} {name:16} {'detected' if found else 'NOT DETECTED'}")
        if able[error] < floor:
            failed = True
            print(f"{error:20} can be detected by {able[error]} rows; floor {floor}")
    symmetric = []
    for name, value in want.items():
        bound = BOUNDS.get(name, BOUND)
        m00 = m[:, 0, 0] if name in ("m_d", "product") else np.ones(len(m))
        # One number of one matrix, for each number in turn.
        off = []
        for k in range(got[name][0].size):
            array = got[name].copy()
            array.reshape(len(m), -1)[7, k] += 2 * bound * m00[7]
            off.append(array)
        changes = {"2 bounds": off} | {error: [change(got[name])] for error, change in GIVES.items()}
        for error, arrays in changes.items():
            if arrays[0] is None:
                continue
            # A diattenuator's matrix is symmetric.
            if error == "transposed" and difference(name, GIVES[error](value), value, m) <= 2 * bound:
                print(f"{error:20} {name:16} cannot detect it")
                symmetric.append(name)
                continue
            found = all(not difference(name, array, value, m) < bound for array in arrays)
            failed |= not found
            print(f"{error:20} {name:16} {'detected' if found else 'NOT DETECTED'}")
    return failed or symmetric != ["m_d"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--power", action="store_true", help="check that planted errors are detected")
    parser.add_argument("--count", type=int, default=100_000, help="number of matrices to compare")
    parser.add_argument("--speed", type=int, default=2_000_000, help="number of matrices for timing Sunstone")
    parser.add_argument("--record", action="store_true", help="write results/decompose.json")
    a = parser.parse_args()
    rng = np.random.default_rng(1)
    m = mixtures(a.count, rng)
    failed = a.count < 2
    with tempfile.TemporaryDirectory() as folder:
        got, _ = ours(m, Path(folder))
        want, _ = theirs(m)
        got["product"], want["product"] = product(got), m
        if a.power:
            sys.exit(1 if power(m, got, want, Path(folder)) or failed else 0)
        print(f"{'array':16} {'largest difference':>20} {'bound':>7}")
        for name, value in want.items():
            bound = BOUNDS.get(name, BOUND)
            worst = difference(name, got[name], value, m)
            failed |= not worst < bound
            print(f"{name:16} {worst:20.3e} {bound:7.0e}")
        speed(m, a.speed, Path(folder), a.record)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()

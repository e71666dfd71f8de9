#!/usr/bin/env python3
"""Lu–Chipman decomposition against PyPI `muellerkit`, and the time that both take on the same array in one run.

Matrices are random mixtures of three Jones matrices, which exist by construction; a share has a depolarizer of negative
determinant put in front. All three factors, diattenuation, retardance and depolarization are compared; prints a table and exits
with 1 if a row is above its bound of 1e-8. `--power` plants an error in each of our arrays and checks that its row notices.
Times are those of all arrays and of the four scalars alone, in interleaved rounds; with --record they go to
results/decompose.json (result_file.py).
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
    """Mueller matrices of mixtures of three Jones matrices."""
    pauli = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])
    jones = rng.normal(size=(3, count, 2, 2)) + 1j * rng.normal(size=(3, count, 2, 2))
    jones *= np.array([1.0, 0.4, 0.2])[:, None, None, None]
    m = np.einsum("aij,knjl,blm,knim->nab", pauli, jones, pauli, jones.conj(), optimize=True).real / 2
    m[:: 10] = np.diag([1, -0.3, -0.2, -0.25]) @ m[:: 10]
    return m


def ours(m, folder):
    """Our arrays, and the seconds that the decomposition alone took."""
    np.save(folder / "m.npy", m)
    seconds = run(folder)
    return dict(np.load(folder / "p.npz")), seconds


def run(folder, *options):
    """Decomposes m.npy; the seconds that the decomposition alone took."""
    command = [environment.sunstone(), "-v", "decompose", folder / "m.npy", "-o", folder / "p.npz", *options]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return float(re.search(r"matrices in ([0-9.]+) s", done.stderr + done.stdout).group(1))


def speed(m, count, folder, record):
    """Times ours on `count` matrices and muellerkit on `m`, in interleaved rounds."""
    np.save(folder / "m.npy", np.tile(m, (-(-count // len(m)), 1, 1))[:count])
    # Seconds that a million matrices take.
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
    """The same of muellerkit, and its seconds."""
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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--power", action="store_true", help="plant errors and see that they are noticed")
    parser.add_argument("--count", type=int, default=100_000, help="matrices to compare")
    parser.add_argument("--speed", type=int, default=2_000_000, help="matrices to time ours with")
    parser.add_argument("--record", action="store_true", help="write results/decompose.json")
    a = parser.parse_args()
    rng = np.random.default_rng(1)
    m = mixtures(a.count, rng)
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        got, _ = ours(m, Path(folder))
        want, _ = theirs(m)
        print(f"{'array':16} {'largest difference':>20}")
        for name, value in want.items():
            if a.power:
                got[name] = got[name] * (1 + 1e-6) + 1e-6
            scale = np.abs(m[:, 0, 0]) if name == "m_d" else np.ones(len(m))
            difference = np.abs(got[name] - value).reshape(len(m), -1).max(axis=1) / scale
            wrong = not difference.max() < BOUND
            failed |= wrong != a.power
            print(f"{name:16} {difference.max():20.3e}{'  noticed' if a.power and wrong else ''}")
        rebuilt = got["m_delta"] @ got["m_r"] @ got["m_d"]
        off = (np.abs(rebuilt - m).max(axis=(1, 2)) / m[:, 0, 0]).max()
        print(f"{'product':16} {off:20.3e}")
        failed |= not a.power and not off < 1e-10
        if not a.power:
            speed(m, a.speed, Path(folder), a.record)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()

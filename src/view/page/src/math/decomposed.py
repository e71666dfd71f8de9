"""Prints the fixture decomposed.json: Mueller matrices of a store, and the properties that `sunstone decompose` writes for them.

Usage, with a store that has a slice `polarimetric`:

    python3 decomposed.py path/to/sunstone STORE > decomposed.json
"""

import ast
import json
import math
import struct
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

COUNT = 20
PROPERTIES = ["polarizance", "diattenuation", "retardance", "depolarization", "retardance_axis"]


def rows(npy: bytes, size: int) -> list[list[float]]:
    """Returns the numbers of a .npy file of format 1.0, in rows of `size`."""
    (length,) = struct.unpack("<H", npy[8:10])
    header = ast.literal_eval(npy[10 : 10 + length].decode())
    assert not header["fortran_order"]
    code = {"<f4": "f", "<f8": "d"}[header["descr"]]
    values = [value for (value,) in struct.iter_unpack("<" + code, npy[10 + length :])]
    return [values[i : i + size] for i in range(0, len(values), size)]


def word(value: float) -> float | None:
    """Returns a number with the digits of single precision; JSON has no NaN."""
    return float(f"{value:.9g}") if math.isfinite(value) else None


sunstone, store = sys.argv[1:]
with tempfile.TemporaryDirectory() as folder:
    matrices, properties = Path(folder) / "m.npy", Path(folder) / "p.npz"
    query = [store, "polarimetric", "--select", "wavelength=550", "-o"]
    subprocess.run([sunstone, "probe", *query, matrices], check=True, stdout=sys.stderr)
    subprocess.run([sunstone, "decompose", *query, properties, "--only", ",".join(PROPERTIES)], check=True, stdout=sys.stderr)
    found = {"m": rows(matrices.read_bytes(), 16)}
    with zipfile.ZipFile(properties) as files:
        for name in PROPERTIES:
            found[name] = rows(files.read(f"{name}.npy"), 3 if name == "retardance_axis" else 1)

# Pixels that keep at least 1 % of some polarization, at equal distances. Most other pixels are ideal depolarizers.
shown = [i for i, m in enumerate(found["m"]) if max(abs(m[e]) for e in (5, 10, 15)) > 0.01 * m[0]]
chosen = [shown[(2 * k + 1) * len(shown) // (2 * COUNT)] for k in range(COUNT)]
lines = [json.dumps({name: [word(v) for v in values[i]] for name, values in found.items()}) for i in chosen]
print("[\n" + ",\n".join(lines) + "\n]")

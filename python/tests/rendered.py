"""A small store with every kind of slice, rendered once for all tests, and the command that rendered it."""

from __future__ import annotations

import atexit
import functools
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parents[2]

SCENE = """
name = "ball"
wavelengths_nm = [450, 550, 660]
render = { spp = 64, max_depth = 4 }
camera = { resolution = [20, 16], fov_x_deg = 36, pose.look_at = { origin = [0, 0.4, 3], target = [0, 0, 0], up = [0, 1, 0] } }
projector = { resolution = [12, 10], fov_x_deg = 44, irradiance = [1, 1, 1], pose.look_at = { origin = [1, 1, 3], target = [0, 0, 0], up = [0, 1, 0] } }
materials.white.diffuse.albedo = 0.7
materials.gold.rough_conductor = { metal = "Au", alpha = 0.3 }
[[objects]]
name = "ball"
shape.sphere = { center = [0, 0, 0], radius = 0.7 }
material = "gold"
[[objects]]
shape.rectangle = { corner = [-2, -0.7, 2], u = [4, 0, 0], v = [0, 0, -4] }
material = "white"
[[slices]]
name = "full"
projector = "all"
polarization = "mueller"
[[slices]]
name = "epipolar"
projector = { epipolar = { half_width_px = 1.5 } }
polarization = "mueller"
[[slices]]
name = "nonepipolar"
projector = { nonepipolar = { half_width_px = 1.5 } }
polarization = "mueller"
[[slices]]
name = "binned"
camera = { rows = [9] }
projector = { binned = [5, 4] }
polarization = "mueller"
[[slices]]
name = "some"
camera = { rows = [9] }
projector = { columns = [2, 7] }
polarization = "mueller"
[[slices]]
name = "timed"
camera = { rows = [9] }
time = { start_ps = 18000, bin_ps = 50, bins = 60 }
polarization = "mueller"
[[slices]]
name = "flight"
camera = { binned = 2 }
time = { start_ps = 18000, bin_ps = 100, bins = 30 }
[[slices]]
name = "steady"
polarization = "mueller"
"""

VARIED = """
[vary.size]
path = "objects.ball.shape.sphere.radius"
range = { min = 0.4, max = 0.7 }
[vary.roughness]
path = "materials.gold.rough_conductor.alpha"
range = { min = 0.2, max = 0.5 }
"""


@functools.cache
def command() -> str:
    """Return the path of the command `sunstone`: the value of SUNSTONE, else this repository's build, else from the PATH."""
    built = ROOT / "target/release/sunstone"
    found = os.environ.get("SUNSTONE") or (str(built) if built.exists() else shutil.which("sunstone"))
    assert found, "there is no command sunstone: cargo build --release"
    return found

def content(store: Path) -> dict[str, bytes]:
    """Return every file of a store, without the render time."""
    found = {}
    for path in sorted(store.rglob("*")):
        if not path.is_file():
            continue
        name, data = str(path.relative_to(store)), path.read_bytes()
        if name == "zarr.json":
            root = json.loads(data)
            del root["attributes"]["wall_time_s"]
            data = json.dumps(root).encode()
        if name == "manifest.txt":
            # The manifest contains a checksum of that file and a checksum of itself.
            lines = data.splitlines()
            data = b"\n".join(line for line in lines if not line.endswith((b" zarr.json", b" lines above")))
        found[name] = data
    return found


def sunstone(*arguments: object) -> str:
    """Run the command and return its output."""
    done = subprocess.run([command(), *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@functools.cache
def folder() -> Path:
    """Return a folder that is deleted when the tests end."""
    path = Path(tempfile.mkdtemp(prefix="pysunstone-tests-"))
    atexit.register(shutil.rmtree, path, ignore_errors=True)
    return path


@functools.cache
def scene(varied: bool = False) -> Path:
    """Write the scene file."""
    path = folder() / ("varied.toml" if varied else "ball.toml")
    path.write_text(SCENE + (VARIED if varied else ""))
    return path


@functools.cache
def store() -> Path:
    """Return the finished store. Copy it before changing it."""
    path = folder() / "ball.zarr"
    sunstone("render", scene(), "-o", path, "--no-figures")
    return path


def probed(slice_name: str, *arguments: object) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return values and standard errors of `sunstone probe` for a slice."""
    out = folder() / "probed.npy"
    sunstone("probe", store(), slice_name, *arguments, "-o", out, "--force")
    return np.load(out), np.load(out.with_name("probed.std_error.npy"))


def differs(found: npt.ArrayLike, expected: npt.ArrayLike) -> float:
    """Return the largest difference, in units of the single-precision rounding of the largest value."""
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    assert found.shape == expected.shape, f"{found.shape} instead of {expected.shape}"
    scale = np.abs(expected).max()
    assert scale > 0, "nothing to compare"
    return float(np.abs(found - expected).max() / scale / np.finfo(np.float32).eps)

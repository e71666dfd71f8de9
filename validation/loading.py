#!/usr/bin/env python3
"""Measure time and memory from a mesh file to the first ray: binary PLY files of 1 and 10 million triangles, in Sunstone and
Mitsuba.

Sunstone renders 8 x 8 pixels with one sample: a whole process with its files written. Mitsuba (llvm, whose tree is Embree's)
loads the same file into a scene and traces one ray; its seconds exclude its import. The processor time (user and system, all
threads) is also printed, because it does not depend on other load. Rounds are interleaved. Each program runs in a separate
process, whose largest resident memory comes from the system (for Mitsuba minus that of the process with two triangles).

    python3 validation/loading.py [--rounds 5] [--record]

Requires LLVM. With --record the numbers go to results/loading.json.
"""

import argparse
import os
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

    import rays

    rays.np = np

SCENE = """
[render]
spp = 1

[camera]
resolution = [8, 8]
fov_x_deg = 30
pose.look_at = { origin = [0.5, 0.5, 3.0], target = [0.5, 0.5, 0.0] }

[projector]
resolution = [8, 8]
fov_x_deg = 40
pose.look_at = { origin = [0.6, 0.5, 3.0], target = [0.5, 0.5, 0.0] }

[materials]
wall.diffuse.albedo = [0.5, 0.5, 0.5]

[[objects]]
shape.ply = { file = "mesh.ply" }
material = "wall"

[[slices]]
name = "photo"
"""
SHOWN = ["sunstone_", "mitsuba_", "over_mitsuba_", "sunstone_processor_", "mitsuba_processor_", "processor_over_mitsuba_"]
# Loads a mesh, traces a ray, and prints the time and the memory of the process.
MITSUBA = """
import sys, time, resource
import mitsuba as mi
mi.set_variant("llvm_ad_mono_polarized")
float((mi.Float(1) + 1)[0])
begun, spent = time.perf_counter(), time.process_time()
scene = mi.load_dict({"type": "scene", "mesh": {"type": "ply", "filename": sys.argv[1], "face_normals": True}})
hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(0.5, 0.4, 3), mi.Vector3f(0, 0, -1)))
assert abs(float(hit.t[0]) - 3) < 0.2
print(time.perf_counter() - begun, time.process_time() - spent, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def hills(triangles):
    """Return a hilly square of about `triangles` triangles."""
    n = max(1, round((triangles / 2) ** 0.5))
    u = np.linspace(0, 1, n + 1, dtype=np.float32)
    x, y = np.meshgrid(u, u, indexing="xy")
    z = 0.05 * np.sin(17 * x) * np.cos(13 * y)
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)[None, :]).ravel().astype(np.uint32)
    below = np.stack([corner, corner + 1, corner + n + 2], axis=1)
    above = np.stack([corner, corner + n + 2, corner + n + 1], axis=1)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32), np.concatenate([below, above])


def ours(folder):
    """Return the seconds, the seconds of processor time and the bytes of memory of one render."""
    program = [environment.sunstone(), "render", folder / "scene.toml", "-o", folder / "out.zarr", "--force", "--no-figures"]
    begun = time.perf_counter()
    process = subprocess.Popen([*map(str, program)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    took = time.perf_counter() - begun
    if status:
        sys.exit(f"sunstone render failed with exit status {status}")
    return took, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024


def theirs(file):
    """Return the seconds, the seconds of processor time and the bytes of memory of Mitsuba."""
    text = subprocess.run([sys.executable, "-c", MITSUBA, str(file)], check=True, capture_output=True, text=True).stdout
    took, spent, used = text.split()
    return float(took), float(spent), int(used) * 1024


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--record", action="store_true", help="write results/loading.json")
    options = parser.parse_args()
    numbers = {}
    with tempfile.TemporaryDirectory(dir=environment.in_memory()) as temporary:
        few = Path(temporary) / "few.ply"
        rays.write_ply(few, *hills(2))
        bare = theirs(few)[2]
        for name, count in (("1m", 1_000_000), ("10m", 10_000_000)):
            folder = Path(temporary) / name
            folder.mkdir()
            (folder / "scene.toml").write_text(SCENE)
            vertices, triangles = hills(count)
            rays.write_ply(folder / "mesh.ply", vertices, triangles)
            found = [(ours(folder), theirs(folder / "mesh.ply")) for _ in range(options.rounds)]
            mine, other = ([pair[k][0] for pair in found] for k in range(2))
            numbers[f"sunstone_{name}"] = result_file.rounds(mine, "s", "lower")
            numbers[f"mitsuba_{name}"] = result_file.rounds(other, "s", "lower")
            numbers[f"over_mitsuba_{name}"] = result_file.ratio(mine, other, "lower")
            mine, other = ([pair[k][1] for pair in found] for k in range(2))
            numbers[f"sunstone_processor_{name}"] = result_file.rounds(mine, "s", "lower")
            numbers[f"mitsuba_processor_{name}"] = result_file.rounds(other, "s", "lower")
            numbers[f"processor_over_mitsuba_{name}"] = result_file.ratio(mine, other, "lower")
            most = [max(pair[k][2] for pair in found) for k in range(2)]
            each = most[0] / len(triangles), (most[1] - bare) / len(triangles)
            numbers[f"bytes_{name}"] = result_file.once(each[0], "bytes a triangle", "the greatest of all rounds")
            numbers[f"mitsuba_bytes_{name}"] = result_file.once(each[1], "bytes a triangle", "the greatest of all rounds")
            for key in (f"{start}{name}" for start in SHOWN):
                print(f"{key:26} median {numbers[key]['median']:.3f}, best {numbers[key]['best']:.3f}", flush=True)
            print(f"{len(triangles)} triangles: {each[0]:.0f} and {each[1]:.0f} bytes each", flush=True)
    if options.record:
        import mitsuba as mi

        measures = ["src/import", "src/scene", "src/transport/geometry", "validation/loading.py"]
        result_file.write("loading", __file__, measures, numbers, {"mitsuba": mi.__version__})


if __name__ == "__main__":
    main()

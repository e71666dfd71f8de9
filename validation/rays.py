#!/usr/bin/env python3
"""Measure rays per second on a mesh of 708,000 triangles: Sunstone's tree against Embree's, with the same rays, nearest hits.

The mesh is a wavy sphere in a torus knot in a wavy sphere, generated deterministically; the rays start inside. Primary rays are
those of a pinhole camera of 1024 x 1024 pixels, row by row. Bounce rays leave the primary hits in cosine-distributed directions,
one per hit, in the order of the hits. Every program returns distance, primitive and barycentric coordinates of every ray:

- Sunstone: benches/rays.rs, as in a render: `Geometry::intersect` for primary rays, one ray at a time, and
  `Geometry::intersect_each` for bounce rays, 16 rays at a time;
- Embree: `rtcIntersect1` through embreex, one ray at a time, one thread;
- Mitsuba (llvm): `ray_intersect_preliminary`, which calls Embree on packets of rays.

Rounds are interleaved because the machine's speed drifts; the first is a warm-up. Distances must agree with Embree's. With
--record the numbers go to results/rays.json (result_file.py).
"""

import argparse
import json
import os
import subprocess
import sys
import time
from importlib import metadata

import environment
import result_file

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import numpy as np

OUT = environment.ROOT / "target/rays"
RESOLUTION, BAR = 1024, 0.9
EYE = (0.4, -3.4, 2.2)


def grid(rows, columns, position, closed):
    """Return a surface that is closed in the second direction, and in the first if `closed`: vertices, triangles."""
    s, t = np.meshgrid(np.arange(rows) / (rows if closed else rows - 1), np.arange(columns) / columns, indexing="ij")
    vertices = np.stack(position(s, t), -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rows if closed else rows - 1), np.arange(columns), indexing="ij")
    corner = lambda a, b: ((i + a) % rows * columns + (j + b) % columns).ravel()
    a, b, c, d = corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def ball(radius):
    """A wavy sphere with a small hole at each pole."""

    def position(s, t):
        theta, phi = 1e-3 + (np.pi - 2e-3) * s, 2 * np.pi * t
        waves = 0.07 * np.sin(7 * theta) * np.sin(9 * phi) + 0.015 * np.sin(61 * theta) * np.cos(53 * phi)
        r = radius * (1 + waves)
        return r * np.sin(theta) * np.cos(phi), r * np.sin(theta) * np.sin(phi), r * np.cos(theta)

    return position


def knot(s, t):
    """A tube around the (2, 3) torus knot."""
    a = 2 * np.pi * s
    path = lambda a: np.stack([(2 + np.cos(3 * a)) * np.cos(2 * a), (2 + np.cos(3 * a)) * np.sin(2 * a), np.sin(3 * a)], -1)
    along = path(a + 1e-4) - path(a - 1e-4)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    across = np.cross(along, path(a) + [0, 0, 5])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    phi = (2 * np.pi * t)[..., None]
    p = 0.6 * path(a) + 0.16 * (np.cos(phi) * across + np.sin(phi) * np.cross(along, across))
    return p[..., 0], p[..., 1], p[..., 2]


def mesh():
    """Return vertices (f32) and triangles (u32)."""
    parts = [grid(301, 400, ball(0.7), False), grid(2000, 72, knot, True), grid(301, 300, ball(6.0), False)]
    first, vertices, triangles = 0, [], []
    for v, f in parts:
        vertices.append(v)
        triangles.append(f + first)
        first += len(v)
    return np.concatenate(vertices).astype(np.float32), np.concatenate(triangles).astype(np.uint32)


def write_ply(path, vertices, triangles):
    faces = np.zeros(len(triangles), dtype=[("n", "u1"), ("i", "<u4", 3)])
    faces["n"], faces["i"] = 3, triangles
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(triangles)}\nproperty list uchar uint vertex_indices\nend_header\n"
    )
    path.write_bytes(head.encode() + vertices.astype("<f4").tobytes() + faces.tobytes())


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def primary():
    """Return origins and directions of the camera's rays."""
    eye = np.array(EYE)
    forward = unit(-eye)
    right = unit(np.cross(forward, [0, 0, 1]))
    down = np.cross(forward, right)
    p = (np.arange(RESOLUTION) + 0.5) / RESOLUTION - 0.5
    y, x = np.meshgrid(p, p, indexing="ij")
    directions = unit(forward + 1.1 * (x[..., None] * right + y[..., None] * down)).reshape(-1, 3)
    return np.broadcast_to(eye, directions.shape).astype(np.float32), directions.astype(np.float32)


def bounce(origins, directions, hits):
    """Return rays from the hits, cosine-distributed about the normal on the hit side."""
    met = np.isfinite(hits["t"])
    o, d, t = (a[met].astype(float) for a in (origins, directions, hits["t"]))
    n = unit(hits["normal"][met].astype(float))
    n *= -np.sign(np.sum(n * d, 1, keepdims=True))
    random = np.random.default_rng(1)
    leave = unit(n + unit(random.normal(size=n.shape)))
    return (o + d * t[:, None] + 1e-4 * n).astype(np.float32), leave.astype(np.float32)


class Embree:
    """Embree through embreex, one ray at a time."""

    def __init__(self, vertices, triangles):
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.scene = EmbreeScene()
        TriangleMesh(self.scene, vertices, triangles.astype(np.int32))
        self.threads = [1]

    def trace(self, origins, directions, _):
        begun = time.perf_counter()
        out = self.scene.run(origins, directions, query="INTERSECT", output=True)
        seconds = time.perf_counter() - begun
        t = np.where(out["primID"] >= 0, out["tfar"], np.inf)
        self.hits = {"t": t, "normal": out["Ng"]}
        return seconds


class Mitsuba:
    """Mitsuba, packets of rays."""

    def __init__(self, path):
        import drjit as dr
        import mitsuba as mi

        mi.set_variant("llvm_ad_rgb")
        self.dr, self.mi = dr, mi
        self.scene = mi.load_dict({"type": "scene", "mesh": {"type": "ply", "filename": str(path), "face_normals": True}})
        self.threads = sorted({1, os.cpu_count()})

    def trace(self, origins, directions, threads):
        dr, mi = self.dr, self.mi
        dr.set_thread_count(threads)
        ray = mi.Ray3f(mi.Point3f(*map(mi.Float, origins.T)), mi.Vector3f(*map(mi.Float, directions.T)))
        dr.eval(ray)
        dr.sync_thread()
        begun = time.perf_counter()
        hit = self.scene.ray_intersect_preliminary(ray, coherent=False)
        dr.eval(hit.t, hit.prim_index, hit.prim_uv)
        dr.sync_thread()
        seconds = time.perf_counter() - begun
        self.hits = {"t": np.array(hit.t)}
        return seconds


class Sunstone:
    """benches/rays.rs in a separate process."""

    def __init__(self, program, ply, name):
        self.rays, self.out = OUT / f"{name}.f32", OUT / f"{name}_hits.f32"
        command = [program, ply, self.rays, self.out] + (["--alternate"] if name == "bounce" else [])
        self.command = [str(c) for c in command]
        self.process = None
        self.threads = sorted({1, os.cpu_count()})

    def trace(self, origins, directions, threads):
        if self.process is None:
            np.concatenate([origins, directions], 1).astype("<f4").tofile(self.rays)
            pipe = subprocess.PIPE
            self.process = subprocess.Popen(self.command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True)
        self.process.stdin.write(f"{threads}\n")
        self.process.stdin.flush()
        return float(self.process.stdout.readline())

    def end(self):
        self.process.communicate()
        self.hits = {"t": np.fromfile(self.out, "<f4").reshape(-1, 4)[:, 0]}


def bench_program():
    """Build benches/rays.rs and return its path. Builds with the features of all packages, so that no crate is compiled again."""
    packages = ["--workspace", "--exclude", "sunstone-python"]
    command = ["cargo", "bench", *packages, "--bench", "rays", "--no-run", "--message-format=json"]
    out = subprocess.run(command, cwd=environment.ROOT, check=True, capture_output=True, text=True).stdout
    built = [json.loads(line) for line in out.splitlines() if line.startswith("{")]
    return next(b["executable"] for b in built if b.get("target", {}).get("name") == "rays" and b.get("executable"))


def agreement(ours, theirs):
    """Return the fraction of rays that miss in both programs, or hit at the same distance to 1e-5."""
    both = np.isfinite(ours) & np.isfinite(theirs)
    near = np.zeros(len(ours), bool)
    near[both] = np.abs(ours[both] - theirs[both]) <= 1e-5 * np.maximum(1.0, theirs[both])
    return float(np.mean(near | (np.isinf(ours) & np.isinf(theirs))))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--record", action="store_true", help="write results/rays.json")
    parser.add_argument("--no-mitsuba", action="store_true")
    options = parser.parse_args()

    OUT.mkdir(parents=True, exist_ok=True)
    ply = OUT / "mesh.ply"
    vertices, triangles = mesh()
    write_ply(ply, vertices, triangles)
    program = bench_program()
    embree = Embree(vertices, triangles)
    mitsuba = None if options.no_mitsuba else Mitsuba(ply)
    host = result_file.machine()
    numbers = {"triangles": result_file.once(len(triangles), "", "a count")}
    print(f"{host['processor']}, {host['cores']} cores; {len(triangles)} triangles")
    print(f"{'rays':8} | {'program':9} | threads | Mrays/s (best) | to Embree")
    rays, worst = primary(), np.inf
    for name in ("primary", "bounce"):
        programs = {"Embree": embree, "Sunstone": Sunstone(program, ply, name)}
        if mitsuba:
            programs["Mitsuba"] = mitsuba
        seconds = {}
        for _ in range(options.rounds + 1):
            for label, side in programs.items():
                for threads in side.threads:
                    seconds.setdefault((label, threads), []).append(side.trace(*rays, threads))
        programs["Sunstone"].end()
        count = len(rays[0])
        # The first round is a warm-up.
        speed = {key: count / min(s[1:]) / 1e6 for key, s in seconds.items()}
        agree = agreement(programs["Sunstone"].hits["t"], embree.hits["t"])
        for (label, threads), s in speed.items():
            print(f"{name:8} | {label:9} | {threads:7} | {s:14.2f} | {s / speed['Embree', 1]:.2f}")
        print(f"{name:8} | {count} rays, {np.isfinite(embree.hits['t']).mean():.3f} hit; {agree:.6f} agree with Embree")
        worst = min(worst, speed["Sunstone", 1] / speed["Embree", 1])
        for (label, threads), s in seconds.items():
            rate = result_file.rounds([count / x / 1e6 for x in s[1:]], "million rays/s", "higher")
            numbers[f"{name}_{label.lower()}_{threads}"] = rate
        for label in ("Embree", "Mitsuba"):
            if (label, 1) in seconds:
                paired = result_file.ratio(seconds[label, 1][1:], seconds["Sunstone", 1][1:])
                numbers[f"{name}_over_{label.lower()}"] = paired
        numbers[f"{name}_agree"] = result_file.once(agree, "share of rays", "a count")
        if agree < 0.9999:
            sys.exit(f"only {agree:.6f} of the rays agree with Embree to 1e-5; expected at least 0.9999")
        if name == "primary":
            rays = bounce(*rays, embree.hits)
    print(f"one thread, worse of both kinds: {worst:.2f} of Embree's; bar {BAR}: {'met' if worst >= BAR else 'MISSED'}")
    if options.record:
        measures = ["src/transport/geometry", "benches/rays.rs", "validation/rays.py"]
        names = {"Embree": "embreex"} | ({"Mitsuba": "mitsuba"} if mitsuba else {})
        versions = {name: metadata.version(name) for name in names.values()}
        result_file.write("rays", __file__, measures, numbers, versions)


if __name__ == "__main__":
    main()

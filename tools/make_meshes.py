#!/usr/bin/env python3
"""Write the meshes of scenes/mirror_room: knot.glb, vase.ply and pedestal.obj.

Lengths are in metres and +y is up. Every mesh stands on y = 0, is closed and faces outward. Requires Python 3 only; the output is
deterministic.

    tools/make_meshes.py [folder]      (default: scenes/mirror_room of this repository)
"""

import json
import math
import struct
import sys
from pathlib import Path

TAU = 2.0 * math.pi


def add(a, b, s=1.0):
    return tuple(x + s * y for x, y in zip(a, b))


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    n = math.sqrt(dot(a, a))
    return tuple(x / n for x in a)


def f32(x):
    """Round to the nearest single-precision number, without negative zero."""
    return struct.unpack("<f", struct.pack("<f", x))[0] + 0.0


def stand(points, size, axes):
    """Scale points so that their largest extent along `axes` is `size`, centre x and z, and place them on y = 0."""
    low = [min(p[k] for p in points) for k in range(3)]
    high = [max(p[k] for p in points) for k in range(3)]
    scale = size / max(high[k] - low[k] for k in axes)
    origin = ((low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2)
    return [tuple(f32(scale * (x - o)) for x, o in zip(p, origin)) for p in points]


# --- knot.glb ---------------------------------------------------------------------------------------------------------

KNOT_RINGS, KNOT_SIDES, KNOT_TUBE = 256, 16, 0.45


def knot_point(t):
    """Return a point of the (2,3) torus knot on the torus of radii 2 and 1 about the z axis."""
    r = 2.0 + math.cos(3 * t)
    return (r * math.cos(2 * t), r * math.sin(2 * t), math.sin(3 * t))


def knot_tangent(t):
    r, dr = 2.0 + math.cos(3 * t), -3.0 * math.sin(3 * t)
    return unit(
        (
            dr * math.cos(2 * t) - 2 * r * math.sin(2 * t),
            dr * math.sin(2 * t) + 2 * r * math.cos(2 * t),
            3 * math.cos(3 * t),
        )
    )


def knot():
    """Return (positions, normals, triangles) of a tube around the knot, with rotation-minimizing frames."""
    times = [TAU * i / KNOT_RINGS for i in range(KNOT_RINGS + 1)]
    frame = unit(cross(knot_tangent(0.0), (0.0, 0.0, 1.0)))
    frames = []
    for t in times:
        tangent = knot_tangent(t)
        frame = unit(add(frame, tangent, -dot(frame, tangent)))
        frames.append((frame, cross(tangent, frame)))
    # The twist that closes the frame is distributed evenly along the knot.
    (n0, b0), (n1, _) = frames[0], frames[-1]
    gap = math.atan2(dot(n1, b0), dot(n1, n0))
    points, normals, triangles = [], [], []
    for i in range(KNOT_RINGS):
        centre, (n, b) = knot_point(times[i]), frames[i]
        for j in range(KNOT_SIDES):
            a = TAU * j / KNOT_SIDES - gap * i / KNOT_RINGS
            normal = add(tuple(math.cos(a) * x for x in n), b, math.sin(a))
            points.append(add(centre, normal, KNOT_TUBE))
            normals.append(tuple(f32(x) for x in normal))
            i1, j1 = (i + 1) % KNOT_RINGS, (j + 1) % KNOT_SIDES
            p, q, r, s = (u * KNOT_SIDES + v for u, v in ((i, j), (i, j1), (i1, j1), (i1, j)))
            triangles += [(p, q, r), (p, r, s)]
    return stand(points, 0.5, (0, 1)), normals, triangles


def write_glb(path, name, positions, normals, triangles):
    chunks = [
        b"".join(struct.pack("<3f", *p) for p in positions),
        b"".join(struct.pack("<3f", *n) for n in normals),
        b"".join(struct.pack("<3H", *t) for t in triangles),
    ]
    views, offset = [], 0
    for chunk, target in zip(chunks, (34962, 34962, 34963)):
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(chunk), "target": target})
        offset += len(chunk)
    binary = b"".join(chunks)
    binary += b"\0" * (-len(binary) % 4)
    vector = {"componentType": 5126, "count": len(positions), "type": "VEC3"}
    bounds = {
        "min": [min(p[k] for p in positions) for k in range(3)],
        "max": [max(p[k] for p in positions) for k in range(3)],
    }
    document = {
        "asset": {"version": "2.0", "generator": "tools/make_meshes.py"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0}],
        "meshes": [
            {"name": name, "primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}]}
        ],
        "materials": [{"name": name}],
        "accessors": [
            {"bufferView": 0, **vector, **bounds},
            {"bufferView": 1, **vector},
            {"bufferView": 2, "componentType": 5123, "count": 3 * len(triangles), "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    with open(path, "wb") as out:
        out.write(b"glTF" + struct.pack("<2I", 2, 12 + 8 + len(text) + 8 + len(binary)))
        out.write(struct.pack("<I", len(text)) + b"JSON" + text)
        out.write(struct.pack("<I", len(binary)) + b"BIN\0" + binary)


# --- vase.ply ---------------------------------------------------------------------------------------------------------

VASE_SIDES, VASE_TURN = 56, math.radians(14)

# Control points (radius, height) of the glass's cross-section: foot, stem, outer wall, rim, inner wall, inner bottom.
VASE_PROFILE = [
    (0.000, 0.000), (0.030, 0.000), (0.060, 0.000), (0.084, 0.000), (0.094, 0.005), (0.084, 0.013), (0.052, 0.022),
    (0.026, 0.040), (0.018, 0.075), (0.018, 0.120), (0.034, 0.155), (0.074, 0.190), (0.106, 0.250), (0.116, 0.320),
    (0.108, 0.390), (0.099, 0.440), (0.097, 0.454), (0.090, 0.454), (0.089, 0.438), (0.098, 0.389), (0.106, 0.320),
    (0.096, 0.256), (0.064, 0.204), (0.030, 0.184), (0.000, 0.182),
]  # fmt: skip


def spline(points, u):
    """Return point and outward normal of a uniform cubic B-spline segment with four control points, u from 0 to 1."""
    weights = ((1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3)
    slopes = (-((1 - u) ** 2), 3 * u**2 - 4 * u, -3 * u**2 + 2 * u + 1, u**2)
    r, y = (sum(w * p[c] for w, p in zip(weights, points)) / 6 for c in (0, 1))
    dr, dy = (sum(w * p[c] for w, p in zip(slopes, points)) for c in (0, 1))
    return (r, y), unit((dy, -dr))


def outline(control, turn):
    """Return points and outward normals (radius, height) along the uniform cubic B-spline of a profile, from axis to axis.

    `turn` is the largest angle, in radians, between neighbouring normals.
    """
    mirror = [(-control[1][0], control[1][1]), *control, (-control[-2][0], control[-2][1])]
    out = []
    for k in range(len(control) - 1):
        points = mirror[k : k + 4]
        (_, start), (_, end) = spline(points, 0.0), spline(points, 1.0)
        angle = math.acos(max(-1.0, min(1.0, dot(start, end))))
        # Sharp bends get more steps; 1e-9 makes the count independent of rounding errors of the angle.
        steps = max(2, math.ceil(angle / turn - 1e-9))
        last = k == len(control) - 2
        out += [spline(points, step / steps) for step in range(steps + last)]
    return out


def turned(profile, sides, turn, height):
    """Return (positions, normals, triangles) of a surface of revolution about the y axis, of the given height."""
    curve = outline(profile, turn)
    top = max(y for (_, y), _ in curve)
    low = min(y for (_, y), _ in curve)
    scale = height / (top - low)
    circle = [(math.cos(TAU * j / sides), math.sin(TAU * j / sides)) for j in range(sides)]
    points, normals, rings = [], [], []
    for k, ((r, y), (nr, ny)) in enumerate(curve):
        first, y = len(points), scale * (y - low)
        if k in (0, len(curve) - 1):
            points.append((0.0, f32(y), 0.0))
            normals.append((0.0, f32(ny), 0.0))
            rings.append([first] * sides)
        else:
            points += [(f32(scale * r * c), f32(y), f32(scale * r * s)) for c, s in circle]
            normals += [(f32(nr * c), f32(ny), f32(nr * s)) for c, s in circle]
            rings.append(list(range(first, first + sides)))
    triangles = []
    for lower, upper in zip(rings, rings[1:]):
        for j in range(sides):
            i = (j + 1) % sides
            p, q, r, s = lower[j], upper[j], upper[i], lower[i]
            triangles += [t for t in ((p, q, r), (p, r, s)) if len(set(t)) == 3]
    return points, normals, triangles


def write_ply(path, positions, normals, triangles):
    header = ["ply", "format binary_little_endian 1.0", "comment made by tools/make_meshes.py"]
    header += [f"element vertex {len(positions)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    with open(path, "wb") as out:
        out.write("\n".join(header).encode())
        for p, n in zip(positions, normals):
            out.write(struct.pack("<6f", *p, *n))
        for t in triangles:
            out.write(struct.pack("<B3i", 3, *t))


# --- pedestal.obj -----------------------------------------------------------------------------------------------------

# (distance of the flat sides from the axis, height), from the lower to the upper edge.
PEDESTAL_PROFILE = [
    (0.245, 0.000), (0.250, 0.005), (0.250, 0.050), (0.235, 0.065), (0.215, 0.070), (0.200, 0.085), (0.200, 0.215),
    (0.215, 0.230), (0.235, 0.235), (0.250, 0.250), (0.250, 0.290), (0.240, 0.300),
]  # fmt: skip
PEDESTAL_CHAMFER = 0.08


def write_pedestal(path):
    """Write an octagon with chamfered edges; one polygon per face, one normal per polygon."""
    outline = []
    corners = [(math.cos(TAU * (k + 0.5) / 8), math.sin(TAU * (k + 0.5) / 8)) for k in range(8)]
    corners = [add((0.0, 0.0), c, 1.0 / math.cos(TAU / 16)) for c in corners]
    for k, corner in enumerate(corners):
        for other in (corners[k - 1], corners[(k + 1) % 8]):
            outline.append(add(corner, add(other, corner, -1.0), PEDESTAL_CHAMFER))
    sides = len(outline)
    points = [(a * x, y, a * z) for a, y in PEDESTAL_PROFILE for x, z in outline]
    faces = [list(range(sides)), list(reversed(range(len(points) - sides, len(points))))]
    for k in range(len(PEDESTAL_PROFILE) - 1):
        for j in range(sides):
            i = (j + 1) % sides
            faces.append([k * sides + j, (k + 1) * sides + j, (k + 1) * sides + i, k * sides + i])
    number = lambda x: f"{round(x, 6) + 0.0:g}"  # noqa: E731
    lines = ["# made by tools/make_meshes.py", "o pedestal"]
    lines += ["v " + " ".join(number(x) for x in p) for p in points]
    for face in faces:
        a, b, c = (points[i] for i in face[:3])
        normal = unit(cross(add(b, a, -1.0), add(c, a, -1.0)))
        lines.append("vn " + " ".join(number(x) for x in normal))
    lines.append("usemtl pedestal")
    for n, face in enumerate(faces, 1):
        lines.append("f " + " ".join(f"{i + 1}//{n}" for i in face))
    path.write_bytes(("\n".join(lines) + "\n").encode())


def main():
    default = Path(__file__).resolve().parent.parent / "scenes" / "mirror_room"
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    folder.mkdir(parents=True, exist_ok=True)
    write_glb(folder / "knot.glb", "knot", *knot())
    write_ply(folder / "vase.ply", *turned(VASE_PROFILE, VASE_SIDES, VASE_TURN, 0.45))
    write_pedestal(folder / "pedestal.obj")


if __name__ == "__main__":
    main()

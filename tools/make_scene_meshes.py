#!/usr/bin/env python3
"""Write the meshes and images of the scenes disco_ball, coins_mirror, milky_tank, crystals and fruits, and the foil of painted_doll.

Lengths are in metres and +y is up. Every mesh is closed and faces outward, except the facets of the disco ball and the pleated
foil. Requires Python 3 only; the output is deterministic.

    tools/make_scene_meshes.py [folder]      (default: scenes/ of this repository)
"""

import math
import random
import struct
import sys
import zlib
from pathlib import Path

from make_meshes import TAU, add, cross, dot, f32, turned, unit


def write_ply(path, positions, faces, normals=None, uvs=None):
    """Write a binary PLY file of polygons with at most 65,536 vertices, with normals and texture coordinates if given."""
    tables = [t for t in (positions, normals, uvs) if t is not None]
    names = ["x", "y", "z"] + (["nx", "ny", "nz"] if normals else []) + (["s", "t"] if uvs else [])
    header = ["ply", "format binary_little_endian 1.0", "comment made by tools/" + Path(sys.argv[0]).name]
    header += [f"element vertex {len(positions)}", *(f"property float {name}" for name in names)]
    header += [f"element face {len(faces)}", "property list uchar ushort vertex_indices", "end_header", ""]
    with open(path, "wb") as out:
        out.write("\n".join(header).encode())
        for row in zip(*tables):
            values = [f32(x) for part in row for x in part]
            out.write(struct.pack(f"<{len(values)}f", *values))
        for face in faces:
            out.write(struct.pack(f"<B{len(face)}H", len(face), *face))


def write_png(path, rows):
    """Write an 8-bit PNG file of rows of (r, g, b), top row first."""

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = struct.pack(">2I5B", len(rows[0]), len(rows), 8, 2, 0, 0, 0)
    data = b"".join(b"\0" + bytes(x for pixel in row for x in pixel) for row in rows)
    parts = [(b"IHDR", header), (b"IDAT", zlib.compress(data, 9)), (b"IEND", b"")]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts))


def vertex_normals(points, triangles):
    """Return the normals of the vertices of a smooth mesh: means over the adjacent triangles, weighted by area."""
    sums = [(0.0, 0.0, 0.0)] * len(points)
    for face in triangles:
        p, q, r = (points[k] for k in face)
        normal = cross(add(q, p, -1.0), add(r, p, -1.0))
        for k in face:
            sums[k] = add(sums[k], normal)
    return [unit(n) for n in sums]


# --- disco_ball/facets.ply --------------------------------------------------------------------------------------------

BALL_RADIUS, BALL_ROWS = 0.15, 18
# Fraction of its cell that a facet fills, and the spread of the facet's random tilt, as for mirrors glued by hand.
FACET_FILL, FACET_TILT = 0.92, math.radians(0.7)


def facets():
    """Return (positions, faces) of square mirrors in rows around a sphere about the origin, each tilted slightly at random."""
    chance = random.Random(18)
    edge = math.pi / BALL_ROWS
    points, faces = [], []
    for row in range(BALL_ROWS):
        latitude = -math.pi / 2 + edge * (row + 0.5)
        count = max(3, round(TAU * math.cos(latitude) / edge))
        for k in range(count):
            longitude = TAU * (k + 0.5 * (row % 2)) / count
            across = math.cos(latitude)
            out = (across * math.cos(longitude), math.sin(latitude), across * math.sin(longitude))
            east = (-math.sin(longitude), 0.0, math.cos(longitude))
            north = cross(east, out)
            centre = tuple(BALL_RADIUS * x for x in out)
            out = unit(add(add(out, east, chance.gauss(0.0, FACET_TILT)), north, chance.gauss(0.0, FACET_TILT)))
            east = unit(add(east, out, -dot(east, out)))
            north = cross(east, out)
            # Facets near the poles are smaller than their cells allow, so that all facets are squares.
            half = 0.5 * FACET_FILL * BALL_RADIUS * min(edge, TAU * math.cos(latitude) / count)
            first = len(points)
            for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1)):
                points.append(add(add(centre, east, a * half), north, b * half))
            faces.append(tuple(range(first, first + 4)))
    return points, faces


# --- coins_mirror/sun.ply, star.ply -----------------------------------------------------------------------------------

COIN_RADIUS, COIN_HEIGHT, COIN_RELIEF = 0.020, 0.003, 0.0011
COIN_SIDES, COIN_RINGS = 120, 32


def step(low, high, x):
    """Return a smooth step from 0 at `low` to 1 at `high`."""
    t = max(0.0, min(1.0, (x - low) / (high - low)))
    return t * t * (3.0 - 2.0 * t)


def rim(r, a):
    """Return the relief common to all coins: a raised edge and a ring of beads."""
    beads = math.hypot(r - 0.79, 0.79 * (((a * 24 / TAU) % 1.0) - 0.5) * TAU / 24)
    return max(step(0.87, 0.92, r), 0.6 * (1.0 - step(0.035, 0.065, beads)))


def sun(r, a):
    """Return the height, 0 to 1, at radius r (0 to 1) and angle a: a face of three bosses in a disc, and twelve rays."""
    x, y = r * math.cos(a), r * math.sin(a)
    disc = 0.8 * (1.0 - (r / 0.36) ** 4) if r < 0.36 else 0.0
    features = [((-0.12, 0.07), 0.05, -0.3), ((0.12, 0.07), 0.05, -0.3), ((0.0, -0.02), 0.045, 0.35)]
    for (cx, cy), size, height in features:
        disc += height * (1.0 - step(0.0, 1.6 * size, math.hypot(x - cx, y - cy)))
    if r < 0.36 and y < -0.08:
        disc -= 0.3 * (1.0 - step(0.015, 0.05, abs(math.hypot(x, y - 0.05) - 0.20))) * step(0.0, 0.1, 0.18 - abs(x))
    turn = ((a * 12 / TAU) % 1.0) - 0.5
    length = 0.72 if int(a * 12 / TAU) % 2 else 0.60
    width = 0.48 * max(0.0, (length - r) / (length - 0.38))
    rays = 0.7 * (1.0 - step(0.4 * width, width + 0.08, abs(turn))) * step(0.0, 0.08, min(r - 0.38, length - r))
    return max(disc, rays, rim(r, a))


def star(r, a):
    """Return the height of a five-pointed star with ridges from its centre, in a wreath."""
    wedge = abs(((a * 5 / TAU) % 1.0) - 0.5) * TAU / 5
    # The edge of a wedge extends from its tip at radius 0.6 and angle 36° to the notch at radius 0.25 and angle 0.
    tip, notch = (0.60 * math.cos(TAU / 10), 0.60 * math.sin(TAU / 10)), (0.25, 0.0)
    normal = unit((tip[1] - notch[1], notch[0] - tip[0]))
    inside = dot(normal, notch) - dot(normal, (r * math.cos(wedge), r * math.sin(wedge)))
    body = min(1.0, 4.5 * inside) * 0.9 if inside > 0.0 else 0.0
    leaf = 0.45 * (1.0 - step(0.0, 0.05, abs(r - 0.68 - 0.03 * math.sin(20 * a)))) * (0.7 + 0.3 * math.cos(40 * a))
    return max(body, leaf, rim(r, a))


def coin(relief):
    """Return (positions, faces, normals) of a coin that lies on y = 0; its lower face is plain."""

    def height(x, z):
        r, a = math.hypot(x, z) / COIN_RADIUS, math.atan2(-z, x) % TAU
        return COIN_HEIGHT - COIN_RELIEF + COIN_RELIEF * relief(min(r, 0.95), a)

    def normal(x, z):
        e = 0.015 * COIN_RADIUS
        return unit((height(x - e, z) - height(x + e, z), 2 * e, height(x, z - e) - height(x, z + e)))

    # Centre and rings of the relief, then the upper and lower end of the edge, then the rim of the lower face.
    rings = [(COIN_RADIUS * k / COIN_RINGS, None, None) for k in range(1, COIN_RINGS + 1)]
    rings += [(COIN_RADIUS, COIN_HEIGHT, 0.0), (COIN_RADIUS, 0.0, 0.0), (COIN_RADIUS, 0.0, -1.0)]
    points, normals, faces = [(0.0, height(0.0, 0.0), 0.0)], [(0.0, 1.0, 0.0)], []
    for r, y, up in rings:
        for j in range(COIN_SIDES):
            c, s = math.cos(TAU * j / COIN_SIDES), math.sin(TAU * j / COIN_SIDES)
            points.append((r * c, height(r * c, r * s) if y is None else y, r * s))
            normals.append(normal(r * c, r * s) if up is None else (c * (1.0 - abs(up)), up, s * (1.0 - abs(up))))
    ring = lambda k, j: 1 + k * COIN_SIDES + j % COIN_SIDES  # noqa: E731
    faces = [(0, ring(0, j + 1), ring(0, j)) for j in range(COIN_SIDES)]
    for k in (*range(COIN_RINGS - 1), COIN_RINGS):
        for j in range(COIN_SIDES):
            p, q, r, s = ring(k, j), ring(k, j + 1), ring(k + 1, j + 1), ring(k + 1, j)
            faces += [(p, q, r), (p, r, s)]
    first = len(points)
    points.append((0.0, 0.0, 0.0))
    normals.append((0.0, -1.0, 0.0))
    faces += [(first, ring(COIN_RINGS + 2, j), ring(COIN_RINGS + 2, j + 1)) for j in range(COIN_SIDES)]
    return points, faces, normals


# --- milky_tank/doll.ply, doll.png, ruler.png -------------------------------------------------------------------------

DOLL_SIDES = 64

# Control points (radius, height) of a nesting doll: foot, body, neck, head.
DOLL_PROFILE = [
    (0.000, 0.00), (0.100, 0.00), (0.200, 0.00), (0.262, 0.01), (0.285, 0.05), (0.310, 0.14), (0.345, 0.28),
    (0.355, 0.42), (0.320, 0.56), (0.245, 0.65), (0.215, 0.69), (0.240, 0.74), (0.275, 0.82), (0.265, 0.92),
    (0.190, 1.01), (0.090, 1.05), (0.000, 1.05),
]  # fmt: skip


def doll():
    """Return (positions, faces, normals, uvs); u runs once around from +x over +z, v is the height."""
    points, normals, triangles = turned(DOLL_PROFILE, DOLL_SIDES, math.radians(12), 1.0)
    # Texture coordinates jump at u = 0, so the vertices there are duplicated; the poles have one vertex per triangle.
    out = {}
    faces = []
    for face in triangles:
        angles = []
        for i in face:
            x, _, z = points[i]
            angles.append(None if math.hypot(x, z) < 1e-9 else round(DOLL_SIDES * (math.atan2(z, x) % TAU) / TAU))
        known = [a for a in angles if a is not None]
        if max(known) - min(known) > DOLL_SIDES / 2:
            angles = [a if a is None or a > DOLL_SIDES / 2 else a + DOLL_SIDES for a in angles]
            known = [a for a in angles if a is not None]
        corners = [(i, sum(known) / len(known) if a is None else a) for i, a in zip(face, angles)]
        faces.append(tuple(out.setdefault(corner, len(out)) for corner in corners))
    uvs = [(a / DOLL_SIDES, points[i][1]) for i, a in out]
    return [points[i] for i, _ in out], faces, [normals[i] for i, _ in out], uvs


RED, CREAM, GREEN, BLUE, BLACK, YELLOW = (
    (190, 40, 36), (236, 214, 180), (60, 120, 62), (48, 76, 150), (30, 26, 26), (228, 178, 60),
)  # fmt: skip


def doll_paint(u, v):
    """Return the colour of the doll at (u, v); its face points to +z, where u = 1/4."""
    x, y = (u - 0.25) * TAU * 0.27, v - 0.80
    around = abs(u - 0.25)
    if v > 0.66:
        if math.hypot(x, y) < 0.16:
            for eye in (-0.06, 0.06):
                if math.hypot(x - eye, y - 0.03) < 0.022:
                    return BLACK
                if math.hypot(x - 1.6 * eye, y + 0.05) < 0.03:
                    return (224, 140, 120)
            if abs(y + 0.075) < 0.014 and abs(x) < 0.035:
                return RED
            if y > 0.095 + 0.6 * x * x:
                return YELLOW
            return CREAM
        return RED if (int(u * 24) + int(v * 18)) % 4 else YELLOW
    if v > 0.60:
        return YELLOW
    if around < 0.13 and v > 0.08:
        flower = math.hypot(x, v - 0.36)
        if flower < 0.05:
            return YELLOW
        petals = 0.10 + 0.03 * math.cos(6 * math.atan2(v - 0.36, x))
        return RED if flower < petals else CREAM
    if v < 0.08:
        return BLACK
    return GREEN if (v * 12) % 1.0 < 0.5 else BLUE


def ruler_image():
    """Return a ruler of 16 cm: alternating black and white centimetres, each with a number, and ticks of 5 mm; 20 pixels per cm.
    """
    # Rows of a 3 × 5 font, each digit as five octal numbers.
    font = ["75557", "26227", "71747", "71717", "55711", "74717", "74757", "71111", "75757", "75717"]
    width, height = 16 * 20, 60
    rows = []
    for y in range(height):
        row = []
        for x in range(width):
            cm, inner = divmod(x, 20)
            dark = cm % 2 == 1
            if y < 20:
                # Ticks along the upper edge, in the opposite colour.
                if inner < 2 or (inner in (10, 11) and y < 12):
                    dark = not dark
            else:
                text = str(cm)
                scale, top = 4 if len(text) == 1 else 2, 28
                left = 10 - (4 * len(text) - 1) * scale // 2
                column, line = (inner - left) // scale, (y - top) // scale
                if 0 <= line < 5 and 0 <= column < 4 * len(text) and column % 4 < 3:
                    bits = int(font[int(text[column // 4])][line])
                    if bits >> (2 - column % 4) & 1:
                        dark = not dark
            row.append((20, 20, 22) if dark else (235, 232, 220))
        rows.append(row)
    return rows


# --- crystals/calcite.ply, pattern.png --------------------------------------------------------------------------------

# Plane angle of the faces of calcite's cleavage rhombohedron, at its two blunt corners.
CALCITE_ANGLE = math.radians(101.92)


def calcite(edges, turn):
    """Return (positions, faces, optic axis) of a cleavage rhombohedron that lies on y = 0, with a blunt corner below.

    The three edges at the blunt corner enclose equal angles, and the optic axis encloses equal angles with all of them: it is
    the sum of their directions. `edges` are their lengths, and `turn` is the angle about +y.
    """
    c, s = math.cos(CALCITE_ANGLE), math.sin(CALCITE_ANGLE)
    a, b = (1.0, 0.0, 0.0), (c, 0.0, -s)
    # The third edge e has e·a = e·b = c and unit length.
    z = (c * c - c) / s
    e = (c, math.sqrt(1.0 - c * c - z * z), z)
    u, v = math.cos(turn), math.sin(turn)
    a, b, e = ((u * p[0] + v * p[2], p[1], u * p[2] - v * p[0]) for p in (a, b, e))
    axis = unit(add(add(a, b), e))
    a, b, e = (tuple(length * x for x in v) for v, length in zip((a, b, e), edges))
    middle = tuple(0.5 * (x + y + w) for x, y, w in zip(a, b, e))
    corners = []
    for k in range(8):
        p = (-middle[0], 0.0, -middle[2])
        for bit, edge in enumerate((a, b, e)):
            if k >> bit & 1:
                p = add(p, edge)
        corners.append(p)
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return corners, outward(corners, faces), axis


# --- crystals/quartz.ply ----------------------------------------------------------------------------------------------

# Angle of quartz's rhombohedral faces to the plane perpendicular to its axis, from a : c = 1 : 1.1 (51.79 degrees, textbook
# value).
QUARTZ_RADIUS, QUARTZ_PRISM, QUARTZ_ANGLE = 0.012, 0.024, math.radians(51.79)


def quartz():
    """Return (positions, faces) of a six-sided prism about the x axis, the optic axis, with a six-sided point at both ends."""
    height = QUARTZ_RADIUS * math.cos(math.pi / 6.0) * math.tan(QUARTZ_ANGLE)
    turns = [math.radians(60 * k) for k in range(6)]
    ring = [(QUARTZ_RADIUS * math.cos(t), QUARTZ_RADIUS * math.sin(t)) for t in turns]
    points = [(side * 0.5 * QUARTZ_PRISM, y, z) for side in (-1.0, 1.0) for y, z in ring]
    points += [(side * (0.5 * QUARTZ_PRISM + height), 0.0, 0.0) for side in (-1.0, 1.0)]
    faces = []
    for k in range(6):
        n = (k + 1) % 6
        faces += [(k, n, 6 + n, 6 + k), (k, n, 12), (6 + k, 6 + n, 13)]
    return points, outward(points, faces)


# --- crystals/quartz_section.ply, quartz_point.ply ----------------------------------------------------------------------


# Optic axes, as in crystals/scene.toml: 3 degrees from the camera's line of sight, and upright.
QUARTZ_SECTION_AXIS, QUARTZ_POINT_AXIS = (0.275, -0.137, -0.952), (0.0, 1.0, 0.0)


def polyhedron(planes):
    """Return (positions, faces) of the points p with n·p <= d for all planes (n, d)."""
    points = []
    for i, (n, d) in enumerate(planes):
        for j, (m, e) in enumerate(planes[:i]):
            for o, f in planes[:j]:
                det = dot(n, cross(m, o))
                if abs(det) < 1e-9:
                    continue
                sides = zip((d, e, f), (cross(m, o), cross(o, n), cross(n, m)))
                p = (0.0, 0.0, 0.0)
                for weight, side in sides:
                    p = add(p, side, weight / det)
                inside = all(dot(k, p) <= g + 1e-9 for k, g in planes)
                if inside and all(math.dist(p, q) > 1e-7 for q in points):
                    points.append(p)
    faces = []
    for n, d in planes:
        corners = [k for k, p in enumerate(points) if abs(dot(n, p) - d) < 1e-8]
        if len(corners) < 3:
            continue
        centre = tuple(sum(points[k][axis] for k in corners) / len(corners) for axis in range(3))
        first = unit(add(points[corners[0]], centre, -1.0))
        second = cross(n, first)
        angle = lambda k: math.atan2(dot(add(points[k], centre, -1.0), second), dot(add(points[k], centre, -1.0), first))  # noqa: B023, E731
        faces.append(tuple(sorted(corners, key=angle)))
    return points, faces


def quartz_crystal(seed, radius, ends, axis):
    """Return (positions, faces) of a hexagonal prism of quartz that rests on y = 0, about an axis through x = z = 0.

    `radius` is the distance of its sides from its axis. `ends` are the two heights along the axis, each with the kind of the end:
    "cut" perpendicular to the axis, or "point" with the faces of the two rhombohedra, of which every second one is larger. Natural
    faces have slightly different distances from the centre.
    """
    chance = random.Random(seed)
    axis = unit(axis)
    up = (0.0, 1.0, 0.0) if abs(axis[1]) < 0.9 else (0.35, 0.0, 1.0)
    first = unit(add(up, axis, -dot(up, axis)))
    second = cross(axis, first)
    turn = lambda k: add(tuple(math.cos(TAU * k / 6) * x for x in first), second, math.sin(TAU * k / 6))  # noqa: E731
    planes = [(turn(k), radius * chance.uniform(0.92, 1.10)) for k in range(6)]
    c, s = math.cos(QUARTZ_ANGLE), math.sin(QUARTZ_ANGLE)
    for sign, (height, kind) in zip((1.0, -1.0), ends):
        if kind == "cut":
            planes.append((tuple(sign * x for x in axis), height))
            continue
        for k in range(6):
            larger = (k % 2 == 0) == (sign > 0.0)
            tip = height * (1.0 if larger else 1.0 + 0.35 * radius / height) * chance.uniform(0.99, 1.02)
            planes.append((add(tuple(sign * c * x for x in axis), turn(k), s), c * tip))
    points, faces = polyhedron(planes)
    low = min(p[1] for p in points)
    return [(x, y - low, z) for x, y, z in points], faces


# --- crystals/pebbles.ply, rods.ply -------------------------------------------------------------------------------------

# Centre (x, z), radius, and ratio of height to radius of each pebble.
PEBBLES = [
    (-0.034, 0.036, 0.0055, 0.65), (-0.026, 0.043, 0.0036, 0.7), (0.016, 0.034, 0.0048, 0.7), (0.047, -0.034, 0.0090, 0.75),
    (-0.010, -0.040, 0.0080, 0.9), (-0.046, -0.034, 0.0100, 0.7), (-0.008, 0.034, 0.0034, 0.7), (0.0205, 0.0425, 0.0026, 0.7),
]  # fmt: skip
PEBBLE_RINGS, PEBBLE_SIDES = 12, 24


def pebbles():
    """Return (positions, faces, normals) of rounded stones that lie on y = 0."""
    chance = random.Random(7)
    points, faces, normals = [], [], []
    for x, z, radius, flat in PEBBLES:
        waves = [(unit(tuple(chance.gauss(0.0, 1.0) for _ in range(3))), chance.uniform(2.0, 3.5), chance.uniform(0.0, TAU)) for _ in range(4)]
        first, own = len(points), []
        for i in range(PEBBLE_RINGS + 1):
            a = math.pi * i / PEBBLE_RINGS
            for j in range(PEBBLE_SIDES if 0 < i < PEBBLE_RINGS else 1):
                b = TAU * j / PEBBLE_SIDES
                d = (math.sin(a) * math.cos(b), math.cos(a), -math.sin(a) * math.sin(b))
                r = radius * (1.0 + sum(0.05 * math.sin(k * dot(n, d) + t) for n, k, t in waves))
                own.append((x + r * d[0], flat * r * d[1], z + r * d[2]))
        low = min(p[1] for p in own)
        own = [(p[0], p[1] - low, p[2]) for p in own]
        at = lambda i, j: (0 if i == 0 else len(own) - 1 if i == PEBBLE_RINGS else 1 + (i - 1) * PEBBLE_SIDES + j % PEBBLE_SIDES)  # noqa: B023, E731
        triangles = []
        for i in range(PEBBLE_RINGS):
            for j in range(PEBBLE_SIDES):
                p, q, r, s = at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)
                triangles += [(p, s, r)] if i == 0 else [(p, s, q)] if i == PEBBLE_RINGS - 1 else [(p, s, r), (p, r, q)]
        points += own
        normals += vertex_normals(own, triangles)
        faces += [tuple(first + k for k in triangle) for triangle in triangles]
    return points, faces, normals


# Both ends and the radius of each rod.
RODS = [
    ((-0.030, 0.0022, -0.034), (0.004, 0.0560, -0.0575), 0.0016),
    ((-0.014, 0.0018, 0.0480), (0.012, 0.0018, 0.0320), 0.0016),
]  # fmt: skip
ROD_SIDES = 20


def rods():
    """Return (positions, faces, normals) of round rods with flat ends."""
    points, faces, normals = [], [], []
    for start, end, radius in RODS:
        along = unit(add(end, start, -1.0))
        side = unit(cross(along, (0.0, 1.0, 0.0)))
        other = cross(along, side)
        ring = [add(tuple(math.cos(TAU * j / ROD_SIDES) * x for x in side), other, math.sin(TAU * j / ROD_SIDES)) for j in range(ROD_SIDES)]
        first = len(points)
        for centre in (start, end):
            points += [add(centre, n, radius) for n in ring]
            normals += ring
        for j in range(ROD_SIDES):
            i = (j + 1) % ROD_SIDES
            faces.append((first + j, first + i, first + ROD_SIDES + i, first + ROD_SIDES + j))
        for centre, direction in ((start, -1.0), (end, 1.0)):
            cap = list(range(len(points), len(points) + ROD_SIDES))
            points += [add(centre, n, radius) for n in ring]
            normals += [tuple(direction * x for x in along)] * ROD_SIDES
            faces.append(tuple(cap if direction > 0.0 else reversed(cap)))
    return points, faces, normals


def outward(points, faces):
    """Orient the faces of a convex body counter-clockwise as seen from outside, by means of the mean of its points."""
    centre = tuple(sum(p[k] for p in points) / len(points) for k in range(3))
    out = []
    for face in faces:
        p, q, r = (points[i] for i in face[:3])
        normal = cross(add(q, p, -1.0), add(r, p, -1.0))
        out.append(face if dot(normal, add(p, centre, -1.0)) > 0.0 else face[::-1])
    return out


def pattern_image():
    """Return squares with crosses, which make double images and bent lines visible in all directions."""
    size, cell = 256, 32
    rows = []
    for y in range(size):
        row = []
        for x in range(size):
            (i, u), (j, v) = divmod(x, cell), divmod(y, cell)
            dark = (i + j) % 2 == 1
            mark = (abs(u - 15.5) < 2.5 and abs(v - 15.5) < 10) or (abs(v - 15.5) < 2.5 and abs(u - 15.5) < 10)
            row.append((40, 44, 60) if dark != mark else (232, 226, 214))
        rows.append(row)
    return rows


# --- fruits/apple.ply, pear.ply, stem.ply, petals.ply, heart.ply, cloth.png -----------------------------------------------------------------------------

FRUIT_SIDES = 56

# Control points (radius, height) from the blossom end to the stem cavity.
APPLE_PROFILE = [
    (0.000, 0.120), (0.040, 0.105), (0.090, 0.040), (0.190, 0.000), (0.300, 0.030), (0.400, 0.130), (0.470, 0.280),
    (0.505, 0.450), (0.500, 0.610), (0.440, 0.760), (0.330, 0.850), (0.200, 0.865), (0.100, 0.800), (0.045, 0.710),
    (0.000, 0.690),
]  # fmt: skip

PEAR_PROFILE = [
    (0.000, 0.070), (0.040, 0.055), (0.090, 0.010), (0.180, 0.000), (0.290, 0.050), (0.375, 0.160), (0.410, 0.300),
    (0.395, 0.440), (0.330, 0.580), (0.250, 0.710), (0.205, 0.830), (0.190, 0.930), (0.160, 1.020), (0.100, 1.060),
    (0.050, 1.045), (0.000, 1.030),
]  # fmt: skip


def stem():
    """Return (positions, faces, normals) of a bent, tapered twig of unit length, from the origin upward."""
    rings, sides = 10, 12
    points, normals, faces = [], [], []
    for k in range(rings + 1):
        t = k / rings
        centre, radius = (0.22 * t * t, t, 0.0), 0.045 + 0.035 * abs(t - 0.4) ** 1.5 * 2.0
        along = unit((0.44 * t, 1.0, 0.0))
        side = unit((along[1], -along[0], 0.0))
        other = cross(side, along)
        for j in range(sides):
            a = TAU * j / sides
            n = add(tuple(math.cos(a) * x for x in side), other, math.sin(a))
            points.append(add(centre, n, radius))
            normals.append(n)
    for k in range(rings):
        for j in range(sides):
            i = (j + 1) % sides
            faces.append((k * sides + j, (k + 1) * sides + j, (k + 1) * sides + i, k * sides + i))
    for k, direction in ((0, -1.0), (rings, 1.0)):
        first = len(points)
        points += points[k * sides : (k + 1) * sides]
        normals += [unit((0.44 * k / rings * direction, direction, 0.0))] * sides
        cap = list(range(first, first + sides))
        faces.append(tuple(cap if direction < 0 else reversed(cap)))
    return points, faces, normals


# Whorls of a flower: number of petals, distance of their base from the axis, length, largest half width, height of the base and
# rise of the tip, in units of the flower's radius; half the thickness of a petal.
WHORLS = [(9, 0.30, 0.70, 0.185, 0.000, 0.06), (9, 0.29, 0.60, 0.165, 0.070, 0.20), (8, 0.28, 0.42, 0.125, 0.140, 0.27)]
PETAL_THICKNESS = 0.014


def petals():
    """Return (positions, faces, normals) of a flower's petals, of unit radius, around +y; petals do not touch each other."""
    rings, sides = 9, 6
    points, faces, normals = [], [], []
    for w, (count, base, length, width, height, rise) in enumerate(WHORLS):
        for k, up in ((k, up) for k in range(count) for up in (True, False)):
            # The upper and the lower side have their own normals along their common edge.
            turn = TAU * (k + 0.5 * (w % 2)) / count + 0.11 * w
            first, own = len(points), []
            c, s = math.cos(turn), math.sin(turn)
            for i in range(rings + 1):
                t = i / rings
                # A petal is widest at two thirds of its length, and its edges bend upward.
                half = width * max(0.0, math.sin(math.pi * t**1.35)) ** 0.6
                thick = PETAL_THICKNESS * max(0.0, math.sin(math.pi * t)) ** 0.5 * (1.0 if up else -1.0)
                for j in range(sides + 1 if 0 < i < rings else 1):
                    a = math.pi * j / sides
                    x, z = base + length * t, half * math.cos(a)
                    y = height + rise * t**1.6 + 0.3 * z * z / width - 0.012 * math.cos(5.0 * z / width)
                    y += thick * math.sin(a) if 0 < j < sides else 0.0
                    own.append((c * x - s * z, y, s * x + c * z))
            at = lambda i, j: 0 if i == 0 else len(own) - 1 if i == rings else 1 + (i - 1) * (sides + 1) + j  # noqa: B023, E731
            triangles = []
            for i in range(rings):
                for j in range(sides):
                    p, q, r, o = at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)
                    triangles += [(p, o, r)] if i == 0 else [(p, o, q)] if i == rings - 1 else [(p, o, r), (p, r, q)]
            triangles = [face if up else face[::-1] for face in triangles]
            faces += [tuple(first + corner for corner in face) for face in triangles]
            points += own
            normals += vertex_normals(own, triangles)
    return points, faces, normals


def flower_heart():
    """Return (positions, faces, normals) of the round heart of the flower of `petals`, with many small bosses."""
    rings, sides = 24, 48
    points, faces, normals = [], [], []

    def height(x, z):
        r, a = math.hypot(x, z), math.atan2(z, x)
        boss = 0.010 * math.cos(60.0 * r) * math.cos(12 * a) * step(0.02, 0.08, r)
        return 0.06 + 0.15 * math.sqrt(max(0.0, 1.0 - (r / 0.27) ** 2)) + boss * (1.0 - step(0.22, 0.26, r))

    rows = [(0.27 * math.sin(0.5 * math.pi * i / rings), 1.0) for i in range(1, rings + 1)] + [(0.27, -1.0)]
    points.append((0.0, height(0.0, 0.0), 0.0))
    for r, up in rows:
        for j in range(sides):
            x, z = r * math.cos(TAU * j / sides), r * math.sin(TAU * j / sides)
            points.append((x, height(x, z), z) if up > 0.0 else (x, 0.0, z))
    points.append((0.0, 0.0, 0.0))
    ring = lambda i, j: 1 + i * sides + j % sides  # noqa: E731
    for j in range(sides):
        faces.append((0, ring(0, j + 1), ring(0, j)))
        for i in range(len(rows) - 1):
            p, q, r, s = ring(i, j), ring(i, j + 1), ring(i + 1, j + 1), ring(i + 1, j)
            faces += [(p, q, r), (p, r, s)]
        faces.append((len(points) - 1, ring(len(rows) - 1, j), ring(len(rows) - 1, j + 1)))
    return points, faces, vertex_normals(points, faces)


def cloth_image():
    """Return a woven check of 40 × 28 cells in three shades of blue, with the threads of the weave."""
    size, shades = 12, ((226, 228, 224), (150, 172, 200), (84, 112, 160))
    chance = random.Random(5)
    warp, weft = ([chance.uniform(-9.0, 9.0) for _ in range(size * n)] for n in (40, 28))
    rows = []
    for y in range(28 * size):
        row = []
        for x in range(40 * size):
            colour = shades[(x // size) % 2 + (y // size) % 2]
            thread = warp[x] if (x + y) % 2 else weft[y]
            row.append(tuple(max(0, min(255, round(v + thread + (6 if (x + y) % 2 else -6)))) for v in colour))
        rows.append(row)
    return rows


def pleats():
    """Return a foil with eight vertical pleats of 6 mm whose sides enclose a right angle. The foil is 85 mm high and faces +z."""
    positions, faces = [], []
    for i in range(17):
        x, z = 0.003 * (i - 8), 0.003 if i % 2 == 0 else 0.0
        positions += [(x, 0.0, z), (x, 0.085, z)]
    for i in range(16):
        a = 2 * i
        faces.append((a, a + 2, a + 3, a + 1))
    return positions, faces


def main():
    default = Path(__file__).resolve().parent.parent / "scenes"
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    for name in ("disco_ball", "coins_mirror", "milky_tank", "crystals", "fruits", "painted_doll"):
        (root / name).mkdir(parents=True, exist_ok=True)
    write_ply(root / "disco_ball/facets.ply", *facets())
    for name, relief in (("sun", sun), ("star", star)):
        write_ply(root / f"coins_mirror/{name}.ply", *coin(relief))
    write_ply(root / "milky_tank/doll.ply", *doll())
    size = 192
    paint = [[doll_paint((x + 0.5) / size, 1.0 - (y + 0.5) / size) for x in range(size)] for y in range(size)]
    write_png(root / "milky_tank/doll.png", paint)
    write_png(root / "milky_tank/ruler.png", ruler_image())
    corners, faces, axis = calcite((0.020, 0.014, 0.0185), math.radians(-10))
    write_ply(root / "crystals/calcite.ply", corners, faces)
    print("calcite's optic axis, for crystals/scene.toml:", [round(x, 6) for x in axis])
    write_ply(root / "crystals/quartz.ply", *quartz())
    section = quartz_crystal(1, 0.0098, [(0.011, "cut")] * 2, QUARTZ_SECTION_AXIS)
    write_ply(root / "crystals/quartz_section.ply", *section)
    point = quartz_crystal(2, 0.0044, [(0.0190, "point"), (0.0120, "cut")], QUARTZ_POINT_AXIS)
    write_ply(root / "crystals/quartz_point.ply", *point)
    write_ply(root / "crystals/pebbles.ply", *pebbles())
    write_ply(root / "crystals/rods.ply", *rods())
    write_png(root / "crystals/pattern.png", pattern_image())
    for name, profile, height in (("apple", APPLE_PROFILE, 0.065), ("pear", PEAR_PROFILE, 0.095)):
        points, normals, triangles = turned(profile, FRUIT_SIDES, math.radians(10), height)
        write_ply(root / f"fruits/{name}.ply", points, triangles, normals)
    write_ply(root / "fruits/stem.ply", *stem())
    write_ply(root / "fruits/petals.ply", *petals())
    write_ply(root / "fruits/heart.ply", *flower_heart())
    write_png(root / "fruits/cloth.png", cloth_image())
    write_ply(root / "painted_doll/pleats.ply", *pleats())


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Write scenes/sss_statue/dragon.ply: a seated dragon on a plinth, one closed smooth surface.

The dragon is the zero set of a signed distance: tubes of varying radius and thin triangles, joined by a smooth minimum (Quilez,
"smooth minimum", polynomial form). Surface nets (Gibson 1998, "Constrained elastic surface nets") extract the surface from a
grid. The field is smoothed first, so that no detail is finer than the cells. Every cell that the surface crosses gets a vertex,
and every grid edge that the surface crosses gets a quadrilateral. Vertices are then moved onto the zero set along the field's
gradient, which is also the normal.

One unit is the height of the statue. +y is up, and the statue stands on y = 0. Requires numpy, which the environment of the
checks has. (numpy 2.4.6 made the shipped file.)

    .venv/bin/python tools/make_statue.py [folder]      (default: scenes/sss_statue of this repository)
"""

import sys
from pathlib import Path

import numpy as np
from make_scene_meshes import write_ply

# Edge length of a cell, and the box that contains the statue.
CELL = 0.0195
LOW, HIGH = np.array([-0.56, -0.04, -0.56]), np.array([0.56, 1.42, 0.56])


def smooth_min(a, b, k):
    """Return the smaller of two distances, blended where they differ by less than k."""
    h = np.maximum(k - np.abs(a - b), 0.0) / k
    return np.minimum(a, b) - h * h * k * 0.25


def tube(p, joints):
    """Return the distance to a chain of joints (x, y, z, radius) with interpolated radius (nearly Euclidean)."""
    best = None
    for (*a, ra), (*b, rb) in zip(joints, joints[1:]):
        a, b = np.array(a), np.array(b)
        along = b - a
        t = np.clip((p - a) @ along / (along @ along), 0.0, 1.0)
        d = np.linalg.norm(p - a - t[:, None] * along, axis=1) - (ra + t * (rb - ra))
        best = d if best is None else smooth_min(best, d, 0.5 * min(ra, rb) + 1e-3)
    return best


def sheet(p, a, b, c, thickness):
    """Return the distance to a triangle of the given thickness."""
    a, b, c = (np.array(v) for v in (a, b, c))
    n = np.cross(b - a, c - a)
    inside = np.ones(len(p), bool)
    edge = np.full(len(p), np.inf)
    for u, v in ((a, b), (b, c), (c, a)):
        along = v - u
        inside &= (p - u) @ np.cross(along, n) <= 0.0
        t = np.clip((p - u) @ along / (along @ along), 0.0, 1.0)
        edge = np.minimum(edge, np.linalg.norm(p - u - t[:, None] * along, axis=1))
    plane = np.abs((p - a) @ n) / np.linalg.norm(n)
    return np.where(inside, plane, edge) - 0.5 * thickness


def spline(joints, steps):
    """Return a Catmull–Rom curve through joints."""
    joints = np.array(joints, float)
    ends = np.vstack([2 * joints[0] - joints[1], joints, 2 * joints[-1] - joints[-2]])
    out = []
    for k in range(len(joints) - 1):
        p0, p1, p2, p3 = ends[k : k + 4]
        for t in np.arange(steps) / steps:
            square, cube = 2 * p0 - 5 * p1 + 4 * p2 - p3, 3 * p1 - p0 - 3 * p2 + p3
            out.append(0.5 * (2 * p1 + (p2 - p0) * t + square * t**2 + cube * t**3))
    return [*map(tuple, out), tuple(joints[-1])]


SPINE = [
    (0.0, 0.27, -0.16, 0.165), (0.0, 0.40, -0.05, 0.190), (0.0, 0.56, 0.05, 0.170), (0.0, 0.71, 0.06, 0.120),
    (0.0, 0.85, 0.00, 0.090), (0.0, 0.98, 0.01, 0.080), (0.0, 1.06, 0.09, 0.085),
]  # fmt: skip
TAIL = [
    (0.0, 0.24, -0.26, 0.120), (-0.20, 0.19, -0.36, 0.085), (-0.37, 0.175, -0.20, 0.070), (-0.41, 0.17, 0.04, 0.058),
    (-0.32, 0.165, 0.28, 0.046), (-0.12, 0.16, 0.40, 0.034), (0.10, 0.17, 0.42, 0.022),
]  # fmt: skip

# One side, x to the right; the other side is its mirror image.
HEAD = [
    ((0.0, 1.07, 0.10, 0.092), (0.0, 1.045, 0.20, 0.072), (0.0, 1.015, 0.31, 0.052)),
    ((0.0, 1.00, 0.13, 0.050), (0.0, 0.955, 0.20, 0.038), (0.0, 0.945, 0.27, 0.028)),
    ((0.035, 1.130, 0.10, 0.030), (0.050, 1.125, 0.17, 0.026), (0.045, 1.090, 0.22, 0.020)),
    ((0.055, 1.09, 0.18, 0.030), (0.058, 1.09, 0.182, 0.030)),
    ((0.030, 1.045, 0.335, 0.020), (0.026, 1.030, 0.345, 0.020)),
]
HORN = [
    (0.050, 1.13, 0.06, 0.036), (0.095, 1.22, -0.03, 0.030), (0.115, 1.31, -0.09, 0.022), (0.100, 1.38, -0.06, 0.011),
]  # fmt: skip
EAR = [(0.085, 1.08, 0.05, 0.028), (0.150, 1.12, -0.01, 0.024), (0.190, 1.15, -0.07, 0.009)]
FORELEG = [
    (0.12, 0.58, 0.08, 0.085), (0.165, 0.42, 0.12, 0.065), (0.150, 0.27, 0.20, 0.050), (0.150, 0.165, 0.235, 0.050),
]  # fmt: skip
THIGH = [(0.12, 0.30, -0.14, 0.130), (0.22, 0.28, -0.02, 0.115), (0.26, 0.24, 0.05, 0.080)]
SHIN = [(0.26, 0.24, 0.05, 0.075), (0.25, 0.17, 0.02, 0.050), (0.27, 0.155, 0.14, 0.045)]
SHOULDER, WRIST = (0.10, 0.66, -0.04), (0.27, 1.02, -0.20)
FINGERS = [(0.47, 0.78, -0.10), (0.46, 0.56, -0.28), (0.31, 0.44, -0.37), (0.10, 0.46, -0.22)]


def claws(x, y, z):
    """Return three toes in front of a paw."""
    joints = [(1.0, 0.0, 0.0, 0.030), (1.6, -0.012, 0.055, 0.026), (2.0, -0.02, 0.095, 0.010)]
    return [[(x + a * s, y + b, z + c, r) for a, b, c, r in joints] for s in (-0.032, 0.0, 0.032)]


def spikes(p):
    """Return the distance to a row of spikes along the back, the neck and the tail."""
    chain = np.array(spline(SPINE, 4)[:1:-1] + spline(TAIL, 3)[1:])
    best = np.full(len(p), np.inf)
    for k in range(1, len(chain) - 2):
        *at, radius = chain[k]
        along = chain[k + 1, :3] - chain[k - 1, :3]
        along /= np.linalg.norm(along)
        # Backward and up, perpendicular to the chain.
        out = np.array([0.0, 0.35, -1.0]) if k < 22 else np.array([0.0, 1.0, 0.0])
        out -= (out @ along) * along
        out /= np.linalg.norm(out)
        at, tall = np.array(at), 0.045 + 0.42 * radius
        root, tip = at + 0.85 * radius * out, at + (radius + tall) * out + 0.35 * tall * along
        best = np.minimum(best, tube(p, [(*root, 0.34 * tall + 0.010), (*tip, 0.015)]))
    return best


def plinth(p):
    """Return the distance to a round base with a fluted side and a moulded edge."""
    r, y = np.hypot(p[:, 0], p[:, 2]), p[:, 1]
    flutes = np.cos(32 * np.arctan2(p[:, 2], p[:, 0])) * np.clip(1.0 - (np.abs(y - 0.055) / 0.03) ** 4, 0.0, 1.0)
    radius = 0.485 + 0.014 * flutes
    q = np.stack([r - radius + 0.02, np.abs(y - 0.055) - 0.035], axis=1)
    body = np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0) - 0.02
    mould = np.hypot(r - 0.485, y - 0.105) - 0.022
    return smooth_min(body, mould, 0.02)


def dragon(p):
    """Return the approximate signed distance to the statue at points p (n × 3)."""
    side = p * np.array([np.nan, 1.0, 1.0])
    side[:, 0] = np.abs(p[:, 0])
    body = tube(p, spline(SPINE, 4))
    body = smooth_min(body, tube(p, spline(TAIL, 3)), 0.06)
    limbs = smooth_min(tube(side, FORELEG), tube(side, THIGH), 0.03)
    limbs = smooth_min(limbs, tube(side, SHIN), 0.03)
    body = smooth_min(body, limbs, 0.05)
    # Scales: bumps in rows, fewer on the belly.
    x, y, z = p.T
    bump = np.sin(42 * y + 14 * z) * np.sin(36 * np.arctan2(x, z + 0.25) * 0.5) * np.clip(0.6 - 2.5 * z, 0.15, 1.0)
    body = body - 0.010 * bump
    # Plates across the belly and the throat.
    front = np.clip((z - 0.13) / 0.05, 0.0, 1.0) * np.clip(1.0 - np.abs(x) / 0.11, 0.0, 1.0) * (y < 0.95)
    body = body - 0.015 * front * np.sin(62 * y)
    for n, part in enumerate(HEAD):
        body = smooth_min(body, tube(side, part), 0.012 if n > 2 else 0.03)
    for part, k in ((spline(HORN, 3), 0.02), (spline(EAR, 3), 0.03)):
        # Rings around the horns.
        d = tube(side, part)
        body = smooth_min(body, d - 0.006 * np.sin(105 * y) if k == 0.02 else d, k)
    for toes in (claws(0.150, 0.150, 0.265), claws(0.270, 0.145, 0.165)):
        for toe in toes:
            body = smooth_min(body, tube(side, toe), 0.015)
    body = smooth_min(body, spikes(p), 0.02)
    tip = TAIL[-1]
    for dx, dz in ((0.10, 0.055), (0.10, -0.055), (0.17, 0.0)):
        end = (tip[0] + dx, tip[1] + 0.03, tip[2] - 0.04 + dz)
        body = smooth_min(body, sheet(p, tip[:3], end, (tip[0] + 0.09, tip[1] + 0.03, tip[2] - 0.04), 0.035), 0.03)
    wing = tube(side, [(*SHOULDER, 0.055), (0.21, 0.86, -0.16, 0.038), (*WRIST, 0.030)])
    for finger in FINGERS[:3]:
        mid = 0.5 * (np.array(WRIST) + np.array(finger)) + np.array([0.02, 0.03, -0.02])
        wing = smooth_min(wing, tube(side, [(*WRIST, 0.028), (*mid, 0.023), (*finger, 0.016)]), 0.02)
        wing = smooth_min(wing, tube(side, [(*mid, 0.02), (*finger, 0.014)]), 0.02)
    for a, b in zip(FINGERS, FINGERS[1:]):
        # The free edge of the wing's skin curves inward between fingers.
        inner = 0.5 * (np.array(a) + np.array(b)) * 0.80 + 0.20 * np.array(WRIST)
        skin = np.minimum(sheet(side, WRIST, a, inner, 0.040), sheet(side, WRIST, inner, b, 0.040))
        wing = smooth_min(wing, skin, 0.02)
    wing = smooth_min(wing, sheet(side, SHOULDER, WRIST, FINGERS[3], 0.040), 0.03)
    body = smooth_min(body, wing, 0.035)
    return smooth_min(body, plinth(p), 0.03)


def unambiguous(field):
    """Fill narrow gaps, so that no square of four grid points has only two opposite corners inside.

    At such a square the surface would touch itself: four faces would share an edge.
    """
    field = field.copy()
    while True:
        inside = field < 0.0
        fill = np.zeros_like(inside)
        for u, v in ((0, 1), (1, 2), (2, 0)):
            whole, first, last = slice(None), slice(None, -1), slice(1, None)
            part = lambda a, i, j: a[tuple(i if k == u else j if k == v else whole for k in range(3))]  # noqa: E731
            ends = [(first, first), (last, first), (last, last), (first, last)]
            a, b, c, d = (part(inside, *end) for end in ends)
            crossed = (a == c) & (b == d) & (a != b)
            for end in ends:
                part(fill, *end)[...] |= crossed
        fill &= ~inside
        if not fill.any():
            return field
        field[fill] = -0.1


def surface_net(field):
    """Return (vertices in cells, quadrilaterals) of the zero set of values on a grid, which are positive outside."""
    inside = field < 0.0
    corners = [(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    shape = tuple(n - 1 for n in field.shape)
    cut = lambda a, c: a[c[0] : c[0] + shape[0], c[1] : c[1] + shape[1], c[2] : c[2] + shape[2]]  # noqa: E731
    count = sum(cut(inside, c).astype(int) for c in corners)
    cells = np.argwhere((count > 0) & (count < 8))
    number = np.full(shape, -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    # A cell's vertex is the mean of the points where the surface crosses its twelve edges.
    total, weight = np.zeros((len(cells), 3)), np.zeros(len(cells))
    at = lambda c: field[tuple((cells + np.array(c)).T)]  # noqa: E731
    for a in corners:
        for axis in range(3):
            if a[axis]:
                continue
            b = tuple(x + (n == axis) for n, x in enumerate(a))
            fa, fb = at(a), at(b)
            crossed = (fa < 0.0) != (fb < 0.0)
            t = np.where(crossed, fa / np.where(crossed, fa - fb, 1.0), 0.0)
            point = np.array(a) + t[:, None] * (np.array(b) - np.array(a))
            total += point * crossed[:, None]
            weight += crossed
    vertices = cells + total / weight[:, None]
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        step = np.eye(3, dtype=int)
        near = np.argwhere(np.diff(inside.astype(int), axis=axis) != 0)
        near = near[(near[:, u] > 0) & (near[:, v] > 0)]
        ring = [number[tuple((near - d).T)] for d in (step[u] + step[v], step[v], 0 * step[u], step[u])]
        quads = np.stack(ring, axis=1)
        flip = ~inside[tuple(near.T)]
        quads[flip] = quads[flip][:, ::-1]
        faces.append(quads)
    return vertices, np.vstack(faces)


def blurred(field):
    """Remove detail finer than the grid cells with a narrow filter along each axis."""
    for axis in range(3):
        padded = np.pad(field, [(1, 1) if k == axis else (0, 0) for k in range(3)], mode="edge")
        part = lambda i: np.take(padded, np.arange(i, i + field.shape[axis]), axis)  # noqa: B023, E731
        field = 0.125 * part(0) + 0.75 * part(1) + 0.125 * part(2)
    return field


def sample(field, p):
    """Interpolate a grid trilinearly at p, in cells."""
    whole = np.clip(np.floor(p).astype(int), 0, np.array(field.shape[:3]) - 2)
    t = p - whole
    out = 0.0
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, t, 1.0 - t), axis=1)
        value = field[tuple((whole + corner).T)]
        out = out + (weight if value.ndim == 1 else weight[:, None]) * value
    return out


def unfolded(vertices, normals, triangles):
    """Return vertices and normals with folds of the surface removed. Folds occur in narrow gaps, where the field's gradient is
    too coarse.

    There a vertex moves to the mean of its triangles' centres and receives the mean of their normals.
    """
    ends = triangles.ravel()
    for _ in range(30):
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        fronts = np.cross(b - a, c - a)
        means, centres = np.zeros_like(vertices), np.zeros_like(vertices)
        np.add.at(means, ends, np.repeat(fronts, 3, axis=0))
        np.add.at(centres, ends, np.repeat((a + b + c) / 3, 3, axis=0))
        means /= np.linalg.norm(means, axis=1)[:, None]
        normals = np.where(((normals * means).sum(axis=1) < 0.8)[:, None], means, normals)
        fronts /= np.linalg.norm(fronts, axis=1)[:, None]
        bad = np.unique(triangles[(fronts[:, None] * normals[triangles]).sum(axis=2).min(axis=1) < 0.25])
        if len(bad) == 0:
            break
        vertices = vertices.copy()
        vertices[bad] = centres[bad] / np.bincount(ends, minlength=len(vertices))[bad, None]
    return vertices, normals


def check_closed(faces):
    """Check that every edge joins two faces that traverse it in opposite directions."""
    edges = np.concatenate([faces[:, [a, (a + 1) % faces.shape[1]]] for a in range(faces.shape[1])])
    keys = edges[:, 0] * (1 << 32) + edges[:, 1]
    back = edges[:, 1] * (1 << 32) + edges[:, 0]
    if len(np.unique(keys)) != len(keys) or not np.array_equal(np.sort(keys), np.sort(back)):
        raise SystemExit("the surface is not closed; change CELL slightly")


def surface(distance, low, high, cell):
    """Return (vertices, normals, triangles) of the zero set of a signed distance in a box, on a grid of the given cell size."""
    axes = [np.arange(a, b, cell) for a, b in zip(low, high)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    field = np.concatenate([distance(slab) for slab in grid.reshape(len(axes[0]), -1, 3)]).reshape(grid.shape[:3])
    field = unambiguous(blurred(field / cell))
    vertices, quads = surface_net(field)
    slopes = np.stack(np.gradient(field), axis=-1)
    for _ in range(4):
        g = sample(slopes, vertices)
        move = np.clip(sample(field, vertices) / (g * g).sum(axis=1), -0.2, 0.2)
        vertices = vertices - move[:, None] * g
    normals = sample(slopes, vertices)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    vertices = low + cell * vertices
    # The shorter diagonal splits a quadrilateral.
    a, b, c, d = (vertices[quads[:, k]] for k in range(4))
    straight = np.linalg.norm(a - c, axis=1) <= np.linalg.norm(b - d, axis=1)
    halves = (([0, 1, 2], [0, 1, 3]), ([0, 2, 3], [1, 2, 3]))
    pairs = [np.where(straight[:, None], quads[:, one], quads[:, two]) for one, two in halves]
    triangles = np.vstack(pairs)
    check_closed(triangles)
    return *unfolded(vertices, normals, triangles), triangles


def main():
    default = Path(__file__).resolve().parent.parent / "scenes" / "sss_statue"
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    folder.mkdir(parents=True, exist_ok=True)
    vertices, normals, triangles = surface(dragon, LOW, HIGH, CELL)
    # Place on y = 0 and scale to unit height.
    vertices[:, 1] -= vertices[:, 1].min()
    vertices /= vertices[:, 1].max()
    write_ply(folder / "dragon.ply", vertices.tolist(), triangles.tolist(), normals.tolist())
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    print(f"{len(vertices)} vertices, {len(triangles)} triangles, from {low.round(3)} to {high.round(3)}")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Write the lion of scenes/statue_mirror and the doll of scenes/painted_doll: closed smooth surfaces, with painted images.

Each figurine is the zero set of a signed distance that joins named parts by a smooth minimum (tools/make_statue.py). Every triangle
belongs to the part that is nearest to its centre. Each part has a tile of the images, and the front view (x, y) of the part fills
its tile, so that a tile is drawn in the figurine's units. One image is the paint and one is the weight of the metal leaf.

A figurine is about one unit high, stands on y = 0 and faces +z. Requires numpy, which the environment of the checks has.
(numpy 2.4.6 made the shipped files.)

    .venv/bin/python tools/make_figurines.py [folder]      (default: scenes/ of this repository)
"""

import sys
from pathlib import Path

import numpy as np
from make_scene_meshes import write_ply, write_png
from make_statue import smooth_min, spline, surface, tube

# A tile shows the square of this edge length around x = 0, from y = 0 upward, with this number of pixels per side. The centres
# of its outermost pixels lie on the square's edge, so that interpolation does not mix tiles.
TILE_EDGE, TILE_PIXELS = 1.2, 384


def ball(p, centre, radii):
    """Return the approximate distance to an ellipsoid."""
    q = (p - np.array(centre)) / np.array(radii)
    r = np.linalg.norm(q, axis=1)
    slope = np.linalg.norm(q / np.array(radii), axis=1)
    return np.where(slope > 1e-6, r * (r - 1.0) / np.maximum(slope, 1e-6), -min(radii))


def block(p, centre, half, rounding):
    """Return the distance to a box with rounded edges."""
    q = np.abs(p - np.array(centre)) - np.array(half) + rounding
    return np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0) - rounding


def mirrored(p):
    """Return points with x made positive: a part of one side stands for both."""
    return p * np.array([0.0, 1.0, 1.0]) + np.abs(p) * np.array([1.0, 0.0, 0.0])


def joined(distances, k):
    """Return the smooth minimum of a list of distances."""
    out = distances[0]
    for d in distances[1:]:
        out = smooth_min(out, d, k)
    return out


# --- lion -------------------------------------------------------------------------------------------------------------

HEAD = np.array([0.0, 0.795, 0.20])


def lock(root, tip, width, bend):
    """Return the joints of a tapered lock of hair from root to tip, bent sideways by a fraction of its length."""
    root, tip = np.array(root), np.array(tip)
    side = np.cross(tip - root, [0.0, 0.0, 1.0])
    middle = 0.5 * (root + tip) + bend * side
    return spline([(*root, width), (*middle, 0.85 * width), (*tip, 0.25 * width)], 2)


def mane(p):
    """Return the distance to the mane: three wreaths of locks around the face, and locks on the chest and the back."""
    parts = [ball(p, (0.0, 0.76, 0.045), (0.215, 0.235, 0.155)), ball(p, (0.0, 0.56, 0.12), (0.16, 0.18, 0.14))]
    locks = []
    for count, inner, outer, near, far, width, bend, start in (
        (17, 0.120, 0.205, 0.235, 0.190, 0.032, 0.16, 0.0),
        (19, 0.165, 0.285, 0.165, 0.090, 0.040, -0.18, 0.5),
        (17, 0.190, 0.315, 0.060, -0.060, 0.046, 0.20, 0.0),
    ):
        for k in range(count):
            a = 2 * np.pi * (k + start) / count
            out = np.array([np.sin(a), np.cos(a), 0.0])
            # Locks below the face hang down and are longer.
            drop = np.array([0.0, -0.10 * max(0.0, 0.3 - np.cos(a)), 0.0])
            middle = np.array([HEAD[0], HEAD[1] - 0.015, 0.0])
            root = middle + inner * out + np.array([0.0, 0.0, near])
            locks.append(lock(root, middle + outer * out + drop + np.array([0.0, 0.0, far]), width, bend))
    for row, (y, z, count) in enumerate(((0.62, 0.235, 4), (0.55, 0.240, 5), (0.47, 0.225, 4))):
        for k in range(count):
            x = 0.062 * (k - 0.5 * (count - 1))
            locks.append(lock((x, y, z - 2.5 * x * x), (1.1 * x, y - 0.125, z - 0.015 - 3.0 * x * x), 0.036, 0.15 * (-1) ** (k + row)))
    for y, z, count in ((0.80, -0.10, 5), (0.66, -0.11, 5)):
        for k in range(count):
            x = 0.075 * (k - 0.5 * (count - 1))
            locks.append(lock((x, y, z + 1.5 * x * x), (1.15 * x, y - 0.17, z - 0.015 + 1.5 * x * x), 0.042, 0.15 * (-1) ** k))
    hair = np.full(len(p), np.inf)
    for joints in locks:
        hair = smooth_min(hair, tube(p, joints), 0.024)
    return smooth_min(joined(parts, 0.06), hair, 0.02)


def lion(p):
    """Return the distances to the parts of a seated lion on a plinth."""
    side = mirrored(p)
    torso = tube(p, [(0.0, 0.30, -0.19, 0.185), (0.0, 0.42, -0.06, 0.185), (0.0, 0.54, 0.05, 0.180), (0.0, 0.68, 0.08, 0.15)])
    haunch = ball(side, (0.155, 0.265, -0.135), (0.105, 0.165, 0.175))
    shin = tube(side, [(0.185, 0.20, 0.00, 0.070), (0.19, 0.155, 0.06, 0.052), (0.19, 0.145, 0.14, 0.050)])
    foreleg = tube(side, [(0.115, 0.52, 0.10, 0.095), (0.115, 0.34, 0.185, 0.064), (0.115, 0.20, 0.205, 0.052), (0.115, 0.15, 0.225, 0.056)])
    body = joined([torso, haunch, shin, foreleg], 0.05)
    for x, z, scale in ((0.115, 0.265, 1.0), (0.19, 0.165, 0.9)):
        for dx, dz in ((-0.036, 0.0), (0.0, 0.012), (0.036, 0.0)):
            toe = [(x + scale * dx, 0.135, z + dz, 0.034 * scale), (x + 1.15 * scale * dx, 0.125, z + dz + 0.035, 0.026 * scale)]
            body = smooth_min(body, tube(side, toe), 0.012)
    tail = tube(p, spline([(0.0, 0.20, -0.33, 0.050), (0.16, 0.15, -0.36, 0.036), (0.28, 0.145, -0.22, 0.030), (0.295, 0.145, -0.04, 0.028)], 4))
    tuft = tube(p, [(0.295, 0.145, -0.03, 0.030), (0.295, 0.15, 0.05, 0.050), (0.285, 0.145, 0.15, 0.012)])
    tuft = tuft - 0.006 * np.sin(4.0 * np.arctan2(p[:, 1] - 0.15, p[:, 0] - 0.295) + 30.0 * p[:, 2])
    body = smooth_min(body, tail, 0.03)

    skull = ball(p, HEAD, (0.118, 0.128, 0.115))
    bridge = tube(p, [(0.0, 0.855, 0.265, 0.052), (0.0, 0.815, 0.335, 0.044), (0.0, 0.795, 0.375, 0.040)])
    muzzle = tube(side, [(0.030, 0.765, 0.335, 0.058), (0.034, 0.758, 0.365, 0.050)])
    chin = tube(p, [(0.0, 0.705, 0.275, 0.050), (0.0, 0.695, 0.335, 0.036)])
    cheek = ball(side, (0.085, 0.765, 0.255), (0.052, 0.060, 0.055))
    face = joined([skull, bridge, muzzle, chin, cheek], 0.022)
    # The brow stands out, and eye sockets, the mouth and the line below the nose are cut in.
    face = smooth_min(face, tube(side, [(0.028, 0.880, 0.300, 0.022), (0.062, 0.888, 0.288, 0.024), (0.098, 0.862, 0.255, 0.018)]), 0.02)
    for cut in (
        tube(side, [(0.044, 0.838, 0.325, 0.022), (0.086, 0.838, 0.305, 0.018)]),
        tube(side, [(0.0, 0.722, 0.40, 0.011), (0.045, 0.712, 0.375, 0.011), (0.078, 0.722, 0.325, 0.010)]),
        tube(p, [(0.0, 0.722, 0.415, 0.008), (0.0, 0.775, 0.425, 0.008)]),
    ):
        face = -smooth_min(-face, cut, 0.012)
    ear = -smooth_min(-ball(side, (0.118, 0.925, 0.165), (0.048, 0.052, 0.034)), ball(side, (0.122, 0.925, 0.196), (0.028, 0.032, 0.026)), 0.01)
    face = smooth_min(face, ear, 0.02)

    step = block(p, (0.0, 0.028, -0.03), (0.36, 0.028, 0.40), 0.012)
    base = smooth_min(block(p, (0.0, 0.07, -0.03), (0.335, 0.045, 0.375), 0.012), step, 0.01)
    return {
        "plinth": base,
        "body": body,
        "mane": mane(p),
        "face": face,
        "eyes": ball(side, (0.064, 0.842, 0.296), (0.024, 0.021, 0.020)),
        "nose": joined([ball(p, (0.0, 0.800, 0.408), (0.036, 0.024, 0.020)), ball(p, (0.0, 0.785, 0.412), (0.018, 0.020, 0.016))], 0.01),
        "tuft": tuft,
    }


LION_PAINT = {
    "plinth": (60, 84, 70), "body": (196, 148, 84), "mane": (120, 66, 34), "face": (206, 162, 100), "eyes": (24, 20, 18),
    "nose": (52, 34, 30), "tuft": (120, 66, 34),
}  # fmt: skip


def lion_paint(part, x, y):
    """Return (colour, weight of the leaf) at the point (x, y) of the front view of a part: the mane and the plinth's edge are gilt."""
    gilt = part in ("mane", "tuft") or (part == "plinth" and y > 0.068)
    return LION_PAINT[part], 255 if gilt else 0


# --- doll -------------------------------------------------------------------------------------------------------------


def doll(p):
    """Return the distances to the parts of a girl in a pleated dress, with plaits and a bow."""
    side = mirrored(p)
    x, y, z = p.T
    # Skirt and bodice: a surface of revolution, flattened from front to back, with pleats that end at the waist.
    r, around = np.hypot(x, 1.25 * z), np.arctan2(1.25 * z, x)
    ys = [0.20, 0.26, 0.34, 0.42, 0.49, 0.535, 0.58, 0.64, 0.69, 0.72]
    rs = [0.315, 0.305, 0.270, 0.222, 0.165, 0.132, 0.138, 0.150, 0.125, 0.060]
    fold = 0.022 * np.clip((0.52 - y) / 0.3, 0.0, 1.0) * np.cos(14 * around)
    q = np.stack([(r - np.interp(y, ys, rs) - fold) * 0.8, np.abs(y - 0.455) - 0.245], axis=1) + 0.012
    dress = np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0) - 0.012
    head = joined(
        [ball(p, (0.0, 0.87, 0.0), (0.160, 0.165, 0.155)), ball(p, (0.0, 0.848, 0.155), (0.020, 0.020, 0.022)), tube(p, [(0.0, 0.70, 0.0, 0.055), (0.0, 0.76, 0.0, 0.055)])],
        0.02,
    )
    crown = ball(p, (0.0, 0.895, -0.030), (0.182, 0.178, 0.172)) - 0.005 * np.sin(70 * np.abs(x) + 25 * y)
    plait = spline([(0.165, 0.87, -0.03, 0.050), (0.225, 0.80, 0.01, 0.046), (0.225, 0.70, 0.05, 0.040), (0.205, 0.62, 0.075, 0.024)], 4)
    plait = tube(side, plait) - 0.008 * np.sin(95 * y)
    bow = joined([tube(side, [(0.0, 1.065, -0.01, 0.030), (0.055, 1.080, -0.01, 0.026), (0.105, 1.090, -0.01, 0.040)])], 0.01)
    tie = ball(side, (0.208, 0.640, 0.073), (0.036, 0.020, 0.036))
    collar = tube(side, [(0.0, 0.715, 0.075, 0.026), (0.05, 0.725, 0.055, 0.028), (0.082, 0.735, 0.0, 0.026), (0.05, 0.735, -0.055, 0.026), (0.0, 0.735, -0.075, 0.026)])
    belt = np.hypot(r - 0.132, y - 0.535) - 0.021
    return {
        "shoes": joined([tube(side, [(0.085, 0.045, -0.035, 0.045), (0.090, 0.042, 0.075, 0.046)])], 0.01),
        "legs": tube(side, [(0.085, 0.07, -0.01, 0.046), (0.085, 0.16, -0.01, 0.056), (0.085, 0.26, -0.01, 0.052)]),
        "dress": dress,
        "sleeves": joined([ball(side, (0.165, 0.655, 0.0), (0.075, 0.070, 0.070)), tube(side, [(0.10, 0.68, 0.0, 0.05), (0.16, 0.66, 0.0, 0.06)])], 0.02),
        "arms": joined([tube(side, [(0.19, 0.62, 0.0, 0.044), (0.275, 0.53, 0.02, 0.040), (0.315, 0.445, 0.065, 0.034)]), ball(side, (0.325, 0.420, 0.080), (0.040, 0.046, 0.040))], 0.03),
        "head": head,
        "hair": smooth_min(crown, plait, 0.02),
        "bow": smooth_min(bow, tie, 0.001),
        "collar": smooth_min(collar, belt, 0.001),
    }


RED, CREAM, BLUE, BLACK, SKIN, BROWN, WHITE = (
    (190, 40, 36), (236, 214, 180), (48, 76, 150), (30, 26, 26), (238, 190, 156), (106, 62, 30), (240, 238, 232),
)  # fmt: skip


def doll_paint(part, x, y):
    """Return (colour, weight of the leaf) at the point (x, y) of the front view of a part."""
    plain = {"shoes": BLACK, "sleeves": CREAM, "arms": SKIN, "hair": BROWN}
    if part in plain:
        return plain[part], 0
    if part in ("bow", "collar"):
        return RED, 255
    if part == "legs":
        return (WHITE if (y * 36) % 2.0 < 1.0 else BLUE), 0
    if part == "head":
        u, v = abs(x), y - 0.87
        if np.hypot(u - 0.058, (v - 0.012) * 0.8) < 0.026:
            if np.hypot(u - 0.058, v - 0.010) < 0.009:
                return BLACK, 0
            return (BLUE if np.hypot(u - 0.058, v - 0.010) < 0.017 else WHITE), 0
        if abs(v - 0.055 + 4.0 * (u - 0.058) ** 2) < 0.005 and abs(u - 0.058) < 0.032:
            return BROWN, 0
        if abs(v + 0.072 - 9.0 * u * u) < 0.008 and u < 0.040:
            return RED, 0
        return ((232, 140, 118) if np.hypot(u - 0.090, v + 0.045) < 0.026 else SKIN), 0
    # The dress: a gilt hem, gilt flowers on the skirt, buttons, and a white apron.
    if y < 0.258:
        return RED, 255
    if y > 0.53:
        return (RED, 255) if abs(x) < 0.018 and abs((y * 14.0) % 1.0 - 0.5) < 0.22 else (RED, 0)
    flowers = ((0.0, 0.375, 0.078), (-0.175, 0.335, 0.050), (0.175, 0.335, 0.050))
    for cx, cy, size in flowers:
        d, a = np.hypot(x - cx, y - cy), np.arctan2(y - cy, x - cx)
        if d < 0.30 * size:
            return WHITE, 0
        if d < size * (0.72 + 0.28 * np.cos(6 * a)):
            return RED, 255
    if abs(x) < 0.095 + 0.12 * (0.53 - y) and y > 0.285:
        return (BLUE if y < 0.297 else WHITE), 0
    return RED, 0


# --- files ------------------------------------------------------------------------------------------------------------


def write_figurine(folder, name, parts, paint, box, cell):
    """Write a mesh with texture coordinates, NAME.ply, and its images, NAME.png and leaf.png."""
    folder.mkdir(parents=True, exist_ok=True)
    whole = lambda p: joined(list(parts(p).values()), 0.012)  # noqa: E731
    vertices, normals, triangles = surface(whole, *map(np.array, box), cell)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    if not np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 1e-9:
        raise SystemExit(f"{name}: a triangle has no area; change the size of the cells slightly")
    names = list(parts(vertices[:1]))
    centres = vertices[triangles].mean(axis=1)
    owner = np.argmin(np.stack(list(parts(centres).values())), axis=0)
    # A vertex that several parts share is stored once for each.
    corners = np.stack([triangles.ravel(), np.repeat(owner, 3)], axis=1)
    kinds, which = np.unique(corners, axis=0, return_inverse=True)
    at, tile = vertices[kinds[:, 0]], kinds[:, 1]
    inside = np.clip(np.stack([at[:, 0] / TILE_EDGE + 0.5, at[:, 1] / TILE_EDGE], axis=1), 0.0, 1.0)
    inside = (0.5 + (TILE_PIXELS - 1) * inside) / TILE_PIXELS
    uvs = np.stack([(tile + inside[:, 0]) / len(names), inside[:, 1]], axis=1)
    at = at - np.array([0.0, vertices[:, 1].min(), 0.0])
    write_ply(folder / f"{name}.ply", at.tolist(), which.reshape(-1, 3).tolist(), normals[kinds[:, 0]].tolist(), uvs.tolist())
    places = [k * TILE_EDGE / (TILE_PIXELS - 1) for k in range(TILE_PIXELS)]
    rows = [[paint(part, x - 0.5 * TILE_EDGE, y) for part in names for x in places] for y in reversed(places)]
    write_png(folder / f"{name}.png", [[colour for colour, _ in row] for row in rows])
    write_png(folder / "leaf.png", [[(leaf, leaf, leaf) for _, leaf in row] for row in rows])
    low, high = at.min(axis=0), at.max(axis=0)
    print(f"{name}: {len(at)} vertices, {len(triangles)} triangles, from {low.round(3)} to {high.round(3)}")


def main():
    default = Path(__file__).resolve().parent.parent / "scenes"
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    write_figurine(root / "statue_mirror", "lion", lion, lion_paint, ((-0.42, -0.05, -0.50), (0.42, 1.18, 0.52)), 0.0138)
    write_figurine(root / "painted_doll", "doll", doll, doll_paint, ((-0.44, -0.05, -0.35), (0.44, 1.22, 0.35)), 0.0135)


if __name__ == "__main__":
    main()

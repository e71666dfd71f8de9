"""Polarized light by Mitsuba's own means: a polarizer before the lamp, against the columns of our matrix.

A sheet between the point light and all else makes its light completely polarized. Mitsuba's `volpath` connects
surfaces to lights through such sheets (its `path` does not). A linear polarizer absorbs along an axis a, projected
perpendicular to the ray (Korger et al. 2013), and passes (1, -1, 0, 0)/2 in the frame whose horizontal is a: we state
that frame for the light, and the image is (T0 - T1)/2, T0 and T1 being columns of T. The `circular` polarizer passes
(1, 0, 0, ±1)/2 in every frame: (T0 ± T3)/2. Ours is the same scene without the sheet.

The error of such sums is not that of their terms, for a path brings to all of them: it comes from renders of many
seeds.
"""

import numpy as np

import comparison
import exported
import frames
import programs
from pairs import Pair

BATCHES = 32
BLOCK = 2
FILE = exported.HERE / "polarized.toml"
LAMP, AIM = np.array([0.5, 2.2, 2.5]), np.array([0.0, -0.3, 0.0])
# The light's way, and two directions across it.
WAY = (AIM - LAMP) / np.linalg.norm(AIM - LAMP)
SIDE = np.cross(WAY, [0, 1, 0]) / np.linalg.norm(np.cross(WAY, [0, 1, 0]))
SLANT = (SIDE + np.cross(SIDE, WAY)) / np.sqrt(2)
LEFT = '<bsdf type="circular"><boolean name="left_handed" value="true"/></bsdf>'
# Name, sheet, the absorbed axis, what the lamp sends in the frame of that axis.
STATES = [
    ("linear", '<bsdf type="polarizer"/>', SIDE, [0.5, -0.5, 0, 0]),
    ("right circular", '<bsdf type="circular"/>', SIDE, [0.5, 0, 0, 0.5]),
    ("left circular", LEFT, SIDE, [0.5, 0, 0, -0.5]),
    ("slanted", '<bsdf type="polarizer"/>', SLANT, [0.5, -0.5, 0, 0]),
]


def sheet(bsdf, axis):
    """A square before the lamp whose v direction is the axis."""
    half, centre = 0.6, LAMP + 0.3 * WAY
    columns = [half * np.cross(axis, WAY), half * axis, WAY, centre]
    matrix = np.eye(4)
    matrix[:3] = np.stack(columns, axis=1)
    numbers = " ".join(f"{x:.9g}" for x in matrix.ravel())
    return f'<shape type="rectangle"><transform name="to_world"><matrix value="{numbers}"/></transform>{bsdf}</shape>'


def ours(toml, axis, seed, spp):
    """T of many seeds, [seed, y, x, out, in], with the lamp's horizontal along the axis; the scene is left in
    `toml`."""
    text = FILE.read_text()
    assert "horizontal = [1, 0, 0]" in text
    toml.write_text(text.replace("horizontal = [1, 0, 0]", f"horizontal = {[float(f'{x:.9g}') for x in axis]}"))
    images = [programs.render(toml, spp, seed * BATCHES + i)[0][0][0] for i in range(BATCHES)]
    return np.stack(images)


def run(seed, llvm, folder, full):
    """Yields a pair for each state of the light."""
    spp, our_spp = (n * (4 if full else 1) for n in ((128, 128) if llvm else (8, 64)))
    toml, axis, matrices = folder / "polarized.toml", None, None
    for name, bsdf, absorbed, state in STATES:
        if absorbed is not axis:
            axis, matrices = absorbed, ours(toml, absorbed, seed, our_spp)
        shade = f"{sheet(bsdf, axis)}</scene>"
        through = lambda xml: xml.replace('"path"', '"volpath"').replace("</scene>", shade)
        loaded = exported.export(toml, 550, through)
        theirs = programs.stokes(loaded, spp, seed, BATCHES)
        mean, error = comparison.mean_and_error(matrices @ state)
        # The mistake: the orthogonal state, as if the column had the wrong sign.
        wrong = matrices.mean(0) @ (np.array(state) * [1, -1, -1, -1])
        yield Pair("polarized lamp", name, [f"s{j}" for j in range(4)], mean, error, theirs,
                   frames.angles(loaded.sensors()[0]), BLOCK, BATCHES, {"column": wrong})

"""Compare polarized light, made by Mitsuba with a polarizer in front of the lamp, with the columns of Sunstone's matrix.

A sheet between the point light and the scene polarizes its light completely. Mitsuba's `volpath` connects surfaces to lights
through such sheets (its `path` does not). A linear polarizer absorbs along an axis a, projected perpendicular to the ray (Korger
et al. 2013), and transmits (1, -1, 0, 0)/2 in the frame whose horizontal is a. Sunstone uses that frame for the light, and the
image is (T0 - T1)/2, where T0 and T1 are columns of T. The `circular` polarizer transmits (1, 0, 0, ±1)/2 in every frame: (T0 ±
T3)/2. Sunstone renders the same scene without the sheet.

The standard errors of such sums cannot be computed from those of their terms, because each path contributes to all terms. They
come from renders with many seeds.
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
# Direction of the light, and two directions perpendicular to it.
WAY = (AIM - LAMP) / np.linalg.norm(AIM - LAMP)
SIDE = np.cross(WAY, [0, 1, 0]) / np.linalg.norm(np.cross(WAY, [0, 1, 0]))
SLANT = (SIDE + np.cross(SIDE, WAY)) / np.sqrt(2)
LEFT = '<bsdf type="circular"><boolean name="left_handed" value="true"/></bsdf>'
# Name, sheet, absorbed axis, and the light's Stokes vector in the frame of that axis.
STATES = [
    ("linear", '<bsdf type="polarizer"/>', SIDE, [0.5, -0.5, 0, 0]),
    ("right circular", '<bsdf type="circular"/>', SIDE, [0.5, 0, 0, 0.5]),
    ("left circular", LEFT, SIDE, [0.5, 0, 0, -0.5]),
    ("slanted", '<bsdf type="polarizer"/>', SLANT, [0.5, -0.5, 0, 0]),
]


def sheet(bsdf, axis):
    """Return a square in front of the lamp whose v direction is the axis."""
    half, centre = 0.6, LAMP + 0.3 * WAY
    columns = [half * np.cross(axis, WAY), half * axis, WAY, centre]
    matrix = np.eye(4)
    matrix[:3] = np.stack(columns, axis=1)
    numbers = " ".join(f"{x:.9g}" for x in matrix.ravel())
    return f'<shape type="rectangle"><transform name="to_world"><matrix value="{numbers}"/></transform>{bsdf}</shape>'


def ours(toml, axis, seed, spp):
    """Return T of many seeds, [seed, y, x, out, in], with the lamp's horizontal along the axis; the scene stays in `toml`."""
    text = FILE.read_text()
    assert "horizontal = [1, 0, 0]" in text
    toml.write_text(text.replace("horizontal = [1, 0, 0]", f"horizontal = {[float(f'{x:.9g}') for x in axis]}"))
    images = [programs.render(toml, spp, seed * BATCHES + i)[0][0][0] for i in range(BATCHES)]
    return np.stack(images)


def run(seed, llvm, folder, full):
    """Yield a pair for each state of the light."""
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
        # The wrong version: the orthogonal state, as if the column had the wrong sign.
        wrong = matrices.mean(0) @ (np.array(state) * [1, -1, -1, -1])
        yield Pair("polarized lamp", name, [f"s{j}" for j in range(4)], mean, error, theirs,
                   frames.angles(loaded.sensors()[0]), BLOCK, BATCHES, {"column": wrong})

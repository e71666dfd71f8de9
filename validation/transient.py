"""Compare time-resolved light: mitransient's per-bin Stokes vectors with Sunstone's slices.

Conversions: mitransient bins the optical path length in metres, Sunstone the travel time in picoseconds. mitransient counts the
distance from the near clipping plane, Sunstone from the pinhole (so the plane is as close to the pinhole as possible). Both
multiply the distance inside a medium by its index, and both assign a path of time t to bin floor((t - start) / width).
mitransient's Stokes frames are those of Mitsuba's `stokes`.

mitransient keeps Stokes vectors over time only in mono polarized variants. Light is unpolarized: the only integrator of
mitransient that could pass light through a polarizer, `transient_prbvolpath`, does not rotate Stokes frames at surfaces.
"""

import re

import mitsuba as mi
import numpy as np

import exported
import frames
from pairs import Pair

LIGHT_M_PER_PS = 299_792_458e-12
BATCHES = 32
BLOCK = 4


def translate(xml, time):
    """Return the XML of an exported scene, adapted for mitransient."""
    start, width, bins = time
    integrator = re.search(r'<integrator type="path">.*?</integrator>', xml, re.DOTALL)[0]
    integrator = integrator.replace('"path"', '"transient_path"')
    integrator = integrator.replace("</integrator>", '<string name="temporal_filter" value="box"/></integrator>')
    xml = re.sub(r'<integrator type="stokes">.*?</integrator>\s*</integrator>', integrator, xml, flags=re.DOTALL)
    film = (f'<film type="transient_hdr_film"><integer name="temporal_bins" value="{bins}"/>'
            f'<float name="start_opl" value="{start * LIGHT_M_PER_PS!r}"/>'
            f'<float name="bin_width_opl" value="{width * LIGHT_M_PER_PS!r}"/>')
    xml = xml.replace('<film type="hdrfilm">', film).replace('<string name="component_format" value="float32"/>', "")
    return xml.replace('name="near_clip" value="0.001"', 'name="near_clip" value="0.00001"')


def run(scene, toml, wavelength, ours, spp, seed):
    """Return the pair of a scene of exported.py; `ours` is mean and standard error of T, [y, x, t, out, in]."""
    # mitransient registers its integrators and films with the current variant, so its import must follow that choice.
    import mitransient  # noqa: F401

    loaded = exported.export(toml, wavelength, lambda xml: translate(xml, scene.time))
    images = [np.array(mi.render(loaded, spp=spp, seed=seed * BATCHES + i)[1]) for i in range(BATCHES)]
    theirs = np.stack(images)[..., :4]
    mean, error = (a[..., 0] for a in ours)
    return Pair(scene.name, "over time", [f"s{j}" for j in range(4)], mean, error, theirs,
                frames.angles(loaded.sensors()[0]), BLOCK)

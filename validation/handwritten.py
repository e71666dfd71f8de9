"""The scenes of scenes.py, written by hand for both programs and rendered by both."""

import mitsuba as mi
import numpy as np

import frames
import programs
import scenes
from pairs import Pair

BATCHES = 64
OUR_SPP = 4096
BLOCK = 4


def ours(scene, seed, folder):
    """Return mean and standard error of T, [y, x, (t,) out, in]."""
    toml = folder / f"{scene.name.replace(', ', '_').replace(' ', '_')}.toml"
    toml.write_text(scene.toml())
    [(mean, error)] = programs.render(toml, OUR_SPP, seed)
    return mean[0], error[0]


def run(seed, llvm, folder):
    """Yield the pairs: Stokes images, and with LLVM the gold corner's 16 elements over time."""
    if llvm:
        import masking

        masking.register()
    for make in scenes.STOKES:
        scene = make(llvm)
        mean, error = ours(scene, seed, folder)
        loaded = mi.load_dict(scene.dictionary(mi))
        theirs = programs.stokes(loaded, 128 if llvm else 24, seed, BATCHES)
        elements = [f"s{i}" for i in range(4)]
        yield Pair(scene.name, "", elements, mean[..., 0], error[..., 0], theirs, frames.angles(loaded.sensors()[0]))
    if llvm:
        yield corner(seed, folder)


def corner(seed, folder):
    """Return all 16 elements over time, in blocks of pixels and bins. Single pixels and bins have too few samples for Gaussian
    errors.
    """
    import mueller_integrator

    scene = scenes.corner(True)
    loaded = mi.load_dict(scene.dictionary(mi))
    theirs = [
        mueller_integrator.render(loaded, scene.light, scene.max_depth, 64, seed * BATCHES + i, scene.time)
        for i in range(BATCHES)
    ]
    flat = lambda a: np.asarray(a).reshape(*np.shape(a)[:-2], 16)
    elements = [f"T{i}{j}" for i in range(4) for j in range(4)]
    return Pair(scene.name, "over time", elements, *map(flat, ours(scene, seed, folder)), flat(theirs), block=BLOCK)

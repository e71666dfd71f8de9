"""Functions that run both programs: Sunstone as a command, Mitsuba as a library."""

import subprocess
import sys

import mitsuba as mi
import numpy as np
import xarray

import environment

# Weights of R, G, B in the luminance.
LUMINANCE = [0.212671, 0.715160, 0.072169]


def sunstone(*arguments):
    """Run Sunstone; stop on failure."""
    done = subprocess.run([environment.sunstone(), *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        print(f"sunstone {' '.join(map(str, arguments))}\n{done.stderr}", file=sys.stderr)
        sys.exit(3)
    return done


def render(toml, spp, seed, slices=("mueller",)):
    """Return means and standard errors of slices of a scene file, each [wavelength, y, x, (t,) out, in]."""
    store = toml.with_suffix(".zarr")
    sunstone("render", toml, "-o", store, "--force", "--seed", seed, "--spp", spp, "--no-figures",
             "--integrator", "path")
    out = []
    for name in slices:
        data = xarray.open_zarr(store, group=name, consolidated=False)
        data = data.transpose("wavelength", "y", "x", *(["t"] if "t" in data.dims else []), "stokes_out", "stokes_in")
        out.append((data["mean"].values.astype(float), data["std_error"].values.astype(float)))
    return out


def stokes(scene, spp, seed, batches):
    """Return Stokes images with separate seeds, in Mitsuba's frames, [seed, y, x, 4]; for single-wavelength scenes."""
    images = [np.array(mi.render(scene, spp=spp, seed=seed * batches + i)) for i in range(batches)]
    return luminance(np.stack(images)) / white(seed)


def luminance(images):
    """Return the values of Stokes images from Mitsuba's channels."""
    # Channels: colour of the nested integrator (with alpha, if any), then S0, S1, S2, S3 in R, G, B. All spectra are constant, so
    # that luminance is their value. (Scalar Mitsuba samples wavelengths, and its R, G, B are those of an equal-energy spectrum,
    # which is not white.)
    return images[..., -12:].reshape(*images.shape[:-1], 4, 3) @ LUMINANCE


def white(seed):
    """Return Mitsuba's pixel value for a radiance of 1.

    It is exactly 1 in the mono variant, but 1.00094 ± 0.00005 in the scalar one (apparently from its conversion of spectra to
    colours), which is unrelated to light transport.
    """
    film = {"type": "hdrfilm", "width": 24, "height": 24, "rfilter": {"type": "box"}}
    empty = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "stokes", "nested": {"type": "path"}},
        "sensor": {"type": "perspective", "film": film, "sampler": {"type": "independent"}},
        "light": {"type": "constant", "radiance": {"type": "uniform", "value": 1.0}},
    })
    return luminance(np.array(mi.render(empty, spp=512, seed=seed)))[..., 0].mean()

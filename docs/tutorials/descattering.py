# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # Seeing through milk
#
# A ruler stands in a tank of milky water. Light that the milk scatters hides the ruler. Epipolar imaging, time gating and polarization can
# separate the scattered light from light that the ruler reflects. This tutorial uses epipolar imaging, with few samples and pixels. The
# page [seeing through scattering](../applications/scattering.md) lists results for all methods at a larger size, and published claims that
# do not hold.
#
# Install the packages of this tutorial with `pip install "./python[stores,plot]"`.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pysunstone as ps

ROOT = next(folder for folder in [Path.cwd(), *Path.cwd().parents] if (folder / "scenes").is_dir())
scene = ps.Scene.load(ROOT / "scenes/milky_tank/scene.toml")
scene

# %%
shown = ["conventional", "epipolar", "nonepipolar"]
slices = scene.render(spp=6, slices=shown)
{name: s.dims for name, s in slices.items()}

# %%
def picture(name):
    """Return the intensity of a slice at all wavelengths, as an image."""
    data = slices[name].to_xarray()["mean"]
    data = data.isel({d: 0 for d in ("stokes_out", "stokes_in") if d in data.dims})
    return data.transpose("y", "x", "wavelength")

# %% [markdown]
# Compare light from the epipolar line with all other light. Light that the milk scatters comes from projector pixels on and off the
# epipolar line. Light that the ruler reflects directly comes from the epipolar line.

# %%
figure, axes = plt.subplots(1, len(shown), figsize=(4 * len(shown), 4))
for axis, name in zip(axes, shown):
    image = picture(name).values
    axis.imshow(np.clip(image[..., ::-1] / np.percentile(image, 99), 0, 1)), axis.set_title(name), axis.axis("off")

# %% [markdown]
# Compute the contrast of each image in its central region: the standard deviation divided by the mean.

# %%
for name in shown:
    green = picture(name).sel(wavelength=550).values[32:96, 32:96]
    print(f"{name:12} contrast {green.std() / green.mean():.2f}")

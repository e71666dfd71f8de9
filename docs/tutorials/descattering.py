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
# A ruler stands in a tank of milky water. Light that the milk scatters hides it. Epipolar position, arrival time and polarization separate
# this light from the light of the ruler. This tutorial uses few samples and pixels. For results at a larger size, and for claims that do
# not hold, see [the application](../applications/scattering.md).

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
    """The intensity of a slice in colours."""
    data = slices[name].to_xarray()["mean"]
    data = data.isel({d: 0 for d in ("stokes_out", "stokes_in") if d in data.dims})
    return data.transpose("y", "x", "wavelength")

# %% [markdown]
# Compare light from the epipolar line with all other light. Light that the milk scattered comes from everywhere; light that the ruler
# reflected comes from the line.

# %%
figure, axes = plt.subplots(1, len(shown), figsize=(4 * len(shown), 4))
for axis, name in zip(axes, shown):
    image = picture(name).values
    axis.imshow(np.clip(image[..., ::-1] / np.percentile(image, 99), 0, 1)), axis.set_title(name), axis.axis("off")

# %% [markdown]
# Compute the contrast of each image: its standard deviation over its mean, in the middle of the picture.

# %%
for name in shown:
    green = picture(name).sel(wavelength=550).values[32:96, 32:96]
    print(f"{name:12} contrast {green.std() / green.mean():.2f}")

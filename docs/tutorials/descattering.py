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
# A ruler in a tank of milky water. Light that scattered in the milk hides it; where the projector's light can have come from, when it arrives and how
# it is polarized tell the two apart. Here at few samples and pixels; [the application](../applications/scattering.md) says what full
# size shows, and what does not hold.

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
# Light of the epipolar line against all other light: what the milk scattered comes from everywhere, what the ruler reflected from
# the line.

# %%
figure, axes = plt.subplots(1, len(shown), figsize=(4 * len(shown), 4))
for axis, name in zip(axes, shown):
    image = picture(name).values
    axis.imshow(np.clip(image[..., ::-1] / np.percentile(image, 99), 0, 1)), axis.set_title(name), axis.axis("off")

# %% [markdown]
# How much each hides: contrast, the spread of the image over its mean, in the middle of the picture.

# %%
for name in shown:
    green = picture(name).sel(wavelength=550).values[32:96, 32:96]
    print(f"{name:12} contrast {green.std() / green.mean():.2f}")

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
# # A first tensor
#
# From a scene file to a Mueller image, a time profile and an error bar. This page was run as it stands, at few samples.

# %%
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pysunstone as ps

ROOT = next(folder for folder in [Path.cwd(), *Path.cwd().parents] if (folder / "scenes").is_dir())
scene = ps.Scene.load(ROOT / "scenes/mirror_room/scene.toml")
scene

# %% [markdown]
# A scene lists *slices* of T(s, s', p, p', t): what to keep of it. One render fills all of them, with standard errors.

# %%
store = Path(tempfile.mkdtemp()) / "room.zarr"
done = scene.render(store, spp=8)
done["samples"], done["wall_time_s"]

# %%
room = ps.open_store(store)
{name: dict(node["mean"].sizes) for name, node in room.children.items()}

# %% [markdown]
# ## A Mueller image
#
# M00 is the intensity; the other elements are divided by it. Grey is no polarization, and the gold knot has plenty.

# %%
room["polarimetric"].sunstone.plot_mueller(wavelength=550)

# %% [markdown]
# ## A profile over time
#
# Row `y = 150` resolves travel time in bins of 25 ps. One pixel of it, lit by all projector pixels, with its error band:

# %%
xt = room["xt"]
xt.sel(x=180, wavelength=550).isel(stokes_out=0, stokes_in=0).to_dataset().sunstone.plot_profile().figure

# %% [markdown]
# ## Probing
#
# What a camera sees when the projector is polarized horizontally and pulses for 60 ps is a contraction of the tensor.

# %%
seen = xt.sunstone.probe(state="horizontal", pulse=60)
image = seen["mean"].sel(wavelength=550).isel(stokes_out=0)
image.plot(vmax=float(image.quantile(0.995)))
plt.show()

# %% [markdown]
# ## How sure is it?
#
# Every element has its standard error. Of pixels with light, at 8 samples a pixel:

# %%
photo = room["polarimetric"].to_dataset().isel(stokes_out=0, stokes_in=0).compute()
relative = (photo["std_error"] / photo["mean"]).where(photo["mean"] > 0)
print(f"median relative error of the intensity: {float(relative.median()):.1%}")
assert 0 < float(relative.median()) < 1

# %% [markdown]
# In memory, without a file, the numbers are the same to the bit:

# %%
arrays = scene.render(spp=8, slices=["polarimetric"])
assert np.array_equal(arrays["polarimetric"]["mean"], room["polarimetric"]["mean"].values)

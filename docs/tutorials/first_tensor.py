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
# This tutorial renders a scene file and shows a Mueller image, a time profile and standard errors. It uses few samples, so it runs quickly.
#
# Install the packages of this tutorial with `pip install "./python[stores,plot]"`.

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
# A scene lists *slices* of the tensor T(s, s', p, p', t). Each slice defines which entries or sums to keep along each axis. One render
# computes all slices and their standard errors.

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
# M00 is the intensity. The other elements are divided by M00. Elements of unpolarized light are grey. Light from the gold knot is strongly
# polarized.

# %%
room["polarimetric"].sunstone.plot_mueller(wavelength=550)

# %% [markdown]
# ## A profile over time
#
# The slice `xt` resolves the travel time for image row `y = 150` in bins of 25 ps. Plot the time profile of one pixel of this row, with its
# error band:

# %%
xt = room["xt"]
xt.sel(x=180, wavelength=550).isel(stokes_out=0, stokes_in=0).to_dataset().sunstone.plot_profile().figure

# %% [markdown]
# ## Probing
#
# A probe contracts the tensor with an illumination. In this example, the projector emits horizontally polarized pulses of 60 ps:

# %%
seen = xt.sunstone.probe(state="horizontal", pulse=60)
image = seen["mean"].sel(wavelength=550).isel(stokes_out=0)
image.plot(vmax=float(image.quantile(0.995)))
plt.show()

# %% [markdown]
# ## Standard errors
#
# Every element has a standard error. Print the median relative error of the lit pixels at 8 samples per pixel:

# %%
photo = room["polarimetric"].to_dataset().isel(stokes_out=0, stokes_in=0).compute()
relative = (photo["std_error"] / photo["mean"]).where(photo["mean"] > 0)
print(f"median relative error of the intensity: {float(relative.median()):.1%}")
assert 0 < float(relative.median()) < 1

# %% [markdown]
# A render to memory, without a store, gives bit-identical values:

# %%
arrays = scene.render(spp=8, slices=["polarimetric"])
assert np.array_equal(arrays["polarimetric"]["mean"], room["polarimetric"]["mean"].values)

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
# # Build your own scene
#
# This tutorial builds a scene from NumPy meshes, step by step. The methods of the builder accept the keys of [scene
# files](../scene-files.md).
#
# Install the packages of this tutorial with `pip install "./python[stores,plot]"`.

# %%
import matplotlib.pyplot as plt
import numpy as np
import pysunstone as ps

# %% [markdown]
# Create the mesh of a wavy sheet: vertices in metres, faces with counter-clockwise vertices as seen from outside, and normals for smooth
# shading.

# %%
n = 40
u, v = np.meshgrid(np.linspace(-0.5, 0.5, n), np.linspace(-0.5, 0.5, n))
height = 0.04 * np.sin(14 * u) * np.cos(9 * v)
vertices = np.stack([u, v, height], axis=-1).reshape(-1, 3)
corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
faces = np.concatenate([
    np.stack([corner, corner + 1, corner + n + 1], axis=1),
    np.stack([corner, corner + n + 1, corner + n], axis=1),
])
slope_u = 0.04 * 14 * np.cos(14 * u) * np.cos(9 * v)
slope_v = -0.04 * 9 * np.sin(14 * u) * np.sin(9 * v)
normals = np.stack([-slope_u, -slope_v, np.ones_like(u)], axis=-1).reshape(-1, 3)
normals /= np.linalg.norm(normals, axis=1, keepdims=True)

# %%
scene = (
    ps.SceneBuilder("wavy plastic")
    .camera([0, 0, 2.2], [0, 0, 0], fov_x_deg=30, resolution=[96, 96])
    .projector([0.5, 0, 2.2], [0, 0, 0], fov_x_deg=36, resolution=[128, 128])
    .material("plastic", plastic={"ior": 1.5, "albedo": [0.2, 0.3, 0.5], "alpha": 0.15})
    .mesh("sheet", vertices, faces, normals=normals, material="plastic")
    .slice("photo")
    .slice("mueller", polarization="mueller")
    .slice("epipolar", projector={"epipolar": {"half_width_px": 1.5}})
    .render(spp=32)
    .build()
)
scene

# %%
slices = scene.render()
photo = slices["photo"]["mean"]
plt.imshow(np.clip(photo[..., ::-1] / np.percentile(photo, 99.5), 0, 1)), plt.axis("off");

# %% [markdown]
# The arrays of a slice have named axes. `to_xarray` converts a slice to an xarray dataset without a copy. Decompose the Mueller matrices
# and show two properties:

# %%
mueller = slices["mueller"].to_xarray()
parts = ps.decompose(mueller["mean"].transpose(..., "wavelength", "stokes_out", "stokes_in").values, only=["diattenuation", "depolarization"])
figure, axes = plt.subplots(1, 2, figsize=(8, 3.5))
for axis, (name, values) in zip(axes, parts.items()):
    axis.set_title(name), axis.axis("off")
    plt.colorbar(axis.imshow(values[:, :, 1]), ax=axis)

# %% [markdown]
# ## Errors
#
# An error message states the position of the error and how to fix it:

# %%
try:
    ps.SceneBuilder("typo").camera([0, 0, 2], [0, 0, 0], fov_x_deg=30, resolution=[8, 8], zoom=2).slice("photo").build()
except ps.InputError as error:
    print(error)

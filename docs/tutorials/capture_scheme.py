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
# # Validate a capture scheme
#
# How accurately does a polarimeter measure Mueller matrices? This tutorial simulates captures of a rendered scene, reconstructs the Mueller
# matrices and compares them with the true matrices. You can thus test a capture scheme before you buy any hardware.
#
# Install the packages of this tutorial with `pip install "./python[stores,plot]"`.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pysunstone as ps

ROOT = next(folder for folder in [Path.cwd(), *Path.cwd().parents] if (folder / "scenes").is_dir())
scene = ps.Scene.load(ROOT / "scenes/gold_mirror/scene.toml")
slices = scene.render(spp=16)
name = next(n for n, s in slices.items() if "stokes_in" in s.dims and "t" not in s.dims)
data = slices[name].to_xarray()["mean"].transpose("y", "x", "wavelength", "stokes_out", "stokes_in")
data.sizes

# %% [markdown]
# Select the matrices of the lit pixels at one wavelength, and divide each matrix by its M00:

# %%
matrices = data.sel(wavelength=550).values.reshape(-1, 4, 4)
truth = matrices[matrices[:, 0, 0] > 0.01 * matrices[:, 0, 0].max()]
truth = truth / truth[:, :1, :1]
len(truth)

# %% [markdown]
# ## Design matrices
#
# A capture scheme maps the 16 elements of a Mueller matrix to intensities, `A @ M.reshape(16)`. The captures determine a matrix if A has
# rank 16. The ratio of the error variance to its lower bound measures the quality of the scheme: a ratio of 1 is optimal. (With sixteen
# captures of dual rotating retarders, in steps of 5 and 25 degrees, A is nearly singular, so this scheme is useless.)

# %%
for scheme in (ps.Scheme.drr(16), ps.Scheme.drr(36), ps.Scheme.qrpr(36), ps.Scheme.drr(9, polarizer_array=True)):
    reported = scheme.quality()
    print(f"{scheme!r}: rank {reported['rank']:.0f}, error variance {reported['error_variance'] / scheme.bound:.2f} of its bound")

# %% [markdown]
# ## Capture and reconstruction
#
# For each number of captures, compare the error of the reconstructed matrices with the error that the design matrix predicts.

# %%
noise = 0.01
def measured_error(scheme, seed):
    intensities = ps.simulate(truth, scheme, noise=noise, seed=seed)
    found, stated = ps.reconstruct(intensities, scheme, noise=noise, errors=True)
    return found - truth, stated

counts = [20, 25, 30, 36, 49, 64]
found, expected = [], []
for captures in counts:
    scheme = ps.Scheme.drr(captures)
    errors, stated = measured_error(scheme, seed=captures)
    found.append(np.sqrt(np.mean(errors**2)))
    expected.append(noise * np.sqrt(scheme.quality()["error_variance"] / 16))
    # The deviations from the truth agree with the stated errors.
    z = errors / stated
    assert abs(np.mean(z**2) - 1) < 5 * np.sqrt(2 / z.size) * 4, np.mean(z**2)

plt.loglog(counts, found, "o", label="simulated captures")
plt.loglog(counts, expected, "-", label="from the design matrix")
plt.xlabel("captures"), plt.ylabel("error of an element (M00 = 1)"), plt.legend();

# %% [markdown]
# The points lie on the line, so the closed form predicts the error of a capture scheme. `sunstone learn` uses this closed form to optimize
# the angles for a given number of captures.

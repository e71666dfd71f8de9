"""Contraction of slices of T with projector patterns and Stokes states, I = Σ T P over s' and p', and convolution with a pulse
along t.

The theory is that of Baek & Heide 2021 (`eq:general_light_transport`). The sums are computed on xarray arrays and equal the
results of `sunstone probe`. They are lazy for lazy arrays and are computed in double precision. Results are float32, as in
stores.

**Standard errors.** The elements of one camera pixel are estimated from the same samples and may have any correlation. A weighted
sum over them therefore has the error bound Σ|w|·se (``"bound"``, as `sunstone probe` reports). √Σ(w·se)² (``"independent"``) is
valid for independent elements. Projector pixels and time bins that share few paths are nearly independent. For n correlated
elements, this value is too small by a factor of up to √n. Different camera pixels have different samples, so over y and x, errors
are added in quadrature in both cases.
"""

# pyright: basic
from __future__ import annotations

import warnings
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from ._arrays import real
from .boxes import bins

__all__ = ["Errors", "STATES", "contracted", "kernel", "pattern_weights", "stokes_vector", "summed"]

#: Method by which standard errors of sums over a pixel's elements are computed.
Errors = Literal["bound", "independent"]
#: Stokes vectors of unit power by name (the names of `sunstone probe --stokes`).
STATES: Mapping[str, tuple[float, float, float, float]] = {
    "unpolarized": (1, 0, 0, 0),
    "horizontal": (1, 1, 0, 0),
    "vertical": (1, -1, 0, 0),
    "plus45": (1, 0, 1, 0),
    "minus45": (1, 0, -1, 0),
    "right": (1, 0, 0, 1),
    "left": (1, 0, 0, -1),
}
_CAMERA = ("y", "x")
#: Relative tolerance for rounding errors of Stokes vectors.
_SLACK = 1e-4


def stokes_vector(state: str | npt.ArrayLike) -> xr.DataArray:
    """Return a Stokes vector over `stokes_in`, or several over `state` and `stokes_in`.

    Parameters
    ----------
    state
        A name of `STATES`, four numbers, or an array of shape (K, 4).

    Raises
    ------
    ValueError
        If the vector is not physical: s0 must be above 0, and s1² + s2² + s3² at most s0².
    """
    if isinstance(state, str):
        if state not in STATES:
            raise ValueError(f"unknown state `{state}`: choose from {', '.join(STATES)}, or pass four numbers")
        state = STATES[state]
    found = real("state", state, np.float64)
    if found.shape[-1:] != (4,) or found.ndim > 2:
        raise ValueError(f"the Stokes vector is of shape {found.shape}: pass four numbers, or an array (K, 4) for several vectors")
    polarized = np.sqrt((found[..., 1:] ** 2).sum(-1))
    if not np.all((found[..., 0] > 0) & (polarized <= found[..., 0] * (1 + _SLACK))):
        raise ValueError(f"the Stokes vector {found.tolist()} is not physical: s0 must be above 0, and s1² + s2² + s3² at most s0²")
    # Round to single precision, as the command does.
    found = found.astype(np.float32).astype(float)
    return xr.DataArray(found, dims=("state", "stokes_in")[-found.ndim :], coords={"stokes_in": np.arange(4)})


def pattern_weights(pattern: npt.ArrayLike, data: xr.DataArray) -> xr.DataArray | None:
    """Return the mean drive over the projector pixels of every entry (v, u) of an array; ``None`` if nothing is to be contracted.

    Parameters
    ----------
    pattern
        Drives, or a mask, of shape (rows, columns) of the projector, or (K, rows, columns) for K patterns (axis `pattern`).
    data
        An array of a slice, with the attributes it was opened with.

    Raises
    ------
    ValueError
        If the pattern does not fit the projector, or the slice is already summed over the projector's pixels.
    """
    drive = real("pattern", pattern, np.float32)
    if drive.ndim not in (2, 3) or not np.all(np.isfinite(drive)):
        raise ValueError(
            f"the pattern is of shape {drive.shape}, or not finite: pass finite numbers of shape (rows, columns) or (K, rows, columns)"
        )
    if not {"v", "u"} <= set(data.dims):
        if np.all(drive == 1) and drive.ndim == 2:
            return None
        raise ValueError('the slice is already summed over projector pixels: render a slice with `projector = "all"`')
    height, width = drive.shape[-2:]
    size = data.attrs.get("projector_size")
    if size is not None and [int(n) for n in size] != [width, height]:
        raise ValueError(f"the pattern has {width} × {height} pixels, but the projector has {size[0]} × {size[1]}")
    binned = data.attrs.get("projector_bin") or (None, None)
    rows, columns = bins(data["v"].values, binned[1]), bins(data["u"].values, binned[0])
    for boxes, total, name in ((rows, height, "rows"), (columns, width, "columns")):
        if boxes[-1][1] >= total:
            raise ValueError(f"the slice contains projector pixel {boxes[-1][1]}, but the pattern has only {total} {name}")
    # Sums over boxes are differences of cumulative sums from the upper left corner.
    corner = np.zeros((*drive.shape[:-2], height + 1, width + 1))
    corner[..., 1:, 1:] = drive.astype(float).cumsum(-2).cumsum(-1)
    first, last = np.array(rows).T
    left, right = np.array(columns).T
    area = np.outer(last - first + 1, right - left + 1)

    def at(row: npt.NDArray[Any], column: npt.NDArray[Any]) -> npt.NDArray[Any]:
        found: npt.NDArray[Any] = corner[..., row[:, None], column[None, :]]
        return found

    total_drive = at(last + 1, right + 1) - at(first, right + 1) - at(last + 1, left) + at(first, left)
    kept_rows, kept_columns = np.zeros(height, dtype=bool), np.zeros(width, dtype=bool)
    for boxes, kept in ((rows, kept_rows), (columns, kept_columns)):
        for a, b in boxes:
            kept[a : b + 1] = True
    lost = int(((drive != 0) & ~np.outer(kept_rows, kept_columns)).sum())
    if lost:
        warnings.warn(
            f"the pattern uses {lost} projector pixels that the slice does not keep, so the light of these pixels is missing",
            stacklevel=2,
        )
    dims = ("pattern", "v", "u")[-drive.ndim :]
    return xr.DataArray(total_drive / area, dims=dims, coords={"v": data["v"], "u": data["u"]})


def kernel(pulse: float | npt.ArrayLike, bin_ps: float) -> list[tuple[int, float]]:
    """Return a pulse as pairs (delay in bins, weight) whose weights sum to 1.

    Parameters
    ----------
    pulse
        Full width at half maximum of a Gaussian, picoseconds, or samples at the slice's bin width, the first without delay.
    bin_ps
        Width of a bin in picoseconds.
    """
    shape = real("pulse", pulse, np.float64)
    if shape.ndim == 0:
        if not (np.isfinite(shape) and shape >= 0):
            raise ValueError(f"the width of the pulse is {float(shape)} ps: pass a finite number of picoseconds, 0 or more")
        sigma = float(shape) / np.sqrt(8 * np.log(2)) / bin_ps
        reach = int(np.ceil(6 * sigma))
        later = range(-reach, reach + 1)
        weights = [1.0 if k == 0 else float(np.exp(-0.5 * (k / sigma) ** 2)) for k in later]
    elif shape.ndim == 1 and shape.size:
        later, weights = range(shape.size), shape.tolist()
    else:
        raise ValueError(f"the pulse is of shape {shape.shape}: pass a width in picoseconds, or a list of samples")
    total = float(np.sum(weights))
    if not (np.isfinite(total) and total > 0):
        raise ValueError("the sum of the pulse's samples must be positive and finite")
    return [(k, w / total) for k, w in zip(later, weights, strict=True) if w != 0]


def _smear(pulse: float | npt.ArrayLike, data: xr.DataArray) -> tuple[xr.DataArray, xr.DataArray]:
    """Return the weights from every bin (t) to every bin (t_out), and the weights of the light that leaves the bins."""
    if "t" not in data.dims:
        raise ValueError("the slice does not resolve time: render a slice with time bins")
    n = data.sizes["t"]
    bin_ps = data.attrs.get("time_bin_ps")
    if bin_ps is None:
        if n < 2:
            raise ValueError("the width of the time bins is unknown, because the attribute `time_bin_ps` is missing")
        bin_ps = float(data["t"][1] - data["t"][0])
    matrix, outside = np.zeros((n, n)), np.zeros(n)
    for later, weight in kernel(pulse, float(bin_ps)):
        source = np.arange(max(0, -later), min(n, n - later))
        matrix[source, source + later] += weight
        out = np.ones(n, dtype=bool)
        out[source] = False
        outside[out] += weight
    along = xr.DataArray(matrix, dims=("t", "t_out"), coords={"t": data["t"]})
    return along, xr.DataArray(outside, dims="t", coords={"t": data["t"]})


def _dot(data: xr.DataArray, weights: xr.DataArray, dims: Sequence[Hashable], errors: Errors | None) -> xr.DataArray:
    """Return Σ w x over dimensions, or the standard error of the sum."""
    data = data.astype(float)
    result: xr.DataArray
    if errors == "independent":
        result = xr.dot(data**2, weights**2, dim=dims, optimize=True) ** 0.5
    else:
        # With `optimize`, a sum along time becomes a matrix product, which is ten times as fast.
        result = xr.dot(data, weights if errors is None else abs(weights), dim=dims, optimize=True)
    return result


def _ordered(result: xr.DataArray, like: xr.DataArray) -> xr.DataArray:
    """Return float32 with new axes first, then the slice's axes in their order, and with the attributes of the source."""
    new = [d for d in result.dims if d not in like.dims]
    result = result.transpose(*new, *(d for d in like.dims if d in result.dims)).astype(np.float32)
    for name in result.coords:
        if name in like.coords:
            result[name].attrs.update(like[name].attrs)
    return result.assign_attrs(like.attrs)


def contracted(
    data: xr.DataArray,
    pattern: npt.ArrayLike | None,
    state: str | npt.ArrayLike | None,
    pulse: float | npt.ArrayLike | None,
    errors: Errors | None,
) -> tuple[xr.DataArray, xr.DataArray | None]:
    """Contract an array of values or, with `errors`, of their standard errors.

    The parameters are those of `SunstoneArray.probe`. The second result is the light that the pulse moves out of the bins.
    """
    result, shifted = data, None
    if pattern is not None and (drive := pattern_weights(pattern, data)) is not None:
        result = _dot(result, drive, ("v", "u"), errors)
    if state is not None:
        light = stokes_vector(state)
        if "stokes_in" in data.dims:
            if data.sizes["stokes_in"] != 4:
                raise ValueError("entries of the axis `stokes_in` were selected: call `probe` first, then select")
            result = _dot(result, light, ("stokes_in",), errors)
        elif light.ndim > 1 or not np.array_equal(light, (1, 0, 0, 0)):
            raise ValueError("the slice contains only intensity: pass the state `unpolarized`, or render a slice with polarization `mueller`")
    if pulse is not None:
        along, outside = _smear(pulse, data)
        shifted = _ordered(_dot(result, outside, ("t",), errors), data)
        result = _dot(result, along, ("t",), errors).rename(t_out="t").assign_coords(t=data["t"])
    return _ordered(result, data), shifted


def summed(data: xr.DataArray, over: Iterable[Hashable], errors: Errors | None) -> xr.DataArray:
    """Sum over axes, or combine errors: over a pixel's elements by the method `errors`, over camera pixels in quadrature."""
    over = list(over)
    if missing := [d for d in over if d not in data.dims]:
        raise ValueError(f"no axis `{missing[0]}`; the axes are {', '.join(map(str, data.dims))}")
    result = data.astype(float)
    if errors is None:
        return _ordered(result.sum(over, skipna=False), data)
    inner, pixels = [d for d in over if d not in _CAMERA], [d for d in over if d in _CAMERA]
    if errors == "bound":
        result = result.sum(inner, skipna=False)
    else:
        result = (result**2).sum(inner, skipna=False) ** 0.5
    return _ordered((result**2).sum(pixels, skipna=False) ** 0.5, data)

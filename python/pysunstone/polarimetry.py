"""Decomposes, captures and reconstructs Mueller matrices in xarray arrays with named axes.

The values equal those of `pysunstone.decompose`, `simulate` and `reconstruct`. Lazy Dask arrays are first computed in memory.
"""

# pyright: basic
from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import xarray as xr

from .capture import Scheme, reconstruct, simulated
from .mueller import decompose

__all__ = ["SchemeLike", "captured", "decomposed", "reconstructed"]


class _Scheme(Protocol):
    def to_toml(self) -> str: ...


#: A scheme: its file, or an object with a method `to_toml()`, such as `pysunstone.Scheme`.
SchemeLike = str | os.PathLike[str] | _Scheme

_STOKES = ("stokes_out", "stokes_in")
#: Units and long names of the results of decompositions.
_PARTS = {
    "polarizance": ("1", "polarizance"),
    "diattenuation": ("1", "diattenuation"),
    "retardance": ("radian", "retardance, 0 to pi"),
    "depolarization": ("1", "depolarization power"),
    "retardance_axis": ("1", "axis of the retarder on the Poincare sphere"),
    "entropy": ("1", "entropy after Cloude"),
    "m_delta": ("1", "depolarizer, with the transmittance M00"),
    "m_r": ("1", "retarder"),
    "m_d": ("1", "diattenuator"),
}


def _rising(data: xr.DataArray, dims: Sequence[str]) -> xr.DataArray:
    """Sort an array by its coordinates along the given axes, because the NumPy functions identify entries by position."""
    for dim in dims:
        if dim in data.dims and dim in data.coords and data[dim].dtype.kind in "fiu":
            values = data[dim].values
            if np.unique(values).size != values.size:
                raise ValueError(f"the coordinate `{dim}` has equal values: {values}")
            if (np.diff(values) < 0).any():
                data = data.sortby(dim)
    return data


def _like(data: xr.DataArray, other: xr.DataArray, what: str) -> xr.DataArray:
    """Return another array with its entries in the order of the first array's coordinates."""
    shared = [d for d in other.dims if d in data.dims and d in data.indexes and d in other.indexes]
    for dim in shared:
        if not data.indexes[dim].equals(other.indexes[dim]):
            if set(data.indexes[dim]) != set(other.indexes[dim]):
                raise ValueError(f"{what}: the coordinate `{dim}` differs from that of the data")
            other = other.sel({dim: data[dim].values})
    return other


def _matrices(data: xr.DataArray) -> xr.DataArray:
    """Return Mueller matrices with the matrix axes last and the wavelength before them."""
    if not set(_STOKES) <= set(data.dims) or any(data.sizes[d] != 4 for d in _STOKES):
        raise ValueError(
            "Mueller matrices are required, with four entries along `stokes_out` and `stokes_in`: "
            "render a slice with polarization `mueller`, and do not select entries of these axes"
        )
    data = _rising(data, _STOKES)
    lanes = ["wavelength"] if "wavelength" in data.dims else []
    return data.transpose(*(d for d in data.dims if d not in (*lanes, *_STOKES)), *lanes, *_STOKES)


def _coords(data: xr.DataArray, dims: Sequence[Any]) -> dict[Any, xr.DataArray]:
    """Return the coordinates of an array that lie along the given axes."""
    return {name: coordinate for name, coordinate in data.coords.items() if set(coordinate.dims) <= set(dims)}


def decomposed(mean: xr.DataArray, std_error: xr.DataArray | None, only: Sequence[str] | None) -> xr.Dataset:
    """Return Lu and Chipman's factors and scalars; see `SunstoneArray.decompose`."""
    matrices = _matrices(mean)
    errors = None if std_error is None else _matrices(_like(mean, std_error, "std_error")).transpose(*matrices.dims).values
    pixels = matrices.dims[:-2]
    result: dict[str, xr.DataArray] = {}
    for name, values in decompose(matrices.values, errors, only=only).items():
        kind = name.removesuffix("_error")
        units, said = _PARTS.get(kind, ("1", kind))
        if kind != name:
            name, said = f"{kind}_std_error", f"standard error of the {said}"
        extra = {0: (), 1: ("poincare",), 2: _STOKES}[values.ndim - len(pixels)]
        coords = _coords(matrices, (*pixels, *(_STOKES if extra == _STOKES else ())))
        result[name] = xr.DataArray(values, dims=(*pixels, *extra), coords=coords, attrs={"units": units, "long_name": said})
    return xr.Dataset(result)


def _wavelengths(data: xr.DataArray) -> tuple[xr.DataArray, dict[str, Any]]:
    """Return the array with the wavelength as an axis, if it is known, and the matching keyword argument."""
    if "wavelength" not in data.coords:
        return data, {}
    if "wavelength" not in data.dims:
        data = data.expand_dims("wavelength")
    return data, {"wavelengths_nm": [float(w) for w in data["wavelength"].values]}


def _scheme(scheme: SchemeLike) -> Scheme:
    if isinstance(scheme, Scheme):
        return scheme
    return Scheme.load(scheme) if isinstance(scheme, str | os.PathLike) else Scheme.from_toml(scheme.to_toml())


def _bins(data: xr.DataArray, pixels: Sequence[Any]) -> dict[str, float]:
    """Return the width of the time bins, if rows, columns, wavelengths and bins are the only axes."""
    if [d for d in pixels if d != "wavelength"] != ["y", "x", "t"] or data.sizes["t"] < 2:
        return {}
    return {"bin_ps": float(data["t"][1] - data["t"][0])}


def captured(
    mean: xr.DataArray,
    scheme: SchemeLike,
    detector: Mapping[str, Any] | str | os.PathLike[str] | None,
    noise: float | None,
    relative_noise: float | None,
    seed: int,
) -> xr.Dataset:
    """Simulate captures; see `SunstoneArray.capture`."""
    single = "wavelength" in mean.coords and "wavelength" not in mean.dims
    data, options = _wavelengths(mean)
    matrices = _matrices(data)
    pixels = matrices.dims[:-2]
    if detector is not None:
        options |= {"detector": detector, **_bins(matrices, pixels)}
    values, variances = simulated(
        matrices.values, _scheme(scheme), noise=noise, relative_noise=relative_noise, seed=seed, **options
    )
    dims = ("capture", "channel")[: values.ndim - len(pixels)] + pixels
    kept = [d for d in pixels if values.shape[dims.index(d)] == matrices.sizes[d]]
    coords: dict[Any, Any] = {**_coords(matrices, kept), "capture": np.arange(1, values.shape[0] + 1)}
    if "channel" in dims:
        coords["channel"] = ("channel", [0.0, 45.0, 90.0, 135.0], {"units": "degree", "long_name": "polarizer of the sensor"})
    units = mean.attrs.get("units", "1")

    def array(numbers: npt.NDArray[Any], said: str, unit: str) -> xr.DataArray:
        made = xr.DataArray(numbers, dims=dims, coords=coords, attrs={"units": unit, "long_name": said})
        return made.isel(wavelength=0) if single else made

    result = {"mean": array(values, "intensity", units)}
    if variances is not None:
        result["variance"] = array(variances, "variance of the intensity", f"({units})2")
    return xr.Dataset(result)


def reconstructed(
    intensities: xr.DataArray,
    scheme: SchemeLike,
    variance: xr.DataArray | None,
    noise: float | None,
    saturation: float | None,
    realizable: bool,
    errors: bool,
    prior: Any = None,
) -> xr.Dataset:
    """Reconstruct Mueller matrices from captures; see `SunstoneArray.reconstruct`."""
    if "capture" not in intensities.dims:
        raise ValueError("captures are required along the axis `capture`")
    intensities = _rising(intensities, ("capture", "channel"))
    if variance is not None:
        variance = _like(intensities, variance, "variance")
    single = "wavelength" in intensities.coords and "wavelength" not in intensities.dims
    data, options = _wavelengths(intensities)
    lanes = [d for d in ("wavelength",) if d in data.dims]
    leading = [d for d in ("capture", "channel") if d in data.dims]
    pixels = [d for d in data.dims if d not in (*leading, *lanes)] + lanes
    order = [*leading, *pixels]
    weights = None if variance is None else _wavelengths(variance)[0].transpose(*order).values
    found = reconstruct(
        data.transpose(*order).values,
        _scheme(scheme),
        variance=weights,
        noise=noise,
        saturation=saturation,
        realizable=realizable,
        errors=errors,
        prior=prior,
        **options,
    )
    coords: dict[Any, Any] = {**_coords(data, pixels), **{d: np.arange(4) for d in _STOKES}}
    units = intensities.attrs.get("units", "1")
    result = {}
    for name, values, said in zip(
        ("mean", "std_error"), found if errors else (found,), ("Mueller matrix", "standard error"), strict=False
    ):
        made = xr.DataArray(values, dims=(*pixels, *_STOKES), coords=coords, attrs={"units": units, "long_name": said})
        result[name] = made.isel(wavelength=0) if single else made
    return xr.Dataset(result)

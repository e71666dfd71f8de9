"""Decomposing, capturing and reconstructing Mueller matrices of arrays of xarray, with their axes.

The numbers are those of `sunstone decompose`, `capture` and `reconstruct`, which are run on the arrays; what Dask has put off
is computed first, in memory.
"""

# pyright: basic
from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import xarray as xr

from .command import run_on_arrays

__all__ = ["SchemeLike", "captured", "decomposed", "reconstructed"]


class _Scheme(Protocol):
    def to_toml(self) -> str: ...


#: A scheme: its file, or an object that says itself as such a file, as `pysunstone.Scheme`.
SchemeLike = str | os.PathLike[str] | _Scheme

_STOKES = ("stokes_out", "stokes_in")
#: What decompositions hold: units, and words.
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


def _matrices(data: xr.DataArray) -> xr.DataArray:
    """Mueller matrices as the last two axes, behind the wavelength."""
    if not set(_STOKES) <= set(data.dims) or any(data.sizes[d] != 4 for d in _STOKES):
        raise ValueError(
            "Mueller matrices are needed, four entries along `stokes_out` and `stokes_in`: render polarization `mueller`, select none"
        )
    lanes = ["wavelength"] if "wavelength" in data.dims else []
    return data.transpose(*(d for d in data.dims if d not in (*lanes, *_STOKES)), *lanes, *_STOKES)


def _coords(data: xr.DataArray, dims: Sequence[Any]) -> dict[Any, xr.DataArray]:
    """Coordinates of an array that lie along some of its axes."""
    return {name: coordinate for name, coordinate in data.coords.items() if set(coordinate.dims) <= set(dims)}


def decomposed(mean: xr.DataArray, std_error: xr.DataArray | None, only: Sequence[str] | None) -> xr.Dataset:
    """Lu and Chipman's factors and scalars; see `SunstoneArray.decompose`."""
    matrices = _matrices(mean)
    inputs = {"m": matrices.values}
    words: list[object] = ["decompose", "{m}"]
    if std_error is not None:
        inputs["e"] = _matrices(std_error).values
        words += ["--errors", "{e}"]
    if only is not None:
        words += ["--only", ",".join(only)]
    pixels = matrices.dims[:-2]
    result: dict[str, xr.DataArray] = {}
    for name, values in run_on_arrays(words, inputs, {"--output": "npz"}).items():
        kind = name.removesuffix("_error")
        units, said = _PARTS.get(kind, ("1", kind))
        if kind != name:
            name, said = f"{kind}_std_error", f"standard error of the {said}"
        extra = {0: (), 1: ("poincare",), 2: _STOKES}[values.ndim - len(pixels)]
        coords = _coords(matrices, (*pixels, *(_STOKES if extra == _STOKES else ())))
        result[name] = xr.DataArray(values, dims=(*pixels, *extra), coords=coords, attrs={"units": units, "long_name": said})
    return xr.Dataset(result)


def _wavelengths(data: xr.DataArray) -> tuple[xr.DataArray, list[object]]:
    """The array with the wavelength as an axis, where it is known, and the option that says it."""
    if "wavelength" not in data.coords:
        return data, []
    if "wavelength" not in data.dims:
        data = data.expand_dims("wavelength")
    return data, ["--wavelengths", ",".join(f"{float(w):g}" for w in data["wavelength"].values)]


def _scheme(scheme: SchemeLike) -> tuple[list[object], dict[str, str]]:
    """The option that names a scheme, and the text of its file where it is none."""
    if isinstance(scheme, (str, os.PathLike)):
        return ["--scheme", os.fspath(scheme)], {}
    return ["--scheme", "{scheme}"], {"scheme": scheme.to_toml()}


def captured(
    mean: xr.DataArray,
    scheme: SchemeLike,
    detector: str | os.PathLike[str] | None,
    noise: float | None,
    relative_noise: float | None,
    seed: int,
) -> xr.Dataset:
    """What a rig reads; see `SunstoneArray.capture`."""
    single = "wavelength" in mean.coords and "wavelength" not in mean.dims
    data, option = _wavelengths(mean)
    matrices = _matrices(data)
    named, texts = _scheme(scheme)
    words: list[object] = ["capture", "{m}", *named, "--seed", seed, *option]
    outputs = {"--output": "npy"}
    if detector is not None:
        words += ["--detector", os.fspath(detector)]
        outputs["--variance"] = "npy"
    words += [] if noise is None else ["--noise", noise]
    words += [] if relative_noise is None else ["--relative-noise", relative_noise]
    found = run_on_arrays(words, {"m": matrices.values}, outputs, texts)
    pixels = matrices.dims[:-2]
    values = found["--output"]
    dims = ("capture", "channel")[: values.ndim - len(pixels)] + pixels
    coords: dict[Any, Any] = {**_coords(matrices, pixels), "capture": np.arange(1, values.shape[0] + 1)}
    if "channel" in dims:
        coords["channel"] = ("channel", [0.0, 45.0, 90.0, 135.0], {"units": "degree", "long_name": "polarizer of the sensor"})
    units = mean.attrs.get("units", "1")

    def array(numbers: npt.NDArray[Any], said: str, unit: str) -> xr.DataArray:
        made = xr.DataArray(numbers, dims=dims, coords=coords, attrs={"units": unit, "long_name": said})
        return made.isel(wavelength=0) if single else made

    result = {"mean": array(values, "intensity", units)}
    if "--variance" in found:
        result["variance"] = array(found["--variance"], "variance of the intensity", f"({units})2")
    return xr.Dataset(result)


def reconstructed(
    intensities: xr.DataArray,
    scheme: SchemeLike,
    variance: xr.DataArray | None,
    noise: float | None,
    saturation: float | None,
    realizable: bool,
    errors: bool,
) -> xr.Dataset:
    """Mueller matrices from captures; see `SunstoneArray.reconstruct`."""
    if "capture" not in intensities.dims:
        raise ValueError("captures are needed along the axis `capture`")
    single = "wavelength" in intensities.coords and "wavelength" not in intensities.dims
    data, option = _wavelengths(intensities)
    lanes = [d for d in ("wavelength",) if d in data.dims]
    leading = [d for d in ("capture", "channel") if d in data.dims]
    pixels = [d for d in data.dims if d not in (*leading, *lanes)] + lanes
    order = [*leading, *pixels]
    inputs = {"i": data.transpose(*order).values}
    named, texts = _scheme(scheme)
    words: list[object] = ["reconstruct", "{i}", *named, *option]
    if variance is not None:
        inputs["v"] = _wavelengths(variance)[0].transpose(*order).values
        words += ["--variance", "{v}"]
    words += [] if noise is None else ["--noise", noise]
    words += [] if saturation is None else ["--saturation", saturation]
    words += ["--realizable"] if realizable else []
    outputs = {"--output": "npy", **({"--errors": "npy"} if errors else {})}
    found = run_on_arrays(words, inputs, outputs, texts)
    coords: dict[Any, Any] = {**_coords(data, pixels), **{d: np.arange(4) for d in _STOKES}}
    units = intensities.attrs.get("units", "1")
    result = {}
    for name, option_name, said in (("mean", "--output", "Mueller matrix"), ("std_error", "--errors", "standard error")):
        if option_name in found:
            made = xr.DataArray(
                found[option_name], dims=(*pixels, *_STOKES), coords=coords, attrs={"units": units, "long_name": said}
            )
            result[name] = made.isel(wavelength=0) if single else made
    return xr.Dataset(result)

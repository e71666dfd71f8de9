"""Capture schemes of ellipsometers, simulated captures, and Mueller matrices reconstructed from captures."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pysunstone import _native
from pysunstone._arrays import real
from pysunstone._native import InputError

__all__ = ["Scheme", "design_matrix", "reconstruct", "simulate"]


class Scheme:
    """How the polarizing elements of a rig are set in each capture."""

    def __init__(self, native: _native.Scheme) -> None:
        self._native = native

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Scheme:
        """Read a scheme file: TOML, or CSV by its name."""
        return cls(_native.Scheme.load(path))

    @classmethod
    def from_toml(cls, text: str) -> Scheme:
        """Make a scheme of the text of its file."""
        return cls(_native.Scheme.from_toml(text))

    @classmethod
    def drr(cls, captures: int = 36, *, polarizer_array: bool = False) -> Scheme:
        """Dual rotating retarders (Azzam 1978): 5° and 25° a capture."""
        return cls(_native.Scheme.preset("drr", captures, polarizer_array))

    @classmethod
    def qrpr(cls, captures: int = 36, *, polarizer_array: bool = False) -> Scheme:
        """Quad rotating polarizers and retarders at hand-made angles."""
        return cls(_native.Scheme.preset("qrpr", captures, polarizer_array))

    @classmethod
    def lc(cls, captures: int = 16, *, polarizer_array: bool = False) -> Scheme:
        """Liquid-crystal retarders, two a side."""
        return cls(_native.Scheme.preset("lc", captures, polarizer_array))

    def to_toml(self) -> str:
        """The text of its file."""
        return self._native.to_toml()

    @property
    def name(self) -> str:
        """Short name."""
        return self._native.name

    @property
    def captures(self) -> int:
        """Number of captures."""
        return self._native.captures

    @property
    def channels(self) -> int:
        """Numbers that a capture gives a pixel: 1, or 4 of a polarizer array (0°, 45°, 90°, 135°)."""
        return self._native.channels

    @property
    def bound(self) -> float:
        """Least error variance that as many captures allow."""
        return self._native.bound

    def quality(self, wavelength_nm: float = 550.0) -> dict[str, float]:
        """``rank``, ``condition`` number, and ``error_variance``: sum over the 16 elements, over that of an intensity."""
        rank, condition, variance = self._native.quality(wavelength_nm)
        return {"rank": rank, "condition": condition, "error_variance": variance}

    def __repr__(self) -> str:
        return f"<pysunstone.Scheme {self.name!r}, {self.captures} captures, {self.channels} channels>"


def design_matrix(
    scheme: Scheme, wavelength_nm: float = 550.0, *, incidence_deg: float = 0.0, azimuth_deg: float = 0.0
) -> npt.NDArray[np.float64]:
    """The matrix A of a scheme, (captures × channels, 16): intensities are ``A @ M.reshape(16)``."""
    return scheme._native.design_matrix(wavelength_nm, incidence_deg, azimuth_deg)  # pyright: ignore[reportPrivateUsage]


def _measured(scheme: Scheme) -> tuple[int, ...]:
    return (scheme.captures,) if scheme.channels == 1 else (scheme.captures, scheme.channels)


def _lanes(wavelengths_nm: float | Sequence[float], leading: tuple[int, ...]) -> list[float]:
    nm = [float(w) for w in np.atleast_1d(np.asarray(wavelengths_nm, np.float64))]
    if len(nm) != 1 and (not leading or leading[-1] != len(nm)):
        raise InputError(f"the last axis of shape {leading} is not as long as the {len(nm)} wavelengths")
    return nm


def simulate(
    matrices: npt.ArrayLike,
    scheme: Scheme,
    *,
    wavelengths_nm: float | Sequence[float] = 550.0,
    noise: float = 0.0,
    seed: int = 0,
) -> npt.NDArray[np.float32]:
    """Simulate what a rig with a scheme reads of known Mueller matrices.

    Parameters
    ----------
    matrices
        (..., 4, 4).
    wavelengths_nm
        One for all, or one for each entry of the last axis before the matrices.
    noise
        Standard deviation of normal noise, in the unit of the matrices.
    seed
        Of the noise.

    Returns
    -------
    numpy.ndarray
        (captures, ...), or (captures, 4, ...) of a polarizer array.
    """
    array = real("matrices", matrices, np.float64)
    if array.ndim < 2 or array.shape[-2:] != (4, 4):
        raise InputError(f"the matrices' shape is {array.shape}; give (..., 4, 4)")
    leading = array.shape[:-2]
    nm = _lanes(wavelengths_nm, leading)
    found = _native.simulate(scheme._native, array, nm, noise, seed)  # pyright: ignore[reportPrivateUsage]
    return found.reshape(_measured(scheme) + leading)


def reconstruct(
    intensities: npt.ArrayLike,
    scheme: Scheme,
    *,
    variance: npt.ArrayLike | None = None,
    wavelengths_nm: float | Sequence[float] = 550.0,
    noise: float | None = None,
    saturation: float | None = None,
    realizable: bool = False,
    errors: bool = False,
) -> Any:
    """Reconstruct Mueller matrices from captures.

    Parameters
    ----------
    intensities
        (captures, ...), or (captures, 4, ...) of a polarizer array; NaN is left out. Contiguous arrays of single or double precision
        are read without a copy.
    variance
        Variances of the intensities, of the same shape; they weigh.
    wavelengths_nm
        One for all, or one for each entry of the last axis.
    noise
        Standard deviation of the intensities, where there are no variances: for errors.
    saturation
        Intensities from here on are left out.
    realizable
        Return the nearest matrices that can exist.
    errors
        Return standard errors, too.

    Returns
    -------
    numpy.ndarray, or two of them
        (..., 4, 4), in the precision of the intensities; standard errors of the same shape.
    """
    array = real("intensities", intensities)
    measured = _measured(scheme)
    if array.shape[: len(measured)] != measured:
        raise InputError(f"the intensities' shape is {array.shape}; {scheme.captures} captures are of shape {measured} + (...)")
    leading = array.shape[len(measured) :]
    nm = _lanes(wavelengths_nm, leading)
    flat = (scheme.captures * scheme.channels, int(np.prod(leading, dtype=np.int64)))
    weights = None
    if variance is not None:
        weights = real("variance", variance, array.dtype)
        if weights.shape != array.shape:
            raise InputError(f"variance: its shape is {weights.shape}, that of the intensities {array.shape}")
        weights = weights.reshape(flat)
    found, spread = _native.reconstruct(
        scheme._native,  # pyright: ignore[reportPrivateUsage]
        array.reshape(flat),
        weights,
        nm,
        noise,
        saturation,
        realizable,
        errors,
    )
    shape = (*leading, 4, 4)
    return found.reshape(shape) if spread is None else (found.reshape(shape), spread.reshape(shape))

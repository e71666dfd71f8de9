"""Evaluates scattering matrices of single participating media over the scattering angle.

A matrix maps the Stokes vector before scattering to the Stokes vector after scattering, per steradian. The integral of its M00
over the sphere is 1. The horizontal axis of both frames is perpendicular to the scattering plane (the first axis is "s"). M01 =
M10 is therefore positive if scattered light is polarized perpendicular to this plane. The matrix has the six elements S11 = M00,
S12 = M01 = M10, S22 = M11, S33 = M22, S34 = M23 = -M32, S44 = M33 of spheres and of small or randomly oriented particles; the
others are zero. The values are the renderer's, in single precision, as `sunstone phase eval` prints them.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pysunstone import _native
from pysunstone._arrays import real
from pysunstone._documents import json_of
from pysunstone._native import InputError
from pysunstone.scene import Scene

__all__ = ["Medium", "eval", "evaluate"]

#: Keys of phase functions. A phase function is evaluated in a medium with arbitrary coefficients.
_PHASES = {"isotropic", "rayleigh", "henyey_greenstein", "mie"}


class Medium:
    """A medium, built for given wavelengths. Use it for its coefficients, and for repeated calls; `evaluate` builds the medium in
    each call.

    Parameters
    ----------
    source
        A phase function as under ``[media.NAME.homogeneous.phase]`` of a scene file, ``{"rayleigh": {"depolarization": 0.0}}``,
        ``{"henyey_greenstein": {"g": 0.8}}``, ``{"mie": {"kinds": [...]}}`` or ``"isotropic"``; a medium as under
        ``[media.NAME]``, ``{"milk": {}}``; a dict of several, ``{"media": {NAME: ...}}``; the path of a file of media (TOML); or
        a `Scene`.
    name
        Name of the medium, if there are several.
    wavelengths_nm
        A number, or a list in any order. Lists in a dict or file belong to the key ``wavelengths_nm`` of that dict or file (by
        default 450, 550, 660) and are interpolated.
    folder
        Base of relative paths in a dict.

    Raises
    ------
    InputError
        With the location of the error.
    """

    def __init__(
        self,
        source: Scene | Mapping[str, Any] | str | os.PathLike[str],
        name: str | None = None,
        *,
        wavelengths_nm: float | Sequence[float] | npt.NDArray[Any] = 550.0,
        folder: str | os.PathLike[str] = ".",
    ) -> None:
        wanted = real("wavelengths_nm", wavelengths_nm, np.float64)
        if wanted.ndim > 1:
            raise InputError(f"wavelengths_nm: the shape is {wanted.shape}; give a number or a list")
        nm = [float(w) for w in np.atleast_1d(wanted)]
        self._one = wanted.ndim == 0
        self._wavelengths = np.array(nm)
        if source == "isotropic":
            source = {"isotropic": None}
        if isinstance(source, Scene):
            self._native = _native.Medium.of_scene(source._native, name, nm)  # pyright: ignore[reportPrivateUsage]
        elif isinstance(source, Mapping):
            self._native = _native.Medium.from_json(json_of(_document(source, name)), folder, name, nm)
        else:
            self._native = _native.Medium.load(source, name, nm)
        self._bulk = self._native.bulk()

    @property
    def name(self) -> str:
        """Name of the medium in the file or dict."""
        return self._native.name

    @property
    def wavelengths_nm(self) -> npt.NDArray[np.float64]:
        """Wavelengths in nanometres for which the medium is built."""
        return self._wavelengths

    @property
    def index(self) -> Any:
        """Refractive index of the host medium; a number, or one value per wavelength, as all coefficients."""
        return self._column("index")

    @property
    def scattering(self) -> Any:
        """Scattering coefficient in 1/m."""
        return self._column("scattering")

    @property
    def absorption(self) -> Any:
        """Absorption coefficient in 1/m."""
        return self._column("absorption")

    @property
    def asymmetry(self) -> Any:
        """Mean cosine of the scattering angle."""
        return self._column("asymmetry")

    @property
    def scattering_cross_section(self) -> Any:
        """Mean scattering cross section per particle in m²; 0 if no particles are defined."""
        return self._column("scattering_cross_section")

    @property
    def absorption_cross_section(self) -> Any:
        """Mean absorption cross section per particle in m²; 0 if no particles are defined."""
        return self._column("absorption_cross_section")

    def _column(self, name: str) -> Any:
        values = self._bulk[name]
        return float(values[0]) if self._one else values

    def __repr__(self) -> str:
        return f"<pysunstone.phase.Medium {self.name!r} at {', '.join(f'{w:g}' for w in self._wavelengths)} nm>"

    def evaluate(self, angles_deg: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Evaluate the scattering matrices; see `evaluate`."""
        angles = real("angles_deg", angles_deg, np.float64)
        if not np.all((angles >= 0) & (angles <= 180)):
            raise InputError("angles_deg: some values are no scattering angles; use 0 to 180 degrees")
        found = self._native.evaluate(np.ascontiguousarray(angles).reshape(-1))
        lanes = () if self._one else (len(self._wavelengths),)
        return found.reshape((*angles.shape, *lanes, 4, 4))


def _document(source: Mapping[str, Any], name: str | None) -> Mapping[str, Any]:
    """Return the equivalent content of a file of media."""
    if "media" in source:
        return source
    if len(source) == 1 and next(iter(source)) in _PHASES:
        kind, settings = next(iter(source.items()))
        phase: Any = kind if kind == "isotropic" else {kind: settings}
        source = {"homogeneous": {"scattering": 1.0, "phase": phase}}
    return {"media": {name or "medium": source}}


def evaluate(medium: Any, angles_deg: npt.ArrayLike, **options: Any) -> npt.NDArray[np.float32]:
    """Evaluate the scattering matrix of a medium over the scattering angle.

    Parameters
    ----------
    medium
        A `Medium`, or a source for one: a phase function or a medium as a dict of scene files, the path of a file of media, or a
        `Scene`.
    angles_deg
        Scattering angles, 0 (forward) to 180 degrees, of any shape.
    **options
        ``name``, ``wavelengths_nm``, ``folder``, as for `Medium`.

    Returns
    -------
    numpy.ndarray
        Mueller matrices (..., 4, 4), per steradian; (..., wavelengths, 4, 4) for a list of wavelengths. The documentation of the
        module defines the frames.

    Examples
    --------
    >>> import pysunstone as ps
    >>> m = ps.phase.evaluate({"rayleigh": {"depolarization": 0.0}}, [0.0, 90.0, 180.0])
    >>> float(m[1, 0, 1] / m[1, 0, 0])  # at 90° light is fully polarized, perpendicular to the plane  # doctest: +SKIP
    """
    if isinstance(medium, Medium):
        if options:
            raise InputError(f"{', '.join(options)}: the medium is already built; pass these options to phase.Medium")
        return medium.evaluate(angles_deg)
    return Medium(medium, **options).evaluate(angles_deg)


#: Alias of `evaluate`. In this module, the alias hides Python's built-in function.
eval = evaluate

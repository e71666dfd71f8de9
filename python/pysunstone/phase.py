"""Phase functions of participating media by themselves: scattering matrices over the angle.

A matrix takes the Stokes vector of light before it is scattered to that behind, per steradian, and the integral of its M00 over the
sphere is 1. Both frames have the perpendicular of the scattering plane as their horizontal ("s" comes first): M01 = M10 is
positive where light is polarized perpendicular to that plane. The matrix has the six elements S11 = M00, S12 = M01 = M10, S22 = M11,
S33 = M22, S34 = M23 = -M32, S44 = M33 of spheres and small or randomly turned particles; the others are zero. Numbers are the
renderer's own, in single precision, as `sunstone phase eval` prints.
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

#: Phase functions that are no media: their coefficients do not matter.
_PHASES = {"isotropic", "rayleigh", "henyey_greenstein", "mie"}


class Medium:
    """A medium, built for some wavelengths: for its coefficients, and for many calls, of which each would build it anew.

    Parameters
    ----------
    source
        A phase function as of ``[media.NAME.homogeneous.phase]`` of a scene file, ``{"rayleigh": {"depolarization": 0.0}}``,
        ``{"henyey_greenstein": {"g": 0.8}}``, ``{"mie": {"kinds": [...]}}`` or ``"isotropic"``; a medium as below ``[media.NAME]``,
        ``{"milk": {}}``; a dict of several, ``{"media": {NAME: ...}}``; the path of a file of media (TOML); or a `Scene`.
    name
        Which of several.
    wavelengths_nm
        A number, or any of them in any order. Lists of a dict or file belong to its ``wavelengths_nm`` (450, 550, 660 if it has
        none) and are interpolated.
    folder
        Where relative paths of a dict begin.

    Raises
    ------
    InputError
        With the place of what is wrong.
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
        """Its name in the file or dict."""
        return self._native.name

    @property
    def wavelengths_nm(self) -> npt.NDArray[np.float64]:
        """What it is built for."""
        return self._wavelengths

    @property
    def index(self) -> Any:
        """Refractive index of the host; a number, or one a wavelength, as all coefficients."""
        return self._column("index")

    @property
    def scattering(self) -> Any:
        """Coefficient of scattering, 1/m."""
        return self._column("scattering")

    @property
    def absorption(self) -> Any:
        """Coefficient of absorption, 1/m."""
        return self._column("absorption")

    @property
    def asymmetry(self) -> Any:
        """Mean cosine of the scattering angle."""
        return self._column("asymmetry")

    @property
    def scattering_cross_section(self) -> Any:
        """Mean cross section of scattering of a particle, m²; 0 where no particles were given."""
        return self._column("scattering_cross_section")

    @property
    def absorption_cross_section(self) -> Any:
        """Mean cross section of absorption of a particle, m²; 0 where no particles were given."""
        return self._column("absorption_cross_section")

    def _column(self, name: str) -> Any:
        values = self._bulk[name]
        return float(values[0]) if self._one else values

    def __repr__(self) -> str:
        return f"<pysunstone.phase.Medium {self.name!r} at {', '.join(f'{w:g}' for w in self._wavelengths)} nm>"

    def evaluate(self, angles_deg: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Its scattering matrices; see `evaluate`."""
        angles = real("angles_deg", angles_deg, np.float64)
        if not np.all((angles >= 0) & (angles <= 180)):
            raise InputError("angles_deg: some are no scattering angles; give 0 to 180 degrees")
        found = self._native.evaluate(np.ascontiguousarray(angles).reshape(-1))
        lanes = () if self._one else (len(self._wavelengths),)
        return found.reshape((*angles.shape, *lanes, 4, 4))


def _document(source: Mapping[str, Any], name: str | None) -> Mapping[str, Any]:
    """The content of a file of media that says the same."""
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
        A `Medium`, or what makes one: a phase function or a medium as a dict of scene files, the path of a file of media, or a
        `Scene`.
    angles_deg
        Scattering angles, 0 (forward) to 180 degrees, of any shape.
    **options
        ``name``, ``wavelengths_nm``, ``folder``, as of `Medium`.

    Returns
    -------
    numpy.ndarray
        Mueller matrices (..., 4, 4), per steradian; (..., wavelengths, 4, 4) of a list of wavelengths. Frames: see the module.

    Examples
    --------
    >>> import pysunstone as ps
    >>> m = ps.phase.evaluate({"rayleigh": {"depolarization": 0.0}}, [0.0, 90.0, 180.0])
    >>> float(m[1, 0, 1] / m[1, 0, 0])  # light from the side is fully polarized, perpendicular to the plane  # doctest: +SKIP
    """
    if isinstance(medium, Medium):
        if options:
            raise InputError(f"{', '.join(options)}: the medium is built already; say this to phase.Medium")
        return medium.evaluate(angles_deg)
    return Medium(medium, **options).evaluate(angles_deg)


#: The same under the name that says it best, which hides Python's own.
eval = evaluate

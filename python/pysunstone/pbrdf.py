"""Evaluates polarimetric BRDFs of single materials, analytic and measured, over arrays of directions.

The surface's normal is +z and its tangent +x. Directions are vectors of any length that point away from the surface: the incoming
direction towards the light source, the outgoing direction towards the receiver. The horizontal axis of a Stokes frame is
perpendicular to the plane of the normal and the direction: (-sin φ, cos φ, 0) with the azimuth φ of the direction (the first axis
is "s"; along the normal φ = 0). A matrix maps from the frame of the incoming direction to that of the outgoing direction.
Handedness and signs are those of ``CONVENTIONS.md``. The values are the renderer's, in single precision, as `sunstone pbrdf eval`
prints them.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pysunstone import _display, _native
from pysunstone._arrays import real
from pysunstone._documents import json_of
from pysunstone._native import InputError
from pysunstone.scene import Scene

__all__ = ["Material", "direction", "eval", "evaluate", "frame", "mirror", "refract"]


def direction(theta_deg: npt.ArrayLike, phi_deg: npt.ArrayLike = 0.0) -> npt.NDArray[np.float64]:
    """Return unit vectors (..., 3) from polar angles to the normal (+z) and azimuths from the tangent (+x), in degrees."""
    theta, phi = np.radians(real("theta_deg", theta_deg, np.float64)), np.radians(real("phi_deg", phi_deg, np.float64))
    sine = np.sin(theta)
    return np.stack(np.broadcast_arrays(sine * np.cos(phi), sine * np.sin(phi), np.cos(theta)), axis=-1)


def frame(directions: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the horizontal axes (..., 3) of the Stokes frames for directions (..., 3): (-sin φ, cos φ, 0)."""
    w = _directions("directions", directions)
    phi = np.arctan2(w[..., 1], w[..., 0])
    return np.stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)], axis=-1)


class Material:
    """A material, built for given wavelengths. Use it for repeated calls; the functions below build the material in each call.

    Parameters
    ----------
    source
        A dict as under ``[materials.NAME]`` of a scene file, such as ``{"plastic": {"albedo": 0.3, "ior": 1.5, "alpha": 0.2}}``;
        a dict of several materials that may refer to each other, ``{"materials": {NAME: ...}}``; the path of a file of materials
        (TOML) or of a measured table (``.pbsdf``); or a `Scene`.
    name
        Name of the material, if there are several.
    wavelengths_nm
        A number, or a list in any order. Lists in a dict or file belong to the key ``wavelengths_nm`` of that dict or file (by
        default 450, 550, 660) and are interpolated; a scene supports only its own wavelengths.
    uv
        Texture coordinates.
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
        uv: tuple[float, float] = (0.5, 0.5),
        folder: str | os.PathLike[str] = ".",
    ) -> None:
        wanted = real("wavelengths_nm", wavelengths_nm, np.float64)
        if wanted.ndim > 1:
            raise InputError(f"wavelengths_nm: the shape is {wanted.shape}; give a number or a list")
        nm = [float(w) for w in np.atleast_1d(wanted)]
        self._one = wanted.ndim == 0
        self._uv = (float(uv[0]), float(uv[1]))
        if isinstance(source, Scene):
            self._native = _native.Material.of_scene(source._native, name, nm)  # pyright: ignore[reportPrivateUsage]
        elif isinstance(source, Mapping):
            document = source if "materials" in source else {"materials": {name or "material": source}}
            self._native = _native.Material.from_json(json_of(document), folder, name, nm)
        elif os.fspath(source).endswith(".pbsdf"):
            table = {"materials": {name or "measured": {"measured": {"file": os.path.abspath(source)}}}}
            self._native = _native.Material.from_json(json_of(table), ".", name, nm)
        else:
            self._native = _native.Material.load(source, name, nm)
        self._wavelengths = np.array(nm)

    @property
    def name(self) -> str:
        """Name of the material in the file, dict or scene."""
        return self._native.name

    @property
    def wavelengths_nm(self) -> npt.NDArray[np.float64]:
        """Wavelengths in nanometres for which the material is built."""
        return self._wavelengths

    def __repr__(self) -> str:
        return f"<pysunstone.pbrdf.Material {self.name!r} at {', '.join(f'{w:g}' for w in self._wavelengths)} nm>"

    def _repr_html_(self) -> str:
        normal = [0.0, 0.0, 1.0]
        facing = np.atleast_3d(self.evaluate(normal, normal)[..., 0, 0]).ravel()
        rows = [("wavelengths", ", ".join(f"{w:g} nm" for w in self._wavelengths))]
        rows.append(("BRDF M00 at normal incidence [1/sr]", ", ".join(f"{v:.4g}" for v in facing)))
        try:
            power = self.mirror(normal)[0]
            rows.append(("specular reflectance at normal incidence", ", ".join(f"{v:.4g}" for v in np.ravel(power[..., 0, 0]))))
        except InputError:
            # The material has no specular reflection.
            pass
        return _display.block(f"Material {self.name}", [_display.picture(self._ball(), "ball under one light")], rows)

    def _ball(self, size: int = 96) -> npt.NDArray[np.uint8]:
        """Return an image of a ball in parallel light from the upper left, (size, size, 3)."""
        y, x = np.mgrid[0.5:size, 0.5:size] / (size / 2) - 1
        inside = x**2 + y**2 < 0.98
        normals = np.stack([x, -y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], -1)[inside]
        # Each normal is the z axis of the surface's frame. The x axis is horizontal.
        across = np.cross([0.0, 1.0, 0.0], normals)
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        frame = np.stack([across, np.cross(normals, across), normals], -2)
        light = np.array([-0.45, 0.6, 0.66]) / np.linalg.norm([-0.45, 0.6, 0.66])
        to_light, to_eye = frame @ light, frame @ np.array([0.0, 0.0, 1.0])
        values = self.evaluate(to_light, to_eye)[..., 0, 0] * np.maximum(to_light[:, 2:] if not self._one else to_light[:, 2], 0)
        shown = np.zeros((size, size, len(self._wavelengths)), np.float32)
        shown[inside] = values.reshape(-1, len(self._wavelengths))
        return _display.to_rgb(shown, ("y", "x", "wavelength"), list(self._wavelengths), None, False)

    def evaluate(self, incoming: npt.ArrayLike, outgoing: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Evaluate the BRDF; see `evaluate`."""
        wi, wo = np.broadcast_arrays(_directions("incoming", incoming), _directions("outgoing", outgoing))
        found = self._native.brdf(_rows(wi), _rows(wo), self._uv)
        return self._shaped(found, wi.shape[:-1], (4, 4))

    def mirror(self, incoming: npt.ArrayLike) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]]:
        """Return the specular reflection; see `mirror`."""
        return self._specular(incoming, False)

    def refract(self, incoming: npt.ArrayLike) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]]:
        """Return the specular transmission; see `refract`."""
        return self._specular(incoming, True)

    def _specular(self, incoming: npt.ArrayLike, transmitted: bool) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]]:
        wi = _directions("incoming", incoming)
        matrices, leaving = self._native.specular(_rows(wi), transmitted, self._uv)
        return self._shaped(matrices, wi.shape[:-1], (4, 4)), self._shaped(leaving, wi.shape[:-1], (3,))

    def _shaped(self, found: npt.NDArray[Any], leading: tuple[int, ...], last: tuple[int, ...]) -> npt.NDArray[Any]:
        lanes = () if self._one else (len(self._wavelengths),)
        return found.reshape((*leading, *lanes, *last))


def _directions(what: str, given: npt.ArrayLike) -> npt.NDArray[np.float64]:
    w = real(what, given, np.float64)
    if w.shape[-1:] != (3,):
        raise InputError(f"{what}: the shape is {w.shape}; give vectors, (..., 3)")
    if not np.all(np.isfinite(w)) or not np.all((w != 0).any(-1)):
        raise InputError(f"{what}: some directions are zero or not finite; give finite vectors that are not zero")
    return w


def _rows(w: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.ascontiguousarray(w).reshape(-1, 3)


def _built(material: Any, options: Mapping[str, Any]) -> Material:
    if isinstance(material, Material):
        if options:
            raise InputError(f"{', '.join(options)}: the material is already built; pass these options to pbrdf.Material")
        return material
    return Material(material, **options)


def evaluate(material: Any, incoming: npt.ArrayLike, outgoing: npt.ArrayLike, **options: Any) -> npt.NDArray[np.float32]:
    """Evaluate the polarimetric BRDF of a material over arrays of directions.

    Parameters
    ----------
    material
        A `Material`, or a source for one: a dict as in scene files, the path of a file of materials or of a measured table
        (``.pbsdf``), or a `Scene`.
    incoming
        Directions (..., 3) towards the light source, in the surface's frame (see the module), of any length.
    outgoing
        Directions (..., 3) towards the receiver; both are broadcast.
    **options
        ``name``, ``wavelengths_nm``, ``uv``, ``folder``, as for `Material`.

    Returns
    -------
    numpy.ndarray
        Mueller matrices (..., 4, 4), per steradian, without the cosine; (..., wavelengths, 4, 4) for a list of wavelengths.
        Matrices are zero for directions into which no light is scattered. Specular reflection and transmission are not part of
        the BRDF: see `mirror` and `refract`.

    Examples
    --------
    >>> import pysunstone as ps
    >>> wi, wo = ps.pbrdf.direction(40.0, 180.0), ps.pbrdf.direction(range(0, 90, 10))
    >>> m = ps.pbrdf.evaluate({"rough_conductor": {"metal": "Au", "alpha": 0.2}}, wi, wo, wavelengths_nm=[450, 550, 660])
    >>> m.shape
    (9, 3, 4, 4)
    """
    return _built(material, options).evaluate(incoming, outgoing)


#: Alias of `evaluate`. In this module, the alias hides Python's built-in function.
eval = evaluate


def mirror(
    material: Any, incoming: npt.ArrayLike, **options: Any
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]]:
    """Return Mueller matrices of specular reflection by a smooth surface.

    Parameters
    ----------
    material, incoming, **options
        As for `evaluate`.

    Returns
    -------
    matrices
        (..., 4, 4), for power; (..., wavelengths, 4, 4) for a list of wavelengths.
    outgoing
        Directions of the reflected light, (..., 3) or (..., wavelengths, 3).

    Raises
    ------
    InputError
        If the material has no specular reflection for these directions.
    """
    return _built(material, options).mirror(incoming)


def refract(
    material: Any, incoming: npt.ArrayLike, **options: Any
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]]:
    """Return Mueller matrices of specular transmission through a smooth surface; arguments and results as for `mirror`.

    The matrices apply to power. Radiance also changes by the squared ratio of the refractive indices. Under total internal
    reflection they are zero, and the direction is NaN.
    """
    return _built(material, options).refract(incoming)

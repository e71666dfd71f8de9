"""Applications of the tensor (Baek & Heide 2021) with baselines, and shape reconstruction from your own arrays.

`run` renders the scenes of an application, fits every method on the training variants and evaluates it on the test variants, as
`sunstone apply`. Other functions work on images only: codes of structured light (`patterns`, `decode`), triangulation (`depth`),
and normals from depths (`normals`) or from polarization (`polarization_cues`, `polarization_normals`). Depths are in metres along
the camera's axis. Normals are unit vectors in the camera's frame (x right, y down, z forward) that point to the camera. Unknown
values are NaN.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pysunstone import _native
from pysunstone._arrays import real
from pysunstone._native import InputError
from pysunstone._progress import Progress, reporting
from pysunstone.scene import Scene

__all__ = [
    "Code",
    "Devices",
    "Picture",
    "Report",
    "applications",
    "decode",
    "depth",
    "normals",
    "patterns",
    "polarization_cues",
    "polarization_normals",
    "run",
]

Path = str | os.PathLike[str]
Array = npt.NDArray[np.float64]
#: Codes of structured light, after Posdamer & Altschuler 1982; Gupta et al. 2011; Srinivasan et al. 1984; Gupta & Nayar 2012.
Code = Literal["gray", "xor-02", "xor-04", "phase-shift", "micro-phase-shift"]


def applications() -> list[dict[str, Any]]:
    """List all applications as dicts.

    Keys: ``name``, ``shows`` (purpose), ``scene``, ``train`` and ``test`` (variants), ``methods``, ``metrics``, and sizes.
    """
    found: list[dict[str, Any]] = json.loads(_native.applications_json())
    return found


@dataclass(frozen=True)
class Picture:
    """An image of a method's result for the first seed: ``values`` (rows, columns, channels) for the test variant ``variant``."""

    method: str
    name: str
    variant: int | None
    values: Array = field(repr=False)


@dataclass(frozen=True)
class Report:
    """Scores of an application's methods.

    Attributes
    ----------
    name
        Name of the application.
    rows
        The table, one dict per row: ``metric``, ``unit``, ``more_is_better``, ``method``, ``source``, ``mean``, and ``std_error``
        over variants and seeds. All methods except the first also have ``difference`` (the first method minus this one on the
        same renders) and ``difference_std_error``; these are NaN for the first method. Errors are NaN if there is a single
        variant.
    captured
        The same tables for slices that a simulated rig captures, by the name of the capture chain.
    notes
        Notes on the results.
    pictures
        Results of the methods for the first seed.
    attrs
        Scene, variants, pixels, samples, seeds.
    """

    name: str
    rows: list[dict[str, Any]] = field(repr=False)
    captured: dict[str, list[dict[str, Any]]] = field(repr=False)
    notes: list[str] = field(repr=False)
    pictures: list[Picture] = field(repr=False)
    attrs: dict[str, Any]

    def to_xarray(self) -> Any:
        """Return the table as an ``xarray.Dataset`` over ``metric`` and ``method``; requires xarray."""
        import xarray

        metrics = list(dict.fromkeys(row["metric"] for row in self.rows))
        methods = list(dict.fromkeys(row["method"] for row in self.rows))
        names = ("mean", "std_error", "difference", "difference_std_error")
        values = {name: np.full((len(metrics), len(methods)), np.nan) for name in names}
        for row in self.rows:
            at = metrics.index(row["metric"]), methods.index(row["method"])
            for name in names:
                values[name][at] = row[name]
        units = {row["metric"]: row["unit"] for row in self.rows}
        return xarray.Dataset(
            {name: (("metric", "method"), numbers) for name, numbers in values.items()},
            coords={"metric": metrics, "method": methods, "unit": ("metric", [units[m] for m in metrics])},
            attrs=self.attrs,
        )


@dataclass(frozen=True)
class _Asked:
    name: str
    scenes: str | None
    renders: str
    preview: bool
    seeds: int
    chain: str | None
    output: str | None


def run(
    name: str,
    *,
    scenes: Path | None = None,
    renders: Path = os.path.join("out", "apply", "renders"),
    preview: bool = True,
    seeds: int = 1,
    capture: Path | None = None,
    output: Path | None = None,
    progress: bool | Progress | None = None,
) -> Report:
    """Run an application, as `sunstone apply` does. A preview run takes minutes, a full run takes hours.

    Ctrl-C stops the run; finished renders are kept.

    Parameters
    ----------
    name
        One of `applications`.
    scenes
        Folder of the scenes that come with Sunstone; by default ``scenes`` in the working folder or in a folder above it.
    renders
        Folder of the renders. Renders are kept, and finished renders are not repeated.
    preview
        Render small, noisy images.
    seeds
        Number of seeds. The whole run is repeated for each seed.
    capture
        File of a capture chain (examples: ``rigs/chains``). Methods are then also evaluated on slices that are captured by the
        simulated rig of this file.
    output
        Folder for tables and images, as written by the command.
    progress
        True for a bar, or a function that is called with the finished and total tiles of the current render.

    Raises
    ------
    InputError
        If there is no such application, scene or chain.
    RenderError
        If a render fails, for example because the disk is full or threads cannot start.
    """
    text = [None if path is None else os.fspath(path) for path in (scenes, capture, output)]
    asked = _Asked(name, text[0], os.fspath(renders), preview, seeds, text[1], text[2])
    with reporting(progress) as tell:
        document, pictures = _native.run_application(asked, tell)
    found = json.loads(document)
    return Report(
        found["application"],
        [_row(row) for row in found["rows"]],
        {through["captured"]: [_row(row) for row in through["rows"]] for through in found["through"]},
        found["notes"],
        [Picture(**picture) for picture in pictures],
        {key: found[key] for key in ("shows", "by", "scene", "train", "test", "pixels", "spp", "seeds")},
    )


def _row(row: Mapping[str, Any]) -> dict[str, Any]:
    def number(estimate: Any, key: str) -> float:
        value = None if estimate is None else estimate[key]
        return float("nan") if value is None else float(value)

    kept = {key: row[key] for key in ("metric", "unit", "more_is_better", "method", "source")}
    value, difference = row["value"], row["ours_less_this"]
    return kept | {
        "mean": number(value, "mean"),
        "std_error": number(value, "standard_error"),
        "difference": number(difference, "mean"),
        "difference_std_error": number(difference, "standard_error"),
    }


class Devices:
    """A calibrated camera and projector: pinholes without distortion.

    Parameters
    ----------
    camera, projector
        Dicts with ``resolution`` (columns, rows), ``focal`` lengths and ``principal`` point in pixels (the image's upper left
        corner is 0, 0), ``origin`` in metres, and ``axes``: the directions image right, image down and forward in world
        coordinates, by default the world's axes. Functions that use only the camera need no projector.
    """

    def __init__(self, camera: Mapping[str, Any], projector: Mapping[str, Any] | None = None) -> None:
        self._native = _native.Devices(_numbers("camera", camera), None if projector is None else _numbers("projector", projector))

    @classmethod
    def of(cls, scene: Scene) -> Devices:
        """Return the devices of a scene, as a calibration without error."""
        native = _native.Devices.of_scene(scene._native)  # pyright: ignore[reportPrivateUsage]
        if native is None:
            raise InputError("the scene has no projector; add one, or use Devices(camera)")
        made = cls.__new__(cls)
        made._native = native
        return made

    @property
    def camera(self) -> dict[str, Any]:
        """Parameters of the camera."""
        return dict(zip(_KEYS, self._native.camera, strict=True))

    @property
    def projector(self) -> dict[str, Any]:
        """Parameters of the projector."""
        return dict(zip(_KEYS, self._native.projector, strict=True))


_KEYS = ("resolution", "focal", "principal", "origin", "axes")
_DEFAULTS: dict[str, Any] = {"origin": (0.0, 0.0, 0.0), "axes": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))}


def _numbers(what: str, device: Mapping[str, Any]) -> Any:
    unknown, missing = set(device) - set(_KEYS), [k for k in _KEYS[:3] if k not in device]
    if unknown or missing:
        wrong = f"unknown key `{min(unknown)}`" if unknown else f"`{missing[0]}` is missing"
        raise InputError(f"{what}: {wrong}; give {', '.join(_KEYS)}")
    given = {key: real(f"{what}.{key}", device.get(key, _DEFAULTS.get(key)), np.float64) for key in _KEYS}
    for key, shape in zip(_KEYS, ((2,), (2,), (2,), (3,), (3, 3)), strict=True):
        if given[key].shape != shape:
            raise InputError(f"{what}.{key}: the shape is {given[key].shape}; give {shape}")
    return ([int(n) for n in given["resolution"]], *(given[key].tolist() for key in _KEYS[1:]))


def _image(what: str, given: npt.ArrayLike, last: tuple[int, ...] = ()) -> Array:
    """Check the trailing axes of an image and return it with shape (rows, columns, channels)."""
    array = real(what, given, np.float64)
    if array.ndim != 2 + len(last) or array.shape[2:] != last:
        raise InputError(f"{what}: the shape is {array.shape}; give {('rows', 'columns', *last)}".replace("'", ""))
    return array.reshape((*array.shape[:2], -1)) if last else array[..., None]


def patterns(code: Code, columns: int, *, periods: Sequence[float] | None = None) -> Array:
    """Return the patterns of a code of structured light: drives 0 to 1 of projector columns, (captures, columns).

    ``periods``, in columns, apply to ``phase-shift`` (decreasing from ``columns``; by default, each period is a quarter of the
    previous one) and to ``micro-phase-shift``.
    """
    return _native.code_patterns(code, columns, _listed(periods))


def decode(
    code: Code,
    captures: npt.ArrayLike,
    columns: int,
    *,
    periods: Sequence[float] | None = None,
    least_contrast: float = 0.0,
) -> tuple[Array, Array]:
    """Decode captures (captures, rows, columns) under `patterns`.

    Returns
    -------
    column
        Coordinate of the projector column (centres at i + ½), (rows, columns); NaN where a capture's contrast is below
        ``least_contrast``.
    confidence
        Contrast of the code, 0 to 1.
    """
    array = real("captures", captures, np.float64)
    if array.ndim != 3:
        raise InputError(f"captures: the shape is {array.shape}; give (captures, rows, columns)")
    pixels = np.ascontiguousarray(np.moveaxis(array, 0, -1))
    column, confidence = _native.decode_columns(code, pixels, columns, _listed(periods), least_contrast)
    return column[..., 0], confidence[..., 0]


def _listed(periods: Sequence[float] | None) -> list[float] | None:
    return None if periods is None else [float(p) for p in periods]


def depth(devices: Devices, column: npt.ArrayLike) -> Array:
    """Triangulate depths (rows, columns) from decoded projector columns (rows, columns)."""
    return _native.triangulate(devices._native, _image("column", column))[..., 0]  # pyright: ignore[reportPrivateUsage]


def normals(devices: Devices, depth: npt.ArrayLike, *, radius: int = 2, robust: bool = True) -> Array:
    """Return normals (rows, columns, 3) of depths.

    Each normal is that of a plane that is fitted to the depths in a square window with a side of 2·``radius`` + 1 pixels, with
    Tukey's biweight if ``robust``.
    """
    native = devices._native  # pyright: ignore[reportPrivateUsage]
    return _native.normals_of_depth(native, _image("depth", depth), radius, robust)


def polarization_cues(
    matrices: npt.ArrayLike, index: float = 1.5, *, mirrored: bool = False, mirrored_off: bool = False
) -> Array:
    """Return the degree of polarization, and the normal's zenith angle and azimuth (modulo π), radians, from Mueller matrices.

    Parameters
    ----------
    matrices
        (rows, columns, 4, 4): an image of Mueller matrices of a dielectric object, in the frame of each pixel.
    index
        Refractive index of the dielectric.
    mirrored
        Use the polarization of specular reflection (zenith angles below Brewster's angle) instead of subsurface scattering.
    mirrored_off
        Exclude single specular reflection by using M00 + M33 as intensity, which requires a projector near the camera (Baek et
        al. 2018).

    Returns
    -------
    numpy.ndarray
        (rows, columns, 3); NaN where there is no signal (Atkinson & Hancock 2006).
    """
    return _native.polarization_cues(_image("matrices", matrices, (4, 4)), index, mirrored, mirrored_off)


def polarization_normals(devices: Devices, cues: npt.ArrayLike, guess: npt.ArrayLike) -> Array:
    """Return normals (rows, columns, 3) from `polarization_cues`.

    The cues are consistent with two normals. The result is the one that is closer to ``guess``, such as the normal of a coarse
    scan.
    """
    native = devices._native  # pyright: ignore[reportPrivateUsage]
    return _native.normals_of_cues(native, _image("cues", cues, (3,)), _image("guess", guess, (3,)))

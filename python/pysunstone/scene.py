"""Scenes, and renders of scenes."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from pysunstone import _display, _native
from pysunstone._arrays import plain, whole
from pysunstone._cautions import caution
from pysunstone._documents import json_of
from pysunstone._native import InputError
from pysunstone._progress import Progress, reporting

__all__ = ["Layers", "Scene", "Slice", "Slices", "layers"]

Path = str | os.PathLike[str]


@dataclass(frozen=True)
class Slice:
    """One slice of the tensor T(s, s', p, p', t), with standard errors.

    Attributes
    ----------
    name
        Name of the slice in the scene.
    dims
        Names of the axes of ``arrays["mean"]``: those of ``y, x, v, u, t, bounces, component, label, stokes_out, stokes_in,
        wavelength`` that the slice resolves, in this order.
    coords
        Coordinates along every axis: pixels, picoseconds (bin centres), nanometres, indices.
    arrays
        ``mean`` and ``std_error`` (float32, over ``dims``); with time bins also ``overflow`` and ``overflow_std_error``, the
        light outside the bins; ``total_std_error`` (y, x), the standard error of M00 summed over all other axes. Bit-identical to
        the arrays of a store.
    array_dims
        Names of the axes of every array.
    attrs
        Attributes of the slice, as in a store.
    coord_attrs
        Unit and meaning of every axis.
    """

    name: str
    dims: tuple[str, ...]
    coords: dict[str, npt.NDArray[np.float64]]
    arrays: dict[str, npt.NDArray[np.float32]]
    array_dims: dict[str, tuple[str, ...]]
    attrs: dict[str, Any]
    coord_attrs: dict[str, dict[str, str]] = field(repr=False)

    def __getitem__(self, name: str) -> npt.NDArray[np.float32]:
        """Return the array with this name."""
        if name not in self.arrays:
            raise UnknownNameError(f"slice `{self.name}` has no array `{name}`; available: {', '.join(self.arrays)}")
        return self.arrays[name]

    def __repr__(self) -> str:
        return f"<pysunstone.Slice {self.name!r}, {self._shape()}, arrays {', '.join(self.arrays)}>"

    def _shape(self) -> str:
        return " x ".join(f"{axis} {len(self.coords[axis])}" for axis in self.dims)

    def _range(self, axis: str) -> str:
        values, units = self.coords[axis], self.coord_attrs[axis]["units"]
        shown = f"{values[0]:g}" if len(values) == 1 else f"{values[0]:g} to {values[-1]:g}"
        return f"{len(values)}: {shown}" + ("" if units == "1" else f" {units}")

    def _pictures(self) -> list[str]:
        is_image = {"y", "x"} <= set(self.dims)
        return [_display.picture(self.to_rgb(), self.name)] if is_image else []

    def _repr_html_(self) -> str:
        light = ("Σ M00", f"{self._intensity():.4g} {self.attrs.get('units', 'W m-2 sr-1 nm-1')}")
        axes = [(axis, self._range(axis)) for axis in self.dims]
        return _display.block(f"Slice {self.name}", self._pictures(), [*axes, ("arrays", ", ".join(self.arrays)), light])

    def _intensity(self) -> float:
        first = tuple(0 if axis.startswith("stokes_") else slice(None) for axis in self.dims)
        return float(np.nansum(self.arrays["mean"][first], dtype=np.float64))

    def to_rgb(self, white: float | None = None, *, linear: bool = False) -> npt.NDArray[Any]:
        """Return the photograph of the slice: M00, summed over all axes except the camera pixels, red first.

        Parameters
        ----------
        white
            Value that is shown as white; by default the 99th percentile.
        linear
            Return linear values (float32, in the unit of the slice) instead of 8-bit sRGB values.

        Returns
        -------
        numpy.ndarray
            (rows, columns, 3).

        Raises
        ------
        ValueError
            If the slice does not keep camera pixels.
        """
        nm = self.coords.get("wavelength")
        return _display.to_rgb(self.arrays["mean"], self.dims, None if nm is None else list(nm), white, linear)

    def plot(self, **options: Any) -> Any:
        """Draw the slice: Mueller matrices as a grid of images, else a photograph, else a time profile.

        Requires the packages of the extra ``plot`` and xarray. ``options`` are those of `pysunstone.plots.plot`.
        """
        return self.to_xarray().sunstone.plot(**options)

    def to_xarray(self) -> Any:
        """Return an ``xarray.Dataset`` with the accessor ``.sunstone``, without a copy; requires xarray."""
        import importlib

        import xarray

        importlib.import_module("pysunstone.accessor")
        return xarray.Dataset(
            {name: (self.array_dims[name], values) for name, values in self.arrays.items()},
            coords={name: (name, values, self.coord_attrs[name]) for name, values in self.coords.items()},
            attrs=self.attrs,
        )


class UnknownNameError(KeyError):
    """A name does not exist. The text is shown without the quotes of `KeyError`."""

    def __str__(self) -> str:
        return str(self.args[0])


class Slices(dict[str, Slice]):
    """Slices of a render by name.

    Attributes
    ----------
    attrs
        Provenance: scene, seed, samples, devices, units.
    samples
        Number of samples of each camera pixel, (height, width).
    summary
        Statistics of the render: ``tiles``, ``samples``, ``rays``, ``discarded_samples``, ``wall_time_s``, ``complete``.
    """

    attrs: dict[str, Any]
    samples: npt.NDArray[np.uint32]
    summary: dict[str, Any]

    def __missing__(self, name: str) -> Slice:
        raise UnknownNameError(f"the render has no slice `{name}`; available: {', '.join(self)}")

    def __repr__(self) -> str:
        parts = [f"  {name!r}: {one!r}" for name, one in list(self.items())[:_SHOWN]]
        more = [f"  and {len(self) - _SHOWN} more"] if len(self) > _SHOWN else []
        return "\n".join([f"<pysunstone.Slices, {len(self)} slices", *parts, *more]) + ">"

    def _repr_html_(self) -> str:
        pictures = [picture for one in list(self.values())[:_SHOWN] for picture in one._pictures()]  # pyright: ignore[reportPrivateUsage]
        rows = [(name, one._shape()) for name, one in self.items()]  # pyright: ignore[reportPrivateUsage]
        return _display.block(f"{len(self)} slices", pictures, rows)


#: Maximum number of slices in the display of a render.
_SHOWN = 12


class Layers(dict[str, "npt.NDArray[Any]"]):
    """Ground-truth layers of a camera image: arrays by name, with the axes y and x first.

    Attributes
    ----------
    dims
        Names of the axes of every array: ``y, x``, then ``vector`` (world x, y, z) or ``wavelength``.
    labels
        Names of the objects and materials that the numbers in ``object`` and ``material`` stand for.
    attrs
        Unit and meaning of every layer.
    wavelengths_nm
        Vacuum wavelengths of ``albedo`` in nanometres.
    """

    dims: dict[str, tuple[str, ...]]
    labels: dict[str, list[str]]
    attrs: dict[str, dict[str, str]]
    wavelengths_nm: list[float]

    def __missing__(self, name: str) -> npt.NDArray[Any]:
        raise UnknownNameError(f"there is no layer `{name}`; available: {', '.join(self)}")

    def __repr__(self) -> str:
        height, width = self["depth"].shape
        return f"<pysunstone.Layers, {width} x {height}, {', '.join(self)}>"

    def to_xarray(self) -> Any:
        """Return an ``xarray.Dataset``; requires xarray. Labels are the attribute ``labels`` of their layers."""
        import xarray

        height, width = self["depth"].shape
        coords: dict[str, Any] = {"y": np.arange(height), "x": np.arange(width), "vector": ["x", "y", "z"]}
        coords["wavelength"] = ("wavelength", self.wavelengths_nm, {"units": "nm", "long_name": "vacuum wavelength"})
        labels = {name: {"labels": self.labels[name]} for name in self.labels}
        arrays = {name: (self.dims[name], values, {**self.attrs[name], **labels.get(name, {})}) for name, values in self.items()}
        return xarray.Dataset(arrays, coords=coords)


def layers(scene: Scene, *, rays: int = 4, through: bool = False) -> Layers:
    """Return the ground truth of every camera pixel: depth, position, normals, object, material and albedo, as `sunstone layers`.

    Parameters
    ----------
    scene
        The scene.
    rays
        Number of rays along each side of a pixel; 4 gives 16 rays per pixel.
    through
        Trace rays through smooth interfaces (glass, water, crystals), with refraction, and through sheets.

    Returns
    -------
    Layers
        Arrays by name: ``depth`` (metres along the ray), ``optical_length``, ``position``, ``geometric_normal``,
        ``shading_normal``, ``object``, ``copy``, ``material``, ``albedo`` and ``coverage``. Missing values are NaN or -1.
    """
    found = Layers()
    found.dims, found.labels, found.attrs, found.wavelengths_nm = {}, {}, {}, scene.wavelengths_nm
    for name, dims, units, meaning, labels, values in scene._native.layers(whole("rays", rays, 1, 64), through):  # pyright: ignore[reportPrivateUsage]
        found[name] = values
        found.dims[name] = tuple(dims)
        found.attrs[name] = {"units": units, "long_name": meaning}
        if labels is not None:
            found.labels[name] = labels
    return found


@dataclass(frozen=True)
class _Asked:
    spp: int | None
    replicates: int | None
    seed: int | None
    threads: int | None
    slices: list[str] | None


def _mesh(name: str, given: Any) -> Any:
    """Convert the arrays of a mesh for the extension."""
    parts: dict[str, Any]
    if isinstance(given, Mapping):
        parts = dict(given)  # pyright: ignore[reportUnknownArgumentType]
    else:
        parts = dict(zip(("vertices", "faces", "normals", "uvs"), given, strict=False))
    unknown = parts.keys() - {"vertices", "faces", "normals", "uvs"}
    if unknown or "vertices" not in parts or "faces" not in parts:
        raise InputError(f"mesh {name}: pass vertices and faces, and optionally normals and uvs")
    faces = plain(f"mesh {name}, faces", parts["faces"])
    if faces.dtype.kind not in "iu":
        raise InputError(f"mesh {name}, faces: the dtype is {faces.dtype}; give integers")
    if faces.size and (int(faces.min()) < 0 or int(faces.max()) > 0xFFFFFFFF):
        raise InputError(f"mesh {name}, faces: indices of vertices count from 0, up to 2³² - 1")

    def points(key: str) -> Any:
        values = parts.get(key)
        if values is None:
            return None
        array = plain(f"mesh {name}, {key}", values)
        if array.ndim != 2 or array.dtype.kind not in "fiu":
            raise InputError(f"mesh {name}, {key}: {array.dtype} of shape {array.shape}; give rows of real numbers")
        return np.asarray(array, np.float32)

    if faces.ndim != 2:
        raise InputError(f"mesh {name}, faces: the shape is {faces.shape}; give rows of 3 numbers")
    return points("vertices"), faces.astype(np.uint32), points("normals"), points("uvs")


def _image(given: Any) -> bytes:
    if isinstance(given, bytes):
        return given
    array = plain("image", given)
    if array.dtype != np.uint8:
        if array.dtype.kind not in "fiu":
            raise InputError(f"an image of dtype {array.dtype}; give uint8, or real numbers for linear values")
        if array.dtype.kind in "iu" and array.size and (array.min() < 0 or array.max() > 1):
            raise InputError(
                f"an image of dtype {array.dtype} with values up to {array.max()}; give uint8, "
                "or divide by the largest value of the dtype for linear values of 0 to 1"
            )
        array = array.astype(np.float32)
    return _native.encode_image(array)


def _variant(number: int | None) -> int | None:
    return None if number is None else whole("variant", number)


#: Maximum number of pixels of a camera image that is sketched.
_MOST_SKETCHED = 4_000_000


class Scene:
    """An immutable scene, ready to render. Create it with `load`, `from_toml`, `from_dict` or a `SceneBuilder`.

    Concurrent renders of the same scene run one after another. Renders of different scenes run in parallel.
    """

    def __init__(self, native: _native.Scene) -> None:
        self._native = native
        caution(f"{native.name}: {note}" for note in native.notes)

    @classmethod
    def load(cls, path: Path, variant: int | None = None) -> Scene:
        """Read a scene file.

        Parameters
        ----------
        path
            Scene file (TOML).
        variant
            Number of a variant, if the file has ``[vary]``.

        Raises
        ------
        InputError
            With file, line, column and fix.
        """
        return cls(_native.Scene.load(path, _variant(variant)))

    @classmethod
    def from_toml(cls, text: str, folder: Path = ".", variant: int | None = None) -> Scene:
        """Parse the text of a scene file as ``scene.toml`` in ``folder``; errors as for `load`."""
        return cls(_native.Scene.from_toml(text, os.path.join(folder, "scene.toml"), _variant(variant)))

    @classmethod
    def from_dict(
        cls,
        document: Mapping[str, Any],
        *,
        folder: Path = ".",
        meshes: Mapping[str, Any] | None = None,
        images: Mapping[str, Any] | None = None,
    ) -> Scene:
        """Create a scene from a dict with the keys of a scene file.

        Parameters
        ----------
        document
            Content of a scene file. NumPy numbers and arrays are allowed; None counts as a missing key.
        folder
            Base of relative paths.
        meshes
            Meshes in memory, by the names that objects refer to (``{"ply": {"file": NAME}}``): ``(vertices, faces)``,
            ``(vertices, faces, normals, uvs)`` or a dict of these; vertices (n, 3) in metres, faces (m, 3) integers from 0.
        images
            Images in memory, by the names that textures and slices refer to: uint8 (colours sRGB-encoded, unless the texture is
            ``raw``) or real numbers (linear), of shape (h, w) or (h, w, 3); or the bytes of an image file.

        Raises
        ------
        InputError
            The attribute ``file`` states the location: ``scene in code: objects[0].material``.
        """
        return cls(
            _native.Scene.from_json(
                json_of(document),
                folder,
                [(name, _mesh(name, mesh)) for name, mesh in (meshes or {}).items()],
                [(name, _image(image)) for name, image in (images or {}).items()],
            )
        )

    def variant(self, number: int) -> Scene:
        """Return a variant of the scene, which must have a table ``vary``; also of a variant.

        Raises
        ------
        InputError
            If the variant does not exist.
        """
        return Scene(self._native.variant_of(whole("variant", number)))

    @property
    def materials(self) -> list[str]:
        """Names of the materials."""
        return self._native.materials

    @property
    def objects(self) -> list[str]:
        """Names of the objects."""
        return self._native.objects

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self._native.name

    @property
    def text(self) -> str:
        """The scene file as TOML."""
        return self._native.text

    @property
    def sha256(self) -> str:
        """Hash of the scene's content; renders with equal hashes can be merged."""
        return self._native.sha256

    @property
    def notes(self) -> list[str]:
        """Notes about the scene file, such as unused contents and corrections."""
        return self._native.notes

    @property
    def slices(self) -> list[str]:
        """Names of the slices of T that a render keeps."""
        return self._native.slices

    @property
    def wavelengths_nm(self) -> list[float]:
        """Vacuum wavelengths in nanometres."""
        return self._native.wavelengths_nm

    @property
    def resolution(self) -> tuple[int, int]:
        """Width and height of the camera's image in pixels."""
        return self._native.resolution

    @property
    def spp(self) -> int:
        """Samples per camera pixel."""
        return self._native.spp

    @property
    def seed(self) -> int:
        """Seed of the random numbers."""
        return self._native.seed

    def __repr__(self) -> str:
        width, height = self.resolution
        return f"<pysunstone.Scene {self.name!r}, {width} x {height}, slices {', '.join(self.slices)}>"

    def _repr_html_(self) -> str:
        rows = self._native.description()
        for what, names in (("materials", self.materials), ("objects", self.objects)):
            rows.append((what, f"{len(names)}: {', '.join(names[:_SHOWN])}" + (", ..." if len(names) > _SHOWN else "")))
        rows += [("note", note) for note in self.notes]
        width, height = self.resolution
        pictures = [_display.picture(self._sketch(), "sketch, without shadows")] if width * height <= _MOST_SKETCHED else []
        return _display.block(f"Scene {self.name}", pictures, rows)

    def _sketch(self) -> npt.NDArray[np.uint8]:
        """Return an image of the visible surfaces, lit from the camera, (rows, columns, 3)."""
        seen = layers(self, rays=1)
        away = np.asarray(self._native.camera_origin, np.float32) - seen["position"]
        with np.errstate(invalid="ignore"):
            away /= np.linalg.norm(away, axis=-1, keepdims=True)
            facing = np.abs((away * seen["shading_normal"]).sum(-1))
        # Metals and glass have no albedo.
        albedo = np.nan_to_num(seen["albedo"], nan=0.6)
        image = albedo * facing[..., None]
        return _display.to_rgb(image, ("y", "x", "wavelength"), self.wavelengths_nm, 1.0, False)

    def render(
        self,
        output: Path | None = None,
        *,
        spp: int | None = None,
        replicates: int | None = None,
        seed: int | None = None,
        threads: int | None = None,
        slices: Sequence[str] | str | None = None,
        resume: bool = False,
        force: bool = False,
        progress: bool | Progress | None = None,
    ) -> Any:
        """Render slices of T with standard errors.

        The same scene, seed and samples give bit-identical arrays and stores for any number of threads, from Python and from the
        command. Other Python threads keep running. After Ctrl-C, the current tiles are finished, and ``KeyboardInterrupt`` is
        raised. An exception in ``progress`` has the same effect and is raised again. A stopped store can be resumed.

        Parameters
        ----------
        output
            Zarr store to write, a folder or an address (``s3://``, ``gs://``, ``az://``). None: return arrays in memory.
        spp, replicates, seed
            Samples per camera pixel, minimum number of independent groups of samples, and random seed; by default those of the
            scene.
        threads
            Number of worker threads; by default one per core.
        slices
            Names of the slices to keep; by default all.
        resume, force
            Resume an unfinished store; replace a store. Only with ``output``.
        progress
            True for a bar (of tqdm, if installed), or a function that is called with the finished and total number of tiles.

        Returns
        -------
        Slices or dict
            `Slices` by name. With ``output``, the statistics ``complete``, ``tiles``, ``samples``, ``rays``, ``wall_time_s``.

        Raises
        ------
        InputError
            If the scene keeps no slices, or the store exists or belongs to another render.
        RenderError
            If the render fails, for example because the disk is full or threads cannot start.
        """
        names = [slices] if isinstance(slices, str) else None if slices is None else list(slices)
        asked = _Asked(
            None if spp is None else whole("spp", spp, 1, 2**30),
            None if replicates is None else whole("replicates", replicates, 1, 2**30),
            None if seed is None else whole("seed", seed),
            None if threads is None else whole("threads", threads, 1),
            names,
        )
        if output is None:
            if resume or force:
                raise InputError("resume and force apply only to a store: pass output")
            with reporting(progress) as tell:
                found = _slices(_native.render_arrays(self._native, asked, tell), self.resolution)
            caution(found.summary.pop("cautions"))
            return found
        if resume and force:
            raise InputError("pass either resume or force")
        with reporting(progress) as tell:
            summary = json.loads(_native.render_store(self._native, asked, output, resume, force, tell))
        caution(summary.pop("cautions"))
        return summary


def _slices(native: dict[str, Any], resolution: tuple[int, int]) -> Slices:
    found = Slices()
    for name, attributes, fields in native["slices"]:
        coords: dict[str, npt.NDArray[np.float64]] = {}
        coord_attrs: dict[str, dict[str, str]] = {}
        for axis, units, long_name, values in fields["mean"][0]:
            coords[axis] = values
            coord_attrs[axis] = {"units": units, "long_name": long_name}
        dims = {field_name: tuple(axis[0] for axis in axes) for field_name, (axes, _, _) in fields.items()}
        arrays = {field_name: values for field_name, (_, values, _) in fields.items()}
        found[name] = Slice(name, dims["mean"], coords, arrays, dims, json.loads(attributes), coord_attrs)
    width, height = resolution
    found.attrs = json.loads(native["attributes"])
    found.samples = native["samples"].reshape(height, width)
    found.summary = json.loads(native["summary"])
    return found

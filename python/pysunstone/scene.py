"""Scenes, and their renders."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from pysunstone import _native
from pysunstone._arrays import plain
from pysunstone._documents import json_of
from pysunstone._native import InputError
from pysunstone._progress import Progress, told

__all__ = ["Scene", "Slice", "Slices"]

Path = str | os.PathLike[str]


@dataclass(frozen=True)
class Slice:
    """One slice of the tensor T(s, s', p, p', t), with its error bars.

    Attributes
    ----------
    name
        As in the scene.
    dims
        Names of the axes of ``arrays["mean"]``, of ``y, x, v, u, t, bounces, component, label, stokes_out, stokes_in, wavelength``
        those that the slice resolves, in this order.
    coords
        Coordinates along every axis: pixels, picoseconds (bin centres), nanometres, plain numbers.
    arrays
        ``mean`` and ``std_error`` (float32, over ``dims``); with time bins ``overflow`` and ``overflow_std_error``, the light outside
        them; ``total_std_error`` (y, x), that of M00 summed over all else. The numbers of a store, to the bit.
    array_dims
        Names of the axes of every array.
    attrs
        What a store notes of the slice.
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
        """The array of a name."""
        return self.arrays[name]

    def to_xarray(self) -> Any:
        """As an ``xarray.Dataset`` without a copy; needs xarray."""
        import xarray

        return xarray.Dataset(
            {name: (self.array_dims[name], values) for name, values in self.arrays.items()},
            coords={name: (name, values, self.coord_attrs[name]) for name, values in self.coords.items()},
            attrs=self.attrs,
        )


class Slices(dict[str, Slice]):
    """Slices by name, as a render made them.

    Attributes
    ----------
    attrs
        Provenance: scene, seed, samples, devices, units.
    samples
        How many samples of each camera pixel count, (height, width).
    summary
        What the render did: ``tiles``, ``samples``, ``rays``, ``discarded_samples``, ``wall_time_s``, ``complete``.
    """

    attrs: dict[str, Any]
    samples: npt.NDArray[np.uint32]
    summary: dict[str, Any]


@dataclass(frozen=True)
class _Asked:
    spp: int | None
    replicates: int | None
    seed: int | None
    threads: int | None
    slices: list[str] | None


def _mesh(name: str, given: Any) -> Any:
    """Arrays of a mesh as the extension takes them."""
    parts: dict[str, Any]
    if isinstance(given, Mapping):
        parts = dict(given)  # pyright: ignore[reportUnknownArgumentType]
    else:
        parts = dict(zip(("vertices", "faces", "normals", "uvs"), given, strict=False))
    unknown = parts.keys() - {"vertices", "faces", "normals", "uvs"}
    if unknown or "vertices" not in parts or "faces" not in parts:
        raise InputError(f"mesh {name}: give vertices and faces, and perhaps normals and uvs")
    faces = plain(f"mesh {name}, faces", parts["faces"])
    if faces.dtype.kind not in "iu":
        raise InputError(f"mesh {name}, faces: their dtype is {faces.dtype}; give integers")
    if faces.size and (int(faces.min()) < 0 or int(faces.max()) > 0xFFFFFFFF):
        raise InputError(f"mesh {name}, faces: numbers of vertices count from 0")

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
                f"an image of dtype {array.dtype} up to {array.max()}; give uint8, or divide by the largest value for linear values of 0 to 1"
            )
        array = array.astype(np.float32)
    return _native.encode_image(array)


class Scene:
    """A scene, ready to render. Made by `load`, `from_toml`, `from_dict` or a `SceneBuilder`; it does not change.

    Renders of one scene wait for each other; of different scenes they run at once.
    """

    def __init__(self, native: _native.Scene) -> None:
        self._native = native

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
        return cls(_native.Scene.load(path, variant))

    @classmethod
    def from_toml(cls, text: str, folder: Path = ".", variant: int | None = None) -> Scene:
        """Make a scene of the text of its file, as if it stood in ``folder`` as ``scene.toml``; raises as `load`."""
        return cls(_native.Scene.from_toml(text, os.path.join(folder, "scene.toml"), variant))

    @classmethod
    def from_dict(
        cls,
        document: Mapping[str, Any],
        *,
        folder: Path = ".",
        meshes: Mapping[str, Any] | None = None,
        images: Mapping[str, Any] | None = None,
    ) -> Scene:
        """Make a scene of a dict with the keys of a scene file.

        Parameters
        ----------
        document
            What a scene file says; numbers and arrays of NumPy are welcome, None is as if left out.
        folder
            Where relative paths begin.
        meshes
            Meshes in memory by the names under which objects know them (``{"ply": {"file": NAME}}``): ``(vertices, faces)``,
            ``(vertices, faces, normals, uvs)`` or a dict of these; (n, 3) metres, (m, 3) integers from 0.
        images
            Images in memory by the names under which textures and slices know them: uint8 (colours sRGB-encoded, unless the texture
            says ``raw``) or real numbers (linear), of shape (h, w) or (h, w, 3); or the bytes of a file.

        Raises
        ------
        InputError
            ``file`` names the place: ``scene in code: objects[0].material``.
        """
        return cls(
            _native.Scene.from_json(
                json_of(document),
                folder,
                [(name, _mesh(name, mesh)) for name, mesh in (meshes or {}).items()],
                [(name, _image(image)) for name, image in (images or {}).items()],
            )
        )

    @property
    def name(self) -> str:
        """Short name."""
        return self._native.name

    @property
    def text(self) -> str:
        """Its file as TOML."""
        return self._native.text

    @property
    def sha256(self) -> str:
        """Hash of all that it means; two renders can be merged if they have one."""
        return self._native.sha256

    @property
    def notes(self) -> list[str]:
        """What its author should know."""
        return self._native.notes

    @property
    def slices(self) -> list[str]:
        """Names of what is kept of T."""
        return self._native.slices

    @property
    def wavelengths_nm(self) -> list[float]:
        """Vacuum wavelengths, nanometres."""
        return self._native.wavelengths_nm

    @property
    def resolution(self) -> tuple[int, int]:
        """Width and height of the camera's image."""
        return self._native.resolution

    @property
    def spp(self) -> int:
        """Samples per camera pixel."""
        return self._native.spp

    @property
    def seed(self) -> int:
        """Random seed."""
        return self._native.seed

    def __repr__(self) -> str:
        width, height = self.resolution
        return f"<pysunstone.Scene {self.name!r}, {width} x {height}, slices {', '.join(self.slices)}>"

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
        """Render slices of T, with error bars.

        The same scene, seed and samples give the same bits, whatever the number of threads, into arrays and stores, by Python and by
        the command. Python goes on beside it. Ctrl-C finishes the tiles in flight and raises ``KeyboardInterrupt``; so does an
        exception of ``progress``, which is raised. A store can then be resumed.

        Parameters
        ----------
        output
            Zarr store to write, a folder or an address (``s3://``, ``gs://``, ``az://``); None: arrays in memory.
        spp, replicates, seed
            Samples per camera pixel, least number of independent groups of them, and random seed, instead of the scene's.
        threads
            Worker threads; None: as many as cores.
        slices
            Names of the slices to keep; None: all.
        resume, force
            Go on with an unfinished store; replace one. Only with ``output``.
        progress
            True for a bar (of tqdm, if it is there), or a function that is called with tiles done and tiles in all.

        Returns
        -------
        Slices or dict
            `Slices` by name; of a store, what was done: ``complete``, ``tiles``, ``samples``, ``rays``, ``wall_time_s``.

        Raises
        ------
        InputError
            The scene keeps nothing, or the store is there already, or is not of this render.
        RenderError
            A full disk, no threads.
        """
        names = [slices] if isinstance(slices, str) else None if slices is None else list(slices)
        asked = _Asked(spp, replicates, seed, threads, names)
        if output is None:
            if resume or force:
                raise InputError("resume and force are for stores: give an output")
            with told(progress) as tell:
                return _slices(_native.render_arrays(self._native, asked, tell), self.resolution)
        if resume and force:
            raise InputError("give resume or force, not both")
        with told(progress) as tell:
            return json.loads(_native.render_store(self._native, asked, output, resume, force, tell))


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

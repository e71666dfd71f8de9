"""Imports Mitsuba 3 scenes: dicts as for ``mi.load_dict``, XML and JSON."""

# pyright: basic
from __future__ import annotations

import json
import math
import os
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pysunstone import _native
from pysunstone._arrays import plain, real
from pysunstone._native import InputError
from pysunstone.scene import Scene

__all__ = ["from_mitsuba"]

#: Lists that Mitsuba accepts as strings.
_LISTS = {("irregular", "wavelengths"), ("irregular", "values"), ("regular", "values")}
#: Plugins that read an image, with the keys of an image in memory.
_IMAGES = {"bitmap": ("bitmap", "data"), "envmap": ("bitmap",)}


def from_mitsuba(
    scene: Mapping[str, Any] | str | os.PathLike[str],
    *,
    folder: str | os.PathLike[str] | None = None,
    parameters: Mapping[str, Any] | None = None,
    wavelengths_nm: Sequence[float] | None = None,
    projector_resolution: tuple[int, int] | None = None,
) -> Scene:
    """Import a scene of Mitsuba 3, as `sunstone import`.

    Parameters
    ----------
    scene
        A dict as for ``mi.load_dict``, which may contain transforms, arrays, bitmaps and meshes of Mitsuba; the path of an XML
        file or of a dict as JSON; or the text of one. A scene that Mitsuba has already loaded does not expose its description.
    folder
        Base of relative paths in a dict or text; by default the working folder. A file uses its own folder.
    parameters
        Values of ``$name`` in XML, as for Mitsuba's ``-D``.
    wavelengths_nm
        Wavelengths of the scene, 1 to 4, increasing; by default 450, 550, 660. RGB colours are converted to values at these
        wavelengths: red above 590 nm, green from 500 to 590 nm, blue below 500 nm.
    projector_resolution
        Resolution of a projector whose image does not define it.

    Returns
    -------
    Scene
        A scene with one slice, ``mueller``. Properties that change in the conversion are reported as warnings.

    Raises
    ------
    InputError
        Lists everything that Sunstone cannot express, each with its key (``box.bsdf.reflectance``) or line, and the fix.
    """
    given = {key: _word(value) for key, value in (parameters or {}).items()}
    if wavelengths_nm is not None:
        given["wavelengths_nm"] = ", ".join(f"{float(w):.17g}" for w in wavelengths_nm)
    if projector_resolution is not None:
        given["projector_resolution"] = "{}, {}".format(*projector_resolution)
    files: dict[str, bytes] = {}
    places: list[str] | None = None
    notes: list[str] = []
    if isinstance(scene, Mapping):
        reported = _Dict(files, notes)
        plain = reported.plain(scene, "")
        places = []
        text = _lines(plain, places)
        path = os.path.join(folder or ".", "scene in a dict")
    elif isinstance(scene, str | os.PathLike):
        name = os.fspath(scene)
        if isinstance(name, str) and name.lstrip()[:1] in ("<", "{"):
            text, path = name, os.path.join(folder or ".", "scene in a text")
        elif folder is not None:
            raise InputError("folder: a file uses its own folder; omit this argument")
        else:
            path = os.fspath(name)
            try:
                text = Path(path).read_text(encoding="utf-8")
            except (OSError, UnicodeDecodeError) as e:
                raise InputError(f"cannot read {path}: {e}; give the path of an XML file of Mitsuba 3, or a dict") from e
    else:
        raise InputError(
            f"a {_type(scene)} does not expose its description; give the dict of `mi.load_dict`, or the path of the XML file"
        )
    made, told_notes, faults = _native.import_mitsuba(text, path, given, list(files.items()))
    if made is None:
        raise _error(faults, places)
    for note in [*notes, *told_notes]:
        warnings.warn(note, stacklevel=2)
    return Scene(made)


def _word(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _type(value: Any) -> str:
    kind = type(value)
    return kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"


_Fault = tuple[str, "int | None", "int | None", str, "str | None"]


def _error(faults: Sequence[_Fault], places: Sequence[str] | None) -> InputError:
    """Return one error that lists all faults; its attributes are those of the first fault."""

    def where(fault: _Fault) -> str:
        file, line, column, _, _ = fault
        if places is not None:
            key = places[line - 1] if line is not None and line <= len(places) else ""
            return key or "the dict"
        return file if line is None else f"{file}:{line}:{column}"

    said = [f"{where(f)}: {f[3]}" + (f"; {f[4]}" if f[4] else "") for f in faults]
    error = InputError("\n".join(said))
    if faults:
        error.file = where(faults[0]) if places is not None else faults[0][0]
        error.line, error.column = (None, None) if places is not None else faults[0][1:3]
        error.message, error.fix = faults[0][3], faults[0][4]
    return error


class _Dict:
    """Converts a dict to JSON types."""

    def __init__(self, files: dict[str, bytes], notes: list[str]) -> None:
        self._files = files
        self._notes = notes

    def plain(self, value: Any, at: str) -> Any:
        if isinstance(value, Mapping):
            return self._mapping(value, at)
        if isinstance(value, bool | str) or value is None:
            return value
        if isinstance(value, int | float | np.generic) and np.ndim(value) == 0:
            return self._number(value, at)
        if isinstance(value, list | tuple):
            return [self.plain(v, at) for v in value]
        if _is(value, "Transform"):
            transform: Any = value
            return self._matrix(transform.matrix, at)
        if _is(value, "Mesh"):
            return self._mesh(value, at)
        if isinstance(value, os.PathLike):
            return os.fspath(value)
        return self._array(value, at)

    def _number(self, value: Any, at: str) -> Any:
        number = value.item() if isinstance(value, np.generic) else value
        if isinstance(number, float) and not math.isfinite(number):
            raise _refused(at, f"it is {number}", "give a finite number")
        return number

    def _mapping(self, value: Mapping[Any, Any], at: str) -> dict[str, Any]:
        for key in value:
            if not isinstance(key, str):
                raise _refused(at, f"its key {key!r} is not a string", "use strings")
        kind = value.get("type")
        out: dict[str, Any] = {}
        for key, inner in value.items():
            below = f"{at}.{key}" if at else key
            if isinstance(kind, str) and key in _IMAGES.get(kind, ()) and not isinstance(inner, str):
                if "filename" in value:
                    raise _refused(below, "there is also a `filename`", "give only one of them")
                out["filename"] = self._image(inner, below)
            elif (kind, key) in _LISTS and not isinstance(inner, str):
                out[key] = ", ".join(f"{v:.17g}" for v in np.ravel(np.asarray(inner, np.float64)))
            else:
                out[key] = self.plain(inner, below)
        return out

    def _array(self, value: Any, at: str) -> Any:
        try:
            array = plain("an array", value)
            if array.dtype.kind not in "fiub":
                raise TypeError
        except (TypeError, ValueError, RuntimeError):
            raise _refused(
                at,
                f"a {_type(value)} does not expose its description",
                "give a number, a string, an array, a transform, a bitmap, a mesh, or the dict that it was loaded from",
            ) from None
        if not np.isfinite(array).all():
            raise _refused(at, "some of its numbers are not finite", "give finite numbers")
        if array.ndim <= 1 and array.size == 1:
            return array.reshape(()).item()
        # Arrays of Mitsuba's vectorized variants have an additional axis.
        if array.ndim > 1 and array.shape[-1] == 1:
            array = array[..., 0]
        return array.tolist()

    def _matrix(self, matrix: Any, at: str) -> Any:
        array = real("a transform", matrix, np.float64)
        if array.ndim == 3 and array.shape[-1] == 1:
            array = array[..., 0]
        if array.shape not in ((3, 3), (4, 4)):
            raise _refused(at, f"its matrix is of shape {array.shape}", "give one transform, 4 x 4 or 3 x 3")
        # Remove the rounding errors of products of rotations.
        last = np.eye(len(array))[-1]
        if np.allclose(array[-1], last, atol=1e-6):
            array[-1] = last
        return self._array(array, at)

    def _named(self, at: str, extension: str) -> str:
        base = "".join(c if c.isalnum() or c in "-_." else "_" for c in at) or "file"
        name, number = f"{base}{extension}", 1
        while name in self._files:
            number += 1
            name = f"{base}-{number}{extension}"
        return name

    def _image(self, value: Any, at: str) -> str:
        """Store an image in memory as a file and return the file's name."""
        gamma = bool(value.srgb_gamma()) if _is(value, "Bitmap") else False
        try:
            array: Any = plain("an image", value)
        except (TypeError, ValueError, RuntimeError):
            array = np.asarray(None)
        if array.dtype.kind not in "fiu" or array.ndim not in (2, 3):
            raise _refused(at, f"a {_type(value)} is not an image", "give a mi.Bitmap, or an array (rows, columns[, channels])")
        if array.ndim == 3 and array.shape[2] in (2, 4):
            self._notes.append(f"{at}: the last channel of the image (alpha) is not used")
            array = array[..., :-1]
        if array.ndim == 3 and array.shape[2] == 1:
            array = array[..., 0]
        if array.dtype.kind in "iu":
            largest = np.iinfo(array.dtype).max
            if array.dtype != np.uint8 or not gamma:
                array = array / largest
        if array.dtype == np.uint8:
            encoded, extension = _native.encode_image(np.ascontiguousarray(array)), ".png"
        else:
            linear = _linear(array) if gamma else array
            encoded, extension = _native.encode_image(np.ascontiguousarray(linear.astype(np.float32))), ".exr"
        name = self._named(at, extension)
        self._files[name] = encoded
        return name

    def _mesh(self, mesh: Any, at: str) -> dict[str, Any]:
        if _true(mesh, "is_emitter") or _true(mesh, "is_sensor"):
            raise _refused(
                at,
                "the mesh is an emitter or sensor and does not expose its parameters",
                "save it with write_ply, and give a dict of type `ply`",
            )
        with tempfile.TemporaryDirectory(prefix="pysunstone-") as folder:
            path = os.path.join(folder, "mesh.ply")
            mesh.write_ply(path)
            encoded = Path(path).read_bytes()
        name = self._named(at, ".ply")
        self._files[name] = encoded
        self._notes.append(
            f"{at}: a mesh does not expose its material; a diffuse one with albedo 0.5 is used. To change it, save the mesh with "
            'write_ply and give a dict {"type": "ply", "filename": ..., "bsdf": ...}'
        )
        return {"type": "ply", "filename": name, "face_normals": not _true(mesh, "has_vertex_normals")}


def _is(value: Any, kind: str) -> bool:
    """Return whether an object is of a Mitsuba class. Attributes are not tested, because Mitsuba's vectors have attributes for
    all names of swizzled components.
    """
    return any(of.__module__.startswith("mitsuba") and kind in of.__name__ for of in type(value).__mro__)


def _linear(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Convert sRGB values to linear values."""
    found: npt.NDArray[Any] = np.where(values <= 0.04045, values / 12.92, ((np.maximum(values, 0) + 0.055) / 1.055) ** 2.4)
    return found


def _true(of: Any, method: str) -> bool:
    found = getattr(of, method, None)
    return bool(found()) if callable(found) else False


def _refused(at: str, message: str, fix: str) -> InputError:
    error = InputError(f"{at or 'the dict'}: {message}; {fix}")
    error.file, error.message, error.fix = at or "the dict", message, fix
    return error


def _lines(value: Any, places: list[str]) -> str:
    """Return a dict as JSON with one key per line; ``places`` receives the key of every line."""
    out: list[str] = []

    def line(text: str, at: str) -> None:
        out.append(text)
        places.append(at)

    def write(before: str, value: Any, after: str, at: str) -> None:
        if not isinstance(value, dict):
            line(before + json.dumps(value, allow_nan=False) + after, at)
            return
        line(before + "{", at)
        items = list(value.items())
        for i, (key, inner) in enumerate(items):
            write(f"{json.dumps(key)}: ", inner, "," if i + 1 < len(items) else "", f"{at}.{key}" if at else key)
        line("}" + after, at)

    write("", value, "", "")
    return "\n".join(out)

"""Data sets for machine learning: variants of a scene in one Zarr store with an axis `sample`.

A scene with `[vary]` describes any number of scenes (docs/scene-files.md, variants); variant K is deterministic. A function can
also make the scenes. `make` renders the variants one after another into one store, and resumes after an interruption. `images`
reads the store for training.

Layout: one group per slice, with `mean` (and `std_error`) over `sample` and the slice's axes, and a group `layers` of ground truth
(depth, normals, ...) on request. A chunk holds one sample if a sample is smaller than 64 MiB. Coordinates along `sample` are `variant`, `seed` and every drawn parameter. `dataset.json` is the
manifest.
"""

# pyright: basic
from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import json
import os
import re
import shutil
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
import zarr
from zarr.errors import ZarrUserWarning

from ._documents import json_of
from ._native import InputError, RenderError
from .scene import Scene
from .scene import layers as layers_of
from .stores import NotAStoreError, StoreError, UnfinishedStoreError, open_store, pieces

__all__ = ["DatasetError", "make", "manifest", "open_dataset"]

_MANIFEST, _FORM = "dataset.json", 1
_OF_SAMPLES = ("variant", "seed")
#: Group of the ground-truth layers.
_LAYERS = "layers"
#: Units by the suffixes of names in scene files (CONVENTIONS.md).
_UNITS = {"deg": "degree", "nm": "nm", "ps": "ps", "px": "pixel", "mrad": "mrad", "mm": "mm", "um": "um"}


class DatasetError(StoreError):
    """A data set cannot be made or read. The text states the reason and the fix."""


def manifest(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the manifest of a data set: its settings (`settings`) and a description of every sample (`samples`).

    Raises
    ------
    NotAStoreError
        If the folder contains no data set.
    """
    file = Path(path, _MANIFEST)
    try:
        found = json.loads(file.read_text())
    except (FileNotFoundError, NotADirectoryError):
        raise NotAStoreError(f"{path} is not a data set: the file {_MANIFEST} is missing") from None
    except ValueError as e:
        raise DatasetError(f"{file} is not valid JSON: {e}") from None
    if not isinstance(found, dict) or found.get("form") != _FORM:
        raise DatasetError(f"{file} is not of form {_FORM}, the only form that this version of pysunstone reads: upgrade pysunstone, or make the data set again")
    return found


def _write_manifest(path: Path, content: dict[str, Any]) -> None:
    part = path / f".{_MANIFEST}.tmp"
    part.write_text(json.dumps(content, indent=1) + "\n")
    part.replace(path / _MANIFEST)


#: A scene file with `[vary]`, a scene, or a function that returns the scene of a variant (and the values of its parameters).
Variants = str | os.PathLike[str] | Scene | Callable[[int], Any]


def make(
    scene: Variants,
    output: str | os.PathLike[str],
    variants: Sequence[int] | int,
    *,
    slices: Sequence[str],
    layers: Sequence[str] = (),
    spp: int | None = None,
    seed: int = 0,
    std_error: bool = True,
    threads: int | None = None,
    keep: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Render variants of a scene into one data set.

    Existing samples are not rendered again. Repeat a stopped call to resume it, even within an unfinished render. A call with
    additional variants adds these to the data set.

    Parameters
    ----------
    scene
        Scene file with `[vary]`; a `Scene` (with `vary`, or the same scene with different noise in each sample); or a function
        that returns the `Scene` of a variant, given its number, or a tuple of the `Scene` and a dict of the values of its
        parameters. A function must return the same scene whenever it is called with the same number.
    output
        Folder of the data set. Renders stay in ``OUTPUT.parts`` until their samples are in the data set.
    variants
        Numbers of the variants, or the number of variants, which are then counted from 0.
    slices
        Slices of the scene to keep. Their axes must be the same in all variants.
    layers
        Ground-truth layers to keep in the group ``layers``, such as ``["depth", "shading_normal"]``; see `pysunstone.layers`.
    spp
        Samples per pixel; by default those of the scene.
    seed
        Variant K is rendered with the seed `seed` + K, so that all samples have different noise.
    std_error
        Also keep standard errors.
    threads
        Number of threads per render; by default one per core.
    keep
        Keep the stores of the single renders.
    progress
        Called after every sample with the finished and total number of samples.

    Returns
    -------
    pathlib.Path
        The data set. Read it with `open_dataset` or `MuellerImages`.

    Raises
    ------
    DatasetError
        If the folder contains a different data set, axes differ between variants, or a render fails.
    """
    numbers = list(range(variants)) if isinstance(variants, int) else [int(k) for k in variants]
    if not numbers or len(set(numbers)) < len(numbers) or min(numbers) < 0:
        raise DatasetError("variants: pass at least one number, all different and 0 or more")
    if not slices:
        raise DatasetError("slices: pass the name of at least one slice")
    if layers and _LAYERS in slices:
        raise DatasetError(f"slices: a slice with the name `{_LAYERS}` cannot be in a data set with layers; rename the slice")
    settings = {
        "slices": list(slices),
        "layers": list(layers),
        "fields": ["mean", "std_error"] if std_error else ["mean"],
        "spp": spp,
        "seed": seed,
    }
    with _locked(Path(output)):
        return _make(_Source.of(scene), Path(output), numbers, settings, threads, keep, progress)


@dataclass(frozen=True)
class _Source:
    """The scenes of a data set."""

    name: str
    #: Hash of the description of all variants; None for a function.
    sha256: str | None
    #: Dotted keys of the scene that the parameters set.
    places: dict[str, str]
    scene: Callable[[int], Any]

    @classmethod
    def of(cls, given: Variants) -> _Source:
        if isinstance(given, str | os.PathLike):
            path = Path(given)
            whole = Scene.load(path)
            return cls(path.name, hashlib.sha256(path.read_bytes()).hexdigest(), _places(whole), whole.variant)
        if isinstance(given, Scene):
            content = hashlib.sha256(f"{given.sha256} {given._native.source}".encode()).hexdigest()
            places = _places(given)
            return cls(given.name, content, places, given.variant if places else lambda k: given)
        if not callable(given):
            raise DatasetError(f"scene: got a {type(given).__name__}; pass a scene file, a Scene, or a function of the variant's number")
        return cls(getattr(given, "__name__", "function"), None, {}, given)

    def variant(self, number: int) -> tuple[Scene, dict[str, Any]]:
        """Return the scene of a variant, and the values of its parameters."""
        try:
            made = self.scene(number)
        except InputError as e:
            raise DatasetError(f"variant {number} of {self.name}: {e}") from None
        scene, values = made if isinstance(made, tuple) else (made, None)
        if not isinstance(scene, Scene):
            raise DatasetError(f"variant {number} of {self.name}: the function returned a {type(scene).__name__}; return a Scene")
        if values is None:
            values = {name: _value(text) for name, text in (scene._native.values or {}).items()}
        return scene, dict(values)


def _make(
    source: _Source,
    path: Path,
    numbers: list[int],
    settings: dict[str, Any],
    threads: int | None,
    keep: bool,
    progress: Callable[[int, int], None] | None,
) -> Path:
    settings = {"scene": source.name, "scene_file_sha256": source.sha256, **settings}
    content: dict[str, Any] = {"form": _FORM, "settings": settings, "places": source.places, "finished": False, "samples": []}
    if path.exists():
        content = manifest(path)
        # Data sets of earlier versions have no layers.
        content["settings"].setdefault("layers", [])
        for key, ours in settings.items():
            if content["settings"].get(key) != ours:
                raise DatasetError(
                    f"{path} was made with {key} {content['settings'].get(key)!r}, not {ours!r}: choose another output, or delete the data set"
                )
        if source.sha256 is None and content["samples"]:
            first = content["samples"][0]
            if source.variant(first["variant"])[0].sha256 != first["scene_sha256"]:
                raise DatasetError(
                    f"{path} was made from other scenes: the function returns a different scene for variant {first['variant']}; "
                    "choose another output, or delete the data set"
                )
        _sweep(path)
    order = [entry["variant"] for entry in content["samples"]]
    order += [k for k in numbers if k not in order]
    if len(order) > len(content["samples"]):
        path.mkdir(parents=True, exist_ok=True)
        content["finished"] = False
        _write_manifest(path, content)
    for index, variant in enumerate(order):
        if index >= len(content["samples"]):
            scene, values = source.variant(variant)
            entry, store = _rendered(source.name, scene, values, path, variant, settings, threads)
            _put(path, index, len(order), store, settings)
            if settings["layers"]:
                _put_layers(path, index, len(order), scene, settings["layers"])
            content["samples"].append(entry)
            # A sample belongs to the data set once the manifest lists it.
            _write_manifest(path, content)
            if not keep:
                shutil.rmtree(store)
        if progress is not None:
            progress(index + 1, len(order))
    if not content["finished"]:
        _finish(path, content)
    return path


def _sweep(path: Path) -> None:
    """Remove the temporary files that a killed Zarr process left."""
    for file in path.rglob("*.partial"):
        if re.fullmatch(r".*\.[0-9a-f]{32}\.partial", file.name):
            file.unlink(missing_ok=True)


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Lock the data set against other writers, on systems whose locks end with their process."""
    parts = _parts(path)
    parts.mkdir(parents=True, exist_ok=True)
    try:
        with (parts / ".lock").open("w") as file:
            if sys.platform != "win32":
                import fcntl

                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except OSError:
                    raise DatasetError(f"another process writes {path}: wait until it ends, or choose another output") from None
            yield
            (parts / ".lock").unlink()
    finally:
        # Keep the folder if it still contains renders.
        if not any(parts.iterdir()):
            parts.rmdir()


def _parts(path: Path) -> Path:
    return path.with_name(f"{path.name}.parts")


def _rendered(
    name: str, scene: Scene, values: dict[str, Any], path: Path, variant: int, settings: dict[str, Any], threads: int | None
) -> tuple[dict[str, Any], Path]:
    """Return the sample's manifest entry and the store of a variant, which is rendered if necessary."""
    store = _parts(path) / f"variant{variant}.zarr"
    seed = settings["seed"] + variant
    begun = time.monotonic()
    try:
        # `resume` has no effect on a finished store, and refuses the store of another scene.
        scene.render(store, spp=settings["spp"], seed=seed, threads=threads, slices=settings["slices"], resume=store.exists())
    except (InputError, RenderError) as e:
        raise DatasetError(f"variant {variant} of {name} was not rendered: {e}") from None
    attributes = open_store(store, chunks=None, slices=[]).attrs
    entry = {
        "variant": variant,
        "seed": seed,
        "values": json.loads(json_of(values)),
        "scene_sha256": attributes["scene_sha256"],
        "samples_per_pixel": attributes["samples_per_pixel"],
        "discarded_samples": attributes.get("discarded_samples", 0),
        "version": attributes.get("version"),
        "seconds": round(time.monotonic() - begun, 3),
    }
    return entry, store


def _value(text: str) -> Any:
    """Parse a value of a scene file to a number or a list of numbers; other values stay text."""
    try:
        return json.loads(text)
    except ValueError:
        return text


def _places(scene: Scene) -> dict[str, str]:
    """Return the dotted scene keys that the parameters set."""
    return {name: ", ".join(keys) for name, keys in scene._native.varied}


def _group(path: Path) -> zarr.Group:
    # The consolidated metadata describe the last finished state.
    return zarr.open_group(path, mode="a", zarr_format=3, use_consolidated=False)


def _put(path: Path, index: int, samples: int, store: Path, settings: dict[str, Any]) -> None:
    """Write a sample into a data set, which is created or extended to ``samples`` samples if necessary."""
    tree = open_store(store, chunks=None)
    root = _group(path)
    if "title" not in root.attrs:
        kept = ("title", "conventions", "camera", "projector", "version")
        origin: dict[str, Any] = {key: tree.attrs[key] for key in kept if key in tree.attrs}
        origin["settings"] = settings
        root.attrs.update(origin)
    for name in settings["slices"]:
        data = tree.children[name].to_dataset()
        group = root.require_group(name)
        if "projector_selection" not in group.attrs:
            group.attrs.update({k: v for k, v in data.attrs.items() if k not in ("camera", "projector")})
        _put_coordinates(group, data, name, first=index == 0)
        for field in settings["fields"]:
            values = data[field]
            _grown(group, field, values, samples)[index] = values.values


def _put_layers(path: Path, index: int, samples: int, scene: Scene, names: Sequence[str]) -> None:
    """Write the layers of a sample."""
    found = layers_of(scene)
    if unknown := [name for name in names if name not in found]:
        raise DatasetError(f"layers: unknown layer `{unknown[0]}`; available: {', '.join(found)}")
    data = found.to_xarray()
    # Zarr has no stable type of texts.
    data = data.assign_coords(vector=("vector", np.arange(3), {"units": "1", "long_name": "world coordinate", "labels": ["x", "y", "z"]}))
    for axis in ("y", "x"):
        data[axis].attrs.update(units="pixel", long_name=f"camera {'row' if axis == 'y' else 'column'} (pixel centre)")
    group = _group(path).require_group(_LAYERS)
    for name in names:
        values = data[name]
        for dim in map(str, values.dims):
            _put_coordinate(group, data[dim], _LAYERS, first=index == 0)
        array = _grown(group, name, values, samples)
        if found.labels.get(name) != array.attrs.get("labels"):
            raise DatasetError(
                f"layer `{name}`: variant {index} has other objects or materials than the first: give all variants the same names, or "
                "keep other layers"
            )
        array[index] = values.values


def _put_coordinates(group: zarr.Group, data: xr.Dataset, name: str, first: bool) -> None:
    """Write the axes of a slice with the first sample; for later samples, check that they are equal."""
    for dim in map(str, data["mean"].dims):
        _put_coordinate(group, data[dim], name, first)


def _put_coordinate(group: zarr.Group, coordinate: xr.DataArray, name: str, first: bool) -> None:
    dim = str(coordinate.dims[0])
    if first:
        # A killed call may have left these arrays without values.
        attributes = dict(coordinate.attrs)
        array = group.create_array(
            dim, shape=coordinate.shape, dtype=coordinate.dtype, dimension_names=[dim], attributes=attributes, overwrite=True
        )
        array[:] = coordinate.values
    elif not np.array_equal(_values(group, dim), coordinate.values):
        raise DatasetError(f"axis `{dim}` of slice `{name}` is not the same in all variants: keep slices whose axes are equal in all variants")


def _values(group: zarr.Group, name: str) -> npt.NDArray[Any]:
    array = group[name]
    assert isinstance(array, zarr.Array)
    return np.asarray(array[:])


def _grown(group: zarr.Group, field: str, values: xr.DataArray, samples: int) -> zarr.Array[Any]:
    """Return the array of a field with space for ``samples`` samples; unwritten entries are NaN (-1 for numbers)."""
    if field not in group:
        sizes = {d: n for d, n in values.sizes.items()}
        stored = dict(sizes) if values.nbytes <= 64 << 20 else values.encoding.get("preferred_chunks", dict(sizes))
        real = values.dtype.kind == "f"
        chunk = pieces(sizes, stored, values.dtype.itemsize)
        return group.create_array(
            field,
            shape=(samples, *values.shape),
            chunks=(1, *(chunk[d] for d in values.dims)),
            dtype="float32" if real else values.dtype,
            fill_value=float("nan") if real else -1,
            dimension_names=["sample", *map(str, values.dims)],
            attributes={key: values.attrs[key] for key in ("units", "long_name", "labels") if key in values.attrs},
        )
    array = group[field]
    assert isinstance(array, zarr.Array)
    if array.shape[0] < samples:
        array.resize((samples, *array.shape[1:]))
    return array


def _finish(path: Path, content: dict[str, Any]) -> None:
    """Write the coordinates of all samples and the consolidated metadata."""
    samples = content["samples"]
    root = _group(path)
    fields = {name: content["settings"]["fields"] for name in content["settings"]["slices"]}
    if content["settings"].get("layers"):
        fields[_LAYERS] = content["settings"]["layers"]
    for name in fields:
        group = root.require_group(name)
        for coordinate, (values, dims, attributes) in _coordinates(samples, content["places"]).items():
            array = group.create_array(
                coordinate, shape=values.shape, dtype=values.dtype, dimension_names=dims, attributes=attributes, overwrite=True
            )
            array[...] = values
        for field in fields[name]:
            # Mark them as coordinates for xarray (CF conventions).
            group[field].attrs["coordinates"] = " ".join([*_OF_SAMPLES, *samples[0]["values"]])
    with warnings.catch_warnings():
        # Zarr warns that the manifest is not an array, and that consolidated metadata are not part of format 3.
        warnings.simplefilter("ignore", ZarrUserWarning)
        zarr.consolidate_metadata(path, zarr_format=3)
    content["finished"] = True
    _write_manifest(path, content)


def _coordinates(
    samples: list[dict[str, Any]], places: dict[str, str]
) -> dict[str, tuple[npt.NDArray[Any], list[str], dict[str, Any]]]:
    """Return coordinates along `sample`: values, dimensions, attributes."""
    found: dict[str, tuple[npt.NDArray[Any], list[str], dict[str, Any]]] = {
        "sample": (np.arange(len(samples)), ["sample"], {"units": "1", "long_name": "sample"}),
        "variant": (np.array([s["variant"] for s in samples]), ["sample"], {"units": "1", "long_name": "variant of the scene"}),
        "seed": (np.array([s["seed"] for s in samples]), ["sample"], {"units": "1", "long_name": "random seed"}),
    }
    for name in samples[0]["values"]:
        values = [s["values"][name] for s in samples]
        place = places[name] if name in places else str(name)
        attributes: dict[str, Any] = {"units": _units(place), "long_name": place}
        try:
            numbers = np.array(values, dtype=float)
        except (TypeError, ValueError):
            # Names and other texts are stored as indices into `labels`.
            texts = [v if isinstance(v, str) else json.dumps(v) for v in values]
            labels = sorted(set(texts))
            found[name] = (np.array([labels.index(t) for t in texts]), ["sample"], {**attributes, "labels": labels})
            continue
        dims = ["sample", *(f"{name}_{axis}" for axis in range(1, numbers.ndim))]
        found[name] = (numbers, dims, attributes)
    return found


def _units(place: str) -> str:
    """Return the unit for the suffix of a name in a scene file; ``1`` if the name has no such suffix."""
    words = [word for word in place.replace('"', "").split(".") if not word.isdigit()]
    return _UNITS.get(words[-1].rsplit("_", 1)[-1], "1") if words else "1"


def open_dataset(path: str | os.PathLike[str], *, unfinished: bool = False, chunks: Any = "auto") -> xr.DataTree:
    """Open a data set as a tree with one node per slice, and a node ``layers`` if the data set has layers.

    Parameters
    ----------
    path
        Folder of the data set.
    unfinished
        Also open a data set with missing samples; missing samples are omitted.
    chunks
        ``"auto"``: Dask arrays whose chunks are the stored chunks, if Dask is installed. ``None``: Dask is not used.

    Raises
    ------
    UnfinishedStoreError
        If samples are missing in the data set.
    NotAStoreError
        If the folder contains no data set.
    """
    content = manifest(path)
    finished, samples = bool(content["finished"]), content["samples"]
    if not finished and not unfinished:
        raise UnfinishedStoreError(
            f"{path} is not finished: {len(samples)} samples exist; repeat the call of `make`, or pass unfinished=True"
        )
    lazily = chunks
    if chunks == "auto":
        lazily = {} if importlib.util.find_spec("dask") else None
    if finished:
        return xr.open_datatree(path, engine="zarr", chunks=lazily)
    # The coordinates of samples are written when all samples are finished.
    stale = ["sample", *_OF_SAMPLES, *(samples[0]["values"] if samples else ())]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ZarrUserWarning)
        tree = xr.open_datatree(path, engine="zarr", chunks=lazily, consolidated=False, drop_variables=stale)
    variants = ("sample", [s["variant"] for s in samples])

    def there(data: xr.Dataset) -> xr.Dataset:
        return data.isel(sample=slice(len(samples))).assign_coords(variant=variants) if "sample" in data.dims else data

    return tree.map_over_datasets(there)

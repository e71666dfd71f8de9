"""Stores of Sunstone as xarray trees.

A store is a Zarr v3 hierarchy with one group per slice. `xarray.open_datatree(path)` also opens it; `open_store` adds checks and
metadata. It refuses unfinished, damaged and foreign stores with a clear message. A missing chunk is an error instead of zeros.
Dask chunks follow the store's chunks. Every array carries the attributes that the accessor needs.
"""

# pyright: basic
from __future__ import annotations

import importlib
import importlib.util
import json
import math
import os
import struct
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import xarray as xr
from zarr.abc.store import ByteRequest, RangeByteRequest, Store, SuffixByteRequest
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import FsspecStore, LocalStore, WrapperStore

from .boxes import bins
from .shards import Shards, Tail

__all__ = [
    "DamagedStoreError",
    "NewerStoreError",
    "NotAStoreError",
    "StoreError",
    "UnfinishedStoreError",
    "open_store",
]

#: First words of a manifest, and the newest supported form.
_HEAD, _NEWEST = "sunstone manifest ", 1
_MANIFEST, _ROOT = "manifest.txt", "zarr.json"
#: Maximum size of a Dask chunk in bytes: several stored chunks, which have at most 8 MiB.
_PIECE = 64 << 20
#: Attributes copied from the root to each slice, and from a slice to each of its arrays.
_OF_SLICES = ("camera", "projector")
_OF_ARRAYS = ("projector_size", "projector_bin", "pixels_per_element", "projector_selection", "time_start_ps", "time_bin_ps")


class StoreError(ValueError):
    """A store cannot be opened. The text states the store, the reason and the fix."""


class NotAStoreError(StoreError):
    """The store does not exist, or Sunstone did not write it."""


class UnfinishedStoreError(StoreError):
    """A render or merge has not finished writing the store."""


class NewerStoreError(StoreError):
    """A newer version of Sunstone wrote the store in an unsupported form."""


class DamagedStoreError(StoreError):
    """A file does not match the manifest: it is missing, truncated or changed."""


@dataclass(frozen=True)
class _Entry:
    crc: int
    size: int


class _CheckedStore(WrapperStore[Store]):
    """A store whose files are checked against its manifest.

    Zarr reads a chunk without a file as zeros. This class requires that every file of the manifest exists with the listed size,
    and that every chunk ends with the checksum in the manifest. (Zarr's codec checks the bytes against that checksum.) For
    partial reads of a shard, the requested range is checked against the shard's tail, which is fetched once and kept.
    """

    def __init__(self, store: Store, name: str, entries: Mapping[str, _Entry], shards: Shards) -> None:
        super().__init__(store)
        self._name = name
        self._entries = entries
        self._shards = shards
        self._tails: dict[str, Tail] = {}

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        entry, chunks = self._entries.get(key), self._shards.chunks(key)
        if entry is not None and chunks is not None and byte_range is not None:
            return await self._part(key, entry, chunks, prototype, byte_range)
        found = await self._store.get(key, prototype, byte_range)
        if entry is None or byte_range is not None:
            return found
        if found is None:
            raise self._damaged(key, "is missing")
        same = len(found) == entry.size
        if same and chunks is not None:
            same = Tail(found[-Shards.tail_length(chunks) :].to_bytes(), chunks).checksum == entry.crc
        elif same and not key.endswith(_ROOT):
            same = found[-4:].to_bytes() == struct.pack("<I", entry.crc)
        if not same:
            raise self._damaged(key, "does not match the manifest")
        return found

    def _damaged(self, key: str, what: str) -> DamagedStoreError:
        return DamagedStoreError(f"{self._name}: {key} {what}: render the store again, or copy it again completely")

    async def _part(
        self, key: str, entry: _Entry, chunks: int, prototype: BufferPrototype, byte_range: ByteRequest
    ) -> Buffer:
        """Return some bytes of a shard."""
        tail = self._tails.get(key)
        if tail is None:
            length = Shards.tail_length(chunks)
            # The offset is valid only if the shard has the expected length.
            last = await self._store.get(key, prototype, RangeByteRequest(entry.size - length, entry.size + 1))
            if last is None:
                raise self._damaged(key, "is missing")
            if len(last) == entry.size:
                # Plain web servers may return only whole files.
                last = last[-length:]
            same = len(last) == length
            tail = Tail(last.to_bytes(), chunks) if same else None
            if tail is None or tail.checksum != entry.crc:
                raise self._damaged(key, "does not match the manifest")
            self._tails[key] = tail
        if isinstance(byte_range, SuffixByteRequest) and byte_range.suffix == len(tail.index):
            return prototype.buffer.from_bytes(tail.index)
        found = await self._store.get(key, prototype, byte_range)
        if found is None:
            raise self._damaged(key, "is missing")
        if isinstance(byte_range, RangeByteRequest):
            if len(found) == entry.size:
                found = found[byte_range.start : byte_range.end]
            fault = tail.fault(byte_range.start, byte_range.end, found.to_bytes())
            if fault:
                raise self._damaged(key, f"is damaged, {fault}")
        return found

    def _with_store(self, store: Store) -> _CheckedStore:
        # Zarr calls this to make read-only copies.
        return type(self)(store, self._name, self._entries, self._shards)

    def with_read_only(self, read_only: bool = False) -> _CheckedStore:
        return self._with_store(self._store.with_read_only(read_only))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _CheckedStore) and self._store == other._store

    def __hash__(self) -> int:
        return hash(self._name)


def open_store(
    path_or_url: str | os.PathLike[str],
    chunks: Literal["auto"] | Mapping[Hashable, int] | None = "auto",
    *,
    unfinished: bool = False,
    slices: list[str] | None = None,
) -> xr.DataTree:
    """Open a store that Sunstone wrote: slices, layers, or raw frames.

    Parameters
    ----------
    path_or_url
        A folder, or a URL that fsspec can read (``http://``, ``https://``, ``s3://``, ...; requires fsspec and its backend).
    chunks
        ``"auto"``: Dask arrays if Dask is installed, in pieces of whole stored chunks of up to 64 MiB. A mapping from dimensions
        to lengths: Dask chunks of these lengths. ``None``: Dask is not used. In all cases, data are read only when needed.
    unfinished
        Also open an unfinished store; elements that are not yet rendered are NaN.
    slices
        Names of the slices to open; by default all.

    Returns
    -------
    xarray.DataTree
        One node per slice, with `mean`, `std_error` and its other arrays over named dimensions with coordinates and units. The
        root's attributes hold the provenance (scene, seeds, samples, version), ``store`` and ``state``.

    Raises
    ------
    NotAStoreError
        If the path contains no store of Sunstone.
    UnfinishedStoreError
        If the store is not finished; the text states the progress.
    NewerStoreError
        If a newer version of Sunstone wrote the store.
    DamagedStoreError
        If files do not match the manifest. For damaged chunks, this exception is raised when they are read.

    Examples
    --------
    >>> room = open_store("out/mirror_room.zarr")            # doctest: +SKIP
    >>> room["xt/mean"].sel(wavelength=550, stokes_out=0, stokes_in=0)  # doctest: +SKIP
    """
    # Register the accessor only when a store is opened.
    importlib.import_module("pysunstone.accessor")
    location = _Location.of(path_or_url)
    attributes = _attributes(location)
    entries = _manifest(location)
    if entries is None and not unfinished:
        fix = "join all parts (`sunstone merge`)" if "part" in attributes else "let it finish (`sunstone render --resume`)"
        raise UnfinishedStoreError(
            f"{location.name} is not finished ({_state(location, attributes)}): {fix}, or open it with unfinished=True"
        )
    store = location.store()
    if entries is not None:
        store = _CheckedStore(store, location.name, entries, Shards.of(_description(location)))
    known = list(attributes.get("slices", []))
    if slices is not None and (strange := [s for s in slices if s not in known]):
        raise StoreError(f"{location.name} has no slice `{strange[0]}`; available slices: {', '.join(known)}")
    how: Any = {"engine": "zarr", "chunks": None, "consolidated": _is_consolidated(location), "cache": chunks is None}
    if slices is None:
        groups = xr.open_groups(cast(Any, store), **how)
    else:
        # Open only the requested slices, because opening a slice takes one request per axis.
        groups = {f"/{name}": xr.open_dataset(cast(Any, store), group=name, **how) for name in slices}
        groups["/"] = xr.open_dataset(cast(Any, store), **how)
    nodes = {}
    root = _without_camera(groups["/"])
    for name, data in groups.items():
        if name == "/":
            continue
        data = _told(data, name.strip("/"), attributes)
        if entries is None and "mean" in data:
            data = _hidden(data, root.get("samples"))
        nodes[name] = _cut(data, chunks)
    state = "finished" if entries is not None else "unfinished"
    nodes["/"] = _cut(root.assign_attrs(store=location.name, state=state), chunks)
    return xr.DataTree.from_dict(nodes, name=Path(location.name.rstrip("/")).name)


@dataclass(frozen=True)
class _Location:
    """Location of a store: a folder or a URL."""

    name: str
    remote: bool

    @classmethod
    def of(cls, path_or_url: str | os.PathLike[str]) -> _Location:
        name = os.fspath(path_or_url)
        # `C:\\...` is not a URL.
        return cls(name, "://" in name)

    def read(self, file: str) -> bytes | None:
        """Return the bytes of a file; ``None`` if it does not exist."""
        if not self.remote:
            try:
                return Path(self.name, file).read_bytes()
            except (FileNotFoundError, NotADirectoryError):
                return None
        import fsspec  # type: ignore[import-untyped]

        system, path = fsspec.url_to_fs(f"{self.name.rstrip('/')}/{file}")
        try:
            return bytes(system.cat_file(path))
        except FileNotFoundError:
            return None

    def store(self) -> Store:
        if self.remote:
            return FsspecStore.from_url(self.name.rstrip("/"), read_only=True)
        return LocalStore(self.name, read_only=True)


def _description(location: _Location) -> dict[str, Any]:
    text = location.read(_ROOT)
    if text is None:
        exists = location.remote or Path(location.name).exists()
        why = "it has no zarr.json" if exists else "there is nothing"
        raise NotAStoreError(f"{location.name} is not a store of Sunstone: {why}")
    try:
        found = json.loads(text)
    except ValueError as e:
        raise DamagedStoreError(f"{location.name}: {_ROOT} is not valid JSON: {e}") from None
    if not isinstance(found, dict):
        raise DamagedStoreError(f"{location.name}: {_ROOT} is not a JSON object")
    return found


def _attributes(location: _Location) -> dict[str, Any]:
    found = _description(location)
    if found.get("zarr_format") != 3:
        raise NewerStoreError(f"{location.name} is of Zarr format {found.get('zarr_format')}; only format 3 is supported")
    attributes = found.get("attributes")
    if not isinstance(attributes, dict) or not {"slices", "layers"} & attributes.keys():
        raise NotAStoreError(f"{location.name} is not a store of Sunstone: its zarr.json lists no slices and no layers")
    return attributes


def _is_consolidated(location: _Location) -> bool:
    return "consolidated_metadata" in _description(location)


def _manifest(location: _Location) -> dict[str, _Entry] | None:
    """Return the manifest's entries by path; ``None`` if the store is not finished."""
    found = location.read(_MANIFEST)
    if found is None:
        return None
    damaged = DamagedStoreError(f"{location.name}: {_MANIFEST} is damaged")
    try:
        lines = found.decode().splitlines()
        head = lines[0].removeprefix(_HEAD)
        version, count = head.split(":")
        number = int(version)
    except (ValueError, IndexError):
        raise damaged from None
    if number > _NEWEST:
        raise NewerStoreError(f"{location.name} is of form {number}, but this version of pysunstone reads forms up to {_NEWEST}: upgrade pysunstone")
    entries = {}
    try:
        # The last line is a checksum of the lines above.
        for line in lines[1:-1]:
            crc, size, path = line.split(" ", 2)
            entries[path] = _Entry(int(crc, 16), int(size))
        if not lines[-1].endswith(" lines above") or len(entries) != int(count.split()[0]):
            raise damaged
    except (ValueError, IndexError):
        raise damaged from None
    return entries


def _root(location: _Location) -> xr.Dataset:
    consolidated = _is_consolidated(location)
    return xr.open_dataset(cast(Any, location.store()), engine="zarr", chunks=None, consolidated=consolidated)


def _state(location: _Location, attributes: Mapping[str, Any]) -> str:
    """Return a description of the progress of an unfinished store."""
    words = [f"status `{attributes.get('status', 'unknown')}`"]
    try:
        samples = _root(location)["samples"]
        done = float((samples > 0).mean())
        words.append(f"{100 * done:.0f} % of the camera's pixels have samples")
    except (KeyError, OSError, ValueError):
        pass
    return ", ".join(words)


def _without_camera(root: xr.Dataset) -> xr.Dataset:
    """Rename the root's dimensions to names that no slice has. Stores of earlier versions call the dimensions of `samples` y and
    x.
    """
    if "samples" not in root:
        return root
    return root.rename({old: f"camera_{old}" for old in ("y", "x") if old in root["samples"].dims})


def _told(data: xr.Dataset, name: str, attributes: Mapping[str, Any]) -> xr.Dataset:
    """Add the attributes that a slice and its arrays need when they are separated from the tree."""
    data = data.assign_attrs(slice=name, **{key: attributes[key] for key in _OF_SLICES if key in attributes})
    reported = {key: data.attrs[key] for key in _OF_ARRAYS if key in data.attrs}
    for array in data.data_vars.values():
        array.attrs.update(reported, slice=name)
    return data


def _hidden(data: xr.Dataset, samples: xr.DataArray | None) -> xr.Dataset:
    """Set elements without samples to NaN, as `sunstone probe --partial`."""
    if samples is None or not {"y", "x"} <= set(data["mean"].dims):
        done: xr.DataArray | bool = False
    else:
        single = data.attrs.get("pixels_per_element", 1) == 1
        rows, columns = (bins(data[axis].values, 1 if single else None) for axis in ("y", "x"))
        counts = samples.values > 0
        # An element of a bin is finished if all of its pixels are.
        table = [[bool(counts[a : b + 1, c : d + 1].all()) for c, d in columns] for a, b in rows]
        done = xr.DataArray(np.array(table), dims=("y", "x"), coords={"y": data["y"], "x": data["x"]})
    return data.map(lambda array: array.where(done, np.nan).assign_attrs(array.attrs)).assign_attrs(data.attrs)


def _cut(data: xr.Dataset, chunks: Literal["auto"] | Mapping[Hashable, int] | None) -> xr.Dataset:
    """Convert the arrays to Dask arrays, in pieces of whole stored chunks."""
    if chunks is None:
        return data
    if chunks != "auto":
        return data.chunk({k: v for k, v in chunks.items() if k in data.dims})
    if importlib.util.find_spec("dask") is None or not data.data_vars:
        return data
    largest = max(data.data_vars.values(), key=lambda array: array.size)
    stored = _stored(largest)
    return data.chunk(pieces(dict(largest.sizes), stored, largest.dtype.itemsize))


def _stored(array: xr.DataArray) -> Mapping[Hashable, int]:
    """Return the shape of the stored pieces that are read as a whole.

    The shape is that of a chunk. For a sharded array, it is that of a shard, or of a chunk within the shards if a shard is too
    large.
    """
    for lengths in (array.encoding.get("shards"), array.attrs.get("unsharded_chunk")):
        if lengths:
            cut = {dim: min(n, length) for (dim, n), length in zip(array.sizes.items(), lengths, strict=True)}
            if math.prod(cut.values()) * array.dtype.itemsize <= _PIECE:
                return cut
    return array.encoding.get("preferred_chunks") or dict(array.sizes)


def pieces(sizes: Mapping[Hashable, int], stored: Mapping[Hashable, int], itemsize: int) -> dict[Hashable, int]:
    """Return the chunk lengths for Dask: multiples of the stored chunks, grown from the last dimension up to 64 MiB.

    Parameters
    ----------
    sizes, stored
        Lengths of the array and of its chunks by dimension, in the order of storage.
    itemsize
        Bytes per element.
    """
    lengths = {dim: min(stored.get(dim, n), n) for dim, n in sizes.items()}
    room = _PIECE // max(1, itemsize * math.prod(lengths.values()))
    for dim in reversed(list(sizes)):
        have = -(-sizes[dim] // lengths[dim])
        grow = max(1, min(room, have))
        lengths[dim] = min(lengths[dim] * grow, sizes[dim])
        room //= grow
    return lengths

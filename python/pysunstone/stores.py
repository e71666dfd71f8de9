"""Stores of Sunstone as trees of xarray.

A store is a Zarr v3 hierarchy with one group a slice. `xarray.open_datatree(path)` opens it too; what `open_store` adds is
that it knows what a store is: one that is unfinished, damaged or none is refused in words, a chunk that was lost is an error
and not zeros, arrays are cut for Dask along the store's own chunks, and every array carries what the accessor needs to know.
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

#: What a manifest begins with, and the newest one that is understood.
_HEAD, _NEWEST = "sunstone manifest ", 1
_MANIFEST, _ROOT = "manifest.txt", "zarr.json"
#: Bytes that a piece for Dask may have: several stored chunks, which have 8 MiB at most.
_PIECE = 64 << 20
#: Attributes of the root that a slice needs when it is alone, and of a slice that its arrays need.
_OF_SLICES = ("camera", "projector")
_OF_ARRAYS = ("projector_size", "projector_bin", "pixels_per_element", "projector_selection", "time_start_ps", "time_bin_ps")


class StoreError(ValueError):
    """A store cannot be opened; the text says which, why, and what fixes it."""


class NotAStoreError(StoreError):
    """There is nothing, or something that Sunstone did not write."""


class UnfinishedStoreError(StoreError):
    """A render or merge has not written all of it yet."""


class NewerStoreError(StoreError):
    """A newer Sunstone wrote it in a form that is not known here."""


class DamagedStoreError(StoreError):
    """A file is not what the manifest says: lost, cut short, or another one."""


@dataclass(frozen=True)
class _Entry:
    crc: int
    size: int


class _CheckedStore(WrapperStore[Store]):
    """A store whose files must be as its manifest says.

    Zarr takes a chunk without a file for zeros. Here a file that the manifest lists must be there, of its size, and a chunk must
    end with the checksum of its line (whether its bytes have that checksum, Zarr's codec checks). Of a shard some bytes are read, which
    its tail must tell of; that is fetched once and kept.
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
            raise self._damaged(key, "is lost")
        same = len(found) == entry.size
        if same and chunks is not None:
            same = Tail(found[-Shards.tail_length(chunks) :].to_bytes(), chunks).checksum == entry.crc
        elif same and not key.endswith(_ROOT):
            same = found[-4:].to_bytes() == struct.pack("<I", entry.crc)
        if not same:
            raise self._damaged(key, "is not what was written")
        return found

    def _damaged(self, key: str, what: str) -> DamagedStoreError:
        return DamagedStoreError(f"{self._name}: {key} {what}: render it again, or copy the store whole")

    async def _part(
        self, key: str, entry: _Entry, chunks: int, prototype: BufferPrototype, byte_range: ByteRequest
    ) -> Buffer:
        """Some bytes of a shard."""
        tail = self._tails.get(key)
        if tail is None:
            length = Shards.tail_length(chunks)
            # From a place that is right only if the shard is as long as it should be.
            last = await self._store.get(key, prototype, RangeByteRequest(entry.size - length, entry.size + 1))
            if last is None:
                raise self._damaged(key, "is lost")
            if len(last) == entry.size:
                # Plain web servers may know whole files alone.
                last = last[-length:]
            same = len(last) == length
            tail = Tail(last.to_bytes(), chunks) if same else None
            if tail is None or tail.checksum != entry.crc:
                raise self._damaged(key, "is not what was written")
            self._tails[key] = tail
        if isinstance(byte_range, SuffixByteRequest) and byte_range.suffix == len(tail.index):
            return prototype.buffer.from_bytes(tail.index)
        found = await self._store.get(key, prototype, byte_range)
        if found is None:
            raise self._damaged(key, "is lost")
        if isinstance(byte_range, RangeByteRequest):
            if len(found) == entry.size:
                found = found[byte_range.start : byte_range.end]
            fault = tail.fault(byte_range.start, byte_range.end, found.to_bytes())
            if fault:
                raise self._damaged(key, f"is damaged, {fault}")
        return found

    def _with_store(self, store: Store) -> _CheckedStore:
        # Zarr makes read-only copies so.
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
    """Open a store that Sunstone wrote: of slices, of layers, or of raw frames.

    Parameters
    ----------
    path_or_url
        A folder, or a URL that fsspec reads (``http://``, ``https://``, ``s3://``, ...; needs fsspec and what it needs for that).
    chunks
        ``"auto"``: arrays of Dask where Dask is installed, in pieces of whole stored chunks of up to 64 MiB. A mapping of names of
        dimensions to lengths: pieces of these. ``None``: no Dask. Nothing is read before it is asked for in any case.
    unfinished
        Open an unfinished store too: what is not rendered yet is NaN.
    slices
        Names of the slices to open; all without it.

    Returns
    -------
    xarray.DataTree
        A node a slice, with `mean`, `std_error` and what else it has over named dimensions with coordinates and units. The
        attributes of the root say where it came from (scene, seeds, samples, version), and ``store`` and ``state``.

    Raises
    ------
    NotAStoreError
        There is nothing, or something else.
    UnfinishedStoreError
        It is not finished; the text says how far it is.
    NewerStoreError
        A newer Sunstone wrote it.
    DamagedStoreError
        It is not what was written. Of chunks, this is raised when they are read.

    Examples
    --------
    >>> room = open_store("out/mirror_room.zarr")            # doctest: +SKIP
    >>> room["xt/mean"].sel(wavelength=550, stokes_out=0, stokes_in=0)  # doctest: +SKIP
    """
    # The accessor is there when there is something to access.
    importlib.import_module("pysunstone.accessor")
    location = _Location.of(path_or_url)
    attributes = _attributes(location)
    entries = _manifest(location)
    if entries is None and not unfinished:
        fix = "join all parts (`sunstone merge`)" if "part" in attributes else "let it finish (`sunstone render --resume`)"
        raise UnfinishedStoreError(
            f"{location.name} is not finished ({_state(location, attributes)}): {fix}, or read what there is with unfinished=True"
        )
    store = location.store()
    if entries is not None:
        store = _CheckedStore(store, location.name, entries, Shards.of(_description(location)))
    known = list(attributes.get("slices", []))
    if slices is not None and (strange := [s for s in slices if s not in known]):
        raise StoreError(f"{location.name} has no slice `{strange[0]}`; it has: {', '.join(known)}")
    how: Any = {"engine": "zarr", "chunks": None, "consolidated": _is_consolidated(location), "cache": chunks is None}
    if slices is None:
        groups = xr.open_groups(cast(Any, store), **how)
    else:
        # What is not asked for is not read: each slice takes a request an axis.
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
    """Where a store is: a folder or a URL."""

    name: str
    remote: bool

    @classmethod
    def of(cls, path_or_url: str | os.PathLike[str]) -> _Location:
        name = os.fspath(path_or_url)
        # `C:\\...` is no URL.
        return cls(name, "://" in name)

    def read(self, file: str) -> bytes | None:
        """The bytes of a file, ``None`` where there is none."""
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
        raise NotAStoreError(f"{location.name} is no store of Sunstone: {why}")
    try:
        found = json.loads(text)
    except ValueError as e:
        raise DamagedStoreError(f"{location.name}: {_ROOT} is no valid JSON: {e}") from None
    if not isinstance(found, dict):
        raise DamagedStoreError(f"{location.name}: {_ROOT} is no JSON object")
    return found


def _attributes(location: _Location) -> dict[str, Any]:
    found = _description(location)
    if found.get("zarr_format") != 3:
        raise NewerStoreError(f"{location.name} is of Zarr format {found.get('zarr_format')}; format 3 is known")
    attributes = found.get("attributes")
    if not isinstance(attributes, dict) or not {"slices", "layers"} & attributes.keys():
        raise NotAStoreError(f"{location.name} is no store of Sunstone: its zarr.json lists no slices and no layers")
    return attributes


def _is_consolidated(location: _Location) -> bool:
    return "consolidated_metadata" in _description(location)


def _manifest(location: _Location) -> dict[str, _Entry] | None:
    """Files by their paths; ``None`` where the store is not finished."""
    found = location.read(_MANIFEST)
    if found is None:
        return None
    damaged = DamagedStoreError(f"{location.name}: {_MANIFEST} is not what was written")
    try:
        lines = found.decode().splitlines()
        head = lines[0].removeprefix(_HEAD)
        version, count = head.split(":")
        number = int(version)
    except (ValueError, IndexError):
        raise damaged from None
    if number > _NEWEST:
        raise NewerStoreError(f"{location.name} is of form {number}; this pysunstone knows forms up to {_NEWEST}: install a newer one")
    entries = {}
    try:
        # The last line is a checksum of those above.
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
    """How far an unfinished store is, in words."""
    words = [f"status `{attributes.get('status', 'unknown')}`"]
    try:
        samples = _root(location)["samples"]
        done = float((samples > 0).mean())
        words.append(f"{100 * done:.0f} % of the camera's pixels have samples")
    except (KeyError, OSError, ValueError):
        pass
    return ", ".join(words)


def _without_camera(root: xr.Dataset) -> xr.Dataset:
    """The root with names of dimensions that no slice has: stores of earlier versions call those of `samples` y and x."""
    if "samples" not in root:
        return root
    return root.rename({old: f"camera_{old}" for old in ("y", "x") if old in root["samples"].dims})


def _told(data: xr.Dataset, name: str, attributes: Mapping[str, Any]) -> xr.Dataset:
    """The slice with what it and its arrays must know when they are alone."""
    data = data.assign_attrs(slice=name, **{key: attributes[key] for key in _OF_SLICES if key in attributes})
    told = {key: data.attrs[key] for key in _OF_ARRAYS if key in data.attrs}
    for array in data.data_vars.values():
        array.attrs.update(told, slice=name)
    return data


def _hidden(data: xr.Dataset, samples: xr.DataArray | None) -> xr.Dataset:
    """NaN where no sample was taken, as `sunstone probe --partial` has it."""
    if samples is None or not {"y", "x"} <= set(data["mean"].dims):
        done: xr.DataArray | bool = False
    else:
        single = data.attrs.get("pixels_per_element", 1) == 1
        rows, columns = (bins(data[axis].values, 1 if single else None) for axis in ("y", "x"))
        counts = samples.values > 0
        # Elements of bins are there when all their pixels are.
        table = [[bool(counts[a : b + 1, c : d + 1].all()) for c, d in columns] for a, b in rows]
        done = xr.DataArray(np.array(table), dims=("y", "x"), coords={"y": data["y"], "x": data["x"]})
    return data.map(lambda array: array.where(done, np.nan).assign_attrs(array.attrs)).assign_attrs(data.attrs)


def _cut(data: xr.Dataset, chunks: Literal["auto"] | Mapping[Hashable, int] | None) -> xr.Dataset:
    """The arrays as Dask's, in pieces of whole stored chunks."""
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
    """Lengths of what is best read together: a chunk; of an array in shards, a shard, or what was a chunk before where that is too much."""
    for lengths in (array.encoding.get("shards"), array.attrs.get("unsharded_chunk")):
        if lengths:
            cut = {dim: min(n, length) for (dim, n), length in zip(array.sizes.items(), lengths, strict=True)}
            if math.prod(cut.values()) * array.dtype.itemsize <= _PIECE:
                return cut
    return array.encoding.get("preferred_chunks") or dict(array.sizes)


def pieces(sizes: Mapping[Hashable, int], stored: Mapping[Hashable, int], itemsize: int) -> dict[Hashable, int]:
    """Lengths of pieces for Dask: multiples of the stored chunks, grown from the last dimension on up to 64 MiB.

    Parameters
    ----------
    sizes, stored
        Lengths of the array and of its chunks by dimension, in the order of storage.
    itemsize
        Bytes of an element.
    """
    lengths = {dim: min(stored.get(dim, n), n) for dim, n in sizes.items()}
    room = _PIECE // max(1, itemsize * math.prod(lengths.values()))
    for dim in reversed(list(sizes)):
        have = -(-sizes[dim] // lengths[dim])
        grow = max(1, min(room, have))
        lengths[dim] = min(lengths[dim] * grow, sizes[dim])
        room //= grow
    return lengths

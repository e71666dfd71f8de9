"""Sharded stores: their creation, and checks of partial reads against the manifest.

A shard is a file that contains many chunks, in the format of Zarr's codec ``sharding_indexed``: the last bytes are an index that
locates each chunk. Before this index, a shard of Sunstone contains the checksums of its chunks. The manifest contains a checksum
of both.
"""

# pyright: basic
from __future__ import annotations

import importlib
import math
import os
import struct
from collections.abc import Mapping
from typing import Any

from . import command

__all__ = ["Shards", "Tail", "shard"]

#: Bytes of a chunk's index entry, bytes of a checksum, and the value of both entry numbers for an absent chunk.
_PLACE, _SEAL, _NOWHERE = 16, 4, 2**64 - 1


def shard(store: str | os.PathLike[str], out: str | os.PathLike[str], *, force: bool = False) -> str:
    """Copy a store into shards, as the command `sunstone shard`.

    Parameters
    ----------
    store
        A finished store, a folder or an address (``s3://``, ``gs://``, ``az://``).
    out
        Folder or address to write.
    force
        Replace an existing store.

    Returns
    -------
    str
        The folder or address; open it with `open_store`.

    Raises
    ------
    pysunstone.command.CommandError
        With the command's message, if the store is not finished or already sharded, or if the output exists.

    Examples
    --------
    >>> shard("out/mirror_room.zarr", "s3://renders/room.zarr")  # doctest: +SKIP
    """
    place = os.fspath(out)
    command.run("shard", os.fspath(store), "-o", place, *(["--force"] if force else []))
    return place


def crc32c(data: bytes) -> int:
    """Return the CRC-32C checksum, from the library that Zarr uses."""
    return int(importlib.import_module("google_crc32c").value(data))


class Tail:
    """The last bytes of a shard, which locate its chunks."""

    def __init__(self, tail: bytes, chunks: int) -> None:
        self.index = tail[-(chunks * _PLACE + _SEAL) :]
        self.checksum = crc32c(tail[:-_SEAL])
        seals = struct.unpack_from(f"<{chunks}I", tail)
        places = struct.unpack_from(f"<{2 * chunks}Q", self.index)
        self._seals = {
            (start, start + size): seal
            for start, size, seal in zip(places[::2], places[1::2], seals, strict=True)
            if start != _NOWHERE
        }

    def fault(self, start: int, end: int, data: bytes) -> str | None:
        """Return a description of the fault in these bytes of the shard, or None. Zarr's codec checks each chunk itself."""
        seal = self._seals.get((start, end))
        if seal is None:
            return f"the shard has no chunk at bytes {start} to {end}"
        same = len(data) == end - start and data[-_SEAL:] == struct.pack("<I", seal)
        return None if same else f"the chunk at byte {start} does not match its checksum"


class Shards:
    """The number of chunks of each shard of a store."""

    def __init__(self, chunks: Mapping[str, int]) -> None:
        self._chunks = dict(chunks)

    @classmethod
    def of(cls, root: Mapping[str, Any]) -> Shards:
        """Create an object from the root's metadata, which contain the metadata of all arrays."""
        found = {}
        for node, json in root.get("consolidated_metadata", {}).get("metadata", {}).items():
            codec = (json.get("codecs") or [{}])[0]
            if codec.get("name") == "sharding_indexed":
                shard, chunk = json["chunk_grid"]["configuration"]["chunk_shape"], codec["configuration"]["chunk_shape"]
                found[node] = math.prod(s // c for s, c in zip(shard, chunk, strict=True))
        return cls(found)

    def chunks(self, key: str) -> int | None:
        """Return the number of chunks of a file; ``None`` if it is not a shard."""
        folder, _, name = key.rpartition("/")
        return self._chunks.get(folder) if name.startswith("c.") else None

    @staticmethod
    def tail_length(chunks: int) -> int:
        """Return the number of bytes of the tail of a shard with ``chunks`` chunks."""
        return chunks * (_SEAL + _PLACE) + _SEAL

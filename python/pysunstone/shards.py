"""Stores in shards: made, and held against their manifest though a few bytes of a file are read.

A shard is many chunks in one file, as Zarr's codec ``sharding_indexed`` has them: its last bytes say where each lies. Before these a
shard of Sunstone has the checksums of its chunks, and the manifest's line that of both.
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

#: Bytes of a chunk's place in the index, of its checksum, and both numbers of one that is not there.
_PLACE, _SEAL, _NOWHERE = 16, 4, 2**64 - 1


def shard(store: str | os.PathLike[str], out: str | os.PathLike[str], *, force: bool = False) -> str:
    """Copy a store into shards, by the command `sunstone shard`.

    Parameters
    ----------
    store
        A finished store, a folder or an address (``s3://``, ``gs://``, ``az://``).
    out
        Where to write: a folder or an address.
    force
        Replace a store that is there.

    Returns
    -------
    str
        Where it was written; `open_store` opens it.

    Raises
    ------
    pysunstone.command.CommandError
        With what the command says: that the store is not finished, is in shards already, or something is there.

    Examples
    --------
    >>> shard("out/mirror_room.zarr", "s3://renders/room.zarr")  # doctest: +SKIP
    """
    place = os.fspath(out)
    command.run("shard", os.fspath(store), "-o", place, *(["--force"] if force else []))
    return place


def crc32c(data: bytes) -> int:
    """The checksum CRC-32C, by what Zarr has it from."""
    return int(importlib.import_module("google_crc32c").value(data))


class Tail:
    """The last bytes of a shard, which tell of all others."""

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
        """What is wrong with these bytes of the shard, if anything. (Whether a chunk has its checksum, Zarr's codec checks.)"""
        seal = self._seals.get((start, end))
        if seal is None:
            return f"no chunk of it lies at bytes {start} to {end}"
        same = len(data) == end - start and data[-_SEAL:] == struct.pack("<I", seal)
        return None if same else f"its chunk at byte {start} is not what was written"


class Shards:
    """Which files of a store are shards, and of how many chunks."""

    def __init__(self, chunks: Mapping[str, int]) -> None:
        self._chunks = dict(chunks)

    @classmethod
    def of(cls, root: Mapping[str, Any]) -> Shards:
        """Of a root's description, which has those of all arrays."""
        found = {}
        for node, json in root.get("consolidated_metadata", {}).get("metadata", {}).items():
            codec = (json.get("codecs") or [{}])[0]
            if codec.get("name") == "sharding_indexed":
                shard, chunk = json["chunk_grid"]["configuration"]["chunk_shape"], codec["configuration"]["chunk_shape"]
                found[node] = math.prod(s // c for s, c in zip(shard, chunk, strict=True))
        return cls(found)

    def chunks(self, key: str) -> int | None:
        """How many chunks a file has; ``None`` of what is no shard."""
        folder, _, name = key.rpartition("/")
        return self._chunks.get(folder) if name.startswith("c.") else None

    @staticmethod
    def tail_length(chunks: int) -> int:
        """Bytes of the tail of a shard of so many chunks."""
        return chunks * (_SEAL + _PLACE) + _SEAL

"""Scenes that travel: with all files that they are made of, to workers that have none of them."""

# pyright: basic
from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any

from pysunstone._native import RenderError
from pysunstone.scene import Scene

__all__ = ["Luggage", "folder_of", "pack", "sent", "variant_of"]

#: How often a scene is sent again while workers die under it.
ATTEMPTS = 20


@dataclass(frozen=True)
class Luggage:
    """A scene's text and files, as they are unpacked into a folder.

    Attributes
    ----------
    file
        Scene file, below the folder. It lies so deep that what lies above it in the tree, as far as the scene names it, is in the
        folder as well; and its own folder is called as it was, since scenes without a name are called so.
    text
        What stands in it.
    files
        The files that the scene is made of, by their places in the folder.
    """

    file: str
    text: str
    files: Mapping[str, bytes] = field(repr=False)

    @property
    def key(self) -> str:
        """A name of all of it."""
        all_of_it = hashlib.sha256()
        for name, content in [(self.file, self.text.encode()), *sorted(self.files.items())]:
            for piece in (name.encode(), content):
                all_of_it.update(len(piece).to_bytes(8, "little") + piece)
        return all_of_it.hexdigest()

    def unpack(self, folder: Path) -> None:
        """Into a new folder, which appears whole or not at all."""
        if folder.exists():
            return
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(dir=folder.parent, prefix=".unpacking-"))
        try:
            for name, content in [(self.file, self.text.encode()), *self.files.items()]:
                path = fresh / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            try:
                fresh.rename(folder)
            except OSError:
                if not folder.exists():
                    raise
        finally:
            shutil.rmtree(fresh, ignore_errors=True)


def pack(scene: Scene) -> Luggage:
    """A scene with its files.

    Raises
    ------
    RenderError
        If it names a file by an absolute path.
    """
    native = scene._native
    path = Path(os.path.abspath(native.path))
    found = dict(native.files())
    absolute = next((name for name in found if os.path.isabs(name)), None)
    if absolute is not None:
        raise RenderError(
            f"{path}: it names {absolute}, by an absolute path, which workers without it cannot follow; name it from the scene's folder"
        )
    depth = max((PurePath(os.path.normpath(name)).parts.count("..") for name in found), default=0)
    own = Path(*["above"] * depth, path.parent.name or "scene")
    files = {os.path.normpath(own / name): content for name, content in found.items()}
    return Luggage(str(own / path.name), scene.text, files)


def variant_of(scene: Scene) -> int | None:
    """Which variant of its text a scene is."""
    return scene._native.variant


def folder_of(worker: Any, name: str) -> Path:
    """Where a worker keeps something of a name: a folder of its own, which goes with it."""
    return Path(worker.local_directory) / name


def sent(client: Any, luggage: Luggage) -> tuple[str, Any]:
    """Sends a scene to all workers, those that come later too: the name of its folder, and what takes it back."""
    from distributed import WorkerPlugin

    # Not two calls for one, the first of which would take it from the second.
    name = f"sunstone-{luggage.key[:16]}-{uuid.uuid4().hex[:8]}"

    class Unpack(WorkerPlugin):
        def setup(self, worker: Any) -> None:
            luggage.unpack(folder_of(worker, name))

        def teardown(self, worker: Any) -> None:
            shutil.rmtree(folder_of(worker, name), ignore_errors=True)

    for attempt in range(ATTEMPTS):
        try:
            client.register_plugin(Unpack(), name=name)
            break
        except OSError:
            # A worker died meanwhile. Who comes in its place has it.
            if attempt + 1 == ATTEMPTS:
                raise
    return name, lambda: client.unregister_worker_plugin(name)

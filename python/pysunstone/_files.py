"""Transfers scenes with all their files to workers that do not share a file system."""

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

#: Maximum number of attempts to send a scene while workers die.
ATTEMPTS = 20


@dataclass(frozen=True)
class Luggage:
    """Text and files of a scene, to be unpacked into a folder.

    Attributes
    ----------
    file
        Path of the scene file relative to the folder. It is nested deep enough that all ``..`` paths of the scene stay inside the
        folder. The scene file's own folder keeps its name, because scenes without a name are named after it.
    text
        Text of the scene file.
    files
        Files that the scene refers to, by their paths relative to the folder.
    """

    file: str
    text: str
    files: Mapping[str, bytes] = field(repr=False)

    @property
    def key(self) -> str:
        """Return a hash of the text and all files."""
        all_of_it = hashlib.sha256()
        for name, content in [(self.file, self.text.encode()), *sorted(self.files.items())]:
            for piece in (name.encode(), content):
                all_of_it.update(len(piece).to_bytes(8, "little") + piece)
        return all_of_it.hexdigest()

    def unpack(self, folder: Path) -> None:
        """Unpack the scene atomically into a new folder."""
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
    """Return a scene with its files.

    Raises
    ------
    RenderError
        If the scene names a file by an absolute path.
    """
    native = scene._native
    path = Path(os.path.abspath(native.path))
    found = dict(native.files())
    absolute = next((name for name in found if os.path.isabs(name)), None)
    if absolute is not None:
        raise RenderError(
            f"{path}: the scene names {absolute} by an absolute path, which other workers cannot resolve; "
            "use a path relative to the scene's folder"
        )
    depth = max((PurePath(os.path.normpath(name)).parts.count("..") for name in found), default=0)
    own = Path(*["above"] * depth, path.parent.name or "scene")
    files = {os.path.normpath(own / name): content for name, content in found.items()}
    return Luggage(str(own / path.name), scene.text, files)


def variant_of(scene: Scene) -> int | None:
    """Return the number of a scene's variant, or None."""
    return scene._native.variant


def folder_of(worker: Any, name: str) -> Path:
    """Return a folder on a worker that is deleted when the worker ends."""
    return Path(worker.local_directory) / name


def sent(client: Any, luggage: Luggage) -> tuple[str, Any]:
    """Send a scene to all workers, including later ones.

    Return the name of its folder on the workers, and a function that removes it.
    """
    from distributed import WorkerPlugin

    # Each call uses a unique name. Otherwise, the first of two calls that ends would remove the scene of the other call.
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
            # A worker died during the call. Its replacement receives the plugin.
            if attempt + 1 == ATTEMPTS:
                raise
    return name, lambda: client.unregister_worker_plugin(name)

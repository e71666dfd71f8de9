"""The explorer of stores in notebooks and in the browser."""

from __future__ import annotations

import html
import os
import webbrowser
from dataclasses import dataclass
from pathlib import Path

from pysunstone import _native

__all__ = ["View", "view"]

#: URLs of the explorers of this process. A cell that runs again shows the same explorer.
_RUNNING: dict[tuple[tuple[str, ...], int], str] = {}


@dataclass(frozen=True)
class View:
    """An explorer of stores. A notebook shows it as an inline frame.

    The explorer serves until the Python process ends.
    """

    #: Address of the page on this computer, with the token that gives access.
    url: str
    #: Height of the frame in a notebook, in CSS pixels.
    height: int = 800

    def open(self) -> bool:
        """Open the page in the browser. Returns whether a browser was found."""
        return webbrowser.open(self.url)

    def _repr_html_(self) -> str:
        address = html.escape(self.url, quote=True)
        style = "border: 0; width: 100%"
        return f'<iframe src="{address}" height="{self.height}" style="{style}" title="Explorer of stores"></iframe>'


def view(*stores: str | os.PathLike[str], port: int = 0, height: int = 800) -> View:
    """Return an explorer of stores that `sunstone render`, `merge`, `reconstruct` or `rig run` wrote.

    The explorer is the page of the command ``sunstone view``. A store that is being rendered is shown as it grows.

    Parameters
    ----------
    *stores
        Paths of stores.
    port
        Port on this computer; 0 stands for any free port. If the notebook runs on another computer, choose a port and forward it.
    height
        Height of the frame in a notebook, in CSS pixels.

    Raises
    ------
    InputError
        If a path is not a store, or the store is damaged.

    Examples
    --------
    >>> import pysunstone as ps
    >>> ps.view("out/mirror_room.zarr")  # doctest: +SKIP
    """
    paths = tuple(str(Path(store).resolve()) for store in stores)
    if (paths, port) not in _RUNNING:
        _RUNNING[paths, port] = _native.start_view(paths, port)
    return View(_RUNNING[paths, port], height)

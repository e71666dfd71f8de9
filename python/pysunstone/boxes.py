"""Computes the range of device pixels of each axis entry. A bin's coordinate is the mean of its pixel indices (CONVENTIONS.md)."""

# pyright: basic
from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["bins"]


def bins(centres: npt.ArrayLike, pixels: int | None = None) -> list[tuple[int, int]]:
    """Return the first and last pixel of every entry.

    Parameters
    ----------
    centres
        Coordinates of the entries, in pixels, increasing.
    pixels
        Pixels per bin, if known. If 1, entries are single pixels, even if they are not consecutive. If None, consecutive integer
        coordinates are pixels, and fractional coordinates are bins that tile the axis from pixel 0.

    Raises
    ------
    ValueError
        If coordinates are not the centres of whole pixels, or are ambiguous.

    Examples
    --------
    >>> bins([1.5, 5.5, 8.5])
    [(0, 3), (4, 7), (8, 9)]
    """
    coords = np.asarray(centres, dtype=float)
    whole = bool(np.all(coords == np.floor(coords)))
    consecutive = bool(np.all(np.diff(coords) == 1))
    if pixels is None and whole and not consecutive:
        raise ValueError(
            "it is unknown whether projector pixels are binned, because the attribute `projector_bin` is missing; "
            "open the store with pysunstone.open_store, and call `probe` before you change arrays"
        )
    if (pixels is not None and pixels <= 1) or (pixels is None and whole):
        if not whole or coords.size and coords[0] < 0:
            raise ValueError(f"coordinates {coords} are not indices of whole pixels")
        return [(int(c), int(c)) for c in coords]
    found, first = [], 0.0
    for centre in coords:
        last = 2 * float(centre) - first
        if not (last >= first and last == np.floor(last)):
            raise ValueError(f"coordinate {centre} is not the centre of a bin of whole pixels that tiles the axis from pixel 0")
        found.append((int(first), int(last)))
        first = last + 1
    return found

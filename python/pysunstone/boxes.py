"""Which device pixels an entry of an axis stands for: coordinates are pixel indices, of bins their mean (CONVENTIONS.md)."""

# pyright: basic
from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["bins"]


def bins(centres: npt.ArrayLike, pixels: int | None = None) -> list[tuple[int, int]]:
    """First and last pixel of every entry.

    Parameters
    ----------
    centres
        Coordinates of the entries, pixels, rising.
    pixels
        Pixels of a bin where that is known: 1 says that entries are single pixels, whatever lies between them. Without it,
        consecutive whole coordinates are pixels, and fractional ones are bins that tile the axis from pixel 0.

    Raises
    ------
    ValueError
        If coordinates are no middles of whole pixels, or could be either.

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
            "it is not known whether pixels are binned or listed: the attribute `projector_bin` is missing; "
            "open the store with pysunstone.open_store, and probe before arrays are changed"
        )
    if (pixels is not None and pixels <= 1) or (pixels is None and whole):
        if not whole or coords.size and coords[0] < 0:
            raise ValueError(f"coordinates {coords} are not those of whole pixels")
        return [(int(c), int(c)) for c in coords]
    found, first = [], 0.0
    for centre in coords:
        last = 2 * float(centre) - first
        if not (last >= first and last == np.floor(last)):
            raise ValueError(f"coordinate {centre} is not the middle of whole pixels of bins that tile the axis from pixel 0")
        found.append((int(first), int(last)))
        first = last + 1
    return found

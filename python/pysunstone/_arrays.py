"""Arrays as the extension takes them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from pysunstone._native import InputError

__all__ = ["plain", "real"]

#: Where named dimensions must stand in an array whose axes are counted.
_FIRST, _LAST = ("capture", "channel"), ("stokes_out", "stokes_in")


def _order(what: str, given: Any) -> None:
    """Refuse a named array (xarray) whose dimensions stand where the function does not expect them."""
    dims = getattr(given, "dims", None)
    if not isinstance(dims, tuple):
        return
    first, last = [d for d in _FIRST if d in dims], [d for d in _LAST if d in dims]
    if list(dims[: len(first)]) != first or list(dims[len(dims) - len(last) :]) != last:
        raise InputError(
            f"{what}: the dimensions are {dims}; transpose to {(*first, '...', *last)}, or use the accessor `.sunstone`, which goes by names"
        )


def plain(what: str, given: Any, *, fill: float | None = None) -> npt.NDArray[Any]:
    """An array without a mask.

    Parameters
    ----------
    what
        Name of the argument, for messages.
    given
        Anything that NumPy takes as an array.
    fill
        What masked entries become; None: they are refused.
    """
    _order(what, given)
    if isinstance(given, list | tuple) and any(isinstance(entry, np.ma.MaskedArray) for entry in given):  # pyright: ignore[reportUnknownVariableType]
        # `asarray` would drop the masks of the entries.
        given = np.ma.stack(given)  # pyright: ignore[reportUnknownArgumentType, reportUnknownMemberType]
    if isinstance(given, np.ma.MaskedArray) and np.ma.is_masked(given):  # pyright: ignore[reportUnknownArgumentType, reportUnknownMemberType]
        if fill is None or given.dtype.kind not in "fiub":  # pyright: ignore[reportUnknownMemberType]
            raise InputError(f"{what}: {int(np.ma.count_masked(given))} entries are masked; fill or remove them")  # pyright: ignore[reportUnknownArgumentType, reportUnknownMemberType]
        single = given.dtype.type in (np.float16, np.float32)  # pyright: ignore[reportUnknownMemberType]
        return np.asarray(given.astype(np.float32 if single else np.float64).filled(fill))  # pyright: ignore[reportUnknownArgumentType, reportUnknownMemberType]
    try:
        return np.asarray(given)
    except (TypeError, ValueError, RuntimeError) as fault:
        raise InputError(f"{what}: NumPy cannot read it as an array ({fault}); give a numpy.ndarray") from fault


def real(what: str, given: Any, dtype: Any = None, *, fill: float | None = None) -> npt.NDArray[Any]:
    """A C-contiguous array in native single or double precision; a copy only where the given one is not.

    Single precision stays, all other real numbers become double. Masked entries become ``fill``, or are refused.
    """
    array = plain(what, given, fill=fill)
    if array.dtype.kind not in "fiub":
        raise InputError(f"{what}: the dtype is {array.dtype}; give real numbers")
    if dtype is None:
        dtype = np.float32 if array.dtype.type in (np.float16, np.float32) else np.float64
    return np.require(array, dtype=np.dtype(dtype), requirements=["C", "A"])

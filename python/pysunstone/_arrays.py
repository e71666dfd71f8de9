"""Converts arguments to the arrays that the extension accepts."""

from __future__ import annotations

import operator
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from pysunstone._native import InputError

__all__ = ["plain", "real", "whole"]

#: NumPy's type stubs for masked arrays are incomplete.
_ma: Any = np.ma

#: Named dimensions that must come first and last in an array whose axes are positional.
_FIRST, _LAST = ("capture", "channel"), ("stokes_out", "stokes_in")


def _order(what: str, given: Any) -> None:
    """Refuse an xarray object whose dimensions are not in the order that the function expects."""
    found: object = getattr(given, "dims", None)
    if not isinstance(found, tuple):
        return
    dims = [str(d) for d in cast("tuple[object, ...]", found)]
    first, last = [d for d in _FIRST if d in dims], [d for d in _LAST if d in dims]
    if dims[: len(first)] != first or dims[len(dims) - len(last) :] != last:
        raise InputError(
            f"{what}: the dimensions are {dims}; transpose to {(*first, '...', *last)}, "
            "or use the accessor `.sunstone`, which finds dimensions by name"
        )


def plain(what: str, given: Any, *, fill: float | None = None) -> npt.NDArray[Any]:
    """Return an array without a mask.

    Parameters
    ----------
    what
        Name of the argument, for messages.
    given
        Anything that NumPy converts to an array.
    fill
        Value of masked entries. If None, masked entries are refused.
    """
    _order(what, given)
    if isinstance(given, list | tuple):
        entries = cast("list[Any]", given)
        if any(isinstance(entry, np.ma.MaskedArray) for entry in entries):
            # `asarray` drops the masks of the entries.
            given = _ma.stack(entries)
    if isinstance(given, np.ma.MaskedArray):
        masked: Any = cast(Any, given)
        if _ma.is_masked(masked):
            if fill is None or masked.dtype.kind not in "fiub":
                count = int(_ma.getmaskarray(masked).sum())
                raise InputError(f"{what}: {count} entries are masked; fill or remove them")
            single = masked.dtype.type in (np.float16, np.float32)
            return np.asarray(_ma.filled(_ma.asarray(masked, np.float32 if single else np.float64), fill))
        given = masked
    try:
        return np.asarray(cast(Any, given))
    except (TypeError, ValueError, RuntimeError) as fault:
        raise InputError(f"{what}: NumPy cannot read it as an array ({fault}); give a numpy.ndarray") from fault


def real(what: str, given: Any, dtype: Any = None, *, fill: float | None = None) -> npt.NDArray[Any]:
    """Return a C-contiguous array in native single or double precision; copy only if necessary.

    Single precision is kept; all other real numbers become double precision. Masked entries become ``fill``; without ``fill``
    they are refused.
    """
    array = plain(what, given, fill=fill)
    if array.dtype.kind not in "fiub":
        raise InputError(f"{what}: the dtype is {array.dtype}; give real numbers")
    if dtype is None:
        dtype = np.float32 if array.dtype.type in (np.float16, np.float32) else np.float64
    return np.require(array, dtype=np.dtype(dtype), requirements=["C", "A"])


def whole(what: str, given: Any, least: int = 0, most: int = 2**63 - 1) -> int:
    """Return a whole number as an `int`; refuse other types and numbers outside ``least`` to ``most``."""
    try:
        number = operator.index(given)
    except TypeError:
        raise InputError(f"{what}: expected a whole number, got {given!r}") from None
    if not least <= number <= most:
        limits = f"from {least} to {most}" if most < 2**63 - 1 else f"of {least} or more"
        raise InputError(f"{what}: expected a whole number {limits}, got {number}")
    return number

"""Arrays as the extension takes them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from pysunstone._native import InputError

__all__ = ["real"]


def real(what: str, given: Any, dtype: Any = None) -> npt.NDArray[Any]:
    """A C-contiguous array in native single or double precision; a copy only where the given one is not.

    Single precision stays, all other real numbers become double.
    """
    array = np.asarray(given)
    if array.dtype.kind not in "fiub":
        raise InputError(f"{what}: the dtype is {array.dtype}; give real numbers")
    if dtype is None:
        dtype = np.float32 if array.dtype.type in (np.float16, np.float32) else np.float64
    return np.require(array, dtype=np.dtype(dtype), requirements=["C", "A"])

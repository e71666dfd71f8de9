"""Decomposes Mueller matrices."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pysunstone import _native
from pysunstone._arrays import real

__all__ = ["decompose"]


def decompose(
    matrices: npt.ArrayLike, std_error: npt.ArrayLike | None = None, *, only: Sequence[str] | None = None
) -> dict[str, npt.NDArray[Any]]:
    """Decompose Mueller matrices after Lu and Chipman, M = M_Δ M_R M_D, on all cores.

    Parameters
    ----------
    matrices
        (..., 4, 4). Single precision is kept; all other types become double precision. Contiguous arrays are read without a copy.
    std_error
        Standard errors of the elements, of the same shape. With them, standard errors of the four scalars are also returned.
    only
        Names of the arrays to return, including ``entropy``.

    Returns
    -------
    dict
        Arrays of the shape of the leading axes: ``polarizance``, ``diattenuation``, ``retardance`` (radians, 0 to π),
        ``depolarization``; ``retardance_axis`` (..., 3), Stokes components of the fast axis; the factors ``m_delta``, ``m_r``,
        ``m_d`` (..., 4, 4); with ``std_error``, also ``polarizance_error`` etc. NaN for matrices that are not realizable (m00 ≤
        0, diattenuation above 1).

    Raises
    ------
    InputError
        If shapes do not fit, numbers are not real, errors are negative, or names are unknown.
    """
    array = real("matrices", matrices)
    errors = None if std_error is None else real("std_error", std_error, array.dtype)
    names = [q for q in _native.quantities() if q != "entropy"] if only is None else list(only)
    found, missing = _native.decompose(array, errors, names)
    if missing:
        warnings.warn(
            f"{missing} of {array.size // 16} matrices cannot exist (m00 <= 0, diattenuation above 1, or not finite); the results for these are NaN",
            RuntimeWarning,
            stacklevel=2,
        )
    return {name: np.asarray(values) for name, values in found.items()}

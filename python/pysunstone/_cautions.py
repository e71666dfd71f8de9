"""Warnings about input that is valid but probably not what the user means."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable

__all__ = ["SunstoneWarning", "caution"]


class SunstoneWarning(UserWarning):
    """Input or a result is valid, but probably not what you mean: a black image, ignored contents, saturated captures."""


def caution(texts: Iterable[str]) -> None:
    """Issue a warning for each text, with the location of the first caller outside of this package."""
    here = os.path.dirname(__file__)
    level, frame = 1, sys._getframe()  # pyright: ignore[reportPrivateUsage]
    while frame.f_back is not None and os.path.dirname(frame.f_code.co_filename) == here:
        frame = frame.f_back
        level += 1
    for text in texts:
        warnings.warn(text, SunstoneWarning, stacklevel=level)

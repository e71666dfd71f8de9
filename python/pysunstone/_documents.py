"""Converts dicts with the keys of Sunstone's files to JSON for the extension."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from pysunstone._native import InputError

__all__ = ["json_of"]


def _plain(value: Any) -> Any:
    """Convert types that JSON does not support: NumPy arrays and numbers, and paths."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()  # pyright: ignore[reportUnknownVariableType, reportUnknownMemberType]
    if isinstance(value, os.PathLike):
        return os.fspath(value)  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
    raise InputError(f"a scene cannot contain a {type(value).__name__}; give numbers, strings, lists and dicts of them")


def _without_none(value: Any) -> Any:
    """Drop entries that are None. TOML has no null value; a missing key has the same meaning."""
    if isinstance(value, Mapping):
        items: Any = value.items()  # pyright: ignore[reportUnknownVariableType, reportUnknownMemberType]
        return {k: _without_none(v) for k, v in items if v is not None}
    if isinstance(value, list | tuple):
        return [_without_none(v) for v in value]  # pyright: ignore[reportUnknownVariableType]
    return value


def json_of(document: Mapping[str, Any]) -> str:
    """Return a dict as JSON. NumPy numbers and arrays become plain numbers and lists; None counts as a missing key."""
    return json.dumps(_without_none(document), default=_plain, allow_nan=False)

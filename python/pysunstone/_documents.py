"""Dicts with the keys of Sunstone's files, as the extension takes them."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from pysunstone._native import InputError

__all__ = ["json_of"]


def _plain(value: Any) -> Any:
    """What JSON does not know: arrays and numbers of NumPy, paths."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()  # pyright: ignore[reportUnknownVariableType, reportUnknownMemberType]
    if isinstance(value, os.PathLike):
        return os.fspath(value)  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
    raise InputError(f"a scene holds no {type(value).__name__}; give numbers, texts, lists and dicts of them")


def _without_none(value: Any) -> Any:
    """Without what is None: TOML has no word for it, and leaving a key out says the same."""
    if isinstance(value, Mapping):
        items: Any = value.items()  # pyright: ignore[reportUnknownVariableType, reportUnknownMemberType]
        return {k: _without_none(v) for k, v in items if v is not None}
    if isinstance(value, list | tuple):
        return [_without_none(v) for v in value]  # pyright: ignore[reportUnknownVariableType]
    return value


def json_of(document: Mapping[str, Any]) -> str:
    """A dict as JSON: numbers and arrays of NumPy are plain, None is as if left out."""
    return json.dumps(_without_none(document), default=_plain, allow_nan=False)

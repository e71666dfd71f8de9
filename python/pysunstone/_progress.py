"""Reports progress to users."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

__all__ = ["Progress", "reporting"]

Progress = Callable[[int, int], object]


@contextmanager
def reporting(progress: bool | Progress | None, unit: str = "tile") -> Generator[Progress | None, None, None]:
    """Yield the callback for progress, which is called with the finished and total numbers of tiles (or other units).

    ``True`` selects a tqdm bar, or lines on stderr if tqdm is not installed.
    """
    if not progress:
        yield None
    elif progress is not True:
        yield progress
    else:
        try:
            tqdm: Any = importlib.import_module("tqdm.auto")
        except ImportError:
            yield _lines(unit)
            return
        bar = tqdm.tqdm(unit=unit)

        def show(done: int, tiles: int) -> None:
            bar.total = tiles
            bar.update(done - bar.n)

        try:
            yield show
        finally:
            bar.close()


def _lines(unit: str) -> Progress:
    last = time.monotonic()

    def show(done: int, tiles: int) -> None:
        nonlocal last
        if done == tiles or time.monotonic() - last > 5:
            last = time.monotonic()
            print(f"{done}/{tiles} {unit}s", file=sys.stderr)

    return show

"""Units of work for renders with Dask: the work of one task, and retries if workers die."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import time
import uuid
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pysunstone._native import RenderError
from pysunstone.command import CommandError, find, run

__all__ = ["TOPIC", "Command", "Made", "Meter", "Metrics", "Unit", "finish", "once", "run_command"]

TOPIC = "sunstone"
"""Topic of the scheduler's events (``client.get_events(TOPIC)``): each is a :class:`Metrics` as a dictionary, with ``store``."""

ATTEMPTS = 100
"""Maximum number of attempts for a unit whose workers die."""

LOST_REPEATS = 10
"""Number of times that the scheduler itself repeats a unit before it reports a failure."""

LOCKED = " is being written by "
"""Part of the command's message about a store whose lock another process holds."""

PAUSE_S = 1.0
"""Seconds between attempts while another process holds the lock."""


def run_command(words: Sequence[str]) -> str:
    """Run the command. Where the operating system supports it, the command ends when this process ends."""
    name, *rest = words
    try:
        return run(*rest, command=name, tied=True)
    except CommandError as e:
        raise RenderError(str(e)) from None


def _found(command: str | None) -> str:
    try:
        return command or find()
    except CommandError as e:
        raise RenderError(str(e)) from None


def _own_folder() -> Path:
    """Return the folder of the worker that runs this function."""
    import distributed as dask

    worker: Any = dask.get_worker()
    return Path(worker.local_directory)


@dataclass(frozen=True)
class Command:
    """Arguments of the command for a worker. Repeated runs give the same result.

    Attributes
    ----------
    command
        The command; if None, the worker finds it.
    words
        Arguments of the command.
    below
        Arguments that are paths in the worker's own folder: their positions in ``words``, and the relative paths.
    may_refuse
        If true, return an empty string if the command fails.
    """

    command: str | None
    words: tuple[str, ...]
    below: tuple[tuple[int, str], ...] = ()
    may_refuse: bool = False

    def __call__(self) -> str:
        """Run the command.

        Another process may hold the lock of the store, such as a worker that was believed dead. In this case, wait for the other
        process. If that process has died, the command takes over the lock.
        """
        words = list(self.words)
        for at, name in self.below:
            words[at] = str(_own_folder() / name)
        while True:
            try:
                return run_command([_found(self.command), *words])
            except RenderError as e:
                if LOCKED in str(e):
                    time.sleep(PAUSE_S)
                elif self.may_refuse:
                    return ""
                else:
                    raise


@dataclass(frozen=True)
class Made:
    """Cost of making a unit; zero if the unit already existed."""

    seconds: float
    samples: int


def _samples(reported: str) -> int:
    samples = re.search(r" tiles, (\d+) samples", reported)
    return int(samples[1]) if samples else 0


@dataclass(frozen=True)
class Unit:
    """Result of one task: a part of a render, or a whole render, in a folder or at an address."""

    command: Command
    place: str
    threads: int

    def __call__(self) -> Made:
        """Make the unit, unless it already exists."""
        begun = time.perf_counter()
        if "://" in self.place:
            # A store at an address appears under its final name immediately and is locked while it is written. Resuming keeps the
            # part that an earlier attempt finished.
            reported = self._render(self.place, "--resume")
            return Made(time.perf_counter() - begun, _samples(reported))
        if os.path.isdir(self.place):
            return Made(0.0, 0)
        os.makedirs(os.path.dirname(self.place), exist_ok=True)
        # The name is unique, so that concurrent attempts at the same unit do not conflict.
        fresh = f"{self.place}.{uuid.uuid4().hex}.tmp"
        try:
            reported = self._render(fresh)
            try:
                os.rename(fresh, self.place)
            except OSError:
                # Another worker was faster, and its result has the same bytes.
                if not os.path.isdir(self.place):
                    raise
        finally:
            shutil.rmtree(fresh, ignore_errors=True)
        return Made(time.perf_counter() - begun, _samples(reported))

    def _render(self, into: str, *more: str) -> str:
        words = (*self.command.words, *more, "--threads", str(self.threads), "-o", into)
        return Command(self.command.command, words, self.command.below)()


@dataclass(frozen=True)
class Metrics:
    """Progress of a render.

    Attributes
    ----------
    finished, units
        Finished parts and all parts (of the current round, in a render to a target error).
    samples
        Samples that this call has taken so far, over all pixels.
    samples_per_s
        Samples per second since the call began.
    round
        Number of the round, in a render to a target error.
    error
        Relative error after the previous rounds, once known.
    target_error
        Relative error at which the render stops.
    """

    finished: int
    units: int
    samples: int
    samples_per_s: float
    round: int | None = None
    error: float | None = None
    target_error: float | None = None


@dataclass
class Meter:
    """Accumulates the results of units and reports them to the caller and to the scheduler."""

    client: Any
    store: str
    report: Callable[[Metrics], None] | None
    target_error: float | None = None
    round: int | None = None
    error: float | None = None
    samples: int = 0
    begun: float = field(default_factory=time.perf_counter)

    def made(self, finished: int, units: int, made: Made) -> None:
        self.samples += made.samples
        rate = self.samples / max(time.perf_counter() - self.begun, 1e-9)
        reported = Metrics(finished, units, self.samples, rate, self.round, self.error, self.target_error)
        self.client.log_event(TOPIC, {"store": self.store, **asdict(reported)})
        if self.report is not None:
            self.report(reported)


def finish(client: Any, units: Sequence[Unit], progress: Callable[[int, int], None] | None, meter: Meter) -> None:
    """Run all units, and repeat units whose worker died."""

    def made(finished: int, of: int, made: Any) -> None:
        meter.made(finished, of, made)
        if progress is not None:
            progress(finished, of)

    # The key depends on the location of the result, so that two concurrent calls for the same result compute it only once.
    _make(client, [(hashlib.sha256(unit.place.encode()).hexdigest()[:16], unit.place, unit) for unit in units], made)


def once(client: Any, command: Command) -> str:
    """Run a command on a worker and return its output."""
    reported: list[str] = []
    _make(client, [(uuid.uuid4().hex[:16], command.words[0], command)], lambda _, __, text: reported.append(text))
    return reported[0]


def _make(client: Any, tasks: Sequence[tuple[str, str, Callable[[], Any]]], made: Callable[[int, int, Any], None]) -> None:
    """Run tasks, each of which has a key and a name; report every result."""
    import distributed as dask

    running: dict[str, tuple[tuple[str, str, Callable[[], Any]], int]] = {}
    futures: list[Any] = []

    def submit(task: tuple[str, str, Callable[[], Any]], attempt: int) -> Any:
        future = client.submit(task[2], key=f"sunstone-{task[0]}-{attempt}", retries=LOST_REPEATS, pure=True)
        running[future.key] = (task, attempt)
        futures.append(future)
        return future

    finished = 0
    completed: Any = dask.as_completed
    pending = completed([submit(task, 0) for task in tasks])
    for future in pending:
        task, attempt = running.pop(future.key)
        error = future.exception() if future.status == "error" else None
        if future.status == "finished":
            # The worker may die before it transfers the result. Then the task is repeated.
            with contextlib.suppress(CancelledError):
                result = future.result()
                finished += 1
                made(finished, len(tasks), result)
                continue
        if not (error is None or isinstance(error, dask.KilledWorker | CancelledError)):
            client.cancel([f for f in futures if not f.done()])
            if isinstance(error, RenderError):
                raise error
            raise RenderError(f"{task[1]}: {error}") from error
        if attempt + 1 >= ATTEMPTS:
            raise RenderError(f"{task[1]}: the workers died {ATTEMPTS} times; give the workers more memory")
        pending.add(submit(task, attempt + 1))

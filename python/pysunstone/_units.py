"""Units of work of renders by Dask: what one task makes, and how all are made, whichever workers die meanwhile."""

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
"""Topic of the events that the scheduler is told (``client.get_events(TOPIC)``): a :class:`Metrics` as a dictionary, with ``store``."""

ATTEMPTS = 100
"""How often a unit is tried whose workers die under it."""

LOST_REPEATS = 10
"""How often the scheduler itself makes a unit again before it asks us."""

LOCKED = " is being written by "
"""What the command says of a store whose lock another process holds."""

PAUSE_S = 1.0
"""How long one waits for that process before it is looked at again."""


def run_command(words: Sequence[str]) -> str:
    """Run the command, which dies with this process where the system can see to that."""
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
    """The folder of the worker that runs this."""
    import distributed as dask

    worker: Any = dask.get_worker()
    return Path(worker.local_directory)


@dataclass(frozen=True)
class Command:
    """Words of the command, run by a worker; they say the same however often they are run.

    Attributes
    ----------
    command
        The command; as the worker finds it where ``None``.
    words
        Its words.
    below
        Words that name files of the worker: their places among ``words``, and what stands there, from the worker's own folder.
    may_refuse
        Whether it may refuse, and then says nothing.
    """

    command: str | None
    words: tuple[str, ...]
    below: tuple[tuple[int, str], ...] = ()
    may_refuse: bool = False

    def __call__(self) -> str:
        """Run it. Who else writes the same store, as a worker does that was thought dead, is waited for; if that has died, the
        command itself takes its lock over."""
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
    """What making a unit took: nothing, if it was there."""

    seconds: float
    samples: int


def _samples(told: str) -> int:
    samples = re.search(r" tiles, (\d+) samples", told)
    return int(samples[1]) if samples else 0


@dataclass(frozen=True)
class Unit:
    """What one task makes: a part of a render, or all of it, in a folder or below an address."""

    command: Command
    place: str
    threads: int

    def __call__(self) -> Made:
        """Make it, if nobody has yet."""
        begun = time.perf_counter()
        if "://" in self.place:
            # A store below an address appears under its name at once, and is locked while it is made. What an earlier attempt has
            # finished of it is kept.
            told = self._render(self.place, "--resume")
            return Made(time.perf_counter() - begun, _samples(told))
        if os.path.isdir(self.place):
            return Made(0.0, 0)
        os.makedirs(os.path.dirname(self.place), exist_ok=True)
        # Nobody else writes there, whoever else makes the same.
        fresh = f"{self.place}.{uuid.uuid4().hex}.tmp"
        try:
            told = self._render(fresh)
            try:
                os.rename(fresh, self.place)
            except OSError:
                # Another worker was first, with the same bytes.
                if not os.path.isdir(self.place):
                    raise
        finally:
            shutil.rmtree(fresh, ignore_errors=True)
        return Made(time.perf_counter() - begun, _samples(told))

    def _render(self, into: str, *more: str) -> str:
        words = (*self.command.words, *more, "--threads", str(self.threads), "-o", into)
        return Command(self.command.command, words, self.command.below)()


@dataclass(frozen=True)
class Metrics:
    """How far a render is.

    Attributes
    ----------
    finished, units
        Parts that are finished, and all (of the round, of a render to an error).
    samples
        Samples that this call has taken so far, of all pixels.
    samples_per_s
        The same for each second since the call began.
    round
        Number of the round, of a render to an error.
    error
        Relative error after the rounds before, once there is one.
    target_error
        What it is to become.
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
    """Counts what units bring, and tells it to whoever asked and to the scheduler."""

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
        told = Metrics(finished, units, self.samples, rate, self.round, self.error, self.target_error)
        self.client.log_event(TOPIC, {"store": self.store, **asdict(told)})
        if self.report is not None:
            self.report(told)


def finish(client: Any, units: Sequence[Unit], progress: Callable[[int, int], None] | None, meter: Meter) -> None:
    """Make all units, whichever workers die meanwhile."""

    def made(finished: int, of: int, made: Any) -> None:
        meter.made(finished, of, made)
        if progress is not None:
            progress(finished, of)

    # The key is that of the result's place, so that two calls for one result at once make it once.
    _make(client, [(hashlib.sha256(unit.place.encode()).hexdigest()[:16], unit.place, unit) for unit in units], made)


def once(client: Any, command: Command) -> str:
    """Let a worker run a command; what it printed."""
    told: list[str] = []
    _make(client, [(uuid.uuid4().hex[:16], command.words[0], command)], lambda _, __, text: told.append(text))
    return told[0]


def _make(client: Any, tasks: Sequence[tuple[str, str, Callable[[], Any]]], made: Callable[[int, int, Any], None]) -> None:
    """Run tasks, each of which has a key and a name; tells every result."""
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
            # Its worker may die before it has told: then it is made again.
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
            raise RenderError(f"{task[1]}: its workers died {ATTEMPTS} times; they may have too little memory")
        pending.add(submit(task, attempt + 1))

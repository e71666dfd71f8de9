"""Renders on many processes or machines, by Dask.

A unit of work is a part of one render: some of its tiles (``sunstone render --part K/N``). It is a pure function of scene, options and
part, is made in a fresh temporary store and then renamed into place, so that retries, workers that die and units that run twice
change nothing. Walks from the light, of which every part may see some, all parts make together (``--light``). All parts together are joined by ``sunstone merge`` to the bytes of one render on one machine.

All that workers need is the command ``sunstone`` and one file system in common, which holds the scene and takes the result.

Examples
--------
>>> from pysunstone import distributed
>>> distributed.render("scenes/mirror_room/scene.toml", "out/room.zarr", spp=256)        # processes of this machine
>>> from dask_jobqueue import SLURMCluster                                               # 64 of a cluster
>>> cluster = SLURMCluster(cores=1, memory="2GB", walltime="04:00:00")
>>> cluster.scale(64)
>>> distributed.render("scene.toml", "/shared/room.zarr", client=cluster.get_client())
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import time
import uuid
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pysunstone._native import RenderError
from pysunstone.command import CommandError, find, run

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["TOPIC", "Job", "Metrics", "RenderError", "render", "render_many"]

PARTS_PER_WORKER = 4
"""Parts for each thread of the workers, so that none waits long for the last one."""

TOPIC = "sunstone"
"""Topic of the events that the scheduler is told (``client.get_events(TOPIC)``): a :class:`Metrics` as a dictionary, with ``store``."""

ATTEMPTS = 100
"""How often a unit is tried whose workers die under it."""

LOST_REPEATS = 10
"""How often the scheduler itself lets workers die under a unit before it asks us."""


@dataclass(frozen=True)
class Job:
    """One render of many.

    Attributes
    ----------
    scene
        Scene file.
    name
        Name of its store in the folder of all, without ``.zarr``; by default that of the scene's folder, with its variant and seed.
    spp, seed, variant, integrator
        As the options of ``sunstone render``; of the scene where ``None``.
    slices
        Slices to keep; all of the scene's where empty.
    """

    scene: str | os.PathLike[str]
    name: str | None = None
    spp: int | None = None
    seed: int | None = None
    variant: int | None = None
    integrator: str | None = None
    slices: Sequence[str] = field(default=())

    @property
    def store(self) -> str:
        """Name of its store."""
        if self.name is not None:
            return f"{self.name}.zarr"
        name = Path(self.scene).resolve().parent.name
        variant = "" if self.variant is None else f"_variant{self.variant}"
        seed = "" if self.seed is None else f"_seed{self.seed}"
        return f"{name}{variant}{seed}.zarr"

    def options(self) -> list[str]:
        """The words of ``sunstone render`` that say what is rendered."""
        words = [str(Path(self.scene).resolve()), "--no-figures"]
        for name in ("spp", "seed", "variant", "integrator"):
            value = getattr(self, name)
            if value is not None:
                words += [f"--{name}", str(value)]
        if self.slices:
            words += ["--slices", ",".join(self.slices)]
        return words


@dataclass(frozen=True)
class _Unit:
    """What one task makes: a part of a render, or all of it."""

    command: str
    words: tuple[str, ...]
    place: str
    threads: int

    def __call__(self) -> _Made:
        """Make it, if nobody has yet."""
        begun = time.perf_counter()
        if os.path.isdir(self.place):
            return _Made(0.0, 0)
        os.makedirs(os.path.dirname(self.place), exist_ok=True)
        # Nobody else writes there, whoever else makes the same.
        fresh = f"{self.place}.{uuid.uuid4().hex}.tmp"
        try:
            told = _run([self.command, "render", *self.words, "--threads", str(self.threads), "-o", fresh])
            try:
                os.rename(fresh, self.place)
            except OSError:
                # Another worker was first, with the same bytes.
                if not os.path.isdir(self.place):
                    raise
        finally:
            shutil.rmtree(fresh, ignore_errors=True)
        samples = re.search(r" tiles, (\d+) samples", told)
        return _Made(time.perf_counter() - begun, int(samples[1]) if samples else 0)


@dataclass(frozen=True)
class _Made:
    """What making a unit took: nothing, if it was there."""

    seconds: float
    samples: int


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
class _Meter:
    """Counts what units bring, and tells it to whoever asked and to the scheduler."""

    client: Any
    store: str
    report: Callable[[Metrics], None] | None
    target_error: float | None = None
    round: int | None = None
    error: float | None = None
    samples: int = 0
    begun: float = field(default_factory=time.perf_counter)

    def made(self, finished: int, units: int, made: _Made) -> None:
        self.samples += made.samples
        rate = self.samples / max(time.perf_counter() - self.begun, 1e-9)
        told = Metrics(finished, units, self.samples, rate, self.round, self.error, self.target_error)
        self.client.log_event(TOPIC, {"store": self.store, **asdict(told)})
        if self.report is not None:
            self.report(told)


def render(
    scene: str | os.PathLike[str],
    path: str | os.PathLike[str],
    spp: int | None = None,
    seed: int | None = None,
    parts: int | None = None,
    client: Client | None = None,
    *,
    variant: int | None = None,
    integrator: str | None = None,
    slices: Sequence[str] = (),
    threads: int = 1,
    command: str | None = None,
    overwrite: bool = False,
    target_error: float | None = None,
    target_slice: str | None = None,
    target_share: float | None = None,
    most_spp: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    report: Callable[[Metrics], None] | None = None,
) -> Path:
    """Render a scene on all workers into one store, byte for byte that of ``sunstone render``.

    With ``target_error``, rounds of samples are rendered until a slice is known to that relative error, in the tiles that need them;
    the store is again that of ``sunstone render --target-error``.

    Parts that are finished are kept beside ``path`` (``path.parts``) until all are, so that the same call goes on where an earlier one
    was stopped.

    Parameters
    ----------
    scene
        Scene file, at the same place for all workers.
    path
        Store to write, on a file system that all workers share.
    spp, seed, variant, integrator, slices
        As the options of ``sunstone render``.
    parts
        Number of parts; by default four for each thread of the workers.
    client
        Of the cluster; by default one of processes on this machine, for this call.
    threads
        Threads of one part.
    command
        The command ``sunstone`` on the workers; by default what SUNSTONE names, that of this Python's scripts, or that of the PATH.
    overwrite
        Replace a store at ``path``.
    target_error, target_slice, target_share, most_spp
        As the options of ``sunstone render``; ``spp`` is then the number of samples of the first round.
    progress
        Called with the number of finished parts and of all; of each round by itself.
    report
        Called with the same and more, as the scheduler's events of topic :data:`TOPIC` have it.

    Returns
    -------
    Path
        The store.

    Raises
    ------
    RenderError
        If the command refuses, or a part is lost with its worker again and again.
    FileExistsError
        If there is something at ``path``.
    """
    job = Job(scene, None, spp, seed, variant, integrator, tuple(slices))
    whole = _local(path)
    name = _command(command)
    if whole.exists() and not overwrite:
        raise FileExistsError(f"{whole} already exists: name another place, or pass overwrite=True")
    with _client(client) as on:
        count = parts if parts is not None else PARTS_PER_WORKER * max(1, sum(on.nthreads().values()))
        if count < 1:
            raise ValueError(f"parts is {count}; give at least 1")
        folder = whole.with_name(f"{whole.name}.parts")
        goal = {"error": target_error, "slice": target_slice, "share": target_share}
        words = [word for key, value in goal.items() if value is not None for word in (f"--target-{key}", str(value))]
        words += [] if most_spp is None else ["--most-spp", str(most_spp)]
        place = folder / _key(name, job, words)
        meter = _Meter(on, str(whole), report, target_error)

        def parts_of(options: Sequence[str], into: Path) -> list[str]:
            units = [
                _Unit(
                    name,
                    (*job.options(), *options, "--part", f"{number}/{count}", "--light", str(place / "light")),
                    str(into / f"{number}of{count}"),
                    threads,
                )
                for number in range(1, count + 1)
            ]
            _finish(on, units, progress, meter)
            return [unit.place for unit in units]

        force = ["--force"] if overwrite else []
        if not words:
            _run([name, "merge", *parts_of((), place), "-o", str(whole), *force])
        else:
            _to_error([name, "render", *job.options(), *words], words, place, parts_of, meter)
            if overwrite and whole.exists():
                shutil.rmtree(whole)
            os.rename(place / "whole.zarr", whole)
    shutil.rmtree(folder, ignore_errors=True)
    return whole


def _to_error(
    command: Sequence[str],
    words: Sequence[str],
    place: Path,
    parts_of: Callable[[Sequence[str], Path], list[str]],
    meter: _Meter,
) -> None:
    """Render rounds until none is needed any more, and pool them in ``whole.zarr``."""
    rounds, whole = place / "whole.zarr.rounds", place / "whole.zarr"
    while not whole.exists():
        standing = json.loads(_run([*command, "--rounds", str(rounds)]))
        meter.error = standing["error"]
        if standing["next"] != "round":
            break
        number = meter.round = standing["round"]
        into = place / f"round{number}"
        parts = parts_of([*words, "--rounds", str(rounds), "--round", str(number)], into)
        rounds.mkdir(parents=True, exist_ok=True)
        _run([command[0], "merge", *parts, "-o", str(rounds / f"{number}.zarr")])
        shutil.rmtree(into, ignore_errors=True)
        shutil.rmtree(place / "light", ignore_errors=True)
    _run([*command, "--resume", "-o", str(whole)])


def render_many(
    scenes: Iterable[str | os.PathLike[str] | Job],
    folder: str | os.PathLike[str],
    client: Client | None = None,
    *,
    threads: int = 1,
    command: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Render many scenes, variants or seeds, each whole by one worker, into stores of one folder with a manifest.

    What is in the folder from an earlier call with the same options is kept; what is of other ones is refused.

    Parameters
    ----------
    scenes
        Scene files, or :class:`Job`s.
    folder
        Where the stores go, on a file system that all workers share.
    client, threads, command, progress
        As of :func:`render`.

    Returns
    -------
    Path
        The manifest ``manifest.json``: a list, in the order of ``scenes``, of ``store``, ``scene``, ``scene_sha256``, ``variant``, ``seed``,
        ``samples_per_pixel`` and ``checksum``, the SHA-256 of the store's own manifest but for the line of the root's description,
        which holds the time that rendering took.

    Raises
    ------
    RenderError
        If the command refuses a render, or one is lost with its worker again and again.
    ValueError
        If two renders have the same name.
    """
    jobs = [scene if isinstance(scene, Job) else Job(scene) for scene in scenes]
    names = [job.store for job in jobs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"two renders are to be {twice}: give each a name of its own (Job(scene, name=...))")
    into = _local(folder)
    into.mkdir(parents=True, exist_ok=True)
    name = _command(command)
    units = [_Unit(name, tuple(job.options()), str(into / job.store), threads) for job in jobs]
    for unit in units:
        if os.path.isdir(unit.place):
            # The command refuses what is of another render, and says so.
            _run([name, "render", *unit.words, "--resume", "-o", unit.place])
    with _client(client) as on:
        _finish(on, units, progress, _Meter(on, str(into), None))
    entries: list[dict[str, Any]] = []
    for store in names:
        attributes = json.loads((into / store / "zarr.json").read_text())["attributes"]
        entries.append(
            {
                "store": store,
                "scene": attributes.get("title"),
                "scene_sha256": attributes["scene_sha256"],
                "variant": attributes.get("variant"),
                "seed": attributes["seeds"][0],
                "samples_per_pixel": attributes["samples_per_pixel"],
                "checksum": _checksum(into / store),
            }
        )
    manifest = into / "manifest.json"
    fresh = into / f".manifest.{uuid.uuid4().hex}.tmp"
    fresh.write_text(json.dumps(entries, indent=2) + "\n")
    fresh.replace(manifest)
    return manifest


def _checksum(store: Path) -> str:
    """Of all that the store holds, but for the time that rendering took."""
    lines = (store / "manifest.txt").read_text().splitlines()
    kept = [line for line in lines if not line.endswith((" zarr.json", " lines above"))]
    return hashlib.sha256("\n".join(kept).encode()).hexdigest()


def _local(path: str | os.PathLike[str]) -> Path:
    text = os.fspath(path)
    if "://" in text:
        raise ValueError(f"{text}: name a folder on a file system that all workers share; object stores are not written")
    return Path(text).resolve()


def _command(command: str | None) -> str:
    """The command on the workers."""
    try:
        return command or find()
    except CommandError as e:
        raise RenderError(str(e)) from None


def _key(command: str, job: Job, words: Sequence[str] = ()) -> str:
    """A name of all that a render depends on: what was made under another is not taken for it."""
    version = _run([command, "--version"])
    content = Path(job.scene).read_bytes()
    text = json.dumps([version, hashlib.sha256(content).hexdigest(), job.options(), *words])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _run(words: Sequence[str]) -> str:
    """Run the command, which dies with this process where the system can see to that."""
    name, *rest = words
    try:
        return run(*rest, command=name, tied=True)
    except CommandError as e:
        raise RenderError(str(e)) from None


@contextmanager
def _client(given: Client | None) -> Generator[Any, None, None]:
    """A client, whose methods Dask gives no types."""
    if given is not None:
        yield given
        return
    import distributed as dask

    made: Any = dask
    with (
        made.LocalCluster(threads_per_worker=1, n_workers=os.cpu_count() or 1, dashboard_address=None) as cluster,
        made.Client(cluster) as client,
    ):
        yield client


def _submit(client: Any, unit: _Unit, attempt: int) -> Any:
    # The key is that of the result's place, so that two calls for one result at once make it once.
    name = hashlib.sha256(unit.place.encode()).hexdigest()[:16]
    return client.submit(unit, key=f"sunstone-{name}-{attempt}", retries=LOST_REPEATS, pure=True)


def _finish(client: Any, units: Sequence[_Unit], progress: Callable[[int, int], None] | None, meter: _Meter) -> None:
    """Make all units, whichever workers die meanwhile."""
    import distributed as dask

    running: dict[str, tuple[_Unit, int]] = {}
    futures: list[Any] = []
    for unit in units:
        future = _submit(client, unit, 0)
        running[future.key] = (unit, 0)
        futures.append(future)
    finished = 0
    completed: Any = dask.as_completed
    pending = completed(futures)
    for future in pending:
        unit, attempt = running.pop(future.key)
        error = future.exception() if future.status == "error" else None
        if future.status == "finished":
            finished += 1
            meter.made(finished, len(units), future.result())
            if progress is not None:
                progress(finished, len(units))
            continue
        if not (error is None or isinstance(error, dask.KilledWorker | CancelledError)):
            client.cancel([f for f in futures if not f.done()])
            if isinstance(error, RenderError):
                raise error
            raise RenderError(f"{unit.place}: {error}") from error
        if attempt + 1 >= ATTEMPTS:
            raise RenderError(f"{unit.place}: its workers died {ATTEMPTS} times; they may have too little memory")
        again = _submit(client, unit, attempt + 1)
        running[again.key] = (unit, attempt + 1)
        futures.append(again)
        pending.add(again)

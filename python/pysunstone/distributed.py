"""Distributes renders over processes or machines with Dask.

A unit of work is a part of one render: a subset of the tiles (``sunstone render --part K/N``). Its result depends only on scene,
options and part. Retries, dying workers and duplicate runs therefore do not change the result. In a folder, a part is written to
a temporary store and then renamed; at an address, it is written under the lock of its store. Light subpaths can reach the pixels
of any part, so all parts share the subpaths (``--light``). ``sunstone merge`` joins the parts to the same bytes as one render on
one machine.

Workers need the command ``sunstone`` and a shared file system, which holds the scene and receives the result. If the result is
written to an object store, no shared file system is required: the scene is then sent to the workers with all its files.

Examples
--------
>>> from pysunstone import distributed
>>> distributed.render("scenes/mirror_room/scene.toml", "out/room.zarr", spp=256)        # processes of this machine
>>> from dask_jobqueue import SLURMCluster                                               # 64 of a cluster
>>> cluster = SLURMCluster(cores=1, memory="2GB", walltime="04:00:00")
>>> cluster.scale(64)
>>> distributed.render("scene.toml", "/shared/room.zarr", client=cluster.get_client())
>>> distributed.render("scene.toml", "s3://renders/room.zarr", client=cluster.get_client())    # without /shared
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import uuid
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pysunstone._files import pack, sent, variant_of
from pysunstone._native import RenderError
from pysunstone._units import TOPIC, Command, Meter, Metrics, Unit, finish, once, run_command
from pysunstone.command import CommandError, find
from pysunstone.scene import Scene

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["TOPIC", "Job", "Metrics", "RenderError", "render", "render_many"]

PARTS_PER_WORKER = 4
"""Parts per worker thread. With several parts per thread, the idle time at the end is shorter."""


@dataclass(frozen=True)
class Job:
    """One render of `render_many`.

    Attributes
    ----------
    scene
        Scene file.
    name
        Name of the store in the common folder, without ``.zarr``; by default the name of the scene's folder with variant and
        seed.
    spp, seed, variant, integrator
        As the options of ``sunstone render``; ``None`` uses the scene's values.
    slices
        Slices to keep; if empty, all slices of the scene.
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
        """Name of the render's store."""
        if self.name is not None:
            return f"{self.name}.zarr"
        name = Path(self.scene).resolve().parent.name
        variant = "" if self.variant is None else f"_variant{self.variant}"
        seed = "" if self.seed is None else f"_seed{self.seed}"
        return f"{name}{variant}{seed}.zarr"

    def options(self) -> list[str]:
        """Arguments of ``sunstone render`` that select what is rendered."""
        return [str(Path(self.scene).resolve()), *self.choices()]

    def choices(self) -> list[str]:
        """Arguments of ``sunstone render`` without the scene."""
        words = ["--no-figures"]
        for name in ("spp", "seed", "variant", "integrator"):
            value = getattr(self, name)
            if value is not None:
                words += [f"--{name}", str(value)]
        if self.slices:
            words += ["--slices", ",".join(self.slices)]
        return words


def render(
    scene: str | os.PathLike[str] | Scene,
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
) -> Path | str:
    """Render a scene on all workers into one store, which is byte-identical to that of ``sunstone render``.

    With ``target_error``, rounds of samples are rendered until a slice reaches this relative error. Later rounds render only the
    tiles that need more samples. The store then equals that of ``sunstone render --target-error``.

    Finished parts are kept next to ``path`` (in ``path.parts``) until all parts are finished. Repeat a stopped call to resume it.

    Parameters
    ----------
    scene
        Scene file, at the same path for all workers if ``path`` is a folder; or a `Scene`, which is sent to them.
    path
        Store to write, on a file system that all workers share, or an address (``s3://``, ``gs://``, ``az://``) to which all
        workers can write, each with the credentials of its own environment (docs/object-stores.md). At an address no shared file
        system is needed: the scene is sent to the workers.
    spp, seed, variant, integrator, slices
        As the options of ``sunstone render``.
    parts
        Number of parts; by default four per worker thread.
    client
        Client of the cluster; by default a cluster of processes on this machine is started for this call.
    threads
        Threads per part.
    command
        The command ``sunstone`` on the workers; by default the value of SUNSTONE, else the command in Python's scripts folder,
        else on the PATH. If a file system is shared, this process searches for the command; otherwise each worker does.
    overwrite
        Replace a store at ``path``.
    target_error, target_slice, target_share, most_spp
        As the options of ``sunstone render``; ``spp`` is then the number of samples of the first round.
    progress
        Called with the number of finished parts and of all parts, separately for each round.
    report
        Called with :class:`Metrics`, which the scheduler also receives as events of topic :data:`TOPIC`.

    Returns
    -------
    Path or str
        The store; a string for an address.

    Raises
    ------
    RenderError
        If the command fails, if the worker of a part dies repeatedly, or if a scene to be sent contains an absolute path.
    FileExistsError
        If ``path`` exists.
    """
    goal = {"error": target_error, "slice": target_slice, "share": target_share}
    words = [word for key, value in goal.items() if value is not None for word in (f"--target-{key}", str(value))]
    words += [] if most_spp is None else ["--most-spp", str(most_spp)]
    if isinstance(scene, Scene) and variant is None:
        variant = variant_of(scene)
    job = Job("" if isinstance(scene, Scene) else scene, None, spp, seed, variant, integrator, tuple(slices))
    if parts is not None and parts < 1:
        raise ValueError(f"parts is {parts}; pass at least 1")
    text = os.fspath(path)
    place = _Address(text, command) if "://" in text else _Folder(Path(text).resolve(), _command(command))
    if isinstance(place, _Folder) and place.path.exists() and not overwrite:
        raise FileExistsError(_there(place.path))
    with _client(client) as on, contextlib.ExitStack() as at_end:
        count = parts if parts is not None else PARTS_PER_WORKER * max(1, sum(on.nthreads().values()))
        if isinstance(place, _Folder) and not isinstance(scene, Scene):
            content = Path(job.scene).read_bytes()
            source, luggage = Command(place.command, ("render", *job.options())), ""
        else:
            packed = pack(scene if isinstance(scene, Scene) else Scene.load(scene, variant))
            content = packed.key.encode()
            luggage, back = sent(on, packed)
            # Workers that have left the cluster need no cleanup.
            at_end.callback(_quietly, back)
            source = Command(place.command, ("render", "", *job.choices()), ((1, os.path.join(luggage, packed.file)),))
        place.begin(on, overwrite)
        name = place.run(on, "--version")
        key = _key(name, content, [*job.choices(), *words])
        meter = Meter(on, str(place.path), report, target_error)

        def parts_of(options: Sequence[str], into: str) -> list[str]:
            """Render all parts and return the paths or addresses of their stores."""
            units: list[Unit] = []
            for number in range(1, count + 1):
                own = [*source.words, *options, "--part", f"{number}/{count}", "--light"]
                light = place.light(key, luggage)
                below = source.below if light else (*source.below, (len(own), os.path.join(luggage, "light")))
                units.append(Unit(Command(source.command, (*own, light), below), place.join(key, into, f"{number}of{count}"), threads))
            finish(on, units, progress, meter)
            return [unit.place for unit in units]

        if not words:
            place.merge(on, parts_of((), ""), str(place.path), overwrite)
        else:
            asked = Command(source.command, (*source.words, *words), source.below)
            _to_error(on, place, key, asked, words, parts_of, meter, overwrite)
        place.end(on)
    return place.path


def _there(path: object) -> str:
    return f"{path} already exists: choose another path, or pass overwrite=True"


def _quietly(work: Callable[[], Any]) -> None:
    with contextlib.suppress(Exception):
        work()


class _Folder:
    """A result on a shared file system. This process itself performs all operations on the result."""

    def __init__(self, path: Path, command: str) -> None:
        self.path, self.command = path, command
        self._parts = path.with_name(f"{path.name}.parts")

    def begin(self, client: Any, overwrite: bool) -> None:
        pass

    def run(self, client: Any, *words: str) -> str:
        return run_command([self.command, *words])

    def join(self, key: str, *names: str) -> str:
        return str(self._parts.joinpath(key, *names))

    def light(self, key: str, luggage: str) -> str:
        """Return the folder of the light subpaths that all parts share."""
        return self.join(key, "light")

    def rounds(self, key: str) -> tuple[str, str]:
        """Return the folder of the rounds, and the store into which the rounds are merged."""
        return self.join(key, "whole.zarr.rounds"), self.join(key, "whole.zarr")

    def merge(self, client: Any, parts: Sequence[str], whole: str, force: bool) -> None:
        Path(whole).parent.mkdir(parents=True, exist_ok=True)
        self.run(client, "merge", *parts, "-o", whole, *(["--force"] if force else []))

    def remove(self, client: Any, places: Sequence[str]) -> None:
        for place in places:
            shutil.rmtree(place, ignore_errors=True)

    def put(self, client: Any, whole: str, overwrite: bool) -> None:
        """Rename the store of all rounds to its final path."""
        if overwrite and self.path.exists():
            shutil.rmtree(self.path)
        os.rename(whole, self.path)

    def end(self, client: Any) -> None:
        shutil.rmtree(self._parts, ignore_errors=True)


class _Address:
    """A result at an address. Workers perform all operations on the result, so that this process does not need write access."""

    def __init__(self, path: str, command: str | None) -> None:
        self.path, self.command, self._overwrite = path.rstrip("/"), command, False

    def begin(self, client: Any, overwrite: bool) -> None:
        self._overwrite = overwrite
        # `info` fails if the address has no finished store. It also fails without access; in this case the first part reports the
        # reason.
        if once(client, Command(self.command, ("info", self.path), may_refuse=True)) and not overwrite:
            raise FileExistsError(_there(self.path))

    def run(self, client: Any, *words: str) -> str:
        return once(client, Command(self.command, words))

    def join(self, key: str, *names: str) -> str:
        return "/".join([f"{self.path}.parts", key, *(name for name in names if name)])

    def light(self, key: str, luggage: str) -> str:
        # Each worker traces all light subpaths, once for all of its parts.
        return ""

    def rounds(self, key: str) -> tuple[str, str]:
        # Object stores cannot rename.
        return f"{self.path}.rounds", self.path

    def merge(self, client: Any, parts: Sequence[str], whole: str, force: bool) -> None:
        if whole == self.path:
            # Another program may have written to the address in the meantime.
            self.begin(client, self._overwrite)
        # A worker may die after the merge but before it reports. The next attempt then finds the finished result.
        self.run(client, "merge", *parts, "-o", whole, "--force")
        self.remove(client, parts)

    def remove(self, client: Any, places: Sequence[str]) -> None:
        if places:
            self.run(client, "remove", *places)

    def put(self, client: Any, whole: str, overwrite: bool) -> None:
        pass

    def end(self, client: Any) -> None:
        pass


def _to_error(
    client: Any,
    place: _Folder | _Address,
    key: str,
    asked: Command,
    words: Sequence[str],
    parts_of: Callable[[Sequence[str], str], list[str]],
    meter: Meter,
    overwrite: bool,
) -> None:
    """Render rounds until the target error is reached, and merge the rounds."""

    def ask(*more: str) -> str:
        """Run the command on a worker that has the scene, and return the output."""
        return once(client, Command(asked.command, (*asked.words, *more), asked.below))

    rounds, whole = place.rounds(key)
    # An earlier call may have merged the rounds but not renamed the store.
    pooled = isinstance(place, _Folder) and Path(whole).exists()
    while not pooled:
        standing = json.loads(ask("--rounds", rounds))
        meter.error = standing["error"]
        if standing["next"] != "round":
            break
        number = meter.round = standing["round"]
        parts = parts_of([*words, "--rounds", rounds, "--round", str(number)], f"round{number}")
        place.merge(client, parts, f"{rounds}/{number}.zarr", False)
        place.remove(client, parts)
        if isinstance(place, _Folder):
            shutil.rmtree(place.light(key, ""), ignore_errors=True)
    if overwrite and isinstance(place, _Address):
        place.remove(client, [whole])
    ask("--resume", "-o", whole)
    place.put(client, whole, overwrite)


def render_many(
    scenes: Iterable[str | os.PathLike[str] | Job],
    folder: str | os.PathLike[str],
    client: Client | None = None,
    *,
    threads: int = 1,
    command: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Render many scenes, variants or seeds into the stores of one folder with a manifest. One worker renders each store.

    Stores of an earlier call with the same options are kept; stores of other renders are refused.

    Parameters
    ----------
    scenes
        Scene files, or :class:`Job`s.
    folder
        Folder for the stores, on a file system that all workers share.
    client, threads, command, progress
        As for :func:`render`.

    Returns
    -------
    Path
        The manifest ``manifest.json``: a list, in the order of ``scenes``, of ``store``, ``scene``, ``scene_sha256``,
        ``variant``, ``seed``, ``samples_per_pixel`` and ``checksum``. The checksum is the SHA-256 of the store's manifest,
        without the line for the root's metadata, which contains the render time.

    Raises
    ------
    RenderError
        If the command refuses a render, or the worker of a render dies repeatedly.
    ValueError
        If two renders have the same name.
    """
    jobs = [scene if isinstance(scene, Job) else Job(scene) for scene in scenes]
    names = [job.store for job in jobs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"two renders would write {twice}: pass a different name for each (Job(scene, name=...))")
    into = _local(folder)
    into.mkdir(parents=True, exist_ok=True)
    name = _command(command)
    units = [Unit(Command(name, ("render", *job.options())), str(into / job.store), threads) for job in jobs]
    for unit in units:
        if os.path.isdir(unit.place):
            # The command refuses the store of another render and explains why.
            run_command([name, *unit.command.words, "--resume", "-o", unit.place])
    with _client(client) as on:
        finish(on, units, progress, Meter(on, str(into), None))
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
    """Return a hash of the store's content without the render time."""
    lines = (store / "manifest.txt").read_text().splitlines()
    kept = [line for line in lines if not line.endswith((" zarr.json", " lines above"))]
    return hashlib.sha256("\n".join(kept).encode()).hexdigest()


def _local(path: str | os.PathLike[str]) -> Path:
    text = os.fspath(path)
    if "://" in text:
        raise ValueError(f"{text}: use a folder on a file system that all workers share; only `render` writes to object stores")
    return Path(text).resolve()


def _command(command: str | None) -> str:
    """Return the command on workers that share this process's file system."""
    try:
        return command or find()
    except CommandError as e:
        raise RenderError(str(e)) from None


def _key(version: str, scene: bytes, words: Sequence[str]) -> str:
    """Return a hash of everything that a render depends on, so that results of other renders are never reused."""
    text = json.dumps([version, hashlib.sha256(scene).hexdigest(), *words])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@contextmanager
def _client(given: Client | None) -> Generator[Any, None, None]:
    """Yield a client, untyped because Dask's methods have no type annotations."""
    if given is not None:
        yield given
        return
    import distributed as dask

    made: Any = dask
    count = os.cpu_count() or 1
    with (
        made.LocalCluster(threads_per_worker=1, n_workers=count, dashboard_address=None) as cluster,
        made.Client(cluster) as client,
    ):
        # Dask does not restart a worker that dies during its start. Adaptive scaling replaces the worker; otherwise the call
        # could wait forever.
        cluster.adapt(minimum=count, maximum=count)
        yield client

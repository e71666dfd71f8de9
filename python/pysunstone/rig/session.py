"""Sessions: execution of a plan by the instruments of a rig file and by Python objects."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import dataclass
from typing import Any

from pysunstone import _native
from pysunstone._native import InputError
from pysunstone._progress import Progress, reporting
from pysunstone.rig.instruments import Instrument

__all__ = ["Check", "Cost", "Outcome", "Report", "Session", "check"]

#: Methods that identify the kind of an instrument.
_KINDS = {
    "stage": ("begin_move", "finish_move", "home", "read", "stop"),
    "projector": ("load", "show", "dark"),
    "camera": ("configure", "expose", "frame"),
    "galvo": ("point",),
    "laser": ("emit", "state"),
    "counter": ("configure", "begin", "finish"),
}
_COMMON = ("identify", "reconnect", "limits")


@dataclass(frozen=True)
class Cost:
    """Cost of a run, without retries, homing and saving (saving runs in parallel)."""

    frames: int
    duration_s: float
    """Duration on the rig's clock."""
    moving_s: float
    """Time during which stages move, which is part of ``duration_s``."""
    raw_bytes: int


@dataclass(frozen=True)
class Outcome:
    """Result of a run."""

    taken: int
    """Number of frames captured by this run."""
    retries: int
    """Number of failed attempts."""
    elapsed_s: float
    """Elapsed time on the rig's clock. A simulated bench has its own clock, which differs from wall time."""


def _kind(instrument: object) -> str | None:
    """Return the kind of instrument all of whose methods the object has."""
    found = [kind for kind, names in _KINDS.items() if all(callable(getattr(instrument, n, None)) for n in (*names, *_COMMON))]
    return found[0] if found else None


def _lacks(instrument: object, kind: str) -> list[str]:
    return [n for n in (*_KINDS[kind], *_COMMON) if not callable(getattr(instrument, n, None))]


class Session(MutableMapping[str, Any]):
    """A plan and the instruments that execute it.

    A session maps names to instruments: ``projector``, ``camera``, ``galvo``, ``laser``, ``counter``, and stages by the names of
    the scheme's elements that they carry. The instruments of the rig file, simulated or real, are present from the start. Use
    them directly, or replace them by objects that follow the same protocol:

    >>> session = Session("rigs/spatio_polarimetric/plan.toml")     # doctest: +SKIP
    >>> session["camera"] = MyCamera()                              # doctest: +SKIP
    >>> session.run("night.zarr", progress=True)                    # doctest: +SKIP

    Parameters
    ----------
    plan
        Plan file.
    rig
        Rig file; by default the one that the plan names.
    instruments
        Python instruments by name. They replace instruments of the same names in the rig file, which are then not connected. The
        rig file does not have to list them.
    sample
        Capture a known sample instead of the scene, for calibration: air, mirror or polarizer. A simulated bench inserts it.
    dry
        Prepare only for `cost`: the scene of a simulated bench is not rendered, and no frame can be captured.
    bench_folder
        Folder where a simulated bench keeps the tensors of its scenes.
    progress
        Progress of the render for the simulated bench, as for `Scene.render`.

    Raises
    ------
    InputError
        If a file is invalid, or the rig does not match the plan.
    RenderError
        If an instrument of the rig file does not answer, or the render fails.
    """

    def __init__(
        self,
        plan: str | os.PathLike[str],
        rig: str | os.PathLike[str] | None = None,
        *,
        instruments: Mapping[str, Instrument] | None = None,
        sample: str | None = None,
        dry: bool = False,
        bench_folder: str | os.PathLike[str] = "out/bench",
        progress: bool | Progress | None = None,
    ) -> None:
        given = dict(instruments or {})
        for name, instrument in given.items():
            _fits(name, instrument)
        with reporting(progress) as show:
            self._native, own = _native.rig_open(plan, rig, list(given), sample, bench_folder, dry, show)
        self._instruments: dict[str, Any] = {**own, **given}
        self._dry = dry

    def __getitem__(self, name: str) -> Any:
        return self._instruments[name]

    def __setitem__(self, name: str, instrument: Any) -> None:
        _fits(name, instrument)
        self._instruments[name] = instrument

    def __delitem__(self, name: str) -> None:
        del self._instruments[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._instruments)

    def __len__(self) -> int:
        return len(self._instruments)

    def cost(self) -> Cost:
        """Return the cost of a run without moving any instrument. Refuses a plan that the instruments cannot execute."""
        return Cost(*_native.rig_cost(self._native, self._instruments))

    def run(
        self,
        output: str | os.PathLike[str],
        *,
        resume: bool = False,
        force: bool = False,
        progress: bool | Progress | None = None,
    ) -> Outcome:
        """Capture all frames of the plan into a store. Each frame is recorded only after it is on disk.

        The store is that of ``sunstone rig run``. `open_store` reads it, and ``sunstone reconstruct`` computes Mueller matrices
        from it. Ctrl-C, or an exception in `progress`, ends the run after the current frame.

        Parameters
        ----------
        output
            Path of the store.
        resume
            Resume an unfinished run.
        force
            Replace an existing store.
        progress
            ``True`` for a bar, or a function that is called with the finished and total number of frames.

        Raises
        ------
        InstrumentError
            If an instrument fails permanently. If a Python instrument raised an exception, that is the cause.
        InputError
            If the plan cannot be executed, or the store belongs to another run.
        RenderError
            If the disk fails.
        """
        if self._dry:
            raise InputError("a dry session takes nothing; open the session without dry=True")
        with reporting(progress, "frame") as show:
            return Outcome(*_native.rig_run(self._native, self._instruments, output, resume, force, show))

    def check(self, name: str) -> Report:
        """Run the conformance checks on an instrument. The instrument moves and emits light."""
        return check(self._instruments[name], name=name)

    def __repr__(self) -> str:
        return f"<pysunstone.rig.Session of {', '.join(self._instruments)}>"


def _fits(name: str, instrument: object) -> None:
    kind = name if name in _KINDS and name != "stage" else "stage"
    if lacks := _lacks(instrument, kind):
        what = f"`{name}`" if kind == name else f"`{name}`, a stage by its name (other names: {', '.join(list(_KINDS)[1:])}),"
        raise InputError(f"{what} is a {type(instrument).__name__}, which has no method {', '.join(lacks)}")


@dataclass(frozen=True)
class Check:
    """The result of one check: the requirement, and the fault if the check failed."""

    name: str
    fault: str | None


class Report(tuple[Check, ...]):
    """Results of the checks of one instrument; true if all checks pass."""

    __slots__ = ()

    @property
    def faults(self) -> list[Check]:
        """Failed checks."""
        return [c for c in self if c.fault is not None]

    def __bool__(self) -> bool:
        return not self.faults

    def __str__(self) -> str:
        lines = [f"passes {len(self) - len(self.faults)} of {len(self)} checks"]
        lines += [f"  {c.name}: {c.fault}" for c in self.faults]
        return "\n".join(lines)


def check(instrument: Instrument, *, name: str | None = None) -> Report:
    """Check whether an instrument follows its protocol, with the suite that every driver of Sunstone passes.

    The instrument moves, emits light and exposes. The same rules are enforced as in a run (limits, one exposure at a time).

    Parameters
    ----------
    instrument
        An instrument of any kind; its methods determine the kind.
    name
        Name for messages; by default the name of the class.
    """
    kind = _kind(instrument)
    if kind is None:
        nearest = min(_KINDS, key=lambda k: len(_lacks(instrument, k)) / len(_KINDS[k]))
        raise InputError(
            f"a {type(instrument).__name__} is no instrument: of a {nearest} it has no {', '.join(_lacks(instrument, nearest))}"
        )
    return Report(Check(*c) for c in _native.rig_check(kind, name or type(instrument).__name__, instrument))

"""Sessions: a plan, executed by the instruments of a rig file and by those that are objects of Python."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import dataclass
from typing import Any

from pysunstone import _native
from pysunstone._native import InputError
from pysunstone._progress import Progress, told
from pysunstone.rig.instruments import Instrument

__all__ = ["Check", "Cost", "Outcome", "Report", "Session", "check"]

#: Methods that tell one kind from all others.
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
    """What a run costs. Tries again, homing and saving are not in it; saving runs beside."""

    frames: int
    duration_s: float
    """On the rig's clock."""
    moving_s: float
    """Of it, while stages move."""
    raw_bytes: int


@dataclass(frozen=True)
class Outcome:
    """What a run did."""

    taken: int
    """Frames that it took."""
    retries: int
    """Tries that failed."""
    elapsed_s: float
    """Time that passed on the rig's clock, which of a simulated bench is not that of the wall."""


def _kind(instrument: object) -> str | None:
    """The kind whose methods it has all of."""
    found = [kind for kind, names in _KINDS.items() if all(callable(getattr(instrument, n, None)) for n in (*names, *_COMMON))]
    return found[0] if found else None


def _lacks(instrument: object, kind: str) -> list[str]:
    return [n for n in (*_KINDS[kind], *_COMMON) if not callable(getattr(instrument, n, None))]


class Session(MutableMapping[str, Any]):
    """A plan and the instruments that execute it.

    It is a mapping of names to instruments: ``projector``, ``camera``, ``galvo``, ``laser``, ``counter``, and stages by the names of the
    scheme's elements that they carry. Those of the rig file are there from the begin, simulated or real; each can be used as it is, or
    replaced by an object that follows the same protocol:

    >>> session = Session("rigs/spatio_polarimetric/plan.toml")     # doctest: +SKIP
    >>> session["camera"] = MyCamera()                              # doctest: +SKIP
    >>> session.run("night.zarr", progress=True)                    # doctest: +SKIP

    Parameters
    ----------
    plan
        Plan file.
    rig
        Rig file, instead of the plan's.
    instruments
        Instruments of Python by name. Those of the same names in the rig file are not connected; nor need they be in it.
    sample
        Capture a known sample instead of the scene, to calibrate with: air, mirror or polarizer. A simulated bench puts it there.
    dry
        To ask for the cost: a bench's scene is not rendered, and its light meets nothing.
    bench_folder
        Where a bench keeps the tensors of the scenes that it plays.
    progress
        Of that render, as of `Scene.render`.

    Raises
    ------
    InputError
        A file is wrong, or rig and plan do not fit.
    RenderError
        An instrument of the file does not answer, or the render failed.
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
        with told(progress) as show:
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
        """What a run costs, before anything moves; refuses a plan that the instruments cannot do."""
        return Cost(*_native.rig_cost(self._native, self._instruments))

    def run(
        self,
        output: str | os.PathLike[str],
        *,
        resume: bool = False,
        force: bool = False,
        progress: bool | Progress | None = None,
    ) -> Outcome:
        """Take all frames of the plan into a store, each safe on disk before the next counts.

        The store is that of ``sunstone rig run``: `open_store` reads it, ``sunstone reconstruct`` makes Mueller matrices of it. Ctrl-C,
        or an exception of `progress`, ends it after the frame in flight.

        Parameters
        ----------
        output
            The store.
        resume
            Go on with a run that did not come to its end.
        force
            Replace what is there.
        progress
            ``True``, or a function of frames done and frames in all.

        Raises
        ------
        InstrumentError
            An instrument failed for good; an exception of Python's is its cause.
        InputError
            The plan cannot be done, or the store is another run's.
        RenderError
            The disk failed.
        """
        if self._dry:
            raise InputError("a dry session takes nothing; open it without dry=True")
        with told(progress, "frame") as show:
            return Outcome(*_native.rig_run(self._native, self._instruments, output, resume, force, show))

    def check(self, name: str) -> Report:
        """Run the checks of its kind on an instrument, which moves and shines."""
        return check(self._instruments[name], name=name)

    def __repr__(self) -> str:
        return f"<pysunstone.rig.Session of {', '.join(self._instruments)}>"


def _fits(name: str, instrument: object) -> None:
    kind = name if name in _KINDS and name != "stage" else "stage"
    if lacks := _lacks(instrument, kind):
        what = f"`{name}`" if kind == name else f"`{name}`, a stage by its name (there are {', '.join(list(_KINDS)[1:])} besides),"
        raise InputError(f"{what} is a {type(instrument).__name__}, which has no method {', '.join(lacks)}")


@dataclass(frozen=True)
class Check:
    """A check: what an instrument shall do, and what it did instead, if anything."""

    name: str
    fault: str | None


class Report(tuple[Check, ...]):
    """Checks of one instrument; true where it keeps all of its promises."""

    __slots__ = ()

    @property
    def faults(self) -> list[Check]:
        """What it did not do."""
        return [c for c in self if c.fault is not None]

    def __bool__(self) -> bool:
        return not self.faults

    def __str__(self) -> str:
        lines = [f"passes {len(self) - len(self.faults)} of {len(self)} checks"]
        lines += [f"  {c.name}: {c.fault}" for c in self.faults]
        return "\n".join(lines)


def check(instrument: Instrument, *, name: str | None = None) -> Report:
    """Check whether an instrument keeps to its protocol, by the suite that every driver of Sunstone passes.

    It moves, shines and exposes meanwhile. What the session itself holds for an instrument (limits, one exposure at a time) is kept by
    the session here as well.

    Parameters
    ----------
    instrument
        An instrument of any kind; the kind is told by its methods.
    name
        In messages; that of its class without it.
    """
    kind = _kind(instrument)
    if kind is None:
        nearest = min(_KINDS, key=lambda k: len(_lacks(instrument, k)) / len(_KINDS[k]))
        raise InputError(
            f"a {type(instrument).__name__} is no instrument: of a {nearest} it has no {', '.join(_lacks(instrument, nearest))}"
        )
    return Report(Check(*c) for c in _native.rig_check(kind, name or type(instrument).__name__, instrument))

"""What a session asks of instruments: a class of methods for each kind, and what goes in and comes out.

Write a class that follows one of the protocols, in whatever way it talks to its hardware, and give an object of it to a `Session`.
Every call either does what it says within `within_s` seconds or raises: `TimeoutError` where no answer came (tried again),
`OSError` where the line is gone (`reconnect`, then tried again; pyserial's and PyUSB's errors are such), `InstrumentError` to say more.
Any other exception ends the session. What `limits` says is held by the session: no method is asked for more than that. Angles are
degrees, times seconds, rates hertz.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

__all__ = [
    "AreaCamera",
    "CameraLimits",
    "CameraSettings",
    "CounterLimits",
    "CounterSettings",
    "Fault",
    "Frame",
    "GalvoLimits",
    "GalvoScanner",
    "Histogram",
    "Identity",
    "Instrument",
    "InstrumentError",
    "LaserLimits",
    "LaserState",
    "PatternProjector",
    "PhotonCounter",
    "ProjectorLimits",
    "PulsedLaser",
    "Region",
    "RotationStage",
    "StageLimits",
    "StageReading",
]

#: Kinds of failures, and what a session does: ``timeout`` asks again; ``stalled`` homes and asks again; ``disconnected`` connects anew
#: and asks again; ``saturated`` tries again; ``limit`` and ``refused`` end the run.
Fault = Literal["timeout", "limit", "stalled", "disconnected", "saturated", "refused"]


class InstrumentError(RuntimeError):
    """An instrument failed.

    Raise it in an instrument to say how; a session that an instrument ended raises it with the instrument's name, and the original
    exception as its cause.

    Parameters
    ----------
    fault
        Kind of the failure, which says what the session does about it.
    what
        What happened and how to fix it, in words.
    instrument
        Its name in the session; the session fills it in.
    """

    def __init__(self, fault: Fault, what: str, instrument: str | None = None, rest: str = "") -> None:
        text = f"{fault}: {what}" if instrument is None else f"{instrument}: {fault}: {what}"
        super().__init__(f"{text}\n{rest}" if rest else text)
        self.fault: Fault = fault
        self.what = what
        self.instrument = instrument
        self._rest = rest

    def __reduce__(self) -> tuple[Any, ...]:
        # An exception is copied by its text alone otherwise.
        return type(self), (self.fault, self.what, self.instrument, self._rest)


@dataclass(frozen=True)
class Identity:
    """What an instrument says of itself."""

    maker: str
    model: str
    serial: str
    firmware: str = ""


@runtime_checkable
class Instrument(Protocol):
    """Any instrument. The session calls it from a thread of its own, one call at a time.

    Who inherits from a protocol below gets these three, which suit instruments that cannot say who they are and need no connecting.
    A number of degrees Celsius from ``temperature_c`` is noted in the journal.
    """

    def identify(self, within_s: float) -> Identity:
        """Who it is: proof that the line works."""
        return Identity(type(self).__module__, type(self).__name__, "unknown")

    def reconnect(self, within_s: float) -> None:
        """Connect anew after the line was lost, and forget what was under way. Settings are made again after that."""
        return None

    def temperature_c(self) -> float | None:
        """Temperature, degrees Celsius, where it knows it."""
        return None


@dataclass(frozen=True)
class StageLimits:
    """What a rotation stage can do."""

    range_deg: tuple[float, float] = (-np.inf, np.inf)
    """Least and greatest angle of its own scale."""
    velocity_deg_per_s: float = 25.0
    """Greatest speed; `Session.cost` reckons with it."""
    acceleration_deg_per_s2: float = 25.0
    resolution_deg: float = 0.001
    """Least step of the encoder: a goal counts as reached within two of them."""


@dataclass(frozen=True)
class StageReading:
    """Where a stage is."""

    angle_deg: float
    """By its encoder."""
    moving: bool = False
    homed: bool = True
    """Its zero has been found since it was switched on."""


class RotationStage(Instrument, Protocol):
    """A motorized rotation stage that carries a polarizer or retarder. Moves are begun and waited for apart: several turn at once."""

    @abstractmethod
    def limits(self) -> StageLimits:
        """What it can do; asked once."""
        raise NotImplementedError

    @abstractmethod
    def home(self, within_s: float) -> None:
        """Find its zero and wait for it."""

    @abstractmethod
    def begin_move(self, angle_deg: float) -> None:
        """Begin a move to an angle of its scale and return at once. A move under way is replaced."""

    @abstractmethod
    def finish_move(self, within_s: float) -> StageReading:
        """Wait for the end of the move that was begun, and say where the encoder then is."""
        raise NotImplementedError

    @abstractmethod
    def read(self, within_s: float) -> StageReading:
        """Where it is."""
        raise NotImplementedError

    @abstractmethod
    def stop(self, within_s: float) -> None:
        """Stop at once."""


@dataclass(frozen=True)
class ProjectorLimits:
    """What a pattern projector can do."""

    size: tuple[int, int]
    """Columns and rows."""
    patterns: int = 4096
    """How many its memory holds."""
    bits: int = 8
    """Bits a pixel: 1 where a pixel is on (255) or off (0)."""
    shortest_s: float = 0.0
    """Shortest time a pattern can stand."""


class PatternProjector(Instrument, Protocol):
    """A projector that shows patterns from its memory."""

    @abstractmethod
    def limits(self) -> ProjectorLimits:
        """What it can do; asked once."""
        raise NotImplementedError

    @abstractmethod
    def load(self, patterns: Sequence[npt.NDArray[np.uint8]], within_s: float) -> None:
        """Load patterns, numbered from 0: arrays (rows, columns), 255 is full light. Those loaded before are forgotten."""

    @abstractmethod
    def show(self, pattern: int, within_s: float) -> None:
        """Show a loaded pattern until another is asked for, and return when its light stands."""

    @abstractmethod
    def dark(self, within_s: float) -> None:
        """No light."""


@dataclass(frozen=True)
class Region:
    """Part of the sensor that is read: columns and rows from its upper left corner."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True)
class CameraSettings:
    """What a camera is set to."""

    region: Region
    exposure_s: float
    gain_db: float = 0.0
    format: str = "Mono12p"
    """GenICam's name of the digital numbers: Mono8, Mono10p, Mono12p or Mono16, of which arrays hold the numbers unpacked."""
    trigger: Literal["software", "line"] = "software"
    """What begins an exposure: the call, or the projector's line."""


@dataclass(frozen=True)
class CameraLimits:
    """What a camera can do."""

    size: tuple[int, int]
    """Columns and rows of the sensor."""
    step: tuple[int, int] = (1, 1)
    """Columns and rows of regions are multiples of these."""
    exposure_s: tuple[float, float] = (1e-6, 3600.0)
    gain_db: tuple[float, float] = (0.0, 0.0)
    formats: tuple[str, ...] = ("Mono12p",)
    row_time_s: float = 0.0
    """Time to read one row; `Session.cost` reckons with it."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame."""

    pixels: npt.NDArray[Any]
    """Digital numbers, (rows, columns) of the region, the sensor's upper row first; uint8 or uint16."""
    number: int | None = None
    """The camera's own count of frames, by which lost and stale ones are told; None where it does not count."""
    timestamp_ns: int = 0
    """The camera's own clock at the begin of the exposure."""


class AreaCamera(Instrument, Protocol):
    """An area camera."""

    @abstractmethod
    def limits(self) -> CameraLimits:
        """What it can do; asked once."""
        raise NotImplementedError

    @abstractmethod
    def configure(self, settings: CameraSettings, within_s: float) -> None:
        """Set everything; holds for all exposures that follow. An exposure under way is forgotten."""

    @abstractmethod
    def expose(self) -> None:
        """Begin one exposure and return at once."""

    @abstractmethod
    def frame(self, within_s: float) -> Frame | npt.NDArray[Any]:
        """Wait for the frame of the exposure that was begun: a `Frame`, or its array alone."""
        raise NotImplementedError


@dataclass(frozen=True)
class GalvoLimits:
    """What a galvo scanner can do."""

    range_deg: tuple[float, float]
    """Greatest optical angle from the axis, in x and in y."""
    resolution_deg: float = 1e-3
    settle_s: float = 0.0
    """Time until the beam stands after a small step."""


class GalvoScanner(Instrument, Protocol):
    """A pair of galvo mirrors that points a beam."""

    @abstractmethod
    def limits(self) -> GalvoLimits:
        """What it can do; asked once."""
        raise NotImplementedError

    @abstractmethod
    def point(self, angles_deg: tuple[float, float], within_s: float) -> tuple[float, float]:
        """Point the beam to optical angles from the axis, in x and y, wait until it stands, and say where the mirrors are."""
        raise NotImplementedError


@dataclass(frozen=True)
class LaserLimits:
    """What a pulsed laser can do."""

    wavelength_nm: float
    rate_hz: tuple[float, float]
    """Least and greatest rate of pulses."""


@dataclass(frozen=True)
class LaserState:
    """How a laser is."""

    emitting: bool
    """Light comes out."""
    rate_hz: float
    power: float = 1.0
    """Mean power over nominal: plans wait while it is below their limit."""


class PulsedLaser(Instrument, Protocol):
    """A pulsed laser."""

    @abstractmethod
    def limits(self) -> LaserLimits:
        """What it can do; asked once."""
        raise NotImplementedError

    @abstractmethod
    def emit(self, on: bool, rate_hz: float, within_s: float) -> None:
        """Light on at a rate, or off."""

    @abstractmethod
    def state(self, within_s: float) -> LaserState:
        """How it is."""
        raise NotImplementedError


@dataclass(frozen=True)
class CounterLimits:
    """What a photon counter can do."""

    bins: int = 32768
    """Bins of a histogram."""
    finest_ps: float = 25.0
    """Width of its finest bin, picoseconds; others are powers of two times that."""
    longest_s: float = 3600.0
    """Longest acquisition."""
    full: int = 2**32 - 1
    """Counts that a bin holds before it is full."""
    tags: str | None = None
    """Type of the records of its time tags ("TimeHarp 260 P T3", "MultiHarp T3", ...), if it gives any."""


@dataclass(frozen=True)
class CounterSettings:
    """What a counter is set to."""

    bins: int
    """From the sync pulse on."""
    bin_ps: float
    dwell_s: float
    """How long photons are counted."""
    offset_ps: float = 0.0
    """Added to the sync's time."""
    tags: bool = False
    """Give time tags instead of a histogram."""


@dataclass(frozen=True, eq=False)
class Histogram:
    """What was counted in one acquisition."""

    counts: npt.NDArray[Any]
    """By bin, integers; empty where time tags were asked for."""
    pulses: int
    """Laser pulses while it counted."""
    number: int | None = None
    """The counter's own number of the acquisition; None where it does not count."""
    timestamp_ns: int = 0
    records: npt.NDArray[Any] | None = None
    """The 32-bit records of its time tags, as the card sent them."""


class PhotonCounter(Instrument, Protocol):
    """A single-photon detector with its time-correlated counting."""

    @abstractmethod
    def limits(self) -> CounterLimits:
        """What it can do; asked once."""
        raise NotImplementedError

    @abstractmethod
    def configure(self, settings: CounterSettings, within_s: float) -> None:
        """Set everything; holds for all acquisitions that follow."""

    @abstractmethod
    def begin(self) -> None:
        """Begin an acquisition and return at once."""

    @abstractmethod
    def finish(self, within_s: float) -> Histogram:
        """Wait for its end."""
        raise NotImplementedError

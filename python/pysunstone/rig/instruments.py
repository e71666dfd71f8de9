"""Protocols of the instruments that a session uses: one class per kind, with its settings and results.

To add an instrument, write a class that follows one of the protocols and pass an object of it to a `Session`. Every call either
finishes within `within_s` seconds or raises an exception: `TimeoutError` if no answer came (the session tries again), `OSError`
if the connection is lost (the session calls `reconnect` and tries again; pyserial's and PyUSB's errors are `OSError`),
`InstrumentError` to give details. Any other exception ends the session. The session enforces `limits`: no method receives a
request beyond them. Angles are in degrees, times in seconds, rates in hertz.
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

#: Kinds of faults, each with the session's reaction. ``timeout``: try again. ``stalled``: home and try again. ``disconnected``:
#: reconnect and try again. ``saturated``: try again. ``limit`` and ``refused``: end the run.
Fault = Literal["timeout", "limit", "stalled", "disconnected", "saturated", "refused"]


class InstrumentError(RuntimeError):
    """A failure of an instrument.

    An instrument raises this error to describe a failure. If an instrument fails permanently, the session raises this error with
    the instrument's name. The cause is the original exception.

    Parameters
    ----------
    fault
        Kind of the failure, which selects the session's reaction.
    what
        Description of the failure and its fix.
    instrument
        Name of the instrument in the session; set by the session.
    """

    def __init__(self, fault: Fault, what: str, instrument: str | None = None, rest: str = "") -> None:
        text = f"{fault}: {what}" if instrument is None else f"{instrument}: {fault}: {what}"
        super().__init__(f"{text}\n{rest}" if rest else text)
        self.fault: Fault = fault
        self.what = what
        self.instrument = instrument
        self._rest = rest

    def __reduce__(self) -> tuple[Any, ...]:
        # By default, pickle restores an exception from its text only.
        return type(self), (self.fault, self.what, self.instrument, self._rest)


@dataclass(frozen=True)
class Identity:
    """Identity that an instrument reports."""

    maker: str
    model: str
    serial: str
    firmware: str = ""


@runtime_checkable
class Instrument(Protocol):
    """Base of all instruments. The session calls all methods of an instrument from one separate thread, one at a time.

    Classes that inherit from one of the protocols below inherit these three methods. The defaults suit instruments that cannot
    report their identity and need no connection. A value of ``temperature_c`` is recorded in the journal.
    """

    def identify(self, within_s: float) -> Identity:
        """Return the identity, and thereby check the connection."""
        return Identity(type(self).__module__, type(self).__name__, "unknown")

    def reconnect(self, within_s: float) -> None:
        """Reconnect after the connection was lost, and discard operations in progress. The session then applies the settings
        again.
        """
        return None

    def temperature_c(self) -> float | None:
        """Return the temperature in degrees Celsius, or None if unknown."""
        return None


@dataclass(frozen=True)
class StageLimits:
    """Limits of a rotation stage."""

    range_deg: tuple[float, float] = (-np.inf, np.inf)
    """Smallest and largest angle of the stage's own scale."""
    velocity_deg_per_s: float = 25.0
    """Highest speed; `Session.cost` uses it."""
    acceleration_deg_per_s2: float = 25.0
    resolution_deg: float = 0.001
    """Smallest step of the encoder. A target is reached if the position is within two steps of it."""


@dataclass(frozen=True)
class StageReading:
    """Position of a stage."""

    angle_deg: float
    """Angle according to the encoder."""
    moving: bool = False
    homed: bool = True
    """Whether the zero position has been found since the stage was switched on."""


class RotationStage(Instrument, Protocol):
    """A motorized rotation stage that carries a polarizer or retarder.

    Moves are started and awaited in separate calls, so that several stages can rotate simultaneously.
    """

    @abstractmethod
    def limits(self) -> StageLimits:
        """Return the limits; called once."""
        raise NotImplementedError

    @abstractmethod
    def home(self, within_s: float) -> None:
        """Find the zero position and wait until it is found."""

    @abstractmethod
    def begin_move(self, angle_deg: float) -> None:
        """Start a move to an angle of the stage's scale and return immediately. A new move replaces a move in progress."""

    @abstractmethod
    def finish_move(self, within_s: float) -> StageReading:
        """Wait for the end of the started move and return the encoder's reading."""
        raise NotImplementedError

    @abstractmethod
    def read(self, within_s: float) -> StageReading:
        """Return the position."""
        raise NotImplementedError

    @abstractmethod
    def stop(self, within_s: float) -> None:
        """Stop immediately."""


@dataclass(frozen=True)
class ProjectorLimits:
    """Limits of a pattern projector."""

    size: tuple[int, int]
    """Columns and rows."""
    patterns: int = 4096
    """Number of patterns that the memory holds."""
    bits: int = 8
    """Bits per pixel. If 1, pixels are either on (255) or off (0)."""
    shortest_s: float = 0.0
    """Shortest time that a pattern can be shown."""


class PatternProjector(Instrument, Protocol):
    """A projector that shows patterns from its memory."""

    @abstractmethod
    def limits(self) -> ProjectorLimits:
        """Return the limits; called once."""
        raise NotImplementedError

    @abstractmethod
    def load(self, patterns: Sequence[npt.NDArray[np.uint8]], within_s: float) -> None:
        """Load patterns, numbered from 0: arrays (rows, columns), 255 is full intensity. The new patterns replace all loaded
        patterns.
        """

    @abstractmethod
    def show(self, pattern: int, within_s: float) -> None:
        """Show a loaded pattern until the next request, and return when its light is stable."""

    @abstractmethod
    def dark(self, within_s: float) -> None:
        """Turn the light off."""


@dataclass(frozen=True)
class Region:
    """Region of the sensor to read: columns and rows from its upper left corner."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True)
class CameraSettings:
    """Settings of a camera."""

    region: Region
    exposure_s: float
    gain_db: float = 0.0
    format: str = "Mono12p"
    """GenICam name of the pixel format: Mono8, Mono10p, Mono12p or Mono16. Arrays hold the unpacked digital numbers."""
    trigger: Literal["software", "line"] = "software"
    """Start of an exposure: by the call, or by the projector's trigger line."""


@dataclass(frozen=True)
class CameraLimits:
    """Limits of a camera."""

    size: tuple[int, int]
    """Columns and rows of the sensor."""
    step: tuple[int, int] = (1, 1)
    """Regions must be multiples of these numbers of columns and rows."""
    exposure_s: tuple[float, float] = (1e-6, 3600.0)
    gain_db: tuple[float, float] = (0.0, 0.0)
    formats: tuple[str, ...] = ("Mono12p",)
    row_time_s: float = 0.0
    """Time to read one row; `Session.cost` uses it."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a camera."""

    pixels: npt.NDArray[Any]
    """Digital numbers, (rows, columns) of the region, the sensor's upper row first; uint8 or uint16."""
    number: int | None = None
    """The camera's frame counter, which reveals lost and stale frames; None if the camera does not count."""
    timestamp_ns: int = 0
    """The camera's clock at the start of the exposure, nanoseconds."""


class AreaCamera(Instrument, Protocol):
    """An area camera."""

    @abstractmethod
    def limits(self) -> CameraLimits:
        """Return the limits; called once."""
        raise NotImplementedError

    @abstractmethod
    def configure(self, settings: CameraSettings, within_s: float) -> None:
        """Apply all settings, for all following exposures. An exposure in progress is discarded."""

    @abstractmethod
    def expose(self) -> None:
        """Start one exposure and return immediately."""

    @abstractmethod
    def frame(self, within_s: float) -> Frame | npt.NDArray[Any]:
        """Wait for the frame of the started exposure: a `Frame`, or its array alone."""
        raise NotImplementedError


@dataclass(frozen=True)
class GalvoLimits:
    """Limits of a galvo scanner."""

    range_deg: tuple[float, float]
    """Largest optical angle from the axis, in x and in y."""
    resolution_deg: float = 1e-3
    settle_s: float = 0.0
    """Time until the beam is stable after a small step."""


class GalvoScanner(Instrument, Protocol):
    """A pair of galvo mirrors that directs a beam."""

    @abstractmethod
    def limits(self) -> GalvoLimits:
        """Return the limits; called once."""
        raise NotImplementedError

    @abstractmethod
    def point(self, angles_deg: tuple[float, float], within_s: float) -> tuple[float, float]:
        """Direct the beam to optical angles from the axis, in x and y, wait until the beam is stable, and return the angles of
        the mirrors.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class LaserLimits:
    """Limits of a pulsed laser."""

    wavelength_nm: float
    rate_hz: tuple[float, float]
    """Lowest and highest pulse rate."""


@dataclass(frozen=True)
class LaserState:
    """State of a laser."""

    emitting: bool
    """Whether light is emitted."""
    rate_hz: float
    power: float = 1.0
    """Mean power relative to the nominal power. Plans wait while the power is below their limit."""


class PulsedLaser(Instrument, Protocol):
    """A pulsed laser."""

    @abstractmethod
    def limits(self) -> LaserLimits:
        """Return the limits; called once."""
        raise NotImplementedError

    @abstractmethod
    def emit(self, on: bool, rate_hz: float, within_s: float) -> None:
        """Turn the light on at a pulse rate, or off."""

    @abstractmethod
    def state(self, within_s: float) -> LaserState:
        """Return the state."""
        raise NotImplementedError


@dataclass(frozen=True)
class CounterLimits:
    """Limits of a photon counter."""

    bins: int = 32768
    """Largest number of bins of a histogram."""
    finest_ps: float = 25.0
    """Width of the finest bin, picoseconds; other widths are the finest width times powers of two."""
    longest_s: float = 3600.0
    """Longest acquisition."""
    full: int = 2**32 - 1
    """Counts at which a bin is full."""
    tags: str | None = None
    """Type of the time-tag records ("TimeHarp 260 P T3", "MultiHarp T3", ...), or None without support for time tags."""


@dataclass(frozen=True)
class CounterSettings:
    """Settings of a photon counter."""

    bins: int
    """Number of bins, starting at the sync pulse."""
    bin_ps: float
    dwell_s: float
    """Counting time."""
    offset_ps: float = 0.0
    """Offset added to the time of the sync pulse."""
    tags: bool = False
    """Whether to return time tags instead of a histogram."""


@dataclass(frozen=True, eq=False)
class Histogram:
    """Result of one acquisition."""

    counts: npt.NDArray[Any]
    """Counts per bin, integers; empty if time tags were requested."""
    pulses: int
    """Laser pulses during the acquisition."""
    number: int | None = None
    """The counter's number of the acquisition; None if the counter does not number acquisitions."""
    timestamp_ns: int = 0
    records: npt.NDArray[Any] | None = None
    """32-bit time-tag records in the format of the card."""


class PhotonCounter(Instrument, Protocol):
    """A single-photon detector with time-correlated counting."""

    @abstractmethod
    def limits(self) -> CounterLimits:
        """Return the limits; called once."""
        raise NotImplementedError

    @abstractmethod
    def configure(self, settings: CounterSettings, within_s: float) -> None:
        """Apply all settings, for all following acquisitions."""

    @abstractmethod
    def begin(self) -> None:
        """Start an acquisition and return immediately."""

    @abstractmethod
    def finish(self, within_s: float) -> Histogram:
        """Wait for the end of the acquisition and return its result."""
        raise NotImplementedError

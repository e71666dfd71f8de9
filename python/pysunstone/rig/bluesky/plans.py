"""Instruments as devices for bluesky's RunEngine."""

from __future__ import annotations

import concurrent.futures
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pysunstone.rig.instruments import AreaCamera, CameraSettings, Frame, InstrumentError, PatternProjector, RotationStage

__all__ = ["MovableProjector", "MovableStage", "ReadableCamera", "Status"]

#: Longest single wait for a stage, seconds.
_LOOK_S = 0.2


class Status:
    """Status of an operation on a separate thread, following bluesky's protocol."""

    def __init__(self, work: Callable[[], object]) -> None:
        self._future: concurrent.futures.Future[object] = concurrent.futures.Future()

        def do() -> None:
            try:
                self._future.set_result(work())
            except BaseException as error:
                self._future.set_exception(error)

        threading.Thread(target=do, daemon=True).start()

    def add_callback(self, callback: Callable[[Status], object]) -> None:
        """Call `callback` with this status when it ends, or immediately if it has ended."""
        self._future.add_done_callback(lambda _: callback(self))

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        """Return the exception of the operation, or None; raise ``TimeoutError`` if it has not ended."""
        try:
            return self._future.exception(timeout)
        except concurrent.futures.TimeoutError:
            raise TimeoutError("the operation has not ended") from None

    def wait(self, timeout: float | None = None) -> None:
        """Wait for the end; raise the exception of a failed operation."""
        self._future.result(timeout)

    @property
    def done(self) -> bool:
        """Whether the operation has ended."""
        return self._future.done()

    @property
    def success(self) -> bool:
        """Whether the operation has ended successfully."""
        return self.done and self._future.exception() is None


class _AsDevice:
    """Common part of all devices for bluesky."""

    parent = None

    def __init__(self, name: str) -> None:
        self.name = name
        self._turn = threading.Lock()

    def read_configuration(self) -> dict[str, Any]:
        """Return an empty configuration."""
        return {}

    def describe_configuration(self) -> dict[str, Any]:
        """Return an empty description."""
        return {}

    def _reading(self, value: Any) -> dict[str, Any]:
        return {self.name: {"value": value, "timestamp": time.time()}}


class MovableStage(_AsDevice):
    """A rotation stage as a device of bluesky: `Movable`, `Locatable`, `Readable` and `Stoppable`, in degrees of the stage's
    scale.

    A stage whose zero position is unknown is homed before its first move.
    """

    def __init__(self, stage: RotationStage, name: str, *, within_s: float = 600.0) -> None:
        super().__init__(name)
        self._stage = stage
        self._within_s = within_s
        self._goal: float | None = None
        self._stopped: bool | None = None

    @property
    def hints(self) -> dict[str, Any]:
        """Fields that bluesky plots by default."""
        return {"fields": [self.name]}

    @property
    def position(self) -> float:
        """Current angle, degrees."""
        return self._stage.read(self._within_s).angle_deg

    def set(self, value: float) -> Status:
        """Start a move."""
        self._goal = float(value)
        self._stopped = None

        def move() -> None:
            with self._turn:
                if not self._stage.read(self._within_s).homed:
                    self._stage.home(self._within_s)
                self._stage.begin_move(float(value))
                self._finish(time.monotonic() + self._within_s)

        return Status(move)

    def _finish(self, until: float) -> None:
        # Wait in short intervals, so that another thread can stop the stage.
        while self._stopped is None:
            try:
                self._stage.finish_move(_LOOK_S)
                break
            except (InstrumentError, TimeoutError) as error:
                passes = isinstance(error, TimeoutError) or error.fault == "timeout"
                if not passes or time.monotonic() > until:
                    raise
        if self._stopped is False:
            raise InstrumentError("stalled", "the stage was stopped during the move", self.name)

    def stop(self, success: bool = False) -> None:
        """Stop immediately. The move in progress fails, unless `success`."""
        self._stopped = success
        self._stage.stop(self._within_s)

    def locate(self) -> dict[str, float]:
        """Return the target and the current position."""
        at = self.position
        return {"setpoint": at if self._goal is None else self._goal, "readback": at}

    def read(self) -> dict[str, Any]:
        """Read the current angle."""
        return self._reading(self.position)

    def describe(self) -> dict[str, Any]:
        """Describe the keys of `read`."""
        return {self.name: {"source": f"pysunstone:{self.name}", "dtype": "number", "shape": [], "units": "deg"}}


class MovableProjector(_AsDevice):
    """A projector as a device of bluesky. Set it to the number of a pattern; -1 turns the light off."""

    def __init__(
        self, projector: PatternProjector, name: str, patterns: Sequence[npt.NDArray[np.uint8]], *, within_s: float = 30.0
    ) -> None:
        super().__init__(name)
        self._projector = projector
        self._within_s = within_s
        self._shown = -1
        projector.load(patterns, within_s)

    def set(self, value: int) -> Status:
        """Show a pattern."""

        def show() -> None:
            with self._turn:
                if value < 0:
                    self._projector.dark(self._within_s)
                else:
                    self._projector.show(int(value), self._within_s)
                self._shown = int(value)

        return Status(show)

    def read(self) -> dict[str, Any]:
        """Read the number of the current pattern."""
        return self._reading(self._shown)

    def describe(self) -> dict[str, Any]:
        """Describe the keys of `read`."""
        return {self.name: {"source": f"pysunstone:{self.name}", "dtype": "integer", "shape": []}}


class ReadableCamera(_AsDevice):
    """A camera as a device of bluesky: `Triggerable` and `Readable`. Its image is an array (rows, columns) of digital numbers."""

    def __init__(self, camera: AreaCamera, name: str, settings: CameraSettings, *, within_s: float = 30.0) -> None:
        super().__init__(name)
        self._camera = camera
        self._settings = settings
        self._within_s = within_s
        self._image: npt.NDArray[Any] | None = None
        camera.configure(settings, within_s)

    def trigger(self) -> Status:
        """Take an image."""

        def take() -> None:
            with self._turn:
                self._camera.expose()
                frame = self._camera.frame(self._settings.exposure_s + self._within_s)
                self._image = frame.pixels if isinstance(frame, Frame) else frame

        return Status(take)

    def read(self) -> dict[str, Any]:
        """Read the last image."""
        if self._image is None:
            raise InstrumentError("refused", "no image was taken; trigger the camera first", self.name)
        return self._reading(self._image)

    def describe(self) -> dict[str, Any]:
        """Describe the keys of `read`."""
        region = self._settings.region
        shape = [region.height, region.width]
        return {self.name: {"source": f"pysunstone:{self.name}", "dtype": "array", "dtype_numpy": "<u2", "shape": shape}}

    def read_configuration(self) -> dict[str, Any]:
        """Read the exposure time and gain."""
        settings = self._settings
        found = {"exposure_s": settings.exposure_s, "gain_db": settings.gain_db}
        return {f"{self.name}-{key}": {"value": value, "timestamp": time.time()} for key, value in found.items()}

    def describe_configuration(self) -> dict[str, Any]:
        """Describe the keys of `read_configuration`."""
        units = {"exposure_s": "s", "gain_db": "dB"}
        return {
            f"{self.name}-{key}": {"source": f"pysunstone:{self.name}", "dtype": "number", "shape": [], "units": unit}
            for key, unit in units.items()
        }

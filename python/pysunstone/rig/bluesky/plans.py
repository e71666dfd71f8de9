"""Instruments as devices of bluesky, for its RunEngine."""

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

#: How long a stage is waited for at a time, seconds.
_LOOK_S = 0.2


class Status:
    """The status of work on a thread of its own, as bluesky has it."""

    def __init__(self, work: Callable[[], object]) -> None:
        self._future: concurrent.futures.Future[object] = concurrent.futures.Future()

        def do() -> None:
            try:
                self._future.set_result(work())
            except BaseException as error:
                self._future.set_exception(error)

        threading.Thread(target=do, daemon=True).start()

    def add_callback(self, callback: Callable[[Status], object]) -> None:
        """Call with this status when it ends; at once where it has."""
        self._future.add_done_callback(lambda _: callback(self))

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        """What it failed with; ``TimeoutError`` where it has not ended."""
        try:
            return self._future.exception(timeout)
        except concurrent.futures.TimeoutError:
            raise TimeoutError("it has not ended") from None

    def wait(self, timeout: float | None = None) -> None:
        """Wait for its end; raises what it failed with."""
        self._future.result(timeout)

    @property
    def done(self) -> bool:
        """It has ended."""
        return self._future.done()

    @property
    def success(self) -> bool:
        """It has ended well."""
        return self.done and self._future.exception() is None


class _AsDevice:
    """What all devices of bluesky have."""

    parent = None

    def __init__(self, name: str) -> None:
        self.name = name
        self._turn = threading.Lock()

    def read_configuration(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def describe_configuration(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def _reading(self, value: Any) -> dict[str, Any]:
        return {self.name: {"value": value, "timestamp": time.time()}}


class MovableStage(_AsDevice):
    """A rotation stage as a device of bluesky: `Movable`, `Locatable`, `Readable` and `Stoppable`, in degrees of its own scale.

    A stage whose zero is not known is homed before its first move.
    """

    def __init__(self, stage: RotationStage, name: str, *, within_s: float = 600.0) -> None:
        super().__init__(name)
        self._stage = stage
        self._within_s = within_s
        self._goal: float | None = None
        self._stopped: bool | None = None

    @property
    def hints(self) -> dict[str, Any]:
        """What plots show."""
        return {"fields": [self.name]}

    @property
    def position(self) -> float:
        """Where it is."""
        return self._stage.read(self._within_s).angle_deg

    def set(self, value: float) -> Status:
        """Begin a move."""
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
        # In short waits, so that another thread comes to stop it.
        while self._stopped is None:
            try:
                self._stage.finish_move(_LOOK_S)
                break
            except (InstrumentError, TimeoutError) as error:
                passes = isinstance(error, TimeoutError) or error.fault == "timeout"
                if not passes or time.monotonic() > until:
                    raise
        if self._stopped is False:
            raise InstrumentError("stalled", "it was stopped on its way", self.name)

    def stop(self, success: bool = False) -> None:
        """Stop at once; what was on its way fails, unless `success`."""
        self._stopped = success
        self._stage.stop(self._within_s)

    def locate(self) -> dict[str, float]:
        """Where it was sent, and where it is."""
        at = self.position
        return {"setpoint": at if self._goal is None else self._goal, "readback": at}

    def read(self) -> dict[str, Any]:
        """Where it is."""
        return self._reading(self.position)

    def describe(self) -> dict[str, Any]:
        """What `read` has."""
        return {self.name: {"source": f"pysunstone:{self.name}", "dtype": "number", "shape": [], "units": "deg"}}


class MovableProjector(_AsDevice):
    """A projector as a device of bluesky that is set to the number of a pattern; -1 is no light."""

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
        """The pattern that is shown."""
        return self._reading(self._shown)

    def describe(self) -> dict[str, Any]:
        """What `read` has."""
        return {self.name: {"source": f"pysunstone:{self.name}", "dtype": "integer", "shape": []}}


class ReadableCamera(_AsDevice):
    """A camera as a device of bluesky: `Triggerable` and `Readable`; its picture is an array (rows, columns) of digital numbers."""

    def __init__(self, camera: AreaCamera, name: str, settings: CameraSettings, *, within_s: float = 30.0) -> None:
        super().__init__(name)
        self._camera = camera
        self._settings = settings
        self._within_s = within_s
        self._image: npt.NDArray[Any] | None = None
        camera.configure(settings, within_s)

    def trigger(self) -> Status:
        """Take a picture."""

        def take() -> None:
            with self._turn:
                self._camera.expose()
                frame = self._camera.frame(self._settings.exposure_s + self._within_s)
                self._image = frame.pixels if isinstance(frame, Frame) else frame

        return Status(take)

    def read(self) -> dict[str, Any]:
        """The last picture."""
        if self._image is None:
            raise InstrumentError("refused", "no picture was taken; trigger it first", self.name)
        return self._reading(self._image)

    def describe(self) -> dict[str, Any]:
        """What `read` has."""
        region = self._settings.region
        shape = [region.height, region.width]
        return {self.name: {"source": f"pysunstone:{self.name}", "dtype": "array", "dtype_numpy": "<u2", "shape": shape}}

    def read_configuration(self) -> dict[str, Any]:
        """Exposure and gain."""
        settings = self._settings
        found = {"exposure_s": settings.exposure_s, "gain_db": settings.gain_db}
        return {f"{self.name}-{key}": {"value": value, "timestamp": time.time()} for key, value in found.items()}

    def describe_configuration(self) -> dict[str, Any]:
        """What `read_configuration` has."""
        units = {"exposure_s": "s", "gain_db": "dB"}
        return {
            f"{self.name}-{key}": {"source": f"pysunstone:{self.name}", "dtype": "number", "shape": [], "units": unit}
            for key, unit in units.items()
        }

"""The bridge to bluesky and ophyd-async: their devices as instruments of a session, and instruments as their devices.

A device is known by bluesky's protocols alone, so that neither library is needed here: `Movable` (``set`` gives a status), `Readable`,
`Locatable`, `Triggerable`, `Stoppable`; those of ophyd-async, whose methods are coroutines, as well.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import inspect
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from pysunstone.rig.instruments import (
    AreaCamera,
    CameraLimits,
    CameraSettings,
    Frame,
    Identity,
    InstrumentError,
    PatternProjector,
    RotationStage,
    StageLimits,
    StageReading,
)

__all__ = ["CameraOfDevice", "ReadableCamera", "MovableProjector", "MovableStage", "StageOfDevice", "Status", "event_loop"]

#: Longest wait for an answer that no deadline of the session is given for, seconds.
_ANSWER_S = 10.0
#: How long a stage of ours is waited for at a time, seconds.
_LOOK_S = 0.2
_own_loop: asyncio.AbstractEventLoop | None = None
_lock = threading.Lock()


def event_loop() -> asyncio.AbstractEventLoop:
    """The loop in which devices are asked: that of bluesky's RunEngine where there is one, else one on a thread of its own.

    Devices of ophyd-async belong to the loop in which they were connected: connect them in this one,
    ``asyncio.run_coroutine_threadsafe(device.connect(), event_loop()).result()``, or by ophyd-async's ``init_devices`` after a RunEngine
    was made.
    """
    engine = sys.modules.get("bluesky.run_engine")
    found: asyncio.AbstractEventLoop | None = engine.get_bluesky_event_loop() if engine else None
    if found is not None and found.is_running():
        return found
    global _own_loop
    with _lock:
        if _own_loop is None:
            _own_loop = asyncio.new_event_loop()
            threading.Thread(target=_own_loop.run_forever, name="pysunstone devices", daemon=True).start()
        return _own_loop


class _Device:
    """A device whose methods may be coroutines."""

    def __init__(self, device: Any, loop: asyncio.AbstractEventLoop | None) -> None:
        self.device = device
        self._loop = loop

    def name(self) -> str:
        return str(getattr(self.device, "name", "") or type(self.device).__name__)

    def ask(self, method: Callable[..., Any], *arguments: Any, within_s: float) -> Any:
        """What a method answers, or what its coroutine does."""

        async def asked() -> Any:
            answer = method(*arguments)
            return await answer if inspect.isawaitable(answer) else answer

        return self._run(asked, within_s)

    def begin(self, method: Callable[..., Any], *arguments: Any) -> Any:
        """The status of what a method begins."""

        async def begun() -> Any:
            return method(*arguments)

        return self._run(begun, _ANSWER_S)

    def wait(self, status: Any, within_s: float) -> None:
        """Waits for a status; raises what it failed with."""
        ended = threading.Event()

        def end(_: object) -> None:
            ended.set()

        async def listen() -> None:
            # Callbacks of asyncio's tasks are added in their own thread.
            status.add_callback(end)

        self._run(listen, _ANSWER_S)
        if not ended.wait(within_s):
            raise TimeoutError(f"{self.name()} is not done after {within_s:.1f} s")
        error = status.exception()
        if isinstance(error, asyncio.CancelledError):
            raise RuntimeError(f"{self.name()} was stopped on its way") from error
        if error is not None:
            raise error
        if not status.success:
            raise RuntimeError(f"{self.name()} did not do it, and does not say why")

    def _run(self, work: Callable[[], Any], within_s: float) -> Any:
        future = asyncio.run_coroutine_threadsafe(work(), self._loop or event_loop())
        try:
            return future.result(min(within_s, threading.TIMEOUT_MAX))
        except concurrent.futures.TimeoutError:
            if not future.done():
                future.cancel()
                raise TimeoutError(f"{self.name()} does not answer within {within_s:.1f} s") from None
            raise

    def identity(self) -> Identity:
        of = cast("type[object]", type(self.device))
        return Identity(of.__module__.partition(".")[0], of.__name__, self.name())

    def value(self, key: str | None, within_s: float) -> Any:
        """What it reads: the value of a key; of its own name, or its only one, without a key."""
        reading = self.ask(self.device.read, within_s=within_s)
        wanted = key if key is not None else self.name()
        if wanted not in reading and key is None and len(reading) == 1:
            wanted = next(iter(reading))
        if wanted not in reading:
            raise InstrumentError("refused", f"`read` has no `{wanted}`, but {', '.join(reading)}; name one with key=")
        return reading[wanted]["value"]


class StageOfDevice(RotationStage):
    """A bluesky device that moves, as a rotation stage.

    Parameters
    ----------
    device
        `Movable` in degrees, and `Locatable` or `Readable`; `Stoppable` where it can stop.
    limits
        What it can do: a session holds it to that.
    home
        Called to find its zero, on the session's thread. Without it the device is taken to know its zero always.
    key
        Of ``read`` of a device that is not `Locatable`; its own name without it.
    loop
        Where its coroutines run; `event_loop` without it.
    """

    def __init__(
        self,
        device: Any,
        limits: StageLimits | None = None,
        *,
        home: Callable[[], object] | None = None,
        key: str | None = None,
        loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        self._of = _Device(device, loop)
        self._limits = limits or StageLimits()
        self._home = home
        self._homed = home is None
        self._key = key
        self._status: Any = None

    def limits(self) -> StageLimits:
        return self._limits

    def identify(self, within_s: float) -> Identity:
        return self._of.identity()

    def reconnect(self, within_s: float) -> None:
        self._status = None
        _reconnect(self._of, within_s)

    def home(self, within_s: float) -> None:
        if self._home is not None:
            self._home()
            self._homed = True
        self.begin_move(0.0)
        self.finish_move(within_s)

    def begin_move(self, angle_deg: float) -> None:
        if self._status is not None and not self._status.done:
            # Devices of bluesky take no second goal on their way to a first one.
            self.stop(_ANSWER_S)
        self._status = self._of.begin(self._of.device.set, angle_deg)

    def finish_move(self, within_s: float) -> StageReading:
        if self._status is not None:
            try:
                self._of.wait(self._status, within_s)
            except (TimeoutError, InstrumentError):
                raise
            except Exception as error:
                raise InstrumentError("stalled", f"its move failed: {error}") from error
        return self.read(within_s)

    def read(self, within_s: float) -> StageReading:
        device = self._of.device
        if hasattr(device, "locate"):
            angle = self._of.ask(device.locate, within_s=within_s)["readback"]
        else:
            angle = self._of.value(self._key, within_s)
        moving = self._status is not None and not self._status.done
        return StageReading(float(angle), moving, self._homed)

    def stop(self, within_s: float) -> None:
        stop = getattr(self._of.device, "stop", None)
        if stop is not None:
            self._of.ask(stop, within_s=within_s)
        if self._status is not None:
            # A status that the stop ended has failed, which is as it should be.
            until = time.monotonic() + within_s
            while not self._status.done and time.monotonic() < until:
                time.sleep(0.005)
            if not self._status.done:
                raise TimeoutError(f"{self._of.name()} cannot be stopped, or moves still after {within_s:.1f} s")
            self._status = None


class CameraOfDevice(AreaCamera):
    """A bluesky device that is triggered and read, as a camera.

    Parameters
    ----------
    device
        `Triggerable`, and `Readable` with an array of integers: its picture. Detectors that write their pictures into files are not read.
    limits
        What it can do. Pictures of the whole sensor are cut to the region that is asked for.
    exposure
        `Movable`: the exposure, seconds. Without it the device exposes as it is set, whatever the plan says.
    gain
        `Movable`: the gain, decibels.
    key
        Of the picture in ``read``; the device's own name, or the only one there is, without it.
    loop
        Where its coroutines run; `event_loop` without it.
    """

    def __init__(
        self,
        device: Any,
        limits: CameraLimits,
        *,
        exposure: Any = None,
        gain: Any = None,
        key: str | None = None,
        loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        self._of = _Device(device, loop)
        self._limits = limits
        self._exposure = None if exposure is None else _Device(exposure, loop)
        self._gain = None if gain is None else _Device(gain, loop)
        self._key = key
        self._settings: CameraSettings | None = None
        self._status: Any = None

    def limits(self) -> CameraLimits:
        return self._limits

    def identify(self, within_s: float) -> Identity:
        return self._of.identity()

    def reconnect(self, within_s: float) -> None:
        self._status = self._settings = None
        _reconnect(self._of, within_s)

    def configure(self, settings: CameraSettings, within_s: float) -> None:
        if settings.trigger != "software":
            raise InstrumentError("limit", "a device of bluesky is triggered by software alone")
        for device, value in ((self._exposure, settings.exposure_s), (self._gain, settings.gain_db)):
            if device is not None:
                device.wait(device.begin(device.device.set, value), within_s)
        self._settings, self._status = settings, None

    def expose(self) -> None:
        self._status = self._of.begin(self._of.device.trigger)

    def frame(self, within_s: float) -> npt.NDArray[Any]:
        settings = self._settings
        if settings is None or self._status is None:
            raise InstrumentError("refused", "no exposure was begun")
        self._of.wait(self._status, within_s)
        image = np.asarray(self._of.value(self._key, _ANSWER_S))
        if np.issubdtype(image.dtype, np.signedinteger) and image.size and image.min() >= 0:
            image = image.astype(np.uint32)
        region = settings.region
        if image.shape == (self._limits.size[1], self._limits.size[0]):
            image = image[region.y : region.y + region.height, region.x : region.x + region.width]
        return image


def _reconnect(of: _Device, within_s: float) -> None:
    connect = getattr(of.device, "connect", None)
    if connect is not None and inspect.iscoroutinefunction(connect):
        of.ask(lambda: connect(force_reconnect=True), within_s=within_s)


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

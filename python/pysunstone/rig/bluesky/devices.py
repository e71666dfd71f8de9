"""Devices of bluesky and ophyd-async as instruments of a session."""

from __future__ import annotations

import asyncio
import concurrent.futures
import inspect
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from pysunstone.rig.instruments import (
    AreaCamera,
    CameraLimits,
    CameraSettings,
    Identity,
    InstrumentError,
    RotationStage,
    StageLimits,
    StageReading,
)

__all__ = ["CameraOfDevice", "Device", "StageOfDevice", "event_loop", "position", "reconnect"]

#: Timeout in seconds for requests to which the session gives no deadline.
_ANSWER_S = 10.0
_own_loop: asyncio.AbstractEventLoop | None = None
_lock = threading.Lock()


def event_loop() -> asyncio.AbstractEventLoop:
    """Return the event loop for devices: that of bluesky's RunEngine if there is one, otherwise a loop on a separate thread.

    Devices of ophyd-async belong to the loop in which they were connected. Connect them in this loop, with
    ``asyncio.run_coroutine_threadsafe(device.connect(), event_loop()).result()``, or with ophyd-async's ``init_devices`` after
    you have created a RunEngine.
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


class Device:
    """A device whose methods may be coroutines."""

    def __init__(self, device: Any, loop: asyncio.AbstractEventLoop | None) -> None:
        self.device = device
        self._loop = loop

    def name(self) -> str:
        return str(getattr(self.device, "name", "") or type(self.device).__name__)

    def ask(self, method: Callable[..., Any], *arguments: Any, within_s: float) -> Any:
        """Return the result of a method or of its coroutine."""

        async def asked() -> Any:
            answer = method(*arguments)
            return await answer if inspect.isawaitable(answer) else answer

        return self._run(asked, within_s)

    def begin(self, method: Callable[..., Any], *arguments: Any) -> Any:
        """Return the status of an operation that a method starts."""

        async def begun() -> Any:
            return method(*arguments)

        return self._run(begun, _ANSWER_S)

    def wait(self, status: Any, within_s: float) -> None:
        """Wait for a status; raise its exception if it failed."""
        ended = threading.Event()

        def end(_: object) -> None:
            ended.set()

        async def listen() -> None:
            # Callbacks of asyncio tasks must be added in the thread of their loop.
            status.add_callback(end)

        self._run(listen, _ANSWER_S)
        if not ended.wait(within_s):
            raise TimeoutError(f"{self.name()} did not finish within {within_s:.1f} s")
        error = status.exception()
        if isinstance(error, asyncio.CancelledError):
            raise RuntimeError(f"{self.name()} was stopped during the operation") from error
        if error is not None:
            raise error
        if not status.success:
            raise RuntimeError(f"{self.name()} failed without stating a reason")

    def _run(self, work: Callable[[], Any], within_s: float) -> Any:
        future = asyncio.run_coroutine_threadsafe(work(), self._loop or event_loop())
        try:
            return future.result(min(within_s, threading.TIMEOUT_MAX))
        except concurrent.futures.TimeoutError:
            if not future.done():
                future.cancel()
                raise TimeoutError(f"{self.name()} did not answer within {within_s:.1f} s") from None
            raise

    def identity(self) -> Identity:
        of = cast("type[object]", type(self.device))
        return Identity(of.__module__.partition(".")[0], of.__name__, self.name())

    def value(self, key: str | None, within_s: float) -> Any:
        """Return the value of a key that the device reads. By default the key is the device's name, or the only key."""
        reading = self.ask(self.device.read, within_s=within_s)
        wanted = key if key is not None else self.name()
        if wanted not in reading and key is None and len(reading) == 1:
            wanted = next(iter(reading))
        if wanted not in reading:
            raise InstrumentError("refused", f"`read` returned no key `{wanted}`; available keys: {', '.join(reading)}; pass one of them as key=")
        return reading[wanted]["value"]


class StageOfDevice(RotationStage):
    """A bluesky device that moves, as a rotation stage.

    Parameters
    ----------
    device
        `Movable` in degrees, and `Locatable` or `Readable`; `Stoppable` if it can stop.
    limits
        Limits of the stage, which the session enforces.
    home
        Function that finds the zero position, called on the session's thread. Without this function, the zero position counts as
        always known.
    key
        Key of ``read``, for a device that is not `Locatable`; by default the device's name.
    loop
        Event loop of the device's coroutines; by default `event_loop`.
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
        self._of = Device(device, loop)
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
        reconnect(self._of, within_s)

    def home(self, within_s: float) -> None:
        if self._home is not None:
            self._home()
            self._homed = True
        self.begin_move(0.0)
        self.finish_move(within_s)

    def begin_move(self, angle_deg: float) -> None:
        if self._status is not None and not self._status.done:
            # Devices of bluesky do not accept a new target during a move.
            self.stop(_ANSWER_S)
        self._status = self._of.begin(self._of.device.set, angle_deg)

    def finish_move(self, within_s: float) -> StageReading:
        if self._status is not None:
            try:
                self._of.wait(self._status, within_s)
            except (TimeoutError, asyncio.TimeoutError, InstrumentError):
                raise
            except Exception as error:
                raise InstrumentError("stalled", f"the move failed: {error}") from error
        return self.read(within_s)

    def read(self, within_s: float) -> StageReading:
        moving = self._status is not None and not self._status.done
        return StageReading(position(self._of, self._key, within_s), moving, self._homed)

    def stop(self, within_s: float) -> None:
        stop = getattr(self._of.device, "stop", None)
        if stop is not None:
            self._of.ask(stop, within_s=within_s)
        if self._status is not None:
            # The status of a stopped move fails; this is expected.
            until = time.monotonic() + within_s
            while not self._status.done and time.monotonic() < until:
                time.sleep(0.005)
            if not self._status.done:
                raise TimeoutError(f"{self._of.name()} did not stop within {within_s:.1f} s")
            # asyncio warns about exceptions that are never retrieved.
            self._status.exception()
            self._status = None


class CameraOfDevice(AreaCamera):
    """A bluesky device that is triggered and read, as a camera.

    Parameters
    ----------
    device
        `Triggerable`, and `Readable` with an integer array, the image. Detectors that write their images to files are not
        supported.
    limits
        Limits of the camera. Images of the whole sensor are cropped to the requested region.
    exposure
        `Movable`: exposure time, seconds. If None, the device keeps its exposure time, regardless of the plan.
    gain
        `Movable`: gain, decibels.
    key
        Key of the image in ``read``; by default the device's name, or the only key.
    loop
        Event loop of the device's coroutines; by default `event_loop`.
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
        self._of = Device(device, loop)
        self._limits = limits
        self._exposure = None if exposure is None else Device(exposure, loop)
        self._gain = None if gain is None else Device(gain, loop)
        self._key = key
        self._settings: CameraSettings | None = None
        self._status: Any = None

    def limits(self) -> CameraLimits:
        return self._limits

    def identify(self, within_s: float) -> Identity:
        return self._of.identity()

    def reconnect(self, within_s: float) -> None:
        self._status = self._settings = None
        reconnect(self._of, within_s)

    def configure(self, settings: CameraSettings, within_s: float) -> None:
        if settings.trigger != "software":
            raise InstrumentError("limit", "a device of bluesky supports only the software trigger")
        for device, value in ((self._exposure, settings.exposure_s), (self._gain, settings.gain_db)):
            if device is not None:
                device.wait(device.begin(device.device.set, value), within_s)
        self._settings, self._status = settings, None

    def expose(self) -> None:
        self._status = self._of.begin(self._of.device.trigger)

    def frame(self, within_s: float) -> npt.NDArray[Any]:
        settings = self._settings
        if settings is None or self._status is None:
            raise InstrumentError("refused", "no exposure was started")
        self._of.wait(self._status, within_s)
        image = np.asarray(self._of.value(self._key, _ANSWER_S))
        if np.issubdtype(image.dtype, np.signedinteger) and image.size and image.min() >= 0:
            image = image.astype(np.uint32)
        region = settings.region
        if image.shape == (self._limits.size[1], self._limits.size[0]):
            image = image[region.y : region.y + region.height, region.x : region.x + region.width]
        return image


def position(of: Device, key: str | None, within_s: float) -> float:
    """Return the position of a device: from ``locate`` if available, else from a key that it reads."""
    locate = getattr(of.device, "locate", None)
    if locate is not None:
        return float(of.ask(locate, within_s=within_s)["readback"])
    return float(of.value(key, within_s))


def reconnect(of: Device, within_s: float) -> None:
    """Reconnect a device of ophyd-async; other devices manage their own connections."""
    connect = getattr(of.device, "connect", None)
    if connect is not None and inspect.iscoroutinefunction(connect):
        of.ask(lambda: connect(force_reconnect=True), within_s=within_s)

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

#: Longest wait for an answer that no deadline of the session is given for, seconds.
_ANSWER_S = 10.0
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


class Device:
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
            # Devices of bluesky take no second goal on their way to a first one.
            self.stop(_ANSWER_S)
        self._status = self._of.begin(self._of.device.set, angle_deg)

    def finish_move(self, within_s: float) -> StageReading:
        if self._status is not None:
            try:
                self._of.wait(self._status, within_s)
            except (TimeoutError, asyncio.TimeoutError, InstrumentError):
                raise
            except Exception as error:
                raise InstrumentError("stalled", f"its move failed: {error}") from error
        return self.read(within_s)

    def read(self, within_s: float) -> StageReading:
        moving = self._status is not None and not self._status.done
        return StageReading(position(self._of, self._key, within_s), moving, self._homed)

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
            # asyncio complains of failures that nobody looked at.
            self._status.exception()
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


def position(of: Device, key: str | None, within_s: float) -> float:
    """Where a device is: by ``locate`` where it has that, else a key of what it reads."""
    locate = getattr(of.device, "locate", None)
    if locate is not None:
        return float(of.ask(locate, within_s=within_s)["readback"])
    return float(of.value(key, within_s))


def reconnect(of: Device, within_s: float) -> None:
    """Connects a device of ophyd-async anew; others mind their own lines."""
    connect = getattr(of.device, "connect", None)
    if connect is not None and inspect.iscoroutinefunction(connect):
        of.ask(lambda: connect(force_reconnect=True), within_s=within_s)

"""Devices of bluesky and ophyd-async as the instruments of a scan: mirrors, laser, photon counter."""

from __future__ import annotations

import asyncio
import time
from typing import Any

import numpy as np

from pysunstone.rig.bluesky.devices import Device, position, reconnect
from pysunstone.rig.instruments import (
    CounterLimits,
    CounterSettings,
    GalvoLimits,
    GalvoScanner,
    Histogram,
    Identity,
    InstrumentError,
    LaserLimits,
    LaserState,
    PhotonCounter,
    PulsedLaser,
)

__all__ = ["CounterOfDevice", "GalvoOfDevices", "LaserOfDevices"]


class GalvoOfDevices(GalvoScanner):
    """Two bluesky devices that move, as a pair of galvo mirrors.

    Parameters
    ----------
    x, y
        `Movable` in optical degrees from the axis, and `Locatable` or `Readable`. Both move simultaneously.
    limits
        Limits of the mirrors. After both moves, the scanner waits for ``settle_s``.
    loop
        Event loop of the devices' coroutines; by default `event_loop`.
    """

    def __init__(self, x: Any, y: Any, limits: GalvoLimits, *, loop: asyncio.AbstractEventLoop | None = None) -> None:
        self._axes = [Device(x, loop), Device(y, loop)]
        self._limits = limits

    def limits(self) -> GalvoLimits:
        return self._limits

    def identify(self, within_s: float) -> Identity:
        return self._axes[0].identity()

    def reconnect(self, within_s: float) -> None:
        for axis in self._axes:
            reconnect(axis, within_s)

    def point(self, angles_deg: tuple[float, float], within_s: float) -> tuple[float, float]:
        until = time.monotonic() + within_s
        begun = [(axis, axis.begin(axis.device.set, angle)) for axis, angle in zip(self._axes, angles_deg, strict=True)]
        for axis, status in begun:
            axis.wait(status, max(0.0, until - time.monotonic()))
        time.sleep(self._limits.settle_s)
        x, y = (position(axis, None, within_s) for axis in self._axes)
        return x, y


class LaserOfDevices(PulsedLaser):
    """A bluesky device that controls a laser's shutter, as a pulsed laser.

    Parameters
    ----------
    shutter
        `Movable`: 1 is open, 0 is closed; `Locatable` or `Readable`.
    limits
        Wavelength and pulse rates.
    rate
        `Movable`: pulses per second. If None, the laser keeps its rate.
    power
        `Readable`: mean power relative to the nominal power. If None, plans do not wait for the power.
    loop
        Event loop of the devices' coroutines; by default `event_loop`.
    """

    def __init__(
        self,
        shutter: Any,
        limits: LaserLimits,
        *,
        rate: Any = None,
        power: Any = None,
        loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        self._shutter = Device(shutter, loop)
        self._rate = None if rate is None else Device(rate, loop)
        self._power = None if power is None else Device(power, loop)
        self._limits = limits
        self._hz = limits.rate_hz[0]

    def limits(self) -> LaserLimits:
        return self._limits

    def identify(self, within_s: float) -> Identity:
        return self._shutter.identity()

    def reconnect(self, within_s: float) -> None:
        reconnect(self._shutter, within_s)

    def emit(self, on: bool, rate_hz: float, within_s: float) -> None:
        if on and self._rate is not None:
            self._rate.wait(self._rate.begin(self._rate.device.set, rate_hz), within_s)
        if on:
            self._hz = rate_hz
        self._shutter.wait(self._shutter.begin(self._shutter.device.set, int(on)), within_s)

    def state(self, within_s: float) -> LaserState:
        emitting = position(self._shutter, None, within_s) > 0.5
        power = float(emitting) if self._power is None else float(self._power.value(None, within_s))
        return LaserState(emitting, self._hz, power)


class CounterOfDevice(PhotonCounter):
    """A bluesky device that is triggered and read, as a photon counter.

    Parameters
    ----------
    device
        `Triggerable`, and `Readable` with an array of counts per bin that begins at the sync pulse. Surplus bins are ignored.
    limits
        Limits of the counter. All bins have the finest width of these limits.
    rate_hz
        Pulse rate of the laser, as in the plan, used to compute the number of pulses.
    dwell
        `Movable`: counting time, seconds. If None, the device keeps its counting time, regardless of the plan.
    key
        Key of the counts in ``read``; by default the device's name, or the only key.
    loop
        Event loop of the device's coroutines; by default `event_loop`.
    """

    def __init__(
        self,
        device: Any,
        limits: CounterLimits,
        *,
        rate_hz: float,
        dwell: Any = None,
        key: str | None = None,
        loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        self._of = Device(device, loop)
        self._dwell = None if dwell is None else Device(dwell, loop)
        self._limits = limits
        self._rate_hz = rate_hz
        self._key = key
        self._settings: CounterSettings | None = None
        self._status: Any = None

    def limits(self) -> CounterLimits:
        return self._limits

    def identify(self, within_s: float) -> Identity:
        return self._of.identity()

    def reconnect(self, within_s: float) -> None:
        self._status = self._settings = None
        reconnect(self._of, within_s)

    def configure(self, settings: CounterSettings, within_s: float) -> None:
        if settings.bin_ps != self._limits.finest_ps or settings.offset_ps != 0 or settings.tags:
            raise InstrumentError(
                "limit",
                f"the device has bins of {self._limits.finest_ps} ps from the sync pulse, and no time tags; correct bin_ps, offset_ps, time_tags",
            )
        if self._dwell is not None:
            self._dwell.wait(self._dwell.begin(self._dwell.device.set, settings.dwell_s), within_s)
        self._settings, self._status = settings, None

    def begin(self) -> None:
        self._status = self._of.begin(self._of.device.trigger)

    def finish(self, within_s: float) -> Histogram:
        settings = self._settings
        if settings is None or self._status is None:
            raise InstrumentError("refused", "no acquisition was started")
        self._of.wait(self._status, within_s)
        counts = np.asarray(self._of.value(self._key, within_s))
        return Histogram(counts[: settings.bins], round(settings.dwell_s * self._rate_hz))

"""Devices of bluesky and ophyd-async as what a scan is made with: mirrors, laser, photon counter."""

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
    """Two bluesky devices that move, as a pair of mirrors.

    Parameters
    ----------
    x, y
        `Movable` in optical degrees from the axis, and `Locatable` or `Readable`. Both move at once.
    limits
        What they can do; after both have ended, the beam is given ``settle_s``.
    loop
        Where their coroutines run; `event_loop` without it.
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
    """A bluesky device that opens a laser's shutter, as a pulsed laser.

    Parameters
    ----------
    shutter
        `Movable`: 1 lets light out, 0 does not; `Locatable` or `Readable`.
    limits
        Its wavelength and rates.
    rate
        `Movable`: pulses a second. Without it the laser has the rate that it has.
    power
        `Readable`: mean power over nominal. Without it plans wait for no power.
    loop
        Where their coroutines run; `event_loop` without it.
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
        `Triggerable`, and `Readable` with an array of counts by bin, which begins at the sync pulse; more bins than are asked for are cut.
    limits
        What it can do. Bins have its finest width alone.
    rate_hz
        Rate of the laser, by which pulses are reckoned: that of the plan.
    dwell
        `Movable`: how long photons are counted, seconds. Without it the device counts as it is set, whatever the plan says.
    key
        Of the counts in ``read``; the device's own name, or the only one there is, without it.
    loop
        Where its coroutines run; `event_loop` without it.
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
                f"it has bins of {self._limits.finest_ps} ps from the sync pulse on, and no time tags; correct bin_ps, offset_ps, time_tags",
            )
        if self._dwell is not None:
            self._dwell.wait(self._dwell.begin(self._dwell.device.set, settings.dwell_s), within_s)
        self._settings, self._status = settings, None

    def begin(self) -> None:
        self._status = self._of.begin(self._of.device.trigger)

    def finish(self, within_s: float) -> Histogram:
        settings = self._settings
        if settings is None or self._status is None:
            raise InstrumentError("refused", "no acquisition was begun")
        self._of.wait(self._status, within_s)
        counts = np.asarray(self._of.value(self._key, within_s))
        return Histogram(counts[: settings.bins], round(settings.dwell_s * self._rate_hz))

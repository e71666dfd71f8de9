"""The bridge to bluesky, with bluesky's RunEngine and simulated devices of ophyd and ophyd-async."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bluesky.plan_stubs as bps
import bluesky.plans as bp
import numpy as np
import numpy.typing as npt
import ophyd.sim
import pytest
import rigs
from bluesky import protocols
from bluesky.run_engine import RunEngine
from ophyd_async.core import Array1D, AsyncStatus, StandardReadable, init_devices, soft_signal_r_and_setter, soft_signal_rw
from ophyd_async.sim import SimMotor
from rendered import ROOT

import pysunstone as ps
from pysunstone import rig
from pysunstone.rig.bluesky import (
    CameraOfDevice,
    CounterOfDevice,
    GalvoOfDevices,
    LaserOfDevices,
    MovableProjector,
    MovableStage,
    ReadableCamera,
    StageOfDevice,
    Status,
    event_loop,
)


@pytest.fixture(scope="module")
def engine() -> Iterator[RunEngine]:
    made = RunEngine(call_returns_result=True)
    yield made
    made.loop.call_soon_threadsafe(made.loop.stop)


@pytest.fixture
def session(tmp_path: Path) -> rig.Session:
    return rig.Session(rigs.write(tmp_path) / "camera.toml")


def motor(speed: float) -> SimMotor:
    """Return a motor of ophyd-async in degrees, connected in bluesky's event loop."""
    with init_devices():
        made = SimMotor("motor", instant=speed == 0, units="deg")

    async def set_up() -> None:
        if speed:
            await made.velocity.set(speed)
            await made.acceleration_time.set(0.05)

    asyncio.run_coroutine_threadsafe(set_up(), event_loop()).result(5)
    return made


def test_an_ophyd_async_motor_conforms_as_a_stage(engine: RunEngine) -> None:
    assert event_loop() is engine.loop
    stage = StageOfDevice(motor(400.0), rig.StageLimits((-720, 720), 400, 8000, 0.001))
    report = rig.check(stage)
    assert report and len(report) == 18, str(report)


def test_a_motor_that_misses_its_target_is_detected(engine: RunEngine) -> None:
    class Skewed(SimMotor):
        async def locate(self) -> Any:
            where = await super().locate()
            return {"setpoint": where["setpoint"], "readback": where["readback"] * 1.01}

    with init_devices():
        skewed = Skewed("skewed")
    faults = {c.name for c in rig.check(StageOfDevice(skewed)).faults}
    assert "moves to the requested angle and reports it" in faults
    # The motor moves without delay, so that no move can time out or be stopped.
    assert "reports a timeout at a short deadline and continues the move" in faults


def test_motors_serve_as_stages_of_a_run(engine: RunEngine, session: rig.Session, tmp_path: Path) -> None:
    """Synchronous and asynchronous motors among simulated stages."""
    limits = rig.StageLimits((-720, 720), 400, 8000, 0.001)
    turning, axis = motor(2000.0), ophyd.sim.SynAxis(name="axis")
    session["retarder_2"] = StageOfDevice(turning, limits)
    session["retarder_3"] = StageOfDevice(axis, limits)
    assert session["retarder_3"].identify(1.0) == rig.Identity("ophyd", "SynAxis", "axis")
    outcome = session.run(tmp_path / "s.zarr")
    assert (outcome.taken, outcome.retries) == (60, 0)
    frames = ps.open_store(tmp_path / "s.zarr")["frames"]
    own = rig.Session(tmp_path / "camera.toml")
    own.run(tmp_path / "own.zarr")
    goals = ps.open_store(tmp_path / "own.zarr")["frames"]
    for name in ("angle_retarder_2", "angle_retarder_3"):
        assert len(np.unique(goals[name])) > 3, "it turns"
        np.testing.assert_allclose(frames[name], goals[name], atol=2e-3)


class Jammed(SimMotor):
    """Fails in every third move."""

    moves = 0

    @AsyncStatus.wrap
    async def set(self, new_position: float, timeout: Any = None) -> None:  # type: ignore[override]
        self.moves += 1
        if self.moves % 3 == 0:
            raise RuntimeError("the gear slips")
        await super().set(new_position)


def test_a_failed_move_is_reported_as_a_stall(engine: RunEngine, session: rig.Session, tmp_path: Path) -> None:
    with init_devices():
        jammed = Jammed("jammed")
    homed: list[str] = []
    session["retarder_2"] = StageOfDevice(jammed, home=lambda: homed.append(threading.current_thread().name))
    outcome = session.run(tmp_path / "s.zarr")
    assert outcome.taken == 60 and outcome.retries > 0
    assert len(homed) == 1 + outcome.retries
    retries = [e["failure"] for e in rigs.journal(tmp_path / "s.zarr") if e["event"] == "retry"]
    assert set(retries) == {"retarder_2: stalled: the move failed: the gear slips"}


def test_a_device_that_does_not_answer_times_out() -> None:
    class Mute:
        name = "mute"

        async def read(self) -> dict[str, Any]:
            await asyncio.sleep(60)
            return {}

    begun = time.monotonic()
    with pytest.raises(TimeoutError, match=r"mute did not answer within 0\.2 s"):
        StageOfDevice(Mute()).read(0.2)
    assert time.monotonic() - begun < 5


class Detector(StandardReadable):
    """Takes images with one of the rig's cameras, as a device of ophyd-async."""

    def __init__(self, camera: Any, name: str = "") -> None:
        self.camera = camera
        self.exposure = soft_signal_rw(float, 0.01)
        with self.add_children_as_readables():
            self.image, self._set_image = soft_signal_r_and_setter(np.ndarray)
        super().__init__(name)

    @AsyncStatus.wrap
    async def trigger(self) -> None:
        whole = rig.Region(0, 0, 12, 10)
        self.camera.configure(rig.CameraSettings(whole, await self.exposure.get_value()), 1.0)
        self.camera.expose()
        self._set_image(self.camera.frame(10.0).pixels)


def test_an_ophyd_async_detector_gives_the_frames_of_the_camera(
    engine: RunEngine, session: rig.Session, tmp_path: Path
) -> None:
    rig.Session(tmp_path / "camera.toml").run(tmp_path / "own.zarr")
    with init_devices():
        detector = Detector(session["camera"], "detector")
    session["camera"] = CameraOfDevice(
        detector, rig.CameraLimits((12, 10)), exposure=detector.exposure, key="detector-image"
    )
    session.run(tmp_path / "s.zarr")
    assert rigs.content(tmp_path / "s.zarr") == rigs.content(tmp_path / "own.zarr")


def test_an_ophyd_detector_serves_as_a_camera(session: rig.Session, tmp_path: Path) -> None:
    taken: list[npt.NDArray[Any]] = []

    def picture() -> npt.NDArray[Any]:
        taken.append(np.full((10, 12), len(taken) % 4096))
        return taken[-1]

    session["camera"] = CameraOfDevice(ophyd.sim.SynSignal(func=picture, name="picture"), rig.CameraLimits((12, 10)))
    before = len(taken)
    session.run(tmp_path / "s.zarr")
    raw = ps.open_store(tmp_path / "s.zarr")["frames/raw"].values.reshape(60, 10, 12)
    assert len(taken) == before + 60
    np.testing.assert_array_equal(raw.max((1, 2)), np.arange(before, before + 60))
    # Stripes are cropped from the whole image.
    assert (raw.min((1, 2)) == 0).sum() > 10
    faults = [c.name for c in rig.check(session["camera"]).faults]
    assert faults == ["reports a timeout at a short deadline and delivers the frame later"], "it has no exposure to wait for"


class Spot(StandardReadable):
    """Counts with the rig's counter, as a device of ophyd-async."""

    def __init__(self, counter: Any, name: str = "") -> None:
        self.counter = counter
        self.dwell = soft_signal_rw(float, 0.001)
        with self.add_children_as_readables():
            self.counts, self._set_counts = soft_signal_r_and_setter(Array1D[np.uint32])
        super().__init__(name)

    @AsyncStatus.wrap
    async def trigger(self) -> None:
        self.counter.configure(rig.CounterSettings(100, 25.0, await self.dwell.get_value()), 1.0)
        self.counter.begin()
        self._set_counts(self.counter.finish(10.0).counts)


class Mirror(ophyd.sim.SynAxis):
    """One of two axes that turn the rig's mirrors."""

    def __init__(self, galvo: Any, at: list[float], axis: int, name: str) -> None:
        self.galvo, self.at, self.axis = galvo, at, axis
        super().__init__(name=name)

    def set(self, value: float) -> Any:
        self.at[self.axis] = value
        found = self.galvo.point(tuple(self.at), 1.0)
        return super().set(found[self.axis])


class Shutter(ophyd.sim.SynAxis):
    """Controls the emission of the rig's laser."""

    def __init__(self, laser: Any, name: str) -> None:
        self.laser = laser
        super().__init__(name=name)

    def set(self, value: float) -> Any:
        self.laser.emit(value == 1, 1e7, 1.0)
        return super().set(value)


def test_devices_give_the_same_scan_as_the_rig(engine: RunEngine, tmp_path: Path) -> None:
    """Mirrors, shutter and counter wrap those of the simulated rig: identical counts."""
    plan = rigs.write(tmp_path) / "scan.toml"
    plan.write_text(plan.read_text().replace("dwell_ms = 2", "dwell_ms = 2\nrate_hz = 1e7"))
    rig.Session(plan).run(tmp_path / "own.zarr")
    session = rig.Session(plan)
    at = [0.0, 0.0]
    x, y = (Mirror(session["galvo"], at, i, "xy"[i]) for i in range(2))
    with init_devices():
        spot = Spot(session["counter"], "spot")
    session["galvo"] = GalvoOfDevices(x, y, session["galvo"].limits())
    session["laser"] = laser = LaserOfDevices(Shutter(session["laser"], "shutter"), session["laser"].limits())
    limits = rig.CounterLimits(bins=100)
    session["counter"] = CounterOfDevice(spot, limits, rate_hz=1e7, dwell=spot.dwell, key="spot-counts")
    assert session.run(tmp_path / "s.zarr").retries == 0
    assert not laser.state(1.0).emitting
    own, found = (ps.open_store(tmp_path / f"{name}.zarr")["frames"] for name in ("own", "s"))
    assert int(own["raw"].sum()) > 1000
    np.testing.assert_array_equal(found["raw"], own["raw"])
    for name in ("pointing_x", "pointing_y", "pulses"):
        np.testing.assert_array_equal(found[name], own[name])
    assert len(np.unique(found["pointing_x"])) == 5 and len(np.unique(found["pointing_y"])) == 4
    assert rig.check(session["galvo"]), str(rig.check(session["galvo"]))
    plan.write_text(plan.read_text().replace("bin_ps = 25", "bin_ps = 50"))
    session = rig.Session(plan, instruments={"counter": session["counter"]})
    with pytest.raises(rig.InstrumentError, match=r"counter: limit: the device has bins of 25\.0 ps from the sync pulse"):
        session.run(tmp_path / "wide.zarr")


def test_a_missing_key_is_reported(session: rig.Session, tmp_path: Path) -> None:
    signal = ophyd.sim.SynSignal(func=lambda: np.zeros((10, 12), int), name="picture")
    session["camera"] = CameraOfDevice(signal, rig.CameraLimits((12, 10)), key="image")
    with pytest.raises(rig.InstrumentError, match="camera: refused: `read` returned no key `image`; available keys: picture; pass one of them as key="):
        session.run(tmp_path / "s.zarr")


def test_a_run_engine_scans_the_rig(engine: RunEngine, session: rig.Session) -> None:
    """A stage, a projector and a camera of Sunstone in bluesky plans: two polarizers follow the law of Malus."""
    stage = MovableStage(session["polarizer_1"], "polarizer")
    white = [np.full((6, 8), 255, np.uint8)]
    projector = MovableProjector(session["projector"], "pattern", white)
    settings = rig.CameraSettings(rig.Region(0, 0, 12, 10), 0.01)
    camera = ReadableCamera(session["camera"], "camera", settings)
    for device, kinds in (
        (stage, (protocols.Movable, protocols.Locatable, protocols.Readable, protocols.Stoppable, protocols.HasHints)),
        (projector, (protocols.Movable, protocols.Readable)),
        (camera, (protocols.Triggerable, protocols.Readable, protocols.Configurable)),
    ):
        assert [k.__name__ for k in kinds if not isinstance(device, k)] == []
    for name in ("retarder_2", "retarder_3", "polarizer_4"):
        session[name].home(100.0)
    documents: list[tuple[str, dict[str, Any]]] = []
    angles = np.linspace(0.0, 180.0, 13)

    def plan() -> Any:
        yield from bps.mv(projector, 0)
        yield from bp.list_scan([camera, projector], stage, list(angles))
        yield from bps.mv(projector, -1)

    engine(plan(), lambda name, document: documents.append((name, document)))
    events = [d["data"] for name, d in documents if name == "event"]
    stop = next(d for name, d in documents if name == "stop")
    assert stop["exit_status"] == "success" and len(events) == 13
    np.testing.assert_allclose([e["polarizer"] for e in events], angles, atol=1e-3)
    assert {e["pattern"] for e in events} == {0}
    # Retarders at 0° between the rotating and the fixed polarizer do not change the first harmonic.
    light = np.array([np.mean(e["camera"]) for e in events])
    angle = np.radians(angles)
    basis = np.stack([np.ones(13), np.cos(2 * angle), np.sin(2 * angle)], 1)
    found, *_ = np.linalg.lstsq(basis, light, rcond=None)
    assert np.abs(light - basis @ found).max() < 0.02 * light.max()
    assert found[1] > 0.9 * found[0]
    descriptor = next(d for name, d in documents if name == "descriptor")
    assert descriptor["data_keys"]["camera"]["shape"] == [10, 12]
    assert descriptor["configuration"]["camera"]["data"]["camera-exposure_s"] == 0.01


def test_instrument_errors_fail_the_plan(engine: RunEngine, session: rig.Session) -> None:
    from bluesky.utils import FailedStatus

    stage = MovableStage(session["polarizer_1"], "polarizer")
    with pytest.raises(FailedStatus) as raised:
        engine(bps.mv(stage, 1e4))
    assert isinstance(raised.value.__cause__, rig.InstrumentError) and raised.value.__cause__.fault == "limit"


def test_a_moving_stage_can_be_stopped(engine: RunEngine) -> None:
    stage = MovableStage(StageOfDevice(motor(20.0), rig.StageLimits((-720, 720), 20, 400, 0.001)), "slow")
    status = stage.set(100.0)
    time.sleep(0.8)
    stage.stop()
    assert isinstance(status.exception(10.0), rig.InstrumentError) and not status.success
    assert 0.0 < stage.position < 90.0
    stage.set(stage.position + 1.0).wait(10.0)


def test_the_documented_example_runs(engine: RunEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the code of docs/python-rig.md in a folder with the files that it names."""
    code = (ROOT / "docs" / "python-rig.md").read_text().split("```py\n")[1].split("```")[0]
    for folder in ("rigs", "scenes"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    # One engine per process: devices live in its loop.
    assert "engine = RunEngine()\n" in code
    names: dict[str, Any] = {"engine": engine}
    exec(compile(code.replace("engine = RunEngine()\n", ""), "docs/python-rig.md", "exec"), names)  # noqa: S102
    turned = ps.open_store(tmp_path / "turned.zarr")["frames/angle_retarder_2"]
    assert len(np.unique(turned)) == 36


def test_a_status_calls_back_once_it_has_ended() -> None:
    gate, seen = threading.Event(), []
    status = Status(lambda: gate.wait(10))
    with pytest.raises(TimeoutError):
        status.exception()
    status.add_callback(seen.append)
    assert not status.done and not status.success and seen == []
    gate.set()
    status.wait(10)
    status.add_callback(seen.append)
    assert status.done and status.success and seen == [status, status]

"""Rig sessions with Python instruments: stores equal those of the command, failures are reported, interrupted runs resume."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rigs
from rendered import ROOT, SCENE, sunstone

import pysunstone as ps
from pysunstone import rig


def by_command(folder: Path, plan: str) -> dict[str, bytes]:
    """Return the files that `sunstone rig run` writes."""
    store = folder / f"{plan}-by-command.zarr"
    sunstone("rig", "run", folder / f"{plan}.toml", "-o", store)
    return rigs.content(store)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, bytes]]:
    """Return undisturbed runs of the command."""
    folder = rigs.write(tmp_path_factory.mktemp("sound"))
    return {plan: by_command(folder, plan) for plan in ("camera", "scan", "tags")}


@pytest.mark.parametrize("plan", ["camera", "scan", "tags"])
def test_wrapped_instruments_give_the_same_store_as_the_command(
    tmp_path: Path, sound: dict[str, dict[str, bytes]], plan: str
) -> None:
    session = rig.Session(rigs.write(tmp_path) / f"{plan}.toml")
    assert set(session) == {"polarizer_1", "retarder_2", "retarder_3", "polarizer_4", *rigs.AROUND}
    around = rigs.wrap(session)
    cost = session.cost()
    outcome = session.run(tmp_path / "s.zarr")
    assert (outcome.taken, outcome.retries) == (cost.frames, 0)
    assert rigs.content(tmp_path / "s.zarr") == sound[plan]
    assert around["retarder_2"].calls.count("home") == 1
    used = {"camera": ("camera", "expose"), "scan": ("counter", "begin"), "tags": ("counter", "begin")}[plan]
    assert around[used[0]].calls.count(used[1]) == cost.frames
    last = around["projector"].calls[-1] if plan == "camera" else around["laser"].calls[-1]
    assert last == ("dark" if plan == "camera" else "emit False"), "its light goes off"


def test_built_in_instruments_give_the_same_store_as_the_command(tmp_path: Path, sound: dict[str, dict[str, bytes]]) -> None:
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")
    seen: list[tuple[int, int]] = []
    session.run(tmp_path / "s.zarr", progress=lambda done, frames: seen.append((done, frames)))
    assert rigs.content(tmp_path / "s.zarr") == sound["camera"]
    assert seen and seen[-1][1] == 60 and seen == sorted(seen)
    # The session returns the instruments, which can be used directly.
    assert session["camera"].identify(1.0).model == "area camera"


#: Faults of the simulated bench, each with the session's reaction.
MISHAPS = [
    ("camera", "dropped_frame", "camera", 7),
    ("camera", "short_frame", "camera", 8),
    ("camera", "stale_frame", "camera", 9),
    ("camera", "saturation", "camera", 5),
    ("camera", "stall", "retarder_2", 3),
    ("camera", "cable_out", "retarder_3", 2),
    ("camera", "cable_out", "camera", 4),
    ("camera", "power_cut", "projector", 9),
    ("camera", "timeout", "projector", 6),
    ("scan", "dropped_frame", "counter", 11),
    ("scan", "laser_low", "counter", 12),
    ("scan", "cable_out", "galvo", 13),
    ("scan", "saturation", "counter", 14),
    ("tags", "dropped_frame", "counter", 15),
]


@pytest.mark.parametrize(("plan", "kind", "instrument", "at"), MISHAPS)
def test_simulated_faults_behind_python_are_retried(
    tmp_path: Path, sound: dict[str, dict[str, bytes]], plan: str, kind: str, instrument: str, at: int
) -> None:
    session = rig.Session(rigs.write(tmp_path, rigs.fault(kind, instrument, at)) / f"{plan}.toml")
    rigs.wrap(session)
    outcome = session.run(tmp_path / "s.zarr")
    assert outcome.retries >= 1
    assert rigs.content(tmp_path / "s.zarr") == sound[plan]


class Failing(rigs.Camera):
    """Raises an exception in some of its exposures."""

    def __init__(self, of: Any, error: Callable[[], BaseException], at: set[int]) -> None:
        super().__init__(of)
        self.error, self.at, self.exposures = error, at, 0

    def expose(self) -> None:
        self.exposures += 1
        if self.exposures in self.at:
            raise self.error()
        super().expose()


#: Temporary exceptions, and the journal's entries for them.
PASSING: list[tuple[Callable[[], Exception], str]] = [
    (lambda: TimeoutError("no trigger"), "camera: timeout: `expose` raised TimeoutError: no trigger"),
    (lambda: OSError("no such device"), "camera: disconnected: `expose` raised OSError: no such device"),
    (lambda: BrokenPipeError(32, "gone"), "camera: disconnected: `expose` raised BrokenPipeError: [Errno 32] gone"),
    (lambda: rig.InstrumentError("stalled", "its shutter sticks"), "camera: stalled: its shutter sticks"),
    (lambda: rig.InstrumentError("saturated", "the sun shines in"), "camera: saturated: the sun shines in"),
]


@pytest.mark.parametrize(("error", "noted"), PASSING)
def test_transient_exceptions_are_retried(
    tmp_path: Path, sound: dict[str, dict[str, bytes]], error: Callable[[], Exception], noted: str
) -> None:
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")
    session["camera"] = camera = Failing(session["camera"], error, {4, 5, 20})
    outcome = session.run(tmp_path / "s.zarr")
    assert outcome.retries == 3 and camera.exposures == 63
    retries = [e["failure"] for e in rigs.journal(tmp_path / "s.zarr") if e["event"] == "retry"]
    assert retries == [noted] * 3
    assert camera.calls.count("reconnect") == (3 if "disconnected" in noted else 0)
    assert rigs.content(tmp_path / "s.zarr") == sound["camera"]


@pytest.mark.parametrize(
    ("error", "fault"),
    [(ValueError("a bug"), "refused"), (rig.InstrumentError("limit", "too far"), "limit"), (TimeoutError("dead"), "timeout")],
)
def test_persistent_exceptions_end_the_run_and_are_the_cause(
    tmp_path: Path, sound: dict[str, dict[str, bytes]], error: Exception, fault: str
) -> None:
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")
    own = session["camera"]
    session["camera"] = camera = Failing(own, lambda: error, set(range(9, 1000)))
    with pytest.raises(rig.InstrumentError) as raised:
        session.run(tmp_path / "s.zarr")
    found = raised.value
    assert (found.fault, found.instrument) == (fault, "camera") and found.__cause__ is error
    assert "resume with resume=True" in str(found) and str(found).startswith(f"camera: {fault}: ")
    assert camera.exposures == (9 + 5 if fault == "timeout" else 9), "what may pass is tried five times more"
    with pytest.raises(ps.InputError, match="already exists"):
        session.run(tmp_path / "s.zarr")
    session["camera"] = own
    assert session.run(tmp_path / "s.zarr", resume=True).taken == 60 - 8
    assert rigs.content(tmp_path / "s.zarr") == sound["camera"]


def test_system_exit_is_not_wrapped(tmp_path: Path) -> None:
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")
    session["camera"] = Failing(session["camera"], lambda: SystemExit(3), {2})
    with pytest.raises(SystemExit):
        session.run(tmp_path / "s.zarr")


def test_errors_can_be_pickled() -> None:
    error = pickle.loads(pickle.dumps(rig.InstrumentError("stalled", "it sticks", "a", "resume")))
    assert (error.fault, error.what, error.instrument, str(error)) == ("stalled", "it sticks", "a", "a: stalled: it sticks\nresume")


def test_a_failing_thermometer_is_reported_and_ignored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Feverish(rigs.Stage):
        def temperature_c(self) -> float | None:
            raise ValueError("no probe")

    reported: list[Any] = []
    monkeypatch.setattr(sys, "unraisablehook", reported.append)
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")
    session["retarder_2"] = Feverish(session["retarder_2"])
    assert session.run(tmp_path / "s.zarr").retries == 0
    assert [str(t.exc_value) for t in reported] == ["no probe"]
    noted = next(e["temperatures_c"] for e in rigs.journal(tmp_path / "s.zarr") if e["event"] == "frame")
    assert "retarder_2" not in dict(noted) and dict(noted)["retarder_3"] == 23.0


class Lying(rigs.Camera):
    """Returns invalid frames."""

    def __init__(self, of: Any, lie: Callable[[rig.Frame], Any]) -> None:
        super().__init__(of)
        self.lie = lie

    def frame(self, within_s: float) -> Any:
        return self.lie(self.of.frame(within_s))


def of_frame(**changes: Any) -> Callable[[rig.Frame], Any]:
    return lambda f: rig.Frame(**{"pixels": f.pixels, "number": f.number, "timestamp_ns": f.timestamp_ns} | changes)


#: Invalid frames, and the error messages.
LIES: list[tuple[Callable[[rig.Frame], Any], str]] = [
    (lambda f: None, "the pixels of the frame are None; expected a NumPy array"),
    (lambda f: f.pixels.astype(float), r"the pixels of the frame are float64 of shape \(10, 12\); expected a NumPy array \(rows, columns\) of uint8 or uint16"),
    (lambda f: f.pixels.ravel(), r"the pixels of the frame are uint16 of shape \(120,\)"),
    (lambda f: f.pixels.astype(np.int16) - 1, "the pixels of the frame are int16"),
    (lambda f: f.pixels.T, r"timeout: `frame` returned an array of shape \(12, 10\), but .* 10 rows and 12 columns"),
    (lambda f: np.full_like(f.pixels, 4096), "a pixel has the value 4096, but the pixel format Mono12p holds values from 0 to 4095"),
    (of_frame(number="seven"), "`number` is 'seven'; expected the camera's frame number, or None"),
    (of_frame(number=-1), "`number` is -1"),
    (of_frame(timestamp_ns=None), "`timestamp_ns` is None; expected an integer number of nanoseconds"),
    (of_frame(number=1), "an earlier frame arrived again"),
]


@pytest.mark.parametrize(("lie", "message"), LIES)
def test_invalid_frames_are_reported(tmp_path: Path, lie: Callable[[rig.Frame], Any], message: str) -> None:
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")
    session["camera"] = Lying(session["camera"], lie)
    with pytest.raises(rig.InstrumentError, match=message) as raised:
        session.run(tmp_path / "s.zarr")
    assert raised.value.instrument == "camera" and raised.value.__cause__ is None


def replaced(of: Any, method: str, answer: Callable[[Any], Any]) -> Any:
    """Return an instrument with one method whose results are changed."""
    before = getattr(of, method)
    setattr(of, method, lambda *a: answer(before(*a)))
    return of


#: Plan, instrument, method, changed result, and error message.
ANSWERS: list[tuple[str, str, str, Callable[[Any], Any], str]] = [
    ("camera", "retarder_2", "read", lambda r: None, "`read` returned None: the attribute `angle_deg` is missing; expected a finite number of degrees"),
    ("camera", "retarder_2", "read", lambda r: rig.StageReading(np.nan), "`angle_deg` is NaN; expected a finite number of degrees"),
    ("camera", "retarder_2", "read", lambda r: rig.StageReading("12"), "`angle_deg` is '12'"),  # type: ignore[arg-type]
    ("camera", "retarder_2", "finish_move", lambda r: rig.StageReading(r.angle_deg + 0.5), "stalled: the stage is at .*, expected"),
    ("scan", "galvo", "point", lambda at: at[0], "expected the angles of the mirrors, as two finite numbers in degrees"),
    ("scan", "laser", "state", lambda s: rig.LaserState(True, np.inf), "`rate_hz` is inf"),
    ("scan", "counter", "finish", lambda h: rig.Histogram(h.counts[:-1], h.pulses), "`finish` returned 63 counts, but 64 bins are configured"),
    ("scan", "counter", "finish", lambda h: rig.Histogram(h.counts - 1.0, h.pulses), "`counts` is float64 of shape"),
    ("scan", "counter", "finish", lambda h: rig.Histogram(h.counts, -5), "`pulses` is -5"),
]


@pytest.mark.parametrize(("plan", "name", "method", "answer", "message"), ANSWERS)
def test_invalid_answers_are_reported(
    tmp_path: Path, plan: str, name: str, method: str, answer: Callable[[Any], Any], message: str
) -> None:
    session = rig.Session(rigs.write(tmp_path) / f"{plan}.toml")
    session[name] = replaced(rigs.AROUND.get(name, rigs.Stage)(session[name]), method, answer)
    with pytest.raises(rig.InstrumentError, match=message) as raised:
        session.run(tmp_path / "s.zarr")
    assert raised.value.instrument == name


def test_invalid_limits_are_reported(tmp_path: Path) -> None:
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")
    session["camera"] = replaced(rigs.Camera(session["camera"]), "limits", lambda _: rig.CameraLimits((12, 10), formats=("RGB8",)))
    with pytest.raises(ps.InputError, match="camera: `limits` returned .* unknown pixel format `RGB8`; supported: Mono8, "):
        session.cost()
    session["camera"] = replaced(session["camera"], "limits", lambda _: rig.CameraLimits((12, 10), exposure_s=(0.02, 1)))
    with pytest.raises(ps.InputError, match="camera: limit: exposure time 10ms is outside the range 20ms to 1s"):
        session.cost()


def test_invalid_instruments_are_refused(tmp_path: Path) -> None:
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")
    with pytest.raises(ps.InputError, match="`camera` is a object, which has no method configure, expose, frame, identify"):
        session["camera"] = object()
    with pytest.raises(ps.InputError, match="`camra`, a stage by its name .* is a RigCamera, which has no method begin_move"):
        session["camra"] = session["camera"]
    with pytest.raises(ps.InputError, match="unknown sample `glass`"):
        rig.Session(tmp_path / "camera.toml", sample="glass")
    with pytest.raises(ps.InputError, match="this output is or contains an input"):
        session.run(tmp_path, force=True)
    del session["camera"]
    with pytest.raises(ps.InputError, match="the plan needs a camera, but the rig has none"):
        session.cost()


def test_instruments_can_be_implemented_in_python(tmp_path: Path, sound: dict[str, dict[str, bytes]]) -> None:
    lent = rig.Session(rigs.write(tmp_path) / "camera.toml")
    text = rigs.RIG.replace("[camera]\nsize = [12, 10]\n", '[camera]\ndriver = "python"\nsize = [12, 10]\n')
    (tmp_path / "rig.toml").write_text(text)
    with pytest.raises(ps.RenderError, match="`camera` is implemented in Python; pass the instrument to"):
        rig.Session(tmp_path / "camera.toml")
    session = rig.Session(tmp_path / "camera.toml", instruments={"camera": rigs.Camera(lent["camera"])})
    # The camera of another bench captures that bench, so frames are dark, but the run finishes.
    assert session.run(tmp_path / "s.zarr").taken == 60


def test_a_bench_with_a_scene_renders_it_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = rigs.write(tmp_path)
    (folder / "ball.toml").write_text(SCENE)
    text = rigs.RIG.replace('sample = "air"\n', 'scene = "ball.toml"\nspp = 4\nslice = "full"\n')
    (folder / "rig.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    expected = by_command(folder, "camera")
    session = rig.Session("camera.toml", dry=True)
    assert session.cost().frames == 60
    with pytest.raises(ps.InputError, match="a dry session takes nothing"):
        session.run("s.zarr")
    seen: list[tuple[int, int]] = []
    session = rig.Session("camera.toml", bench_folder="bench", progress=lambda done, tiles: seen.append((done, tiles)))
    assert seen[-1][0] == seen[-1][1] and len(list(Path("bench").glob("*.zarr"))) == 1
    rigs.wrap(session)
    session.run("s.zarr")
    assert rigs.content(tmp_path / "s.zarr") == expected


def test_a_run_stopped_by_ctrl_c_resumes(tmp_path: Path, sound: dict[str, dict[str, bytes]]) -> None:
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")

    class Interrupting(rigs.Camera):
        def expose(self) -> None:
            super().expose()
            if self.calls.count("expose") == 12:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.3)

    session["camera"] = camera = Interrupting(session["camera"])
    with pytest.raises(KeyboardInterrupt):
        session.run(tmp_path / "s.zarr")
    assert 12 <= camera.calls.count("expose") < 60
    frames = [e["frame"] for e in rigs.journal(tmp_path / "s.zarr") if e["event"] == "frame"]
    assert frames == list(range(camera.calls.count("expose"))), "the frame in flight was kept"
    # Any program can resume the run. Here, the command resumes it.
    sunstone("rig", "run", tmp_path / "camera.toml", "-o", tmp_path / "s.zarr", "--resume")
    assert rigs.content(tmp_path / "s.zarr") == sound["camera"]


def test_a_second_ctrl_c_interrupts_a_hanging_camera(tmp_path: Path, sound: dict[str, dict[str, bytes]]) -> None:
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")
    own = session["camera"]
    hangs, raised, sent = threading.Event(), [], []

    class Hanging(rigs.Camera):
        def frame(self, within_s: float) -> Any:
            if self.calls.count("expose") == 9:
                hangs.set()
                try:
                    while True:
                        time.sleep(0.02)
                except BaseException as error:
                    raised.append(type(error))
                    raise
            return super().frame(within_s)

    def interrupt() -> None:
        hangs.wait(60)
        # Two signals are sufficient, but a busy machine may deliver two signals as one.
        for number in range(60):
            time.sleep(0.4)
            if raised:
                return
            sent.append(number)
            os.kill(os.getpid(), signal.SIGINT)

    session["camera"] = Hanging(own)
    threading.Thread(target=interrupt).start()
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        session.run(tmp_path / "s.zarr")
    assert raised == [KeyboardInterrupt] and time.monotonic() - begun < 30
    assert len(sent) >= 2, "the first alone does not end it"
    session["camera"] = own
    assert session.run(tmp_path / "s.zarr", resume=True).taken == 60 - 8
    assert rigs.content(tmp_path / "s.zarr") == sound["camera"]


def test_an_exception_in_progress_ends_the_run(tmp_path: Path, sound: dict[str, dict[str, bytes]]) -> None:
    class Slow(rigs.Camera):
        def expose(self) -> None:
            time.sleep(0.02)
            super().expose()

    class Enough(Exception):
        pass

    def progress(done: int, frames: int) -> None:
        if done > 5:
            raise Enough

    session = rig.Session(rigs.write(tmp_path) / "camera.toml")
    session["camera"] = Slow(session["camera"])
    with pytest.raises(Enough):
        session.run(tmp_path / "s.zarr", progress=progress)
    session.run(tmp_path / "s.zarr", resume=True)
    assert rigs.content(tmp_path / "s.zarr") == sound["camera"]


def test_instruments_cannot_be_used_during_a_run(tmp_path: Path) -> None:
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")
    messages: list[str] = []

    class Curious(rigs.Camera):
        def expose(self) -> None:
            if not messages:
                for ask in (lambda: session["projector"].dark(1.0), session.cost):
                    try:
                        ask()
                    except ps.InputError as error:
                        messages.append(str(error))
            super().expose()

    session["camera"] = Curious(session["camera"])
    session.run(tmp_path / "s.zarr")
    assert messages == [
        "projector: the instrument is in use by a running session; wait until the session ends",
        "the session is already running; wait until the session ends",
    ]
    session["projector"].dark(1.0)


def test_the_gil_is_free_between_calls(tmp_path: Path) -> None:
    """While a Python camera waits without the GIL, other threads run; and the camera is called from a single thread."""
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")
    threads: set[int] = set()

    class Waiting(rigs.Camera):
        def expose(self) -> None:
            threads.add(threading.get_ident())
            super().expose()

    session["camera"] = Waiting(session["camera"])
    turns, ended = 0, threading.Event()

    def count() -> None:
        nonlocal turns
        while not ended.wait(0.001):
            turns += 1

    other = threading.Thread(target=count)
    other.start()
    begun = time.monotonic()
    session.run(tmp_path / "s.zarr")
    wall = time.monotonic() - begun
    ended.set()
    other.join()
    assert len(threads) == 1 and threading.get_ident() not in threads
    assert turns > 50 * wall


def test_the_store_of_a_run_opens_and_is_reconstructed(tmp_path: Path) -> None:
    plan = rigs.write(tmp_path) / "camera.toml"
    # Use 25 captures, because 16 captures of this scheme do not determine all elements.
    plan.write_text(plan.read_text().replace("captures = 6", "captures = 25"))
    session = rig.Session(plan)
    rigs.wrap(session)
    session.run(tmp_path / "s.zarr")
    raw = ps.open_store(tmp_path / "s.zarr")["frames/raw"]
    assert dict(raw.sizes) == {"capture": 25, "shot": 5, "exposure": 2, "y": 10, "x": 12}
    sunstone("reconstruct", tmp_path / "s.zarr", "-o", tmp_path / "m.zarr")
    full = ps.open_store(tmp_path / "m.zarr")["full/mean"]
    assert {"y", "x"} <= set(full.dims) and np.isfinite(full.values).all()


@pytest.fixture(scope="module")
def idle(tmp_path_factory: pytest.TempPathFactory) -> rig.Session:
    """Return a session that is not run."""
    return rig.Session(rigs.write(tmp_path_factory.mktemp("idle")) / "camera.toml")


@pytest.mark.parametrize("name", ["retarder_2", *rigs.AROUND])
def test_instruments_pass_the_conformance_checks(idle: rig.Session, name: str) -> None:
    own = idle.check(name)
    assert own and len(own) >= 10, str(own)
    around = rig.check(rigs.AROUND.get(name, rigs.Stage)(idle[name]))
    assert around and [c.name for c in around] == [c.name for c in own], str(around)


#: Instrument, method, changed result, and the checks that detect it.
PLANTED: list[tuple[str, str, Callable[[Any], Any], set[str]]] = [
    ("retarder_2", "identify", lambda i: rig.Identity("", "", ""), {"reports its identity"}),
    ("retarder_2", "temperature_c", lambda t: 1000.0, {"reports a plausible temperature or none"}),
    (
        "retarder_2",
        "finish_move",
        lambda r: rig.StageReading(r.angle_deg + 0.1),
        {
            "moves to the requested angle and reports it",
            "a second move replaces the first",
            "reports a timeout at a short deadline and continues the move",
            "moves after a stop",
        },
    ),
    (
        "retarder_2",
        "read",
        lambda r: rig.StageReading(r.angle_deg, True, False),
        {"reports homed, stopped and near zero after homing", "stops during a move"},
    ),
    ("camera", "frame", lambda f: rig.Frame(f.pixels, 7), {"delivers frames with the configured region and format"}),
    ("camera", "frame", lambda f: f.pixels[:1, :1], {"delivers frames with the configured region and format", "refuses a second exposure during the first"}),
    ("galvo", "point", lambda at: (at[0], 0.0), {"points to the requested angles"}),
    ("laser", "state", lambda s: rig.LaserState(True, s.rate_hz), {"turns off"}),
    ("counter", "finish", lambda h: rig.Histogram(h.counts, 0, h.number), {"returns the configured number of bins"}),
]


@pytest.mark.parametrize(("name", "method", "answer", "found"), PLANTED)
def test_planted_faults_are_detected(
    idle: rig.Session, name: str, method: str, answer: Callable[[Any], Any], found: set[str]
) -> None:
    report = rig.check(replaced(rigs.AROUND.get(name, rigs.Stage)(idle[name]), method, answer))
    assert not report and found <= {c.name for c in report.faults}, str(report)
    assert f"of {len(report)} checks" in str(report)


def test_a_camera_that_ignores_deadlines_is_detected(idle: rig.Session) -> None:
    """The checks detect a camera that waits longer than the deadline."""

    class Stubborn(rigs.Camera):
        def frame(self, within_s: float) -> Any:
            return super().frame(1000.0)

    faults = rig.check(Stubborn(idle["camera"])).faults
    assert [c.name for c in faults] == ["reports a timeout at a short deadline and delivers the frame later"]


def test_the_check_refuses_incomplete_instruments() -> None:
    with pytest.raises(ps.InputError, match="a Half is no instrument: of a projector it has no dark"):

        class Half(rig.Instrument):
            def limits(self) -> None: ...
            def load(self) -> None: ...
            def show(self) -> None: ...

        rig.check(Half())


def test_the_documented_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the code of docs/python-rig.md in a folder with the files that it names."""
    text = (ROOT / "docs" / "python-rig.md").read_text()
    code = [part.split("```")[0] for part in text.split("```python\n")[1:]]
    assert len(code) >= 2
    for folder in ("rigs", "scenes"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    (tmp_path / "lab").mkdir()
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for part in code:
        exec(compile(part, "docs/python-rig.md", "exec"), names)  # noqa: S102
    assert (tmp_path / "night.zarr" / "manifest.txt").exists()


def test_one_changed_pixel_is_detected(tmp_path: Path, sound: dict[str, dict[str, bytes]]) -> None:
    """Negative control: the comparison of bytes detects a changed pixel."""
    session = rig.Session(rigs.write(tmp_path) / "camera.toml")

    def change(frame: rig.Frame) -> rig.Frame:
        if frame.number == 33:
            frame.pixels[4, 7] ^= 1
        return frame

    session["camera"] = Lying(session["camera"], change)
    session.run(tmp_path / "s.zarr")
    found = rigs.content(tmp_path / "s.zarr")
    assert sorted(found) == sorted(sound["camera"])
    other = [name for name in found if found[name] != sound["camera"][name]]
    assert len(other) == 2 and "manifest.txt" in other, other


def test_mypy_checks_the_protocols(tmp_path: Path) -> None:
    """mypy detects a missing method and a different signature."""
    (tmp_path / "lab.py").write_text("""
from pysunstone import rig, _native

def camera(own: _native.RigCamera) -> rig.AreaCamera:
    return own

class Half(rig.RotationStage):
    def limits(self) -> rig.StageLimits:
        return rig.StageLimits()

Half()

class Wrong(rig.PulsedLaser):
    def limits(self) -> rig.LaserLimits:
        return rig.LaserLimits(550.0, (1e6, 8e7))

    def emit(self, on: bool, rate_hz: str, within_s: float) -> None: ...

    def state(self, within_s: float) -> int:
        return 3
""")
    # NumPy's types are not checked, because parsing them takes long.
    (tmp_path / "mypy.ini").write_text("[mypy]\n[mypy-numpy.*]\nfollow_imports = skip\n")
    mypy = [sys.executable, "-m", "mypy", "--cache-dir", tmp_path / "cache", "lab.py"]
    # mypy searches site-packages by default and does not accept this folder in MYPYPATH.
    home = Path(ps.__file__).parents[1]
    path = {} if home.name == "site-packages" else {"MYPYPATH": str(home)}
    done = subprocess.run(mypy, cwd=tmp_path, env=os.environ | path, capture_output=True, text=True, check=False)
    errors = [line.split("error: ")[1] for line in done.stdout.splitlines() if "error: " in line]
    assert len(errors) == 3, done.stdout + done.stderr
    assert errors[0].startswith('Cannot instantiate abstract class "Half" with abstract attributes "begin_move", "finish_move", "home", "read"')
    assert errors[1].startswith('Argument 2 of "emit" is incompatible with supertype')
    assert errors[2].startswith('Return type "int" of "state" incompatible with return type "LaserState"')

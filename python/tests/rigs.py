"""A small simulated rig with all instruments, and Python classes that wrap its instruments."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rendered import sunstone

from pysunstone import rig

RIG = """
name = "test"
[stages.polarizer_1]
[stages.retarder_2]
backlash_deg = 0.1
[stages.retarder_3]
[stages.polarizer_4]
[projector]
size = [8, 6]
[camera]
size = [12, 10]
[geometry]
camera = { matrix = [[12, 0, 5.5], [0, 12, 4.5], [0, 0, 1]], distortion = [-0.1, 0.02, 0, 0] }
projector = { matrix = [[8, 0, 3.5], [0, 8, 2.5], [0, 0, 1]] }
rodrigues = [0, 0.05, 0]
translation = [0.2, 0.01, 0]
[laser]
nm = 550
[galvo]
[counter]
[bench]
sample = "air"
brightness = 0.3
wavelength_nm = 550
seed = 5
"""

CAMERA = """
rig = "rig.toml"
scheme = { kind = "quad", captures = 6 }
[camera]
exposures_ms = [10, 40]
masks = ["dark", "full", { name = "epipolar", stripes = 3 }]
[limits]
saturated_share = 0.9
"""

SCAN = """
rig = "rig.toml"
scheme = { kind = "quad", captures = 4 }
[scan]
points = [5, 4]
fov_x_deg = 10
dwell_ms = 2
bins = 64
bin_ps = 25
[limits]
laser_power = 0.9
"""


def write(folder: Path, faults: str = "") -> Path:
    """Write the files of the rig, with faults of the simulated bench; return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in {
        "rig": RIG + faults,
        "camera": CAMERA,
        "scan": SCAN,
        "tags": SCAN.replace("bin_ps = 25\n", "bin_ps = 25\ntime_tags = true\n"),
    }.items():
        (folder / f"{name}.toml").write_text(text)
    return folder


def fault(kind: str, instrument: str, at: int) -> str:
    """Return a fault of the bench as TOML."""
    return f'[[bench.faults]]\nkind = "{kind}"\ninstrument = "{instrument}"\nat = {at}\n'


def content(store: Path) -> dict[str, bytes]:
    """Return every file of a finished run except the journal, which differs between runs. The command checks the store."""
    sunstone("verify", store)
    files = (p for p in sorted(store.rglob("*")) if p.is_file() and p.name != ".session.jsonl")
    return {str(p.relative_to(store)): p.read_bytes() for p in files}


def journal(store: Path) -> list[dict[str, Any]]:
    """Return the events of a run."""
    return [json.loads(line) for line in (store / ".session.jsonl").read_text().splitlines()]


class Around(rig.Instrument):
    """Forwards all calls to an instrument, and counts them."""

    def __init__(self, of: Any) -> None:
        self.of = of
        self.calls: list[str] = []

    def identify(self, within_s: float) -> rig.Identity:
        return self.of.identify(within_s)

    def reconnect(self, within_s: float) -> None:
        self.calls.append("reconnect")
        self.of.reconnect(within_s)

    def temperature_c(self) -> float | None:
        return self.of.temperature_c()


class Stage(Around, rig.RotationStage):
    def limits(self) -> rig.StageLimits:
        return self.of.limits()

    def home(self, within_s: float) -> None:
        self.calls.append("home")
        self.of.home(within_s)

    def begin_move(self, angle_deg: float) -> None:
        self.calls.append("begin_move")
        self.of.begin_move(angle_deg)

    def finish_move(self, within_s: float) -> rig.StageReading:
        return self.of.finish_move(within_s)

    def read(self, within_s: float) -> rig.StageReading:
        return self.of.read(within_s)

    def stop(self, within_s: float) -> None:
        self.of.stop(within_s)


class Projector(Around, rig.PatternProjector):
    def limits(self) -> rig.ProjectorLimits:
        return self.of.limits()

    def load(self, patterns: Sequence[npt.NDArray[np.uint8]], within_s: float) -> None:
        self.of.load(patterns, within_s)

    def show(self, pattern: int, within_s: float) -> None:
        self.calls.append("show")
        self.of.show(pattern, within_s)

    def dark(self, within_s: float) -> None:
        self.calls.append("dark")
        self.of.dark(within_s)


class Camera(Around, rig.AreaCamera):
    def limits(self) -> rig.CameraLimits:
        return self.of.limits()

    def configure(self, settings: rig.CameraSettings, within_s: float) -> None:
        self.of.configure(settings, within_s)

    def expose(self) -> None:
        self.calls.append("expose")
        self.of.expose()

    def frame(self, within_s: float) -> rig.Frame | npt.NDArray[Any]:
        return self.of.frame(within_s)


class Galvo(Around, rig.GalvoScanner):
    def limits(self) -> rig.GalvoLimits:
        return self.of.limits()

    def point(self, angles_deg: tuple[float, float], within_s: float) -> tuple[float, float]:
        self.calls.append("point")
        return self.of.point(angles_deg, within_s)


class Laser(Around, rig.PulsedLaser):
    def limits(self) -> rig.LaserLimits:
        return self.of.limits()

    def emit(self, on: bool, rate_hz: float, within_s: float) -> None:
        self.calls.append(f"emit {on}")
        self.of.emit(on, rate_hz, within_s)

    def state(self, within_s: float) -> rig.LaserState:
        return self.of.state(within_s)


class Counter(Around, rig.PhotonCounter):
    def limits(self) -> rig.CounterLimits:
        return self.of.limits()

    def configure(self, settings: rig.CounterSettings, within_s: float) -> None:
        self.of.configure(settings, within_s)

    def begin(self) -> None:
        self.calls.append("begin")
        self.of.begin()

    def finish(self, within_s: float) -> rig.Histogram:
        return self.of.finish(within_s)


AROUND: dict[str, type[Any]] = {"projector": Projector, "camera": Camera, "galvo": Galvo, "laser": Laser, "counter": Counter}


def wrap(session: rig.Session) -> dict[str, Any]:
    """Wrap every instrument of a session in Python."""
    for name in session:
        session[name] = AROUND.get(name, Stage)(session[name])
    return dict(session)

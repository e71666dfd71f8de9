"""A rig session whose instruments are all Python: a laboratory that computes what its camera sees."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rendered import sunstone

import pysunstone as ps
from pysunstone import rig

LABORATORY = """
[detector.cmos]
bit_depth = 12
[stages.retarder_3]
driver = "python"
approach_deg = 0
"""

WHOLE = """
rig = "rig.toml"
scheme = { kind = "drr", captures = 36 }
[camera]
exposures_ms = [1]
masks = ["dark", "full"]
"""


#: Digital number of unit light.
SCALE = 4000


class Axle(rig.RotationStage):
    """A simulated stage that moves without delay, in steps of 0.001°."""

    def __init__(self) -> None:
        self.at, self.homed, self.goals = 77.0, False, [0.0]

    def limits(self) -> rig.StageLimits:
        return rig.StageLimits(range_deg=(-720.0, 720.0), resolution_deg=0.001)

    def home(self, within_s: float) -> None:
        self.at, self.homed = 0.0, True

    def begin_move(self, angle_deg: float) -> None:
        self.goals.append(angle_deg)

    def finish_move(self, within_s: float) -> rig.StageReading:
        self.at = round(self.goals[-1], 3)
        return self.read(within_s)

    def read(self, within_s: float) -> rig.StageReading:
        return rig.StageReading(self.at, homed=self.homed)

    def stop(self, within_s: float) -> None:
        pass


class Lamp(rig.PatternProjector):
    """A projector that emits light if a pixel of the pattern is on."""

    def __init__(self) -> None:
        self.loaded: list[Any] = []
        self.light = 0.0

    def limits(self) -> rig.ProjectorLimits:
        return rig.ProjectorLimits(size=(4, 3), bits=1)

    def load(self, patterns: Any, within_s: float) -> None:
        assert all(p.shape == (3, 4) and p.dtype == np.uint8 for p in patterns)
        self.loaded = list(patterns)

    def show(self, pattern: int, within_s: float) -> None:
        self.light = float(self.loaded[pattern].mean() / 255)

    def dark(self, within_s: float) -> None:
        self.light = 0.0


def rotated(matrix: Any, degrees: float) -> Any:
    """Return the Mueller matrix of an element with rotated axis (Chipman, Polarized Light and Optical Systems, 6.3)."""
    c, s = np.cos(2 * np.radians(degrees)), np.sin(2 * np.radians(degrees))
    turn = np.array([[1, 0, 0, 0], [0, c, s, 0], [0, -s, c, 0], [0, 0, 0, 1]])
    return turn.T @ matrix @ turn


class Seen(rig.AreaCamera):
    """A camera that views the lamp through a sample between two polarizers with quarter-wave plates. The intensity is computed by
    Mueller calculus with NumPy.
    """

    def __init__(self, lamp: Lamp, axles: dict[str, Axle], sample: Any) -> None:
        self.lamp, self.axles, self.sample = lamp, axles, sample

    def limits(self) -> rig.CameraLimits:
        return rig.CameraLimits(size=(5, 4))

    def configure(self, settings: rig.CameraSettings, within_s: float) -> None:
        self.settings = settings

    def expose(self) -> None:
        polarizer = np.zeros((4, 4))
        polarizer[:2, :2] = 0.5
        plate = np.zeros((4, 4))
        plate[0, 0] = plate[1, 1] = plate[2, 3] = 1.0
        plate[3, 2] = -1.0
        before = rotated(plate, self.axles["retarder_2"].at) @ polarizer
        after = polarizer @ rotated(plate, self.axles["retarder_3"].at)
        self.light = float((after @ self.sample @ before)[0, 0]) * self.lamp.light

    def frame(self, within_s: float) -> Any:
        region = self.settings.region
        return np.full((region.height, region.width), round(100 + SCALE * self.light), np.uint16)


def test_a_rig_with_only_python_instruments_measures_a_known_sample(tmp_path: Path) -> None:
    """Without bench and drivers, in real time, a sample between rotating retarders is reconstructed up to quantization errors."""
    (tmp_path / "rig.toml").write_text(LABORATORY)
    (tmp_path / "plan.toml").write_text(WHOLE)
    # A diattenuator at 0° behind a rotator of 20°: both change if the sign of an angle is flipped.
    sample = np.diag([1.0, 1.0, 0.8, 0.8])
    sample[0, 1] = sample[1, 0] = 0.6
    c, s = np.cos(np.radians(40)), np.sin(np.radians(40))
    sample = sample @ np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])
    lamp, axles = Lamp(), {"retarder_2": Axle(), "retarder_3": Axle()}
    session = rig.Session(
        tmp_path / "plan.toml", instruments={"projector": lamp, "camera": Seen(lamp, axles, sample), **axles}
    )
    outcome = session.run(tmp_path / "s.zarr")
    assert (outcome.taken, outcome.retries) == (72, 0) and lamp.light == 0.0
    # The stage moves to 360° without overshoot, because the rig file does not state its backlash.
    assert {round(goal, 6) for goal in axles["retarder_3"].goals} == {25.0 * k % 360 for k in range(36)}
    sunstone("reconstruct", tmp_path / "s.zarr", "-o", tmp_path / "m.zarr")
    found = ps.open_store(tmp_path / "m.zarr")["full/mean"]
    matrix = found.mean(("y", "x")).squeeze().values
    # The quantization error has a standard deviation of 12^-1/2, which the reconstruction amplifies.
    bound = 5 * np.sqrt(ps.Scheme.drr(36).quality()["error_variance"] / 12) / SCALE
    assert bound < 0.01
    np.testing.assert_allclose(matrix / matrix[0, 0], sample, atol=bound)

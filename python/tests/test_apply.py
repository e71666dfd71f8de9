"""Applications and shape reconstruction on arrays, against closed forms and the command. Negative controls must differ."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pysunstone as ps
import rendered
import scenes
from pysunstone import apply

Array = Any


def run(*words: object) -> str:
    return subprocess.run([rendered.command(), *map(str, words)], capture_output=True, check=True, text=True).stdout


def test_an_application_equals_the_command(tmp_path: Path) -> None:
    """The function and the command use the same renders, so that only the methods run twice."""
    known = {a["name"]: a for a in apply.applications()}
    assert [line.split()[0] for line in run("apply", "list").splitlines()] == list(known)
    reported: list[tuple[int, int]] = []
    found = apply.run(
        "metamerism", scenes=rendered.ROOT / "scenes", renders=tmp_path / "renders", progress=lambda *n: reported.append(n)
    )
    assert reported
    words = ["apply", "metamerism", "--preview", "--seeds", 1, "--scenes", rendered.ROOT / "scenes"]
    output = run(*words, "--renders", tmp_path / "renders", "-o", tmp_path / "out")
    assert "(0 new renders)" in output
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert len(found.rows) == len(report["rows"]) > 4
    for row, want in zip(found.rows, report["rows"], strict=True):
        assert row["mean"] == want["value"]["mean"] and row["std_error"] == want["value"]["standard_error"]
        assert (row["method"], row["metric"]) == (want["method"], want["metric"])
        difference = want["ours_less_this"]
        assert np.isnan(row["difference"]) if difference is None else row["difference"] == difference["mean"]
    assert found.notes == report["notes"] and found.attrs["test"] == known["metamerism"]["test"]
    data = found.to_xarray()
    assert dict(data.sizes) == {"metric": 1, "method": len(found.rows)}
    assert float(data["mean"][0, 2]) == found.rows[2]["mean"] and data.attrs["scene"] == report["scene"]
    assert found.pictures and all(p.values.ndim == 3 for p in found.pictures)

    def stop(done: int, of: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        apply.run("metamerism", scenes=rendered.ROOT / "scenes", renders=tmp_path / "others", progress=stop)


@pytest.mark.parametrize(
    ("code", "periods", "exact"),
    [("gray", None, 0.5), ("xor-02", None, 0.5), ("xor-04", None, 0.5), ("phase-shift", None, 1e-9), ("micro-phase-shift", [16.0, 14.3, 17.9, 15.2], 1e-9)],
)
def test_structured_light_codes_decode_to_their_columns(code: Any, periods: Any, exact: float) -> None:
    rng = np.random.default_rng(2)
    columns, shape = 50, (9, 11)
    column = rng.integers(0, columns, shape)
    shown = apply.patterns(code, columns, periods=periods)
    assert shown.shape[1] == columns and 0 <= shown.min() and shown.max() <= 1
    captures = rng.uniform(0.2, 1.0, shape) * (shown[:, column] + rng.uniform(0, 0.4, shape))
    found, confidence = apply.decode(code, captures, columns, periods=periods)
    assert found.shape == confidence.shape == shape
    assert abs(found - (column + 0.5)).max() < max(exact, 1e-9)
    assert ((confidence > 0) & (confidence <= 1)).all()
    # Negative controls: two captures are exchanged, or ambient light hides the code.
    wrong = captures.copy()
    wrong[[0, -1]] = wrong[[-1, 0]]
    assert not np.allclose(apply.decode(code, wrong, columns, periods=periods)[0], found, equal_nan=True)
    assert np.isnan(apply.decode(code, captures + 1e3, columns, periods=periods, least_contrast=0.05)[0]).all()


def devices() -> apply.Devices:
    return apply.Devices.of(ps.Scene.from_toml(scenes.TEXT))


def rays(camera: dict[str, Any]) -> Array:
    """Return the points at depth 1 of all pixels' rays, in the camera's frame."""
    (w, h), f, c = camera["resolution"], camera["focal"], camera["principal"]
    x, y = np.meshgrid((np.arange(w) + 0.5 - c[0]) / f[0], (np.arange(h) + 0.5 - c[1]) / f[1])
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def test_columns_of_a_plane_give_its_depth_and_normals() -> None:
    both = devices()
    camera, projector = both.camera, both.projector
    assert camera["resolution"] == [24, 16] and np.allclose(np.transpose(camera["axes"]) @ camera["axes"], np.eye(3), atol=1e-6)
    again = apply.Devices(camera, projector)
    assert again.camera == camera and again.projector == projector
    normal, distance = np.array([0.2, -0.4, -1.0]) / np.linalg.norm([0.2, -0.4, -1.0]), -3.0
    ray = rays(camera)
    z = distance / (ray @ normal)
    world = np.array(camera["origin"]) + (ray * z[..., None]) @ np.array(camera["axes"])
    seen = (world - projector["origin"]) @ np.transpose(projector["axes"])
    column = projector["focal"][0] * seen[..., 0] / seen[..., 2] + projector["principal"][0]
    depth = apply.depth(both, column)
    assert np.allclose(depth, z, rtol=1e-9)
    for robust in (True, False):
        assert np.allclose(apply.normals(both, depth, robust=robust), normal, atol=1e-7)
    # Negative control: an offset of 0.1 columns.
    assert not np.allclose(apply.depth(both, column + 0.1), z, rtol=1e-4)
    assert np.isnan(apply.depth(both, np.full_like(column, np.nan))).all()


def test_polarization_determines_the_zenith_angle() -> None:
    """The zenith angle follows Atkinson & Hancock 2006, eq. 9, for subsurface light through a smooth surface of index 1.5."""
    both, n = devices(), 1.5
    shape = (16, 24)
    rng = np.random.default_rng(4)
    zenith, azimuth = rng.uniform(0.05, 1.4, shape), rng.uniform(0, np.pi, shape)
    s, c = np.sin(zenith) ** 2, np.cos(zenith)
    degree = (n - 1 / n) ** 2 * s / (2 + 2 * n**2 - (n + 1 / n) ** 2 * s + 4 * c * np.sqrt(n**2 - s))
    m = np.zeros((*shape, 4, 4))
    m[..., 0, 0] = 0.7
    m[..., 1, 0], m[..., 2, 0] = 0.7 * degree * np.cos(2 * azimuth), 0.7 * degree * np.sin(2 * azimuth)
    cues = apply.polarization_cues(m, n)
    turn = (cues[..., 2] - azimuth + np.pi / 2) % np.pi - np.pi / 2
    assert np.allclose(cues[..., 0], degree, atol=1e-12) and np.allclose(cues[..., 1], zenith, atol=1e-7)
    assert abs(turn).max() < 1e-9
    # Negative control: a different refractive index.
    assert abs(apply.polarization_cues(m, 1.4)[..., 1] - zenith).max() > 0.02
    # Both candidates have this angle to the ray. The candidate closer to the guess is used.
    towards = -rays(both.camera) / np.linalg.norm(rays(both.camera), axis=-1, keepdims=True)
    guess = towards + [0.5, -0.2, 0.0]
    found = apply.polarization_normals(both, cues, guess)
    assert np.allclose(np.linalg.norm(found, axis=-1), 1, atol=1e-12)
    assert np.allclose((found * towards).sum(-1), np.cos(zenith), atol=1e-7)
    other = apply.polarization_normals(both, cues, towards - [0.5, -0.2, 0.0])
    assert ((found * guess).sum(-1) >= (other * guess).sum(-1) - 1e-9).all() and not np.allclose(found, other)


def test_invalid_arguments_are_reported(tmp_path: Path) -> None:
    both = devices()
    camera = both.camera
    for call, words in (
        (lambda: apply.run("metamerismus"), "unknown application `metamerismus`; available:"),
        (lambda: apply.run("metamerism", scenes=tmp_path), str(tmp_path)),
        (lambda: apply.run("metamerism", scenes=rendered.ROOT / "scenes", renders=tmp_path, seeds=0), "seeds"),
        (lambda: apply.run("ellipsometry", capture=tmp_path / "c.toml"), "captures its own input"),
        (lambda: apply.patterns("grey", 50), "unknown code `grey`"),  # type: ignore[arg-type]
        (lambda: apply.patterns("gray", 0), "columns"),
        (lambda: apply.patterns("gray", 50, periods=[3.0]), "periods"),
        (lambda: apply.patterns("micro-phase-shift", 50), "periods"),
        (lambda: apply.decode("gray", np.ones((3, 2, 2)), 50), "got 3 captures, but the code has 12"),
        (lambda: apply.decode("phase-shift", np.ones((4, 2, 2)), 50, periods=[20.0]), "periods"),
        (lambda: apply.decode("gray", np.ones((3, 2)), 50), "captures, rows, columns"),
        (lambda: apply.depth(both, np.ones((3, 2))), "camera has 16 rows of 24"),
        (lambda: apply.normals(both, np.ones((3, 2, 1))), "rows, columns"),
        (lambda: apply.polarization_cues(np.ones((3, 4, 4))), "rows, columns, 4, 4"),
        (lambda: apply.polarization_cues(np.ones((3, 2, 4, 4)), 0.9), "index"),
        (lambda: apply.Devices({**camera, "fov": 3}), "unknown key `fov`"),
        (lambda: apply.Devices({"resolution": [3, 2]}), "`focal` is missing"),
        (lambda: apply.Devices({**camera, "focal": [0.0, 1.0]}), "focal lengths"),
    ):
        with pytest.raises(ps.InputError, match=words):
            call()

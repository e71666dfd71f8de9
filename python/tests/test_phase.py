"""Phase functions over the angle, against closed forms, an independent program and the command. Negative controls must differ."""

from __future__ import annotations

import csv
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pysunstone as ps
import rendered
import scenes
from pysunstone import phase

ANGLES = np.linspace(0.0, 180.0, 721)


def integral(s11: Any) -> float:
    """Integrate over the sphere, with Simpson's rule over the angle."""
    theta = np.radians(ANGLES)
    f = s11 * np.sin(theta) * 2 * np.pi
    h = theta[1] - theta[0]
    return float(h / 3 * (f[0] + f[-1] + 4 * f[1:-1:2].sum() + 2 * f[2:-1:2].sum()))


def test_rayleigh_matches_the_closed_form() -> None:
    m = phase.evaluate({"rayleigh": {"depolarization": 0.0}}, ANGLES.reshape(7, 103))
    assert m.shape == (7, 103, 4, 4)
    mu = np.cos(np.radians(ANGLES))
    want = np.zeros((721, 4, 4))
    want[:, 0, 0] = want[:, 1, 1] = (1 + mu**2) / 2
    want[:, 0, 1] = want[:, 1, 0] = (1 - mu**2) / 2
    want[:, 2, 2] = want[:, 3, 3] = mu
    want *= 3 / (8 * np.pi)
    assert np.allclose(m.reshape(721, 4, 4), want, atol=1e-6)
    # Negative control: light that is polarized in the scattering plane.
    turned = want * [[1, -1, 1, 1], [-1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 1]]
    assert not np.allclose(m.reshape(721, 4, 4), turned, atol=1e-3)
    # For air at 90°, the ratio of parallel to perpendicular light is the depolarization factor.
    air = phase.evaluate({"rayleigh": {"depolarization": 0.028}}, 90.0)
    assert air.shape == (4, 4)
    assert (air[0, 0] - air[0, 1]) / (air[0, 0] + air[0, 1]) == pytest.approx(0.028, rel=1e-4)


@pytest.mark.parametrize("g", [-0.3, 0.0, 0.85])
def test_henyey_greenstein_matches_the_closed_form(g: float) -> None:
    medium = phase.Medium({"henyey_greenstein": {"g": g}})
    s11 = medium.evaluate(ANGLES)[:, 0, 0]
    mu = np.cos(np.radians(ANGLES))
    want = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * mu) ** 1.5)
    assert np.allclose(s11, want, rtol=1e-5)
    assert medium.asymmetry == pytest.approx(g, abs=1e-12)
    assert integral(s11) == pytest.approx(1, rel=1e-4)
    assert not np.allclose(s11, want * 1.001, rtol=1e-5)


def test_spheres_match_miepython() -> None:
    """The time factors of both programs differ: M23 is Im S1 S2* of miepython's amplitudes (validation/mie.py)."""
    miepython = pytest.importorskip("miepython")
    radius, host = 500.0, 1.33
    index = {450.0: 1.60, 550.0: 1.59, 660.0: 1.58}
    kinds = [{"index": list(index.values()), "sizes": {"single": {"radius_nm": radius}}, "amount": {"per_m3": 1e12}}]
    medium = phase.Medium({"particles": {"host": host, "kinds": kinds}}, wavelengths_nm=list(index))
    m = medium.evaluate(ANGLES)
    mu = np.cos(np.radians(ANGLES))
    for lane, (nm, n) in enumerate(index.items()):
        x = 2 * np.pi * radius * host / nm
        s1, s2 = miepython.S1_S2(n / host, x, mu, norm="4pi")
        s = np.zeros((len(mu), 4, 4))
        s[:, 0, 0] = s[:, 1, 1] = (abs(s1) ** 2 + abs(s2) ** 2) / 2
        s[:, 0, 1] = s[:, 1, 0] = (abs(s1) ** 2 - abs(s2) ** 2) / 2
        s[:, 2, 2] = s[:, 3, 3] = (s1 * np.conj(s2)).real
        s[:, 2, 3] = (s1 * np.conj(s2)).imag
        s[:, 3, 2] = -s[:, 2, 3]
        s /= 4 * np.pi
        s *= 1 / integral(s[:, 0, 0])
        off = abs(m[:, lane] - s) / s[:, :1, :1]
        assert off.max() < 2e-5, off.max()
        # Negative controls: the opposite handedness, and a radius that is wrong by 1 %.
        assert (abs(m[:, lane] - np.swapaxes(s, -1, -2)) / s[:, :1, :1]).max() > 0.1
        qext, qsca, _, g = miepython.efficiencies_mx(n / host, x * 1.0)
        assert medium.asymmetry[lane] == pytest.approx(g, rel=1e-6)
        area = np.pi * (radius * 1e-9) ** 2
        assert medium.scattering_cross_section[lane] == pytest.approx(qsca * area, rel=1e-6)
        assert medium.scattering[lane] == pytest.approx(1e12 * qsca * area, rel=1e-6)
        assert medium.scattering[lane] != pytest.approx(1e12 * miepython.efficiencies_mx(n / host, x * 1.01)[1] * area, rel=1e-3)


def test_values_equal_the_command(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text("[media]\ndrink.milk = {}\nfog.homogeneous = { scattering = [1, 2, 3], phase.rayleigh = {} }\n")
    for name in ("drink", "fog"):
        printed = subprocess.run(
            [rendered.command(), "phase", "eval", str(path), "--name", name, "--angles", "19", "--wavelengths", "500,633"],
            capture_output=True,
            check=True,
            text=True,
        ).stdout
        rows = [r for r in csv.reader(printed.splitlines()) if not r[0].startswith(("#", "angle"))]
        want = np.array(rows, dtype=float).reshape(2, 19, 8)
        medium = phase.Medium(path, name, wavelengths_nm=[633, 500])
        m = medium.evaluate(want[0, :, 0])
        for lane, of in ((1, want[0]), (0, want[1])):
            found = np.stack([m[:, lane, i, j] for i, j in ((0, 0), (0, 1), (1, 1), (2, 2), (2, 3), (3, 3))], axis=-1)
            assert np.allclose(found, of[:, 2:], rtol=2e-5, atol=1e-8)
    assert medium.scattering.tolist() == pytest.approx([3 - (660 - 633) / 110, 1.5])
    assert phase.evaluate({"milk": {}}, 10.0).shape == (4, 4)
    scene = ps.Scene.from_dict(scenes.document(media={"fog": {"homogeneous": {"scattering": [1, 2, 3], "phase": {"rayleigh": {}}}}}))
    of_scene = phase.Medium(scene, wavelengths_nm=[633, 500])
    assert np.array_equal(of_scene.evaluate(want[0, :, 0]), m) and of_scene.scattering.tolist() == medium.scattering.tolist()
    with pytest.raises(ps.InputError, match="there is no medium"):
        phase.Medium(ps.Scene.from_toml(scenes.TEXT))
    assert phase.eval("isotropic", [0.0, 90.0])[:, 0, 0] == pytest.approx(1 / (4 * np.pi), rel=1e-6)


def test_invalid_arguments_are_reported(tmp_path: Path) -> None:
    several = {"media": {"a": {"milk": {}}, "b": {"skin": {}}}}
    for call, words in (
        (lambda: phase.evaluate({"rayleigh": {}}, 181.0), "no scattering angles"),
        (lambda: phase.evaluate({"rayleigh": {}}, [np.nan]), "no scattering angles"),
        (lambda: phase.evaluate({"henyey_greenstein": {"g": 1.5}}, 0.0), "g"),
        (lambda: phase.evaluate({"mlk": {}}, 0.0), "mlk"),
        (lambda: phase.evaluate(several, 0.0), "a, b"),
        (lambda: phase.evaluate(several, 0.0, name="c"), "unknown medium `c`"),
        (lambda: phase.evaluate(tmp_path / "none.toml", 0.0), "none.toml"),
        (lambda: phase.evaluate(phase.Medium({"milk": {}}), 0.0, name="x"), "already built"),
    ):
        with pytest.raises(ps.InputError, match=words):
            call()

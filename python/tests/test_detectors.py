"""Captures by detectors and along the rays of a lens, against the command and statistics."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pysunstone as ps
import rendered

CAMERA = rendered.ROOT / "validation/camera.toml"


def run(*words: object) -> str:
    return subprocess.run([rendered.command(), *map(str, words)], capture_output=True, check=True, text=True).stdout


def matrices(*shape: int) -> Any:
    rng = np.random.default_rng(len(shape))
    m = np.zeros((*shape, 4, 4))
    m[..., 0, 0] = 1
    for i in range(1, 4):
        m[..., i, i] = rng.uniform(-0.5, 0.9, shape)
    m[..., 0, 1] = m[..., 1, 0] = 0.05
    return m * rng.uniform(0.2, 1.0, (*shape, 1, 1))


@pytest.mark.parametrize("preset", ["drr36", "drr9p"])
@pytest.mark.parametrize("options", [["--detector"], ["--relative-noise", 0.01], ["--noise", 0.02], ["--noise", 0.0, "--view", 30]])
def test_captures_equal_the_command(tmp_path: Path, preset: str, options: list[object]) -> None:
    m = matrices(6, 8, 2)
    scheme = ps.Scheme.drr(36) if preset == "drr36" else ps.Scheme.drr(9, polarizer_array=True)
    (tmp_path / "s.toml").write_text(scheme.to_toml())
    np.save(tmp_path / "m.npy", m)
    given: dict[str, Any] = {"wavelengths_nm": [450, 650], "seed": 3}
    words: list[object] = ["--wavelengths", "450,650", "--seed", 3, *options]
    if options == ["--detector"]:
        words += [CAMERA, "--variance", tmp_path / "v.npy"]
        given |= {"detector": CAMERA, "variance": True}
    elif "--view" in options:
        given |= {"fov_x_deg": 30.0}
    elif "--noise" in options:
        given |= {"noise": 0.02}
    else:
        given |= {"relative_noise": 0.01}
    run("capture", tmp_path / "m.npy", "--scheme", tmp_path / "s.toml", "-o", tmp_path / "i.npy", *words)
    found = ps.simulate(m, scheme, **given)
    if options == ["--detector"]:
        found, variances = found
        assert np.array_equal(variances, np.load(tmp_path / "v.npy"))
    assert found.shape == np.load(tmp_path / "i.npy").shape
    assert np.array_equal(found, np.load(tmp_path / "i.npy"), equal_nan=True)
    assert not np.array_equal(ps.simulate(m, scheme, wavelengths_nm=[450, 650]), found)
    if "--view" in options:
        # For oblique incidence on plates, the ray of every pixel is required.
        files = [tmp_path / "i.npy", "--scheme", tmp_path / "s.toml", "--wavelengths", "450,650", "--view", 30]
        run("reconstruct", *files, "-o", tmp_path / "r.npy")
        again = ps.reconstruct(found, scheme, wavelengths_nm=[450, 650], fov_x_deg=30.0)
        assert np.array_equal(again, np.load(tmp_path / "r.npy"))
        assert np.allclose(again, m, atol=2e-5)


def test_a_dict_equals_a_detector_file(tmp_path: Path) -> None:
    m, scheme = matrices(6, 8), ps.Scheme.drr(9, polarizer_array=True)
    text = 'demosaic = "superpixel"\n[cmos]\nfull_well_e = 9000.0\nexposure_s = 0.01\n'
    (tmp_path / "d.toml").write_text(text)
    of_file = ps.simulate(m, scheme, detector=tmp_path / "d.toml", seed=1)
    settings = {"demosaic": "superpixel", "cmos": {"full_well_e": 9000.0, "exposure_s": np.float64(0.01)}}
    assert np.array_equal(ps.simulate(m, scheme, detector=settings, seed=1), of_file, equal_nan=True)
    assert of_file.shape == (9, 4, 3, 4)
    other = {**settings, "cmos": {"full_well_e": 9000.0, "exposure_s": 0.02}}
    assert not np.array_equal(ps.simulate(m, scheme, detector=other, seed=1), of_file, equal_nan=True)


def test_photon_counters_count_in_time_bins() -> None:
    """Counts are in the unit of the matrices. The mean over pulses equals the noiseless capture within 5 standard errors."""
    m, scheme = matrices(12, 10, 5), ps.Scheme.drr(16)
    detector = {"spad": {"photons_per_unit": 0.05, "irf_fwhm_ps": 0.0, "irf_tail": 0.0}}
    counted = ps.simulate(m, scheme, detector=detector, bin_ps=500.0, seed=2)
    clean = ps.simulate(m, scheme)
    assert counted.shape == clean.shape == (16, 12, 10, 5)
    off = (counted - clean).ravel()
    assert abs(off.mean()) < 5 * off.std() / off.size**0.5 and off.std() > 0
    # Negative control: 5 % more light is detected.
    assert abs((counted - 1.05 * clean).mean()) > 5 * off.std() / off.size**0.5
    with pytest.raises(ps.InputError, match="counts photons in time bins"):
        ps.simulate(m, scheme, detector=detector)
    with pytest.raises(ps.InputError, match="only a camera provides variances"):
        ps.simulate(m, scheme, detector=detector, bin_ps=500.0, variance=True)


def test_invalid_arguments_are_reported(tmp_path: Path) -> None:
    m, scheme = matrices(4, 4), ps.Scheme.drr(16)
    i = ps.simulate(m, scheme)
    for call, words in (
        (lambda: ps.simulate(m, scheme, detector=tmp_path / "none.toml"), "none.toml"),
        (lambda: ps.simulate(m, scheme, detector={"cmos": {"exposure": 1.0}}), "exposure"),
        (lambda: ps.simulate(m, scheme, detector={"cmos": {}}, noise=0.1), "one of detector, noise"),
        (lambda: ps.simulate(m, scheme, relative_noise=-1.0), "relative_noise"),
        (lambda: ps.simulate(m, scheme, fov_x_deg=180.0), "fov_x_deg"),
        (lambda: ps.simulate(m, scheme, bin_ps=10.0), "rows, columns, bins"),
        (lambda: ps.simulate(m, scheme, noise=0.1, variance=True), "only a camera"),
        (lambda: ps.reconstruct(i, scheme, fov_x_deg=-2.0), "fov_x_deg"),
        (lambda: ps.reconstruct(i[:, 0, 0], scheme, fov_x_deg=20.0), "no rows and columns"),
    ):
        with pytest.raises(ps.InputError, match=words):
            call()

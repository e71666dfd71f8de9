"""Exposure times and photon budgets against closed forms, simulated captures and rendered planes."""

from __future__ import annotations

import math
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pysunstone as ps
import scenes
from pysunstone.exposure import Exposure, exposure_for

#: A camera with simple numbers. Its full well limits the range: 2 e⁻ per DN, and the 16 bits exceed the full well.
CAMERA = {
    "full_well_e": 20_000.0,
    "gain_e_per_dn": 2.0,
    "bit_depth": 16,
    "black_level_dn": 100.0,
    "read_noise_e": 3.0,
    "dark_current_e_s": 0.0,
    "quantum_efficiency": 0.5,
    "photons_per_unit": 4e5,
}


def uniform(m00: float, *shape: int) -> Any:
    """Return matrices of a depolarizer, whose intensity is M00/4 between any two polarizers."""
    m = np.zeros((*shape, 4, 4))
    m[..., 0, 0] = m00
    return m


def usable(camera: dict[str, Any]) -> float:
    """Return the electrons of the first saturated reading, from the documented model."""
    top = 2 ** camera["bit_depth"] - 1
    gain = camera["gain_e_per_dn"]
    noise = math.sqrt(camera["read_noise_e"] ** 2 + gain**2 / 12)
    saturated_dn = min(math.floor((camera["full_well_e"] - 4 * noise) / gain + camera["black_level_dn"]), top)
    return (saturated_dn - 0.5 - camera["black_level_dn"]) * gain


def test_a_uniform_scene_has_the_closed_form() -> None:
    """The time is share × range / (photons_per_unit × efficiency × M00); the full well limits the range."""
    found = exposure_for(uniform(0.25, 3, 5), {"cmos": CAMERA}, 0.6)
    # floor((20 000 - 4 √(9 + 1/3))/2 + 100) = 10 093; (10 093 - 0.5 - 100) × 2 = 19 985.
    assert found.usable_e == usable(CAMERA) == 19_985.0
    assert math.isclose(found.exposure_s, 0.6 * 19_985 / (4e5 * 0.5 * 0.25), rel_tol=1e-12)
    assert math.isclose(found.electrons, 0.6 * 19_985, rel_tol=1e-12)
    assert math.isclose(found.snr, found.electrons / math.sqrt(found.electrons + 9 + 4 / 12), rel_tol=1e-12)
    assert found.saturated == 0.0 and found.share == 0.6
    assert found.detector == {"cmos": {**CAMERA, "exposure_s": found.exposure_s}}
    assert repr(found) == "<pysunstone.Exposure 0.2398 s, median 1.199e+04 electrons, SNR 109, saturated 0 %>"


def test_dark_current_and_the_digital_range_limit_the_exposure() -> None:
    """8 bits of 2 e⁻ end at 255 DN, above the black level of 100 DN: (255 - 0.5 - 100) × 2 = 309 e⁻, of which dark electrons fill some."""
    camera = {**CAMERA, "bit_depth": 8, "dark_current_e_s": 50.0}
    found = exposure_for(uniform(2.0, 4, 4), {"cmos": camera}, 0.5)
    assert found.usable_e == usable(camera) == 309.0
    assert math.isclose(found.exposure_s, 0.5 * 309 / (4e5 * 0.5 * 2.0 + 50), rel_tol=1e-12)
    dark = 50 * found.exposure_s
    assert math.isclose(found.snr, found.electrons / math.sqrt(found.electrons + dark + 9 + 4 / 12), rel_tol=1e-12)


def test_a_scheme_counts_its_polarizers() -> None:
    """Two ideal polarizers pass a quarter of the light of a depolarizer in every capture and channel."""
    bare = exposure_for(uniform(1.0, 4, 4), {"cmos": CAMERA})
    for scheme in (ps.Scheme.drr(9), ps.Scheme.drr(4, polarizer_array=True)):
        found = exposure_for(uniform(1.0, 4, 4), {"cmos": CAMERA}, scheme=scheme)
        assert math.isclose(found.exposure_s, 4 * bare.exposure_s, rel_tol=1e-6)
        assert math.isclose(found.electrons, bare.electrons, rel_tol=1e-6)


def test_efficiency_depends_on_the_wavelength() -> None:
    """The wavelength with the most electrons decides, not the one with the highest radiance."""
    camera = {**CAMERA, "quantum_efficiency": [[450, 0.8], [650, 0.4]]}
    m = uniform(1.0, 2, 3, 3)
    m[:, :, 2] *= 1.5
    found = exposure_for(m, {"cmos": camera}, 0.5, quantile=1.0, wavelengths_nm=[450, 550, 650])
    # Electrons per photon and unit: 0.8, 0.6, 0.4 × 1.5 = 0.6.
    assert math.isclose(found.exposure_s, 0.5 * usable(camera) / (4e5 * 0.8), rel_tol=1e-12)
    assert math.isclose(found.electrons, 0.6 / 0.8 * 0.5 * usable(camera), rel_tol=1e-12)
    one = exposure_for(uniform(1.0, 2, 3), {"cmos": camera}, 0.5, wavelengths_nm=650)
    assert math.isclose(one.exposure_s, 0.5 * usable(camera) / (4e5 * 0.4), rel_tol=1e-12)


def test_the_quantile_skips_highlights() -> None:
    """1 of 1000 pixels is 100 times as bright and saturates."""
    m = uniform(1.0, 20, 50)
    m[3, 7] *= 100
    at_most = {q: exposure_for(m, {"cmos": CAMERA}, quantile=q) for q in (0.99, 1.0)}
    assert math.isclose(at_most[0.99].exposure_s, 100 * at_most[1.0].exposure_s, rel_tol=1e-12)
    assert math.isclose(at_most[0.99].saturated, 1e-3, rel_tol=1e-9) and at_most[1.0].saturated == 0.0


def test_a_bracket_fills_the_shortest_exposure() -> None:
    camera = {**CAMERA, "bracket": [1.0, 4.0, 0.5]}
    plain, found = (exposure_for(uniform(1.0, 4, 4), {"cmos": c}, 0.8) for c in (CAMERA, camera))
    assert math.isclose(found.exposure_s, 2 * plain.exposure_s, rel_tol=1e-12)
    assert math.isclose(found.electrons, plain.electrons, rel_tol=1e-12)
    # The other two exposures are saturated and contribute nothing.
    assert math.isclose(found.snr, plain.snr, rel_tol=1e-12)


def test_defaults_are_those_of_the_camera() -> None:
    """Captures with an empty dict equal those with the defaults of this module, bit by bit."""
    from pysunstone.exposure import _Camera

    settings = {name: getattr(_Camera, name) for name in _Camera.__dataclass_fields__}
    settings = {name: list(v) if isinstance(v, tuple) else v for name, v in settings.items()}
    m = uniform(1.0, 8, 8) * np.linspace(0.1, 7, 8)[:, None, None, None]
    full, empty = (ps.simulate(m, ps.Scheme.drr(4), detector={"cmos": c}, seed=3, variance=True) for c in (settings, {}))
    assert np.array_equal(full[0], empty[0], equal_nan=True) and np.array_equal(full[1], empty[1])
    assert np.isnan(empty[0]).any() and not np.isnan(empty[0]).all()


@pytest.mark.parametrize("binning", [1, 2])
def test_captures_reach_the_share(binning: int) -> None:
    """The mean of N = 96 × 96 × 4 readings (with binning 2, a quarter) is the share of the range within 5 standard errors.

    The standard error is the standard deviation of N readings divided by √N: 0.02 % of the mean. An error of 5 % of the exposure time
    or of the photons is 200 standard errors.
    """
    m, scheme = uniform(1.0, 96, 96), ps.Scheme.drr(4)
    camera = {**CAMERA, "dark_current_e_s": 20.0, "binning": binning}
    found = exposure_for(m, {"cmos": camera}, 0.8, scheme=scheme)
    seen = ps.simulate(m, scheme, detector=found.detector, seed=7)
    assert seen.size == 96 * 96 * 4 // binning**2 and not np.isnan(seen).any()
    electrons = seen.astype(float) * 4e5 * 0.5 * found.exposure_s + 20.0 * found.exposure_s
    want = 0.8 * usable(camera)
    error = math.sqrt(want + 9 + 4 / 12) / math.sqrt(seen.size * binning**2)
    assert abs(electrons.mean() - want) < 5 * error
    # Negative control: an exposure time that is wrong by 5 % violates the tolerance.
    assert abs(1.05 * electrons.mean() - want) > 100 * error
    # The standard deviation of the readings, within 5 standard errors of 1/√(2N).
    snr = electrons.mean() / electrons.std()
    stated = found.snr * electrons.mean() / found.electrons
    assert abs(snr / stated - 1) < 5 / math.sqrt(2 * seen.size)
    assert abs(1.05 * snr / stated - 1) > 5 / math.sqrt(2 * seen.size)
    # Twice the exposure time saturates all readings.
    double = {"cmos": {**found.detector["cmos"], "exposure_s": 2 * found.exposure_s}}
    assert np.isnan(ps.simulate(m, scheme, detector=double, seed=7)).all()


def test_the_quantile_of_a_capture_reaches_the_share() -> None:
    """The brightest of 64 regions of 32 × 32 pixels is the quantile 1 - 1/128: N = 1024 readings of electrons at the share."""
    levels = np.sort(np.random.default_rng(5).uniform(0.05, 1.0, 64))
    m = uniform(1.0, 32, 32, 64) * levels[:, None, None]
    found = exposure_for(m, {"cmos": CAMERA}, 0.9, quantile=1 - 1 / 128)
    # The polarizers of the scheme pass a quarter of the light of a depolarizer.
    seen = ps.simulate(4 * m, ps.Scheme.drr(1), detector=found.detector, seed=11)[0]
    electrons = seen[..., -1].astype(float) * 4e5 * 0.5 * found.exposure_s
    want = 0.9 * usable(CAMERA)
    error = math.sqrt(want) / math.sqrt(electrons.size)
    assert abs(electrons.mean() - want) < 5 * error
    assert abs(1.05 * electrons.mean() - want) > 50 * error


@pytest.mark.parametrize("bracket", [[1.0], [1.0, 1.02]])
def test_the_stated_share_of_saturated_readings_is_seen(bracket: list[float]) -> None:
    """N = 500 × 500 readings near saturation: the count is binomial, within 5 standard deviations (2 % of the count)."""
    camera = {**CAMERA, "bracket": bracket}
    m = uniform(1.0, 500, 500)
    found = exposure_for(m, {"cmos": camera}, 0.995)
    share = np.isnan(ps.simulate(4 * m, ps.Scheme.drr(1), detector=found.detector, seed=13)).mean()
    assert 0.2 < found.saturated < 0.3
    sigma = math.sqrt(found.saturated * (1 - found.saturated) / 250_000)
    assert abs(share - found.saturated) < 5 * sigma
    assert abs(1.05 * share - found.saturated) > 5 * sigma


def test_variances_are_those_of_the_electrons() -> None:
    """With 12 000 electrons and 3 e⁻ of read noise, the variance of `simulate` is electrons / (electrons per unit)² within 0.1 %."""
    m, scheme = uniform(1.0, 64, 64), ps.Scheme.drr(4)
    found = exposure_for(m, {"cmos": CAMERA}, 0.6, scheme=scheme)
    seen, variance = ps.simulate(m, scheme, detector=found.detector, variance=True, seed=17)
    per_unit = 4e5 * 0.5 * found.exposure_s
    # Stated variances: the mean over N = 16 384 readings has a relative error of 1/√(electrons × N) = 7e-5, plus read noise of 8e-4.
    assert math.isclose(variance.mean(), found.electrons / per_unit**2, rel_tol=2e-3)
    assert not math.isclose(variance.mean(), 1.05 * found.electrons / per_unit**2, rel_tol=2e-3)
    assert math.isclose(float((seen / np.sqrt(variance)).mean()), found.snr, rel_tol=1e-3)


@pytest.mark.parametrize("factors", [{"bracket": [1.0, 8.0]}, {"binning": 2}, {"shot_noise": False}])
def test_snr_is_that_of_simulated_readings(factors: dict[str, Any]) -> None:
    """The median pixel has 1/20 of the brightest light, so the long exposure of the bracket is not saturated there."""
    m = uniform(0.05, 64, 64)
    m[:, :2] *= 20
    found = exposure_for(m, {"cmos": {**CAMERA, **factors}}, 0.8)
    seen, variance = (v[0, :, 2:] for v in ps.simulate(4 * m, ps.Scheme.drr(1), detector=found.detector, variance=True, seed=19))
    assert math.isclose(float((seen / np.sqrt(variance)).mean()), found.snr, rel_tol=5e-3)
    assert math.isclose(float(seen.mean() / seen.std()), found.snr, rel_tol=5 / math.sqrt(2 * seen.size))


def plane(**slice_keys: Any) -> ps.Scene:
    """Return a Lambertian plane 1 m in front of the projector and camera, whose radiance is albedo × irradiance / π everywhere."""
    look = {"look_at": {"origin": [0, 0, 1], "target": [0, 0, 0], "up": [0, 1, 0]}}
    return ps.Scene.from_dict(
        {
            "name": "plane",
            "wavelengths_nm": [550],
            "render": {"spp": 16, "max_depth": 2},
            "camera": {"resolution": [16, 12], "fov_x_deg": 30, "pose": look},
            "projector": {"resolution": [16, 16], "fov_x_deg": 60, "irradiance": 3.0, "pose": look},
            "materials": {"white": {"diffuse": {"albedo": 0.5}}},
            "objects": [{"shape": {"rectangle": {"corner": [-2, -2, 0], "u": [4, 0, 0], "v": [0, 4, 0]}}, "material": "white"}],
            "slices": [{"name": "photo", **slice_keys}],
        }
    )


@pytest.mark.parametrize("keys", [{}, {"polarization": "mueller"}, {"time": {"start_ps": 6671.0, "bin_ps": 50, "bins": 4}}])
def test_a_rendered_plane_has_the_closed_form(keys: dict[str, Any]) -> None:
    """The radiance of the plane is 0.5 × 3 / π, also if most of the light is outside the time bins."""
    scene = plane(**keys)
    want = 0.8 * usable(CAMERA) / (4e5 * 0.5 * 0.5 * 3 / math.pi)
    found = exposure_for(scene, {"cmos": CAMERA}, quantile=0.5)
    assert math.isclose(found.exposure_s, want, rel_tol=1e-3)
    kept = scene.render(spp=16)["photo"]
    assert exposure_for(kept, {"cmos": CAMERA}, quantile=0.5) == found


def test_slices_and_xarray_give_the_same_exposure() -> None:
    xr = pytest.importorskip("xarray")
    scene = ps.Scene.from_toml(scenes.TEXT)
    scheme = ps.Scheme.drr(9)
    kept = scene.render(spp=4)["mueller"]
    data = kept.to_xarray()
    matrices = np.moveaxis(kept["mean"], kept.dims.index("wavelength"), 2)
    assert matrices.shape[-2:] == (4, 4)
    nm = [float(w) for w in kept.coords["wavelength"]]
    camera = {"cmos": {**CAMERA, "quantum_efficiency": [[450, 0.3], [650, 0.7]]}}
    for options in ({}, {"scheme": scheme}):
        found = exposure_for(scene, camera, spp=4, **options)
        for given in (kept, data, data["mean"], data["mean"].transpose(..., "y"), xr.DataTree(data)):
            same = exposure_for(given, camera, **options)
            assert math.isclose(same.exposure_s, found.exposure_s, rel_tol=1e-6) and math.isclose(same.snr, found.snr, rel_tol=1e-6)
        array = exposure_for(matrices, camera, wavelengths_nm=nm, **options)
        assert math.isclose(array.exposure_s, found.exposure_s, rel_tol=1e-6)
    one = exposure_for(kept, camera, wavelengths_nm=550, scheme=scheme)
    assert math.isclose(one.exposure_s, exposure_for(matrices[:, :, 1], camera, scheme=scheme).exposure_s, rel_tol=1e-6)
    # Intensities of a capture, and the Stokes vectors of unpolarized light.
    intensities = ps.simulate(matrices, scheme, wavelengths_nm=nm)
    with_scheme = exposure_for(matrices, camera, wavelengths_nm=nm, scheme=scheme)
    assert exposure_for(intensities, camera, wavelengths_nm=nm) == with_scheme
    stokes = exposure_for(matrices[..., 0], camera, wavelengths_nm=nm, kind="stokes")
    assert stokes == exposure_for(matrices, camera, wavelengths_nm=nm)


def test_files_and_calibrations_are_read(tmp_path: Path) -> None:
    (tmp_path / "camera.toml").write_text('demosaic = "bilinear"\n[cmos]\nfull_well_e = 9000\nbracket = [1, 0.1]\n')
    (tmp_path / "calibration.toml").write_text('name = "x"\n[detector.cmos]\nfull_well_e = 9000\n[detector.spad]\n')
    m, scheme = uniform(1.0, 4, 4), ps.Scheme.drr(4, polarizer_array=True)
    found = exposure_for(m, tmp_path / "camera.toml", scheme=scheme)
    assert found.detector["demosaic"] == "bilinear" and found.detector["cmos"]["bracket"] == [1, 0.1]
    assert ps.simulate(m, scheme, detector=found.detector).shape == (4, 4, 4, 4)
    of_calibration = exposure_for(m, tmp_path / "calibration.toml", scheme=scheme)
    assert of_calibration.detector == {"cmos": {"full_well_e": 9000, "exposure_s": of_calibration.exposure_s}}
    assert math.isclose(found.exposure_s, 10 * of_calibration.exposure_s, rel_tol=1e-12)
    assert isinstance(found, Exposure) and isinstance(ps.exposure_for(m, {"cmos": {}}), ps.Exposure)


def test_invalid_arguments_are_reported(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text("[cmos]\nexposure = 1\n")
    (tmp_path / "broken.toml").write_text("[cmos\n")
    m, camera = uniform(1.0, 4, 4), {"cmos": CAMERA}
    dim = uniform(0.0, 40, 50)
    dim[0, 0] = 1.0
    mueller = {"name": "photo", "polarization": "mueller"}
    for call, words in (
        (lambda: exposure_for(m, camera, 0.0), "share: expected a number above 0 and at most 1, got 0"),
        (lambda: exposure_for(m, camera, 1.2), "share"),
        (lambda: exposure_for(m, camera, math.nan), "share"),
        (lambda: exposure_for(m, camera, quantile=0), "quantile"),
        (lambda: exposure_for(0 * m, camera), "found no light"),
        (lambda: exposure_for(m, {"cmos": {**CAMERA, "quantum_efficiency": 0.0}}), "found no light"),
        (lambda: exposure_for(dim, camera), "only 1 of 2000 are positive"),
        (lambda: exposure_for(m * np.nan, camera), "not finite"),
        (lambda: exposure_for(m, {"spad": {}}), "photon counter .* choose `pulses`"),
        (lambda: exposure_for(m, {"cmos": {"exposure": 1.0}}), "exposure"),
        (lambda: exposure_for(m, {}), "both missing"),
        (lambda: exposure_for(m, {"cmos": {"bit_depth": 1, "black_level_dn": 0.9}}), "usable range of -"),
        (lambda: exposure_for(m, tmp_path / "none.toml"), "none.toml"),
        (lambda: exposure_for(m, tmp_path / "bad.toml"), "bad.toml:2:1"),
        (lambda: exposure_for(m, tmp_path / "broken.toml"), "broken.toml:1"),
        (lambda: exposure_for(m[..., 0, 0], camera, scheme=ps.Scheme.drr(9), kind="intensities"), "requires matrices"),
        (lambda: exposure_for(m, camera, kind="radiance"), "kind"),  # type: ignore[arg-type]
        (lambda: exposure_for(m[..., :3], camera, kind="stokes"), r"\(4, 4, 4, 3\)"),
        (lambda: exposure_for(m, camera, wavelengths_nm=[450, 550]), "2 wavelengths"),
        (lambda: exposure_for({"a": m}, camera), "several slices"),
        (lambda: exposure_for("scene.toml", camera), "expected a Scene"),
        (lambda: exposure_for(plane(), camera, scheme=ps.Scheme.drr(9)), 'polarization = "mueller"'),
        (lambda: exposure_for(plane(camera={"rows": [3]}), camera), "every camera pixel"),
        (lambda: exposure_for(plane(), camera, slice="none"), "none"),
        (lambda: exposure_for(plane(), camera, wavelengths_nm=450), "not a wavelength of the data"),
        (lambda: exposure_for(plane(**mueller), camera, spp=0), "spp|samples"),
    ):
        with pytest.raises(ps.InputError, match=words):
            call()


def test_the_page_prints_its_numbers(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the code of `docs/exposure.md` and compare all numbers that it prints with the page, within 2 %."""
    pytest.importorskip("xarray")
    root = Path(__file__).resolve().parents[2]
    monkeypatch.chdir(root)
    text = (root / "docs/exposure.md").read_text(encoding="utf-8")
    pairs = re.findall(r"```python\n(.*?)```\n\n```text\n(.*?)```", text, re.DOTALL)
    assert len(pairs) == text.count("```python") == 4
    names: dict[str, Any] = {}
    for code, want in pairs:
        assert code.count("\n") <= 25
        with warnings.catch_warnings():
            # Saturated pixels of a reconstruction.
            warnings.simplefilter("ignore", RuntimeWarning)
            exec(compile(code, "docs/exposure.md", "exec"), names)
        printed = capsys.readouterr().out
        number = r"\d+(?:\.\d+)?(?:e[+-]\d+)?"
        assert re.sub(number, "#", printed).split() == re.sub(number, "#", want).split()
        seen, stated = ([float(v) for v in re.findall(number, t)] for t in (printed, want))
        assert seen == pytest.approx(stated, rel=0.02)

"""Decomposition, capture and reconstruction, against closed forms and the command on the same store."""

from __future__ import annotations

import os
import subprocess
import sysconfig
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import rendered
from pysunstone import InputError, Scheme
from pysunstone import accessor as _accessor  # noqa: F401  (registers `.sunstone`)
from pysunstone.stores import open_store

DETECTOR = rendered.ROOT / "validation/camera.toml"


@pytest.fixture(autouse=True)
def the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SUNSTONE", rendered.command())


@pytest.fixture(scope="module")
def schemes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("schemes")
    made = {"drr36": ["-k", 36], "drr25": ["-k", 25], "drr9p": ["-k", 9, "--sensor", "polarizer-array"]}
    for name, options in made.items():
        rendered.sunstone("scheme", "drr", *options, "-o", folder / f"{name}.toml")
    return {name: folder / f"{name}.toml" for name in made}


def steady() -> xr.Dataset:
    return open_store(rendered.store()).children["steady"].to_dataset()


def matrix(values: list[list[float]]) -> xr.DataArray:
    return xr.DataArray(np.array(values, dtype=float)[None], dims=("x", "stokes_out", "stokes_in"))


def test_properties_of_known_elements() -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    retarder = matrix([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, s], [0, 0, -s, c]])
    depolarizer = matrix(np.diag([1, 0.5, 0.4, 0.3]).tolist())
    # A partial polarizer with transmittances 1 and q has the diattenuation (1 - q)/(1 + q).
    q = 0.25
    mean, half, root = (1 + q) / 2, (1 - q) / 2, np.sqrt(q)
    polarizer = matrix([[mean, half, 0, 0], [half, mean, 0, 0], [0, 0, root, 0], [0, 0, 0, root]])
    assert float(retarder.sunstone.decompose()["retardance"][0]) == pytest.approx(0.7, rel=1e-6)
    assert float(depolarizer.sunstone.decompose()["depolarization"][0]) == pytest.approx(1 - 0.4, rel=1e-6)
    found = polarizer.sunstone.decompose()
    assert float(found["diattenuation"][0]) == pytest.approx(0.6, rel=1e-6)
    assert float(found["retardance"][0]) == pytest.approx(0, abs=1e-3)
    product = found["m_delta"].values[0] @ found["m_r"].values[0] @ found["m_d"].values[0]
    assert np.allclose(product, polarizer.values[0], atol=1e-6)
    # Negative controls: transposed axes reverse the retarder, and scalars of different elements differ.
    turned = retarder.rename(stokes_out="stokes_in", stokes_in="stokes_out").sunstone.decompose()
    axis = retarder.sunstone.decompose()["retardance_axis"]
    assert np.allclose(turned["retardance_axis"], -axis, atol=1e-6) and abs(axis).max() > 0.9
    assert float(depolarizer.sunstone.decompose()["retardance"][0]) < 0.1


def test_decomposition_of_a_store_equals_the_command() -> None:
    out = rendered.folder() / "props.npz"
    rendered.sunstone("decompose", rendered.store(), "steady", "-o", out)
    found = steady().sunstone.decompose()
    expected = np.load(out)
    for name in expected:
        ours = found[name.replace("_error", "_std_error")]
        assert np.array_equal(ours.values, expected[name], equal_nan=True), name
        assert ours.dims[:3] == ("y", "x", "wavelength")
    assert found["retardance"].attrs["units"] == "radian"
    assert np.isfinite(found["depolarization_std_error"]).any()
    entropy = steady()["mean"].sel(wavelength=550).sunstone.decompose(only=["entropy"])
    assert list(entropy) == ["entropy"] and entropy["entropy"].dims == ("y", "x")


def test_captures_equal_the_command_and_reconstruct_the_matrices(schemes: dict[str, Path]) -> None:
    data = steady()
    for name, shape in (("drr36", (36,)), ("drr9p", (9, 4))):
        captures = data.sunstone.capture(schemes[name])
        assert captures["mean"].shape == (*shape, 16, 20, 3)
        out = rendered.folder() / "captures.npy"
        rendered.sunstone("capture", rendered.store(), "steady", "--scheme", schemes[name], "-o", out)
        assert np.array_equal(captures["mean"], np.load(out))
        again = captures.sunstone.reconstruct(schemes[name], noise=1e-3)
        truth = data["mean"].transpose(*again["mean"].dims)
        worst = float(abs(again["mean"] - truth).max() / abs(truth).max())
        assert worst < 2e-5, worst
        assert again["mean"].attrs["units"] == data["mean"].attrs["units"]
    one = data["mean"].sel(wavelength=660).sunstone.capture(schemes["drr36"])["mean"]
    many = data.sunstone.capture(schemes["drr36"])["mean"].sel(wavelength=660)
    assert one.dims == ("capture", "y", "x") and np.array_equal(one, many)
    text = schemes["drr36"].read_text()

    class Stub:
        def to_toml(self) -> str:
            return text

    reported = data.sunstone.capture(Stub())
    assert reported.identical(data.sunstone.capture(schemes["drr36"]))
    assert reported.sunstone.reconstruct(Stub(), noise=1e-3)["mean"].shape == (16, 20, 3, 4, 4)
    # Negative control: reconstruction with another scheme.
    wrong = data.sunstone.capture(schemes["drr36"]).isel(capture=slice(25)).sunstone.reconstruct(schemes["drr25"], noise=1e-3)
    right = data.sunstone.capture(schemes["drr36"]).isel(capture=slice(25, None)).assign_coords(capture=range(1, 12))
    assert float(abs(wrong["mean"] - truth).max() / abs(truth).max()) < 2e-5
    with pytest.raises(InputError, match="36|11"):
        right.sunstone.reconstruct(schemes["drr36"], noise=1e-3)


def test_excluded_pixels_are_counted(schemes: dict[str, Path]) -> None:
    values = np.broadcast_to(np.diag([1.0, 0.6, -0.5, 0.3]), (5, 4, 4)).copy()
    values[2:4] = np.nan
    truth = xr.DataArray(values, dims=("x", "stokes_out", "stokes_in"))
    captures = xr.DataArray(truth.sunstone.capture(schemes["drr36"])["mean"])
    with pytest.warns(RuntimeWarning, match="2 of 5 pixels are NaN"):
        found = captures.sunstone.reconstruct(schemes["drr36"], noise=1e-3)
    assert np.isnan(found["mean"].values).all(axis=(1, 2)).tolist() == [False, False, True, True, False]
    with pytest.warns(RuntimeWarning, match="2 of 5 matrices cannot exist"):
        truth.sunstone.decompose()


def test_errors_match_the_variance_of_the_scheme(schemes: dict[str, Path]) -> None:
    """The variances of the 16 elements sum to 196 sigma² for DRR36 (PHYSICS.md). Noise agrees within 5 standard errors."""
    sigma, draws = 1e-3, 4000
    truth = xr.DataArray(
        np.broadcast_to(np.diag([1.0, 0.6, -0.5, 0.3]), (draws, 4, 4)), dims=("x", "stokes_out", "stokes_in"), attrs={"units": "1"}
    )
    captures = truth.sunstone.capture(schemes["drr36"], noise=sigma, seed=11)["mean"]
    found = captures.sunstone.reconstruct(schemes["drr36"], noise=sigma)
    stated = float((found["std_error"].isel(x=0).astype(float) ** 2).sum()) / sigma**2
    assert stated == pytest.approx(196, rel=0.005)
    z = ((found["mean"] - truth) / found["std_error"]).values
    assert abs((z**2).mean() - 1) < 5 * np.sqrt(2 / draws)
    assert (abs(z.mean(0)) < 5 / np.sqrt(draws)).all()
    # Negative control: half of the noise is rejected.
    half = captures.sunstone.reconstruct(schemes["drr36"], noise=sigma / 2)
    assert abs((((half["mean"] - truth) / half["std_error"]).values ** 2).mean() - 1) > 1
    free = captures.sunstone.reconstruct(schemes["drr36"])
    assert float((free["std_error"] ** 2).mean()) == pytest.approx(float((found["std_error"] ** 2).mean()), rel=0.05)
    assert list(captures.sunstone.reconstruct(schemes["drr36"], errors=False)) == ["mean"]


def test_a_simulated_camera_returns_variances(schemes: dict[str, Path]) -> None:
    captures = steady().sunstone.capture(schemes["drr36"], DETECTOR, seed=3)
    assert captures["variance"].shape == captures["mean"].shape
    assert float(captures["variance"].min()) > 0
    weighted = captures.sunstone.reconstruct(schemes["drr36"])
    assert np.isfinite(weighted["std_error"]).any()
    other = captures["mean"].sunstone.reconstruct(schemes["drr36"], variance=4 * captures["variance"])
    ratio = (other["std_error"] / weighted["std_error"]).values
    assert np.allclose(ratio[np.isfinite(ratio)], 2, rtol=1e-4)


def test_invalid_arguments_are_reported(schemes: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    data = steady()
    with pytest.raises(ValueError, match="Mueller matrices are required"):
        data.isel(stokes_in=0).sunstone.decompose()
    with pytest.raises(ValueError, match="captures are required"):
        data.sunstone.reconstruct(schemes["drr36"])
    with pytest.raises(InputError, match=r"nothing\.toml"):
        data.sunstone.capture("nothing.toml")
    with pytest.raises(InputError, match="unknown quantity `entrpy`"):
        data.sunstone.decompose(only=["entrpy"])


def test_no_command_is_needed(schemes: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """Decomposition, capture and reconstruction run in this process."""
    data = steady().isel(y=slice(4), x=slice(5)).compute()
    expected = data.sunstone.decompose()
    monkeypatch.delenv("SUNSTONE")
    monkeypatch.setenv("PATH", os.devnull)
    monkeypatch.setattr(sysconfig, "get_path", lambda name: os.devnull)
    monkeypatch.setattr(subprocess, "run", None)
    assert data.sunstone.decompose().identical(expected)
    captures = data.sunstone.capture(schemes["drr36"], {"cmos": {"photons_per_unit": 1e5}})
    assert set(captures) == {"mean", "variance"}
    assert captures.sunstone.reconstruct(schemes["drr36"])["mean"].shape == (4, 5, 3, 4, 4)
    prior = np.eye(16) * 0.1
    few = data.sunstone.capture(Scheme.qrpr(5), noise=1e-3)
    assert np.isfinite(few.sunstone.reconstruct(Scheme.qrpr(5), prior=prior, noise=1e-3)["mean"]).all()


def test_photon_counts_have_a_time_axis(schemes: dict[str, Path]) -> None:
    """A photon counter reads a slice over y, x and t in the slice's own bins."""
    t = xr.DataArray([1000.0, 1500.0, 2000.0], dims="t", attrs={"units": "ps"})
    data = xr.DataArray(
        np.broadcast_to(np.diag([1.0, 0.5, 0.4, 0.3]), (2, 3, 3, 4, 4)), dims=("y", "x", "t", "stokes_out", "stokes_in")
    ).assign_coords(t=t)
    counted = data.sunstone.capture(schemes["drr36"], {"spad": {"photons_per_unit": 0.05}}, seed=1)
    assert list(counted) == ["mean"] and counted["mean"].dims == ("capture", "y", "x", "t")
    clean = data.sunstone.capture(schemes["drr36"])["mean"]
    # The response of the diode moves some of the first bin's light to later bins.
    assert np.array_equal(counted["t"], t) and float(counted["mean"].mean()) == pytest.approx(float(clean.mean()), rel=0.1)
    binned = data.sunstone.capture(schemes["drr36"], {"cmos": {"binning": 2}}, seed=1)
    assert binned["mean"].sizes["y"] == 1 and "y" not in binned.coords

"""Decomposition, schemes, captures and reconstruction of arrays, against closed forms, the command and other programs."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rendered import command

import pysunstone as ps


def retarder(theta: Any, delta: Any) -> Any:
    """Return Mueller matrices of linear retarders with the fast axis at theta."""
    c, s, cd, sd = np.cos(2 * theta), np.sin(2 * theta), np.cos(delta), np.sin(delta)
    m = np.zeros((*np.shape(theta), 4, 4))
    m[..., 0, 0] = 1
    m[..., 1, 1] = c * c + s * s * cd
    m[..., 1, 2] = m[..., 2, 1] = c * s * (1 - cd)
    m[..., 1, 3], m[..., 3, 1] = -s * sd, s * sd
    m[..., 2, 2] = s * s + c * c * cd
    m[..., 2, 3], m[..., 3, 2] = c * sd, -c * sd
    m[..., 3, 3] = cd
    return m


def diattenuator(d: Any) -> Any:
    """Return Mueller matrices of diattenuators along x."""
    m = np.zeros((*np.shape(d), 4, 4))
    m[..., 0, 0] = m[..., 1, 1] = 1
    m[..., 0, 1] = m[..., 1, 0] = d
    m[..., 2, 2] = m[..., 3, 3] = np.sqrt(1 - d**2)
    return m


rng = np.random.default_rng(1)
N = 500
THETA, DELTA, D, A = rng.uniform(0, np.pi, N), rng.uniform(0.1, 3.0, N), rng.uniform(0, 0.9, N), rng.uniform(0.1, 0.9, N)
DEPOLARIZER = np.zeros((N, 4, 4))
DEPOLARIZER[:, range(4), range(4)] = np.stack([np.ones(N), A, A, A], -1)
MATRICES = DEPOLARIZER @ retarder(THETA, DELTA) @ diattenuator(D)


def test_closed_forms() -> None:
    found = ps.decompose(MATRICES)
    np.testing.assert_allclose(found["diattenuation"], D, atol=1e-12)
    np.testing.assert_allclose(found["retardance"], DELTA, atol=1e-6)
    np.testing.assert_allclose(found["depolarization"], 1 - A, atol=1e-9)
    np.testing.assert_allclose(found["m_delta"] @ found["m_r"] @ found["m_d"], MATRICES, atol=1e-9)
    axis = np.stack([np.cos(2 * THETA), np.sin(2 * THETA), 0 * THETA], -1)
    np.testing.assert_allclose(found["retardance_axis"], axis, atol=1e-5)
    assert all(v.dtype == np.float64 for v in found.values())


def test_decompose_agrees_with_muellerkit() -> None:
    muellerkit = pytest.importorskip("muellerkit")
    found = ps.decompose(MATRICES)
    factors = muellerkit.decompose_depolarizer_retarder_diattenuator(MATRICES)
    for name, theirs in zip(("m_delta", "m_r", "m_d"), factors, strict=True):
        np.testing.assert_allclose(found[name], theirs, atol=1e-8, err_msg=name)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_decompose_equals_the_command(tmp_path: Path, dtype: Any) -> None:
    matrices, errors = MATRICES.reshape(50, 10, 4, 4).astype(dtype), np.full((50, 10, 4, 4), 1e-3, dtype)
    np.save(tmp_path / "M.npy", matrices)
    np.save(tmp_path / "E.npy", errors)
    words = [command(), "decompose", "M.npy", "--errors", "E.npy", "-o", "out.npz"]
    subprocess.run(words, cwd=tmp_path, check=True, capture_output=True)
    theirs, mine = np.load(tmp_path / "out.npz"), ps.decompose(matrices, errors)
    assert set(mine) == set(theirs)
    for name, values in mine.items():
        assert values.dtype == dtype
        np.testing.assert_array_equal(values, theirs[name], err_msg=name)


def layouts() -> dict[str, Any]:
    read_only = MATRICES.copy()
    read_only.flags.writeable = False
    wide = np.zeros((N, 4, 8))
    wide[..., ::2] = MATRICES
    return {
        "read-only": read_only,
        "fortran": np.asfortranarray(MATRICES),
        "strided": wide[..., ::2],
        "reversed": MATRICES[::-1].copy()[::-1],
        "big-endian": MATRICES.astype(">f8"),
        "list": MATRICES.tolist(),
        "unaligned": np.frombuffer(b"x" + MATRICES.tobytes(), np.uint8)[1:].view(np.float64).reshape(MATRICES.shape),
    }


@pytest.mark.parametrize("layout", layouts())
def test_layouts(layout: str) -> None:
    given = layouts()[layout]
    kept = np.array(given)
    for name, values in ps.decompose(given).items():
        np.testing.assert_array_equal(values, ps.decompose(MATRICES)[name], err_msg=name)
    np.testing.assert_array_equal(np.array(given), kept)


def test_shapes_and_dtypes() -> None:
    assert ps.decompose(np.eye(4))["retardance"].shape == ()
    assert ps.decompose(np.eye(4, dtype=int))["m_r"].dtype == np.float64
    assert ps.decompose(np.eye(4, dtype=np.float16))["m_r"].dtype == np.float32
    assert ps.decompose(np.zeros((0, 4, 4)))["retardance_axis"].shape == (0, 3)
    assert np.isnan(ps.decompose(np.full((2, 4, 4), np.nan))["retardance"]).all()
    assert np.isnan(ps.decompose(np.zeros((4, 4)))["retardance"])
    assert list(ps.decompose(np.eye(4), only=["entropy"])) == ["entropy"]
    mixed = ps.decompose(MATRICES.astype(np.float32), np.full(MATRICES.shape, 1e-3))
    assert mixed["retardance_error"].dtype == np.float32


@pytest.mark.parametrize(
    ("given", "keys"),
    [
        (np.zeros((4, 3)), {}),
        (np.zeros(16), {}),
        (np.eye(4, dtype=complex), {}),
        (np.array([["a"] * 4] * 4), {}),
        (None, {}),
        (np.eye(4), {"only": ["none"]}),
        (np.eye(4), {"std_error": np.zeros((2, 4, 4))}),
        (np.eye(4), {"std_error": -np.ones((4, 4))}),
    ],
)
def test_wrong_matrices(given: Any, keys: dict[str, Any]) -> None:
    with pytest.raises(ps.InputError):
        ps.decompose(given, **keys)


@pytest.mark.parametrize(("name", "captures", "array"), [("drr", 36, False), ("drr", 9, True), ("lc", 16, False)])
def test_captures_equal_the_command(tmp_path: Path, name: str, captures: int, array: bool) -> None:
    scheme = getattr(ps.Scheme, name)(captures, polarizer_array=array)
    (tmp_path / "mine.toml").write_text(scheme.to_toml())
    np.save(tmp_path / "M.npy", MATRICES.reshape(-1, 2, 4, 4))

    def run(*words: str) -> None:
        subprocess.run([command(), *words], cwd=tmp_path, check=True, capture_output=True)

    sensor = ["--sensor", "polarizer-array"] if array else []
    run("scheme", name, "-k", str(captures), *sensor, "-o", "theirs.toml")
    assert (tmp_path / "theirs.toml").read_text() == scheme.to_toml()
    run("scheme", "matrix", "theirs.toml", "-o", "A.npy")
    # Files contain degrees, so a scheme that is written and read again differs by rounding errors.
    np.testing.assert_allclose(np.load(tmp_path / "A.npy"), ps.design_matrix(scheme), atol=1e-14)
    scheme = ps.Scheme.load(tmp_path / "theirs.toml")
    np.testing.assert_array_equal(np.load(tmp_path / "A.npy"), ps.design_matrix(scheme))
    nm = [450.0, 660.0]
    run("capture", "M.npy", "--scheme", "theirs.toml", "--wavelengths", "450,660", "--noise", "1e-3", "--seed", "4", "-o", "I.npy")
    intensities = ps.simulate(MATRICES.reshape(-1, 2, 4, 4), scheme, wavelengths_nm=nm, noise=1e-3, seed=4)
    np.testing.assert_array_equal(np.load(tmp_path / "I.npy"), intensities)
    words = ["--noise", "1e-3", "--errors", "E.npy", "--wavelengths", "450,660"]
    run("reconstruct", "I.npy", "--scheme", "theirs.toml", *words, "-o", "R.npy")
    found, spread = ps.reconstruct(intensities, scheme, wavelengths_nm=nm, noise=1e-3, errors=True)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(np.load(tmp_path / "R.npy"), found)
    np.testing.assert_array_equal(np.load(tmp_path / "E.npy"), spread)
    # The tolerance is 5 standard errors of a mean of N × 16 squared normal deviates. The errors of one matrix may be fully
    # correlated, so the count is N instead of 16 N.
    z = (found.reshape(-1, 16) - MATRICES.reshape(-1, 16)) / spread.reshape(-1, 16)
    assert abs((z**2).mean() - 1) < 5 * np.sqrt(2 / len(z))


def test_captures_are_products_with_the_design_matrix() -> None:
    scheme = ps.Scheme.drr(36)
    a = ps.design_matrix(scheme)
    assert a.shape == (36, 16)
    np.testing.assert_allclose(ps.simulate(MATRICES, scheme), a @ MATRICES.reshape(-1, 16).T, atol=1e-6)
    quality = scheme.quality()
    assert quality["rank"] == 16
    np.testing.assert_allclose(quality["condition"], np.linalg.cond(a), rtol=1e-9)
    np.testing.assert_allclose(quality["error_variance"], np.trace(np.linalg.inv(a.T @ a)), rtol=1e-9)
    exact = ps.reconstruct((a @ MATRICES.reshape(-1, 16).T), scheme)
    np.testing.assert_allclose(exact, MATRICES, atol=1e-12)
    assert (scheme.captures, scheme.channels) == (36, 1) and "36" in repr(scheme)


def test_reconstruct_layouts_and_weights() -> None:
    scheme = ps.Scheme.drr(25)
    intensities = ps.simulate(MATRICES.reshape(20, 25, 4, 4), scheme, noise=1e-3)
    found = ps.reconstruct(intensities, scheme)
    for other in (np.asfortranarray(intensities), intensities[:, ::-1].copy()[:, ::-1], intensities.astype(">f4")):
        np.testing.assert_array_equal(ps.reconstruct(other, scheme), found)
    same = ps.reconstruct(intensities, scheme, variance=np.full(intensities.shape, 1e-6))
    np.testing.assert_allclose(same, found, atol=1e-5)
    assert ps.reconstruct(intensities.astype(np.float64), scheme).dtype == np.float64


def test_wrong_captures() -> None:
    scheme = ps.Scheme.drr(25)
    for call in (
        lambda: ps.Scheme.drr(0),
        lambda: ps.Scheme.drr(10**7),
        lambda: ps.Scheme.from_toml("nonsense"),
        lambda: ps.Scheme.load("nowhere.toml"),
        lambda: ps.reconstruct(np.zeros((24, 3)), scheme),
        lambda: ps.reconstruct(np.zeros((25, 3)), scheme, variance=np.zeros((25, 4))),
        lambda: ps.reconstruct(np.zeros((25, 3)), scheme, wavelengths_nm=[450, 550]),
        lambda: ps.reconstruct(np.zeros((25, 3)), scheme, noise=-1.0),
        lambda: ps.reconstruct(np.zeros((9, 3)), ps.Scheme.drr(9)),
        lambda: ps.simulate(np.zeros((3, 4)), scheme),
        lambda: ps.simulate(np.eye(4), scheme, noise=float("nan")),
        lambda: ps.simulate(np.eye(4), scheme, wavelengths_nm=-1),
        lambda: ps.design_matrix(scheme, 550, incidence_deg=90),
    ):
        with pytest.raises(ps.InputError):
            call()


def _captures(rows: int = 3) -> tuple[Any, Any, Any]:
    """Return a scheme, realizable matrices, and their captures."""
    scheme = ps.Scheme.drr(36)
    matrices = retarder(np.linspace(0.1, 1.2, rows), np.linspace(0.3, 1.5, rows))
    return scheme, matrices, ps.simulate(matrices, scheme)


def test_masked_captures_are_left_out() -> None:
    scheme, matrices, captures = _captures()
    damaged = captures.copy()
    damaged[5, 1] = 1e9
    mask = np.zeros(captures.shape, bool)
    mask[5, 1] = True
    for given in (
        np.ma.array(damaged, mask=mask),
        np.ma.array(damaged.astype(np.float64), mask=mask),
        [np.ma.array(a, mask=m) for a, m in zip(damaged, mask, strict=True)],
    ):
        assert np.abs(ps.reconstruct(given, scheme) - matrices).max() < 1e-4
    weights = np.ma.array(np.ones_like(damaged), mask=mask)
    assert np.abs(ps.reconstruct(damaged, scheme, variance=weights) - matrices).max() < 1e-4
    # A mask without masked entries has no effect.
    same = ps.reconstruct(np.ma.array(captures, mask=False), scheme)
    assert (same == ps.reconstruct(captures, scheme)).all()
    # Negative control: the corrupted value is not masked.
    assert np.abs(ps.reconstruct(damaged, scheme) - matrices).max() > 1e3


def test_unsupported_masks_are_refused() -> None:
    scheme, matrices, _ = _captures()
    masked = np.ma.array(matrices, mask=matrices > 0.9)
    for work in (
        lambda: ps.decompose(masked),
        lambda: ps.decompose(matrices, masked),
        lambda: ps.simulate(masked, scheme),
        lambda: ps.decompose(list(masked)),
        lambda: ps.Scene.from_dict({}, images={"a.png": np.ma.array(np.zeros((2, 2)), mask=[[0, 1], [0, 0]])}),
        lambda: ps.Scene.from_dict({}, meshes={"a": (np.ma.array(np.zeros((3, 3)), mask=True), np.zeros((1, 3), int))}),
    ):
        with pytest.raises(ps.InputError, match="masked"):
            work()


def test_memory_layout_does_not_change_results() -> None:
    scheme, _, captures = _captures()
    want = ps.reconstruct(captures.astype(np.float64), scheme)
    wide = captures.astype(np.float64)
    padded = np.zeros((36, 6))
    padded[:, ::2] = wide
    for given in (wide.astype(">f8"), np.asfortranarray(wide), padded[:, ::2], wide[::-1][::-1], wide.tolist()):
        assert (ps.reconstruct(given, scheme) == want).all()
    counts = np.round(wide * 1000).astype(np.uint16)
    assert (ps.reconstruct(counts, scheme) == ps.reconstruct(counts.astype(np.float64), scheme)).all()
    assert np.abs(ps.reconstruct(captures.astype(np.float16), scheme) - want).max() < 0.01


def test_arrays_that_are_not_real_numbers_are_refused() -> None:
    scheme, _, captures = _captures()
    for given in (captures.astype(complex), captures.astype(object), captures.astype(str), [[1.0], [1.0, 2.0]]):
        with pytest.raises(ps.InputError, match="intensities"):
            ps.reconstruct(given, scheme)
    for image in (np.full((2, 2), 1000, np.uint16), np.full((2, 2), -1)):
        with pytest.raises(ps.InputError, match="image of dtype"):
            ps.Scene.from_dict({}, images={"a.png": image})


def test_named_arrays_are_aligned_by_their_names() -> None:
    xr = pytest.importorskip("xarray")
    import pysunstone.polarimetry as by_name

    scheme, matrices, captures = _captures()
    given = xr.DataArray(captures, dims=("capture", "x"), coords={"capture": np.arange(1, 37), "x": [0, 1, 2]})
    assert np.abs(ps.reconstruct(given, scheme) - matrices).max() < 1e-4
    with pytest.raises(ps.InputError, match="dimensions"):
        ps.reconstruct(given.T, scheme)
    m = xr.DataArray(matrices, dims=("x", "stokes_out", "stokes_in"))
    with pytest.raises(ps.InputError, match="dimensions"):
        ps.decompose(m.transpose("stokes_out", "stokes_in", "x"))

    variance = xr.full_like(given, 1.0)
    variance[5, 1] = 1e12
    damaged = given.copy()
    damaged[5, 1] = 50.0
    asked = (None, None, False, False)
    for turned, weights in (
        (damaged, variance),
        (damaged.isel(capture=slice(None, None, -1)), variance),
        (damaged, variance.isel(x=slice(None, None, -1))),
        (damaged.T, variance.isel(capture=slice(None, None, -1)).T),
    ):
        found = by_name.reconstructed(turned, scheme, weights, *asked)["mean"].transpose("x", ...)
        assert np.abs(found.values - matrices).max() < 1e-3
    with pytest.raises(ValueError, match="coordinate `x`"):
        by_name.reconstructed(damaged, scheme, variance.assign_coords(x=[0, 1, 7]), *asked)

"""Learned schemes: bounds, agreement with the command, priors, interruption."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pysunstone as ps
import rendered

SHORT: dict[str, Any] = {"starts": 4, "iterations": 200, "adam_steps": 0}


def run(*words: object) -> str:
    return subprocess.run([rendered.command(), *map(str, words)], capture_output=True, check=True, text=True).stdout


def materials(n: int, seed: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return depolarizers that rotate the polarization: these matrices span a space of low dimension."""
    rng = np.random.default_rng(seed)
    m = np.zeros((n, 4, 4))
    m[:, 0, 0] = 1
    d = rng.uniform(0.2, 0.9, (n, 3))
    for i in range(3):
        m[:, i + 1, i + 1] = d[:, 0] * [1, 0.9, 0.5][i]
    m[:, 0, 1] = m[:, 1, 0] = 0.1 * d[:, 1]
    return m * rng.uniform(0.5, 2, (n, 1, 1))


def test_learned_schemes_reach_the_bound() -> None:
    """No scheme of K captures of rank 16 has an error below 1600/K noise variances (440/K for a polarizer array)."""
    reported: list[tuple[int, int]] = []
    for captures, array in ((16, False), (20, False), (8, True)):
        found = ps.learn(captures, polarizer_array=array, seed=1, progress=lambda *n: reported.append(n), **SHORT)
        best = found.scheme.bound
        assert best * captures == pytest.approx(440 if array else 1600)
        assert 0.9999 < found.loss / 5e-4**2 / best < 1.02
        assert found.loss == pytest.approx(found.scheme.quality()["error_variance"] * 5e-4**2, rel=1e-6)
        assert found.rms == pytest.approx((found.loss / 16) ** 0.5) and found.loss_std_error == 0
        assert len(found.descents) == 5 and found.descents[0].name == "quasi-Newton from the template"
        for descent in found.descents:
            assert descent.history.min() == pytest.approx(descent.loss, rel=1e-12) and descent.history[0] > descent.loss
        assert found.loss <= min(d.loss for d in found.descents) * 1.000001
        assert reported[-1] == (5, 5)
    # Negative control: the error of a scheme that was not learned is far above the bound.
    assert ps.Scheme.drr(20).quality()["error_variance"] > 1.2 * ps.Scheme.drr(20).bound


def test_schemes_equal_the_command(tmp_path: Path) -> None:
    budget = ["--starts", 4, "--iterations", 60, "--adam-steps", 30, "--seed", 5, "--resolution", "9x7x11"]
    run("learn", "-k", 6, "--estimator", "prior", "--save-prior", tmp_path / "prior.toml", "-o", tmp_path / "s.toml", *budget)
    of = ps.Materials.stand_ins(resolution=(9, 7, 11))
    found = ps.learn(6, estimator="prior", materials=of, starts=4, iterations=60, adam_steps=30, seed=5)
    assert found.scheme.to_toml() == (tmp_path / "s.toml").read_text()
    assert found.loss > found.seen_loss > 0 and found.loss_std_error > 0
    prior = ps.Materials.load(tmp_path / "prior.toml").prior
    assert np.allclose(prior, of.prior, rtol=1e-12, atol=1e-15) and prior.shape == (16, 16)
    of.save(tmp_path / "again.toml", "stand-ins")
    assert (tmp_path / "again.toml").read_text() == (tmp_path / "prior.toml").read_text()
    # A scheme learned from a template also equals that of the command, and keeps the optics of the template.
    again = ps.learn(template=found.scheme, estimator="prior", materials=of, starts=0, iterations=20, adam_steps=0)
    assert again.seen_loss < found.seen_loss * 1.001 and again.scheme.captures == 6
    other = ps.learn(6, estimator="prior", materials=of, starts=4, iterations=60, adam_steps=30, seed=6)
    assert other.scheme.to_toml() != found.scheme.to_toml()


def test_error_with_a_prior_equals_the_learned_loss() -> None:
    """For matrices with known second moment, the mean squared error equals the learned loss within 5 standard errors."""
    sigma, truth = 2e-3, materials(4000, 3)
    of = ps.Materials.of_matrices(truth)
    t = truth / truth[:, :1, :1]
    assert np.allclose(of.prior, np.einsum("ni,nj->ij", t.reshape(-1, 16), t.reshape(-1, 16)) / len(t), atol=1e-12)
    found = ps.learn(5, estimator="prior", noise=sigma, materials=of, **SHORT)
    captured = ps.simulate(t, found.scheme, noise=sigma, seed=4)
    with_prior = ps.reconstruct(captured, found.scheme, prior=of.prior, noise=sigma)
    off = ((with_prior - t) ** 2).sum((-1, -2))
    error = off.std() / len(t) ** 0.5
    assert abs(off.mean() - found.loss) < 5 * error, (off.mean(), found.loss, error)
    # Negative control: minimum-norm matrices without a prior have large errors.
    with pytest.raises(ps.InputError, match="rank"):
        ps.reconstruct(captured, found.scheme, noise=sigma)
    hand = ps.simulate(t, ps.Scheme.qrpr(5), noise=sigma, seed=4)
    worse = ((ps.reconstruct(hand, ps.Scheme.qrpr(5), prior=of.prior, noise=sigma) - t) ** 2).sum((-1, -2)).mean()
    assert worse > off.mean() + 5 * error


def test_reconstruction_with_a_prior_equals_the_command(tmp_path: Path) -> None:
    truth = materials(300, 7)
    of = ps.Materials.of_matrices(truth)
    of.save(tmp_path / "p.toml")
    scheme = ps.Scheme.qrpr(8)
    (tmp_path / "s.toml").write_text(scheme.to_toml())
    captured = ps.simulate(truth, scheme, noise=1e-3, seed=2)
    np.save(tmp_path / "i.npy", captured)
    files = [tmp_path / "i.npy", "--scheme", tmp_path / "s.toml", "-o", tmp_path / "m.npy", "--errors", tmp_path / "e.npy"]
    run("reconstruct", *files, "--prior", tmp_path / "p.toml", "--noise", 1e-3)
    for prior in (of.prior, tmp_path / "p.toml"):
        found, errors = ps.reconstruct(captured, scheme, prior=prior, noise=1e-3, errors=True)
        assert np.array_equal(found, np.load(tmp_path / "m.npy")) and np.array_equal(errors, np.load(tmp_path / "e.npy"))


def test_ctrl_c_stops_learning() -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    began = time.monotonic()
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.4)
        with pytest.raises(KeyboardInterrupt):
            ps.learn(36, starts=100_000, iterations=10_000)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert time.monotonic() - began < 20

    def fail(done: int, _: int) -> None:
        if done >= 2:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        ps.learn(16, starts=1000, iterations=50, adam_steps=0, progress=fail)


def test_invalid_arguments_are_reported(tmp_path: Path) -> None:
    for call, words in (
        (lambda: ps.learn(), "captures, or a template"),
        (lambda: ps.learn(0), "learn 1 to 256"),
        (lambda: ps.learn(16, noise=0), "noise"),
        (lambda: ps.learn(16, angle_error_deg=91), "angle_error_deg"),
        (lambda: ps.learn(16, estimator="guess"), "least-squares, prior"),  # type: ignore[arg-type]
        (lambda: ps.learn(16, starts=10**6), "100000"),
        (lambda: ps.learn(16, wavelengths_nm=[]), "one wavelength"),
        (lambda: ps.learn(6, materials=np.eye(16) * -1), "negative eigenvalues"),
        (lambda: ps.learn(6, materials=np.triu(np.ones((16, 16)))), "symmetric"),
        (lambda: ps.learn(6, materials=np.zeros((3, 4, 4))), "none of them"),
        (lambda: ps.learn(6, materials=tmp_path / "none.toml"), "none.toml"),
        (lambda: ps.learn(6, materials=tmp_path), str(tmp_path)),
        (lambda: ps.reconstruct(np.ones((5, 3)), ps.Scheme.qrpr(5), prior=np.eye(16)), "noise"),
        (lambda: ps.reconstruct(np.ones((5, 3)), ps.Scheme.qrpr(5), prior=np.eye(4), noise=1.0), "16, 16"),
    ):
        with pytest.raises(ps.InputError, match=words):
            call()

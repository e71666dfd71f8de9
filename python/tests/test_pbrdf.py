"""BRDFs over arrays, against closed forms, the command and invariants. Negative controls must differ."""

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
from pysunstone import pbrdf

ROOT = Path(__file__).resolve().parents[2]
GOLD: dict[str, Any] = {"rough_conductor": {"n": [1.3831, 0.4242, 0.1399], "k": [1.9155, 2.4721, 3.7015], "alpha": 0.3}}
PLASTIC: dict[str, Any] = {"plastic": {"albedo": [0.1, 0.3, 0.6], "ior": 1.5, "alpha": 0.2}}
NM = [450.0, 550.0, 660.0]


def hemisphere(n: int, seed: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    w = np.random.default_rng(seed).normal(size=(n, 3))
    w[:, 2] = abs(w[:, 2]) + 0.05
    return w / np.linalg.norm(w, axis=-1, keepdims=True)


def fresnel(theta: Any, n: complex) -> tuple[Any, Any]:
    """Return the Fresnel amplitude coefficients for s and p. A coefficient is positive if the direction of E is unchanged at
    normal incidence.
    """
    cos, out = np.cos(theta), np.sqrt(n**2 - np.sin(theta) ** 2 + 0j)
    return (cos - out) / (cos + out), (n**2 * cos - out) / (n**2 * cos + out)


def mueller_of(s: Any, p: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the Mueller matrix of diagonal amplitudes, s first; the third and fourth axes follow the handedness of the outgoing
    light.
    """
    a, b = (abs(s) ** 2 + abs(p) ** 2) / 2, (abs(s) ** 2 - abs(p) ** 2) / 2
    c, d = (s * np.conj(p)).real, (s * np.conj(p)).imag
    zero = np.zeros_like(a)
    rows = [[a, b, zero, zero], [b, a, zero, zero], [zero, zero, c, d], [zero, zero, -d, c]]
    return np.moveaxis(np.array(rows, dtype=float), (0, 1), (-2, -1))


def test_a_lambertian_brdf_equals_albedo_over_pi() -> None:
    wi, wo = hemisphere(50, 1), hemisphere(50, 2)
    m = pbrdf.evaluate({"diffuse": {"albedo": 0.6}}, wi[:, None], wo[None])
    assert m.shape == (50, 50, 4, 4) and m.dtype == np.float32
    want = np.zeros((4, 4))
    want[0, 0] = 0.6 / np.pi
    assert np.allclose(m, want, atol=1e-7)
    # There is no reflection below the surface, and the lengths of direction vectors are irrelevant.
    assert not pbrdf.evaluate({"diffuse": {"albedo": 0.6}}, wi, wo * [1, 1, -1]).any()
    assert np.array_equal(pbrdf.evaluate(PLASTIC, 7.5 * wi, wo), pbrdf.evaluate(PLASTIC, wi, 0.3 * wo))


@pytest.mark.parametrize("index", [1.5, 0.4242 + 2.4721j])
def test_smooth_surfaces_follow_fresnel(index: complex) -> None:
    theta = np.linspace(0.0, 89.0, 90)
    metal = index.imag > 0
    of: dict[str, Any] = {"conductor": {"n": index.real, "k": index.imag}} if metal else {"dielectric": {"ior": index.real}}
    m, out = pbrdf.mirror(of, pbrdf.direction(theta, 40.0))
    assert np.allclose(out, pbrdf.direction(theta, 220.0), atol=1e-12)
    want = mueller_of(*fresnel(np.radians(theta), np.conj(index)))
    # Both frames have s along the same axis. Reflection at normal incidence exchanges right and left, also with the signs of
    # `fresnel`.
    assert np.allclose(m[:, :2, :2], want[:, :2, :2], atol=2e-6)
    assert np.allclose(abs(m[:, 2:, 2:]), abs(want[:, 2:, 2:]), atol=2e-6)
    assert m[0, 2, 2] < 0 and m[0, 3, 3] < 0
    # Negative control: a refractive index that is wrong by 1 %.
    other = mueller_of(*fresnel(np.radians(theta), 1.01 * np.conj(index)))
    assert not np.allclose(m[:, :2, :2], other[:, :2, :2], atol=2e-4)
    if not metal:
        t, through = pbrdf.refract(of, pbrdf.direction(theta, 40.0))
        assert np.allclose(m[:, 0, 0] + t[:, 0, 0], 1, atol=2e-5)
        assert np.allclose(np.hypot(through[:, 0], through[:, 1]) * index.real, np.sin(np.radians(theta)), atol=1e-6)
        inside, lost = pbrdf.refract(of, pbrdf.direction([170.0, 130.0]))
        assert inside[0, 0, 0] > 0.9 and not inside[1].any() and np.isnan(lost[1]).all()


@pytest.mark.parametrize("material", [GOLD, PLASTIC, {"rough_dielectric": {"ior": 1.5, "alpha": 0.4}}])
def test_brdfs_are_reciprocal_and_physical(material: dict[str, Any]) -> None:
    """For reversed light, M(i, o) = D M(o, i)ᵀ D. D = diag(1, 1, -1, 1), because horizontal axes are kept."""
    wi, wo = hemisphere(2000, 3), hemisphere(2000, 4)
    built = pbrdf.Material(material, wavelengths_nm=NM)
    m, back = built.evaluate(wi, wo), built.evaluate(wo, wi)
    d = np.diag([1, 1, -1, 1])
    largest = m[..., :1, :1].max()

    def off(reversed_: Any) -> float:
        return float(abs(m - d @ np.swapaxes(reversed_, -1, -2) @ d).max() / largest)

    assert m.shape == (2000, 3, 4, 4)
    assert off(back) < 2e-5
    # Cloude's coherency matrix has no negative eigenvalues, so physical Stokes vectors stay physical.
    pauli = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])
    basis = np.einsum("iab,jcd->ijacbd", pauli, pauli.conj()).reshape(4, 4, 4, 4)
    eigen = np.linalg.eigvalsh(np.einsum("...ij,ijab->...ab", m, basis) / 4)
    assert (eigen[..., 0] > -1e-5 * eigen[..., -1] - 1e-12).all()
    # Negative controls: an error in one element for one direction, and D is omitted.
    wrong = back.copy()
    at = np.unravel_index(m[..., 0, 0].argmax(), m.shape[:2])
    wrong[(*at, 0, 1)] += 1e-3 * largest
    assert off(wrong) > 1e-4
    assert np.linalg.eigvalsh(np.einsum("ij,ijab->ab", np.diag([1, 1.2, 0, 0]), basis) / 4)[0] < -1e-2


def test_values_equal_the_command(tmp_path: Path) -> None:
    wi, wo = [[40.0, 10.0], [70.0, 300.0], [5.0, 0.0]], [[20.0, 120.0], [60.0, 125.0], [30.0, 250.0]]
    (tmp_path / "m.toml").write_text(
        "[materials]\ngold.rough_conductor = { n = [1.3831, 0.4242, 0.1399], k = [1.9155, 2.4721, 3.7015], alpha = 0.3 }\n"
        "red.plastic = { albedo = [0.1, 0.3, 0.6], ior = 1.5, alpha = 0.2 }\nboth.blend = { a = \"gold\", b = \"red\", weight = 0.3 }\n"
    )
    rows = [",".join(map(str, [*a, *b])) for a, b in zip(wi, wo, strict=True)]
    (tmp_path / "d.csv").write_text("\n".join(rows))
    incoming, outgoing = (pbrdf.direction(*np.transpose(w)) for w in (wi, wo))
    for name in ("gold", "red", "both"):
        printed = json.loads(
            subprocess.run(
                [rendered.command(), "pbrdf", "eval", str(tmp_path / "m.toml"), "--name", name, "--directions", str(tmp_path / "d.csv")],
                capture_output=True,
                check=True,
                text=True,
            ).stdout
        )
        want = np.array([d["mueller"] for d in printed])
        found = pbrdf.evaluate(tmp_path / "m.toml", incoming, outgoing, name=name, wavelengths_nm=NM)
        assert np.allclose(found, want, rtol=1e-6, atol=1e-9 * want.max())
        assert np.allclose(pbrdf.frame(outgoing), [d["out"]["frame"] for d in printed], atol=1e-12)
    # A list of wavelengths of any length and order gives the same values as single wavelengths.
    nm = [660.0, 450.0, 500.0, 550.0, 601.5, 450.0]
    many = pbrdf.evaluate(GOLD, incoming, outgoing, wavelengths_nm=nm)
    each = [pbrdf.evaluate(GOLD, incoming, outgoing, wavelengths_nm=w) for w in nm]
    assert many.shape == (3, 6, 4, 4) and np.array_equal(many, np.stack(each, axis=1))
    assert not np.array_equal(many[:, 0], many[:, 1])


MODELS: dict[str, dict[str, Any]] = {
    "diffuse": {"diffuse": {"albedo": 0.5}},
    "metal": {"conductor": {"metal": "Au"}},
    "rough metal": {"rough_conductor": {"metal": "Ag", "alpha": 0.2}},
    "coated": {"coated_conductor": {"metal": "Ag", "films": [{"ior": "SiO", "thickness_nm": 85}]}},
    "glass": {"dielectric": {"ior": "N-BK7"}},
    "frosted": {"rough_dielectric": {"ior": 1.5, "alpha": 0.3}},
    "plastic": {"plastic": {"albedo": 0.4, "ior": 1.5, "alpha": 0.2}},
    "pane": {"thin_dielectric": {"ior": 1.5}},
    "polarizer": {"polarizer": {"angle_deg": 30}},
    "retarder": {"retarder": {"retardance_deg": 90, "angle_deg": 10}},
    "crystal": {"crystal": {"name": "calcite", "axis": [0, 0, 1]}},
    "null": {"null": {}},
    "blend": {"blend": {"a": "diffuse", "b": "rough metal", "weight": 0.3}},
    "sides": {"two_sided": {"front": "rough metal", "back": "diffuse"}},
    "depolarizing": {"partial_depolarizer": {"material": "rough metal", "fraction": 0.2}},
}
ROUGH = {"diffuse", "rough metal", "frosted", "plastic", "blend", "sides", "depolarizing"}
MIRRORS = {"metal", "coated", "glass", "pane", "crystal"}
TRANSPARENT = {"glass", "pane", "polarizer", "retarder", "crystal", "null"}


@pytest.mark.parametrize("name", MODELS)
def test_every_model_is_evaluated(name: str) -> None:
    """All values are finite, also for directions along the surface and the normal. Rough materials have BRDFs; smooth materials
    have lobes that conserve energy.
    """
    w = np.random.default_rng(8).normal(size=(2, 300, 3))
    w[0, :4] = [[1, 0, 0], [0, 0, 1], [0, 0, -1], [1e-300, 0, 1]]
    built = pbrdf.Material({"materials": MODELS}, name, wavelengths_nm=[450, 550])
    m = built.evaluate(*w)
    assert np.isfinite(m).all() and (m[..., 0, 0] >= 0).all() and m.any() == (name in ROUGH)
    assert built.evaluate(np.zeros((0, 3)), [0, 0, 1]).shape == (0, 2, 4, 4)
    powers = []
    for lobe, those in ((built.mirror, MIRRORS), (built.refract, TRANSPARENT)):
        if name in those:
            powers.append(lobe([0.3, 0.1, 0.9])[0][..., 0, 0])
        else:
            with pytest.raises(ps.InputError, match="specularly"):
                lobe([0.3, 0.1, 0.9])
    if name in ("glass", "pane", "crystal"):
        assert np.allclose(sum(powers), 1, atol=1e-5)
    elif name == "polarizer":
        assert np.allclose(powers, 0.5, atol=0.01)


def test_materials_of_scenes_and_tables_are_evaluated(tmp_path: Path) -> None:
    wi, wo = hemisphere(20, 5), hemisphere(20, 6)
    scene = ps.Scene.from_toml(scenes.TEXT)
    of_dict = pbrdf.evaluate({"rough_conductor": {**GOLD["rough_conductor"], "alpha": 0.2}}, wi, wo, wavelengths_nm=NM)
    assert np.array_equal(pbrdf.evaluate(scene, wi, wo, name="gold", wavelengths_nm=NM), of_dict)
    assert np.array_equal(pbrdf.eval(scene, wi, wo, name="gold"), of_dict[:, 1])
    subprocess.run(
        [rendered.command(), "pbrdf", "synth", "--resolution", "41x31x91", "--name", "like_gold", "-o", str(tmp_path)],
        capture_output=True,
        check=True,
    )
    (table,) = tmp_path.glob("*.pbsdf")
    measured = pbrdf.Material(table)
    m = measured.evaluate(pbrdf.direction(30.0), pbrdf.direction(30.0, 180.0))
    assert m[0, 0] > 0 and abs(m[0, 1]) < m[0, 0] and "measured" in repr(measured)


def test_invalid_arguments_are_reported(tmp_path: Path) -> None:
    up = [0.0, 0.0, 1.0]
    scene = ps.Scene.from_toml(scenes.TEXT)
    for call, words in (
        (lambda: pbrdf.evaluate({"difuse": {}}, up, up), "difuse"),
        (lambda: pbrdf.evaluate({"diffuse": {"albedo": 2.0}}, up, up), "albedo"),
        (lambda: pbrdf.evaluate({"diffuse": {"albedo": 0.5}}, [0.0, 0.0, 0.0], up), "incoming: some directions are zero"),
        (lambda: pbrdf.evaluate({"diffuse": {"albedo": 0.5}}, [0.0, 1.0], up), "incoming: the shape"),
        (lambda: pbrdf.evaluate({"diffuse": {"albedo": 0.5}}, up, up, wavelengths_nm=[]), "at least one wavelength"),
        (lambda: pbrdf.evaluate({"diffuse": {"albedo": 0.5}}, up, up, wavelengths_nm=-3.0), "wavelengths_nm"),
        (lambda: pbrdf.mirror({"diffuse": {"albedo": 0.5}}, up), "does not reflect specularly"),
        (lambda: pbrdf.evaluate(scene, up, up), "gold, wall"),
        (lambda: pbrdf.evaluate(scene, up, up, name="tin"), "unknown material `tin`"),
        (lambda: pbrdf.evaluate(scene, up, up, name="gold", wavelengths_nm=600.0), "550"),
        (lambda: pbrdf.evaluate(tmp_path / "none.toml", up, up), "none.toml"),
        (lambda: pbrdf.evaluate(tmp_path / "none.pbsdf", up, up), "none.pbsdf"),
        (lambda: pbrdf.evaluate(pbrdf.Material(GOLD), up, up, name="x"), "already built"),
    ):
        with pytest.raises(ps.InputError, match=words):
            call()

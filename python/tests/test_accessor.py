"""The accessor agrees with the command on the same store, up to rounding. Negative controls must differ."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

import rendered
from pysunstone.contraction import STATES, kernel, stokes_vector
from pysunstone.epipolar import lines
from pysunstone.stores import open_store
from rendered import differs, probed

#: Tolerances in units of the single-precision rounding error: sums in double precision that are rounded once, and results that
#: include errors, squares and roots.
ROUNDINGS = 4.0


def opened(name: str, chunks: Any = "auto") -> xr.Dataset:
    return open_store(rendered.store(), chunks).children[name].to_dataset()


def pattern(seed: int = 3) -> np.ndarray[Any, np.dtype[np.float32]]:
    return np.random.default_rng(seed).random((10, 12), dtype=np.float32)


def written(drive: Any, name: str) -> str:
    """Write a mask as an image for the command."""
    from matplotlib import image

    path = rendered.folder() / name
    image.imsave(path, drive, cmap="gray", vmin=0, vmax=1)
    return str(path)


def mask() -> np.ndarray[Any, np.dtype[np.bool_]]:
    return np.random.default_rng(5).random((10, 12)) < 0.4


@pytest.mark.parametrize("state", ["horizontal", "right", (2.0, 0.3, -0.4, 1.1), None])
@pytest.mark.parametrize("name", ["full", "binned", "some"])
@pytest.mark.filterwarnings("ignore:the pattern uses")
def test_contraction_equals_the_command(name: str, state: Any) -> None:
    """Contracts with a mask, a Stokes state, and both. The mask is black and white, so the transfer function is irrelevant."""
    lit = written(mask(), "mask.png")
    options = [] if state is None else ["--stokes", state if isinstance(state, str) else ",".join(map(str, state))]
    mean, error = probed(name, "--pattern", lit, *options)
    data = opened(name, chunks=None)
    for chunks in ("auto", None):
        result = opened(name, chunks).sunstone.probe(mask(), state)
        assert differs(result["mean"], mean) < ROUNDINGS
        assert differs(result["std_error"], error) < ROUNDINGS
    assert differs(data["mean"].sunstone.probe(mask(), state), mean) < ROUNDINGS
    # Negative controls: the brightest projector pixel is exchanged, or a Stokes vector is scaled by 1 + 2e-5.
    light = data["mean"].isel(stokes_out=0, stokes_in=0).sum(["y", "x", "wavelength"]).compute()
    most = light.isel(light.argmax(["v", "u"]))
    other = mask()
    at = int(most["v"]), int(most["u"])
    other[at] = ~other[at]
    assert differs(data.sunstone.probe(other, state)["mean"], mean) > 10 * ROUNDINGS
    if state is not None:
        wrong = stokes_vector(state).values * (1 + 2e-5, 1, 1, 1)
        assert differs(data.sunstone.probe(mask(), wrong)["mean"], mean) > ROUNDINGS


@pytest.mark.parametrize("name", ["timed", "flight"])
@pytest.mark.parametrize("pulse", [130.0, [1.0, 2.0, 0.5], 0.0])
def test_pulse_convolution_equals_the_command(name: str, pulse: Any) -> None:
    words = f"gaussian:{pulse}" if isinstance(pulse, float) else "samples:" + ",".join(map(str, pulse))
    mean, error = probed(name, "--pulse", words)
    data = opened(name)
    result = data.sunstone.probe(pulse=pulse)
    assert differs(result["mean"], mean) < ROUNDINGS
    assert differs(result["std_error"], error) < ROUNDINGS
    # No light is lost: the sum of the light in the bins, outside the bins, and moved out of the bins by the pulse is constant.
    total = (result["mean"].astype(float).sum("t") + result["shifted_out"] + result["overflow"]).values
    before = (data["mean"].astype(float).sum("t") + data["overflow"]).values
    assert differs(total, before) < 30 * ROUNDINGS
    assert result["t"].attrs["units"] == "ps"
    later = result["mean"].shift(t=1, fill_value=0)
    assert differs(later, mean) > 1000 * ROUNDINGS
    if pulse == 0.0:
        assert differs(result["mean"], data["mean"]) == 0


def test_combined_steps_and_sums_equal_the_command() -> None:
    mean, error = probed("timed", "--stokes", "minus45", "--pulse", "gaussian:200", "--sum", "x,wavelength")
    result = opened("timed").sunstone.probe(state="minus45", pulse=200, sum=["x", "wavelength"])
    assert differs(result["mean"], mean) < ROUNDINGS
    assert differs(result["std_error"], error) < ROUNDINGS
    mean, error = probed("full", "--sum", "y,x,v,u")
    data = opened("full")
    result = data.sunstone.probe(sum=["y", "x", "v", "u"])
    assert differs(result["mean"], mean) < ROUNDINGS
    assert differs(result["std_error"], error) < ROUNDINGS
    # Negative controls: errors are added in quadrature instead of linearly, and vice versa.
    assert differs(data.sunstone.probe(sum=["y", "x", "v", "u"], errors="independent")["std_error"], error) > 1000
    assert differs(data["std_error"].sum(["y", "x", "v", "u"]), error) > 1000


def test_independent_errors_match_errors_of_the_steady_slice() -> None:
    """Compare errors of sums over s' of rendered slices with the error of the steady slice, which is estimated directly."""
    full, steady = opened("full"), opened("steady")
    one = {"stokes_out": 0, "stokes_in": 0}
    truth = steady["std_error"].isel(one).values
    lit = truth > 0
    ratio = {}
    for errors in ("bound", "independent"):
        found = full.sunstone.probe(sum=["v", "u"], errors=errors)["std_error"].isel(one).values
        ratio[errors] = np.median(found[lit] / truth[lit])
    assert ratio["bound"] >= 1
    assert ratio["independent"] < ratio["bound"]
    assert 0.5 < ratio["independent"] < 2, ratio


def test_stacked_patterns_and_states_equal_single_ones() -> None:
    data = opened("full")
    patterns = np.stack([pattern(1), pattern(2)])
    states = np.array([STATES["left"], STATES["vertical"], STATES["unpolarized"]])
    both = data.sunstone.probe(patterns, states)
    assert both["mean"].dims[:2] == ("state", "pattern") or both["mean"].dims[:2] == ("pattern", "state")
    for k in range(2):
        for j in range(3):
            alone = data.sunstone.probe(patterns[k], states[j])
            for field in ("mean", "std_error"):
                assert differs(both[field].isel(pattern=k, state=j), alone[field]) < ROUNDINGS
    assert differs(both["mean"].isel(pattern=0, state=0), alone["mean"]) > 1000


def test_uniform_pattern_equals_the_steady_slice() -> None:
    """I = Σ T P holds up to rounding for stored slices, and I is the sum of epipolar and non-epipolar light."""
    full, steady = opened("full"), opened("steady")
    white = full.sunstone.probe(np.ones((10, 12)))
    assert differs(white["mean"], steady["mean"]) < 20
    near, far = full.sunstone.epipolar(1.5), full.sunstone.epipolar(1.5, inside=False)
    assert differs(near["mean"], opened("epipolar")["mean"]) < 20
    assert differs(far["mean"], opened("nonepipolar")["mean"]) < 20
    assert differs(full.sunstone.epipolar(1.6)["mean"], opened("epipolar")["mean"]) > 1000
    assert differs(white["mean"], near["mean"]) > 1000
    assert not isinstance(near["mean"].data, np.ndarray), "it is as lazy as the slice"
    assert near.equals(opened("full", None).sunstone.epipolar(1.5))
    bound = near["std_error"].values - opened("epipolar")["std_error"].values
    assert bound.min() > -1e-6 * near["std_error"].values.max()


def test_points_lie_on_their_epipolar_lines() -> None:
    """Any point that both devices see lies on the epipolar line of its camera pixel."""
    tree = open_store(rendered.store())
    camera, projector = tree.attrs["camera"], tree.attrs["projector"]

    def seen(device: Any, point: Any) -> Any:
        axes = np.array([device[k] for k in ("right", "down", "forward")])
        local = axes @ (np.asarray(point) - device["origin_m"])
        return local[:2] / local[2] * device["focal_px"] + device["principal_px"] - 0.5

    for point in ([0.1, 0.2, 0.3], [-0.6, 0.4, -1.0], [0.0, 0.0, 0.0]):
        x, y = seen(camera, point)
        u, v = seen(projector, point)
        a, b, c = lines(camera, projector, [y], [x])[0, 0]
        assert a**2 + b**2 == pytest.approx(1)
        assert abs(a * u + b * v + c) < 1e-4
        assert abs(a * (u + 1) + b * v + c) > 0.05


def test_invalid_requests_are_refused() -> None:
    tree = open_store(rendered.store())
    cases: list[tuple[Any, str]] = [
        (lambda: tree["steady"].ds.sunstone.epipolar(), "no axis `v`"),
        (lambda: tree["binned"].ds.sunstone.epipolar(), "bins of pixels"),
        (lambda: tree["steady"].ds.sunstone.probe(pattern()), "already summed over projector pixels"),
        (lambda: tree["full"].ds.sunstone.probe(np.ones((12, 10))), "the pattern has 10 × 12 pixels, but the projector has 12 × 10"),
        (lambda: tree["full"].ds.sunstone.probe(np.ones(12)), "is of shape"),
        (lambda: tree["full"].ds.sunstone.probe(state="sideways"), "unknown state `sideways`: choose from unpolarized"),
        (lambda: tree["full"].ds.sunstone.probe(state=[1, 1, 1, 0]), "is not physical"),
        (lambda: tree["flight"].ds.sunstone.probe(state="left"), "contains only intensity"),
        (lambda: tree["full"].ds.sunstone.probe(pulse=30), "does not resolve time"),
        (lambda: tree["timed"].ds.sunstone.probe(pulse=-1.0), "picoseconds, 0 or more"),
        (lambda: tree["timed"].ds.sunstone.probe(pulse=[0, 0]), "must be positive and finite"),
        (lambda: tree["full"].ds.isel(stokes_in=[0, 1]).sunstone.probe(state="left"), "`probe` first, then select"),
        (lambda: tree["full"].ds.sunstone.probe(sum=["t"]), "no axis `t`; the axes are y, x"),
        (lambda: tree["full"].ds.sunstone.degree_of_polarization(), "choose the light"),
        (lambda: tree["/"].ds.sunstone.probe(), "array `mean` is missing"),
        (lambda: tree["flight"].ds.sunstone.plot_mueller(), "no Mueller matrices"),
        (lambda: tree["full"].ds.sunstone.plot_mueller(), "an image has two axes"),
        (lambda: tree["full"].ds.sunstone.plot_profile(), "does not resolve time"),
        (lambda: tree["timed"].ds.sunstone.plot_profile(), "select or sum"),
    ]
    for call, words in cases:
        with pytest.raises(ValueError, match=words):
            call()
    distorted = {**tree.attrs["camera"], "distortion": {"k1": 0.1}}
    with pytest.raises(ValueError, match="lens of the camera distorts"):
        tree["full"].ds.sunstone.epipolar(camera=distorted)
    with pytest.warns(UserWarning, match=r"uses \d+ projector pixels that the slice does not keep"):
        tree["some"].ds.sunstone.probe(np.ones((10, 12)))


def test_degree_of_polarization_of_known_light() -> None:
    """The degree of polarization of known light is correct. The scatter of 20,000 noisy samples does not exceed the stated bound
    by more than 5 standard errors.
    """
    stokes = np.array([[2.0, 0.6, -0.8, 1.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    error = np.array([[0.01, 0.02, 0.01, 0.02]] * 3)
    data = xr.Dataset(
        {"mean": (("x", "stokes_out"), stokes), "std_error": (("x", "stokes_out"), error)}, coords={"stokes_out": range(4)}
    )
    for kind, degree in (("total", np.sqrt(2.0) / 2), ("linear", 0.5), ("circular", 0.5)):
        result = data.sunstone.degree_of_polarization(kind)
        assert result["mean"].values[0] == pytest.approx(degree, rel=1e-6)
        assert result["mean"].values[1] == 0 and np.isnan(result["mean"].values[2])
        drawn = stokes[0] + error[0] * np.random.default_rng(1).normal(size=(20000, 4))
        which = {"total": (1, 2, 3), "linear": (1, 2), "circular": (3,)}[kind]
        spread = (np.sqrt((drawn[:, which] ** 2).sum(1)) / drawn[:, 0]).std()
        bound = float(result["std_error"][0])
        assert spread < bound * (1 + 5 / np.sqrt(2 * 20000))
        assert bound < 3 * spread
        assert differs(data["mean"].sunstone.degree_of_polarization(kind)[:2], result["mean"][:2]) == 0
    light = opened("steady").sunstone.probe(state="horizontal").sunstone.degree_of_polarization("linear")
    assert 0 <= float(light["mean"].min()) and float(light["mean"].max()) < 1 + 1e-5


def test_tree_nodes_have_the_accessor() -> None:
    tree = open_store(rendered.store())
    ours = tree.children["timed"].sunstone.probe(state="left", pulse=80)
    assert ours.identical(opened("timed").sunstone.probe(state="left", pulse=80))


def test_kernel_is_a_gaussian_of_the_requested_width() -> None:
    weights = dict(kernel(100.0, 1.0))
    assert sum(weights.values()) == pytest.approx(1)
    assert weights[50] / weights[0] == pytest.approx(0.5)
    assert kernel(0.0, 25.0) == [(0, 1.0)]


def test_mueller_images_are_drawn_on_a_symmetric_scale() -> None:
    steady = opened("steady")
    figure = steady.sunstone.plot_mueller(wavelength=660, mask=None)
    panels = [panel for panel in figure.axes if panel.images and panel.get_title()]
    assert [p.get_title() for p in panels] == [f"M{i}{j}" for i in range(4) for j in range(4)]
    matrices = steady["mean"].sel(wavelength=660)
    for k, panel in enumerate(panels):
        i, j = divmod(k, 4)
        shown = panel.images[0]
        expected = matrices.isel(stokes_out=i, stokes_in=j).values.astype(float)
        if k:
            intensity = matrices.isel(stokes_out=0, stokes_in=0).values
            expected = expected / np.where(intensity > 0, intensity, np.nan)
            assert shown.get_clim() == (-1, 1) and shown.get_cmap().name == "RdBu_r"
        assert np.allclose(np.ma.filled(shown.get_array(), np.nan), expected, equal_nan=True, rtol=1e-6)
    # Negative control: rows and columns are exchanged.
    assert not np.allclose(panels[1].images[0].get_array(), panels[4].images[0].get_array(), equal_nan=True)
    figure = steady.sunstone.plot_mueller(normalized=False)
    limits = {panel.images[0].get_clim() for panel in figure.axes if panel.images and panel.get_title()}
    assert len(limits) == 1 and next(iter(limits))[0] == -next(iter(limits))[1]
    assert "550 nm" in figure.get_suptitle()
    figure.savefig(rendered.folder() / "mueller.png")


def test_mueller_images_mask_uncertain_elements_on_an_arctan_scale() -> None:
    steady = opened("steady")
    at = steady.isel(wavelength=1)
    mean, error = (at[name].transpose("stokes_out", "stokes_in", "y", "x").values.astype(float) for name in ("mean", "std_error"))
    figure = steady.sunstone.plot_mueller()
    panels = [panel for panel in figure.axes if panel.images and panel.get_title()]
    for k, panel in enumerate(panels[1:], 1):
        i, j = divmod(k, 4)
        shown = np.ma.getmaskarray(np.ma.masked_invalid(panel.images[0].get_array()))
        assert np.array_equal(shown, (np.abs(mean[i, j]) < 2 * error[i, j]) | ~(mean[0, 0] > 0))
        norm = panel.images[0].norm
        assert np.allclose(norm([-1, 0, 0.1, 1]), [0, 0.5, 0.5 + 0.5 * np.arctan(0.8) / np.arctan(8), 1])
    # Values have an effect: without the mask, fewer pixels are grey.
    grey = [np.isnan(np.ma.filled(p.images[0].get_array(), np.nan)).sum() for p in panels]
    plain = steady.sunstone.plot_mueller(mask=0)
    assert sum(grey) > sum(np.isnan(np.ma.filled(p.images[0].get_array(), np.nan)).sum() for p in plain.axes if p.get_title())
    assert "below 2 standard errors" in figure.get_suptitle() and "standard errors" not in plain.get_suptitle()
    bar = figure.axes[-1]
    assert bar.get_ylabel() == "Mij / M00, arctan scale"
    labels = {t.get_text().replace("\N{MINUS SIGN}", "-"): at for t, at in zip(bar.get_yticklabels(), bar.get_yticks(), strict=True)}
    assert list(labels) == ["-1", "-0.2", "-0.1", "-0.05", "0", "0.05", "0.1", "0.2", "1"]
    assert all(at == pytest.approx(float(label)) for label, at in labels.items())
    linear = steady.sunstone.plot_mueller(scale="linear")
    assert linear.axes[-1].get_ylabel() == "Mij / M00"
    assert steady.sunstone.plot_mueller(normalized=False).axes[-1].get_ylabel().startswith("Mij [")
    raw = steady.sunstone.plot_mueller(normalized=False, scale="arctan")
    assert "arctan scale" in raw.axes[-1].get_ylabel()
    for name, drawn in (("arctan.png", figure), ("raw.png", raw)):
        drawn.savefig(rendered.folder() / name)


def test_plots_refuse_wrong_options() -> None:
    steady, timed = opened("steady"), opened("timed").isel(y=0, x=0)
    cases = [
        (lambda: steady.sunstone.plot_mueller(wavelength=600), "wavelength 600 nm does not exist: choose from 450, 550, 660 nm"),
        (lambda: steady.sunstone.plot_mueller(wavelength=550.6), "choose from 450, 550, 660 nm"),
        (lambda: steady.sunstone.plot_mueller(wavelength=np.nan), "wavelength nan nm"),
        (lambda: steady.isel(wavelength=0).sunstone.plot_mueller(wavelength=550), "choose from 450 nm"),
        (lambda: timed.sunstone.plot_profile(wavelength=600), "choose from 450, 550, 660 nm"),
        (lambda: steady.sunstone.plot_mueller(scale="log"), "unknown scale `log`: choose from arctan, linear"),
        (lambda: steady.sunstone.plot_mueller(mask=-1), "positive number of standard errors"),
        (lambda: steady["mean"].sunstone.plot_mueller(mask=2), "mask requires standard errors"),
        (lambda: steady.sunstone.plot_mueller(std_error=steady["std_error"].isel(x=[0])), "std_error has the axes"),
    ]
    for call, words in cases:
        with pytest.raises(ValueError, match=words):
            call()
    for wavelength in (549.5, 550.5):
        assert "550 nm" in steady.sunstone.plot_mueller(wavelength=wavelength).get_suptitle()


def test_profiles_are_drawn_with_their_errors() -> None:
    timed = opened("timed").isel(y=0)
    timed = timed.isel(x=int(timed["mean"].isel(stokes_out=0, stokes_in=0).sum(["t", "wavelength"]).values.argmax()))
    ax = timed.sunstone.plot_profile(sigmas=2)
    assert len(ax.lines) == 3 and [t.get_text() for t in ax.get_legend().get_texts()][1] == "wavelength 550 nm"
    one = timed.isel(stokes_out=0, stokes_in=0, wavelength=1)
    assert np.array_equal(ax.lines[1].get_ydata(), one["mean"].values)
    band = ax.collections[1].get_paths()[0].vertices
    high = (one["mean"] + 2 * one["std_error"]).values
    assert band[:, 1].max() == pytest.approx(high.max(), rel=1e-6)
    assert band[:, 1].max() != pytest.approx(float(one["mean"].max()), rel=1e-3)
    assert ax.get_xlabel() == "travel time [ps]"
    assert len(timed["mean"].sunstone.plot_profile(wavelength=450).lines) == 1
    ax.figure.savefig(rendered.folder() / "profile.png")
    # Labels are within the figure, for short and for long names.
    long = timed["mean"].assign_attrs(long_name="light of one pixel of the camera and of all of the projector, over its irradiance at one metre")
    for drawn in (ax, long.sunstone.plot_profile()):
        drawn.figure.draw_without_rendering()
        label, page = drawn.yaxis.label.get_window_extent(), drawn.figure.bbox
        assert page.x0 <= label.x0 and page.y0 <= label.y0 and label.y1 <= page.y1
        assert "".join(drawn.get_ylabel().split()).endswith(f"[{''.join(timed['mean'].attrs['units'].split())}]")

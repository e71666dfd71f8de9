"""Displays in notebooks: short texts, HTML with images, and photographs that equal those of the command."""

from __future__ import annotations

import base64
import io
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import pysunstone as ps
import rendered
import scenes

image = pytest.importorskip("PIL.Image")


@pytest.fixture(scope="module")
def scene() -> ps.Scene:
    return ps.Scene.from_toml(scenes.TEXT)


@pytest.fixture(scope="module")
def slices(scene: ps.Scene) -> ps.Slices:
    return scene.render()


def test_texts_are_short(scene: ps.Scene, slices: ps.Slices) -> None:
    learned = ps.learn(16, starts=1, iterations=5, adam_steps=5)
    builder = ps.SceneBuilder("a").material("m", diffuse={"albedo": 0.5}).camera([0, 0, 1], [0, 0, 0])
    material = ps.pbrdf.Material({"diffuse": {"albedo": 0.5}})
    shown = [scene, slices, slices["time"], ps.layers(scene), ps.Scheme.drr(), learned, builder, material, ps.Materials.of_matrices(np.eye(4))]
    for value in shown:
        lines = repr(value).splitlines()
        assert len(lines) <= 20 and max(map(len, lines)) <= 200 and " object at 0x" not in repr(value), repr(value)
    assert repr(slices["time"]) == (
        "<pysunstone.Slice 'time', y 16 x x 24 x t 40 x wavelength 3, arrays mean, std_error, overflow, overflow_std_error, total_std_error>"
    )
    assert repr(slices).splitlines()[0] == "<pysunstone.Slices, 2 slices"
    many = ps.Slices({str(k): slices["time"] for k in range(100)})
    assert len(repr(many).splitlines()) <= 20 and "and 88 more" in repr(many)
    assert repr(builder) == "<pysunstone.SceneBuilder, name, 1 materials, camera>"


def pictures(html: str) -> list[npt.NDArray[np.uint8]]:
    return [np.asarray(image.open(io.BytesIO(base64.b64decode(code)))) for code in re.findall(r"base64,([^\"]+)\"", html)]


def test_html_has_images_and_tables(scene: ps.Scene, slices: ps.Slices) -> None:
    (photo,) = pictures(slices["mueller"]._repr_html_())
    assert np.array_equal(photo, slices["mueller"].to_rgb())
    assert len(pictures(slices._repr_html_())) == 2
    html = scene._repr_html_()
    (sketch,) = pictures(html)
    # The gold ball in the middle is seen in front of the wall.
    assert sketch.shape == (16, 24, 3) and sketch[8, 12].max() > 50
    for part in ("24 x 16 pixels", "gold, wall", "mueller, time", "projector"):
        assert part in html, part
    (matrix,) = pictures(ps.Scheme.drr(36)._repr_html_())
    assert matrix.shape == (36, 16, 3)
    # Every element of the first column is 1/4, the largest magnitude: red.
    assert (matrix[:, 0] == [255, 0, 0]).all()
    gold = ps.pbrdf.Material({"rough_conductor": {"metal": "Au", "alpha": 0.2}}, wavelengths_nm=[450, 550, 660])
    (ball,) = pictures(gold._repr_html_())
    lit = ball.reshape(-1, 3).astype(int)
    lit = lit[lit.max(-1) < 255]
    # Gold reflects red more than blue.
    assert (lit[:, 0] >= lit[:, 2]).all() and (lit[:, 0] > lit[:, 2]).any()
    glass = ps.pbrdf.Material({"dielectric": {"ior": 1.5}})._repr_html_()
    assert "0.04" in glass


def test_titles_are_escaped(slices: ps.Slices) -> None:
    one = slices["time"]
    named = ps.Slice("<b>&", one.dims, one.coords, one.arrays, one.array_dims, one.attrs, one.coord_attrs)
    assert "<b>&" not in named._repr_html_().replace("<div><b>", "") and "&lt;b&gt;&amp;" in named._repr_html_()


def test_photographs_equal_those_of_the_command(tmp_path: Path) -> None:
    """Compare the pixels of `sunstone figure` with `to_rgb`, also of a store, and with two wavelengths."""
    text = scenes.TEXT + '[[figures]]\nname = "photo"\nview.photo = { slice = "mueller" }\n'
    (tmp_path / "scene.toml").write_text(text)
    scene = ps.Scene.load(tmp_path / "scene.toml")
    scene.render(tmp_path / "a.zarr")
    subprocess.run([rendered.command(), "figure", "a.zarr", "-o", "figures"], cwd=tmp_path, check=True)
    page = np.asarray(image.open(tmp_path / "figures/photo.png").convert("RGB"))
    mine = scene.render()["mueller"].to_rgb()
    stored = ps.open_store(tmp_path / "a.zarr")["mueller"].sunstone.to_rgb()
    assert np.array_equal(mine, stored)
    # Every colour of the photograph is in the figure, whose pixels are enlarged.
    colours = {tuple(c) for c in page.reshape(-1, 3)}
    assert all(tuple(c) in colours for c in mine.reshape(-1, 3))
    # Negative control: blue first is not in the figure.
    assert not all(tuple(c) in colours for c in mine[..., ::-1].reshape(-1, 3))
    linear = scene.render()["mueller"].to_rgb(linear=True)
    mean = scene.render()["mueller"]["mean"][:, :, 0, 0]
    assert linear.dtype == np.float32 and np.allclose(linear, mean[..., ::-1])


def test_slices_without_pixels_have_no_photograph(slices: ps.Slices) -> None:
    one = slices["time"]
    profile = ps.Slice("p", one.dims[2:], one.coords, {"mean": one["mean"][8, 12]}, {}, one.attrs, one.coord_attrs)
    with pytest.raises(ValueError, match="a photograph needs y and x"):
        profile.to_rgb()
    assert pictures(profile._repr_html_()) == []


def test_plots_follow_the_axes(slices: ps.Slices) -> None:
    pytest.importorskip("matplotlib")
    assert len(slices["mueller"].plot().axes) == 17
    photo: Any = slices["time"].plot()
    assert np.array_equal(photo.axes[0].images[0].get_array(), slices["time"].to_rgb())
    rows = slices["time"].to_xarray().sum("y", keep_attrs=True).isel(x=12)
    axes = rows.sunstone.plot()
    assert np.allclose(axes.lines[0].get_ydata(), rows["mean"].isel(wavelength=0))


def test_to_xarray_has_the_accessor() -> None:
    """In a fresh process, because other tests import the accessor."""
    code = f"import pysunstone as ps; s = ps.Scene.from_toml({scenes.TEXT!r}); print(s.render(spp=2)['mueller'].to_xarray().sunstone)"
    import sys

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "SunstoneDataset" in done.stdout, done.stderr


def test_unknown_names_list_the_known_ones(slices: ps.Slices, scene: ps.Scene) -> None:
    with pytest.raises(KeyError) as fault:
        slices["tme"]
    assert str(fault.value) == "the render has no slice `tme`; available: mueller, time"
    with pytest.raises(KeyError, match="slice `time` has no array `sum`; available: mean"):
        slices["time"]["sum"]
    with pytest.raises(KeyError, match="there is no layer `normal`; available: depth"):
        ps.layers(scene)["normal"]
    assert "tme" not in slices and slices.get("tme") is None

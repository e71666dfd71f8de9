"""Layers, alone and in data sets, and warnings about probable mistakes."""

from __future__ import annotations

import contextlib
import os
import subprocess
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pysunstone as ps
import rendered
import scenes
from pysunstone.dataset import DatasetError, make, manifest, open_dataset


def varied() -> ps.Scene:
    return ps.Scene.from_dict(scenes.document(vary={"size": {"path": "objects.0.shape.sphere.radius", "values": [0.3, 0.5, 0.7]}}))


def tile(height: float) -> ps.Scene:
    """Return a scene with a mesh from NumPy: a triangle at a height."""
    vertices = np.array([[-2, -2, height], [2, -2, height], [0, 2, height]])
    document = scenes.document(objects=[{"shape": {"ply": {"file": "tile"}}, "material": "wall", "name": "tile"}])
    return ps.Scene.from_dict(document, meshes={"tile": (vertices, np.array([[0, 1, 2]]))})


def test_layers_equal_those_of_the_command(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(scenes.TEXT)
    subprocess.run([rendered.command(), "layers", "scene.toml", "-o", "l.npz"], cwd=tmp_path, check=True)
    stored, found = np.load(tmp_path / "l.npz"), ps.layers(ps.Scene.load(tmp_path / "scene.toml"))
    for name, values in found.items():
        assert np.array_equal(values, stored[name], equal_nan=values.dtype.kind == "f"), name
    assert list(stored["material_names"]) == found.labels["material"]
    data = found.to_xarray()
    assert data["shading_normal"].dims == ("y", "x", "vector") and data["depth"].attrs["units"] == "m"
    # Closed forms: the wall is at z = -1, and the ball of radius 0.6 is around the origin.
    wall, edge = found["material"] == found.labels["material"].index("wall"), found["coverage"] < 1
    assert np.allclose(found["position"][wall, 2], -1, atol=1e-6)
    radius = np.linalg.norm(found["position"][~wall & ~edge], axis=-1)
    assert np.all(radius < 0.6) and np.median(radius) > 0.59
    with pytest.raises(ps.InputError, match="rays: expected a whole number from 1 to 64, got 0"):
        ps.layers(ps.Scene.from_toml(scenes.TEXT), rays=0)


def test_variants_of_scenes_in_code() -> None:
    scene = varied()
    assert scene.variant(1).text != scene.variant(2).text and scene.variant(2).variant(1).sha256 == scene.variant(1).sha256
    near = [float(np.nanmin(ps.layers(scene.variant(k), rays=8)["depth"])) for k in range(3)]
    assert near[0] - near[2] == pytest.approx(0.4, abs=0.02)
    with pytest.raises(ps.InputError, match="the scene has 3 variants"):
        scene.variant(3)
    with pytest.raises(ps.InputError, match=r"no \[vary\] table"):
        tile(0.0).variant(0)


def test_data_sets_of_scenes_and_functions_have_labels(tmp_path: Path) -> None:
    scene = varied()
    options: dict[str, Any] = {"slices": ["mueller"], "layers": ["depth", "shading_normal", "material"], "spp": 2}
    of_scene = open_dataset(make(scene, tmp_path / "scene.zarr", 3, **options))
    of_function = open_dataset(make(lambda k: (tile(-0.1 * k), {"height_m": -0.1 * k}), tmp_path / "function.zarr", 20, **options))
    for data, one in ((of_scene, scene.variant), (of_function, lambda k: tile(-0.1 * k))):
        for k in range(data["layers"].sizes["sample"]):
            expected, render = ps.layers(one(k)), one(k).render(spp=2, seed=k)["mueller"]
            for name in options["layers"]:
                assert np.array_equal(data["layers"][name][k], expected[name], equal_nan=expected[name].dtype.kind == "f")
            assert np.array_equal(data["mueller/mean"][k], render["mean"])
            assert data["layers/material"].attrs["labels"] == expected.labels["material"]
        # Negative control: the depth of another sample differs.
        assert not np.array_equal(data["layers/depth"][0], data["layers/depth"][2], equal_nan=True)
    assert np.allclose(of_function["layers/height_m"], -0.1 * np.arange(20)) and of_scene["layers/size"].values.tolist() == [0.3, 0.5, 0.7]
    assert of_scene["layers/depth"].attrs["units"] == "m"
    # The call is repeated without effect, and refused for another function.
    calls: list[int] = []

    def other(k: int) -> ps.Scene:
        calls.append(k)
        return tile(-0.5)

    with pytest.raises(DatasetError, match="scene '<lambda>', not 'other'"):
        make(other, tmp_path / "function.zarr", 20, **options)
    made = make(other, tmp_path / "other.zarr", 2, **options)
    before = manifest(made)
    assert make(other, made, 2, **options) == made and manifest(made) == before
    other_again = other

    def other(k: int) -> ps.Scene:
        return tile(-0.7)

    with pytest.raises(DatasetError, match="a different scene for variant 0"):
        make(other, made, 2, **options)
    assert other_again(0).sha256 != other(0).sha256


def test_the_example_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (rendered.ROOT / "docs/python-xarray.md").read_text()
    code = next(block for block in page.split("```python\n")[1:] if "tiles.zarr" in block).split("```")[0]
    lines = [line for line in code.splitlines() if line]
    assert len(lines) <= 10
    monkeypatch.chdir(tmp_path)
    exec(code, names := {"make": make})
    data = open_dataset("tiles.zarr")
    for k in range(20):
        expected = ps.layers(names["scene"](k)[0])
        for name in ("depth", "shading_normal"):
            assert np.array_equal(data["layers"][name][k], expected[name], equal_nan=True)
    # Closed form: the axis of the camera hits the tile at 3 m and 0.1 m more for each variant.
    assert np.allclose(data["layers/depth"][:, 24, 32], 3 + 0.1 * np.arange(20), rtol=1e-3)


def test_the_denoised_look_is_offered_on_a_terminal(tmp_path: Path) -> None:
    pty = pytest.importorskip("pty")
    (tmp_path / "scene.toml").write_text(scenes.TEXT + '[[figures]]\nname = "photo"\nview.photo = { slice = "mueller" }\n')
    command = [rendered.command(), "render", "scene.toml", "-o", "a.zarr", "--spp", "2", "--force"]
    main, side = pty.openpty()
    subprocess.run(command, cwd=tmp_path, stderr=side, check=True)
    os.close(side)
    text = b""
    with contextlib.suppress(OSError):
        while part := os.read(main, 4096):
            text += part
    offered = "sunstone denoise a.zarr -o a.denoised.zarr && sunstone figure a.denoised.zarr"
    assert offered in text.decode()
    words = offered.replace("sunstone", rendered.command())
    subprocess.run(words, cwd=tmp_path, shell=True, check=True)
    assert (tmp_path / "a.denoised.figures/photo.png").is_file()
    quiet = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "denoise" not in quiet.stderr


def test_mistakes_in_requests_are_refused(tmp_path: Path) -> None:
    out = tmp_path / "a.zarr"
    with pytest.raises(DatasetError, match="unknown layer `normal`; available: depth"):
        make(varied(), out, 1, slices=["mueller"], layers=["normal"], spp=1)
    with pytest.raises(DatasetError, match="scene: got a int; pass a scene file, a Scene, or a function"):
        make(3, out, 1, slices=["mueller"])  # type: ignore[arg-type]
    with pytest.raises(DatasetError, match="the function returned a str; return a Scene"):
        make(lambda k: "scene", tmp_path / "b.zarr", 1, slices=["mueller"])
    names = ["ball", "sphere"]
    document = scenes.document()

    def renamed(k: int) -> ps.Scene:
        return ps.Scene.from_dict({**document, "objects": [{**document["objects"][0], "name": names[k]}, document["objects"][1]]})

    with pytest.raises(DatasetError, match="layer `object`: variant 1 has other objects or materials"):
        make(renamed, tmp_path / "c.zarr", 2, slices=["mueller"], layers=["object"], spp=1)


def test_probable_mistakes_are_warnings() -> None:
    document = scenes.document()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        good = ps.Scene.from_dict(document).render(spp=1)
        ps.simulate(np.eye(4), ps.Scheme.drr())
    assert "cautions" not in good.summary
    late = [document["slices"][0], {"name": "time", "time": {"start_ps": 90000, "bin_ps": 500, "bins": 4}}]
    with pytest.warns(ps.SunstoneWarning, match="has time bins from 90000 to 92000 ps, but direct light arrives from") as caught:
        ps.Scene.from_dict({**document, "slices": late}).render(spp=1)
    # The warning names the line of the user.
    assert caught[0].filename == __file__
    inside = {**document["objects"][0], "shape": {"sphere": {"center": [0, 0.5, 3], "radius": 0.1}}, "name": "cover"}
    with pytest.warns(ps.SunstoneWarning, match="black: the camera is inside the object `cover`"):
        ps.Scene.from_dict({**document, "objects": [*document["objects"], inside]}).render(spp=1)
    image = {"wall": {"diffuse": {"albedo": {"image": "a"}}}, "gold": document["materials"]["gold"]}
    bare = {"shape": {"ply": {"file": "m"}}, "material": "wall", "name": "tile"}
    mesh = (np.array([[-2, -2, 0], [2, -2, 0], [0, 2, 0.0]]), np.array([[0, 1, 2]]))
    with pytest.warns(ps.SunstoneWarning, match="tile: the material `wall` has an image, but the mesh has no texture coordinates"):
        ps.Scene.from_dict({**document, "materials": image, "objects": [bare]}, meshes={"m": mesh}, images={"a": np.full((2, 2), 0.5)})
    with pytest.warns(ps.SunstoneWarning, match="has rank 2 of 16 and does not determine a Mueller matrix; use at least 16 captures"):
        ps.Scheme.drr(2)
    bright = np.diag([1, 0, 0, 0]) * np.array([1e-2, 1e-2, 1e-2, 1e4]).reshape(2, 2, 1, 1)
    with pytest.warns(ps.SunstoneWarning, match="25 % of the intensities are saturated, and NaN"):
        ps.simulate(bright, ps.Scheme.drr(), detector={"cmos": {"exposure_s": 1e-3}})


def test_errors_of_dicts_name_the_key() -> None:
    document = scenes.document()
    for changes, text in [
        ({"materials": {"wall": {"difuse": {}}}}, "scene in code: materials.wall.difuse: unknown name `difuse`, expected one of `diffuse`"),
        ({"render": {"spp": "many"}}, 'scene in code: render.spp: found the text "many", expected a whole number'),
        ({"camera": {**document["camera"], "resolution": [-1, 3]}}, "scene in code: camera.resolution[0]: found the number `-1`"),
        ({"slices": [{"name": "a"}, {"name": "b", "polarization": "muller"}]}, "scene in code: slices[1].polarization: unknown name"),
        ({"objects": [{"material": "wall"}]}, "scene in code: objects[0]: missing key `shape`"),
        ({"camera": None}, "scene in code: missing key `camera`"),
    ]:
        with pytest.raises(ps.InputError) as fault:
            ps.Scene.from_dict({**document, **changes})
        assert str(fault.value).startswith(text), str(fault.value)
        assert fault.value.line is None and fault.value.file is not None
    with pytest.raises(ps.InputError, match=r"^detector in a dict: cmos\.exposre_s: unknown key"):
        ps.simulate(np.eye(4).reshape(1, 1, 4, 4), ps.Scheme.drr(), detector={"cmos": {"exposre_s": 1}})
    with pytest.raises(ps.InputError, match=r"^materials in a dict: materials\.material\.rough_conductor\.metal: unknown optical"):
        ps.pbrdf.Material({"rough_conductor": {"metal": "Xx", "alpha": 0.2}})
    scene = ps.Scene.from_dict(document)
    for options, text in [
        ({"spp": -1}, "spp: expected a whole number from 1 to 1073741824, got -1"),
        ({"spp": 1.5}, "spp: expected a whole number, got 1.5"),
        ({"seed": -1}, "seed: expected a whole number of 0 or more, got -1"),
        ({"slices": "zz"}, "slices: unknown slice `zz`; available: mueller, time"),
    ]:
        with pytest.raises(ps.InputError) as fault:
            scene.render(**options)
        assert str(fault.value) == text
    for name in ("drr", "qrpr", "lc"):
        with pytest.raises(ps.InputError, match="captures: expected a whole number of 1 or more, got -1"):
            getattr(ps.Scheme, name)(-1)

"""Scenes and their renders, bit-identical to those of the command."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rendered import command, content
from scenes import TEXT, document

import pysunstone as ps


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the scene file and its store, rendered by the command."""
    path = tmp_path_factory.mktemp("scene")
    (path / "scene.toml").write_text(TEXT)
    words = [command(), "render", "scene.toml", "--seed", "3", "-o", "by_command.zarr", "--no-figures"]
    subprocess.run(words, cwd=path, check=True, capture_output=True)
    return path


def test_store_equals_that_of_the_command(folder: Path, tmp_path: Path) -> None:
    done = ps.Scene.load(folder / "scene.toml").render(tmp_path / "a.zarr", seed=3, threads=2)
    assert done["complete"] and done["tiles"] == 6
    mine, theirs = content(tmp_path / "a.zarr"), content(folder / "by_command.zarr")
    assert mine.keys() == theirs.keys()
    assert [name for name in mine if mine[name] != theirs[name]] == []


def test_arrays_equal_those_of_the_store(folder: Path) -> None:
    zarr = pytest.importorskip("zarr")
    found = ps.Scene.load(folder / "scene.toml").render(seed=3)
    store = zarr.open_group(str(folder / "by_command.zarr"), mode="r")
    assert list(found) == ["mueller", "time"]
    for name, one in found.items():
        group = store[name]
        assert one.dims == tuple(group["mean"].metadata.dimension_names)
        arrays = [f for f in ("mean", "std_error", "overflow", "overflow_std_error", "total_std_error") if f in group]
        assert list(one.arrays) == arrays
        for array in arrays:
            assert one.arrays[array].dtype == np.float32
            assert one.array_dims[array] == tuple(group[array].metadata.dimension_names)
            np.testing.assert_array_equal(one.arrays[array], group[array][...], err_msg=array)
        for axis, coords in one.coords.items():
            np.testing.assert_array_equal(coords, group[axis][...])
        assert one.attrs == {k: v for k, v in dict(group.attrs).items()}
    assert found["mueller"].arrays["mean"].any()
    np.testing.assert_array_equal(found.samples, store["samples"][...] if "samples" in store else found.samples)
    assert found.attrs["scene_sha256"] == dict(store.attrs)["scene_sha256"]
    assert found.summary["complete"]


def test_threads_and_input_forms_do_not_change_results(folder: Path) -> None:
    ways = [
        ps.Scene.load(folder / "scene.toml").render(spp=4, threads=1),
        ps.Scene.from_toml(TEXT).render(spp=4, threads=3),
        ps.Scene.from_dict(document()).render(spp=4),
        ps.Scene.load(folder / "scene.toml").render(spp=4, slices="mueller"),
    ]
    for other in ways[1:]:
        for name in other:
            for array in other[name].arrays:
                np.testing.assert_array_equal(other[name][array], ways[0][name][array])
    assert list(ways[3]) == ["mueller"]
    # Negative control: another seed gives a different result.
    assert (ps.Scene.from_toml(TEXT).render(spp=4, seed=8)["mueller"]["mean"] != ways[0]["mueller"]["mean"]).any()


def test_a_render_does_not_change_its_scene() -> None:
    scene = ps.Scene.from_toml(TEXT)
    scene.render(spp=2, seed=5, slices=["time"])
    assert (scene.spp, scene.seed, scene.slices) == (16, 0, ["mueller", "time"])
    assert (scene.name, scene.resolution, scene.wavelengths_nm) == ("ball", (24, 16), [450.0, 550.0, 660.0])
    assert "ball" in repr(scene)


def test_xarray() -> None:
    pytest.importorskip("xarray")
    data = ps.Scene.from_toml(TEXT).render(spp=2)["time"].to_xarray()
    assert data["mean"].dims == ("y", "x", "t", "wavelength")
    assert data["overflow"].dims == ("y", "x", "wavelength")
    assert data["t"].attrs["units"] == "ps"
    assert float(data["t"][0]) == 15250.0


QUAD = (np.array([[-2, -2, -1], [2, -2, -1], [2, 2, -1], [-2, 2, -1]], float), np.array([[0, 1, 2], [0, 2, 3]]))


def with_mesh(vertices: Any, faces: Any, **keys: Any) -> ps.Scene:
    builder = ps.SceneBuilder("ball").camera([0, 0.5, 3], [0, 0, 0], fov_x_deg=45, resolution=[24, 16])
    builder.projector([1, 1, 3], [0, 0, 0], fov_x_deg=50, resolution=np.array([16, 16]))
    builder.material("wall", diffuse={"albedo": np.float32(0.5)}).mesh("wall", vertices, faces, material="wall", **keys)
    return builder.slice("mueller", polarization="mueller").render(spp=np.int64(16), tile=8).build()


def test_a_mesh_renders_like_a_rectangle() -> None:
    mean = with_mesh(*QUAD).render()["mueller"]
    objects = [{"shape": {"rectangle": {"corner": [-2, -2, -1], "u": [4, 0, 0], "v": [0, 4, 0]}}, "material": "wall"}]
    plain = ps.Scene.from_dict(document(objects=objects, materials={"wall": {"diffuse": {"albedo": 0.5}}})).render()["mueller"]
    sigma = np.hypot(mean["std_error"], plain["std_error"])[..., 0, 0, :].mean()
    difference = abs(mean["mean"] - plain["mean"])[..., 0, 0, :].mean()
    assert plain["mean"][..., 0, 0, :].mean() > 20 * sigma
    assert difference < 5 * sigma


def test_float_images_are_linear_and_byte_images_are_encoded() -> None:
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)

    def light(pixels: Any, **keys: Any) -> Any:
        builder = ps.SceneBuilder("wall").camera([0, 0, 3], [0, 0, 0], fov_x_deg=45, resolution=[8, 8])
        builder.projector([1, 1, 3], [0, 0, 0], fov_x_deg=50, resolution=[8, 8]).image("paint", pixels)
        builder.material("wall", diffuse={"albedo": {"image": "paint", **keys}}).mesh("wall", *QUAD, uvs=uvs, material="wall")
        return builder.slice("all").render(spp=4, max_depth=2).build().render()["all"]["mean"]

    real = light(np.full((2, 2, 3), 0.5, np.float32))
    assert real.mean() > 0
    np.testing.assert_array_equal(real, light(np.full((2, 2, 3), 0.5, np.float32), raw=True))
    whole = light(np.full((2, 2, 3), 128, np.uint8))
    # IEC 61966-2-1.
    assert whole.mean() / real.mean() == pytest.approx(((128 / 255 + 0.055) / 1.055) ** 2.4 / 0.5, rel=1e-5)
    assert light(np.full((2, 2, 3), 128, np.uint8), raw=True).mean() / real.mean() == pytest.approx(2 * 128 / 255, rel=1e-5)


@pytest.mark.parametrize("change", [np.asfortranarray, lambda a: a[::-1][::-1], lambda a: a.tolist(), lambda a: a.astype(">f8")])
def test_layouts_of_meshes(change: Any) -> None:
    vertices = change(QUAD[0])
    if isinstance(vertices, np.ndarray):
        vertices.flags.writeable = False
    np.testing.assert_array_equal(
        with_mesh(vertices, QUAD[1].astype(np.uint8)).render(spp=1)["mueller"]["mean"],
        with_mesh(*QUAD).render(spp=1)["mueller"]["mean"],
    )


@pytest.mark.parametrize(
    ("vertices", "faces", "expected"),
    [
        (QUAD[0][:, :2], QUAD[1], "rows of 3"),
        (QUAD[0], QUAD[1] + 5, "mesh"),
        (QUAD[0], QUAD[1] - 1, "from 0"),
        (QUAD[0], QUAD[1].astype(float), "integers"),
        (QUAD[0] * np.nan, QUAD[1], "mesh"),
        (QUAD[0].astype(complex), QUAD[1], "real"),
        (QUAD[0], QUAD[1].ravel(), "rows of 3"),
    ],
)
def test_wrong_meshes(vertices: Any, faces: Any, expected: str) -> None:
    with pytest.raises(ps.InputError, match=expected):
        with_mesh(vertices, faces)


@pytest.mark.parametrize("pixels", [np.full((4, 4, 3), 128, np.uint8), np.full((4, 4), 128, np.uint8)])
def test_images_in_memory(pixels: Any) -> None:
    image = {"albedo": {"image": "wall.png"}}
    textured = document(materials={**document()["materials"], "wall": {"diffuse": image}})
    mean = ps.Scene.from_dict(textured, images={"wall.png": pixels}).render(spp=4)["mueller"]["mean"]
    assert np.isfinite(mean).all() and mean.any()
    with pytest.raises(ps.InputError, match="wall.png"):
        ps.Scene.from_dict(textured)


def test_errors_have_file_and_line() -> None:
    with pytest.raises(ps.InputError) as caught:
        ps.Scene.from_toml(TEXT.replace('material = "gold"', 'material = "silver"'))
    e = caught.value
    assert isinstance(e, ValueError)
    assert (e.line, e.file) == (1 + TEXT.splitlines().index('material = "gold"'), "./scene.toml")
    assert e.message and "silver" in e.message and e.fix
    with pytest.raises(ps.InputError, match=r"objects\[1\]"):
        bad = document()
        bad["objects"][1]["material"] = "silver"
        ps.Scene.from_dict(bad)
    with pytest.raises(ps.InputError) as caught:
        ps.Scene.load("nowhere.toml")
    assert caught.value.file == "nowhere.toml" and caught.value.line is None


@pytest.mark.parametrize(
    "bad", [{"name": object()}, {"render": {"spp": float("nan")}}, {"unknown": 1}, {"render": {"spp": -1}}, {"slices": [1]}]
)
def test_wrong_dicts(bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError):
        ps.Scene.from_dict(document(**bad))


def test_wrong_renders(folder: Path, tmp_path: Path) -> None:
    scene = ps.Scene.from_toml(TEXT)
    for wrong in ({"spp": 0}, {"slices": "none"}, {"threads": 0}, {"threads": 10**6}, {"replicates": 0}, {"resume": True}):
        with pytest.raises(ps.InputError):
            scene.render(**wrong)
    with pytest.raises((OverflowError, TypeError, ValueError)):
        scene.render(spp=-1)
    with pytest.raises(ps.InputError, match="by_command"):
        scene.render(folder / "by_command.zarr")
    with pytest.raises(ps.InputError):
        scene.render(tmp_path / "a.zarr", resume=True, force=True)
    nothing = ps.Scene.from_dict(document(slices=[]))
    with pytest.raises(ps.InputError, match="slices"):
        nothing.render()
    # The scene can still be rendered.
    assert scene.render(spp=1)["mueller"]["mean"].any()


def test_progress_is_reported_and_its_exceptions_end_the_render() -> None:
    scene = ps.Scene.from_toml(TEXT)
    reported: list[tuple[int, int]] = []
    scene.render(progress=lambda done, tiles: reported.append((done, tiles)))
    assert reported[-1] == (6, 6)

    def refuse(done: int, tiles: int) -> None:
        raise KeyError("enough")

    with pytest.raises(KeyError, match="enough"):
        scene.render(spp=20000, progress=refuse)
    scene.render(spp=1, progress=True)


def test_other_threads_run_during_a_render() -> None:
    scene = ps.Scene.from_toml(TEXT)
    ticks, done = [0], threading.Event()

    def tick() -> None:
        while not done.wait(0.01):
            ticks[0] += 1

    beside = threading.Thread(target=tick)
    beside.start()
    begun = time.monotonic()
    scene.render(spp=3000, slices="mueller")
    taken = time.monotonic() - begun
    done.set()
    beside.join()
    assert ticks[0] > 5 * taken, (ticks, taken)


def test_ctrl_c_ends_a_render_that_can_be_resumed(tmp_path: Path) -> None:
    words = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
import pysunstone as ps
from scenes import TEXT
scene = ps.Scene.from_toml(TEXT)
try:
    scene.render("a.zarr", spp=20000, threads=1, progress=lambda done, tiles: print(done, flush=True))
except KeyboardInterrupt:
    sys.exit(42)
"""
    job = subprocess.Popen([sys.executable, "-c", words], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    assert job.stdout is not None
    job.stdout.readline()
    job.send_signal(signal.SIGINT)
    begun = time.monotonic()
    assert job.wait(timeout=120) == 42
    assert time.monotonic() - begun < 60
    scene = ps.Scene.from_toml(TEXT)
    done = scene.render(tmp_path / "a.zarr", spp=20000, resume=True)
    assert done["complete"] and 0 < done["samples"] < 24 * 16 * 20000
    scene.render(tmp_path / "b.zarr", spp=20000)
    mine, theirs = content(tmp_path / "a.zarr"), content(tmp_path / "b.zarr")
    assert [name for name in theirs if name != "zarr.json" and mine.get(name) != theirs[name]] == []


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_renders_in_forked_processes() -> None:
    words = f"""
import multiprocessing, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
import pysunstone as ps
from scenes import TEXT
scene = ps.Scene.from_toml(TEXT)
here = scene.render(spp=1)["mueller"]["mean"]
def work(seed):
    return scene.render(spp=1, seed=seed)["mueller"]["mean"]
with multiprocessing.get_context("fork").Pool(2) as pool:
    there = pool.map(work, [0, 1])
assert (there[0] == here).all() and (there[1] != here).any()
"""
    subprocess.run([sys.executable, "-c", words], check=True, timeout=120)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_threaded_functions_work_in_forked_processes() -> None:
    words = f"""
import multiprocessing, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
import numpy as np
import pysunstone as ps
from scenes import TEXT
def work(seed):
    scene = ps.Scene.from_toml(TEXT)
    mean = scene.render(spp=1, seed=seed)["mueller"]["mean"]
    ps.decompose(np.broadcast_to(np.eye(4), (50, 4, 4)))
    scheme = ps.Scheme.drr(36)
    ps.reconstruct(ps.simulate(np.eye(4), scheme), scheme)
    try:
        ps.from_mitsuba("<scene version='3.0.0'/>")
    except ps.InputError:
        pass
    return mean, ps._native.command(["sunstone", "schema"])
here, _ = work(0)
with multiprocessing.get_context("fork").Pool(2) as pool:
    there = pool.map(work, [0, 1])
assert (there[0][0] == here).all() and (there[1][0] != here).any()
"""
    subprocess.run([sys.executable, "-c", words], check=True, timeout=120, stdout=subprocess.DEVNULL)


def test_module_command_equals_the_program(folder: Path, tmp_path: Path) -> None:
    def run(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, "-m", "pysunstone", *words], capture_output=True, text=True, cwd=folder)

    def run_program(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([command(), *words], capture_output=True, text=True, cwd=folder)

    for words in (["--version"], ["--help"], ["render", "--no-such"], ["info", "nowhere"], ["info", "by_command.zarr"], ["schema"]):
        mine, theirs = run(*words), run_program(*words)
        assert (mine.returncode, mine.stdout, mine.stderr) == (theirs.returncode, theirs.stdout, theirs.stderr), words


def test_import_is_quick_and_light() -> None:
    words = "import sys, time; t = time.perf_counter(); import pysunstone; d = time.perf_counter() - t; print(d, 'numpy' in sys.modules)"
    seconds, numpy = min(subprocess.check_output([sys.executable, "-c", words], text=True).split() for _ in range(3))
    assert float(seconds) < 0.3 and numpy == "False"

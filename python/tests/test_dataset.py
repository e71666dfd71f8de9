"""Data sets of variants: samples equal the renders, parameters equal the drawn values, and existing samples are not rendered
again.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import rendered
from pysunstone import Scene, dataset
from pysunstone.dataset import make, manifest, open_dataset
from pysunstone.images import MuellerImages
from pysunstone.stores import NotAStoreError, UnfinishedStoreError, open_store

SLICES = ["steady", "timed"]


def made(output: Path, variants: Any = 3, **options: Any) -> Path:
    options = {"slices": SLICES, "spp": 32, **options}
    return make(rendered.scene(varied=True), output, variants, **options)


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("data") / "three.zarr")


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int | None, bool]]:
    """Return a list that receives the variant of every render, and whether the render is resumed."""
    calls: list[tuple[int | None, bool]] = []
    render = Scene.render

    def counting(scene: Scene, *words: Any, **options: Any) -> Any:
        calls.append((scene._native.variant, options["resume"]))
        return render(scene, *words, **options)

    monkeypatch.setattr(Scene, "render", counting)
    return calls


def everything(path: Path) -> dict[str, bytes]:
    """Return all files with their bytes, without the render times."""
    found = {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file()}
    content = json.loads(found["dataset.json"])
    for entry in content["samples"]:
        entry["seconds"] = 0
    return {**found, "dataset.json": json.dumps(content).encode()}


def test_samples_and_parameters_equal_those_of_single_renders(three: Path, tmp_path: Path) -> None:
    tree = open_dataset(three)
    content = manifest(three)
    for k in range(3):
        store = tmp_path / f"{k}.zarr"
        options = ["--variant", k, "--seed", k, "--spp", 32, "--no-figures"]
        rendered.sunstone("render", rendered.scene(varied=True), "-o", store, *options)
        alone = open_store(store)
        values = alone.attrs["variant"]["values"]
        for name in SLICES:
            data, one = tree.children[name].to_dataset(), alone.children[name].to_dataset()
            for field in ("mean", "std_error"):
                assert np.array_equal(data[field].isel(sample=k), one[field]), f"{name}/{field} of {k}"
            # Negative control: the sample of another variant differs.
            assert not np.array_equal(data["mean"].isel(sample=(k + 1) % 3), one["mean"])
            for parameter in ("size", "roughness"):
                assert float(data[parameter][k]) == float(values[parameter])
            assert int(data["variant"][k]) == k and int(data["seed"][k]) == k
        assert content["samples"][k]["scene_sha256"] == alone.attrs["scene_sha256"]
    assert content["finished"] and len(content["samples"]) == 3
    steady = tree.children["steady"].to_dataset()
    assert steady["mean"].dims[0] == "sample" and steady["mean"].attrs["units"].startswith("W m-2")
    assert {"variant", "seed", "size", "roughness"} <= set(steady.coords)
    assert steady["size"].attrs["long_name"] == "objects.ball.shape.sphere.radius"
    assert tree.children["timed"]["t"].attrs["units"] == "ps"
    assert xr.open_datatree(three, engine="zarr").equals(tree)
    assert not three.with_name("three.zarr.parts").exists()


def test_existing_samples_are_not_rendered_again(three: Path, tmp_path: Path, counted: list[tuple[int | None, bool]]) -> None:
    output = tmp_path / "data.zarr"

    class Stop(Exception):
        pass

    def stop(done: int, of: int) -> None:
        assert of == 3
        if done == 2:
            raise Stop

    with pytest.raises(Stop):
        made(output, progress=stop)
    with pytest.raises(UnfinishedStoreError, match="2 samples exist"):
        open_dataset(output)
    partial = open_dataset(output, unfinished=True).children["steady"].to_dataset()
    assert partial.sizes["sample"] == 2 and partial["mean"].notnull().all()
    # The third variant is rendered but not stored, as if the process had been killed between the two steps.
    settings = {**manifest(output)["settings"]}
    dataset._rendered("scene", Scene.load(rendered.scene(varied=True), 2), {}, output, 2, settings, None)
    seen: list[int] = []
    made(output, progress=lambda done, of: seen.append(done))
    assert counted == [(0, False), (1, False), (2, False), (2, True)]
    assert seen == [1, 2, 3]
    assert everything(output) == everything(three)
    made(output)
    assert len(counted) == 4
    # A call with more variants renders only the additional ones.
    made(output, 5)
    assert len(counted) == 6
    assert everything(made(tmp_path / "five.zarr", 5)) == everything(output)


def test_a_killed_call_resumes(three: Path, tmp_path: Path) -> None:
    """The process and its render are killed repeatedly. The data set equals that of an undisturbed call."""
    output = tmp_path / "data.zarr"
    words = f"make({str(rendered.scene(varied=True))!r}, {str(output)!r}, 3, slices={SLICES!r}, spp=32)"
    rng, kills = np.random.default_rng(2), 0
    for _ in range(40):
        process = subprocess.Popen(
            [sys.executable, "-c", f"from pysunstone.dataset import make; print(1, flush=True); {words}"],
            stdout=subprocess.PIPE,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": str(Path(dataset.__file__).parents[1])},
        )
        assert process.stdout is not None and process.stdout.readline() == b"1\n"
        try:
            process.wait(rng.uniform(0.02, 0.35))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            kills += 1
            process.wait()
        process.stdout.close()
        if process.returncode == 0 or kills == 3:
            break
    # A temporary file such as a killed Zarr process leaves.
    (output / "steady").mkdir(exist_ok=True)
    (output / "steady" / f"zarr.{'0f' * 16}.partial").touch()
    made(output)
    assert kills > 0
    assert everything(output) == everything(three)


def test_only_one_process_writes_a_data_set(tmp_path: Path) -> None:
    output = tmp_path / "data.zarr"

    def other(done: int, of: int) -> None:
        with pytest.raises(dataset.DatasetError, match="another process writes"):
            made(output)

    made(output, 1, progress=other)
    assert len(manifest(output)["samples"]) == 1 and sorted(p.name for p in tmp_path.iterdir()) == ["data.zarr"]


def test_different_axes_are_refused(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(rendered.SCENE + '[vary.start]\npath = "slices.timed.time.start_ps"\nvalues = [18000, 18000, 19000]\n')
    options: dict[str, Any] = {"slices": ["timed"], "spp": 2}
    assert len(manifest(make(scene, tmp_path / "two.zarr", 2, **options))["samples"]) == 2
    with pytest.raises(dataset.DatasetError, match="axis `t` of slice `timed` is not the same in all variants"):
        make(scene, tmp_path / "three.zarr", 3, **options)


def test_inconsistent_requests_are_refused(three: Path, tmp_path: Path) -> None:
    with pytest.raises(dataset.DatasetError, match="was made with spp 32, not 16"):
        made(three, spp=16)
    with pytest.raises(dataset.DatasetError, match="all different"):
        made(tmp_path / "a.zarr", [1, 1])
    with pytest.raises(dataset.DatasetError, match="variant 0 of .* was not rendered: .*stedy"):
        made(tmp_path / "c.zarr", 1, slices=["stedy"])
    with pytest.raises(NotAStoreError, match=r"dataset\.json is missing"):
        made(rendered.store(), 1)
    with pytest.raises(NotAStoreError, match=r"dataset\.json is missing"):
        open_dataset(tmp_path / "none")
    with pytest.raises(dataset.DatasetError, match="no slice `full`; available slices: steady, timed"):
        MuellerImages(three, "full")
    with pytest.raises(dataset.DatasetError, match="no parameter `colour`; available parameters: roughness, size"):
        MuellerImages(three, "steady", parameters=["colour"])


def test_images_equal_the_samples(three: Path) -> None:
    steady = open_dataset(three, chunks=None).children["steady"].to_dataset()
    images = MuellerImages(three, "steady", parameters=["size", "roughness"])
    assert len(images) == 3 and images.dims == ["stokes_out", "stokes_in", "wavelength", "y", "x"]
    image, values = images[1]
    expected = steady["mean"].isel(sample=1).transpose(*images.dims)
    assert image.dtype == np.float32 and np.array_equal(image, expected)
    assert np.allclose(values, [steady["size"][1], steady["roughness"][1]])
    assert np.array_equal(images[-1][0], images[2][0]) and not np.array_equal(images[0][0], images[2][0])
    with pytest.raises(IndexError):
        images[3]
    one = MuellerImages(three, "steady", wavelength=660, normalized=True, transform=lambda m: m[:, :, ::2])
    assert one.dims == ["stokes_out", "stokes_in", "y", "x"]
    matrix = steady["mean"].isel(sample=1, wavelength=2).transpose(*one.dims).values[:, :, ::2].astype(float)
    over = np.where(matrix[0, 0] > 0, matrix / np.where(matrix[0, 0] > 0, matrix[0, 0], 1), 0)
    over[0, 0] = matrix[0, 0]
    assert np.allclose(one[1][0], over, rtol=1e-6)
    with pytest.raises(ValueError, match="wavelength 600 nm does not exist: choose from 450, 550, 660 nm"):
        MuellerImages(three, "steady", wavelength=600)
    assert np.array_equal(pickle.loads(pickle.dumps(images))[1][0], image)


def test_text_parameters_become_numbers_with_labels() -> None:
    samples = [{"variant": k, "seed": k, "values": {"metal": m, "place": [k, 2.0], "turn": k}} for k, m in enumerate(['"Au"', '"Ag"'])]
    found = dataset._coordinates(samples, {"turn": "objects.knot.transform.rotate_deg.1", "metal": "materials.a.metal"})
    assert found["metal"][0].tolist() == [1, 0] and found["metal"][2]["labels"] == ['"Ag"', '"Au"']
    assert found["place"][1] == ["sample", "place_1"] and found["place"][0].shape == (2, 2)
    assert found["turn"][2] == {"units": "degree", "long_name": "objects.knot.transform.rotate_deg.1"}


@pytest.mark.parametrize("workers", [0, 2])
def test_pytorch_streams_batches(three: Path, workers: int) -> None:
    data = pytest.importorskip("torch.utils.data")
    images = MuellerImages(three, "steady")
    loader = data.DataLoader(images, batch_size=2, num_workers=workers)
    batches = list(loader)
    assert [tuple(image.shape) for image, _ in batches] == [(2, 4, 4, 3, 16, 20), (1, 4, 4, 3, 16, 20)]
    assert batches[0][1].shape == (2, 2)
    assert np.array_equal(batches[1][0][0].numpy(), images[2][0])

"""Renders with Dask into an object store, by workers without a shared file system, are byte-identical to those of one process."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import distributed as dask
import numpy as np
import pytest
from clusters import Killer
from object_server import bucket, download, names
from rendered import SCENE, command, content, sunstone

from pysunstone import Scene, distributed
from pysunstone._files import pack
from pysunstone._units import Command, Unit
from pysunstone.distributed import Metrics, RenderError

__all__ = ["bucket"]

pytestmark = pytest.mark.skipif(importlib.util.find_spec("moto") is None, reason="needs moto[server]")

# Dask has no type annotations.
DASK: Any = dask

TILE = b"""ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property float s
property float t
element face 1
property list uchar int vertex_indices
end_header
-0.4 0.9 0 0 0
0.4 0.9 0 1 0
0.4 1.4 0 1 1
-0.4 1.4 0 0 1
4 0 1 2 3
"""

MORE = """
[[objects]]
name = "tile"
shape.ply.file = "../shapes/tile.ply"
material = "painted"
[materials.painted.diffuse]
albedo = { image = "images/paint.png" }
"""


# The other slices would only add objects: their kinds are tested in folders.
SLICES = {"full", "timed", "steady"}


def scene_in(folder: Path) -> Path:
    """Write the scene of the other tests with three slices and without a name. One of its files is in a folder above that of the scene."""
    from pysunstone import _native

    file = folder / "ball" / "scene.toml"
    head, *slices = SCENE.split("[[slices]]\n")
    kept = ["[[slices]]\n" + text for text in slices if text.split('"')[1] in SLICES]
    assert len(kept) == len(SLICES)
    head = head.replace('name = "ball"\nwavelengths', "wavelengths").replace("max_depth = 4", "max_depth = 4, tile = 8")
    # Four tiles.
    head = head.replace("resolution = [20, 16]", "resolution = [16, 16]")
    text = "".join([head, *kept, MORE])
    for path, made in (
        (folder / "shapes" / "tile.ply", TILE),
        (file.parent / "images" / "paint.png", _native.encode_image(np.arange(48, dtype=np.uint8).reshape(4, 4, 3) * 5)),
        (file, text.encode()),
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(made)
    return file


class Elsewhere(DASK.WorkerPlugin):  # type: ignore[misc]
    """Gives each worker a separate working folder."""

    name = "elsewhere"

    def setup(self, worker: Any) -> None:
        os.chdir(worker.local_directory)


@pytest.fixture(scope="module")
def cluster(bucket: str) -> Iterator[Any]:
    with pytest.MonkeyPatch.context() as patch:
        # Time for which the locks of killed workers stay valid.
        patch.setenv("SUNSTONE_LEASE_S", "2")
        with DASK.LocalCluster(n_workers=3, threads_per_worker=1, dashboard_address=None) as made:
            made.adapt(minimum=3, maximum=3)
            yield made


@pytest.fixture(scope="module")
def client(cluster: Any) -> Iterator[Any]:
    with DASK.Client(cluster) as made:
        made.register_plugin(Elsewhere())
        yield made


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the store of a single process."""
    folder = tmp_path_factory.mktemp("whole")
    sunstone("render", scene_in(folder), "--no-figures", "--threads", 1, "-o", folder / "whole.zarr")
    return folder / "whole.zarr"


def assert_same(a: Path, b: Path) -> None:
    one, other = content(a), content(b)
    assert sorted(one) == sorted(other) and len(one) > 50
    assert [name for name in one if one[name] != other[name]] == []


def test_killed_workers_do_not_change_the_output(
    bucket: str, cluster: Any, client: Any, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = scene_in(tmp_path / "mine")

    def pack_and_remove(scene: Scene) -> Any:
        # The workers cannot access the scene's files.
        packed = pack(scene)
        shutil.rmtree(tmp_path / "mine")
        return packed

    monkeypatch.setattr(distributed, "pack", pack_and_remove)
    address = f"{bucket}/killed.zarr"
    counts: list[tuple[int, int]] = []
    with Killer(cluster, 1.5) as killer:
        path = distributed.render(
            file, address, parts=4, client=client, command=command(), progress=lambda done, of: counts.append((done, of))
        )
    print(f"{killer.kills} workers killed")
    assert path == address and killer.kills >= 1
    assert counts == [(n, 4) for n in range(1, 5)]
    assert_same(whole, download(address, tmp_path / "there.zarr"))
    assert names(f"{address}.parts") == []
    # After the call, the workers have no files of the scene.
    left = client.run(lambda dask_worker: [name for name in os.listdir(dask_worker.local_directory) if name.startswith("sunstone-")])
    assert set(map(tuple, left.values())) == {()}


def test_finished_parts_are_reused(bucket: str, client: Any, whole: Path, tmp_path: Path) -> None:
    file = scene_in(tmp_path)
    address = f"{bucket}/again.zarr"
    reported: list[Metrics] = []

    class Enough(Exception):
        pass

    def stop(metrics: Metrics) -> None:
        reported.append(metrics)
        raise Enough

    with pytest.raises(Enough):
        distributed.render(file, address, parts=3, client=client, command=command(), report=stop)
    assert reported[0].samples > 0 and names(f"{address}.parts")
    later: list[Metrics] = []
    distributed.render(file, address, parts=3, client=client, command=command(), report=later.append)
    all_samples = 16 * 16 * 64
    assert later[-1].finished == 3 and later[-1].samples <= all_samples - reported[0].samples
    assert_same(whole, download(address, tmp_path / "there.zarr"))
    assert names(f"{address}.parts") == []
    with pytest.raises(FileExistsError, match="overwrite"):
        distributed.render(file, address, parts=3, client=client, command=command())
    distributed.render(file, address, spp=8, parts=2, client=client, command=command(), overwrite=True)
    assert json.loads((download(address, tmp_path / "over.zarr") / "zarr.json").read_text())["attributes"]["samples_per_pixel"] == 8


def test_duplicate_units_give_one_result(bucket: str, client: Any, tmp_path: Path) -> None:
    """Two workers make the same unit simultaneously: one waits for the other and then finds the finished result."""
    address = f"{bucket}/twice.zarr"
    words = ("render", str(scene_in(tmp_path)), "--no-figures", "--spp", "512", "--part", "1/2")
    unit = Unit(Command(command(), words), address, 1)
    made: list[Any] = []
    both = [threading.Thread(target=lambda: made.append(unit())) for _ in range(2)]
    for thread in both:
        thread.start()
    for thread in both:
        thread.join()
    assert sorted(m.samples > 0 for m in made) == [False, True]
    sunstone("verify", address)
    sunstone("remove", address)
    assert names(address) == []


def test_scenes_built_in_python_are_sent_to_workers(bucket: str, client: Any, tmp_path: Path) -> None:
    paint = np.linspace(0.1, 0.9, 48, dtype=np.float32).reshape(4, 4, 3)
    scene = Scene.from_dict(
        {
            "camera": {"pose": {"look_at": {"origin": [0, 0, 3], "target": [0, 0, 0]}}, "fov_x_deg": 40, "resolution": [16, 12]},
            "projector": {"pose": {"look_at": {"origin": [1, 0, 3], "target": [0, 0, 0]}}, "fov_x_deg": 40, "resolution": [8, 8]},
            "materials": {"paint": {"diffuse": {"albedo": {"image": "paint"}}}},
            "objects": [{"shape": {"ply": {"file": "tile"}}, "material": "paint"}],
            "slices": [{"name": "all", "polarization": "mueller"}],
            "render": {"spp": 32, "tile": 4},
        },
        folder=tmp_path,
        meshes={"tile": ([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]], None, [[0, 0], [1, 0], [0, 1]])},
        images={"paint": paint},
    )
    scene.render(tmp_path / "here.zarr", threads=1)
    one = content(tmp_path / "here.zarr")
    for place in (tmp_path / "many.zarr", f"{bucket}/many.zarr"):
        path = distributed.render(scene, place, parts=3, client=client, command=command())
        found = content(path if isinstance(path, Path) else download(path, tmp_path / "there.zarr"))
        assert sorted(one) == sorted(found) and [name for name in one if one[name] != found[name]] == []


def test_bidirectional_renders_need_no_shared_folder(bucket: str, client: Any, tmp_path: Path) -> None:
    file = scene_in(tmp_path)
    choices = ["--integrator", "bidirectional", "--spp", "8"]
    sunstone("render", file, *choices, "--no-figures", "--threads", 1, "-o", tmp_path / "one.zarr")
    address = f"{bucket}/light.zarr"
    distributed.render(file, address, spp=8, integrator="bidirectional", parts=4, client=client, command=command())
    assert_same(tmp_path / "one.zarr", download(address, tmp_path / "there.zarr"))


def test_rounds_to_a_target_error_equal_those_of_one_process(bucket: str, cluster: Any, client: Any, tmp_path: Path) -> None:
    file = scene_in(tmp_path)
    words = ["--spp", 32, "--target-error", 0.02, "--target-slice", "steady", "--slices", "steady"]
    sunstone("render", file, *words, "--no-figures", "--threads", 1, "-o", tmp_path / "one.zarr")
    # The command itself writes the same store to an address.
    sunstone("render", file, *words, "--no-figures", "--threads", 1, "-o", f"{bucket}/alone.zarr")
    one = content(tmp_path / "one.zarr")
    assert one == content(download(f"{bucket}/alone.zarr", tmp_path / "alone.zarr"))
    address = f"{bucket}/rounds.zarr"
    with Killer(cluster, 8.0):
        distributed.render(
            file, address, 32, parts=2, client=client, command=command(), target_error=0.02, target_slice="steady", slices=["steady"]
        )
    assert one == content(download(address, tmp_path / "there.zarr"))
    attributes = json.loads((tmp_path / "there.zarr" / "zarr.json").read_text())["attributes"]
    assert attributes["target"]["rounds"] >= 2
    for rest in (f"{address}.parts", f"{address}.rounds", f"{bucket}/alone.zarr.rounds"):
        assert names(rest) == []


def test_absolute_paths_are_refused(bucket: str, client: Any, tmp_path: Path) -> None:
    file = scene_in(tmp_path)
    file.write_text(file.read_text().replace("../shapes/tile.ply", str(tmp_path / "shapes" / "tile.ply")))
    with pytest.raises(RenderError, match="absolute path"):
        distributed.render(file, f"{bucket}/absolute.zarr", client=client, command=command())

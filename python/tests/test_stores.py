"""Stores as trees: stores that open, stores that are refused, and equality of values with the written ones."""

from __future__ import annotations

import functools
import http.server
import importlib.util
import json
import math
import pickle
import shutil
import signal
import subprocess
import threading
import time
import warnings
from collections.abc import Hashable, Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr

import rendered
from pysunstone import shards, stores
from pysunstone.boxes import bins
from pysunstone.command import CommandError
from pysunstone.stores import open_store

def array(tree: xr.DataTree, path: str) -> xr.DataArray:
    found = tree[path]
    assert isinstance(found, xr.DataArray)
    return found


SLICES = ["full", "epipolar", "nonepipolar", "binned", "some", "timed", "flight", "steady"]


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    path = tmp_path / "copy.zarr"
    shutil.copytree(rendered.store(), path)
    return path


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """Serve the folder of the tests and yield its URL."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, format: str, *args: object) -> None:
            pass

    handler = functools.partial(Quiet, directory=rendered.folder())
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_xarray_opens_every_store_as_a_tree(tmp_path: Path) -> None:
    rendered.sunstone("layers", rendered.scene(), "-o", tmp_path / "truth.zarr")
    rendered.sunstone("probe", rendered.store(), "full", "--stokes", "right", "-o", tmp_path / "probed.zarr")
    rendered.sunstone("denoise", rendered.store(), "-o", tmp_path / "denoised.zarr")
    other = tmp_path / "other.zarr"
    rendered.sunstone("render", rendered.scene(), "--seed", 7, "--spp", 32, "-o", other, "--no-figures")
    rendered.sunstone("merge", rendered.store(), other, "-o", tmp_path / "merged.zarr")
    rendered.sunstone("rig", "run", rendered.ROOT / "rigs/coaxial_temporal/plan.toml", "--sample", "mirror", "-o", tmp_path / "night.zarr")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for path in [rendered.store(), *sorted(tmp_path.glob("*.zarr"))]:
            tree = xr.open_datatree(path, engine="zarr")
            ours = open_store(path)
            assert sorted(ours.children) == sorted(tree.children), path
            for name, node in ours.children.items():
                assert node.ds.equals(tree.children[name].ds), f"{path}/{name}"
    assert len(list(tmp_path.glob("*.zarr"))) == 6


def test_a_store_of_an_earlier_version_opens(copied: Path) -> None:
    """Its sample counts are along y and x, which xarray refuses: the negative control of the test above."""
    description = copied / "samples/zarr.json"
    old = json.loads(description.read_text())
    old["dimension_names"] = ["y", "x"]
    description.write_text(json.dumps(old))
    root = json.loads((copied / "zarr.json").read_text())
    root["consolidated_metadata"]["metadata"]["samples"] = old
    (copied / "zarr.json").write_text(json.dumps(root))
    _reseal(copied)
    with pytest.raises(ValueError, match="not aligned"):
        xr.open_datatree(copied, engine="zarr")
    tree = open_store(copied)
    assert array(tree, "samples").sizes == {"camera_y": 16, "camera_x": 20}
    assert int(array(tree, "samples").min()) == 64
    assert array(tree, "timed/mean").equals(array(open_store(rendered.store()), "timed/mean"))


def _reseal(path: Path) -> None:
    """Update the sizes of metadata in the manifest."""
    lines = (path / "manifest.txt").read_text().splitlines()
    changed = []
    for line in lines:
        crc, size, name = line.split(" ", 2)
        changed.append(f"{crc} {(path / name).stat().st_size} {name}" if name.endswith("zarr.json") else line)
    (path / "manifest.txt").write_text("\n".join(changed) + "\n")


def test_values_units_and_provenance_equal_those_of_the_store() -> None:
    tree = open_store(rendered.store())
    assert list(tree.children) == SLICES
    raw = zarr.open_group(rendered.store(), mode="r")
    for name in SLICES:
        data = tree[name].to_dataset()
        for field in ("mean", "std_error"):
            written = raw[f"{name}/{field}"]
            assert isinstance(written, zarr.Array)
            assert np.array_equal(data[field].values, np.asarray(written[:])), f"{name}/{field}"
        assert all(data[d].attrs["units"] for d in data["mean"].dims)
        assert data["mean"].attrs["units"] == "W m-2 sr-1 nm-1 per unit projector drive"
        assert data["mean"].attrs["projector_size"] == [12, 10]
    assert tree.attrs["seeds"] == [0] and tree.attrs["state"] == "finished"
    assert tree.attrs["scene"] == rendered.scene().read_text()
    assert array(tree, "timed/t").attrs["units"] == "ps"


def test_dask_chunks_are_multiples_of_stored_chunks() -> None:
    tree = open_store(rendered.store())
    for name in SLICES:
        mean = array(tree, f"{name}/mean")
        assert mean.chunks is not None
        preferred = mean.encoding["preferred_chunks"]
        for dim, cuts in zip(mean.dims, mean.chunks, strict=True):
            assert all(cut % preferred[dim] == 0 for cut in cuts[:-1]), f"{name} {dim}"
    # Chunks of 6 MiB grow from the last axis: 4 along u, 2 along x, in total 48 MiB of at most 64 MiB.
    sizes: dict[Hashable, int] = {"y": 256, "x": 256, "v": 8, "u": 256, "stokes_out": 4, "stokes_in": 4, "wavelength": 3}
    stored: dict[Hashable, int] = {"y": 8, "x": 8, "v": 8, "u": 64, "stokes_out": 4, "stokes_in": 4, "wavelength": 3}
    lengths = stores.pieces(sizes, stored, 4)
    assert lengths == {**stored, "u": 256, "x": 16}
    assert stores.pieces({"y": 5}, {"y": 2}, 4) == {"y": 5}
    assert not array(open_store(rendered.store(), chunks=None), "full/mean").chunks
    assert array(open_store(rendered.store(), chunks={"x": 4}), "full/mean").chunksizes["x"] == (4,) * 5


def test_nothing_needs_dask(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "dask" else find(name, *rest))
    mean = array(open_store(rendered.store()), "timed/mean")
    assert not mean.chunks and mean.equals(array(open_store(rendered.store(), None), "timed/mean"))


def test_arrays_can_be_pickled() -> None:
    mean = array(open_store(rendered.store()), "steady/mean")
    assert pickle.loads(pickle.dumps(mean)).equals(mean.compute())


def test_a_store_is_read_over_http(url: str) -> None:
    pytest.importorskip("aiohttp", reason="fsspec reads http with it")
    rendered.store()
    tree = open_store(f"{url}/ball.zarr")
    assert list(open_store(f"{url}/ball.zarr", slices=["timed"]).children) == ["timed"]
    local = open_store(rendered.store())
    assert list(tree.children) == SLICES and tree.name == "ball.zarr"
    for name in SLICES:
        assert tree[name].to_dataset().drop_attrs().identical(local[name].to_dataset().drop_attrs()), name
    with pytest.raises(stores.NotAStoreError, match="no zarr.json"):
        open_store(f"{url}/nothing.zarr")


def test_shards_are_read_over_http(url: str) -> None:
    """Shards can be read from a server without range requests."""
    pytest.importorskip("aiohttp", reason="fsspec reads http with it")
    shards.shard(rendered.store(), rendered.folder() / "served.zarr")
    there, here = (array(open_store(place, chunks=None), "full/mean") for place in (f"{url}/served.zarr", rendered.store()))
    assert there[3, 5].equals(here[3, 5]) and there.equals(here)


def test_paths_that_are_not_stores_are_refused(tmp_path: Path) -> None:
    with pytest.raises(stores.NotAStoreError, match="there is nothing"):
        open_store(tmp_path / "none.zarr")
    with pytest.raises(stores.NotAStoreError, match="no zarr.json"):
        open_store(tmp_path)
    zarr.create_group(tmp_path / "strange.zarr")
    with pytest.raises(stores.NotAStoreError, match="lists no slices"):
        open_store(tmp_path / "strange.zarr")
    (tmp_path / "zarr.json").write_text("{")
    with pytest.raises(stores.DamagedStoreError, match="not valid JSON"):
        open_store(tmp_path)
    with pytest.raises(stores.StoreError, match="has no slice `ful`; available slices: full, epipolar"):
        open_store(rendered.store(), slices=["ful"])
    assert list(open_store(rendered.store(), slices=["timed"]).children) == ["timed"]


def test_a_newer_store_is_refused(copied: Path) -> None:
    manifest = copied / "manifest.txt"
    sound = manifest.read_text()
    manifest.write_text(sound.replace("manifest 1:", "manifest 2:"))
    with pytest.raises(stores.NewerStoreError, match="form 2"):
        open_store(copied)
    root = json.loads((copied / "zarr.json").read_text())
    (copied / "zarr.json").write_text(json.dumps({**root, "zarr_format": 4}))
    with pytest.raises(stores.NewerStoreError, match="Zarr format 4"):
        open_store(copied)


@pytest.mark.parametrize("fault", ["lost", "cut", "other", "swapped"])
def test_damaged_chunks_are_errors(copied: Path, fault: str) -> None:
    """Zarr itself reads a missing chunk as zeros, and does not detect an exchanged chunk."""
    chunks = sorted((copied / "full/mean").glob("c.*"))
    chunk = chunks[0]
    if fault == "lost":
        chunk.unlink()
        assert np.isfinite(xr.open_datatree(copied, engine="zarr")["full/mean"]).all()
    elif fault == "cut":
        chunk.write_bytes(chunk.read_bytes()[:-1])
    elif fault == "other":
        sound = bytearray(chunk.read_bytes())
        sound[len(sound) // 2] ^= 1
        chunk.write_bytes(sound)
    else:
        shutil.copy(copied / "full/std_error" / chunk.name, chunk)
    tree = open_store(copied)
    assert array(tree, "steady/mean").isnull().sum() == 0
    kinds = (stores.DamagedStoreError, ValueError, RuntimeError)
    with pytest.raises(kinds, match="full/mean|crc32c|checksum"):
        array(tree, "full/mean").load()


def test_a_damaged_manifest_is_an_error(copied: Path) -> None:
    manifest = copied / "manifest.txt"
    lines = manifest.read_text().splitlines(keepends=True)
    for damaged in (lines[:-1], lines[:5] + lines[6:], ["sunstone", *lines[1:]], []):
        manifest.write_text("".join(damaged))
        with pytest.raises(stores.DamagedStoreError, match=r"manifest\.txt"):
            open_store(copied)


def test_an_unfinished_store_reports_its_progress(tmp_path: Path) -> None:
    """A render is killed. The consolidated metadata match the files that exist, and missing values are NaN."""
    path = tmp_path / "killed.zarr"
    scene = tmp_path / "large.toml"
    scene.write_text(rendered.SCENE.replace("resolution = [20, 16]", "resolution = [200, 160]").replace("spp = 64", "spp = 1024"))
    options = ["--slices", "steady,flight", "--threads", "1", "--no-figures"]
    process = subprocess.Popen([rendered.command(), "render", str(scene), "-o", str(path), *options], stderr=subprocess.DEVNULL)
    begun = time.monotonic()
    while not list((path / "steady/mean").glob("c.*")) and time.monotonic() - begun < 60:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    with pytest.raises(stores.UnfinishedStoreError, match=r"status `incomplete`, \d+ % of the camera's pixels have samples"):
        open_store(path)
    root = json.loads((path / "zarr.json").read_text())["consolidated_metadata"]["metadata"]
    for name, consolidated in root.items():
        stand = json.loads((path / name / "zarr.json").read_text())
        for description in (consolidated, stand):
            description.pop("consolidated_metadata", None)
        assert consolidated == stand, name
    tree = open_store(path, unfinished=True)
    assert tree.attrs["state"] == "unfinished"
    done = array(tree, "samples").values > 0
    assert 0 < done.mean() < 1
    assert np.array_equal(np.isfinite(array(tree, "steady/mean").values).all((2, 3, 4)), done)
    binned = done.reshape(80, 2, 100, 2).all((1, 3))
    assert np.array_equal(np.isfinite(array(tree, "flight/mean").values).all((2, 3)), binned)
    out = tmp_path / "partial.npy"
    rendered.sunstone("probe", path, "flight", "--partial", "-o", out)
    assert np.array_equal(np.load(out), array(tree, "flight/mean").values, equal_nan=True)


def test_a_part_is_not_a_finished_render(tmp_path: Path) -> None:
    path = tmp_path / "part.zarr"
    scene = tmp_path / "tiles.toml"
    scene.write_text(rendered.SCENE.replace("max_depth = 4", "max_depth = 4, tile = 8"))
    rendered.sunstone("render", scene, "--part", "1/2", "--spp", 2, "-o", path, "--no-figures")
    with pytest.raises(stores.UnfinishedStoreError, match=r"`complete part`, \d+ % .*: join all parts"):
        open_store(path)
    tree = open_store(path, unfinished=True)
    assert 0 < float(array(tree, "steady/mean").notnull().mean()) < 1
    assert array(tree, "steady/mean").notnull().all(["stokes_out", "stokes_in", "wavelength"]).equals(
        xr.DataArray(array(tree, "samples").values > 0, dims=("y", "x"), coords={d: tree["steady"][d] for d in ("y", "x")})
    )


def test_entries_map_to_ranges_of_pixels() -> None:
    assert bins([0, 1, 2]) == [(0, 0), (1, 1), (2, 2)]
    assert bins([1.5, 5.5, 8.5]) == [(0, 3), (4, 7), (8, 9)]
    assert bins([1, 4, 6.5], 3) == [(0, 2), (3, 5), (6, 7)]
    assert bins([1, 4], 1) == [(1, 1), (4, 4)]
    for bad in ([1, 4], [1.5, 5.6], [float("nan")]):
        with pytest.raises(ValueError):
            bins(bad)


@pytest.fixture
def sharded(tmp_path: Path) -> Path:
    return Path(shards.shard(rendered.store(), tmp_path / "shards.zarr"))


def test_a_sharded_store_gives_the_same_values(sharded: Path) -> None:
    plain, tree, alone = open_store(rendered.store()), open_store(sharded), xr.open_datatree(sharded, engine="zarr")
    assert len(list(sharded.rglob("c.*"))) < len(list(Path(rendered.store()).rglob("c.*")))
    for name in SLICES:
        for field in plain[name].to_dataset().data_vars:
            there = plain[name][field].values.view("u4")
            for other in (tree, alone):
                assert np.array_equal(other[name][field].values.view("u4"), there), f"{name}/{field}"
        assert tree[name].to_dataset().drop_vars(list(plain[name].data_vars)).drop_attrs().identical(
            plain[name].to_dataset().drop_vars(list(plain[name].data_vars)).drop_attrs()
        )
    one = array(open_store(sharded, chunks=None), "timed/mean")[0, 4]
    assert np.array_equal(one.values, array(plain, "timed/mean")[0, 4].values)
    assert pickle.loads(pickle.dumps(array(tree, "steady/mean"))).equals(array(tree, "steady/mean").compute())
    with pytest.raises(CommandError, match="already sharded"):
        shards.shard(sharded, sharded.with_name("twice.zarr"))
    with pytest.raises(CommandError, match="--force"):
        shards.shard(rendered.store(), sharded)
    assert shards.shard(rendered.store(), sharded, force=True) == str(sharded)


@pytest.mark.parametrize("fault", ["lost", "cut", "chunk", "seals", "index", "swapped"])
@pytest.mark.parametrize("part", [False, True])
def test_damage_of_a_shard_is_an_error(sharded: Path, fault: str, part: bool) -> None:
    shard = sorted((sharded / "full/mean").glob("c.*"))[0]
    reported = json.loads((sharded / "full/mean/zarr.json").read_text())
    lengths = reported["chunk_grid"]["configuration"]["chunk_shape"], reported["codecs"][0]["configuration"]["chunk_shape"]
    chunks = math.prod(s // c for s, c in zip(*lengths, strict=True))
    assert chunks > 1
    content = bytearray(shard.read_bytes())
    tail = len(content) - shards.Shards.tail_length(chunks)
    if fault == "lost":
        shard.unlink()
    elif fault == "cut":
        shard.write_bytes(content[:-1])
    elif fault == "swapped":
        shutil.copy(sharded / "full/std_error" / shard.name, shard)
    else:
        content[{"chunk": 9, "seals": tail + 1, "index": len(content) - 20}[fault]] ^= 1
        shard.write_bytes(content)
    full = array(open_store(sharded, chunks=None), "full/mean")
    inner = lengths[1]
    with pytest.raises((stores.DamagedStoreError, ValueError, RuntimeError), match="full/mean|crc32c|checksum"):
        (full[: inner[0], : inner[1]] if part else full).load()

"""Renders with Dask: byte-identical to those of one process, although workers die."""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import distributed as dask
import pytest
from clusters import Killer
from rendered import ROOT, command, content, folder, sunstone

from pysunstone import distributed
from pysunstone._units import Command, Made, Unit
from pysunstone.distributed import Job, RenderError

COMMAND = command()

# Dask has no type annotations.
DASK: Any = dask

SIDE = 96
SCENE = folder() / "mirror_room" / "scene.toml"


@pytest.fixture(scope="module", autouse=True)
def _scene() -> None:
    """Copy the shipped scene with fewer pixels, in 36 tiles."""
    shutil.copytree(ROOT / "scenes" / "mirror_room", SCENE.parent)
    text, fewer = SCENE.read_text().split("[[figures]]")[0], {"256": str(SIDE), "[150]": "[56]", "spp = 128": "spp = 128\ntile = 16"}
    for word, other in fewer.items():
        assert word in text
        text = text.replace(word, other)
    SCENE.write_text(text)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with DASK.LocalCluster(n_workers=4, threads_per_worker=1, dashboard_address=None) as made:
        # Killed workers are replaced.
        made.adapt(minimum=4, maximum=4)
        yield made


@pytest.fixture(scope="module")
def client(cluster: Any) -> Iterator[Any]:
    with DASK.Client(cluster) as made:
        yield made


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the store of a single process."""
    path = tmp_path_factory.mktemp("whole") / "whole.zarr"
    sunstone("render", SCENE, "--spp", 16, "--integrator", "path", "--no-figures", "--threads", 1, "-o", path)
    return path


def key(job: Job) -> str:
    """Return the name under which a call keeps its parts."""
    return distributed._key(sunstone("--version"), Path(job.scene).read_bytes(), job.choices())


def assert_same(a: Path, b: Path | str) -> None:
    one, other = content(a), content(Path(b))
    assert sorted(one) == sorted(other) and len(one) > 100
    assert [name for name in one if one[name] != other[name]] == []


def test_killed_workers_do_not_change_the_output(cluster: Any, client: Any, whole: Path, tmp_path: Path) -> None:
    begun = time.monotonic()
    counts: list[tuple[int, int]] = []
    with Killer(cluster, 1.0) as killer:
        path = distributed.render(
            SCENE,
            tmp_path / "killed.zarr",
            spp=16,
            parts=24,
            client=client,
            integrator="path",
            progress=lambda done, of: counts.append((done, of)),
        )
    assert isinstance(path, Path)
    print(f"{killer.kills} workers killed in {time.monotonic() - begun:.1f} s")
    assert killer.kills >= 1
    assert_same(whole, path)
    assert counts == [(n, 24) for n in range(1, 25)]
    assert not (tmp_path / "killed.zarr.parts").exists()
    sunstone("verify", path)


def test_finished_parts_are_reused(client: Any, whole: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.zarr"
    job = Job(SCENE, spp=16, integrator="path")
    folder = tmp_path / "out.zarr.parts"
    kept = folder / key(job)
    sunstone("render", *job.options(), "--part", "2/3", "-o", kept / "2of3")
    stamp = (kept / "2of3" / "part.txt").stat().st_mtime_ns
    # Negative control: parts of another seed are not reused.
    other = folder / key(Job(SCENE, spp=16, seed=5, integrator="path"))
    assert other != kept
    seen: list[int] = []

    def watch(done: int, of: int) -> None:
        seen.append((kept / "2of3" / "part.txt").stat().st_mtime_ns)

    distributed.render(SCENE, out, spp=16, parts=3, client=client, integrator="path", progress=watch)
    assert set(seen) == {stamp}
    assert_same(whole, out)
    with pytest.raises(FileExistsError, match="overwrite"):
        distributed.render(SCENE, out, spp=16, parts=3, client=client)


def test_duplicate_units_give_one_result(whole: Path, tmp_path: Path) -> None:
    """Two workers make the same unit simultaneously, and one of them finishes later."""
    words = tuple(Job(SCENE, spp=2, integrator="path").options())
    unit = Unit(Command(COMMAND, ("render", *words, "--part", "1/8")), str(tmp_path / "parts" / "1of8"), 1)
    both = [threading.Thread(target=unit) for _ in range(2)]
    for thread in both:
        thread.start()
    for thread in both:
        thread.join()
    assert [path.name for path in (tmp_path / "parts").iterdir()] == ["1of8"]
    sunstone("verify", tmp_path / "parts" / "1of8")
    assert unit() == Made(0.0, 0)


def test_rounds_to_a_target_error_equal_those_of_one_process(cluster: Any, client: Any, tmp_path: Path) -> None:
    """Workers are killed during the render. The scheduler and the caller receive progress reports."""
    goal = {"spp": 32, "target_error": 0.05, "target_share": 0.6, "integrator": "path", "slices": ["conventional"]}
    one = tmp_path / "one.zarr"
    words = ["--spp", 32, "--target-error", 0.05, "--target-share", 0.6, "--integrator", "path", "--slices", "conventional"]
    sunstone("render", SCENE, *words, "--no-figures", "--threads", 1, "-o", one)
    reported: list[distributed.Metrics] = []
    with Killer(cluster, 1.0):
        path = distributed.render(SCENE, tmp_path / "many.zarr", parts=6, client=client, report=reported.append, **goal)
    assert_same(one, path)
    assert not (tmp_path / "many.zarr.parts").exists()
    reached = json.loads(Path(path, "zarr.json").read_text())["attributes"]["target"]
    assert reached["reached"] <= 0.05 and reached["rounds"] >= 2
    assert [(t.round, t.finished) for t in reported] == [(k, n) for k in range(reached["rounds"]) for n in range(1, 7)]
    assert reported[0].error is None and reported[-1].error > 0.05 and reported[-1].target_error == 0.05
    assert reported[5].samples == SIDE * SIDE * 32 and reported[-1].samples > reported[5].samples and reported[-1].samples_per_s > 0
    events = [event for _, event in client.get_events(distributed.TOPIC) if event["store"] == str(path)]
    assert [event["samples"] for event in events] == [t.samples for t in reported]
    # The result is the same if a round has only one part.
    assert_same(one, distributed.render(SCENE, tmp_path / "single.zarr", parts=1, client=client, **goal))
    # An existing store is replaced only on request.
    with pytest.raises(FileExistsError, match="overwrite"):
        distributed.render(SCENE, path, parts=6, client=client, **goal)
    with pytest.raises(RenderError, match="--target-share"):
        distributed.render(SCENE, tmp_path / "a.zarr", client=client, target_error=0.1, target_share=2.0)


def test_invalid_requests_are_refused(client: Any, tmp_path: Path) -> None:
    with pytest.raises(RenderError, match="unknown slice `nothing`"):
        distributed.render(SCENE, tmp_path / "a.zarr", spp=2, parts=2, client=client, slices=["nothing"])
    with pytest.raises(RenderError, match="no command"):
        distributed.render(SCENE, tmp_path / "a.zarr", client=client, command="no-such-sunstone")
    with pytest.raises(ValueError, match="at least 1"):
        distributed.render(SCENE, tmp_path / "a.zarr", parts=0, client=client)
    with pytest.raises(ValueError, match="only `render` writes to object stores"):
        distributed.render_many([SCENE], "s3://bucket/set", client=client)
    assert not (tmp_path / "a.zarr").exists()


def test_many_renders_have_a_manifest(client: Any, tmp_path: Path) -> None:
    jobs = [Job(SCENE, spp=2, seed=seed, slices=["conventional"], integrator="path") for seed in (1, 2, 3)]
    manifest = distributed.render_many(jobs, tmp_path / "set", client=client)
    entries = json.loads(manifest.read_text())
    assert [entry["store"] for entry in entries] == [f"mirror_room_seed{seed}.zarr" for seed in (1, 2, 3)]
    assert [entry["seed"] for entry in entries] == [1, 2, 3]
    assert len({entry["checksum"] for entry in entries}) == 3
    for entry in entries:
        sunstone("verify", tmp_path / "set" / entry["store"])
    # A call without existing stores and a call with existing stores give the same manifest.
    assert distributed.render_many(jobs, tmp_path / "again", client=client).read_bytes() == manifest.read_bytes()
    (tmp_path / "set" / "manifest.json").unlink()
    shutil.rmtree(tmp_path / "set" / "mirror_room_seed2.zarr")
    assert distributed.render_many(jobs, tmp_path / "set", client=client).read_bytes() == (
        tmp_path / "again" / "manifest.json"
    ).read_bytes()
    # A different render with an existing name is refused.
    jobs[0] = Job(SCENE, name="mirror_room_seed1", spp=4, seed=1, slices=["conventional"], integrator="path")
    with pytest.raises(RenderError, match="differ in samples_per_pixel"):
        distributed.render_many(jobs, tmp_path / "set", client=client)
    with pytest.raises(ValueError, match="two renders"):
        distributed.render_many([jobs[1], jobs[1]], tmp_path / "set", client=client)

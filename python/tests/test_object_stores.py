"""Stores at s3:// addresses, on a local server (moto): renders are equal to those in a folder, and stores open as trees."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import rendered
import scenes
from object_server import bucket, download
from pysunstone import InputError, Scene
from pysunstone.stores import open_store

__all__ = ["bucket"]

pytestmark = pytest.mark.skipif(importlib.util.find_spec("moto") is None, reason="needs moto[server]")


def test_a_render_equals_that_in_a_folder(bucket: str, tmp_path: Path) -> None:
    scene = Scene.from_toml(scenes.TEXT)
    scene.render(tmp_path / "here.zarr", threads=2)
    address = f"{bucket}/a.zarr"
    assert scene.render(address, threads=2)["complete"]
    there = download(address, tmp_path / "there.zarr")
    assert rendered.content(there) == rendered.content(tmp_path / "here.zarr")
    with pytest.raises(InputError, match="force"):
        scene.render(address)
    assert scene.render(address, resume=True)["samples"] == 0


@pytest.mark.skipif(importlib.util.find_spec("s3fs") is None, reason="needs s3fs")
def test_a_store_opens_as_a_tree(bucket: str, tmp_path: Path) -> None:
    scene = Scene.from_toml(scenes.TEXT)
    scene.render(tmp_path / "here.zarr")
    scene.render(f"{bucket}/b.zarr")
    here, there = open_store(tmp_path / "here.zarr"), open_store(f"{bucket}/b.zarr")
    for name in ("mueller/mean", "time/std_error"):
        np.testing.assert_array_equal(np.asarray(there[name]), np.asarray(here[name]))

"""Stores below s3://, on a server of this machine (moto): renders are those of a folder, and open as trees."""

from __future__ import annotations

import importlib.util
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import rendered
import scenes
from pysunstone import InputError, Scene
from pysunstone.stores import open_store

pytestmark = pytest.mark.skipif(importlib.util.find_spec("moto") is None, reason="needs moto[server]")


@pytest.fixture(scope="module")
def bucket() -> Iterator[str]:
    """The address of a bucket, with the environment set to ask for it here."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    server = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-p", str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (
            ("AWS_ACCESS_KEY_ID", "testing"),
            ("AWS_SECRET_ACCESS_KEY", "testing"),
            ("AWS_REGION", "us-east-1"),
            ("AWS_DEFAULT_REGION", "us-east-1"),
            ("AWS_ALLOW_HTTP", "true"),
            ("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}"),
        ):
            patch.setenv(name, value)
        import boto3  # type: ignore[import-untyped]

        for _ in range(300):
            try:
                socket.create_connection(("127.0.0.1", port), 1).close()
                break
            except OSError:
                time.sleep(0.1)
        boto3.client("s3").create_bucket(Bucket="renders")
        yield "s3://renders"
    server.terminate()
    server.wait()


def download(address: str, to: Path) -> Path:
    import boto3

    client = boto3.client("s3")
    bucket, _, prefix = address.removeprefix("s3://").partition("/")
    for found in client.list_objects_v2(Bucket=bucket, Prefix=prefix + "/")["Contents"]:
        path = to / found["Key"].removeprefix(prefix + "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        client.download_file(bucket, found["Key"], str(path))
    return to


def test_a_render_is_that_of_a_folder(bucket: str, tmp_path: Path) -> None:
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
def test_it_opens_as_a_tree(bucket: str, tmp_path: Path) -> None:
    scene = Scene.from_toml(scenes.TEXT)
    scene.render(tmp_path / "here.zarr")
    scene.render(f"{bucket}/b.zarr")
    here, there = open_store(tmp_path / "here.zarr"), open_store(f"{bucket}/b.zarr")
    for name in ("mueller/mean", "time/std_error"):
        np.testing.assert_array_equal(np.asarray(there[name]), np.asarray(here[name]))

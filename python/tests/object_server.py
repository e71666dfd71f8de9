"""A local S3 server (moto) with a bucket."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(scope="module")
def bucket() -> Iterator[str]:
    """Yield the address of a bucket, with the environment variables set for the local server."""
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
    for name in names(address + "/"):
        path = to / name.removeprefix(prefix + "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        client.download_file(bucket, name, str(path))
    return to


def names(address: str) -> list[str]:
    """Return the names in the bucket that begin with an address."""
    import boto3

    bucket, _, prefix = address.removeprefix("s3://").partition("/")
    pages: Any = boto3.client("s3").get_paginator("list_objects_v2").paginate(Bucket=bucket, Prefix=prefix)
    return [found["Key"] for page in pages for found in page.get("Contents", [])]

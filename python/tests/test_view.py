"""Tests of the explorer in notebooks."""

from __future__ import annotations

import json
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import pysunstone as ps
import pytest


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("view") / "room.zarr"
    builder = ps.SceneBuilder("room")
    builder.camera([0, 0, 2], [0, 0, 0], resolution=[4, 3], fov_x_deg=40)
    builder.projector([0.2, 0, 2], [0, 0, 0], resolution=[4, 3], fov_x_deg=40)
    builder.material("white", diffuse={"albedo": 0.5})
    wall = {"rectangle": {"corner": [-2, -2, 0], "u": [4, 0, 0], "v": [0, 4, 0]}}
    builder.object(name="wall", shape=wall, material="white")
    builder.slice("photo")
    builder.build().render(path, spp=1)
    return path


def answer(url: str, path: str, token: str) -> dict[str, object]:
    request = urllib.request.Request(url.split("/?")[0] + path, headers={"x-sunstone-token": token})
    with urllib.request.urlopen(request, timeout=20) as reply:
        return json.load(reply)


def test_a_view_serves_the_store_and_is_an_inline_frame(store: Path) -> None:
    view = ps.view(store, height=500)
    url, token = view.url, view.url.split("token=")[1]
    described = answer(url, "/api/describe", token)
    assert [s["name"] for s in described["stores"][0]["slices"]] == ["photo"]  # type: ignore[index]
    with pytest.raises(urllib.error.HTTPError):
        answer(url, "/api/describe", "wrong")
    text = view._repr_html_()
    assert url in text and 'height="500"' in text
    # A cell that runs again shows the same explorer.
    assert ps.view(store).url == url


def test_paths_that_are_no_stores_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ps.InputError, match="does not exist"):
        ps.view(tmp_path / "missing.zarr")
    with pytest.raises(ps.InputError, match="no store was given"):
        ps.view()


def test_the_process_ends_although_a_view_is_open(store: Path) -> None:
    code = f"import pysunstone as ps; print(ps.view({str(store)!r}).url)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.startswith("http://127.0.0.1:")

"""What renders by Dask cost: the scheduler's time for units that do nothing, and one render by workers against one process.

    SUNSTONE=target/release/sunstone PYTHONPATH=python python python/measure_distributed.py
"""

from __future__ import annotations

import os
import statistics
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import distributed as dask

from pysunstone import distributed

DASK: Any = dask
SCENE = Path(__file__).parents[1] / "scenes" / "mirror_room" / "scene.toml"
UNITS = 10_000
ROUNDS = 3


@dataclass(frozen=True)
class Nothing:
    """A unit that takes no time."""

    place: str

    def __call__(self) -> float:
        return 0.0


def scheduler() -> None:
    with DASK.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, DASK.Client(cluster) as client:
        seconds = []
        for n in range(ROUNDS):
            units: Any = [Nothing(f"{n}/{k}") for k in range(UNITS)]
            begun = time.perf_counter()
            distributed._finish(client, units, None)
            seconds.append(time.perf_counter() - begun)
        each = [f"{1e3 * s / UNITS:.2f}" for s in seconds]
        print(f"{UNITS} units that do nothing: {statistics.median(seconds):.1f} s; ms a unit in each round: {', '.join(each)}", flush=True)


def efficiency(integrator: str, spp: int) -> None:
    name = distributed._command(None)
    with (
        tempfile.TemporaryDirectory() as folder,
        DASK.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        DASK.Client(cluster) as client,
    ):
        client.wait_for_workers(2)
        ratios, one, two = [], [], []
        for n in range(ROUNDS):
            words = ["--spp", str(spp), "--integrator", integrator, "--no-figures", "--threads", "2"]
            begun = time.perf_counter()
            subprocess.run([name, "render", SCENE, *words, "-o", f"{folder}/one{n}"], check=True, capture_output=True)
            one.append(time.perf_counter() - begun)
            begun = time.perf_counter()
            distributed.render(SCENE, f"{folder}/two{n}", spp=spp, client=client, integrator=integrator)
            two.append(time.perf_counter() - begun)
            ratios.append(one[-1] / two[-1])
        shown = ", ".join(f"{a:.1f}/{b:.1f}" for a, b in zip(one, two, strict=True))
        load = os.getloadavg()[0]
        print(f"mirror room, {integrator}, {spp} samples, 8 parts: one process with 2 threads over 2 workers {statistics.median(ratios):.3f}"
              f" (seconds {shown}; load {load:.1f})", flush=True)


if __name__ == "__main__":
    scheduler()
    efficiency("path", 128)
    efficiency("caustics", 64)
    efficiency("bidirectional", 16)

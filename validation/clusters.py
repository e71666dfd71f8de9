#!/usr/bin/env python3
"""Measure the cost of renders with Dask: the scheduler's time per unit, and two workers against one process with two threads.

Rounds are interleaved. Every timed render is complete: a process or call from its start to a finished store in memory. Workers
start before the measurement. The processor time of all commands, including those of the workers, is also printed. Processor time
is independent of other load on the machine, but does not include waiting times.

    python3 validation/clusters.py [--rounds 3] [--record]

Requires the package pysunstone in .venv (pip install ./python[dask]). With --record the numbers go to results/clusters.json.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass

import environment
import result_file

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()

UNITS = 10_000
PARTS = 8
# Renders of half a minute to a minute on two cores of 2020; renders on clusters take longer.
RENDERS = {"path": 768, "caustics": 512, "bidirectional": 96}
SCENE = environment.ROOT / "scenes/mirror_room/scene.toml"


@dataclass(frozen=True)
class Nothing:
    """A unit that does nothing."""

    place: str

    def __call__(self):
        from pysunstone import _units

        return _units.Made(0.0, 0)


def scheduler(client, rounds):
    """Return milliseconds per unit, from 10,000 units that do nothing."""
    from pysunstone import _units

    each = []
    for n in range(rounds):
        units = [Nothing(f"{n}/{k}") for k in range(UNITS)]
        begun = time.perf_counter()
        _units.finish(client, units, None, _units.Meter(client, "nothing", None))
        each.append(1e3 * (time.perf_counter() - begun) / UNITS)
    return each


def used():
    """Return the processor seconds of all commands that this process has run."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return children.ru_utime + children.ru_stime


def pair(client, integrator, spp, folder):
    """Return the seconds of one process with two threads and of two single-threaded workers; then the processor seconds."""
    from pysunstone import distributed

    def everywhere():
        return used() + sum(client.run(used).values())

    words = ["--spp", str(spp), "--integrator", integrator, "--no-figures", "--threads", "2"]
    begun, before = time.perf_counter(), used()
    subprocess.run([environment.sunstone(), "render", SCENE, *words, "-o", f"{folder}/one"], check=True, capture_output=True)
    one, one_used = time.perf_counter() - begun, used() - before
    begun, before = time.perf_counter(), everywhere()
    distributed.render(SCENE, f"{folder}/two", spp=spp, parts=PARTS, client=client, integrator=integrator, command=str(environment.sunstone()))
    return one, time.perf_counter() - begun, one_used, everywhere() - before


def main():
    import dask
    import distributed

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--record", action="store_true", help="write results/clusters.json")
    options = parser.parse_args()
    numbers = {}
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        client.wait_for_workers(2)
        numbers["unit"] = result_file.rounds(scheduler(client, options.rounds), "ms", "lower", f"{options.rounds} rounds of {UNITS}")
        print(f"{UNITS} units that do nothing: {numbers['unit']['median']:.2f} ms each", flush=True)
        found = {name: [] for name in RENDERS}
        for _ in range(options.rounds):
            for name, spp in RENDERS.items():
                with tempfile.TemporaryDirectory(dir=environment.in_memory()) as folder:
                    found[name].append(pair(client, name, spp, folder))
        for name, pairs in found.items():
            one, two, one_used, two_used = zip(*pairs, strict=True)
            numbers[f"one_{name}"] = result_file.rounds(one, "s")
            numbers[f"workers_{name}"] = result_file.rounds(two, "s")
            numbers[f"efficiency_{name}"] = result_file.ratio(one, two)
            numbers[f"processor_{name}"] = result_file.ratio(one_used, two_used)
            reported = [numbers[f"{kind}_{name}"]["median"] for kind in ("efficiency", "processor")]
            print(f"{name:14} efficiency {reported[0]:.3f}, of processor time {reported[1]:.3f}; one process {one}, workers {two}", flush=True)
    if options.record:
        measures = [*result_file.TRACER, "python", "src/cli", "scenes/mirror_room", "validation/clusters.py"]
        result_file.write("clusters", __file__, measures, numbers, {"dask": dask.__version__, "distributed": distributed.__version__})


if __name__ == "__main__":
    main()

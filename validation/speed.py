#!/usr/bin/env python3
"""How fast: the same Cornell box, resolution and depth in Sunstone and in Mitsuba 3, on the same cores in one run.

Sunstone's scene is exported to Mitsuba, so that both render the same thing. Rounds are interleaved, because machines
drift; a row gives each side's best and median. Compared are

- Sunstone, complete: 3 wavelengths, all 16 Mueller elements, 256 time bins, and an s-s' slice; errors of every element;
- Sunstone, plain: 3 wavelengths, intensity alone;
- Mitsuba with the full-Mueller integrator of mueller_integrator.py: 1 wavelength, 16 elements, 256 time bins, one light;
- Mitsuba's own `stokes` over `path`: spectral, no time, one column of the matrix.

A sample is a path from the camera. Sunstone's times are those of the whole process with all files written; Mitsuba's are
of rendering alone, after a warm-up. This is done at two sample counts: what Sunstone writes is the same at any, so that the
complete tensor of few samples costs more a sample.

Then the mirror room: all its slices against its conventional image alone, and two threads against one; beside it what two
programs at once achieve, since the second core of a shared machine is not always a whole one.

Raw numbers go to results/speed.json. Needs LLVM.
"""

import argparse
import json
import os
import platform
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import drjit as dr
    import mitsuba as mi
    import numpy as np

SCENE = environment.HERE / "speed/cornell.toml"
OUT = environment.ROOT / "target/speed"
RESULTS = environment.HERE / "results/speed.json"
RESOLUTION, DEPTH, BINS = 256, 6, 256
MONO, SPECTRAL = "llvm_ad_mono_polarized", "llvm_ad_spectral_polarized"


def sunstone(stores, scene, spp, seed, threads=None):
    """Seconds and megabytes of a render, whose store is left in a folder."""
    # Each into a directory of its own, removed when all is done: to replace a store takes its time, and where many files
    # were just removed, ext4 makes new ones slowly.
    folder = tempfile.mkdtemp(dir=stores)
    program = [environment.sunstone(), "render", scene, "-o", f"{folder}/out.zarr", "--no-figures"]
    program += ["--spp", spp, "--seed", seed] + (["--threads", threads] if threads else [])
    begun = time.perf_counter()
    running = subprocess.Popen([*map(str, program)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    # The system's own count of a child's memory starts with that of the parent it was forked from.
    peak = 0
    while running.poll() is None:
        peak = max(peak, high_water(running.pid))
        time.sleep(0.005)
    if running.returncode:
        sys.exit("sunstone failed")
    return time.perf_counter() - begun, peak


def high_water(pid):
    """Largest resident memory of a process so far, megabytes; 0 if it is gone."""
    try:
        with open(f"/proc/{pid}/status") as status:
            return max((int(line.split()[1]) / 1024 for line in status if line.startswith("VmHWM")), default=0)
    except OSError:
        return 0


def export(folder, *arguments):
    """The scene for Mitsuba."""
    program = [environment.sunstone(), "export", SCENE, "--mitsuba", folder, "--force", *arguments]
    subprocess.run([*map(str, program)], check=True, capture_output=True)
    return str(folder / "scene.xml")


def full_mueller(scene, spp, seed):
    """One render by the integrator of mueller_integrator.py."""
    from mueller_integrator import project, trace

    sensor = scene.sensors()[0]
    sampler = sensor.sampler().clone()
    count = RESOLUTION**2 * spp
    sampler.set_sample_count(spp)
    sampler.set_samples_per_wavefront(spp)
    sampler.seed(seed, count)
    pixel = dr.arange(mi.UInt32, count) // spp
    corner = mi.Point2f(mi.Float(pixel % RESOLUTION), mi.Float(pixel // RESOLUTION))
    ray, _ = sensor.sample_ray(0.0, sampler.next_1d(), (corner + sampler.next_2d()) / RESOLUTION, mi.Point2f(0.5))
    to_camera = mi.mueller.rotate_stokes_basis(
        -ray.d, mi.mueller.stokes_basis(-ray.d), project(mi.Vector3f(1, 0, 0), -ray.d)
    )
    film = dr.zeros(mi.Float, RESOLUTION**2 * BINS * 16)
    light = mi.Point3f(0, 0.5, 3.9), mi.Float(20), mi.Vector3f(1, 0, 0)
    begin = mi.Float(0)
    trace(scene, sampler, ray, begin, mi.Spectrum(to_camera), pixel, film, (10000.0, 117.2, BINS), DEPTH, light)
    dr.eval(film)
    dr.sync_thread()
    return film


def timed(f):
    begun = time.perf_counter()
    f()
    return time.perf_counter() - begun


def machine():
    """What this ran on."""
    model = [line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
    return {"cpu": model[0] if model else platform.processor(), "cores": os.cpu_count(), "system": platform.system()}


def slices_alone(scene, names):
    """A scene file with some of its slices, and no figures; beside the original, which it names files relative to."""
    blocks = re.split(r"(?m)^(?=\[\[)", scene.read_text())
    keep = lambda b: not b.startswith("[[figures]]") and (
        not b.startswith("[[slices]]") or any(f'name = "{name}"' in b for name in names)
    )
    return "".join(filter(keep, blocks))


def interleaved(rows, rounds):
    """Seconds of every row in every round."""
    seconds = {name: [] for name in rows}
    for seed in range(rounds):
        for name, run in rows.items():
            seconds[name].append(run(seed))
    return seconds


def cornell(stores, counts, rounds):
    """Seconds of all programs at every sample count, and megabytes."""
    mi.set_variant(SPECTRAL)
    spectral = mi.load_file(export(OUT / "spectral"))
    mi.set_variant(MONO)
    mono = mi.load_file(export(OUT / "mono", "--wavelength", "550"))

    def stokes(spp, seed):
        mi.set_variant(SPECTRAL)
        image = mi.render(spectral, spp=spp, seed=seed)
        dr.eval(image)
        dr.sync_thread()

    def mueller(spp, seed):
        mi.set_variant(MONO)
        full_mueller(mono, spp, seed)

    plain = OUT / "plain.toml"
    text = SCENE.read_text()
    plain.write_text(text[: text.index("# The complete matrix")] + '[[slices]]\nname = "plain"\n')
    seconds = {}
    for spp in counts:
        stokes(spp, 1000)
        mueller(spp, 1000)
        rows = {
            "Sunstone, complete": lambda seed: sunstone(stores, SCENE, spp, seed)[0],
            "Sunstone, plain": lambda seed: sunstone(stores, plain, spp, seed)[0],
            "Mitsuba, full-Mueller integrator": lambda seed: timed(lambda: mueller(spp, seed)),
            "Mitsuba, stokes": lambda seed: timed(lambda: stokes(spp, seed)),
        }
        seconds[spp] = interleaved(rows, rounds)
    memory = {
        "Sunstone, complete": sunstone(stores, SCENE, counts[0], 0)[1],
        "both Mitsubas": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    return seconds, memory


def mirror_room(stores, rounds):
    """Seconds of all slices and of one, on one thread and two."""
    scene = environment.ROOT / "scenes/mirror_room/scene.toml"
    one = scene.with_name("conventional_alone.toml")
    one.write_text(slices_alone(scene, ["conventional"]))
    rows = {
        f"{what}, {threads} thread{'s' * (threads > 1)}":
            lambda seed, file=file, threads=threads: sunstone(stores, file, 64, seed, threads)[0]
        for threads in (1, 2)
        for what, file in (("all nine slices", scene), ("conventional alone", one))
    }

    def twice(seed):
        """Two renders of one thread each at once, which share nothing but the machine."""
        with ThreadPoolExecutor(2) as both:
            return max(both.map(lambda k: sunstone(stores, scene, 64, 2 * seed + k, 1)[0], (0, 1)))

    rows["all nine slices, twice at once, 1 thread each"] = twice
    try:
        return interleaved(rows, rounds)
    finally:
        one.unlink()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--spp", type=int, nargs="*", default=[64, 256])
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=OUT) as stores:
        room = mirror_room(stores, options.rounds)
        seconds, memory = cornell(stores, options.spp, options.rounds)
    report = {"machine": machine(), "mitsuba": mi.__version__, "cornell_s": seconds, "peak_rss_mb": memory, "mirror_room_s": room}
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(report, indent=1) + "\n")
    show(report)


def show(report):
    """The tables."""
    print(f"{report['machine']['cpu']}, {report['machine']['cores']} cores")
    for spp, rows in report["cornell_s"].items():
        print(f"\n{f'Cornell box, {RESOLUTION}x{RESOLUTION}, {spp} spp':34} | {'best':>6} s | {'median':>6} s | Msamples/s (best)")
        best = {}
        for name, seconds in rows.items():
            best[name] = RESOLUTION**2 * int(spp) / min(seconds) / 1e6
            print(f"{name:34} | {min(seconds):8.2f} | {statistics.median(seconds):8.2f} | {best[name]:6.2f}")
        ours, integrator = best["Sunstone, complete"], best["Mitsuba, full-Mueller integrator"]
        print(f"complete against the full-Mueller integrator: {ours / integrator:.2f} (3 wavelengths against 1)")
        print(f"complete against stokes: {ours / best['Mitsuba, stokes']:.2f}")
        print(f"cost of the complete tensor: {best['Sunstone, plain'] / ours:.2f} times the plain image")
    for name, megabytes in report["peak_rss_mb"].items():
        print(f"peak memory of {name}: {megabytes:.0f} MB")
    room = {name: min(seconds) for name, seconds in report["mirror_room_s"].items()}
    print("\nmirror room, 64 spp: " + "; ".join(f"{name} {seconds:.2f} s" for name, seconds in room.items()))
    every, one = room["all nine slices, 2 threads"], room["conventional alone, 2 threads"]
    print(f"all slices cost {every / one:.2f} times the conventional image; two threads are "
          f"{room['all nine slices, 1 thread'] / every:.2f} times as fast as one")
    own = 2 * room["all nine slices, 1 thread"] / room["all nine slices, twice at once, 1 thread each"]
    print(f"two programs that share nothing do {own:.2f} times the work of one: what the machine's second core is worth")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""How fast: the same Cornell box, resolution and depth in Sunstone and in Mitsuba 3, on the same cores in one run.

Sunstone's scene is exported to Mitsuba, so that both render the same thing. Rounds are interleaved, because machines
drift; a row gives each side's best and median. Compared are

- Sunstone, complete: 3 wavelengths, all 16 Mueller elements, 256 time bins, and an s-s' slice; errors of every element;
- Sunstone, plain: 3 wavelengths, intensity alone;
- Mitsuba with the full-Mueller integrator of mueller_integrator.py: 1 wavelength, 16 elements, 256 time bins, one light;
- Mitsuba's own `stokes` over `path`: spectral, no time, one column of the matrix.

A sample is a path from the camera. Sunstone's times are those of the whole process with all files written; Mitsuba's are
of rendering alone, after a warm-up. Raw numbers go to results/speed.json. Needs LLVM.
"""

import argparse
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import time

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


def sunstone(scene, spp, seed):
    """Seconds and megabytes of a render."""
    program = [environment.sunstone(), "render", scene, "-o", OUT / "out.zarr", "--force", "--no-figures"]
    begun = time.perf_counter()
    command = [*map(str, program), "--spp", str(spp), "--seed", str(seed)]
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
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


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--spp", type=int, default=64)
    options = parser.parse_args()
    spp, samples = options.spp, RESOLUTION**2 * options.spp
    OUT.mkdir(parents=True, exist_ok=True)

    mi.set_variant(SPECTRAL)
    spectral = mi.load_file(export(OUT / "spectral"))
    mi.set_variant(MONO)
    mono = mi.load_file(export(OUT / "mono", "--wavelength", "550"))

    def stokes(seed):
        mi.set_variant(SPECTRAL)
        image = mi.render(spectral, spp=spp, seed=seed)
        dr.eval(image)
        dr.sync_thread()

    def mueller(seed):
        mi.set_variant(MONO)
        full_mueller(mono, spp, seed)

    plain = OUT / "plain.toml"
    text = SCENE.read_text()
    plain.write_text(text[: text.index("# The complete matrix")] + '[[slices]]\nname = "plain"\n')
    rows = {
        "Sunstone, complete": lambda seed: sunstone(SCENE, spp, seed)[0],
        "Sunstone, plain": lambda seed: sunstone(plain, spp, seed)[0],
        "Mitsuba, full-Mueller integrator": lambda seed: timed(lambda: mueller(seed)),
        "Mitsuba, stokes": lambda seed: timed(lambda: stokes(seed)),
    }
    for warm_up in (stokes, mueller):
        warm_up(1000)
    seconds = {name: [] for name in rows}
    for seed in range(options.rounds):
        for name, run in rows.items():
            seconds[name].append(run(seed))
    memory = {
        "Sunstone, complete": sunstone(SCENE, spp, 0)[1],
        "both Mitsubas": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    report = {"machine": machine(), "mitsuba": mi.__version__, "spp": spp, "seconds": seconds, "peak_rss_mb": memory}
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(report, indent=1) + "\n")
    show(report, samples)


def show(report, samples):
    """The table."""
    print(f"{report['machine']['cpu']}, {report['machine']['cores']} cores; {RESOLUTION}x{RESOLUTION}, {report['spp']} spp")
    print(f"{'program':34} | {'best':>6} s | {'median':>6} s | Msamples/s (best)")
    best = {}
    for name, seconds in report["seconds"].items():
        best[name] = samples / min(seconds) / 1e6
        print(f"{name:34} | {min(seconds):8.2f} | {statistics.median(seconds):8.2f} | {best[name]:6.2f}")
    for name, megabytes in report["peak_rss_mb"].items():
        print(f"peak memory of {name}: {megabytes:.0f} MB")
    ours, integrator = best["Sunstone, complete"], best["Mitsuba, full-Mueller integrator"]
    print(f"complete against the full-Mueller integrator: {ours / integrator:.2f} (3 wavelengths against 1)")
    print(f"complete against stokes: {ours / best['Mitsuba, stokes']:.2f}")
    print(f"cost of the complete tensor: {best['Sunstone, plain'] / ours:.2f} times the plain image")


if __name__ == "__main__":
    main()

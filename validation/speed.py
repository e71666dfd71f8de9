#!/usr/bin/env python3
"""Measure speed: the same Cornell box, resolution and depth in Sunstone and in Mitsuba 3, on the same cores in one run.

Sunstone's scene is exported to Mitsuba, so that both render the same scene. Rounds are interleaved because the machine's speed
drifts; a row gives each program's best and median. The rows are

- Sunstone, complete: 3 wavelengths, all 16 Mueller elements, 256 time bins, and an s-s' slice; errors of every element;
- Sunstone, plain: 3 wavelengths, intensity alone;
- Mitsuba with the full-Mueller integrator of mueller_integrator.py: 1 wavelength, 16 elements, 256 time bins, one light;
- Mitsuba's own `stokes` over `path`: spectral, no time, one column of the matrix.

A sample is a path from the camera. Sunstone's times are those of the whole process with all files written. Mitsuba's times are
those of rendering alone, after a warm-up. Two sample counts are measured: Sunstone's output has the same size for any number of
samples, so the complete tensor costs more per sample if there are few samples.

Then the mirror room is rendered: all its slices against its conventional image alone, and two threads against one. For
comparison, the script also measures two programs in parallel, because the second core of a shared machine is not always free.

With --record the numbers go to results/speed.json (result_file.py). Requires LLVM.
"""

import argparse
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor

import environment
import result_file

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import drjit as dr
    import mitsuba as mi
    import numpy as np

SCENE = environment.HERE / "speed/cornell.toml"
OUT = environment.ROOT / "target/speed"
RESOLUTION, DEPTH, BINS = 256, 6, 256
MONO, SPECTRAL = "llvm_ad_mono_polarized", "llvm_ad_spectral_polarized"


def sunstone(stores, scene, spp, seed, threads=None):
    """Return seconds and megabytes of a render, whose store stays in a folder."""
    # Each store goes to a separate folder, and all are removed at the end. Replacing a store takes time, and ext4 creates files
    # slowly where many were just removed.
    folder = tempfile.mkdtemp(dir=stores)
    program = [environment.sunstone(), "render", scene, "-o", f"{folder}/out.zarr", "--no-figures"]
    program += ["--spp", spp, "--seed", seed] + (["--threads", threads] if threads else [])
    begun = time.perf_counter()
    running = subprocess.Popen([*map(str, program)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    # The system's value for a child's memory starts with the memory of the parent from which the child was forked.
    peak = 0
    while running.poll() is None:
        peak = max(peak, high_water(running.pid))
        time.sleep(0.005)
    if running.returncode:
        sys.exit(f"sunstone render failed with exit code {running.returncode}")
    return time.perf_counter() - begun, peak


def high_water(pid):
    """Return the largest resident memory of a process so far, megabytes; 0 if it has ended."""
    try:
        with open(f"/proc/{pid}/status") as status:
            return max((int(line.split()[1]) / 1024 for line in status if line.startswith("VmHWM")), default=0)
    except OSError:
        return 0


def export(folder, *arguments):
    """Return the scene for Mitsuba."""
    program = [environment.sunstone(), "export", SCENE, "--mitsuba", folder, "--force", *arguments]
    subprocess.run([*map(str, program)], check=True, capture_output=True)
    return str(folder / "scene.xml")


def full_mueller(scene, spp, seed, sampler=None):
    """Return one render by the integrator of mueller_integrator.py, with the sensor's sampler or another."""
    from mueller_integrator import project, trace

    sensor = scene.sensors()[0]
    sampler = (sampler or sensor.sampler()).clone()
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


def slices_alone(scene, names):
    """Write a scene file with some of its slices and without figures, in the folder of the original, because its paths are
    relative.
    """
    blocks = re.split(r"(?m)^(?=\[\[)", scene.read_text())
    keep = lambda b: not b.startswith("[[figures]]") and (
        not b.startswith("[[slices]]") or any(f'name = "{name}"' in b for name in names)
    )
    return "".join(filter(keep, blocks))


def interleaved(rows, rounds):
    """Return seconds of every row in every round."""
    seconds = {name: [] for name in rows}
    for seed in range(rounds):
        for name, run in rows.items():
            seconds[name].append(run(seed))
    return seconds


def cornell(stores, counts, rounds):
    """Return seconds of all programs at every sample count, and megabytes."""
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
    """Return the seconds of all slices and of one slice, on one thread and on two threads."""
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
        """Run two single-threaded renders in parallel, which share only the machine."""
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
    parser.add_argument("--record", action="store_true", help="write results/speed.json")
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=OUT) as stores:
        room = mirror_room(stores, options.rounds)
        seconds, memory = cornell(stores, options.spp, options.rounds)
    measured = numbers(seconds, memory, room)
    show(measured, options.spp)
    if options.record:
        measures = [*result_file.TRACER, "scenes/mirror_room", "validation/speed.py", "validation/mueller_integrator.py"]
        result_file.write("speed", __file__, measures, measured, {"mitsuba": mi.__version__})


# Rows of the Cornell box: name in the result file, name in this script.
PROGRAMS = {
    "complete": "Sunstone, complete",
    "plain": "Sunstone, plain",
    "full_mueller": "Mitsuba, full-Mueller integrator",
    "stokes": "Mitsuba, stokes",
}


def numbers(cornell_s, megabytes, room):
    """Return the content of the result file: samples per second, ratios of paired rounds, memory."""
    out = {}
    for spp, seconds in cornell_s.items():
        samples = RESOLUTION**2 * int(spp) / 1e6
        for key, name in PROGRAMS.items():
            out[f"{key}_{spp}"] = result_file.rounds([samples / s for s in seconds[name]], "million samples/s", "higher")
        for key in ("full_mueller", "stokes"):
            ratio = result_file.ratio(seconds[PROGRAMS[key]], seconds[PROGRAMS["complete"]])
            out[f"complete_over_{key}_{spp}"] = ratio
        out[f"cost_of_complete_{spp}"] = result_file.ratio(seconds[PROGRAMS["complete"]], seconds[PROGRAMS["plain"]], "lower")
    for key, name in (("memory", "Sunstone, complete"), ("memory_mitsuba", "both Mitsubas")):
        out[key] = result_file.once(megabytes[name], "MiB", "one run, its greatest resident memory")
    every, one = ({t: room[f"{what}, {t} thread{'s' * (t > 1)}"] for t in (1, 2)} for what in ROOM)
    for threads in (1, 2):
        out[f"mirror_room_{threads}"] = result_file.rounds(every[threads], "s")
        out[f"cost_of_slices_{threads}"] = result_file.ratio(every[threads], one[threads], "lower")
    out["two_threads"] = result_file.ratio(every[1], every[2])
    twice = [s / 2 for s in room["all nine slices, twice at once, 1 thread each"]]
    out["two_programs"] = result_file.ratio(every[1], twice)
    return out


ROOM = ("all nine slices", "conventional alone")


def show(numbers, counts):
    """Print the tables."""
    host = result_file.machine()
    print(f"{host['processor']}, {host['cores']} cores, {host['memory_gb']} GB")
    line = lambda what, n: f"{what:56} | {n['median']:7.3f} | {n['best']:7.3f} | {n['least']:.3f} to {n['greatest']:.3f}"
    for spp in counts:
        print(f"\n{f'Cornell box, {RESOLUTION}x{RESOLUTION}, {spp} spp, million samples/s':56} | median  | best    | rounds")
        for key, name in PROGRAMS.items():
            print(line(name, numbers[f"{key}_{spp}"]))
        print(line("complete over the full-Mueller integrator", numbers[f"complete_over_full_mueller_{spp}"]))
        print(line("complete over stokes", numbers[f"complete_over_stokes_{spp}"]))
        print(line("seconds of the complete tensor over the plain image's", numbers[f"cost_of_complete_{spp}"]))
    print(f"\nmemory: {numbers['memory']['median']:.0f} MiB, both Mitsubas {numbers['memory_mitsuba']['median']:.0f} MiB")
    print(f"\n{'mirror room, 64 spp':56} | median  | best    | rounds")
    for threads in (1, 2):
        print(line(f"seconds of all nine slices, threads: {threads}", numbers[f"mirror_room_{threads}"]))
        print(line(f"  over those of the conventional image, threads: {threads}", numbers[f"cost_of_slices_{threads}"]))
    print(line("two threads over one", numbers["two_threads"]))
    print(line("work of two programs at once over one's", numbers["two_programs"]))


if __name__ == "__main__":
    main()

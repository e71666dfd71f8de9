#!/usr/bin/env python3
"""Check the speed relative to other programs, at a small size, against recorded ratios.

Every round times both programs one after the other on the same task. The ratio is the other program's time over Sunstone's, so
that a slow machine affects both (but the number of cores matters: Sunstone uses all, some of the others use one). The median over
the rounds counts. A ratio fails if it is more than 20 % below that of results/ratios.json. Before it fails, the ratio is measured
again with more rounds.

Ratios depend on the processor: Mitsuba's compiler uses AVX-512 if available, Sunstone does not, and memory speeds differ. The
file contains the ratios of each processor on which they were recorded. On any other processor, the smallest recorded ratios count.

- "Mitsuba, full-Mueller": the Cornell box of speed.py with the integrator of mueller_integrator.py, 16 elements over 256 time
  bins. Sunstone's time is that of the whole command with its files, which are in memory: they are flushed one by one, and a
  shared disk adds between 0 and 0.2 s to a command of 0.2 s;
- "mitransient": the same scene with its `transient_path`, Stokes vectors over 256 bins; Sunstone as above (16 elements for 4);
- "polanalyser": Mueller images from 36 captures, computation only;
- "muellerkit": Lu-Chipman decomposition, computation only;
- "Embree, primary" and "Embree, bounce": nearest hits of rays.py's rays on 708,000 triangles, one thread.

`--write` measures with more rounds and records those of this processor. `--power` multiplies Sunstone's times by 1.5 in every
second round and checks that each ratio fails against that of the other rounds, which have the same noise.
"""

import argparse
import datetime
import json
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import numpy as np

RESULTS = environment.HERE / "results/ratios.json"
CACHE = environment.ROOT / "target/ratios"
# Rounds in CI, rounds if a ratio would fail, rounds for recording.
ROUNDS, MORE_ROUNDS, WRITTEN_ROUNDS = 6, 12, 15
# Lowest allowed fraction of a recorded ratio, and the planted slowdown. It exceeds the floor by the noise of a dozen rounds.
FLOOR, SLOWDOWN = 0.8, 1.5


def timed(action):
    """Return the seconds of an action."""
    begun = time.perf_counter()
    action()
    return time.perf_counter() - begun


def ours(*arguments):
    """Return Sunstone's output and the seconds from its start to its end."""
    done = subprocess.run([environment.sunstone(), *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, done.args))}:\n{done.stderr}")
    return done.stdout + done.stderr


def seconds_said(pattern, text):
    """Return the seconds that Sunstone reports."""
    return float(re.search(pattern, text).group(1))


class Cornell:
    """The Cornell box of speed.py with fewer pixels, at one wavelength for Mitsuba."""

    RESOLUTION, SPP, BINS = 96, 64, (10000.0, 117.2, 256)

    def __init__(self, folder):
        environment.need_llvm("llvm_ad_mono_polarized", "")
        import mitsuba as mi

        import mueller_integrator

        mi.set_log_level(mi.LogLevel.Error)
        self.mi, self.integrator, self.folder = mi, mueller_integrator, folder
        text = (environment.HERE / "speed/cornell.toml").read_text()
        size = f"resolution = [{self.RESOLUTION}, {self.RESOLUTION}]"
        text = text.replace("resolution = [256, 256]", size, 1).replace("rows = [150]", f"rows = [{self.RESOLUTION // 2}]")
        self.file = folder / "cornell.toml"
        self.file.write_text(text)
        ours("export", self.file, "--mitsuba", folder / "mitsuba", "--force", "--wavelength", 550)
        self.xml = (folder / "mitsuba/scene.xml").read_text()
        self.scene = mi.load_file(str(folder / "mitsuba/scene.xml"))

    def ours(self, seed):
        with tempfile.TemporaryDirectory(dir=environment.in_memory() or self.folder) as store:
            command = ["render", self.file, "-o", f"{store}/out.zarr", "--no-figures", "--spp", self.SPP, "--seed", seed]
            return timed(lambda: ours(*command))

    def theirs(self, seed):
        light = (0, 0.5, 3.9), 20.0, (1, 0, 0)
        return timed(lambda: self.integrator.render(self.scene, light, 6, self.SPP, seed, self.BINS))


class Mitransient(Cornell):
    """Time-resolved light by mitransient."""

    def __init__(self, folder):
        super().__init__(folder)
        # mitransient registers its integrators and films with the current variant.
        import mitransient  # noqa: F401

        import transient

        changed = folder / "mitsuba/transient.xml"
        changed.write_text(transient.translate(self.xml, self.BINS))
        self.scene = self.mi.load_file(str(changed))

    def theirs(self, seed):
        return timed(lambda: np.array(self.mi.render(self.scene, spp=self.SPP, seed=seed)[1]))


class Polanalyser:
    """36 captures of a megapixel; Sunstone from files, polanalyser in memory; computation only, the best of three short runs."""

    def __init__(self, folder):
        import importlib.util

        # Only this module: the whole package also imports OpenCV, which is not needed for Mueller matrices.
        package = importlib.util.find_spec("polanalyser").submodule_search_locations[0]
        spec = importlib.util.spec_from_file_location("polanalyser_mueller", Path(package) / "mueller.py")
        self.polanalyser = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.polanalyser)
        self.folder = folder
        self.image = np.random.default_rng(1).random((36, 1000, 1000), dtype=np.float32)
        np.save(folder / "i.npy", self.image)
        ours("scheme", "drr", "-k", "36", "-o", folder / "s.toml")
        ours("scheme", "matrix", folder / "s.toml", "-o", folder / "a.npy")
        # Any generators and analyzers with the same design matrix are valid: its rank-one parts.
        design = np.load(folder / "a.npy").reshape(-1, 4, 4)
        self.analyzers, self.generators = np.zeros_like(design), np.zeros_like(design)
        for k, part in enumerate(design):
            u, s, v = np.linalg.svd(part)
            self.analyzers[k, 0], self.generators[k, :, 0] = u[:, 0] * s[0], v[0]

    def ours(self, _):
        command = ["reconstruct", self.folder / "i.npy", "--scheme", self.folder / "s.toml", "-o", self.folder / "m.npy"]
        return min(seconds_said(r"([0-9.]+) s of computation", ours("-v", *command)) for _ in range(3))

    def theirs(self, _):
        whole = lambda: self.polanalyser.calcMueller(self.image, self.generators, self.analyzers)
        return min(timed(whole) for _ in range(3))


class Muellerkit:
    """300,000 matrices for Sunstone, and a tenth of them, with tenfold time, for muellerkit; computation only."""

    def __init__(self, folder):
        import decompose
        import muellerkit

        self.muellerkit, self.folder = muellerkit, folder
        # decompose.py imports NumPy only when it runs as a script.
        decompose.np = np
        self.few = decompose.mixtures(30_000, np.random.default_rng(1))
        np.save(folder / "m.npy", np.tile(self.few, (10, 1, 1)))

    def ours(self, _):
        command = ["-v", "decompose", self.folder / "m.npy", "-o", self.folder / "p.npz"]
        return seconds_said(r"matrices in ([0-9.]+) s", ours(*command))

    def theirs(self, _):
        return 10 * timed(lambda: self.muellerkit.decompose_depolarizer_retarder_diattenuator(self.few))


class Rays:
    """rays.py's rays of one kind, one thread."""

    made = {}

    def __init__(self, _, kind):
        import rays

        # Both kinds are rays on the same mesh.
        folder = CACHE / "rays"
        folder.mkdir(exist_ok=True)
        # rays.py imports NumPy only when it runs as a script.
        rays.np, rays.OUT = np, folder
        if not Rays.made:
            vertices, triangles = rays.mesh()
            rays.write_ply(folder / "mesh.ply", vertices, triangles)
            embree, primary = rays.Embree(vertices, triangles), rays.primary()
            embree.trace(*primary, 1)
            Rays.made = {"embree": embree, "program": rays.bench_program(), "primary": primary,
                         "bounce": rays.bounce(*primary, embree.hits)}
        self.embree, self.rays = Rays.made["embree"], Rays.made[kind]
        self.program = rays.Sunstone(Rays.made["program"], folder / "mesh.ply", kind)

    def ours(self, _):
        return self.program.trace(*self.rays, 1)

    def theirs(self, _):
        return self.embree.trace(*self.rays, 1)


PEERS = {
    "Mitsuba, full-Mueller": Cornell,
    "mitransient": Mitransient,
    "polanalyser": Polanalyser,
    "muellerkit": Muellerkit,
    "Embree, primary": lambda folder: Rays(folder, "primary"),
    "Embree, bounce": lambda folder: Rays(folder, "bounce"),
}


class Peer:
    """A task for both programs, and their times."""

    def __init__(self, name, folder):
        self.name, self.rounds = name, []
        self.task = PEERS[name](folder)
        # The first round is a warm-up and does not count.
        self.measure(1)
        self.rounds.clear()

    def measure(self, rounds):
        """Measure more rounds, alternating the two programs."""
        for _ in range(rounds):
            seed = len(self.rounds)
            pair = [self.task.ours, self.task.theirs]
            # The order alternates, so that after-effects of one program do not always affect the other.
            taken = {f: f(seed) for f in (pair if seed % 2 else pair[::-1])}
            self.rounds.append((taken[pair[0]], taken[pair[1]]))

    def ratios(self, slowdown=1.0):
        """Return the other program's time over Sunstone's, for each round."""
        return [other / (own * slowdown) for own, other in self.rounds]


def processor():
    """Return the name of this processor, and whether it has AVX-512."""
    from result_file import machine

    flags = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    return machine()["processor"] + (", AVX-512" if "avx512f" in flags else "")


def written():
    """Return the ratios that count here, by name, and their origin: those of this processor, or the smallest of all."""
    every = json.loads(RESULTS.read_text())
    if processor() in every:
        return every[processor()]["ratios"], processor()
    names = {name for entry in every.values() for name in entry["ratios"]}
    least = lambda name: min((e["ratios"][name] for e in every.values() if name in e["ratios"]), key=lambda r: r["ratio_median"])
    return {name: least(name) for name in names}, f"the smallest of all processors, because {processor()} is not among them"


def judge(name, peer, committed):
    """Print a ratio and its floor. Return true if the ratio is not below the floor."""
    ratio, floor = statistics.median(peer.ratios()), FLOOR * committed["ratio_median"]
    if ratio < floor:
        peer.measure(MORE_ROUNDS)
        ratio = statistics.median(peer.ratios())
    good = ratio >= floor
    print(f"{name:24} {ratio:8.2f} {committed['ratio_median']:10.2f} {floor:8.2f} {len(peer.rounds):7}  "
          f"{'' if good else 'TOO SLOW'}", flush=True)
    return good


def found(name, peer):
    """Return whether the check fails for a slowdown planted in every second round. If noise hides it, measure more rounds."""
    for extra in (0, ROUNDS, MORE_ROUNDS):
        peer.measure(extra)
        # The order of the programs also alternates, so rounds are taken in pairs.
        split = [[r for i, r in enumerate(peer.ratios(s)) if i // 2 % 2 == k] for k, s in ((0, 1.0), (1, SLOWDOWN))]
        plain, slowed = map(statistics.median, split)
        if slowed < FLOOR * plain:
            print(f"{name:24} {plain:8.2f}, slowed by {SLOWDOWN}: {slowed:8.2f}, below {FLOOR * plain:8.2f}: found", flush=True)
            return True
    print(f"{name:24} {plain:8.2f}, slowed by {SLOWDOWN}: {slowed:8.2f}: NOT FOUND in {len(peer.rounds)} rounds", flush=True)
    return False


def origin():
    """Return the provenance of a result: commit, machine, date."""
    from result_file import machine

    git = subprocess.run(["git", "rev-parse", "--short=12", "HEAD"], cwd=environment.ROOT, capture_output=True, text=True)
    return {"commit": git.stdout.strip(), "machine": machine(), "date": datetime.date.today().isoformat()}


def write(peers):
    """Return the record of this processor for the result file."""
    from importlib import metadata

    packages = ["mitsuba", "mitransient", "polanalyser", "muellerkit", "embreex"]
    entries = {}
    for name, peer in peers.items():
        low, middle, high = statistics.quantiles(peer.ratios(), n=4)
        own, other = (statistics.median(side) for side in zip(*peer.rounds))
        digits = lambda value: float(f"{value:.4g}")
        entries[name] = {"ratio_median": digits(middle), "ratio_quartiles": [digits(low), digits(high)], "rounds": len(peer.rounds),
                         "ours_s_median": digits(own), "theirs_s_median": digits(other)}
    head = origin() | {"versions": {name: metadata.version(name) for name in packages}}
    every = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    every[processor()] = {"ratios": entries} | head
    RESULTS.write_text(json.dumps(every, indent=1) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="measure with more rounds and write results/ratios.json")
    parser.add_argument("--power", action="store_true", help="check that every ratio detects a planted slowdown")
    parser.add_argument("--rounds", type=int, help=f"initial number of rounds ({ROUNDS}; with --write {WRITTEN_ROUNDS})")
    parser.add_argument("--only", help="check only ratios whose name contains this text")
    options = parser.parse_args()
    names = [name for name in PEERS if not options.only or options.only in name]
    if not names or (options.write and options.only):
        sys.exit("no ratio to check" if not names else "--write records all ratios together")
    committed, whose = written() if not (options.write or options.power) else ({}, "")
    good, peers = True, {}
    CACHE.mkdir(parents=True, exist_ok=True)
    if committed:
        print(f"committed: {whose}")
        print(f"{'':24} {'ratio':>8} {'committed':>10} {'floor':>8} {'rounds':>7}")
    for name in names:
        with tempfile.TemporaryDirectory(dir=CACHE) as folder:
            peers[name] = peer = Peer(name, Path(folder))
            # The planted slowdown uses half of the rounds, in pairs.
            peer.measure(options.rounds or (WRITTEN_ROUNDS if options.write else ROUNDS + 2 * options.power))
            if options.power:
                good &= found(name, peer)
            elif not options.write and name not in committed:
                good = False
                print(f"{name:24} is not in {RESULTS.name}")
            elif not options.write:
                good &= judge(name, peer, committed[name])
            else:
                print(f"{name:24} {statistics.median(peer.ratios()):8.2f} of {len(peer.rounds)} rounds", flush=True)
    if options.write:
        write(peers)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

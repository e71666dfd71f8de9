#!/usr/bin/env python3
"""Compare participating media with Mitsuba 3's `volpath` (intensity) and mitransient's `transient_prbvolpath` (over time).

Both programs render the same clouds, which are compared pixel by pixel and bin by bin as in crosscheck.py. Exit code 0: they
agree. 1: they do not agree. 3: the check could not run. `--power` applies errors to Sunstone's results of the last run; every
error must be detected (planted.py).

Mitsuba's phase functions are scalars: scattering does not polarize. Therefore depolarizing phase functions are compared at any
depth, and Rayleigh's after one scattering of unpolarized light, where polarization is irrelevant. Behind a refracting boundary,
Sunstone's light is polarized between interfaces; the cloud there is so dense that very little light meets two interfaces in a
row. Without LLVM the script fails; with --without-llvm it checks nothing and reports this.
"""

import argparse
import sys
import time

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import mitsuba as mi
    import numpy as np

    import images
    import pairs
    import planted
    import programs
    import scenes

CACHE = environment.ROOT / "target/media"
BATCHES = 32
BLOCK = 4
# Minimum number of pairs that must be able to detect each planted error. (A wrong medium has 50 % more scattering.)
FLOORS = {"intensity 1%": 3, "intensity 6%": 8, "0.5 bin": 3, "1 bin": 3, "wrong medium": 4}
LIGHT_M_PER_PS = 299_792_458e-12


def make_scenes():
    """Return functions that make the scenes (with `times` the scattering), Sunstone's samples per pixel, and time bins, if any.

    Time bins: start and width in picoseconds, number.
    """

    class Cloudy(scenes.Scene):
        """A pair of scenes in the two formats of scenes.py, to which clouds can be added."""

        def null(self, name):
            self._material(name, "null = {}", {"type": "null"})

        def cloud(self, shape, material, scattering, absorption, phase, index=1.0):
            """Add a sphere (center, radius) or a box (min, max) of a medium; phase: "isotropic", "rayleigh" or a number g."""
            keys = {"isotropic": 'phase = "isotropic"', "rayleigh": "phase.rayleigh = {}"}
            toml = keys.get(phase, f"phase.henyey_greenstein.g = {phase}")
            theirs = {"type": phase} if phase in keys else {"type": "hg", "g": phase}
            self._toml += (f"[media.cloud.homogeneous]\nscattering = {scattering}\nabsorption = {absorption}\n"
                           f"index = {index}\n{toml}\n")
            total = scattering + absorption
            medium = {"type": "homogeneous", "sigma_t": total, "albedo": scattering / total, "phase": theirs}
            a, b = shape
            if np.isscalar(b):
                self._object(f'sphere = {{ center = {list(a)}, radius = {b} }}\ninterior = "cloud"', material,
                             {"type": "sphere", "center": list(a), "radius": b, "interior": medium})
            else:
                a, b = np.array(a, float), np.array(b, float)
                matrix = np.diag([*(b - a) / 2, 1.0])
                matrix[:3, 3] = (a + b) / 2
                self._object(f'cube = {{ min = {list(map(float, a))}, max = {list(map(float, b))} }}\n'
                             'interior = "cloud"', material,
                             {"type": "cube", "to_world": matrix, "interior": medium})

        def dictionary(self, mi):
            out = super().dictionary(mi)
            depths = {"max_depth": self.max_depth, "rr_depth": 1000}
            out["integrator"] = {"type": "volpath", **depths}
            if self.time:
                start, width, bins = self.time
                out["integrator"] = {"type": "transient_prbvolpath", **depths, "temporal_filter": "box"}
                out["sensor"]["film"] |= {
                    "type": "transient_hdr_film", "temporal_bins": bins, "start_opl": start * LIGHT_M_PER_PS,
                    "bin_width_opl": width * LIGHT_M_PER_PS}
                out["sensor"]["near_clip"] = 1e-5
            return out

    def ball(times=1, time=None):
        scene = Cloudy("ball, isotropic", True, (0.2, 0.9, 4), (0, 0, 0), 40, time)
        scene.null("none")
        scene.cloud(((0.1, 0, 0), 0.8), "none", 2.0 * times, 0.2, "isotropic")
        scene.point((0.4, 1.8, 1.5), 10.0)
        return scene

    def slab(times=1, time=None):
        scene = Cloudy("slab, g = 0.7", True, (0.2, 1.9, 3.5), (0, 0, 0), 60, time)
        scene.null("none")
        scene.cloud(((-0.9, -0.3, -0.9), (0.9, 0.3, 0.9)), "none", 6.0 * times, 0.1, 0.7)
        scene.projector((-1.5, 2.7, 1), (0, 0, 0), 40.0, 30.0)
        return scene

    def rayleigh(times=1, time=None):
        scene = Cloudy("slab, Rayleigh once", True, (0.2, 1.2, 4), (0, 0, 0), 2, time)
        scene.null("none")
        scene.cloud(((-0.9, -0.6, -0.9), (0.9, 0.6, 0.9)), "none", 0.8 * times, 0.0, "rayleigh")
        scene.point((-1.4, 1.8, 0.5), 10.0)
        return scene

    def glass(times=1, time=None):
        scene = Cloudy("ball in a box", True, (0.2, 0.9, 4), (0, -0.2, 0), 40, time)
        for name, albedo in [("grey", 0.5), ("dark", 0.2)]:
            scene.diffuse(name, albedo)
        scene.dielectric("water", 1.33)
        scenes.box(scene, "grey", "dark", "grey", "dark")
        scene.cloud(((0.1, -0.3, 0.1), 0.6), "water", 12.0 * times, 1.0, 0.3, 1.33)
        scene.point((0.4, 0.8, 1.5), 10.0)
        return scene

    def sky(times=1, time=None):
        scene = Cloudy("ball, sky", True, (0.2, 0.9, 4), (0, 0, 0), 60, time)
        scene.dielectric("water", 1.33)
        scene.cloud(((0.1, 0, 0), 0.8), "water", 9.0 * times, 0.9, -0.2, 1.33)
        scene.environment(1.0)
        return scene

    # Samples per pixel of Sunstone, time bins.
    early = (16000, 500, 24)
    return [(ball, 1024, early), (slab, 2048, early), (rayleigh, 2048, None), (glass, 512, early), (sky, 512, None)]


def ours(scene, what, spp, seed):
    """Return mean and standard error of T00, [y, x, (t,) 1]."""
    toml = CACHE / f"{'_'.join(what.replace(',', '').split())}.toml"
    toml.write_text(scene.toml())
    [(mean, error)] = programs.render(toml, spp, seed)
    return mean[0, ..., :1, 0], error[0, ..., :1, 0]


def theirs(scene, spp, seed):
    """Return renders with separate seeds, [seed, y, x, (t,) 1]."""
    loaded = mi.load_dict(scene.dictionary(mi))
    renders = []
    for i in range(BATCHES):
        done = mi.render(loaded, spp=spp, seed=seed * BATCHES + i)
        renders.append(np.array(done[1] if scene.time else done)[..., :1])
    return np.stack(renders)


def run_all(seed):
    """Render all scenes with both programs into the cache."""
    # mitransient registers its integrators and films with the current variant, so its import must follow that choice.
    import mitransient  # noqa: F401

    names, begun = [], time.monotonic()
    for make, spp, over_time in make_scenes():
        for window in dict.fromkeys([None, over_time]):
            scene = make(time=window)
            what = "over time" if window else ""
            mean, error = ours(scene, f"{scene.name} {what}", spp, seed)
            pair = pairs.Pair(scene.name, what, ["s0"], mean, error, theirs(scene, 64, seed), block=BLOCK)
            if not window:
                pair.wrong["medium"] = ours(make(1.5), f"{scene.name} wrong", spp, seed + 1000)[0]
            pair.save(CACHE)
            names.append(pair.name)
            print(f"rendered {pair.title}, {time.monotonic() - begun:.0f} s", file=sys.stderr)
    (CACHE / "pairs.txt").write_text("\n".join(names))


def print_table(rows):
    print(f"{'scene':28} {'values':>6} {'max |z|':>7} {'chi2/dof':>8} {'gain':>18} {'p-value':>8}  verdict")
    for (scene, quantity, c), passed in zip(rows, pairs.verdicts(rows), strict=True):
        what = scene + quantity.removeprefix("s0")
        print(f"{what:28} {c.pixels:6} {c.max_z:7.2f} {c.chi2_per_dof:8.3f} {c.gain:+.4f} ± {c.gain_error:.4f} {c.p:8.2g}"
              f"  {'agree' if passed else 'DIFFER'}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help="random seed for both programs")
    parser.add_argument("--cached", action="store_true", help="compare the last run's results without rendering")
    parser.add_argument("--power", action="store_true", help="use the last run's results; check that planted errors are detected")
    parser.add_argument("--without-llvm", action="store_true", help="without LLVM: check nothing, and report this")
    options = parser.parse_args()
    begun = time.monotonic()
    CACHE.mkdir(parents=True, exist_ok=True)
    if options.without_llvm:
        print("NOT CHECKED because of --without-llvm: all participating media against Mitsuba")
        return 0
    environment.need_llvm("llvm_ad_mono", "--without-llvm checks nothing.")
    if options.power:
        return 0 if planted.check(pairs.load_all(CACHE), FLOORS) else 1
    mi.set_log_level(mi.LogLevel.Error)
    if not options.cached:
        run_all(options.seed)
    results = pairs.load_all(CACHE)
    rows = pairs.compare_all(results)
    if not rows:
        print("nothing to compare: run without --cached first")
        return 1
    print_table(rows)
    good = planted.judge(results) & all(pairs.verdicts(rows))
    images.write(results, CACHE)
    print(f"\n{'agreement' if good else 'DISAGREEMENT'}, {time.monotonic() - begun:.0f} s; pictures in {CACHE}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""Cross-check Sunstone against Mitsuba 3 and mitransient: the same scenes in both, compared pixel by pixel.

The first run creates a virtual environment (.venv at the project root) and builds Sunstone if necessary. Exit code 0: both
programs agree. 1: they do not agree. 3: the check could not run (the last line gives the reason).

The comparisons cover Stokes images of scenes written by hand for both programs (scenes.py), of scene files that `sunstone export`
writes for Mitsuba, at each of their wavelengths (exported.py), under polarized light (polarized.py) and over time (transient.py).
All 16 elements of the matrix are compared with a custom integrator on top of Mitsuba (mueller_integrator.py).

Mitsuba's llvm variants are required for 16 elements and for time; on Debian 12 install them with `apt-get install libllvm19`.
Without LLVM the check fails; --scalar skips those comparisons and reports this.

For significance and the meaning of the columns see comparison.py. Images go to target/crosscheck (images.py).
"""

import argparse
import itertools
import platform
import sys
import time
from importlib import metadata

import environment
import result_file

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import mitsuba as mi
    import numpy as np

    import comparison
    import images
    import pairs
    import planted
    import programs

CACHE = environment.ROOT / "target/crosscheck"
# Minimum number of pairs that must be able to detect each planted error, with LLVM (see planted.py).
FLOORS = {
    "intensity 1%": 28,
    "intensity 6%": 29,
    "frame 0.5°": 17,
    "frame of light 0.5°": 4,
    "0.5 bin": 3,
    "1 bin": 3,
    "s1 flipped": 29,
    "s2 flipped": 29,
    "s3 flipped": 25,
    "column flipped": 4,
    "wrong wavelength": 15,
    "wrong column": 4,
}
# Images kept by --record.
KEPT = ["mirror_room_550_nm", "Cornell_box_over_time", "polarized_lamp_right_circular"]


def run_all(seed, llvm, full):
    """Render all scenes with both programs into the cache."""
    import exported
    import handwritten
    import polarized

    names, begun = [], time.monotonic()
    by_hand = handwritten.run(seed, llvm, CACHE)
    by_file = (module.run(seed, llvm, CACHE, full) for module in (exported, polarized))
    for pair in itertools.chain(by_hand, *by_file):
        pair.save(CACHE)
        names.append(pair.name)
        print(f"rendered {pair.name}, {time.monotonic() - begun:.0f} s", file=sys.stderr)
    (CACHE / "pairs.txt").write_text("\n".join(names))


def print_table(rows):
    print(f"{'scene':17} {'quantity':19} {'pixels':>6} {'max |z|':>7} {'chi2/dof':>8} {'gain':>19} {'p-value':>8}  "
          "verdict")
    for (scene, quantity, c), passed in zip(rows, pairs.verdicts(rows), strict=True):
        gain = f"{c.gain:+.4f} ± {c.gain_error:.4f}" if abs(c.gain) < 10 else "(no signal)"
        print(f"{scene:17} {quantity:19} {c.pixels:6} {c.max_z:7.2f} {c.chi2_per_dof:8.3f} {gain:>19} {c.p:8.2g}  "
              f"{'agree' if passed else 'DIFFER'}")


# Fresnel numbers -----------------------------------------------------------------------------------------------------

# Mueller matrices of CONVENTIONS.md: name, angle of incidence in degrees, index, [M00, M01, M22, M23].
PINS = [
    ("gold at 60 deg", 60, 0.4242 + 2.4721j, [0.792257, 0.102981, -0.406951, -0.671906]),
    ("glass 1.5 at 45 deg", 45, 1.5, [0.0502399, 0.0417735, -0.0279111, 0]),
    ("glass 1.5 at 0 deg", 0, 1.5, [0.04, 0, -0.04, 0]),
    ("inside glass at 60 deg", -60, 1.5, [1, 0, 0.76087, -0.648905]),
]


def check_pins():
    """Print Mitsuba's Fresnel matrices next to the project's; return True if all agree."""
    good = True
    for name, angle_deg, index, expected in PINS:
        cosine = np.cos(np.radians(angle_deg)) * (1 if angle_deg >= 0 else -1)
        m = mi.mueller.specular_reflection(float(cosine), mi.Complex2f(index.real, index.imag))
        m = np.array(m, float).reshape(4, 4)
        pairs = [(0, 0), (0, 1), (2, 2), (2, 3)]
        block = np.array([[expected[0], expected[1], 0, 0], [expected[1], expected[0], 0, 0],
                          [0, 0, expected[2], expected[3]], [0, 0, -expected[3], expected[2]]])
        same = np.allclose(m, block, atol=2e-6)
        good &= same
        values = ", ".join(f"M{i}{j} = {m[i, j]:+.6f}" for i, j in pairs)
        print(f"{name:24} {values}  {'agree' if same else 'DIFFER'}")
    return good


# Rows of the table in docs/validation.md: prefixes of scene names.
GROUPS = {
    "handwritten": ("gold, ", "mirror and glass"),
    "gold_corner": ("gold corner",),
    "mirror_room": ("mirror room",),
    "cornell_box": ("Cornell box",),
    "glass_ball": ("glass ball",),
    "measured_balls": ("measured balls",),
    "gltf_knot": ("glTF knot",),
    "polarized_lamp": ("polarized lamp",),
    "lamps": ("lamps",),
    "sky": ("sky",),
}


def numbers(table, seconds):
    """Return the content of the result file.

    For every group: the number of comparisons, the largest |z|, the smallest p, and the gain of an intensity that deviates most
    in units of its own standard error.
    """
    out = {
        "comparisons": result_file.once(len(table), "", "a count"),
        "differ": result_file.once(sum(row["verdict"] != "agree" for row in table), "", "a count"),
        "threshold": result_file.once(comparison.SIGNIFICANCE / len(table), "p", "a setting over the comparisons"),
        "seconds": result_file.once(round(seconds), "s"),
    }
    for key, names in GROUPS.items():
        rows = [row for row in table if row["scene"].startswith(names)]
        assert rows, f"no scene of {key}"
        out[f"{key}_comparisons"] = result_file.once(len(rows), "", "a count")
        out[f"{key}_z"] = result_file.once(max(row["max_z"] for row in rows), "standard errors", "greatest of all pixels")
        out[f"{key}_p"] = result_file.once(min(row["p"] for row in rows), "", "least of the comparisons")
        known = [row for row in rows if row["gain_error"] and row["quantity"].startswith(("s0", "T00"))]
        worst = max(known, key=lambda row: abs(row["gain"]) / row["gain_error"])
        out[f"{key}_gain"] = result_file.estimate(worst["gain"], worst["gain_error"], "Sunstone / other - 1")
    return out


def record(rows, seconds):
    """Write the numbers with their provenance, and some of the images, to the repository."""
    import shutil

    packages = ["mitsuba", "mitransient", "drjit", "numpy"]
    finite = lambda x: result_file.significant(x) if abs(x) < 1e9 else None
    table = [
        {"scene": scene, "quantity": quantity, "pixels": c.pixels, "max_z": finite(c.max_z),
         "chi2_per_dof": finite(c.chi2_per_dof), "gain": finite(c.gain), "gain_error": finite(c.gain_error),
         "p": finite(c.p), "verdict": "agree" if passed else "differ"}
        for (scene, quantity, c), passed in zip(rows, pairs.verdicts(rows), strict=True)
    ]
    versions = {name: metadata.version(name) for name in packages} | {"python": platform.python_version(), "variant": mi.variant()}
    exchange = ["src/scene/mitsuba", "src/import"]
    own = ["scenes/mirror_room", "validation/scenes_crosscheck", "validation/crosscheck.py"]
    measures = [*result_file.TRACER, *exchange, *own]
    result_file.write("crosscheck", __file__, measures, numbers(table, seconds), versions, table)
    for name in KEPT:
        shutil.copy(CACHE / f"{name}.png", result_file.RESULTS)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cached", action="store_true", help="compare the last run's results without rendering")
    parser.add_argument("--scalar", action="store_true", help="use Mitsuba's scalar variant, without LLVM; skip comparisons")
    parser.add_argument("--full", action="store_true", help="use four times the samples in the exported scenes")
    parser.add_argument("--seed", type=int, default=1, help="random seed for both programs")
    parser.add_argument("--record", action="store_true", help="write results/crosscheck.json and a few pictures")
    parser.add_argument("--power", action="store_true", help="use the last run's results; check that planted errors are detected")
    options = parser.parse_args()
    begun = time.monotonic()
    CACHE.mkdir(parents=True, exist_ok=True)
    llvm = not options.scalar
    if options.power:
        mi.set_variant("scalar_spectral_polarized")
        return 0 if planted.check(pairs.load_all(CACHE), FLOORS if llvm else {}) else 1
    if llvm:
        environment.need_llvm("llvm_ad_mono_polarized", "--scalar checks Stokes images alone.")
    else:
        mi.set_variant("scalar_spectral_polarized")
    mi.set_log_level(mi.LogLevel.Error)
    print(f"Mitsuba {mi.__version__}, variant {mi.variant()}\n")
    good = check_pins()
    if not options.cached:
        run_all(options.seed, llvm, options.full)
    results = pairs.load_all(CACHE)
    rows = pairs.compare_all(results)
    if not rows:
        print("nothing to compare: run without --cached first")
        return 1
    print()
    print_table(rows)
    good &= planted.judge(results)
    if not llvm:
        print("\nNOT CHECKED, as --scalar was given: all 16 elements, and light over time")
    images.write(results, CACHE)
    good &= all(pairs.verdicts(rows))
    seconds = time.monotonic() - begun
    if options.record:
        record(rows, seconds)
    print(f"\n{'agreement' if good else 'DISAGREEMENT'} at significance {comparison.SIGNIFICANCE} over "
          f"{len(rows)} comparisons, {seconds:.0f} s; pictures in {CACHE}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

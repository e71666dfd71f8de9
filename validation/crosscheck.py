#!/usr/bin/env python3
"""Cross-check of Sunstone against Mitsuba 3: the same scenes in both programs, compared pixel by pixel.

Makes its own virtual environment (.venv at the project root) on the first run, and builds Sunstone if need be. Exit
code 0: they agree. 1: they do not, or trouble on the way (the last line says which).

Mitsuba's llvm variants are faster and are needed for the 16-element comparison; on Debian 12 they are had with
`apt-get install libllvm19`. Without it the scalar variant is used and that comparison is skipped.

Significance, and what the columns mean: see comparison.py. Which scenes: see scenes.py.
"""

import argparse
import os
import subprocess
import sys
import time

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import mitsuba as mi
    import numpy as np
    import xarray

    import comparison
    import scenes

CACHE = environment.ROOT / "target/crosscheck"
BATCHES = 64
OURS_SPP = 4096
BLOCK = 4


# Running both programs -----------------------------------------------------------------------------------------------


def render_ours(scene, seed):
    """Means and standard errors of T, [y, x, (t,) out, in]."""
    stem = CACHE / scene.name.replace(", ", "_").replace(" ", "_")
    stem.with_suffix(".toml").write_text(scene.toml())
    store = stem.with_suffix(".zarr")
    command = [environment.sunstone(), "render", stem.with_suffix(".toml"), "-o", store, "--force", "--seed", str(seed)]
    command += ["--spp", str(OURS_SPP), "--no-figures"]
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode:
        print(run.stderr, file=sys.stderr)
        sys.exit(3)
    data = xarray.open_zarr(store, group="mueller", consolidated=False).isel(wavelength=0)
    return data["mean"].values.astype(np.float64), data["std_error"].values.astype(np.float64)


def render_theirs(scene, seed, llvm):
    """Mitsuba's Stokes images of many seeds, in its own frames: [seed, y, x, stokes]."""
    loaded = mi.load_dict(scene.dictionary(mi))
    spp = 128 if llvm else 24
    # What Mitsuba shows for a radiance of 1: exactly 1 in the mono variant, but 1.00094 ± 0.00005 in the scalar one (from
    # its conversion of spectra to colours, by all appearance), and that is no matter of light transport.
    empty = scenes.Scene("empty", llvm, scene.origin, scene.target, max_depth=2)
    empty.environment(1.0)
    white = luminance(np.array(mi.render(mi.load_dict(empty.dictionary(mi)), spp=512, seed=seed)))[..., 0].mean()
    images = np.stack([np.array(mi.render(loaded, spp=spp, seed=seed * BATCHES + i)) for i in range(BATCHES)])
    return luminance(images) / white


def luminance(images):
    """The values of Stokes images as Mitsuba stores them."""
    # Channels: colour of the nested integrator (with alpha, if any), then S0, S1, S2, S3 in R, G, B. All spectra are
    # constant, so that luminance is their value. (Scalar Mitsuba samples wavelengths, and R, G, B are those of equal
    # energy, which is not white.)
    return images[..., -12:].reshape(*images.shape[:-1], 4, 3) @ [0.212671, 0.715160, 0.072169]


def frame_angles(scene):
    """Angle from Mitsuba's Stokes frame to ours at the pixel centres, counter-clockwise looking toward the source.

    Mitsuba's `stokes` integrator takes cross(ray, camera up) as horizontal; Sunstone takes camera right, projected
    perpendicular to the ray. They agree on the axis and differ by about x y / z^2 off it.
    """
    ray = scene.pixel_directions()
    right, up, _ = scene.camera_axes()
    unit = lambda v: v / np.linalg.norm(v, axis=-1, keepdims=True)
    theirs = unit(np.cross(ray, up))
    ours = unit(right - ray * (ray @ right)[..., None])
    travel = -ray
    return np.arctan2((ours * np.cross(travel, theirs)).sum(-1), (ours * theirs).sum(-1))


def rotate(stokes, angle):
    """Stokes vectors in a basis turned by `angle`."""
    s0, s1, s2, s3 = np.moveaxis(stokes, -1, 0)
    c, s = np.cos(2 * angle), np.sin(2 * angle)
    return np.stack([s0, c * s1 + s * s2, -s * s1 + c * s2, s3], axis=-1)


def run_all(seed, llvm):
    """Renders everything with both programs, into the cache."""
    if llvm:
        import masking
        import mueller_integrator

        masking.register()
    for make in scenes.STOKES:
        scene = make(llvm)
        mean, error = render_ours(scene, seed)
        save(scene, mean[..., 0], error[..., 0], render_theirs(scene, seed, llvm))
    scene = scenes.corner(llvm)
    if llvm:
        loaded = mi.load_dict(scene.dictionary(mi))
        batches = [mueller_integrator.render(scene, loaded, 64, seed * BATCHES + i) for i in range(BATCHES)]
        save(scene, *render_ours(scene, seed), np.stack(batches))
    else:
        path(scene).unlink(missing_ok=True)


def path(scene):
    return CACHE / f"{scene.name}.npz"


def save(scene, ours, ours_error, theirs):
    np.savez(path(scene), ours=ours, ours_error=ours_error, theirs=theirs)


# Comparing -----------------------------------------------------------------------------------------------------------

# Mistakes to be found by the power check, as changes of our image; Stokes elements are the last axis (or, with all 16,
# the last but one). The frame is that of Mitsuba's images.
SABOTAGE = {
    "s1": lambda m: flip(m, 1),
    "s2": lambda m: flip(m, 2),
    "s3": lambda m: flip(m, 3),
    "intensity": lambda m: 1.01 * m,
    "frame": None,
}


def flip(stokes, i):
    return stokes * np.where(np.arange(4) == i, -1.0, 1.0)


def compare_all(sabotage=None):
    """Rows of the table: scene, quantity, outcome (None: skipped)."""
    rows = []
    change = SABOTAGE.get(sabotage) or (lambda m: m)
    for make in scenes.STOKES:
        scene = make()
        data = np.load(path(scene))
        angle = frame_angles(scene) * (0 if sabotage == "frame" else 1)
        theirs, error = comparison.mean_and_error(rotate(data["theirs"], angle))
        rows += compare_elements(scene, [f"s{i}" for i in range(4)], change(data["ours"]), data["ours_error"], theirs, error)
    scene = scenes.corner()
    if path(scene).exists():
        data = np.load(path(scene))
        # Few samples fall into one time bin of one pixel, too few for Gaussian errors: hence blocks of pixels.
        theirs, error = comparison.mean_and_error(block_means(data["theirs"]))
        ours, ours_error = block_means(data["ours"]), np.sqrt(block_means(data["ours_error"] ** 2)) / BLOCK
        ours = np.swapaxes(change(np.swapaxes(ours, -1, -2)), -1, -2)
        flat = lambda a: a.reshape(*a.shape[:-2], 16)
        names = [f"T{i}{j} over time" for i in range(4) for j in range(4)]
        rows += compare_elements(scene, names, *(flat(a) for a in (ours, ours_error, theirs, error)))
    else:
        rows.append((scene.name, "16 elements over time", None))
    return rows


def block_means(images):
    """Means over squares of BLOCK x BLOCK pixels of [..., y, x, t, out, in]."""
    *seeds, h, w, t, m, n = images.shape
    return images.reshape(*seeds, h // BLOCK, BLOCK, w // BLOCK, BLOCK, t, m, n).mean(axis=(-6, -4))


def compare_elements(scene, names, ours, ours_error, theirs, theirs_error):
    scale = np.abs(theirs).max()
    return [
        (scene.name, name,
         comparison.compare(ours[..., i], ours_error[..., i], theirs[..., i], theirs_error[..., i], BATCHES, scale))
        for i, name in enumerate(names)
    ]


def verdicts(rows):
    """Whether each row passes, at SIGNIFICANCE over all rows together."""
    limit = comparison.SIGNIFICANCE / sum(row is not None for *_, row in rows)
    return [row is None or row.p >= limit for *_, row in rows]


def print_table(rows):
    print(f"{'scene':20} {'quantity':16} {'pixels':>6} {'max |z|':>7} {'chi2/dof':>8} {'gain':>19} {'p-value':>8}  verdict")
    for (scene, quantity, c), passed in zip(rows, verdicts(rows), strict=True):
        if c is None:
            print(f"{scene:20} {quantity}: skipped, no LLVM")
            continue
        gain = f"{c.gain:+.4f} ± {c.gain_error:.4f}"
        print(f"{scene:20} {quantity:16} {c.pixels:6} {c.max_z:7.2f} {c.chi2_per_dof:8.3f} {gain:>19} {c.p:8.2g}  "
              f"{'agree' if passed else 'DIFFER'}")


# Fresnel numbers -----------------------------------------------------------------------------------------------------

# Mueller matrices of CONVENTIONS.md: name, cosine of incidence, index, [M00, M01, M22, M23].
PINS = [
    ("gold at 60 deg", 60, 0.4242 + 2.4721j, [0.792257, 0.102981, -0.406951, -0.671906]),
    ("glass 1.5 at 45 deg", 45, 1.5, [0.0502399, 0.0417735, -0.0279111, 0]),
    ("glass 1.5 at 0 deg", 0, 1.5, [0.04, 0, -0.04, 0]),
    ("inside glass at 60 deg", -60, 1.5, [1, 0, 0.76087, -0.648905]),
]


def check_pins():
    """Prints Mitsuba's Fresnel matrices beside the project's; True if all agree."""
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


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cached", action="store_true", help="compare the last run's results, render nothing")
    parser.add_argument("--scalar", action="store_true", help="use Mitsuba's scalar variant even if there is LLVM")
    parser.add_argument("--seed", type=int, default=1, help="other random numbers in both programs")
    parser.add_argument("--sabotage", nargs="?", const="s3", choices=list(SABOTAGE), help="falsify our side: must fail")
    parser.add_argument("--power", action="store_true", help="with the last run's results: every sabotage must be found")
    options = parser.parse_args()
    begun = time.monotonic()
    CACHE.mkdir(parents=True, exist_ok=True)
    if options.power:
        return power()
    llvm = "DRJIT_LIBLLVM_PATH" in os.environ and not options.scalar
    mi.set_variant("llvm_ad_mono_polarized" if llvm else "scalar_spectral_polarized")
    mi.set_log_level(mi.LogLevel.Error)
    print(f"Mitsuba {mi.__version__}, variant {mi.variant()}\n")
    good = check_pins()
    if not options.cached:
        run_all(options.seed, llvm)
    print()
    rows = compare_all(options.sabotage)
    print_table(rows)
    good &= all(verdicts(rows))
    print(f"\n{'agreement' if good else 'DISAGREEMENT'} at significance {comparison.SIGNIFICANCE} over "
          f"{len(rows)} comparisons, {time.monotonic() - begun:.0f} s")
    return 0 if good else 1


def power():
    """Falsifies the last run's results in every way, and says which comparisons notice."""
    good = True
    for name in SABOTAGE:
        rows = compare_all(name)
        found = [f"{scene}: {quantity}" for (scene, quantity, _), ok in zip(rows, verdicts(rows), strict=True) if not ok]
        good &= bool(found)
        print(f"{name:10} {'found by ' + str(len(found)) + ' comparisons, first ' + found[0] if found else 'NOT FOUND'}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

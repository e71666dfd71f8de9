#!/usr/bin/env python3
"""Check the exchange of scenes with Mitsuba 3: Mitsuba renders what `sunstone export --mitsuba` writes.

Exports the scenes of `scenes_exchange/`, loads each with `mi.load_file`, renders its Stokes images with both programs, and
compares them pixel by pixel (comparison.py). Imports the hand-written scene `by_hand.xml` and compares it in the same way.
Exports, imports and exports again; both exports must give the same XML. Every exported scene must also load, and render without a
NaN, in the spectral variant (a scene with images of light: in the variant of one wavelength).

`--power` applies errors to Sunstone's images of the last run and checks that each is detected (planted.py). Without LLVM the
script fails; with --without-llvm it checks nothing and reports this.
"""

import argparse
import re
import subprocess
import sys

import environment

if not {"-h", "--help"} & set(sys.argv):
    if __name__ == "__main__":
        environment.enter()
    import mitsuba as mi
    import numpy as np
    import xarray

    import frames
    import pairs
    import planted

HERE = environment.HERE / "scenes_exchange"
OUT = environment.ROOT / "target/exchange"
BATCHES = 32
THEIR_SPP = 128
OUR_SPP = 2048
# Minimum number of pairs that must be able to detect each planted error.
FLOORS = {"intensity 1%": 2, "intensity 6%": 3, "frame 0.5°": 2, "s1 flipped": 3, "s2 flipped": 3, "s3 flipped": 3}
MONO, SPECTRAL = "llvm_ad_mono_polarized", "llvm_ad_spectral_polarized"
SCENES = [HERE / "cornell.toml", HERE / "room.toml", HERE / "parallel.toml", environment.ROOT / "scenes/mirror_room/scene.toml"]


def run(*arguments):
    """Run Sunstone; stop on failure."""
    done = subprocess.run([environment.sunstone(), *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"sunstone {' '.join(map(str, arguments))}\n{done.stderr}")
    return done


def ours(toml, name, seed):
    """Return mean and standard error of column 0 of the Mueller image, [y, x, 4]."""
    store = OUT / f"{name}.zarr"
    run("render", toml, "-o", store, "--force", "--seed", seed, "--spp", OUR_SPP, "--no-figures",
        "--integrator", "path")
    data = xarray.open_zarr(store, group="mueller", consolidated=False).isel(wavelength=0, stokes_in=0)
    return data["mean"].values.astype(float), data["std_error"].values.astype(float)


def theirs(xml, seed):
    """Return Mitsuba's Stokes images of several seeds, [seed, y, x, 4], and the angle from its frames to Sunstone's."""
    environment.need_llvm(MONO, "")
    scene = mi.load_file(str(xml))
    images = [np.array(mi.render(scene, spp=THEIR_SPP, seed=seed * BATCHES + i)) for i in range(BATCHES)]
    # The last channels are S0, S1, S2, S3, each in R, G, B, which are equal.
    images = np.stack(images)[..., -12:].reshape(BATCHES, *images[0].shape[:2], 4, 3)[..., 0]
    return images, frames.angles(scene.sensors()[0])


def run_all(seed):
    """Render all scenes with both programs into the cache."""
    elements, names = [f"s{i}" for i in range(4)], []
    for name, mean, error, (images, angle) in rendered(seed):
        pair = pairs.Pair(name, "", elements, mean, error, images, angle)
        pair.save(OUT)
        names.append(pair.name)
    (OUT / "pairs.txt").write_text("\n".join(names))


def rendered(seed):
    """Yield for each scene the name, Sunstone's mean and error, and Mitsuba's images and frames."""
    for toml in SCENES[:3]:
        folder = OUT / toml.stem
        run("export", toml, "--mitsuba", folder, "--force")
        yield f"{toml.stem}, exported", *ours(toml, toml.stem, seed), theirs(folder / "scene.xml", seed)
    back = OUT / "by_hand.toml"
    run("import", HERE / "by_hand.xml", "-o", back, "--force", "-D", "wavelengths_nm=550")
    yield "by hand, imported", *ours(back, "by_hand", seed), theirs(HERE / "by_hand.xml", seed)


def check_loading():
    """Check that every exported scene loads and renders at all its wavelengths, and that the XML survives a round trip."""
    good = True
    for toml in SCENES:
        # Images of light contain plain numbers, which Mitsuba's spectral variants refuse.
        variant = MONO if toml.stem == "parallel" else SPECTRAL
        environment.need_llvm(variant, "--without-llvm checks nothing.")
        name = toml.parent.name if toml.stem == "scene" else toml.stem
        folder, again = OUT / f"{name}_spectral", OUT / f"{name}_again"
        run("export", toml, "--mitsuba", folder, "--force")
        run("import", folder / "scene.xml", "-o", folder / "back.toml", "--force")
        run("export", folder / "back.toml", "--mitsuba", again, "--force")
        same = plain(folder) == plain(again)
        finite = np.isfinite(np.array(mi.render(mi.load_file(str(folder / "scene.xml")), spp=1))).all()
        print(f"{name:20} loads in {variant}: {'yes' if finite else 'NaN'}; round trip: {'same' if same else 'DIFFERS'}")
        good &= bool(same and finite)
    return good


def plain(folder):
    """Return the XML without comments and ids, with numbers rounded to six digits."""
    text = re.sub(r"<!--.*?-->|id=\"[^\"]*\"|<float name=\"fov\"[^>]*>", "", (folder / "scene.xml").read_text())
    text = re.sub(r"[A-Za-z0-9_-]+\.(png|ply|exr)", "file", text)
    round6 = lambda m: f"{float(m[0]):.5g}".replace("-0", "0") if abs(float(m[0])) > 1e-6 else "0"
    text = re.sub(r"(?<![\w.])-?\d+(\.\d+)?(e-?\d+)?(?![\w.])", round6, text)
    return [line.strip() for line in text.splitlines() if line.strip()]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--power", action="store_true", help="use the last run's results; check that planted errors are detected")
    parser.add_argument("--without-llvm", action="store_true", help="without LLVM: check nothing, and report this")
    options = parser.parse_args()
    if options.without_llvm:
        print("NOT CHECKED because of --without-llvm: renders of exported scenes by Mitsuba")
        return 0
    OUT.mkdir(parents=True, exist_ok=True)
    if options.power:
        mi.set_variant("scalar_spectral_polarized")
        return 0 if planted.check(pairs.load_all(OUT), FLOORS) else 1
    good = check_loading()
    run_all(options.seed)
    results = pairs.load_all(OUT)
    rows = pairs.compare_all(results)
    print(f"{'scene':20} {'':3} {'max |z|':>7} {'chi2/dof':>8} {'gain':>19} {'p-value':>8}")
    for (scene, element, c), passed in zip(rows, pairs.verdicts(rows), strict=True):
        good &= passed
        gain = f"{c.gain:+.4f} ± {c.gain_error:.4f}"
        print(f"{scene:20} {element:3} {c.max_z:7.2f} {c.chi2_per_dof:8.3f} {gain:>19} {c.p:8.2g}  "
              f"{'agree' if passed else 'DIFFER'}")
    good &= planted.judge(results)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

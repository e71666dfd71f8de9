#!/usr/bin/env python3
"""Scenes to Mitsuba 3 and back: what `sunstone export --mitsuba` writes, rendered by Mitsuba itself.

Exports the scenes of `scenes_exchange/`, loads each with `mi.load_file`, renders its Stokes images there and here, and
compares them pixel by pixel (comparison.py). Imports `by_hand.xml`, a scene as people write them, and compares likewise;
and exports, imports and exports again, which must give the same XML. Every exported scene must also load, and render
without a NaN, in the spectral variant.

`--power` plants mistakes in our images and checks that each is found. Needs LLVM, as crosscheck.py's full run.
"""

import argparse
import re
import subprocess
import sys

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import mitsuba as mi
    import numpy as np
    import xarray

    import comparison
    import frames

HERE = environment.HERE / "scenes_exchange"
OUT = environment.ROOT / "target/exchange"
BATCHES = 32
THEIR_SPP = 128
OUR_SPP = 2048
MONO, SPECTRAL = "llvm_ad_mono_polarized", "llvm_ad_spectral_polarized"
SCENES = [HERE / "cornell.toml", HERE / "room.toml", environment.ROOT / "scenes/mirror_room/scene.toml"]


def run(*arguments):
    """Runs Sunstone; stops on failure."""
    done = subprocess.run([environment.sunstone(), *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"sunstone {' '.join(map(str, arguments))}\n{done.stderr}")
    return done


def ours(toml, name, seed):
    """Mean and standard error of column 0 of the Mueller image, [y, x, 4]."""
    store = OUT / f"{name}.zarr"
    run("render", toml, "-o", store, "--force", "--seed", seed, "--spp", OUR_SPP, "--no-figures")
    data = xarray.open_zarr(store, group="mueller", consolidated=False).isel(wavelength=0, stokes_in=0)
    return data["mean"].values.astype(float), data["std_error"].values.astype(float)


def theirs(xml, seed):
    """Mitsuba's Stokes images of several seeds in Sunstone's frames, [seed, y, x, 4]."""
    mi.set_variant(MONO)
    scene = mi.load_file(str(xml))
    images = [np.array(mi.render(scene, spp=THEIR_SPP, seed=seed * BATCHES + i)) for i in range(BATCHES)]
    # Last come S0, S1, S2, S3, each in R, G, B, which are equal.
    images = np.stack(images)[..., -12:].reshape(BATCHES, *images[0].shape[:2], 4, 3)[..., 0]
    return frames.rotate(images, frames.angles(scene.sensors()[0]))


def pairs(seed):
    """Name, our mean and error, their images: of each scene that both render."""
    for toml in SCENES[:2]:
        folder = OUT / toml.stem
        run("export", toml, "--mitsuba", folder, "--force")
        yield f"{toml.stem}, exported", *ours(toml, toml.stem, seed), theirs(folder / "scene.xml", seed)
    back = OUT / "by_hand.toml"
    run("import", HERE / "by_hand.xml", "-o", back, "--force", "-D", "wavelengths_nm=550")
    yield "by hand, imported", *ours(back, "by_hand", seed), theirs(HERE / "by_hand.xml", seed)


def check_loading():
    """That every exported scene loads and renders at all its wavelengths, and that the XML survives a round trip."""
    good = True
    mi.set_variant(SPECTRAL)
    for toml in SCENES:
        name = toml.parent.name if toml.stem == "scene" else toml.stem
        folder, again = OUT / f"{name}_spectral", OUT / f"{name}_again"
        run("export", toml, "--mitsuba", folder, "--force")
        run("import", folder / "scene.xml", "-o", folder / "back.toml", "--force")
        run("export", folder / "back.toml", "--mitsuba", again, "--force")
        same = plain(folder) == plain(again)
        finite = np.isfinite(np.array(mi.render(mi.load_file(str(folder / "scene.xml")), spp=1))).all()
        print(f"{name:20} loads in {SPECTRAL}: {'yes' if finite else 'NaN'}; round trip: {'same' if same else 'DIFFERS'}")
        good &= bool(same and finite)
    return good


def plain(folder):
    """The XML without comments and ids, numbers to six digits."""
    text = re.sub(r"<!--.*?-->|id=\"[^\"]*\"|<float name=\"fov\"[^>]*>", "", (folder / "scene.xml").read_text())
    text = re.sub(r"[A-Za-z0-9_-]+\.(png|ply)", "file", text)
    round6 = lambda m: f"{float(m[0]):.5g}".replace("-0", "0") if abs(float(m[0])) > 1e-6 else "0"
    text = re.sub(r"(?<![\w.])-?\d+(\.\d+)?(e-?\d+)?(?![\w.])", round6, text)
    return [line.strip() for line in text.splitlines() if line.strip()]


SABOTAGE = {
    "s1": [1, -1, 1, 1],
    "s2": [1, 1, -1, 1],
    "s3": [1, 1, 1, -1],
    "intensity": [1.01] * 4,
}


def compare(results, change):
    """Rows: scene, element, outcome."""
    for name, mean, error, images in results:
        there, there_error = comparison.mean_and_error(images)
        scale = np.abs(there).max()
        for i in range(4):
            pair = mean[..., i] * change[i], error[..., i], there[..., i], there_error[..., i]
            yield name, f"s{i}", comparison.compare(*pair, BATCHES, scale)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--power", action="store_true", help="check that planted mistakes are found")
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    good = check_loading()
    results = list(pairs(options.seed))
    rows = list(compare(results, [1] * 4))
    limit = comparison.SIGNIFICANCE / len(rows)
    print(f"{'scene':20} {'':3} {'max |z|':>7} {'chi2/dof':>8} {'gain':>19} {'p-value':>8}")
    for scene, element, c in rows:
        good &= c.p >= limit
        gain = f"{c.gain:+.4f} ± {c.gain_error:.4f}"
        print(f"{scene:20} {element:3} {c.max_z:7.2f} {c.chi2_per_dof:8.3f} {gain:>19} {c.p:8.2g}  "
              f"{'agree' if c.p >= limit else 'DIFFER'}")
    if options.power:
        for mistake, change in SABOTAGE.items():
            found = any(c.p < limit for *_, c in compare(results, change))
            print(f"planted mistake in {mistake}: {'found' if found else 'NOT FOUND'}")
            good &= found
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()

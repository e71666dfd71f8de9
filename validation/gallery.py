#!/usr/bin/env python3
"""Compare twelve scenes written for Mitsuba 3 after its documentation, imported unchanged and rendered by both programs.

`sunstone import` and `mi.load_file` read each file of `scenes_gallery/`; the Stokes images of both programs are compared pixel by
pixel (comparison.py). The script generates the meshes, the images and the included file that the scenes name. If Sunstone reports
that a model of Mitsuba becomes its nearest polarized model (roughplastic), only s0 is compared. Exits with 1 if a scene differs.

`--power` applies errors to Sunstone's images of the last run and checks that each is detected (planted.py). Requires LLVM.
"""

import argparse
import shutil
import sys

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import mitsuba as mi
    import numpy as np

    import exchange
    import frames
    import pairs
    import planted

HERE = environment.HERE / "scenes_gallery"
OUT = environment.ROOT / "target/gallery"
FLOORS = {"intensity 1%": 6, "intensity 6%": 9, "frame 0.5°": 3, "s1 flipped": 5, "s2 flipped": 5, "s3 flipped": 4}
MONO = "llvm_ad_mono_polarized"
# Scenes of which only s0 is compared.
BRIGHTNESS = {"plastics"}
SLICE = '\n[[slices]]\nname = "mueller"\npolarization = "mueller"\n'


def assets(folder):
    """Generate the files that the scenes name."""
    (folder / "assets").mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(7)
    for xml in HERE.glob("*.xml"):
        shutil.copy(xml, folder)
    theta, phi = np.meshgrid(np.pi * (np.arange(256) + 0.5) / 256, 2 * np.pi * (np.arange(512) + 0.5) / 512, indexing="ij")
    sun = np.exp(8 * (np.sin(theta) * np.cos(phi - 1) * np.sin(0.9) + np.cos(theta) * np.cos(0.9) - 1))
    sky = (0.3 + 0.2 * np.cos(theta) + 5 * sun)[..., None].repeat(3, axis=-1)
    mi.Bitmap(sky.astype(np.float32)).write(str(folder / "sky.exr"))
    grain = rng.integers(40, 255, (6, 4, 1), np.uint8).repeat(3, axis=2)
    mi.Bitmap(grain).write(str(folder / "assets/grain.png"))
    x, y = np.meshgrid(np.linspace(0, 4 * np.pi, 64), np.linspace(0, 2 * np.pi, 64))
    normals = np.stack([0.2 * np.sin(x), 0.2 * np.sin(y), np.ones_like(x)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    mi.Bitmap(np.round((normals + 1) / 2 * 65535).astype(np.uint16)).write(str(folder / "assets/waves.png"))
    shutil.copy(environment.ROOT / "scenes/mirror_room/pedestal.obj", folder / "assets")
    exchange.run("export", environment.HERE / "scenes_crosscheck/knot.toml", "--mitsuba", folder / "knot", "--force",
                 "--wavelength", 550)
    shutil.copy(next((folder / "knot").glob("mesh_*.ply")), folder / "knot.ply")
    places = [
        (1.0 * (i % 12 - 5.5) + 0.3 * dx, 4 - 1.0 * (i // 12) + 0.3 * dz, 360 * turn, 1 + 0.5 * size)
        for i, (dx, dz, turn, size) in enumerate(rng.random((96, 4)))
    ]
    instances = "".join(
        f'<shape type="instance"><ref id="tree"/><transform name="to_world"><scale value="{s:.4f}"/>'
        f'<rotate y="1" angle="{a:.3f}"/><translate x="{x:.4f}" z="{z:.4f}"/></transform></shape>\n'
        for x, z, a, s in places
    )
    (folder / "forest_instances.xml").write_text(f'<scene version="3.0.0">\n{instances}</scene>\n')


def run_all(seed):
    """Import all scenes, and render them with both programs into the cache."""
    exchange.OUT = OUT
    assets(OUT)
    names = []
    for xml in sorted(HERE.glob("*.xml")):
        toml = OUT / f"{xml.stem}.toml"
        done = exchange.run("import", OUT / xml.name, "-o", toml, "--force", "-D", "wavelengths_nm=550")
        for note in done.stderr.splitlines():
            print(f"{xml.stem}: {note}")
        text = toml.read_text()
        if "[[slices]]" not in text:
            toml.write_text(text + SLICE)
        mean, error = exchange.ours(toml, xml.stem, seed)
        # Both programs use single precision: light that is seen directly has no other error.
        error = np.hypot(error, 2e-5 * np.abs(mean[..., :1]))
        images, angle = exchange.theirs(OUT / xml.name, seed)
        count = 1 if xml.stem in BRIGHTNESS else 4
        pair = pairs.Pair(xml.stem.replace("_", " "), "", [f"s{i}" for i in range(count)], mean[..., :count],
                          error[..., :count], images[..., :count], angle if count == 4 else None, 2)
        pair.save(OUT)
        names.append(pair.name)
    (OUT / "pairs.txt").write_text("\n".join(names))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--power", action="store_true", help="use the last run's results; check that planted errors are detected")
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    if options.power:
        mi.set_variant("scalar_spectral_polarized")
        return 0 if planted.check(pairs.load_all(OUT), FLOORS) else 1
    environment.need_llvm(MONO, "Nothing can be compared.")
    mi.set_log_level(mi.LogLevel.Error)
    run_all(options.seed)
    results = pairs.load_all(OUT)
    rows = pairs.compare_all(results)
    good = True
    print(f"{'scene':20} {'':3} {'max |z|':>7} {'chi2/dof':>8} {'gain':>19} {'p-value':>8}")
    for (scene, element, c), passed in zip(rows, pairs.verdicts(rows), strict=True):
        good &= passed
        gain = f"{c.gain:+.4f} ± {c.gain_error:.4f}" if abs(c.gain) < 10 else "(no signal)"
        print(f"{scene:20} {element:3} {c.max_z:7.2f} {c.chi2_per_dof:8.3f} {gain:>19} {c.p:8.2g}  "
              f"{'agree' if passed else 'DIFFER'}")
    good &= planted.judge(results)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""Compare the time to an equal error of the epipolar Mueller image: one render of Sunstone, mitransient one pattern at a time.

The epipolar image keeps, for every camera pixel, the light of the projector pixels on its epipolar line. Sunstone renders this
image at once, as a slice with all 16 elements at three wavelengths. A renderer without projector pixels illuminates one epipolar
line, renders, keeps the camera pixels of the same plane, and repeats this for the next line. The scene is a rectified pair of
256 x 256 pixels (speed/epipolar.toml), so lines are rows, and an image requires

    256 patterns x 4 input states x 3 wavelengths = 3072 renders.

Measurements and assumptions:

- mitransient (`transient_path` over one time bin, monochromatic and polarized, so that it returns the Stokes vector of one
  wavelength) renders --patterns of the 256 rows, each twice with different seeds, after a warm-up. Its time per pattern is the
  median. Patterns are exchanged in place without recompiling or reloading. The other patterns are assumed to take the same time.
- It cannot illuminate a scene with polarized light: a polarizer in front of its projector is black (Mitsuba 3's issue 1462). The
  renders of the other three input states are counted with the time of unpolarized ones (--states 1 leaves them out).
- Three wavelengths are three renders, because a monochromatic variant has one wavelength (--wavelengths 1 leaves them out).
- The error is that of M00 at 550 nm in the rows of the measured patterns, from the difference of two seeds: RMSE = √(mean (a -
  b)²/2). Both programs are unbiased, so time to equal error is t (RMSE/target)².
- Sunstone's time is that of the whole process with all files written.

The means of both programs over the measured rows must agree; otherwise the script fails. A user who renders only the lit row with
mitransient (a film cropped to 256 x 1) saves most of the samples: this case is also measured and printed.
"""

import argparse
import os
import subprocess
import sys
import time

import environment
import result_file

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import drjit as dr
    import mitsuba as mi
    import numpy as np
    import zarr

    mi.set_variant("llvm_ad_mono_polarized")
    import mitransient as mitr

SCENE = environment.HERE / "speed/epipolar.toml"
OUT = environment.ROOT / "target/epipolar"
ROWS, DEPTH, IRRADIANCE, BAR = 256, 6, 20.0, 1000


def sunstone(spp, seed, threads):
    """Return seconds, and M00 at 550 nm [y, x]."""
    store = OUT / f"seed{seed}.zarr"
    options = ["--spp", spp, "--seed", seed, "--threads", threads, "-o", store, "--force", "--no-figures"]
    command = [environment.sunstone(), "render", SCENE, *options]
    begun = time.perf_counter()
    subprocess.run([*map(str, command)], check=True, capture_output=True)
    seconds = time.perf_counter() - begun
    return seconds, zarr.open_group(store)["epipolar/mean"][:, :, 0, 0, 1].astype(float)


class Mitransient:
    """The exported scene under one projector row at a time; the film is cropped to that row if `crop`."""

    def __init__(self, threads, crop):
        command = [environment.sunstone(), "export", SCENE, "--mitsuba", OUT / "mono", "--wavelength", "550", "--force"]
        subprocess.run([*map(str, command)], check=True, capture_output=True)
        xml = (OUT / "mono/scene.xml").read_text()
        dr.set_thread_count(os.cpu_count())
        mi.Bitmap(np.ones((ROWS, ROWS, 1), np.float32)).write(str(OUT / "mono/pattern.exr"))
        pattern = (
            '<texture type="bitmap" name="irradiance"><string name="filename" value="pattern.exr"/>'
            '<boolean name="raw" value="true"/><string name="filter_type" value="nearest"/></texture>'
        )
        uniform = f'<spectrum name="irradiance" value="{IRRADIANCE:.0f}"/>'
        head, body = xml.split("<sensor", 1)
        integrator = f'<integrator type="transient_path"><integer name="max_depth" value="{DEPTH}"/>'
        integrator += '<integer name="rr_depth" value="101"/><string name="temporal_filter" value="box"/></integrator>'
        head = head[: head.index("<integrator")] + integrator
        film = '<film type="transient_hdr_film"><integer name="temporal_bins" value="1"/>'
        film += '<float name="start_opl" value="0"/><float name="bin_width_opl" value="1000"/>'
        body = body.replace('<string name="component_format" value="float32"/>', "").replace(uniform, pattern)
        self.xml = head + "<sensor" + body.replace('<film type="hdrfilm">', film)
        if pattern not in self.xml:
            sys.exit("the exported projector has an unexpected form")
        self.threads, self.crop = threads, crop
        dr.set_thread_count(threads)
        self.scenes = {}

    def scene(self, row):
        """Return the scene, its parameters and the name of the pattern's parameter."""
        key = row if self.crop else None
        if key not in self.scenes:
            xml = self.xml
            if self.crop:
                window = {"crop_offset_x": 0, "crop_offset_y": row, "crop_width": ROWS, "crop_height": 1}
                crop = "".join(f'<integer name="{name}" value="{value}"/>' for name, value in window.items())
                xml = xml.replace('<float name="start_opl"', crop + '<float name="start_opl"')
            path = OUT / "mono/pattern.xml"
            path.write_text(xml)
            # With a single thread, reading images waits forever.
            dr.set_thread_count(os.cpu_count())
            scene = mi.load_file(str(path))
            dr.set_thread_count(self.threads)
            parameters = mi.traverse(scene)
            self.scenes[key] = scene, parameters, next(k for k in parameters.keys() if k.endswith("irradiance.data"))
        return self.scenes[key]

    def render(self, row, spp, seed):
        """Return seconds, and s0 of camera row `row`."""
        scene, parameters, name = self.scene(row)
        pattern = np.zeros((ROWS, ROWS, 1), np.float32)
        pattern[row] = IRRADIANCE
        begun = time.perf_counter()
        parameters[name] = mi.TensorXf(pattern)
        parameters.update()
        steady, transient = mi.render(scene, spp=spp, seed=seed)
        dr.eval(steady, transient)
        dr.sync_thread()
        seconds = time.perf_counter() - begun
        image = np.array(transient, dtype=float)
        return seconds, image[0 if self.crop else row, :, 0, 0]


def rmse(a, b):
    """Return the error of one of two independent estimates of the same numbers."""
    return float(np.sqrt(np.mean((a - b) ** 2) / 2))


def measure(program, rows, spp):
    """Return median seconds of one pattern, its RMSE and its mean."""
    program.render(rows[0], spp, 99)
    seconds, first, second = [], [], []
    for row in rows:
        # A film with another crop is another scene: load and compile it before timing.
        program.render(row, spp, 98)
        for seed, into in ((0, first), (1, second)):
            t, image = program.render(row, spp, seed)
            seconds.append(t)
            into.append(image)
    return {
        "seconds": float(np.median(seconds)),
        "all_seconds": seconds,
        "rmse": rmse(np.array(first), np.array(second)),
        "mean": float(np.mean([first, second])),
        "spp": spp,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--patterns", type=int, default=16, help="rows measured of 256")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--states", type=int, default=4)
    parser.add_argument("--wavelengths", type=int, default=3)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--record", action="store_true", help="write results/epipolar.json")
    options = parser.parse_args()

    (OUT / "mono").mkdir(parents=True, exist_ok=True)
    step = ROWS // options.patterns
    rows = [step // 2 + step * i for i in range(options.patterns)]
    runs = [sunstone(options.spp, seed, options.threads) for seed in (1, 2, 3)]
    images = [image[rows] for _, image in runs]
    ours = {
        "seconds": float(np.median([seconds for seconds, _ in runs])),
        "all_seconds": [seconds for seconds, _ in runs],
        "rmse": float(np.sqrt(np.mean([rmse(images[a], images[b]) ** 2 for a, b in ((0, 1), (0, 2), (1, 2))]))),
        "mean": float(np.mean(images)),
        "spp": options.spp,
    }
    whole = measure(Mitransient(options.threads, crop=False), rows, options.spp)
    cropped = measure(Mitransient(options.threads, crop=True), rows, options.spp)
    renders = ROWS * options.states * options.wavelengths
    print(f"{result_file.machine()['processor']}, {options.threads} threads; {ROWS}x{ROWS}; mean and RMSE of M00 at 550 nm")
    print(f"{'program':36} | {'spp':>4} | s a render | renders | {'mean':>8} | {'RMSE':>8} | s to Sunstone's RMSE |  ratio")
    for name, side, count in (
        ("Sunstone, one render", ours, 1),
        ("mitransient, whole images", whole, renders),
        ("mitransient, cropped to the lit row", cropped, renders),
    ):
        side["total_s"] = side["seconds"] * count * (side["rmse"] / ours["rmse"]) ** 2
        side["ratio"] = side["total_s"] / ours["total_s"]
        print(
            f"{name:36} | {side['spp']:4} | {side['seconds']:10.3f} | {count:7} | {side['mean']:.2e} | {side['rmse']:.2e}"
            f" | {side['total_s']:20.1f} | {side['ratio']:6.0f}"
        )
    print(f"renders: {ROWS} patterns x {options.states} input states x {options.wavelengths} wavelengths, all at the same cost")
    met = "met" if whole["ratio"] >= BAR else "MISSED"
    print(f"one pattern at a time takes {whole['ratio']:.0f} times as long to the same error; bar {BAR}: {met}")
    for name, side in (("whole", whole), ("cropped", cropped)):
        if abs(side["mean"] / ours["mean"] - 1) > 0.05:
            sys.exit(f"the means differ ({name}: {side['mean']}, ours {ours['mean']}); the programs do not render the same")
    if options.record:
        measured = numbers(ours, whole, cropped, renders, options)
        measures = [*result_file.TRACER, "validation/epipolar.py", "validation/speed/epipolar.toml"]
        result_file.write("epipolar", __file__, measures, measured, {"mitransient": mitr.__version__})


def numbers(ours, whole, cropped, renders, options):
    """Return the content of the result file: seconds to Sunstone's error and their ratios; the spread is that of single renders.
    """
    one = ours["seconds"]
    out = {
        "patterns": result_file.once(options.patterns, "", "a setting"),
        "renders": result_file.once(renders, "", "a setting"),
        "rmse": result_file.once(ours["rmse"], "of M00", "three seeds"),
        "sunstone": result_file.rounds(ours["all_seconds"], "s", spread="renders of three seeds"),
    }
    for key, side in (("whole", whole), ("cropped", cropped)):
        factor = (side["rmse"] / ours["rmse"]) ** 2
        spread = f"{len(side['all_seconds'])} renders, each taken for all {renders}"
        out[f"{key}_one"] = result_file.rounds(side["all_seconds"], "s", spread=spread)
        out[key] = result_file.rounds([s * renders * factor for s in side["all_seconds"]], "s", spread=spread)
        ratios = [s * renders * factor / one for s in side["all_seconds"]]
        out[f"{key}_ratio"] = result_file.rounds(ratios, "", "higher", spread=spread + ", over Sunstone's median")
    return out


if __name__ == "__main__":
    main()

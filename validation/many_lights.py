#!/usr/bin/env python3
"""Check noise, bias and time of scenes with many lights, against closed forms and Mitsuba.

Each row prints a number and its upper bound. The exit code is 1 if a row is above its bound.

- Noise: relative variance of a pixel over renders with different seeds, for Sunstone and for Mitsuba's `path` at the same samples
  per pixel. Sunstone's must be at most 1.5 times Mitsuba's, and in the first scene at most 0.005. There a wall receives equal
  light from a large distant lamp and a small near one, whose power is 3200 times smaller.
- Bias: the mean of the same renders against that of a long render of Mitsuba, in standard errors (at most 5).
- Time, only with `--time`: processor time of a render with 1000 lamps over that with one lamp of the same total power, at equal
  samples; medians of interleaved rounds. In the Cornell box, with paths of up to five surfaces, it must be at most 1.5. On a bare
  wall, where only lamps are traced, it is only printed.

`--power` applies errors (values 2 % too large, variances 1.6 times Mitsuba's, twice the allowed time) and checks that each is
detected.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import mitsuba as mi
    import numpy as np
    import zarr

SIZE = 8
SPP = 64
SEEDS = 48
VARIANCE_BOUND = 0.005
VARIANCE_RATIO_BOUND = 1.5
TIME_BOUND = 1.5
SIGMAS = 5.0
ROUNDS = 5
SPP_OF_TIMES = 256

CAMERA = ([0.0, -1.6, 1.2], [0.0, 0.0, 0.0], 12.0)
SLICE = '[[slices]]\nname = "image"\npolarization = "intensity"\n'
WALL = ([-0.5, -0.5, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])


def sphere(centre, radius, radiance):
    """Return a spherical lamp."""
    return "sphere", centre, radius, radiance


def two_lamps():
    """Irradiance π L (r/d)² cosθ in the centre: both lamps contribute equally, and the shadow of the small one is outside the
    view.
    """
    return [sphere([0.0, 0.0, 40.0], 2.0, 2.0), sphere([0.3, 0.0, 0.597], 0.05, 1.0)]


def ceiling(number, height=1.5, side=4.0, radius=0.01):
    """Return a grid of small lamps. A single lamp has the power of 1000."""
    if number == 1:
        return [sphere([0.0, 0.0, height], radius, 1000.0)]
    columns = 40
    rows = number // columns
    place = lambda i: [side * ((i % columns + 0.5) / columns - 0.5), side * ((i // columns + 0.5) / rows - 0.5), height]
    return [sphere(place(i), radius, 1.0) for i in range(number)]


def points(number, **place):
    """Return the same grid of point lights, each with the intensity of a lamp."""
    return [("point", centre, 0.0, radiance * np.pi * radius**2) for _, centre, radius, radiance in ceiling(number, **place)]


def shining(lamps):
    """Return lamps as text of a scene file; the scene defines the material `black`."""
    for kind, centre, radius, radiance in lamps:
        if kind == "sphere":
            yield (f'[[objects]]\nmaterial = "black"\nshape.sphere = {{ center = {centre}, radius = {radius} }}\n'
                   f"emission.radiance = {radiance}\n")
        else:
            yield f"[[emitters]]\npoint = {{ position = {centre}, intensity = {radiance} }}\n"


def toml(lamps, spp, depth=2, size=SIZE):
    """Return the scene of Sunstone."""
    origin, target, fov = CAMERA
    corner, u, v = WALL
    lines = ["wavelengths_nm = [550]", "[render]", 'integrator = "path"', f"spp = {spp}", f"max_depth = {depth}", "tile = 8",
             "[camera]", f"resolution = [{size}, {size}]", f"fov_x_deg = {fov}",
             f"pose.look_at = {{ origin = {origin}, target = {target} }}",
             "[materials]", "white.diffuse.albedo = 0.5", "black.diffuse.albedo = 0",
             "[[objects]]", 'material = "white"', f"shape.rectangle = {{ corner = {corner}, u = {u}, v = {v} }}"]
    return "\n".join(lines) + "\n" + "".join(shining(lamps)) + SLICE


def mitsuba(lamps, depth=2):
    """Return the scene of Mitsuba."""
    origin, target, fov = CAMERA
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth},
        "sensor": {
            "type": "perspective", "fov": fov, "near_clip": 1e-3,
            "to_world": mi.ScalarTransform4f().look_at(origin=origin, target=target, up=[0, 1, 0]),
            "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"},
                     "pixel_format": "luminance", "component_format": "float32"},
            "sampler": {"type": "independent"},
        },
        "wall": {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale([0.5, 0.5, 1]), "bsdf": gray(0.5)},
    }
    for i, (kind, centre, radius, radiance) in enumerate(lamps):
        if kind == "sphere":
            scene[f"lamp{i}"] = {"type": "sphere", "center": centre, "radius": radius, "bsdf": gray(0.0),
                                 "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}}}
        else:
            scene[f"lamp{i}"] = {"type": "point", "position": centre, "intensity": {"type": "rgb", "value": radiance}}
    return mi.load_dict(scene)


def gray(albedo):
    """Return a Lambertian material, equal at all wavelengths."""
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": albedo}}


def render(folder, text, seed=0, threads=2):
    """Return an image by Sunstone, and the processor time of the process in seconds."""
    scene, store = folder / "scene.toml", folder / "image.zarr"
    scene.write_text(text)
    command = [environment.sunstone(), "render", scene, "-o", store, "--force", "--no-figures", "--seed", seed,
               "--threads", threads]
    with open(folder / "messages.txt", "w") as messages:
        process = subprocess.Popen([str(c) for c in command], stdout=messages, stderr=messages)
        _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit((folder / "messages.txt").read_text())
    image = np.asarray(zarr.open(store, mode="r")["image"]["mean"], dtype=float).squeeze()
    return image, usage.ru_utime + usage.ru_stime


class Noise:
    """Images of both programs with many seeds: [seed, y, x]."""

    def __init__(self, name, lamps, bound=float("inf")):
        self.name, self.bound = name, bound
        with tempfile.TemporaryDirectory(dir=environment.in_memory()) as folder:
            text = toml(lamps, SPP)
            self.ours = np.stack([render(Path(folder), text, seed)[0] for seed in range(SEEDS)])
        scene = mitsuba(lamps)
        self.theirs = np.stack([np.array(mi.render(scene, spp=SPP, seed=seed))[..., 0] for seed in range(SEEDS)])
        self.long = np.array(mi.render(scene, spp=64 * SPP, seed=SEEDS))[..., 0]

    @staticmethod
    def relative_variance(images):
        """Return the mean over all pixels."""
        return (images.var(axis=0, ddof=1) / images.mean(axis=0) ** 2).mean()

    def rows(self, ours):
        """Yield the name, the number and the bound of each row."""
        mine, their = self.relative_variance(ours), self.relative_variance(self.theirs)
        bound = min(self.bound, VARIANCE_RATIO_BOUND * their)
        yield f"{self.name}: relative variance (Mitsuba {their:.2g})", mine, bound
        # Standard errors of the means over all pixels.
        error = np.hypot(*(spread.mean(axis=(1, 2)).std(ddof=1) / np.sqrt(SEEDS) for spread in (ours, self.theirs)))
        theirs = np.mean([self.theirs.mean(), self.long.mean()])
        yield f"{self.name}: mean, standard errors", abs(ours.mean() - theirs) / error, SIGMAS

    def planted(self):
        """Yield errors in Sunstone's images, and the index of the row that must detect each."""
        factor = 1.6 * self.relative_variance(self.theirs) / self.relative_variance(self.ours)
        mean = self.ours.mean(axis=0)
        yield "variance of 1.6 times Mitsuba's", mean + np.sqrt(factor) * (self.ours - mean), 0
        yield "2 % brighter", 1.02 * self.ours, 1


def wall(lamps):
    """Return the scene of the noise tests, with longer paths."""
    return toml(lamps, SPP_OF_TIMES, depth=3, size=64)


def cornell_box(lamps):
    """Return the box of `speed/cornell.toml` with lamps below its ceiling."""
    text = (environment.HERE / "speed/cornell.toml").read_text()
    text = text[: text.index("[projector]")] + text[text.index("[materials]"): text.index("# The complete matrix")]
    text = re.sub(r"albedo = \[[\d.]+, ([\d.]+), [\d.]+\]", r"albedo = \1", text.replace("[450, 550, 660]", "[550]"))
    text = text.replace("[256, 256]", "[64, 64]").replace("spp = 64", f"spp = {SPP_OF_TIMES}")
    return text.replace("[materials]", "[materials]\nblack.diffuse.albedo = 0") + "".join(shining(lamps)) + SLICE


class Times:
    """Processor times with 1000 lamps and with one, [round, 2]."""

    def __init__(self, name, scene, lamps, bound):
        self.name, self.bound = name, bound
        with tempfile.TemporaryDirectory(dir=environment.in_memory()) as folder:
            texts = [scene(lamps(number)) for number in (1000, 1)]
            run = lambda text: render(Path(folder), text, threads=1)[1]
            [run(text) for text in texts]
            self.ours = np.array([[run(text) for text in texts] for _ in range(ROUNDS)])

    def rows(self, ours):
        """Yield the name, the number and the bound of the row."""
        yield f"{self.name}: time of 1000 over one", np.median(ours[:, 0] / ours[:, 1]), self.bound

    def planted(self):
        """Yield errors as for `Noise`."""
        if self.bound == float("inf"):
            return
        scale = 2.0 * self.bound / np.median(self.ours[:, 0] / self.ours[:, 1])
        yield "twice the time allowed", self.ours * [scale, 1.0], 0


def cases(timed):
    """Yield all comparisons."""
    yield lambda: Noise("near and far lamp", two_lamps(), VARIANCE_BOUND)
    yield lambda: Noise("1000 lamps", ceiling(1000))
    yield lambda: Noise("1000 points", points(1000))
    if timed:
        # The part of the ceiling inside the box; there y is up.
        within = dict(height=0.95, side=1.8, radius=0.008)
        turned = lambda lamps: [(kind, [x, z, y], *rest) for kind, (x, y, z), *rest in lamps]
        yield lambda: Times("1000 lamps in a box", cornell_box, lambda n: turned(ceiling(n, **within)), TIME_BOUND)
        yield lambda: Times("1000 points in a box", cornell_box, lambda n: turned(points(n, **within)), TIME_BOUND)
        yield lambda: Times("1000 lamps over a wall", wall, ceiling, float("inf"))
        yield lambda: Times("1000 points over a wall", wall, points, float("inf"))


def check(case):
    """Print the rows of a case; return false if one is above its bound."""
    good = True
    for name, number, bound in case.rows(case.ours):
        good &= bool(number <= bound)
        print(f"{name:62} | {number:9.4g} | {bound:9.4g} |{'' if number <= bound else '  FAILED'}", flush=True)
    return good


def power(case):
    """Apply every error to a case; return false if one is not detected."""
    missed = []
    for name, ours, row in case.planted():
        _, number, bound = list(case.rows(ours))[row]
        if number <= bound:
            missed.append(name)
    print(f"{case.name:62} | {'NOT DETECTED: ' + ', '.join(missed) if missed else 'all planted errors detected'}", flush=True)
    return not missed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--power", action="store_true", help="check that planted errors are detected")
    parser.add_argument("--both", action="store_true", help="compare, and check that planted errors are detected")
    parser.add_argument("--time", action="store_true", help="also compare processor times")
    options = parser.parse_args()
    mi.set_variant("scalar_rgb")
    print(f"Mitsuba {mi.__version__}")
    good = True
    for make in cases(options.time):
        case = make()
        if not options.power or options.both:
            good &= check(case)
        if options.power or options.both:
            good &= power(case)
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()

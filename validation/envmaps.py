"""Compare imported environment maps with Mitsuba, pixel by pixel: peak, values and flux.

Maps of several sizes, with noise or with one lit texel, rotated and mirrored, are seen directly and illuminate a diffuse plane.
Requires the package pysunstone in the environment. Exits with 1 if a pixel or the irradiance differs.
"""

import sys
import tempfile
from pathlib import Path

import environment

environment.enter()

import mitsuba as mi
import numpy as np
import pysunstone as ps

mi.set_variant("scalar_rgb")
SIZES = [(2, 1), (4, 2), (3, 2), (3, 3), (8, 4), (7, 5), (64, 32)]
T = mi.ScalarTransform4f
TURNS = {
    "": T(),
    "rotated": T().rotate([0.6, 0, 0.8], 70),
    "mirrored": T().scale([-1, 1, 1]).rotate([0, 0.6, 0.8], 40),
}


def maps(width, height, rng):
    """Yield noise, and a map with one lit texel of 1000 that is not at a pole."""
    yield "noise", np.repeat(rng.uniform(0, 1, (height, width, 1)), 3, axis=2).astype(np.float32)
    if height > 2:
        lit = np.zeros((height, width, 3), np.float32)
        lit[height // 2, width // 3] = 1000
        yield "one texel", lit


def scene(file, turn, look, fov, size, plane):
    """Return a dict for both programs: the map, a camera, and a plane that is visible or far away."""
    at = T().look_at([0, 0, 0], look, [0.1, 1, 0.2]) if not plane else T().look_at([0, 2, 0], [0, 0, 0], [0, 0, 1])
    place = T().rotate([1, 0, 0], -90) if plane else T().translate([0, 0, 1000]).scale(0.01)
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {"type": "perspective", "fov": fov, "to_world": at,
                   "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}},
                   "sampler": {"type": "independent", "sample_count": 256 if not plane else 2048}},
        "light": {"type": "envmap", "filename": str(file), "to_world": turn},
        "plane": {"type": "rectangle", "to_world": place, "bsdf": {"type": "diffuse", "reflectance": 1.0}},
    }


def sunstone(described, spp):
    """Return radiances and their standard errors."""
    made = ps.from_mitsuba(described, wavelengths_nm=[550])
    found = next(iter(made.render(spp=spp).values()))
    pick = lambda a: np.asarray(a).reshape(*np.shape(a)[:2], -1)[..., 0]
    return pick(found["mean"]), pick(found["std_error"])


def main():
    rng = np.random.default_rng(1)
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "map.exr"
        for width, height in SIZES:
            for kind, values in maps(width, height, rng):
                mi.Bitmap(values).write(str(file))
                for name, turn in TURNS.items():
                    phi, theta = 2 * np.pi * (width // 3 + 0.5) / width, np.pi * (height // 2) / max(height - 1, 1)
                    to = np.array([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)])
                    to = list(np.array(turn.matrix, float)[:3, :3] @ to)
                    seen = scene(file, turn, to, 30, 9, False)
                    ours, error = sunstone(seen, 256)
                    loaded = mi.load_dict(seen)
                    renders = np.array([np.array(mi.render(loaded, seed=seed))[..., 0] for seed in range(4)])
                    theirs = renders.mean(axis=0)
                    # Four renders give a poor estimate of a pixel's variance, so all pixels use the largest of the image.
                    slack = 5 * np.sqrt(error**2 + renders.var(axis=0, ddof=1).max() / 4) + 1e-4 * theirs.max()
                    off = (abs(ours - theirs) / slack).max()
                    lit = scene(file, turn, to, 0.01, 5, True)
                    (flux, flux_error), flux_theirs = sunstone(lit, 2048), np.array(mi.render(mi.load_dict(lit)))[..., 0]
                    variance = ((flux_error**2).mean() + flux_theirs.var(ddof=1)) / flux.size
                    apart = abs(flux.mean() - flux_theirs.mean()) / (5 * np.sqrt(variance) + 1e-3 * flux_theirs.mean())
                    bad += off > 1 or apart > 1
                    print(f"{width} x {height}, {kind}, {name or 'plain'}: peak {ours.max():.4g}, Mitsuba {theirs.max():.4g}; "
                          f"plane {flux.mean():.4g}, Mitsuba {flux_theirs.mean():.4g}{'' if max(off, apart) <= 1 else '  DIFFERENT'}")
    sys.exit(int(bad > 0))


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Measure how long each integrator takes until the relative error of a scene's median lit pixel is 5 %.

Every scene of scenes/ that is meant for bidirectional paths is rendered by each integrator, only its conventional image. The
relative standard error of a pixel decreases with the square root of time, so a short render predicts the time of a longer one. A
pixel is lit if its value in the bidirectional render is at least 1 % of the 99th percentile. An integrator that misses light
never reaches the goal, however small its errors. Its light over all lit pixels must therefore agree with the bidirectional image
within 2 % (and five standard errors), and that of the median pixel within 10 %; otherwise "never" is printed.

The errors that a render reports do not include light that has not been sampled yet. Therefore each scene is also rendered as
shipped (integrator "auto") with several seeds, and the error comes from their deviations: the squared deviations of a pixel from
the mean of all seeds, over the squared mean, averaged over seeds (their number less one), wavelengths and 2 × 2 pixels; then the
median over the lit blocks.

    python3 validation/convergence.py [--scenes disco_ball milky_tank] [--seconds 60] [--seeds 4] [--only-seeds] [--record]

With --record, which requires all scenes, the numbers go to results/convergence.json (result_file.py).
"""

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import environment
import result_file

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import numpy as np
    import zarr

ROOT = environment.ROOT
SCENES = ["disco_ball", "milky_tank", "coins_mirror", "sss_statue", "crystals", "fruits"]
GOAL = 0.05


def render(scene, integrator, spp, folder, seed=1):
    """Return the mean and relative error of every pixel and wavelength, and the render time in seconds."""
    text = scene.read_text()
    text = re.sub(r"(?m)^integrator *=.*\n", "", text)
    text = re.sub(r"(?m)^manifold *=.*\n", "", text)
    text = text.replace("[render]", f'[render]\nintegrator = "{integrator}"', 1)
    # The file is in the folder of the original, because its mesh paths are relative to that folder.
    file = scene.with_name(f".convergence-{integrator}.toml")
    file.write_text(text)
    try:
        store = folder / f"{integrator}-{spp}.zarr"
        subprocess.run(
            [environment.sunstone(), "render", file, "--spp", str(spp), "--seed", str(seed)]
            + ["--slices", "conventional", "-o", store, "--force"],
            check=True,
            capture_output=True,
        )
    finally:
        file.unlink()
    group = zarr.open(store, mode="r")
    image = group["conventional"]
    mean, error = (np.asarray(image[name]).squeeze() for name in ("mean", "std_error"))
    return mean, error, group.attrs["wall_time_s"]


def spread(images):
    """Return the relative error of a pixel of one of several renders, as the median over lit blocks of 2 x 2 pixels."""
    images = np.asarray(images, dtype=np.float64)
    mean = images.mean(axis=0)
    variance = ((images - mean) ** 2).sum(axis=0) / (len(images) - 1)
    image = mean.mean(axis=-1)
    lit = image > 0.01 * np.percentile(image, 99)
    relative = np.where(lit[..., None], variance / np.maximum(mean, 1e-30) ** 2, np.nan).mean(axis=-1)
    h, w = relative.shape
    blocks = relative[: h // 2 * 2, : w // 2 * 2].reshape(h // 2, 2, w // 2, 2).mean(axis=(1, 3))
    return float(np.sqrt(np.nanmedian(blocks)))


def by_seeds(scene, seconds, seeds, folder):
    """Return the seconds to the goal of the scene as shipped, from the deviations of seeds."""
    *_, spp = measure(scene, "auto", seconds, folder)
    renders = [render(scene, "auto", spp, folder, seed) for seed in range(1, seeds + 1)]
    took = float(np.mean([r[2] for r in renders]))
    error = spread([r[0] for r in renders])
    return dict(spp=spp, took_s=took, true_error=error, seconds_to_goal=took * (error / GOAL) ** 2)


def check_spread():
    """Check that `spread` returns the error of renders of known error."""
    rng = np.random.default_rng(1)
    truth = rng.uniform(0.5, 2.0, (64, 64, 1))
    for error in (0.03, 0.06):
        renders = [truth * (1 + error * rng.standard_normal((64, 64, 3))) for _ in range(4)]
        found = spread(renders)
        if abs(found / error - 1) > 0.05:
            sys.exit(f"renders of error {error} give a spread of {found}")


def measure(scene, integrator, seconds, folder):
    """Return a render of about `seconds` seconds."""
    spp = 8
    mean, error, took = render(scene, integrator, spp, folder)
    if took < seconds:
        spp = max(spp + 1, int(spp * seconds / max(took, 0.05)))
        mean, error, took = render(scene, integrator, min(spp, 1 << 16), folder)
    return mean, error, took, spp


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--only-seeds", action="store_true", help="measure only the deviations of seeds")
    parser.add_argument("--record", action="store_true", help="write results/convergence.json")
    options = parser.parse_args()
    if options.record and (set(options.scenes) != set(SCENES) or options.only_seeds):
        sys.exit("--record requires all scenes and both measures")
    check_spread()
    rows, true = [], {}
    for name in options.scenes:
        with tempfile.TemporaryDirectory() as temporary:
            row = by_seeds(ROOT / "scenes" / name / "scene.toml", options.seconds, options.seeds, Path(temporary))
        true[name] = row
        rows.append(dict(scene=name, integrator="auto", seeds=options.seeds, **row))
        print(
            f"{name:14} as shipped, {options.seeds} seeds of {row['spp']} samples: {row['took_s']:.1f} s, true error "
            f"{row['true_error']:.4f}, {GOAL:.0%} after {row['seconds_to_goal']:.1f} s",
            flush=True,
        )
    if options.only_seeds:
        return
    print(f"time until the median lit pixel is known to {GOAL:.0%} (128 x 128 pixels, all cores)")
    print(f"{'scene':14} {'integrator':14} {'spp':>6} {'took s':>8} {'error':>8} {'to goal s':>10} {'light found':>12}")
    for name in options.scenes:
        scene = ROOT / "scenes" / name / "scene.toml"
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            found = {}
            for integrator in ("bidirectional", "caustics", "path"):
                if integrator == "caustics" and re.search(r"(?m)^interior", scene.read_text()):
                    # With media, all paths are traced from both ends.
                    continue
                mean, error, took, spp = measure(scene, integrator, options.seconds, folder)
                image = mean.mean(axis=-1)
                if integrator == "bidirectional":
                    lit = image > 0.01 * np.percentile(image, 99)
                    reference, unsure = mean, error
                relative = np.median(error[lit] / np.maximum(mean[lit], 1e-30))
                share = float(np.median(mean[lit] / reference[lit]))
                whole = float(mean[lit].sum() / reference[lit].sum())
                spread = float(np.hypot(np.linalg.norm(error[lit]), np.linalg.norm(unsure[lit])))
                uncertain = spread / float(reference[lit].sum())
                missing = abs(whole - 1) - 5 * uncertain
                complete = bool(integrator == "bidirectional" or (abs(share - 1) < 0.1 and missing < 0.02))
                seconds = took * (relative / GOAL) ** 2 if complete else None
                row = dict(scene=name, integrator=integrator, spp=spp, took_s=took, median_relative_error=float(relative))
                row.update(seconds_to_goal=seconds, median_share_of_light=share, share_of_all_light=whole)
                rows.append({key: plain(value) for key, value in row.items()})
                found[integrator] = seconds
                goal = f"{seconds:10.1f}" if seconds is not None else f"{'never':>10}"
                print(f"{name:14} {integrator:14} {spp:6} {took:8.1f} {relative:8.4f} {goal} {whole:12.4f}", flush=True)
            if found["path"] is not None:
                print(f"{'':14} bidirectional takes {found['bidirectional'] / found['path']:.2f} of path's time")
    if options.record:
        measures = [*result_file.TRACER, "validation/convergence.py", *(f"scenes/{name}" for name in SCENES)]
        result_file.write("convergence", __file__, measures, numbers(rows, true), rows=rows)


def plain(value):
    """Return a number for JSON; null if the goal was not reached."""
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not np.isfinite(value) else value


def numbers(rows, true):
    """Return the content of the result file."""
    out = {"goal": result_file.once(GOAL, "", "a setting")}
    for row in rows:
        if "seeds" in row:
            continue
        key = f"{row['scene']}_{row['integrator']}"
        out[key] = result_file.once(row["seconds_to_goal"], "s", f"from one run of {row['took_s']:.0f} s; null: never")
        out[f"{key}_light"] = result_file.once(row["share_of_all_light"], "of the light that is found", "one run")
    for name, row in true.items():
        key = f"{name}_true"
        out[key] = result_file.once(row["seconds_to_goal"], "s", f"as shipped, by true deviations of seeds of {row['took_s']:.0f} s")
    return out


if __name__ == "__main__":
    main()

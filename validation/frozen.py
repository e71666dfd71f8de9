#!/usr/bin/env python3
"""Compare the program's results with stored checksums, to prove that a change of the code does not change results.

Runs the program (or another one, `--program`) on

- every shipped scene file: a block of tiles in the middle of its image;
- every material under every integrator, on a sphere lit by a projector, a point light and a sky;
- capture, reconstruct, decompose, learn, trial, denoise, probe, layers, merge, shard, export, and figures;
- `apply NAME --preview --seeds 1` for every application (with `--applications`, minutes each);
- `--help` of every command;

and compares the SHA-256 of the output with `frozen.json`. `--power` checks that a change is detected. `--record` rewrites that
file; then state in the commit what changed, and why. The hash excludes paths, times and versions. Chunk files, arrays, tables and
images are hashed completely.
"""

import argparse
import concurrent.futures
import hashlib
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import environment

SCENES = environment.ROOT / "scenes"
TABLE = environment.HERE / "frozen.json"
# Files that contain times, paths or versions.
LEFT_OUT = {"zarr.json", "manifest.txt", "part.txt"}
INTEGRATORS = ["path", "caustics", "bidirectional"]
MATERIALS = {
    "diffuse": "diffuse.albedo = 0.6",
    "conductor": 'conductor.metal = "Au"',
    "rough_conductor": 'rough_conductor = { metal = "Ag", alpha = 0.2 }',
    "dielectric": "dielectric.ior = 1.5",
    "rough_dielectric": "rough_dielectric = { ior = 1.5, alpha = 0.2 }",
    "thin_dielectric": "thin_dielectric.ior = 1.5",
    "plastic": "plastic = { albedo = 0.5, ior = 1.5, alpha = 0.2 }",
    "smooth_plastic": "plastic = { albedo = 0.5, ior = 1.5, alpha = 0.001 }",
    "polarizer": "polarizer.angle_deg = 30",
    "retarder": "retarder = { angle_deg = 20, retardance_deg = 90 }",
    "crystal": 'crystal = { name = "calcite", axis = [0, 1, 1] }',
    "split_crystal": 'crystal = { name = "calcite", axis = [0, 1, 1], split = true }',
    "rough_crystal": 'crystal = { name = "calcite", axis = [0, 1, 1], roughness = 0.3 }',
    "coated_conductor": 'coated_conductor = { metal = "Al", films = [{ ior = "SiO", thickness_nm = 120 }] }',
    "blend": 'blend = { a = "white", b = "black", weight = 0.3 }',
    "partial_depolarizer": 'partial_depolarizer = { material = "metal", fraction = 0.3 }',
    "two_sided": 'two_sided = { front = "metal", back = "white" }',
    "null": "null = {}",
}
SCENE = """wavelengths_nm = [450, 550, 660]
[render]
spp = 4
replicates = 2
max_depth = 6
tile = 8
integrator = "{integrator}"
[camera]
resolution = [8, 8]
fov_x_deg = 40
pose.look_at = {{ origin = [0.4, 0.5, 3], target = [0, 0, 0] }}
[projector]
resolution = [8, 8]
fov_x_deg = 40
pose.look_at = {{ origin = [-0.8, 0.9, 2.5], target = [0, 0, 0] }}
[[emitters]]
point = {{ position = [1, 2, 1], intensity = 2 }}
[[emitters]]
environment.radiance = 0.1
[materials]
white.diffuse.albedo = 0.7
black.diffuse.albedo = 0
metal.conductor.metal = "Ag"
it.{material}
[[objects]]
material = "white"
shape.rectangle = {{ corner = [-2, -0.7, 2], u = [4, 0, 0], v = [0, 0, -4] }}
[[objects]]
material = "it"
shape.sphere.radius = 0.7
[[slices]]
name = "image"
polarization = "mueller"
[[slices]]
name = "transient"
polarization = "mueller"
time = {{ start_ps = 10000, bin_ps = 1000, bins = 16 }}
[[slices]]
name = "projector"
projector = "all"
camera = {{ rows = [4] }}
"""


class Runner:
    """A runner of one program in a separate folder."""

    def __init__(self, program, folder):
        self.program, self.folder = program, folder

    def __call__(self, *arguments):
        """Return the program's standard output, or on failure its error message, so that failures are compared too."""
        done = subprocess.run([self.program, *map(str, arguments)], capture_output=True, text=True, cwd=self.folder)
        return done.stdout if done.returncode == 0 else f"exit code {done.returncode}: {done.stderr}"


def of_text(text):
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def of_path(path):
    """Return the hash of a file, or of all files of a folder."""
    digest = hashlib.sha256()
    for file in sorted(path.rglob("*") if path.is_dir() else [path]):
        if file.is_file() and file.name not in LEFT_OUT:
            digest.update(str(file.relative_to(path)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16] if path.exists() else "nothing written"


def failed(text):
    """Return the message of a failed run, or None. Failed runs must not be recorded."""
    return text if text.startswith("exit code") else None


def middle_tiles(scene):
    """Return the numbers of two tiles in the middle of the image, A-B."""
    text = scene.read_text()
    w, h = map(int, re.search(r"\[camera\][^[]*?resolution = \[(\d+), (\d+)\]", text, re.S).groups())
    size = int((re.search(r"^tile = (\d+)", text, re.M) or [0, "32"])[1])
    across, down = -(-w // size), -(-h // size)
    first = down // 2 * across + across // 2
    return f"{max(0, first - 1)}-{first}"


def shipped(run, folder):
    """Yield every scene file below `scenes/`."""
    for scene in sorted(s for s in SCENES.glob("*/*.toml") if "[camera]" in s.read_text()):
        name = str(scene.relative_to(SCENES))
        out = folder / (name.replace("/", "_") + ".zarr")
        variant = ["--variant", 0] if "[vary" in scene.read_text() else []
        said = run("render", scene, *variant, "--spp", 2, "--tiles", middle_tiles(scene), "--no-figures", "-o", out, "--threads", 1)
        yield f"scene {name}", failed(said) or of_path(out)


def materials(run, folder, more=""):
    """Yield every material under every integrator."""
    for name, material in MATERIALS.items():
        for integrator in INTEGRATORS:
            scene, out = folder / f"{name}_{integrator}.toml", folder / f"{name}_{integrator}.zarr"
            scene.write_text(SCENE.format(integrator=integrator, material=material).replace("intensity = 2", f"intensity = 2{more}"))
            said = run("render", scene, "--no-figures", "-o", out, "--threads", 1)
            yield f"material {name}, {integrator}", failed(said) or of_path(out)


def commands(run, folder):
    """Yield the results of other commands on two small renders."""
    scene = folder / "small.toml"
    scene.write_text(SCENE.format(integrator="path", material=MATERIALS["plastic"]))
    (folder / "materials.toml").write_text(f"[materials]\nit.{MATERIALS['plastic']}\n")
    for seed in (1, 2):
        run("render", scene, "--seed", seed, "--spp", 64, "--no-figures", "-o", f"{seed}.zarr")
    store = "1.zarr"
    steps = [
        ("merge", ["merge", store, "2.zarr", "-o", "merged.zarr"], "merged.zarr"),
        ("shard", ["shard", store, "-o", "sharded.zarr"], "sharded.zarr"),
        ("denoise", ["denoise", store, "2.zarr", "-o", "denoised.zarr"], "denoised.zarr"),
        ("decompose", ["decompose", store, "image", "-o", "properties.npz"], "properties.npz"),
        ("layers", ["layers", scene, "-o", "layers.npz"], "layers.npz"),
        ("probe", ["probe", store, "transient", "--pulse", "gaussian:3000", "--stokes", "horizontal", "-o", "probe.npy"], "probe.npy"),
        ("export", ["export", store, "image", "-o", "image.exr"], "image.exr"),
        ("figure", ["figure", store, "--view", "mueller", "--slice", "image", "-o", "image.png"], "image.png"),
        ("scheme", ["scheme", "drr", "-k", 36, "-o", "drr.toml"], "drr.toml"),
        ("capture", ["capture", store, "image", "--scheme", "drr.toml", "--relative-noise", 1e-3, "-o", "I.npy"], "I.npy"),
        ("reconstruct", ["reconstruct", "I.npy", "--scheme", "drr.toml", "--wavelengths", "450,550,660", "-o", "M.npy"], "M.npy"),
        ("reconstruct, realizable",
         ["reconstruct", "I.npy", "--scheme", "drr.toml", "--wavelengths", "450,550,660", "--realizable", "-o", "R.npy"], "R.npy"),
        ("learn", ["learn", "-k", 17, "-o", "learnt.toml"], "learnt.toml"),
        ("trial", ["trial", store, "image", "--scheme", "drr.toml", "--relative-noise", 1e-3], None),
        ("pbrdf", ["pbrdf", "eval", "materials.toml", "--name", "it", "--in", "30,0", "--out", "40,180"], None),
    ]
    for name, arguments, written in steps:
        said = run(*arguments)
        yield f"command {name}", failed(said) or (of_path(folder / written) if written else of_text(said))


def applications(run, folder):
    """Yield the tables of every application."""
    names = re.findall(r"^ *([a-z_]+)", run("apply", "list"), re.M)
    for name in names:
        out = folder / f"apply_{name}"
        said = run("apply", name, "--preview", "--seeds", 1, "--scenes", SCENES, "--renders", folder / "renders", "-o", out)
        yield f"application {name}", failed(said) or of_path(out)


def helps(run, _):
    """Yield the text of every command's `--help`, independent of the terminal's width."""
    todo = [[]]
    while todo:
        command = todo.pop()
        # The usage line begins with the program's own name.
        text = run(*command, "--help").replace(f"Usage: {Path(run.program).name} ", "Usage: sunstone ")
        yield f"help {' '.join(command) or 'of all'}", failed(text) or of_text(text)
        if "\nCommands:" in text:
            listed = text.split("\nCommands:", 1)[1].split("\n\n", 1)[0]
            todo += [[*command, name] for name in re.findall(r"^  (\w[\w-]*)", listed, re.M) if name != "help"]


def power(program):
    """Apply a small change. Return exit code 1 if a result does not show the change."""
    known = json.loads(TABLE.read_text())
    with tempfile.TemporaryDirectory(dir=environment.in_memory()) as temporary:
        found = dict(materials(Runner(program, Path(temporary)), Path(temporary), ".001"))
    missed = [name for name, value in found.items() if value == known[name]]
    print(f"a brighter lamp changes {len(found) - len(missed)} of {len(found)} results{''.join(', not ' + name for name in missed)}")
    return 1 if missed else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path, help="path of another program")
    parser.add_argument("--record", action="store_true", help="rewrite the table")
    parser.add_argument("--power", action="store_true",
                        help="check that a lamp brighter by one part in 2000 changes the results of all materials")
    parser.add_argument("--applications", action="store_true", help="include the applications")
    options = parser.parse_args()
    program = options.program or environment.sunstone()
    if options.power:
        return power(program)
    groups = [shipped, materials, commands, helps] + [applications] * options.applications
    found = {}
    with tempfile.TemporaryDirectory(dir=environment.in_memory()) as temporary:
        def whole(group):
            folder = Path(temporary) / group.__name__
            folder.mkdir()
            return dict(group(Runner(program, folder), folder))
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            for part in pool.map(whole, groups):
                found |= part
    broken = {name: text for name, text in found.items() if text.startswith(("exit code", "nothing"))}
    for name, text in broken.items():
        print(f"{name}: {text}")
    if options.record:
        kept = json.loads(TABLE.read_text()) if TABLE.exists() else {}
        if not options.applications:
            found |= {name: value for name, value in kept.items() if name.startswith("application")}
        TABLE.write_text(json.dumps(dict(sorted(found.items())), indent=0) + "\n")
        print(f"{len(found)} checksums written")
        return 1 if broken else 0
    known = json.loads(TABLE.read_text())
    asked = {name for name in known if options.applications or not name.startswith("application")}
    changed = sorted(name for name in found.keys() | asked if found.get(name) != known.get(name))
    for name in changed:
        print(f"CHANGED: {name}: {known.get(name, 'not there')} became {found.get(name, 'not there')}")
    print(f"{len(found)} results, {len(changed)} changed")
    return 1 if changed or broken else 0


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""What `sunstone import` makes of other people's files: counts by outcome, and brightness against Mitsuba's own.

Walks folders for Mitsuba scene files (XML with a <scene>), glTF/GLB, OBJ and PLY files and imports each with the `sunstone`
command (a mesh through a scene file of one object). Prints how many are imported and why the others are refused, and writes
the same as JSON. A scene file that another one includes is a fragment: counted apart, since it is imported with the other.

With --render, every imported Mitsuba scene is rendered by both programs at a small size, and the mean of each channel is
compared: `same` (within 1 %, or within 4 standard errors where noise is larger), `noted` (it differs, and a note of the
import says what is different), or `silently different`. The exit code is 1 if any is silently different.

The files are not part of the project: fetch, for example, github.com/mitsuba-renderer/mitsuba-data.
"""

import argparse
import collections
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import environment

MESHES = {".obj": "obj", ".ply": "ply", ".gltf": "gltf", ".glb": "gltf"}
SIZE, SPP, BATCHES = (24, 18), 64, 4
MESH_SCENE = """[camera]
resolution = [4, 4]
fov_x_deg = 40
pose = {{ look_at = {{ from = [0, 0, -5], to = [0, 0, 0] }} }}
[[emitters]]
type = "environment"
[materials.grey]
type = "diffuse"
albedo = 0.5
[[objects]]
shape = {{ {kind} = {{ file = {file}{materials} }} }}
material = "grey"
"""


def command(*arguments):
    """Exit code and messages of the `sunstone` command."""
    try:
        done = subprocess.run([environment.sunstone(), *map(str, arguments)], capture_output=True, text=True, timeout=300)
    except subprocess.TimeoutExpired:
        return 124, "error: timeout"
    return done.returncode, done.stderr + done.stdout


def reason(text):
    """The first error without its place, with names and numbers left out: one reason for many files."""
    found = re.search(r"error: (?:.*?:\d+:\d+: )?(.*)", text)
    line = found[1] if found else (text.strip().splitlines() or ["no message"])[0]
    return re.sub(r"(/\S+|\b[\w.-]+\.(?:xml|png|jpg|exr|ply|obj|spd|vol|mtl|bin)\b)", "FILE", re.sub(r"\d+(\.\d+)?", "N", line))


def notes_of(text):
    return [line.split("note: ", 1)[1] for line in text.splitlines() if "note: " in line]


def version_of(text):
    found = re.search(r"<scene[^>]*version\s*=\s*[\"']([^\"']*)", text)
    return found[1] if found else "?"


def defaults(text):
    """Size and samples as parameters, where the file offers them."""
    wanted = {"resx": SIZE[0], "resy": SIZE[1], "spp": SPP}
    return {name: value for name, value in wanted.items() if re.search(rf"<default\s+name=[\"']{name}[\"']", text)}


def import_scene(path, toml):
    text = path.read_text(errors="replace")
    defines = [f"-D{name}={value}" for name, value in defaults(text).items()]
    code, said = command("import", path, "-o", toml, "--force", *defines)
    return {"file": str(path), "kind": "old Mitsuba" if version_of(text)[:2] in ("0.", "1.") else "Mitsuba",
            "imported": code == 0, "reason": None if code == 0 else reason(said), "notes": notes_of(said) if code == 0 else []}


def import_mesh(path, toml):
    kind = MESHES[path.suffix.lower()]
    materials = ", materials = true" if kind == "gltf" or kind == "obj" and "mtllib" in path.read_text(errors="replace") else ""
    toml.write_text(MESH_SCENE.format(kind=kind, file=json.dumps(str(path)), materials=materials))
    code, said = command("check", toml)
    return {"file": str(path), "kind": path.suffix.lower()[1:], "imported": code == 0,
            "reason": None if code == 0 else reason(said), "notes": notes_of(said) if code == 0 else []}


def ours(toml, folder):
    """Mean and standard error of each channel, R, G, B."""
    import xarray

    text = re.sub(r"(\[camera\][^\[]*?resolution = )\[[^\]]*\]", rf"\g<1>[{SIZE[0]}, {SIZE[1]}]", toml.read_text())
    small, store = toml.with_name("small.toml"), folder / "small.zarr"
    small.write_text(text)
    code, said = command("render", small, "-o", store, "--force", "--spp", SPP * BATCHES, "--no-figures", "--seed", 1)
    if code:
        raise RuntimeError(said)
    data = xarray.open_zarr(store, group="mueller", consolidated=False).isel(stokes_in=0, stokes_out=0)
    mean = data["mean"].mean(["x", "y"]).values.astype(float).reshape(-1)
    error = ((data["std_error"] ** 2).sum(["x", "y"]) ** 0.5 / (SIZE[0] * SIZE[1])).values.astype(float).reshape(-1)
    return (mean[::-1], error[::-1]) if len(mean) == 3 else (mean.repeat(3), error.repeat(3))


def theirs(path):
    """The same of Mitsuba."""
    import mitsuba as mi
    import numpy as np

    text = path.read_text(errors="replace")
    mi.set_variant("scalar_rgb")
    if "transient" in text:
        environment.need_llvm("llvm_ad_rgb", "")
        import mitransient  # noqa: F401 (registers its plugins)
    scene = mi.load_file(str(path), **{name: str(value) for name, value in defaults(text).items()})
    sensor = scene.sensors()[0]
    film = mi.traverse(sensor.film())
    film["size"] = [*SIZE]
    film["crop_size"] = [*SIZE]
    film["crop_offset"] = [0, 0]
    film.update()
    means = []
    for seed in range(BATCHES):
        image = mi.render(scene, spp=SPP, seed=seed, sensor=0)
        image = np.array(image[0] if isinstance(image, tuple) else image)
        means.append(np.nanmean(image[..., :3].reshape(-1, min(3, image.shape[-1])), axis=0) * np.ones(3))
    return np.mean(means, axis=0), np.std(means, axis=0, ddof=1) / BATCHES**0.5


def compare(row, toml, folder):
    """Adds to the row what the two renders say."""
    import numpy as np

    try:
        (a, a_error), (b, b_error) = ours(toml, folder), theirs(Path(row["file"]))
    except Exception as fault:  # noqa: BLE001 (either program's refusal is a result)
        row["rendered"] = "failed"
        row["fault"] = str(fault).strip().splitlines()[-1][:200] if str(fault).strip() else repr(fault)
        return
    bound = np.maximum(0.01 * np.abs(b), 4 * np.hypot(a_error, b_error)) + 1e-7
    row["ours"], row["theirs"] = a.tolist(), b.tolist()
    row["noise"] = float(np.max(np.hypot(a_error, b_error) / np.maximum(np.abs(b), 1e-12)))
    row["ratio"] = float(np.mean(a) / np.mean(b)) if np.mean(b) else None
    same = bool((np.abs(a - b) <= bound).all())
    row["rendered"] = "same" if same else "noted" if row["notes"] else "silently different"


def table(rows):
    """Prints counts by kind, reasons and renders."""
    for kind in sorted({row["kind"] for row in rows}):
        of_kind = [row for row in rows if row["kind"] == kind]
        good = sum(row["imported"] for row in of_kind)
        print(f"\n{kind}: {good} of {len(of_kind)} imported")
        reasons = collections.Counter(row["reason"] for row in of_kind if not row["imported"])
        for text, count in reasons.most_common():
            print(f"  {count:4}  {text}")
        rendered = collections.Counter(row["rendered"] for row in of_kind if "rendered" in row)
        for text, count in rendered.most_common():
            print(f"  rendered: {text}: {count}")
    for row in rows:
        if row.get("rendered") in ("silently different", "noted", "failed"):
            say = f"ratio {row['ratio']:.4f}, noise {row['noise']:.4f}" if row.get("ratio") else row.get("fault", "their image is black")
            print(f"  {row['rendered']}: {row['file']}: {say}{'; ' + '; '.join(row['notes']) if row['notes'] else ''}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--render", action="store_true", help="compare the brightness with Mitsuba's")
    parser.add_argument("--only", default="", help="files whose path matches this regular expression")
    parser.add_argument("--json", type=Path, default=environment.ROOT / "target/import_statistics.json")
    options = parser.parse_args()
    files = sorted({f for folder in options.folders for f in folder.resolve().rglob("*") if f.is_file()})
    scenes = {f for f in files if f.suffix.lower() == ".xml" and "<scene" in f.read_text(errors="replace")}
    fragments = set()
    for scene in scenes:
        for name in re.findall(r"<include\s+filename=[\"']([^\"']*)", scene.read_text(errors="replace")):
            fragments |= {f for f in scenes if str(f).endswith("/" + re.sub(r".*\$\w+", "", name).lstrip("./"))}
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        toml = folder / "scene.toml"
        for path in files:
            if not re.search(options.only, str(path)):
                continue
            if path in scenes:
                row = import_scene(path, toml)
                row["kind"] += " fragment" if path in fragments else ""
                if options.render and row["imported"]:
                    compare(row, toml, folder)
            elif path.suffix.lower() in MESHES:
                row = import_mesh(path, toml)
            else:
                continue
            rows.append(row)
            if options.render:
                print(".", end="", flush=True, file=sys.stderr)
    table(rows)
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps(rows, indent=1))
    return 1 if any(row.get("rendered") == "silently different" for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())

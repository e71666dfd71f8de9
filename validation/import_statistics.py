#!/usr/bin/env python3
"""Import Mitsuba, glTF, OBJ and PLY files of other projects; count outcomes, and compare brightness with Mitsuba's renders.

Searches folders for Mitsuba scene files (XML with a <scene>), glTF/GLB, OBJ and PLY files and imports each with the `sunstone`
command (a mesh through a scene file with one object). Prints how many are imported and why the others are refused, and writes the
same as JSON. A scene file that another one includes, or that has neither shapes nor a sensor, is a fragment. Fragments are
counted separately, because they are imported with others.

With --render, both programs render every imported Mitsuba scene at a small size, and the mean of each channel is compared: `same`
(within 1 %, or within 4 standard errors if noise is larger), `noted` (it differs, and a note of the import explains the
difference), or `silently different`. The exit code is 1 if any is silently different.

The files are not part of the project. Fetch, for example, github.com/mitsuba-renderer/mitsuba-data.
"""

import argparse
import collections
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import environment

MESHES = {".obj": "obj", ".ply": "ply", ".gltf": "gltf", ".glb": "gltf"}
WIDTH, SPP, BATCHES = 24, 64, 4
# Notes that do not imply a difference in brightness.
NEUTRAL = re.compile("pixels are means|paths without end|the scene has several|the scene has no integrator|the file is of Mitsuba 0|"
                     ".* is not used|mitransient counts|hdrfilm|.*traces paths its own way|.*polarized in sunstone")
# Plugins whose meaning differs without polarization.
POLARIZED = re.compile(r"type=[\"'](stokes|polarizer|retarder|circular|measured_polarized|pplastic)[\"']")
MESH_SCENE = """[camera]
resolution = [4, 4]
fov_x_deg = 40
pose.look_at = {{ origin = [0, 0, -5], target = [0, 0, 0] }}
[[emitters]]
environment = {{ radiance = 1 }}
[materials.grey]
diffuse.albedo = 0.5
[[objects]]
shape.{kind} = {{ file = {file}{materials} }}
material = "grey"
[[slices]]
name = "photo"
"""


def command(*arguments):
    """Return exit code and messages of the `sunstone` command."""
    try:
        done = subprocess.run([environment.sunstone(), *map(str, arguments)], capture_output=True, text=True, timeout=300)
    except subprocess.TimeoutExpired:
        return 124, "error: timeout"
    return done.returncode, done.stderr + done.stdout


def reason(text):
    """Return the first error without its location, names and numbers, so that equal reasons of many files are grouped."""
    found = re.search(r"error: (?:.*?:\d+:\d+: )?(.*)", text)
    line = found[1] if found else (text.strip().splitlines() or ["no message"])[0]
    return re.sub(r"(/\S+|\b[\w.-]+\.(?:xml|png|jpg|exr|ply|obj|spd|vol|mtl|bin)\b)", "FILE", re.sub(r"\d+(\.\d+)?", "N", line))


def notes_of(text):
    return [line.split("note: ", 1)[1] for line in text.splitlines() if "note: " in line]


def version_of(text):
    found = re.search(r"<scene[^>]*version\s*=\s*[\"']([^\"']*)", text)
    return found[1] if found else "?"


def whole_text(path, depth=0):
    """Return the text of a scene file and of the files that it includes."""
    text = path.read_text(errors="replace")
    names = re.findall(r"<include\s+filename=[\"']([^\"']*)", text) if depth < 5 else []
    parts = [path.parent / name for name in names]
    return "\n".join([text, *(whole_text(part, depth + 1) for part in parts if part.is_file())])


def defaults(path):
    """Return the number of samples as a parameter, if the file uses it."""
    return {"spp": SPP} if "$spp" in whole_text(path) else {}


def import_scene(path, toml):
    text = path.read_text(errors="replace")
    defines = [f"-D{name}={value}" for name, value in defaults(path).items()]
    code, said = command("import", path, "-o", toml, "--force", *defines)
    return {"file": str(path), "kind": "old Mitsuba" if version_of(text)[:2] in ("0.", "1.") else "Mitsuba",
            "imported": code == 0, "reason": None if code == 0 else reason(said), "notes": notes_of(said) if code == 0 else []}


def import_mesh(path, toml):
    kind = MESHES[path.suffix.lower()]
    materials = ", materials = true" if kind == "gltf" or kind == "obj" and "mtllib" in path.read_text(errors="replace") else ""
    toml.write_text(MESH_SCENE.format(kind=kind, file=json.dumps(str(path)), materials=materials))
    code, said = command("info", toml)
    return {"file": str(path), "kind": path.suffix.lower()[1:], "imported": code == 0,
            "reason": None if code == 0 else reason(said), "notes": notes_of(said) if code == 0 else []}


def size_like(w, h):
    """Return a small size of nearly the same aspect ratio."""
    return [WIDTH, max(1, round(WIDTH * h / w))]


def ours(toml, folder):
    """Return mean and standard error of each channel, R, G, B."""
    import xarray

    text = toml.read_text()
    w, h = tomllib.loads(text)["camera"]["resolution"]
    small_size = size_like(w, h)
    text = re.sub(r"(\[camera\]\s+resolution = )\[[^\]]*\]", rf"\g<1>[{small_size[0]}, {small_size[1]}]", text)
    scale = {"fx": small_size[0] / w, "cx": small_size[0] / w, "cy": small_size[1] / h}
    text = re.sub(r"^(fx|cx|cy) = (\S+)$", lambda m: f"{m[1]} = {float(m[2]) * scale[m[1]]}", text, flags=re.M)
    small, store = toml.with_name("small.toml"), folder / "small.zarr"
    small.write_text(text)
    code, said = command("render", small, "-o", store, "--force", "--spp", SPP * BATCHES, "--no-figures", "--seed", 1)
    if code:
        raise RuntimeError(said)
    data = xarray.open_zarr(store, group="mueller", consolidated=False).isel(stokes_in=0, stokes_out=0)
    mean = data["mean"].mean(["x", "y"]).values.astype(float).reshape(-1)
    error = ((data["std_error"] ** 2).sum(["x", "y"]) ** 0.5 / (small_size[0] * small_size[1])).values.astype(float).reshape(-1)
    return (mean[::-1], error[::-1]) if len(mean) == 3 else (mean.repeat(3), error.repeat(3))


def theirs(path):
    """Return the mean and standard error of each channel for Mitsuba."""
    import mitsuba as mi
    import numpy as np

    text = whole_text(path)
    mi.set_variant("scalar_rgb")
    transient, polarized = "transient" in text, POLARIZED.search(text)
    if transient or polarized:
        environment.need_llvm("llvm_ad_mono_polarized" if polarized else "llvm_ad_rgb", "")
    if transient:
        import mitransient  # noqa: F401 (registers its plugins)
    scene = mi.load_file(str(path), **{name: str(value) for name, value in defaults(path).items()})
    sensor = scene.sensors()[0]
    parameters = mi.traverse(sensor)
    if [*sensor.film().crop_size()] == [*sensor.film().size()]:
        parameters["film.size"] = parameters["film.crop_size"] = size_like(*sensor.film().size())
        parameters.update()
    means = []
    for seed in range(BATCHES):
        image = mi.render(scene, spp=SPP, seed=seed, sensor=0)
        image = np.array(image[0] if isinstance(image, tuple) else image)
        means.append(np.nanmean(image[..., :3].reshape(-1, min(3, image.shape[-1])), axis=0) * np.ones(3))
    return np.mean(means, axis=0), np.std(means, axis=0, ddof=1) / BATCHES**0.5


def compare(row, toml, folder):
    """Add the comparison of the two renders to the row."""
    import numpy as np

    try:
        (a, a_error), (b, b_error) = ours(toml, folder), theirs(Path(row["file"]))
    except Exception as fault:  # noqa: BLE001 (either program's refusal is a result)
        row["rendered"] = "Mitsuba fails"
        row["fault"] = str(fault).strip().splitlines()[-1][:200] if str(fault).strip() else repr(fault)
        return
    if POLARIZED.search(whole_text(Path(row["file"]))):
        # Luminance, in all of R, G and B.
        weights = np.array([0.212671, 0.715160, 0.072169])
        a, a_error = a @ weights * np.ones(3), np.sqrt(a_error**2 @ weights**2) * np.ones(3)
    bound = np.maximum(0.01 * np.abs(b), 4 * np.hypot(a_error, b_error)) + 1e-7
    row["ours"], row["theirs"] = a.tolist(), b.tolist()
    row["noise"] = float(np.max(np.hypot(a_error, b_error) / np.maximum(np.abs(b), 1e-12)))
    row["ratio"] = float(np.mean(a) / np.mean(b)) if np.mean(b) else None
    explained = [note for note in row["notes"] if not NEUTRAL.match(note)]
    same = bool((np.abs(a - b) <= bound).all())
    row["rendered"] = "same" if same else "noted" if explained else "silently different"


def table(rows):
    """Print counts by kind, reasons and renders."""
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
        if row.get("rendered") in ("silently different", "noted", "Mitsuba fails"):
            say = f"ratio {row['ratio']:.4f}, noise {row['noise']:.4f}" if row.get("ratio") else row.get("fault", "their image is black")
            print(f"  {row['rendered']}: {row['file']}: {say}{'; ' + '; '.join(row['notes']) if row['notes'] else ''}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--render", action="store_true", help="compare the brightness with Mitsuba's renders")
    parser.add_argument("--only", default="", help="import only files whose path matches this regular expression")
    parser.add_argument("--json", type=Path, default=environment.ROOT / "target/import_statistics.json")
    options = parser.parse_args()
    files = sorted({f for folder in options.folders for f in folder.resolve().rglob("*") if f.is_file()})
    scenes = {f for f in files if f.suffix.lower() == ".xml" and "<scene" in f.read_text(errors="replace")}
    # A scene file without a shape or a sensor renders nothing: it is included by others, whose names may come from parameters.
    fragments = {f for f in scenes if not re.search("<(shape|sensor|include)[ >]", f.read_text(errors="replace"))}
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

"""Scene files that `sunstone export` writes for Mitsuba, rendered by both programs from one description.

Mitsuba renders one wavelength at a time (its spectral images would mix all of them). Smooth interfaces, sharp lobes and meshes
make some paths rare and bright, so pixels are compared in small squares (`BLOCK`).
"""

import contextlib
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

import mitsuba as mi
import numpy as np

import environment
import frames
import programs
from pairs import Pair

HERE = environment.HERE / "scenes_crosscheck"
RESOLUTION = 32
BATCHES = 32
BLOCK = 2


@dataclass
class Exported:
    """A scene to compare.

    Its name, its file, whether mueller_integrator.py also renders all 16 elements, time bins if any (start and width in
    picoseconds, number), Mitsuba's samples as a fraction of the default, and whether all wavelengths are compared (with `full`,
    they always are).
    """

    name: str
    file: Path
    all_elements: bool = False
    time: tuple | None = None
    share: float = 1
    all_wavelengths: bool = True


SCENES = [
    Exported("mirror room", environment.ROOT / "scenes/mirror_room/scene.toml", True, (12000, 500, 32)),
    Exported("Cornell box", environment.HERE / "speed/cornell.toml", True, (20000, 500, 32)),
    Exported("glass ball", HERE / "glass.toml"),
    # For tables, Mitsuba takes minutes to compile its kernel, and compiles it again for each wavelength.
    Exported("measured balls", HERE / "measured.toml", share=0.25, all_wavelengths=False),
    Exported("glTF knot", HERE / "knot.toml", all_elements=True),
    Exported("lamps", HERE / "lamps.toml"),
    Exported("sky", HERE / "sky.toml"),
]


def prepare(scene, folder):
    """Write a copy at the size for comparisons and return its path.

    It keeps the original except for the image's size, the slices and the figures. Facets mask each other as in Mitsuba.
    """
    text = scene.file.read_text()
    text = text[: text.index("[[slices]]")]
    text = re.sub(r"resolution = \[\d+, \d+\]", f"resolution = [{RESOLUTION}, {RESOLUTION}]", text, count=1)
    text = re.sub(r'file = "(?!tables)', f'file = "{scene.file.parent}/', text)
    rough = r"((?:rough_conductor|plastic) = \{(?!.*masking)[^\n]*?) \}\n"
    text = re.sub(rough, r'\1, masking = "separable" }\n', text)
    text = re.sub(r"\ntile = \d+", "", text).replace("[render]\n", "[render]\ntile = 8\n")
    text += '[[slices]]\nname = "mueller"\npolarization = "mueller"\n'
    if scene.time:
        start, width, bins = scene.time
        text += (f'[[slices]]\nname = "transient"\npolarization = "mueller"\n'
                 f"time = {{ start_ps = {start}, bin_ps = {width}, bins = {bins} }}\n")
    path = folder / f"{scene.name.replace(' ', '_')}.toml"
    path.write_text(text)
    if "tables/" in text:
        tables(folder / "tables")
    if "lamp.png" in text:
        squares = np.array([[255, 60, 10], [0, 200, 90], [128, 128, 255], [30, 250, 0]], np.uint8).reshape(2, 2, 3)
        mi.Bitmap(squares).write(str(folder / "lamp.png"))
    if "sky.exr" in text:
        mi.Bitmap(sky()).write(str(folder / "sky.exr"))
    return path


def sky():
    """Return radiances of a gradient with a broad sun, each in a different colour."""
    theta, phi = np.meshgrid(np.pi * (np.arange(32) + 0.5) / 32, 2 * np.pi * (np.arange(64) + 0.5) / 64, indexing="ij")
    sun = np.exp(8 * (np.sin(theta) * np.cos(phi - 1) * np.sin(0.9) + np.cos(theta) * np.cos(0.9) - 1))
    out = np.stack([0.3 + 0.2 * np.cos(theta) + weight * sun for weight in (6, 4, 2)], axis=-1)
    return out.astype(np.float32)


def tables(folder):
    """Write the tables of measured.toml with zeros in place of NaN.

    An entry with light or viewer below the horizon is NaN. Next to such an entry, Mitsuba returns zero, while Sunstone
    interpolates from the valid entries. This affects 8 of 256 squares of two pixels, all at the rim or the terminator of the
    spheres: 0.002875 against Mitsuba's 0.002656, while the tabulated material gives 0.002866. Both programs treat zeros in the
    same way.
    """
    from mitsuba.python import tensor_io

    programs.sunstone("pbrdf", "synth", HERE / "tables.toml", "-o", folder, "--resolution", "41x31x31")
    for path in folder.glob("*.pbsdf"):
        with contextlib.redirect_stdout(None):
            fields = tensor_io.read(str(path))
            tensor_io.write(str(path), **(fields | {"M": np.nan_to_num(fields["M"])}))


def export(toml, wavelength, change=lambda xml: xml):
    """Return Mitsuba's scene at one wavelength; `change` edits the XML before it is loaded."""
    out = toml.with_name(f"{toml.stem}_{wavelength:g}")
    programs.sunstone("export", toml, "--mitsuba", out, "--force", "--wavelength", wavelength)
    changed = out / "changed.xml"
    changed.write_text(change((out / "scene.xml").read_text()))
    return mi.load_file(str(changed))


def wavelengths(toml):
    return tomllib.loads(toml.read_text())["wavelengths_nm"]


def run(seed, llvm, folder, full):
    """Yield the pairs. `full`: all wavelengths also in scalar variants, and four times the samples."""
    more = 4 if full else 1
    for scene in SCENES:
        spp = round((128 if llvm else 32) * more * scene.share)
        toml = prepare(scene, folder)
        slices = ["mueller"] + ["transient"] * bool(scene.time)
        steady, *timed = programs.render(toml, (2048 if llvm else 1024) * more, seed, slices)
        nm = wavelengths(toml)
        for i in range(len(nm)) if full or (llvm and scene.all_wavelengths) else [1]:
            loaded = export(toml, nm[i])
            theirs = programs.stokes(loaded, spp, seed, BATCHES)
            mean, error = (image[i, ..., 0] for image in steady)
            yield Pair(scene.name, f"{nm[i]:g} nm", [f"s{j}" for j in range(4)], mean, error, theirs,
                       frames.angles(loaded.sensors()[0]), BLOCK, wrong={"wavelength": steady[0][i - 1, ..., 0]})
        if llvm:
            middle = len(nm) // 2
            if scene.all_elements:
                yield columns(scene, toml, nm[middle], [image[middle] for image in steady], spp, seed)
            if scene.time:
                import transient

                yield transient.run(scene, toml, nm[middle], [image[middle] for image in timed[0]], spp, seed)


def columns(scene, toml, wavelength, ours, spp, seed):
    """Return all 16 elements, rendered with mueller_integrator.py."""
    import mueller_integrator

    loaded = export(toml, wavelength)
    description = tomllib.loads(toml.read_text())
    light, depth = source(description, wavelength), description["render"]["max_depth"]
    images = [
        mueller_integrator.render(loaded, light, depth, spp, seed * BATCHES + i)[:, :, 0] for i in range(BATCHES)
    ]
    flat = lambda a: np.asarray(a).reshape(*np.shape(a)[:-2], 16)
    elements = [f"T{i}{j}" for i in range(4) for j in range(4)]
    return Pair(scene.name, f"{wavelength:g} nm, all", elements, *map(flat, ours), flat(images), block=2 * BLOCK)


def source(scene, wavelength):
    """Return the only light of a scene file in the form that mueller_integrator.py accepts."""
    import mueller_integrator

    at = lambda value: value if isinstance(value, (int, float)) else value[scene["wavelengths_nm"].index(wavelength)]
    if "projector" not in scene:
        point = scene["emitters"][0]["point"]
        return point["position"], at(point["intensity"]), point.get("horizontal", [1, 0, 0])
    projector = scene["projector"]
    look = projector["pose"]["look_at"]
    forward = np.subtract(look["target"], look["origin"])
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, look.get("up", [0, 1, 0]))
    right /= np.linalg.norm(right)
    w, h = projector["resolution"]
    intensity = mueller_integrator.projector(
        at(projector["irradiance"]), projector["fov_x_deg"], w / h, forward, right, np.cross(forward, right)
    )
    return look["origin"], intensity, right.tolist()

"""Compare imported geometry with Mitsuba: glass that touches a table, and `serialized` meshes of two versions and precisions.

Mitsuba renders each scene, and Sunstone renders its import. The means of all pixels must agree within five standard errors of the
difference. With --power the planted errors (a block lifted off its table, another mesh of the same file) must be detected.
"""

import argparse
import json
import struct
import sys
import tempfile
import zlib
from pathlib import Path

import environment

environment.enter()

import mitsuba as mi
import numpy as np

from programs import render, sunstone

SIZE = 48
BATCHES = 16
LIMIT = 5.0


def serialized(version, double, shapes):
    """Return a file of triangle meshes (positions, faces), with the list of their offsets at its end."""
    out, starts = b"", []
    for positions, faces in shapes:
        starts.append(len(out))
        data = struct.pack("<I", 0x2000 if double else 0x1000) + (b"mesh\0" if version == 4 else b"")
        data += struct.pack("<QQ", len(positions), len(faces))
        data += np.asarray(positions, "<f8" if double else "<f4").tobytes() + np.asarray(faces, "<u4").tobytes()
        out += struct.pack("<HH", 0x041C, version) + zlib.compress(data)
    out += np.asarray(starts, "<u8" if version == 4 else "<u4").tobytes()
    return out + struct.pack("<I", len(shapes))


def tetrahedron(size):
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * size
    return positions, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]


def scene(shapes):
    camera = {
        "type": "perspective",
        "fov": 40.0,
        "to_world": mi.ScalarTransform4f().look_at(origin=[0, -4, 2.5], target=[0, 0, 0.2], up=[0, 0, 1]),
        "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}},
        "sampler": {"type": "independent", "sample_count": 64},
    }
    light = {"type": "constant", "radiance": 1.0}
    return {"type": "scene", "integrator": {"type": "path", "max_depth": 16}, "sensor": camera, "light": light, **shapes}


def table(height=0.0):
    place = mi.ScalarTransform4f().translate([0, 0, height]).scale(2)
    bsdf = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}
    return {"type": "rectangle", "to_world": place, "bsdf": bsdf}


def block(low):
    place = mi.ScalarTransform4f().translate([0, 0, low + 0.25]).scale([0.5, 0.5, 0.25])
    return {"type": "cube", "to_world": place, "bsdf": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}}


def mesh(file, index):
    bsdf = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}
    return {"type": "serialized", "filename": str(file), "shape_index": index, "face_normals": True, "bsdf": bsdf}


def cases(folder):
    """Yield names, and the scenes for Mitsuba, for Sunstone, and for Sunstone with an error."""
    yield "touching", *(scene({"table": table(), "block": block(z)}) for z in (0.0, 0.0, 2e-3))
    yield "touching 0.3 m up", *(scene({"table": table(0.3), "block": block(z)}) for z in (0.3, 0.3, 0.302))
    for version in (3, 4):
        for double in (False, True):
            file = folder / f"{version}{double}.serialized"
            file.write_bytes(serialized(version, double, [tetrahedron(0.5), tetrahedron(1.0)]))
            one = [scene({"table": table(), "mesh": mesh(file, i)}) for i in (1, 1, 0)]
            yield f"serialized {version}, {'double' if double else 'single'}", *one


def ours(folder, name, described, spp):
    toml = folder / "scene.toml"
    document = folder / "scene.json"
    document.write_text(json.dumps(described, default=lambda transform: np.array(transform.matrix).tolist()))
    notes = sunstone("import", document, "-o", toml, "--force").stderr
    (mean, error), = render(toml, spp, 1)
    values, errors = mean[..., 0, 0].mean(0), error[..., 0, 0].mean(0)
    return values.mean(), np.sqrt((errors**2).sum()) / values.size, notes


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--power", action="store_true", help="check that planted errors are detected")
    parser.add_argument("--spp", type=int, default=256)
    arguments = parser.parse_args()
    mi.set_variant("scalar_rgb")
    wrong = []
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        for name, theirs, same, planted in cases(folder):
            loaded = mi.load_dict(theirs)
            spp = max(arguments.spp // BATCHES, 1)
            means = [np.array(mi.render(loaded, spp=spp, seed=i))[..., 0].mean() for i in range(BATCHES)]
            want, want_error = np.mean(means), np.std(means, ddof=1) / np.sqrt(BATCHES)
            got, error, notes = ours(folder, name, planted if arguments.power else same, arguments.spp)
            z = (got - want) / np.hypot(error, want_error)
            silent = name.startswith("touching") and not arguments.power and "touches" not in notes
            agrees = abs(z) < LIMIT and not silent
            print(f"{name:24} Mitsuba {want:.5f} ± {want_error:.5f}, Sunstone {got:.5f} ± {error:.5f}, z {z:+.1f}")
            if agrees == arguments.power:
                wrong.append(name)
    if wrong:
        print(f"{'not found' if arguments.power else 'different'}: {', '.join(wrong)}", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Check the import of shapes that a mirroring scale or `flip_normals` turns inside out, against Mitsuba.

Covers every Mitsuba shape that Sunstone supports, and meshes with normals, without normals and with `face_normals`; each with no
scale, x = -1, z = -1 and all three -1, with and without `flip_normals`. One scene shows the shape as a one-sided diffuse surface,
as glass and as an area light, next to each other under a uniform sky. The mean of each third of the image must agree within 3 %
(Mitsuba's noise is below 1 %). Exits with 1 if a mean does not agree.
"""

import argparse
import sys

import environment

if not {"-h", "--help"} & set(sys.argv):
    if __name__ == "__main__":
        environment.enter()
    import mitsuba as mi
    import numpy as np

    import programs

OUT = environment.ROOT / "target/orientation"
SIZE, SPP, BOUND = 12, 64, 0.03
SCALES = ['x="1"', 'x="-1"', 'z="-1"', 'x="-1" y="-1" z="-1"']
MATERIALS = ['<bsdf type="diffuse"/>', '<bsdf type="dielectric"/>', '<emitter type="area"/>']
SCENE = """<scene version="3.0.0">
<integrator type="path"><integer name="max_depth" value="6"/><integer name="rr_depth" value="100"/></integrator>
<sensor type="perspective"><float name="fov" value="36"/>
<transform name="to_world"><lookat origin="0, 0.7, 16" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/><rfilter type="box"/></film>
</sensor>
<emitter type="constant"><float name="radiance" value="0.3"/></emitter>
{shapes}</scene>
"""


def octahedron(path, normals):
    """Write a subdivided octahedron as OBJ, with or without vertex normals."""
    corners = [np.array(p, float) for p in [(1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)]]
    faces = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    for _ in range(2):
        middle, finer = {}, []
        for face in faces:
            ids = []
            for a, b in zip(face, face[1:] + face[:1], strict=True):
                key = min(a, b), max(a, b)
                if key not in middle:
                    p = corners[a] + corners[b]
                    middle[key] = len(corners)
                    corners.append(p / np.linalg.norm(p))
                ids.append(middle[key])
            x, y, z = ids
            finer += [(face[0], x, z), (face[1], y, x), (face[2], z, y), (x, y, z)]
        faces = finer
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in corners]
    if normals:
        lines += [f"vn {x:.9g} {y:.9g} {z:.9g}" for x, y, z in corners]
    corner = (lambda i: f"{i + 1}//{i + 1}") if normals else (lambda i: f"{i + 1}")
    path.write_text("\n".join(lines + ["f " + " ".join(map(corner, face)) for face in faces]) + "\n")


def shapes():
    """Yield name, plugin, and content of the element."""
    octahedron(OUT / "bare.obj", False)
    octahedron(OUT / "normals.obj", True)
    file = lambda name: f'<string name="filename" value="{name}.obj"/>'
    flat = '<boolean name="face_normals" value="true"/>'
    tube = '<point name="p0" x="0" y="-1" z="0"/><point name="p1" x="0" y="1" z="0"/><float name="radius" value="0.6"/>'
    return [("sphere", "sphere", ""), ("cylinder", "cylinder", tube), ("disk", "disk", ""), ("rectangle", "rectangle", ""),
            ("cube", "cube", ""), ("mesh", "obj", file("bare")), ("mesh with normals", "obj", file("normals")),
            ("flat mesh", "obj", file("normals") + flat)]


def scene(kind, inside, scale, flip):
    """Return the XML of one shape in each material."""
    if flip:
        inside += '<boolean name="flip_normals" value="true"/>'
    parts = [f'<shape type="{kind}">{inside}<transform name="to_world"><scale {scale}/><rotate x="1" angle="15"/>'
             f'<rotate y="1" angle="25"/><translate x="{x}"/></transform>{material}</shape>'
             for x, material in zip((-3.5, 0, 3.5), MATERIALS, strict=True)]
    return SCENE.format(width=3 * SIZE, height=SIZE, shapes="\n".join(parts))


def thirds(image):
    """Return the means of the left, middle and right third."""
    return image.reshape(SIZE, 3, SIZE).mean((0, 2))


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    mi.set_variant("scalar_rgb")
    good = True
    print(f"{'shape':18} {'scale':22} {'flipped':8} Sunstone / Mitsuba: diffuse, glass, area light")
    for name, kind, inside in shapes():
        for scale in SCALES:
            for flip in (False, True):
                xml, toml = OUT / "scene.xml", OUT / "scene.toml"
                xml.write_text(scene(kind, inside, scale, flip))
                programs.sunstone("import", xml, "-o", toml, "--force", "-D", "wavelengths_nm=550")
                ((mean, _),) = programs.render(toml, SPP, 1)
                ours = thirds(mean[0, :, :, 0, 0])
                theirs = thirds(np.array(mi.render(mi.load_file(str(xml)), spp=SPP))[..., 1])
                agree = np.abs(ours - theirs) <= BOUND * theirs
                good &= bool(agree.all())
                ratios = ", ".join(f"{r:.3f}" for r in ours / theirs)
                print(f"{name:18} {scale:22} {'yes' if flip else 'no':8} {ratios}  {'agree' if agree.all() else 'DIFFER'}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

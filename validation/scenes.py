"""Scenes for both programs, built from the same numbers.

Every method of `Scene` writes one item twice: as TOML text for Sunstone and as an entry of Mitsuba's scene dictionary. Lengths
are in metres; there is one wavelength. Reflectances and indices are plain numbers, passed explicitly to both sides (Mitsuba's own
metal tables and its default exterior index, air, differ from Sunstone's).
"""

import math

import numpy as np

WAVELENGTH_NM = 550
RESOLUTION = 24
FIELD_OF_VIEW_DEG = 30.0
GOLD = (0.4242, 2.4721)
SILVER = (0.0596, 3.5974)


class Scene:
    """One scene in both formats. The camera is at `origin`, looks at `target`, with +y up."""

    def __init__(self, name, llvm, origin, target, max_depth, time=None):
        self.name, self.llvm, self.max_depth, self.time = name, llvm, max_depth, time
        self.origin, self.target = np.array(origin, float), np.array(target, float)
        bins = time and f"{{ start_ps = {time[0]}, bin_ps = {time[1]}, bins = {time[2]} }}"
        self._head = f"""
name = "{name}"
wavelengths_nm = [{WAVELENGTH_NM}]
[render]
max_depth = {max_depth}
rr_depth = {max_depth}
tile = 8
[camera]
resolution = [{RESOLUTION}, {RESOLUTION}]
fov_x_deg = {FIELD_OF_VIEW_DEG}
pose.look_at = {{ origin = {list(origin)}, target = {list(target)}, up = [0, 1, 0] }}
[[slices]]
name = "mueller"
polarization = "mueller"
time = {bins or '"sum"'}
"""
        self._toml = ""
        self._parts = {}

    # Materials. Mitsuba's opaque BSDFs are one-sided, Sunstone's two-sided: hence `twosided`.

    def _material(self, name, toml, bsdf):
        self._toml += f"[materials.{name}]\n{toml}\n"
        self._parts[name] = {**bsdf, "id": name}

    def diffuse(self, name, albedo):
        bsdf = {"type": "diffuse", "reflectance": uniform(albedo)}
        self._material(name, f"diffuse.albedo = {albedo}", {"type": "twosided", "bsdf": bsdf})

    def conductor(self, name, index):
        (n, k) = index
        bsdf = {"type": "conductor", "eta": uniform(n), "k": uniform(k)}
        self._material(name, f"conductor = {{ n = {n}, k = {k} }}", {"type": "twosided", "bsdf": bsdf})

    def rough_conductor(self, name, index):
        """Add a GGX conductor, for which the programs differ by design.

        Mitsuba masks with the separable G1(wi) G1(wo), Sunstone with the height-correlated G2 (Heitz 2014), which is about 0.5 %
        brighter in these scenes at alpha = 0.3. With LLVM, masking.py gives Mitsuba the same G2. Without LLVM, this would be too
        slow; a smaller alpha then makes the difference, which scales as alpha^4, negligible.
        """
        (n, k) = index
        alpha = 0.3 if self.llvm else 0.1
        bsdf = {"type": "roughconductor", "distribution": "ggx", "alpha": alpha, "eta": uniform(n), "k": uniform(k)}
        if self.llvm:
            bsdf = {"type": "height_correlated", "alpha": alpha, "nested": bsdf}
        toml = f"rough_conductor = {{ n = {n}, k = {k}, alpha = {alpha} }}"
        self._material(name, toml, {"type": "twosided", "bsdf": bsdf})

    def dielectric(self, name, ior):
        bsdf = {"type": "dielectric", "int_ior": ior, "ext_ior": 1.0}
        self._material(name, f"dielectric = {{ ior = {ior}, exterior_ior = 1.0 }}", bsdf)

    # Shapes

    def _object(self, toml, material, shape):
        self._toml += f'[[objects]]\nshape.{toml}\nmaterial = "{material}"\n'
        self._parts[f"shape{len(self._parts)}"] = {**shape, "bsdf": {"type": "ref", "id": material}}

    def rectangle(self, corner, u, v, material):
        toml = f"rectangle = {{ corner = {list(corner)}, u = {list(u)}, v = {list(v)} }}"
        c, u, v = (np.array(a, float) for a in (corner, u, v))
        n = np.cross(u, v)
        matrix = np.eye(4)
        matrix[:3] = np.stack([u / 2, v / 2, n / np.linalg.norm(n), c + (u + v) / 2], axis=1)
        self._object(toml, material, {"type": "rectangle", "to_world": matrix})

    def sphere(self, center, radius, material):
        toml = f"sphere = {{ center = {list(center)}, radius = {radius} }}"
        self._object(toml, material, {"type": "sphere", "center": list(center), "radius": radius})

    # Light

    def point(self, position, intensity, horizontal=(1, 0, 0)):
        self._toml += (f"[[emitters]]\npoint = {{ position = {list(position)}, intensity = {intensity}, "
                       f"horizontal = {list(horizontal)} }}\n")
        self._parts["light"] = {"type": "point", "position": list(position), "intensity": uniform(intensity)}
        self.light = position, intensity, horizontal

    def environment(self, radiance):
        self._toml += f"[[emitters]]\nenvironment = {{ radiance = {radiance} }}\n"
        self._parts["light"] = {"type": "constant", "radiance": uniform(radiance)}

    def projector(self, origin, target, fov_x_deg, irradiance):
        self._toml += (f"[projector]\nresolution = [16, 16]\nfov_x_deg = {fov_x_deg}\nirradiance = {irradiance}\n"
                       f"pose.look_at = {{ origin = {list(origin)}, target = {list(target)}, up = [0, 1, 0] }}\n")
        # Mitsuba's projector gives pi times the irradiance that its documentation states for the same number.
        self._parts["light"] = {
            "type": "projector", "irradiance": uniform(irradiance), "scale": 1 / math.pi,
            "fov": fov_x_deg, "fov_axis": "x", "to_world": (origin, target),
        }

    # The two formats

    def toml(self):
        return self._head + self._toml

    def dictionary(self, mi):
        """Return the scene for `mi.load_dict`. Mitsuba's Stokes integrator renders the first column of Sunstone's Mueller images.
        """
        look_at = lambda a, b: mi.ScalarTransform4f().look_at(origin=list(a), target=list(b), up=[0, 1, 0])
        parts = {}
        for key, part in self._parts.items():
            place = part.get("to_world")
            if isinstance(place, tuple):
                part = {**part, "to_world": look_at(*place)}
            elif place is not None:
                part = {**part, "to_world": mi.ScalarTransform4f(place)}
            parts[key] = part
        film = {"type": "hdrfilm", "width": RESOLUTION, "height": RESOLUTION, "rfilter": {"type": "box"}}
        return {
            "type": "scene",
            "integrator": {"type": "stokes", "nested": {
                "type": "path", "max_depth": self.max_depth, "rr_depth": self.max_depth + 1}},
            "sensor": {"type": "perspective", "fov": FIELD_OF_VIEW_DEG, "fov_axis": "x", "near_clip": 1e-3,
                       "to_world": look_at(self.origin, self.target), "film": film,
                       "sampler": {"type": "independent"}},
            **parts,
        }

    def camera_axes(self):
        """Return image right, image up and forward in world coordinates."""
        forward = self.target - self.origin
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 1, 0])
        right /= np.linalg.norm(right)
        return right, np.cross(right, forward), forward


def uniform(value):
    """Return a constant spectrum."""
    return {"type": "uniform", "value": value}


def box(scene, left, right, floor, back):
    """Add four walls of the cube [-1, 1]^3; ceiling and front are open."""
    scene.rectangle((-1, -1, 1), (0, 0, -2), (0, 2, 0), left)
    scene.rectangle((1, -1, -1), (0, 0, 2), (0, 2, 0), right)
    scene.rectangle((-1, -1, 1), (2, 0, 0), (0, 0, -2), floor)
    scene.rectangle((-1, -1, -1), (2, 0, 0), (0, 2, 0), back)


def gold_box(name, llvm):
    """Return a scene of Lambertian surfaces and rough gold, whose interreflections are polarized linearly and circularly."""
    scene = Scene(name, llvm, origin=(0.2, 0.9, 4), target=(0, -0.2, 0), max_depth=4)
    scene.diffuse("grey", 0.5)
    scene.rough_conductor("gold", GOLD)
    box(scene, "gold", "grey", "gold", "grey")
    scene.sphere((0.2, -0.5, 0.1), 0.45, "gold")
    return scene


def point_light(llvm=True):
    scene = gold_box("gold, point light", llvm)
    scene.point((0.4, 0.8, 1.5), 10.0)
    return scene


def projector_light(llvm=True):
    scene = gold_box("gold, projector", llvm)
    scene.projector((-0.5, 0.7, 3), (0, -0.2, 0), 40.0, 10.0)
    return scene


def mirror_and_glass(llvm=True):
    """Return a scene of smooth interfaces: a mirror, total internal reflection and refraction in a glass sphere, seen against lit
    walls.
    """
    scene = Scene("mirror and glass", llvm, origin=(0.2, 0.9, 4), target=(0, -0.2, 0), max_depth=6)
    scene.diffuse("grey", 0.6)
    scene.conductor("silver", SILVER)
    scene.conductor("gold", GOLD)
    scene.dielectric("glass", 1.5185)
    box(scene, "silver", "grey", "gold", "grey")
    scene.sphere((0.2, -0.5, 0.1), 0.45, "glass")
    scene.point((0.4, 0.8, 1.5), 10.0)
    return scene


def environment(llvm=True):
    scene = Scene("gold, environment", llvm, origin=(0.5, 1.2, 4), target=(0, 0, 0), max_depth=4)
    scene.rough_conductor("gold", GOLD)
    scene.diffuse("grey", 0.5)
    scene.sphere((0, 0, 0), 0.6, "gold")
    scene.rectangle((-0.8, -0.6, 0.8), (1.6, 0, 0), (0, 0, -1.6), "gold")
    scene.rectangle((-0.8, -0.6, -0.8), (1.6, 0, 0), (0, 1.2, 0), "grey")
    scene.environment(1.0)
    return scene


def corner(llvm=True):
    """Return two walls and a floor of rough gold: two or three reflections fill all 16 elements and differ in travel time."""
    scene = Scene("gold corner", llvm, origin=(0.3, 0.8, 3), target=(0, -0.4, -0.4), max_depth=4, time=(14000, 1500, 10))
    scene.rough_conductor("gold", GOLD)
    box(scene, "gold", "gold", "gold", "gold")
    scene.point((-0.6, 0.5, 1.2), 10.0, (0.8, 0.6, 0))
    return scene


STOKES = [point_light, projector_light, mirror_and_glass, environment]

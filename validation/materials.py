"""The materials that bsdf.py compares, each in both programs' formats, and the known differences between them."""

from dataclasses import dataclass

import mitsuba as mi
import numpy as np

WAVELENGTHS = [450.0, 550.0, 650.0]
BOUND = 1e-4
GOLD = {"n": [1.3831, 0.4242, 0.1540], "k": [1.9155, 2.4721, 3.5893]}


@dataclass
class Case:
    """One material in both programs' formats."""

    name: str
    toml: str
    bsdf: dict
    # "brdf": any two directions. "mirror", "refract": the direction of a delta lobe.
    lobe: str = "brdf"
    bound: float = BOUND
    note: str = ""
    # Range of the angle between incoming light and the normal, degrees.
    theta: tuple = (0, 89)
    # Range of the same angle of outgoing light, for BRDFs.
    theta_out: tuple = (0, 89)
    # Reference where Mitsuba's BSDF is not polarized. "facet": its M00 times the facet's matrix from `mi.mueller`. "plate": the
    # orders of reflection in a plate, from `mi.mueller` alone. "unpolarized plate": Sunstone's matrices are reduced to what
    # Mitsuba computes.
    completed: str = ""
    # The axes (columns) of the nested BSDF, if Mitsuba passes its matrix on in the Stokes frames of those axes.
    local: np.ndarray | None = None
    # Other materials that `toml` refers to.
    others: str = ""
    # Compared elements: all 16, or only quantities that no change of frames affects.
    frame_free: bool = False
    # The microfacet part of `bsdf` alone, with its roughness: its masking is replaced by the exact one (see `masking_ratio`).
    microfacet: dict | None = None
    # Skips pairs with a smaller cosine between direction and facet.
    least_facet_cos: float = 0.0


def spectrum(values):
    """Return a spectrum that Mitsuba interpolates to exactly these values at WAVELENGTHS."""
    if isinstance(values, (int, float)):
        return {"type": "uniform", "value": float(values)}
    pairs = list(zip(WAVELENGTHS, map(float, values)))
    return {"type": "spectrum", "value": pairs}


def write_table(path):
    """Write a smooth table with all 16 elements, different for every sign of every angle, with Mitsuba's own writer."""
    import contextlib
    import io

    from mitsuba.python import tensor_io

    phi, difference, half = np.linspace(-np.pi, np.pi, 37), np.linspace(0, np.pi / 2, 16), np.linspace(0, np.pi / 2, 19)
    bands = np.array([450, 500, 550, 600, 650])
    p, d, h, w = np.meshgrid(phi, difference, half, bands, indexing="ij")
    table = np.empty((*p.shape, 4, 4), np.float32)
    for i, j in np.ndindex(4, 4):
        wave = np.cos(p + i) * np.sin(d + 0.3 * j) + np.sin(2 * p - j) * np.cos(h + 0.2 * i) + np.cos(w / 100 + i + 2 * j)
        table[..., i, j] = 0.2 * wave if i or j else 2 + 0.5 * wave
    axes = {"phi_d": phi, "theta_d": difference, "theta_h": half}
    with contextlib.redirect_stdout(io.StringIO()):
        tensor_io.write(
            str(path), **{k: v[None].astype(np.float32) for k, v in axes.items()}, wvls=bands.astype(np.uint16), M=table
        )


def cases(folder):
    """Yield the comparisons; files that both programs read are written to `folder`."""
    gold = f"n = {GOLD['n']}, k = {GOLD['k']}"
    gold_mi = {"eta": spectrum(GOLD["n"]), "k": spectrum(GOLD["k"])}
    glass = {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}
    yield Case("diffuse", "diffuse.albedo = [0.2, 0.5, 0.8]", {"type": "diffuse", "reflectance": spectrum([0.2, 0.5, 0.8])})
    yield Case("conductor", f"conductor = {{ {gold} }}", {"type": "conductor", **gold_mi}, "mirror")
    glass_toml = "dielectric = { ior = 1.5 }"
    # Closer to the critical angle, the comparison would only show the single precision of the refracted direction.
    into, out_of = (0, 85), (139, 180)
    yield Case("dielectric, reflection", glass_toml, glass, "mirror")
    yield Case("dielectric, reflection inside, total too", glass_toml, glass, "mirror", theta=(91, 180))
    yield Case("dielectric, refraction in", glass_toml, glass, "refract", theta=into)
    yield Case("dielectric, refraction out", glass_toml, glass, "refract", theta=out_of)
    for kind in ("ggx", "beckmann"):
        rough = f"alpha = 0.3, distribution = '{kind}', masking = 'separable'"
        rough_mi = {"alpha": 0.3, "distribution": kind}
        exact = kind == "beckmann"
        masking = "Mitsuba's fit of Beckmann's masking replaced by the exact one" if exact else ""
        metal = {"type": "roughconductor", **gold_mi, **rough_mi}
        yield Case(
            f"roughconductor, {kind}",
            f"rough_conductor = {{ {gold}, {rough} }}",
            metal,
            microfacet=metal if exact else None,
            note=masking,
        )
        albedo = [0.1, 0.5, 0.7]
        plastic = {"type": "pplastic", "int_ior": 1.5, "ext_ior": 1.0, **rough_mi}
        yield Case(
            f"pplastic, {kind}",
            f"plastic = {{ albedo = {albedo}, ior = 1.5, {rough} }}",
            {**plastic, "diffuse_reflectance": spectrum(albedo)},
            # Mitsuba refracts the ray twice in single precision, which loses digits near the horizon.
            theta=(0, 85),
            theta_out=(0, 85),
            microfacet={**plastic, "diffuse_reflectance": 0.0} if exact else None,
            note=masking,
        )
        unpolarized = "M00 of Mitsuba, which is not polarized; the others over it by mi.mueller"
        rough_glass = {"type": "roughdielectric", "int_ior": 1.5, "ext_ior": 1.0, **rough_mi}
        for what, theta, theta_out in (
            ("reflection", (0, 89), (0, 89)),
            ("reflection inside", (91, 180), (91, 180)),
            ("refraction in", (0, 85), (95, 180)),
            ("refraction out", (95, 180), (0, 85)),
        ):
            yield Case(
                f"roughdielectric, {kind}, {what}",
                f"rough_dielectric = {{ ior = 1.5, {rough} }}",
                rough_glass,
                theta=theta,
                theta_out=theta_out,
                note=unpolarized + ("; " + masking if masking else ""),
                completed="facet",
                microfacet=rough_glass if exact else None,
                # Near a facet's critical angle, the single-precision error of Mitsuba is as large as its value.
                least_facet_cos=0.1 if "refraction" in what else 0.0,
            )
    table = folder / "table.pbsdf"
    write_table(table)
    yield Case(
        "measured_polarized",
        f"measured.file = '{table}'",
        {"type": "measured_polarized", "filename": str(table)},
        note="table written by mitsuba.python.tensor_io",
    )
    # Mitsuba rotates the absorbing axis by theta clockwise, Sunstone the transmitting axis counter-clockwise.
    yield Case("polarizer", "polarizer = { angle_deg = 30 }", {"type": "polarizer", "theta": -30.0}, "refract")
    yield Case("polarizer, from behind", "polarizer = { angle_deg = 30 }", {"type": "polarizer", "theta": -30.0}, "refract",
               theta=(91, 180))
    plate_mi = {"type": "retarder", "theta": 30.0, "delta": 100.0}
    retarder = "retarder = { retardance_deg = 100, angle_deg = 30, tilt = 'cosine' }", plate_mi
    tilted = "Mitsuba's tilted axis is no line in space"
    yield Case("retarder", *retarder, "refract", theta=(0, 0.001), note=f"normal incidence: {tilted}")
    yield Case("retarder, from behind", *retarder, "refract", theta=(179.999, 180), note=f"normal incidence: {tilted}")
    yield Case("retarder, tilted", *retarder, "refract", frame_free=True, note=f"M00, M33, size of M13 and M23: {tilted}")
    yield Case("null", "null = {}", {"type": "null"}, "refract")
    pane = "thin_dielectric = { ior = 1.5 }", {"type": "thindielectric", "int_ior": 1.5, "ext_ior": 1.0}
    for what, lobe in (("reflection", "mirror"), ("transmission", "refract")):
        yield Case(f"thindielectric, {what}", *pane, lobe, completed="unpolarized plate",
                   note="power, by way of Mitsuba's formula, which is not polarized")
        yield Case(f"thin plate, {what}", *pane, lobe, completed="plate", note="orders of reflection summed, by mi.mueller")
    yield from combinations(folder, gold, gold_mi)


def combinations(folder, gold, gold_mi):
    """Yield materials composed of others."""
    rough = "alpha = 0.3, distribution = 'ggx', masking = 'separable'"
    rough_mi = {"alpha": 0.3, "distribution": "ggx"}
    metal = f"rough_conductor = {{ {gold}, {rough} }}", {"type": "roughconductor", **gold_mi, **rough_mi}
    albedo = [0.1, 0.5, 0.7]
    coat = (
        f"plastic = {{ albedo = {albedo}, ior = 1.5, {rough} }}",
        {"type": "pplastic", "int_ior": 1.5, "ext_ior": 1.0, **rough_mi, "diffuse_reflectance": spectrum(albedo)},
    )
    both = f"[materials.metal]\n{metal[0]}\n[materials.coat]\n{coat[0]}\n"
    # As for plastic alone: single precision near the horizon.
    near = {"theta": (0, 85), "theta_out": (0, 85)}
    yield Case("blendbsdf", "blend = { a = 'metal', b = 'coat', weight = 0.3 }",
               {"type": "blendbsdf", "weight": 0.3, "a": metal[1], "b": coat[1]}, others=both, **near)
    two = "two_sided = { front = 'metal', back = 'coat' }", {"type": "twosided", "a": metal[1], "b": coat[1]}
    yield Case("twosided, front", *two, others=both)
    yield Case("twosided, back", *two, others=both, theta=(95, 180), theta_out=(95, 180), local=np.diag([1.0, 1, -1]),
               note="Mitsuba mirrors directions but not Stokes frames: done here")
    image = folder / "normals.png"
    # 20 degrees from the normal, within 8-bit precision.
    stored = np.array([160, 98, 249])
    mi.Bitmap(np.tile(np.uint8(stored), (4, 4, 1))).write(str(image))
    normal = 2 * stored / 255 - 1
    normal /= np.linalg.norm(normal)
    along = np.array([1.0, 0, 0]) - normal * normal[0]
    along /= np.linalg.norm(along)
    local = np.stack([along, np.cross(normal, along), normal], 1)
    texture = {"type": "bitmap", "filename": str(image), "raw": True, "filter_type": "nearest"}
    for name, (toml, bsdf) in {"metal": metal, "coat": coat}.items():
        yield Case(
            f"normalmap, {name}", f"normal_map = {{ material = '{name}', image = '{image}' }}",
            {"type": "normalmap", "normalmap": texture, "use_shadowing_function": False, "nested": bsdf},
            others=both, theta=(0, 65), theta_out=(0, 65), local=local,
            note="without Mitsuba's shadowing function; it leaves Stokes frames unturned: done here",
        )

#!/usr/bin/env python3
"""Every material against Mitsuba 3's BSDF of the same name: all 16 Mueller elements over random direction pairs.

Prints a table `material | pairs | max |dM|/M00 | bound` and exits with 1 if a row is above its bound. Both programs
evaluate the same model in the same directions, so this is no statistics: what is left is single precision, and
differences of the models that are named in the last column.

`--power` plants an error in each of our matrices and checks that every row notices it.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import mitsuba as mi
    import numpy as np

WAVELENGTHS = [450.0, 550.0, 650.0]
BOUND = 1e-4
GOLD = {"n": [1.3831, 0.4242, 0.1540], "k": [1.9155, 2.4721, 3.5893]}


@dataclass
class Case:
    """One material in both languages."""

    name: str
    toml: str
    bsdf: dict
    # "brdf": any two directions. "mirror", "refract": a delta lobe.
    lobe: str = "brdf"
    bound: float = BOUND
    note: str = ""
    # Range of the angle between incoming light and the normal, degrees.
    theta: tuple = (0, 89)
    # The same of outgoing light, for BRDFs.
    theta_out: tuple = (0, 89)
    # Compare M00 alone (where Mitsuba's model is not polarized).
    intensity_only: bool = False
    # The microfacet part of `bsdf` by itself, with its roughness: its masking is made exact (see `masking_ratio`).
    microfacet: dict | None = None
    # Skips pairs that meet their facet under a cosine below this.
    least_facet_cos: float = 0.0


def spectrum(values):
    """A spectrum that Mitsuba interpolates to exactly these values at WAVELENGTHS."""
    if isinstance(values, (int, float)):
        return {"type": "uniform", "value": float(values)}
    pairs = list(zip(WAVELENGTHS, map(float, values)))
    return {"type": "spectrum", "value": pairs}


def write_table(path):
    """A smooth table with all 16 elements, different for every sign of every angle, written by Mitsuba's own writer."""
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
    """What is compared; files that both programs read go to `folder`."""
    gold = f"n = {GOLD['n']}, k = {GOLD['k']}"
    gold_mi = {"eta": spectrum(GOLD["n"]), "k": spectrum(GOLD["k"])}
    glass = {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}
    yield Case("diffuse", "diffuse.albedo = [0.2, 0.5, 0.8]", {"type": "diffuse", "reflectance": spectrum([0.2, 0.5, 0.8])})
    yield Case("conductor", f"conductor = {{ {gold} }}", {"type": "conductor", **gold_mi}, "mirror")
    glass_toml = "dielectric = { ior = 1.5 }"
    # Nearer to the critical angle single precision of the refracted direction is all that is seen.
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
            # Mitsuba refracts the ray and back again in single precision, which costs digits at the horizon.
            theta=(0, 85),
            theta_out=(0, 85),
            microfacet={**plastic, "diffuse_reflectance": 0.0} if exact else None,
            note=masking,
        )
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
                note="M00 alone, Mitsuba's is not polarized" + ("; " + masking if masking else ""),
                intensity_only=True,
                microfacet=rough_glass if exact else None,
                # Near the critical angle of a facet Mitsuba's single precision is off by up to its whole value.
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
    # Mitsuba turns the absorbing axis by theta clockwise, we the transmitting one counter-clockwise.
    yield Case("polarizer", "polarizer = { angle_deg = 30 }", {"type": "polarizer", "theta": -30.0}, "refract")
    yield Case(
        "retarder",
        "retarder = { retardance_deg = 100, angle_deg = 30, tilt = 'cosine' }",
        {"type": "retarder", "theta": 30.0, "delta": 100.0},
        "refract",
        theta=(0, 0.001),
        note="normal incidence: Mitsuba's tilted axis is no line in space",
    )


# Mitsuba -------------------------------------------------------------------------------------------------------------


def rotation(angle):
    """R: Stokes vectors in a frame turned by `angle`, counter-clockwise looking toward the source. [n, 4, 4]"""
    c, s = np.cos(2 * angle), np.sin(2 * angle)
    r = np.zeros((len(angle), 4, 4))
    r[:, 0, 0] = r[:, 3, 3] = 1
    r[:, 1, 1] = r[:, 2, 2] = c
    r[:, 1, 2], r[:, 2, 1] = s, -s
    return r


def angle_between(travel, from_axis, to_axis):
    """By how much `from_axis` is turned to `to_axis`, both across `travel`."""
    c = np.einsum("ni,ni->n", to_axis, from_axis)
    s = np.einsum("ni,ni->n", to_axis, np.cross(travel, from_axis))
    return np.arctan2(s, c)


def to_our_frames(matrices, toward_light, frame_in, toward_eye, frame_out):
    """From Mitsuba's implicit frames (`stokes_basis` of the direction of travel) to the given ones."""

    def basis(travel):
        return np.array([np.array(mi.mueller.stokes_basis(mi.Vector3f(*v))).ravel() for v in travel])

    into = rotation(angle_between(-toward_light, frame_in, basis(-toward_light)))
    out = rotation(angle_between(toward_eye, basis(toward_eye), frame_out))
    return np.einsum("nij,nwjk,nkl->nwil", out, matrices, into)


def wavelength_matrices(value):
    """A Mitsuba spectrum of Mueller matrices as [wavelength, out, in]."""
    m = np.array(value, dtype=float)
    m = m.reshape(4, 4, -1) if m.shape[-1] == 4 and m.ndim == 3 else m
    return np.moveaxis(m, -1, 0)[: len(WAVELENGTHS)]


def interaction(toward_eye):
    """A surface in its own frame, seen from `toward_eye`."""
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*toward_eye)
    si.sh_frame = mi.Frame3f(mi.Vector3f(0, 0, 1))
    si.n = mi.Normal3f(0, 0, 1)
    si.uv = mi.Point2f(0.5, 0.5)
    si.t = 1.0
    si.wavelengths = mi.UnpolarizedSpectrum([*WAVELENGTHS, WAVELENGTHS[-1]])
    return si


def masking_ratio(alpha, directions):
    """Smith's G1 for Beckmann facets over the rational fit of Walter et al. (2007) that Mitsuba takes for it. [n]"""
    from math import erf

    cos = np.abs(directions[:, 2])
    a = cos / (alpha * np.sqrt(np.maximum(1 - cos**2, 1e-12)))
    exact = 2 / (1 + np.vectorize(erf)(a) + np.exp(-(a**2)) / (a * np.sqrt(np.pi)))
    fit = np.where(a >= 1.6, 1, (3.535 * a + 2.181 * a**2) / (1 + 2.276 * a + 2.577 * a**2))
    return exact / fit


def mitsuba(case, toward_light, toward_eye):
    """Mueller matrices [pair, wavelength, out, in] in Mitsuba's frames; BRDFs in 1/sr, delta lobes as they are."""
    result = raw(case, case.bsdf, toward_light, toward_eye)
    if case.microfacet:
        alpha = case.microfacet["alpha"]
        ratio = masking_ratio(alpha, toward_light) * masking_ratio(alpha, toward_eye)
        result += raw(case, case.microfacet, toward_light, toward_eye) * (ratio - 1)[:, None, None, None]
    return result


def raw(case, description, toward_light, toward_eye):
    """What one of Mitsuba's BSDFs says."""
    bsdf = mi.load_dict(description)
    context = mi.BSDFContext()
    result = []
    for light, eye in zip(toward_light, toward_eye):
        si = interaction(eye)
        if case.lobe == "brdf":
            m = wavelength_matrices(bsdf.eval(context, si, mi.Vector3f(*light))) / abs(light[2])
        else:
            # Whichever lobe a small or a large random number picks: the one that goes where `light` is.
            for pick in (0.0, 0.999999):
                bs, weight = bsdf.sample(context, si, pick, mi.Point2f(0.5, 0.5))
                if np.dot(np.array(bs.wo).ravel(), light) > 0.999:
                    break
            else:
                sys.exit(f"{case.name}: Mitsuba has no lobe from {light} to {eye}")
            m = wavelength_matrices(weight) * float(bs.pdf)
            if eye[2] * light[2] < 0 and float(bs.eta) != 1:
                # Radiance to power: Mitsuba's weights hold the squared ratio of the indices.
                m = m * float(bs.eta) ** 2
        result.append(m)
    return np.array(result)


# Sunstone ------------------------------------------------------------------------------------------------------------


def sunstone(case, folder, lines):
    """The answers of `sunstone pbrdf eval` to a list of directions in degrees."""
    (folder / "material.toml").write_text(f"wavelengths_nm = {WAVELENGTHS}\n[materials.m]\n{case.toml}\n")
    np.savetxt(folder / "directions.csv", lines, fmt="%.6f", delimiter=",")
    command = [environment.sunstone(), "pbrdf", "eval", "material.toml", "--directions", "directions.csv"]
    if case.lobe != "brdf":
        command.append(f"--{case.lobe}")
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if run.returncode:
        sys.exit(f"{case.name}: {run.stderr}")
    return json.loads(run.stdout)


def compare(case, pairs, seed, sabotage):
    """Number of pairs compared, and the largest |dM|/M00 over them, all wavelengths and elements."""
    random = np.random.default_rng(seed)
    if case.least_facet_cos:
        pairs *= 2
    # Uniform in the cosine.
    near, far = np.cos(np.radians(np.array([case.theta, case.theta_out]).T))
    theta = np.degrees(np.arccos(random.uniform(far, near, (pairs, 2))))
    phi = random.uniform(-180, 180, (pairs, 2))
    lines = np.stack([theta[:, 0], phi[:, 0], theta[:, 1], phi[:, 1]], 1)
    if case.lobe != "brdf":
        lines = lines[:, :2]
    with tempfile.TemporaryDirectory() as folder:
        answers = sunstone(case, Path(folder), lines)
    # Refracted directions come one for each wavelength; here they agree.
    out = [a["out"][0] if isinstance(a["out"], list) else a["out"] for a in answers]
    ours = np.array([a["mueller"] for a in answers])
    light, frame_in = (np.array([a["in"][k] for a in answers]) for k in ("direction", "frame"))
    eye, frame_out = (np.array([o[k] for o in out]) for k in ("direction", "frame"))
    if sabotage:
        ours = ours.copy()
        ours[..., 2, 3] += 2 * case.bound * ours[..., 0, 0]
        ours[..., 0, 0] *= 1 + 2 * case.bound
    if case.least_facet_cos:
        keep = facet_cosine(light, eye) > case.least_facet_cos
        light, frame_in, eye, frame_out, ours = (x[keep] for x in (light, frame_in, eye, frame_out, ours))
    theirs = to_our_frames(mitsuba(case, light, eye), light, frame_in, eye, frame_out)
    # Mitsuba sets distributions of facets below 1e-20 to zero: next to that, what is nothing to it is nothing.
    nothing = (theirs[..., :1, :1] == 0) & (ours[..., :1, :1] < 1e-15)
    difference = np.abs(ours - theirs) / np.where(nothing, 1, np.maximum(theirs[..., :1, :1], 1e-30))
    return len(ours), difference[..., 0, 0].max() if case.intensity_only else difference.max()


def facet_cosine(light, eye, ior=1.5):
    """The smaller cosine under which refracted light meets its facet."""
    index = np.where(np.stack([light[:, 2], eye[:, 2]]) > 0, 1.0, ior)[..., None]
    facet = index[0] * light + index[1] * eye
    facet /= np.linalg.norm(facet, axis=1, keepdims=True)
    return np.minimum(*(np.abs(np.einsum("ni,ni->n", facet, w)) for w in (light, eye)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=2000, help="random direction pairs for each material")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="rows whose name contains this")
    parser.add_argument("--power", action="store_true", help="check that a planted error is found in every row")
    options = parser.parse_args()
    mi.set_variant("scalar_spectral_polarized")
    print(f"Mitsuba {mi.__version__}, {mi.variant()}")
    print(f"{'material':44} | {'pairs':>6} | {'max |dM|/M00':>12} | {'bound':>8} |")
    with tempfile.TemporaryDirectory() as folder:
        failed = sum(not check(case, options) for case in cases(Path(folder)))
    if failed:
        sys.exit(f"{failed} rows failed")


def check(case, options):
    """Prints the row of a case; false if it is not as it should be."""
    if options.only and options.only not in case.name:
        return True
    pairs, worst = compare(case, options.pairs, options.seed, options.power)
    good = (worst <= case.bound) != options.power
    verdict = "" if good else "  FAILED"
    print(f"{case.name:44} | {pairs:6} | {worst:12.2e} | {case.bound:8.0e} | {case.note}{verdict}", flush=True)
    return good


if __name__ == "__main__":
    main()

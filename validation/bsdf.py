#!/usr/bin/env python3
"""Materials against Mitsuba 3's BSDF of the same name: Mueller elements over random direction pairs.

Prints a table `material | elements | pairs | max |dM|/M00 | bound` and exits with 1 if a row is above its bound. Both programs
evaluate the same model in the same directions, so this is no statistics: what is left is single precision, and
differences of the models that are named in the last column. The materials are listed in materials.py. Where Mitsuba's BSDF is
not polarized (rough and thin dielectrics), its other elements come from Mitsuba's own Fresnel matrices, `mi.mueller`.

`--record` writes results/bsdf_coverage.json: of each material what is compared, at which incidences, and what is not. Every
full run must compare what that file says.

`--power` plants errors in our matrices, one at a time: each element off by twice the bound, all brighter by 1 %, the frame of
light or of the camera turned by 0.5°, two wavelengths exchanged. Every row must notice every error that changes Mitsuba's own
matrices by more than the bound, and so many rows must be able to as FLOORS says.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import mitsuba as mi
    import numpy as np

    import materials
    from materials import WAVELENGTHS

RESULTS = environment.HERE / "results/bsdf_coverage.json"
# Materials of ours that Mitsuba 3 has no counterpart of.
WITHOUT = ["partial_depolarizer", "coated_conductor", "crystal", "plastic with single_scatter", "retarder with tilt = plate"]


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


def to_our_frames(matrices, toward_light, frame_in, toward_eye, frame_out, local):
    """From Mitsuba's implicit frames (`stokes_basis` of the direction of travel) to the given ones.

    `local` holds, as columns, the axes that Mitsuba took directions by when it chose those frames.
    """

    def basis(travel):
        return np.array([np.array(mi.mueller.stokes_basis(mi.Vector3f(*v))).ravel() for v in travel @ local]) @ local.T

    if np.linalg.det(local) < 0:
        # A mirror image: what is counter-clockwise is clockwise there.
        matrices = matrices * np.outer([1, 1, -1, -1], [1, 1, -1, -1])

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
    si.dp_du, si.dp_dv = mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0)
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


def fresnel(toward_light, toward_eye, frame_in, frame_out, refracts, ior=1.5):
    """`mi.mueller`'s matrices of the glass facet that takes light to the eye, in the given frames, [n, 1, out, in]."""
    index = np.where(np.stack([toward_light[:, 2], toward_eye[:, 2]]) > 0, 1.0, ior)[..., None]
    facet = index[0] * toward_light + index[1] * toward_eye
    # Where the directions are those of a mirror, or go straight through, any facet does that bisects them.
    facet /= np.linalg.norm(facet, axis=1, keepdims=True)
    facet *= np.sign(facet[:, 2:])
    across = np.cross(facet, toward_light)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    into = rotation(angle_between(-toward_light, frame_in, across))
    out = rotation(angle_between(toward_eye, across, frame_out))
    one = mi.mueller.specular_transmission if refracts else mi.mueller.specular_reflection
    cosines = np.einsum("ni,ni->n", facet, toward_light)
    blocks = np.array([gray(one(float(c), ior)) for c in cosines])
    return np.einsum("nij,njk,nkl->nil", out, blocks, into)[:, None]


def gray(matrix):
    """A matrix of Mitsuba's, at its first wavelength, [4, 4]."""
    m = np.array(matrix, dtype=float)
    return m.reshape(4, 4, -1)[..., 0]


def plate(toward_light, toward_eye, frame_in, frame_out, refracts, ior=1.5):
    """Orders of reflection between the faces of a plate summed as matrices of `mi.mueller`, [n, wavelength, out, in]."""
    across = np.cross(toward_light, [0, 0, 1.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    into = rotation(angle_between(-toward_light, frame_in, across))
    out = rotation(angle_between(toward_eye, across, frame_out))
    blocks = []
    for cosine in np.abs(toward_light[:, 2]):
        outer, inner = float(cosine), -float(np.sqrt(1 - (1 - cosine**2) / ior**2))
        reflect, again = (gray(mi.mueller.specular_reflection(c, ior)) for c in (outer, inner))
        enter, leave = (gray(mi.mueller.specular_transmission(c, ior)) for c in (outer, inner))
        between = np.linalg.inv(np.eye(4) - again @ again)
        blocks.append(leave @ between @ enter if refracts else reflect + leave @ again @ between @ enter)
    return np.einsum("nij,njk,nkl->nil", out, np.array(blocks), into)[:, None].repeat(len(WAVELENGTHS), 1)


def unpolarized_plate(ours, refracts):
    """Our matrices of a plate taken apart into the powers that one face reflects of s and p, and their mean put together
    again by Mitsuba's formula for the plate: M00 alone, [n, wavelength, 1, 1]."""
    s, p = (ours[..., 0, 0] + sign * ours[..., 0, 1] for sign in (1, -1))
    face = lambda power: (1 - power) / (1 + power) if refracts else power / (2 - power)
    mean = (face(s) + face(p)) / 2
    return ((1 - mean) / (1 + mean) if refracts else 2 * mean / (1 + mean))[..., None, None]


def theirs(case, light, eye, frame_in, frame_out):
    """What our matrices are compared with, in the given frames."""
    refracts = eye[0, 2] * light[0, 2] < 0
    if case.completed == "plate":
        return plate(light, eye, frame_in, frame_out, refracts)
    values = mitsuba(case, light, eye)
    if case.completed == "facet":
        whole = fresnel(light, eye, frame_in, frame_out, refracts)
        # Where no facet can do it, there is nothing to complete.
        whole = np.where(whole[..., :1, :1] > 0, whole, np.diag([1.0, 0, 0, 0]))
        return values[..., :1, :1] * whole / whole[..., :1, :1]
    if case.completed == "unpolarized plate":
        return values[..., :1, :1]
    return to_our_frames(values, light, frame_in, eye, frame_out, np.eye(3) if case.local is None else case.local)


def compared(case, ours, refracts):
    """What is compared of matrices: all elements, or what the case lets."""
    if case.completed == "unpolarized plate" and ours.shape[-1] == 4:
        return unpolarized_plate(ours, refracts)
    if case.frame_free:
        size = lambda m: np.linalg.norm(m, axis=-1)
        return np.stack([ours[..., 0, 0], ours[..., 3, 3], size(ours[..., 1:3, 3])], -1)[..., None, :]
    return ours


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
                out = np.array(bs.wo).ravel()
                if np.dot(out, light) > 0.999 and out[2] * light[2] > 0:
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
    (folder / "material.toml").write_text(f"wavelengths_nm = {WAVELENGTHS}\n[materials.m]\n{case.toml}\n{case.others}")
    np.savetxt(folder / "directions.csv", lines, fmt="%.6f", delimiter=",")
    command = [environment.sunstone(), "pbrdf", "eval", "material.toml", "--name", "m", "--directions", "directions.csv"]
    if case.lobe != "brdf":
        command.append(f"--{case.lobe}")
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if run.returncode:
        sys.exit(f"{case.name}: {run.stderr}")
    return json.loads(run.stdout)


# The comparison ------------------------------------------------------------------------------------------------------


class Answers:
    """Both programs' matrices of a case, and where."""

    def __init__(self, case, pairs, seed):
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
        if case.least_facet_cos:
            keep = facet_cosine(light, eye) > case.least_facet_cos
            light, frame_in, eye, frame_out, ours = (x[keep] for x in (light, frame_in, eye, frame_out, ours))
        self.case, self.ours, self.refracts = case, ours, eye[0, 2] * light[0, 2] < 0
        self.theirs = theirs(case, light, eye, frame_in, frame_out)
        # All elements, for what an error would change of them.
        whole = case.completed == "unpolarized plate"
        self.whole = plate(light, eye, frame_in, frame_out, self.refracts) if whole else self.theirs

    def off(self, ours, theirs):
        """Largest difference of matrices over M00, over all pairs, wavelengths and elements that are compared."""
        a, b = (compared(self.case, m, self.refracts) for m in (ours, theirs))
        # Mitsuba sets distributions of facets below 1e-20 to zero: next to that, what is nothing to it is nothing.
        nothing = (b[..., :1, :1] == 0) & (a[..., :1, :1] < 1e-15)
        return (np.abs(a - b) / np.where(nothing, 1, np.maximum(b[..., :1, :1], 1e-30))).max()


def planted(bound):
    """The errors: how each changes matrices [n, wavelength, out, in]."""

    def element(i, j):
        def change(m):
            m = m.copy()
            m[..., i, j] += 2 * bound * m[..., 0, 0]
            return m

        return change

    turn = rotation(np.radians([0.5]))[0]
    return {f"M{i}{j}": element(i, j) for i, j in np.ndindex(4, 4)} | {
        "intensity 1%": lambda m: 1.01 * m,
        "0.5° at light": lambda m: m @ turn,
        "0.5° at camera": lambda m: turn @ m,
        "wavelengths": lambda m: m[:, [1, 0, 2]],
    }


# How many rows at least must be able to show each planted error.
FLOORS = {"intensity 1%": 34, "0.5° at light": 30, "0.5° at camera": 30, "wavelengths": 12}
ELEMENT_FLOOR = 31


def facet_cosine(light, eye, ior=1.5):
    """The smaller cosine under which refracted light meets its facet."""
    index = np.where(np.stack([light[:, 2], eye[:, 2]]) > 0, 1.0, ior)[..., None]
    facet = index[0] * light + index[1] * eye
    facet /= np.linalg.norm(facet, axis=1, keepdims=True)
    return np.minimum(*(np.abs(np.einsum("ni,ni->n", facet, w)) for w in (light, eye)))


def elements(case):
    """What is compared, in words."""
    if case.completed == "unpolarized plate":
        return "M00"
    return "M00, M33, |M13, M23|" if case.frame_free else "16"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=2000, help="random direction pairs for each material")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="rows whose name contains this")
    parser.add_argument("--power", action="store_true", help="check that planted errors are found in every row")
    parser.add_argument("--record", action="store_true", help="write results/bsdf_coverage.json")
    options = parser.parse_args()
    mi.set_variant("scalar_spectral_polarized")
    print(f"Mitsuba {mi.__version__}, {mi.variant()}")
    with tempfile.TemporaryDirectory() as folder:
        cases = [c for c in materials.cases(Path(folder)) if not options.only or options.only in c.name]
        if not cases:
            sys.exit("no row to check")
        if options.power:
            return power(cases, options)
        print(f"{'material':44} | {'elements':20} | {'pairs':>6} | {'max |dM|/M00':>12} | {'bound':>8} |")
        rows = [check(case, options) for case in cases]
    print(f"not compared, as Mitsuba has no such thing: {', '.join(WITHOUT)}")
    failed = sum(not row["good"] for row in rows)
    if failed:
        sys.exit(f"{failed} rows failed")
    if options.record and not options.only:
        record(rows)
    elif not options.only:
        compares = lambda table: [(row["material"], row["elements"], list(row["theta_in_deg"])) for row in table]
        if compares(rows) != compares(json.loads(RESULTS.read_text())["rows"]):
            sys.exit(f"what is compared is not what {RESULTS.name} says: --record")


def check(case, options):
    """Prints the row of a case, and returns it."""
    answers = Answers(case, options.pairs, options.seed)
    pairs, worst = len(answers.ours), answers.off(answers.ours, answers.theirs)
    good = bool(worst <= case.bound)
    verdict = "" if good else "  FAILED"
    row = f"{case.name:44} | {elements(case):20} | {pairs:6} | {worst:12.2e} | {case.bound:8.0e} | {case.note}{verdict}"
    print(row, flush=True)
    return {"material": case.name, "elements": elements(case), "theta_in_deg": case.theta,
            "theta_out_deg": case.theta_out if case.lobe == "brdf" else None, "pairs": pairs, "worst": float(f"{worst:.2e}"),
            "bound": case.bound, "note": case.note, "good": good}


def power(cases, options):
    """Plants every error in every row."""
    able, missed = {}, []
    for case in cases:
        answers = Answers(case, options.pairs, options.seed)
        blind = []
        for name, change in planted(case.bound).items():
            # An error of exactly twice the bound is told from what is left between the programs.
            if answers.off(change(answers.whole), answers.whole) < 1.9 * case.bound:
                blind.append(name)
                continue
            able[name] = able.get(name, 0) + 1
            if answers.off(change(answers.ours), answers.theirs) <= case.bound:
                missed.append(f"{name} in {case.name}")
        shown = len(planted(case.bound)) - len(blind)
        print(f"{case.name:44} | {shown:2} errors | cannot show {', '.join(blind) or 'none'}", flush=True)
        if not shown:
            missed.append(f"everything in {case.name}")
    for name, count in able.items():
        floor = 1 if options.only else FLOORS.get(name, ELEMENT_FLOOR)
        print(f"{name:16} can be shown by {count} rows; floor {floor}")
        if count < floor:
            missed.append(f"{name}: too few rows can show it")
    missed += [f"{name}: no row can show it" for name in FLOORS if name not in able and not options.only]
    if missed:
        sys.exit("NOT FOUND: " + "; ".join(missed))


def record(rows):
    """What is compared, for the page that says so, and what it was found by."""
    from ratios import origin

    kept = [{key: value for key, value in row.items() if key != "good"} for row in rows]
    head = origin() | {"mitsuba": mi.__version__, "not_compared": WITHOUT}
    lines = ",\n  ".join(json.dumps(row, ensure_ascii=False) for row in kept)
    RESULTS.write_text(json.dumps(head, indent=1)[:-2] + f',\n "rows": [\n  {lines}\n ]\n}}\n')


if __name__ == "__main__":
    main()

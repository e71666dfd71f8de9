#!/usr/bin/env python3
"""Compare materials with Mitsuba 3's BSDFs of the same name: Mueller elements over random direction pairs.

Prints a table `material | elements | pairs | max |dM|/M00 | bound` and exits with 1 if a row is above its bound. Both programs
evaluate the same model in the same directions, so the comparison is deterministic. The remaining differences come from single
precision and from differences between the models, named in the last column. The materials are listed in materials.py. If
Mitsuba's BSDF is not polarized (rough and thin dielectrics), its other elements come from Mitsuba's own Fresnel matrices,
`mi.mueller`.

`--record` writes results/bsdf_coverage.json: for each material what is compared, at which incidences, and what is not compared.
Every full run must compare what that file lists.

`--power` applies errors to Sunstone's matrices, one at a time: each element off by twice the bound, all elements brighter by 1 %,
the light's or the camera's frame rotated by 0.5°, two wavelengths exchanged. Every row must detect every error that changes
Mitsuba's own matrices by more than the bound. FLOORS gives the number of rows that must be able to detect each error.
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
# Materials of Sunstone without a counterpart in Mitsuba 3.
WITHOUT = ["partial_depolarizer", "coated_conductor", "crystal", "plastic with single_scatter", "retarder with tilt = plate"]


# Mitsuba -------------------------------------------------------------------------------------------------------------


def rotation(angle):
    """Return R for Stokes vectors in a frame rotated by `angle`, counter-clockwise looking toward the source. [n, 4, 4]"""
    c, s = np.cos(2 * angle), np.sin(2 * angle)
    r = np.zeros((len(angle), 4, 4))
    r[:, 0, 0] = r[:, 3, 3] = 1
    r[:, 1, 1] = r[:, 2, 2] = c
    r[:, 1, 2], r[:, 2, 1] = s, -s
    return r


def angle_between(travel, from_axis, to_axis):
    """Return the rotation angle from `from_axis` to `to_axis`, both perpendicular to `travel`."""
    c = np.einsum("ni,ni->n", to_axis, from_axis)
    s = np.einsum("ni,ni->n", to_axis, np.cross(travel, from_axis))
    return np.arctan2(s, c)


def to_our_frames(matrices, toward_light, frame_in, toward_eye, frame_out, local):
    """Convert from Mitsuba's implicit frames (`stokes_basis` of the direction of travel) to the given frames.

    The columns of `local` are the axes in which Mitsuba expressed directions when it chose those frames.
    """

    def basis(travel):
        return np.array([np.array(mi.mueller.stokes_basis(mi.Vector3f(*v))).ravel() for v in travel @ local]) @ local.T

    if np.linalg.det(local) < 0:
        # In a mirror image the sense of rotation is reversed.
        matrices = matrices * np.outer([1, 1, -1, -1], [1, 1, -1, -1])

    into = rotation(angle_between(-toward_light, frame_in, basis(-toward_light)))
    out = rotation(angle_between(toward_eye, basis(toward_eye), frame_out))
    return np.einsum("nij,nwjk,nkl->nwil", out, matrices, into)


def wavelength_matrices(value):
    """Return a Mitsuba spectrum of Mueller matrices as [wavelength, out, in]."""
    m = np.array(value, dtype=float)
    m = m.reshape(4, 4, -1) if m.shape[-1] == 4 and m.ndim == 3 else m
    return np.moveaxis(m, -1, 0)[: len(WAVELENGTHS)]


def interaction(toward_eye):
    """Return a surface interaction in its own frame, seen from `toward_eye`."""
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
    """Return Smith's G1 for Beckmann facets over the rational fit of Walter et al. (2007) that Mitsuba uses instead. [n]"""
    from math import erf

    cos = np.abs(directions[:, 2])
    a = cos / (alpha * np.sqrt(np.maximum(1 - cos**2, 1e-12)))
    exact = 2 / (1 + np.vectorize(erf)(a) + np.exp(-(a**2)) / (a * np.sqrt(np.pi)))
    fit = np.where(a >= 1.6, 1, (3.535 * a + 2.181 * a**2) / (1 + 2.276 * a + 2.577 * a**2))
    return exact / fit


def fresnel(toward_light, toward_eye, frame_in, frame_out, refracts, ior=1.5):
    """Return `mi.mueller`'s matrices of the glass facet that directs light to the eye, in the given frames, [n, 1, out, in]."""
    index = np.where(np.stack([toward_light[:, 2], toward_eye[:, 2]]) > 0, 1.0, ior)[..., None]
    facet = index[0] * toward_light + index[1] * toward_eye
    # For mirror directions or straight transmission, every bisecting facet is valid.
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
    """Return a Mueller matrix from Mitsuba at its first wavelength, [4, 4]."""
    m = np.array(matrix, dtype=float)
    return m.reshape(4, 4, -1)[..., 0]


def plate(toward_light, toward_eye, frame_in, frame_out, refracts, ior=1.5):
    """Return the sum over orders of reflection between the faces of a plate, from `mi.mueller`, [n, wavelength, out, in]."""
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
    """Return M00 of a plate, recomputed with Mitsuba's formula, [n, wavelength, 1, 1].

    Sunstone's matrices give the powers of s and p that one face reflects. Mitsuba's formula is applied to their mean.
    """
    s, p = (ours[..., 0, 0] + sign * ours[..., 0, 1] for sign in (1, -1))
    face = lambda power: (1 - power) / (1 + power) if refracts else power / (2 - power)
    mean = (face(s) + face(p)) / 2
    return ((1 - mean) / (1 + mean) if refracts else 2 * mean / (1 + mean))[..., None, None]


def theirs(case, light, eye, frame_in, frame_out):
    """Return the reference for Sunstone's matrices, in the given frames."""
    refracts = eye[0, 2] * light[0, 2] < 0
    if case.completed == "plate":
        return plate(light, eye, frame_in, frame_out, refracts)
    values = mitsuba(case, light, eye)
    if case.completed == "facet":
        whole = fresnel(light, eye, frame_in, frame_out, refracts)
        # Without a valid facet, no matrix needs to be completed.
        whole = np.where(whole[..., :1, :1] > 0, whole, np.diag([1.0, 0, 0, 0]))
        return values[..., :1, :1] * whole / whole[..., :1, :1]
    if case.completed == "unpolarized plate":
        return values[..., :1, :1]
    return to_our_frames(values, light, frame_in, eye, frame_out, np.eye(3) if case.local is None else case.local)


def compared(case, ours, refracts):
    """Return the quantities to compare: all elements, or those that the case allows."""
    if case.completed == "unpolarized plate" and ours.shape[-1] == 4:
        return unpolarized_plate(ours, refracts)
    if case.frame_free:
        size = lambda m: np.linalg.norm(m, axis=-1)
        return np.stack([ours[..., 0, 0], ours[..., 3, 3], size(ours[..., 1:3, 3])], -1)[..., None, :]
    return ours


def mitsuba(case, toward_light, toward_eye):
    """Return Mueller matrices [pair, wavelength, out, in] in Mitsuba's frames; BRDFs in 1/sr, delta lobes without a unit."""
    result = raw(case, case.bsdf, toward_light, toward_eye)
    if case.microfacet:
        alpha = case.microfacet["alpha"]
        ratio = masking_ratio(alpha, toward_light) * masking_ratio(alpha, toward_eye)
        result += raw(case, case.microfacet, toward_light, toward_eye) * (ratio - 1)[:, None, None, None]
    return result


def raw(case, description, toward_light, toward_eye):
    """Evaluate one of Mitsuba's BSDFs."""
    bsdf = mi.load_dict(description)
    context = mi.BSDFContext()
    result = []
    for light, eye in zip(toward_light, toward_eye):
        si = interaction(eye)
        if case.lobe == "brdf":
            m = wavelength_matrices(bsdf.eval(context, si, mi.Vector3f(*light))) / abs(light[2])
        else:
            # A small or a large random number selects the lobe; use the lobe in the direction `light`.
            for pick in (0.0, 0.999999):
                bs, weight = bsdf.sample(context, si, pick, mi.Point2f(0.5, 0.5))
                out = np.array(bs.wo).ravel()
                if np.dot(out, light) > 0.999 and out[2] * light[2] > 0:
                    break
            else:
                sys.exit(f"{case.name}: Mitsuba has no lobe from {light} to {eye}")
            m = wavelength_matrices(weight) * float(bs.pdf)
            if eye[2] * light[2] < 0 and float(bs.eta) != 1:
                # Convert radiance to power: Mitsuba's weights include the squared ratio of the refractive indices.
                m = m * float(bs.eta) ** 2
        result.append(m)
    return np.array(result)


# Sunstone ------------------------------------------------------------------------------------------------------------


def sunstone(case, folder, lines):
    """Return the output of `sunstone pbrdf eval` for a list of directions in degrees."""
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
    """Matrices of both programs for a case, and their directions."""

    def __init__(self, case, pairs, seed):
        random = np.random.default_rng(seed)
        if case.least_facet_cos:
            pairs *= 2
        # Directions are uniform in the cosine of the angle to the normal.
        near, far = np.cos(np.radians(np.array([case.theta, case.theta_out]).T))
        theta = np.degrees(np.arccos(random.uniform(far, near, (pairs, 2))))
        phi = random.uniform(-180, 180, (pairs, 2))
        lines = np.stack([theta[:, 0], phi[:, 0], theta[:, 1], phi[:, 1]], 1)
        if case.lobe != "brdf":
            lines = lines[:, :2]
        with tempfile.TemporaryDirectory() as folder:
            answers = sunstone(case, Path(folder), lines)
        # Refracted directions are given per wavelength; in these cases they are equal for all wavelengths.
        out = [a["out"][0] if isinstance(a["out"], list) else a["out"] for a in answers]
        ours = np.array([a["mueller"] for a in answers])
        light, frame_in = (np.array([a["in"][k] for a in answers]) for k in ("direction", "frame"))
        eye, frame_out = (np.array([o[k] for o in out]) for k in ("direction", "frame"))
        if case.least_facet_cos:
            keep = facet_cosine(light, eye) > case.least_facet_cos
            light, frame_in, eye, frame_out, ours = (x[keep] for x in (light, frame_in, eye, frame_out, ours))
        self.case, self.ours, self.refracts = case, ours, eye[0, 2] * light[0, 2] < 0
        self.theirs = theirs(case, light, eye, frame_in, frame_out)
        # All elements, from which the effect of each error on the compared elements is computed.
        whole = case.completed == "unpolarized plate"
        self.whole = plate(light, eye, frame_in, frame_out, self.refracts) if whole else self.theirs

    def off(self, ours, theirs):
        """Return the largest difference of the matrices divided by M00, over all pairs, wavelengths and compared elements."""
        a, b = (compared(self.case, m, self.refracts) for m in (ours, theirs))
        # Mitsuba sets facet distributions below 1e-20 to zero. Values that are zero for Mitsuba and tiny for Sunstone count as
        # equal.
        nothing = (b[..., :1, :1] == 0) & (a[..., :1, :1] < 1e-15)
        return (np.abs(a - b) / np.where(nothing, 1, np.maximum(b[..., :1, :1], 1e-30))).max()


def planted(bound):
    """Return the errors as functions of matrices [n, wavelength, out, in]."""

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


# Minimum number of rows that must be able to detect each error.
FLOORS = {"intensity 1%": 34, "0.5° at light": 30, "0.5° at camera": 30, "wavelengths": 12}
ELEMENT_FLOOR = 31


def facet_cosine(light, eye, ior=1.5):
    """Return the smaller cosine between the refracted light and its facet."""
    index = np.where(np.stack([light[:, 2], eye[:, 2]]) > 0, 1.0, ior)[..., None]
    facet = index[0] * light + index[1] * eye
    facet /= np.linalg.norm(facet, axis=1, keepdims=True)
    return np.minimum(*(np.abs(np.einsum("ni,ni->n", facet, w)) for w in (light, eye)))


def elements(case):
    """Describe what is compared."""
    if case.completed == "unpolarized plate":
        return "M00"
    return "M00, M33, |M13, M23|" if case.frame_free else "16"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=2000, help="random direction pairs per material")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="check only rows whose name contains this text")
    parser.add_argument("--power", action="store_true", help="check that every row detects the planted errors")
    parser.add_argument("--record", action="store_true", help="write results/bsdf_coverage.json")
    options = parser.parse_args()
    mi.set_variant("scalar_spectral_polarized")
    print(f"Mitsuba {mi.__version__}, {mi.variant()}")
    with tempfile.TemporaryDirectory() as folder:
        cases = [c for c in materials.cases(Path(folder)) if not options.only or options.only in c.name]
        if not cases:
            sys.exit(f"no row has a name that contains {options.only!r}")
        if options.power:
            return power(cases, options)
        print(f"{'material':44} | {'elements':20} | {'pairs':>6} | {'max |dM|/M00':>12} | {'bound':>8} |")
        rows = [check(case, options) for case in cases]
    print(f"not compared, because Mitsuba has no counterpart: {', '.join(WITHOUT)}")
    failed = sum(not row["good"] for row in rows)
    if failed:
        sys.exit(f"{failed} rows failed")
    if options.record and not options.only:
        record(rows)
    elif not options.only:
        compares = lambda table: [(row["material"], row["elements"], list(row["theta_in_deg"])) for row in table]
        if compares(rows) != compares(json.loads(RESULTS.read_text())["rows"]):
            sys.exit(f"the compared elements differ from {RESULTS.name}: update it with --record")


def check(case, options):
    """Print the row of a case and return it."""
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
    """Apply every error to every row."""
    able, missed = {}, []
    for case in cases:
        answers = Answers(case, options.pairs, options.seed)
        blind = []
        for name, change in planted(case.bound).items():
            # An error of exactly twice the bound must exceed the remaining difference between the programs.
            if answers.off(change(answers.whole), answers.whole) < 1.9 * case.bound:
                blind.append(name)
                continue
            able[name] = able.get(name, 0) + 1
            if answers.off(change(answers.ours), answers.theirs) <= case.bound:
                missed.append(f"{name} in {case.name}")
        shown = len(planted(case.bound)) - len(blind)
        print(f"{case.name:44} | {shown:2} errors | cannot detect {', '.join(blind) or 'none'}", flush=True)
        if not shown:
            missed.append(f"everything in {case.name}")
    for name, count in able.items():
        floor = 1 if options.only else FLOORS.get(name, ELEMENT_FLOOR)
        print(f"{name:16} can be detected by {count} rows; floor {floor}")
        if count < floor:
            missed.append(f"{name}: too few rows can detect it")
    missed += [f"{name}: no row can detect it" for name in FLOORS if name not in able and not options.only]
    if missed:
        sys.exit("NOT FOUND: " + "; ".join(missed))


def record(rows):
    """Record what is compared, for the documentation, and the settings of the run."""
    from ratios import origin

    kept = [{key: value for key, value in row.items() if key != "good"} for row in rows]
    head = origin() | {"mitsuba": mi.__version__, "not_compared": WITHOUT}
    lines = ",\n  ".join(json.dumps(row, ensure_ascii=False) for row in kept)
    RESULTS.write_text(json.dumps(head, indent=1)[:-2] + f',\n "rows": [\n  {lines}\n ]\n}}\n')


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Compare scattering by spheres with independent programs: cross sections and all matrix elements over the angle.

`particles` and `polystyrene` are compared with PyPI `miepython`, with sizes averaged here by other quadratures. A large gold
sphere is compared with Mitsuba's reflection by gold, which relates every sign to the program whose conventions Sunstone follows.
Prints a table and exits with 1 if a row is above its bound. The relative bounds are 1e-6 for the coefficients, 1e-6 for the mean
cosine, and 1e-4 of S11 at the same angle for the elements (3e-4 for the largest spheres). `sunstone phase eval` prints the
renderer's table, interpolated, in single precision.

`miepython` uses n - i k and fields exp(+i w t), so its amplitudes are the conjugates of Sunstone's: S34 = M23 = Im S1* S2 of
Bohren & Huffman's amplitudes is Im S1 S2* of its amplitudes. (Its own `phase_matrix` has S34 with the opposite sign.)

`--power` applies errors to Sunstone's numbers, one at a time: each coefficient, the mean cosine and each element off by twice the
bound, the sign of S34, all elements 1 % larger, angles off by 0.5°. Every row must detect each error.
"""

import argparse
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import miepython
    import mitsuba as mi
    import numpy as np

WAVELENGTHS = [450.0, 550.0, 660.0]
COEFFICIENT_BOUND = 1e-6
MATRIX_BOUND = 1e-4
ELEMENTS = ["S11", "S12", "S22", "S33", "S34", "S44"]


@dataclass
class Spheres:
    """Spheres of one substance by number: [(radius in metres, number per cubic metre)]."""

    n: list
    k: list
    sizes: list


@dataclass
class Case:
    """A medium in Sunstone's format, and its spheres."""

    name: str
    toml: str
    host: list
    kinds: list = field(default_factory=list)
    host_absorption: list = field(default_factory=lambda: [0.0] * 3)
    # Largest allowed relative difference of elements.
    bound: float = MATRIX_BOUND


def volume(sizes):
    """Return the volume of the particles."""
    return sum(4 / 3 * np.pi * r**3 * number for r, number in sizes)


def scaled(sizes, fraction):
    """Return the sizes in the number that fills the given fraction of the volume."""
    factor = fraction / volume(sizes)
    return [(r, number * factor) for r, number in sizes]


def log_normal(median, sigma, count=600):
    """Return a log-normal distribution, integrated by Gauss-Legendre in ln r (Sunstone uses the trapezoidal rule)."""
    u, w = np.polynomial.legendre.leggauss(count)
    low, high = -6 * sigma, (6 + 4 * sigma) * sigma
    t = low + (high - low) * (u + 1) / 2
    density = np.exp(-(t**2) / (2 * sigma**2)) / (np.sqrt(2 * np.pi) * sigma)
    return list(zip(median * np.exp(t), w * density * (high - low) / 2))


def gamma(a, b, count=1300):
    """Return Hansen's gamma distribution, integrated by Gauss-Legendre in r."""
    u, w = np.polynomial.legendre.leggauss(count)
    r = a * (1 + 10 * np.sqrt(b)) * (u + 1) / 2
    weight = w * r ** ((1 - 3 * b) / b) * np.exp(-r / (a * b))
    return list(zip(r, weight / weight.sum()))


def cases():
    """Yield the comparisons."""
    vacuum, water = [1.0] * 3, [1.33961, 1.33468, 1.33142]
    beads = [1.5725 + 0.0031080 / l**2 + 0.00034779 / l**4 for l in (0.45, 0.55, 0.66)]
    absorption = [0.00922, 0.0565, 0.41]
    for diameter in (20, 200, 1000, 3000):
        yield Case(
            f"polystyrene, {diameter} nm",
            f"polystyrene = {{ diameter_nm = {diameter}, amount.volume_fraction = 0.01 }}",
            water,
            [Spheres(beads, [0.0] * 3, scaled([(diameter / 2 * 1e-9, 1.0)], 0.01))],
            absorption,
        )
    single = "sizes.single = {{ radius_nm = {radius} }}, amount.per_m3 = 1e12"
    for name, radius, n, k, bound in (
        ("gold, 30 nm", 30, [1.38309, 0.42415, 0.13991], [1.9155, 2.47208, 3.70148], MATRIX_BOUND),
        ("absorbing, 2 um", 2000, [1.4, 1.5, 1.6], [0.1, 0.01, 0.001], MATRIX_BOUND),
        ("bubbles, 3 um", 3000, [1.0] * 3, [0.0] * 3, MATRIX_BOUND),
        ("drops, 12 um", 12000, [1.33961, 1.33468, 1.33142], [1e-9] * 3, MATRIX_BOUND),
        # Dark fringes between bright fringes, a third of a degree apart, show the single precision of directions.
        ("x = 500", 35810, [1.59] * 3, [0.0] * 3, 3e-4),
    ):
        host = water if "bubbles" in name else vacuum
        sizes = single.format(radius=radius)
        yield Case(
            name,
            f"particles = {{ host = {host}, kinds = [{{ index = {n}, k = {k}, {sizes} }}] }}",
            host,
            [Spheres(n, k, [(radius * 1e-9, 1e12)])],
            bound=bound,
        )
    yield Case(
        "log-normal",
        f"particles = {{ host = {water}, kinds = [{{ index = [1.47, 1.463, 1.459], k = [1e-5, 5e-6, 5e-6],"
        " sizes.log_normal = { median_nm = 150, sigma = 0.5 }, amount.volume_fraction = 0.03 }] }",
        water,
        [Spheres([1.47, 1.463, 1.459], [1e-5, 5e-6, 5e-6], scaled(log_normal(150e-9, 0.5), 0.03))],
    )
    # Weak absorption damps resonances that no quadrature of reasonable length resolves.
    yield Case(
        "gamma",
        "particles = { kinds = [{ index = 1.33, k = 0.01, amount.mass = { grams_per_litre = 0.001, density = 1000 },"
        " sizes.gamma = { effective_radius_nm = 1500, effective_variance = 0.1 } }] }",
        vacuum,
        [Spheres([1.33] * 3, [0.01] * 3, scaled(gamma(1500e-9, 0.1), 1e-6))],
    )
    yield Case(
        "two kinds, one listed",
        "particles = { host = 1.33, kinds = [{ index = 1.59, sizes.list = { radius_nm = [100, 300], weight = [9, 1] },"
        " amount.per_m3 = 1e16 }, { index = 1.45, sizes.single = { radius_nm = 800 }, amount.per_m3 = 2e14 }] }",
        [1.33] * 3,
        [
            Spheres([1.59] * 3, [0.0] * 3, [(100e-9, 9e15), (300e-9, 1e15)]),
            Spheres([1.45] * 3, [0.0] * 3, [(800e-9, 2e14)]),
        ],
    )


def theirs(case, lane, mu):
    """Return scattering and absorption coefficient, mean cosine, and elements [6, angle] per steradian, by miepython."""
    wave_number = 2 * np.pi * case.host[lane] / (WAVELENGTHS[lane] * 1e-9)
    scattering = absorption = cosine = 0.0
    elements = np.zeros((6, len(mu)))
    for kind in case.kinds:
        m = (kind.n[lane] - 1j * kind.k[lane]) / case.host[lane]
        for radius, number in kind.sizes:
            x = wave_number * radius
            if x < 1e-3:
                continue
            ext, sca, _, g = miepython.efficiencies_mx(m, x)
            area = np.pi * radius**2 * number
            scattering += area * sca
            absorption += area * (ext - sca)
            cosine += area * sca * g
            s1, s2 = miepython.S1_S2(m, x, mu, norm="wiscombe")
            i1, i2, cross = abs(s1) ** 2, abs(s2) ** 2, s1 * np.conj(s2)
            # The direction perpendicular to the scattering plane is Sunstone's first axis: S12 is positive where S1 is stronger.
            both = np.array([(i1 + i2) / 2, (i1 - i2) / 2, (i1 + i2) / 2, cross.real, cross.imag, cross.real])
            elements += number / wave_number**2 * both
    return scattering, absorption + case.host_absorption[lane], cosine / scattering, elements / scattering


def sunstone(toml, angles):
    """Return the output of `sunstone phase eval`: the rows of coefficients, and elements [wavelength, element, angle]."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "medium.toml"
        path.write_text(f"wavelengths_nm = {WAVELENGTHS}\n[media.m]\n{toml}\n")
        listed = ",".join(f"{a:.9f}" for a in angles)
        command = [environment.sunstone(), "phase", "eval", str(path), "--angles", listed]
        run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode:
        sys.exit(run.stderr)
    lines = run.stdout.splitlines()
    # The first line with # names the columns of the other lines with #.
    head = np.array([line[1:].split(",") for line in lines if line.startswith("# ")][1:], dtype=float)
    rows = np.array([line.split(",") for line in lines if line[0].isdigit()], dtype=float)
    elements = rows[:, 2:].reshape(len(WAVELENGTHS), len(angles), len(ELEMENTS))
    return head, elements.swapaxes(1, 2)


def angles(case):
    """Return scattering angles in degrees: as many near the ends as between them, and none at nodes of the table."""
    s = np.linspace(0, 1, 41 if any(len(k.sizes) > 100 for k in case.kinds) else 301)
    return 180 * s**2 * (3 - 2 * s)


class Answers:
    """Sunstone's and the reference's results of a case: coefficients [wavelength, 3] (scattering, absorption, cosine), elements
    [wavelength, 6, angle].
    """

    def __init__(self, case):
        self.case, self.degrees = case, np.round(angles(case), 9)
        head, self.elements = sunstone(case.toml, self.degrees)
        self.coefficients = head[:, 2:5]
        wanted = [theirs(case, lane, np.cos(np.radians(self.degrees))) for lane in range(len(WAVELENGTHS))]
        self.their_coefficients = np.array([w[:3] for w in wanted], dtype=float)
        self.their_elements = np.array([w[3] for w in wanted])

    def worst(self, coefficients, elements):
        """Return the largest differences: of coefficients, of the cosine, of elements."""
        ours, wanted = coefficients.T, self.their_coefficients.T
        # miepython computes absorption as a difference of similar numbers: errors are relative to the numbers that it subtracts.
        scale = [wanted[0], np.maximum(wanted[1], 1e-6 * wanted[0])]
        off = max((np.abs(ours[i] - wanted[i]) / scale[i]).max() for i in range(2))
        least = (np.abs(elements - self.their_elements) / self.their_elements[:, :1]).max()
        return [off, np.abs(ours[2] - wanted[2]).max(), least]

    def bounds(self):
        """Return the bounds of the differences that `worst` returns."""
        return [COEFFICIENT_BOUND, COEFFICIENT_BOUND, self.case.bound]


def answers_of(case, known={}):
    """Return the results of a case, computed once."""
    if case.name not in known:
        known[case.name] = Answers(case)
    return known[case.name]


def check(case):
    """Print the row of a case. Return false if the row fails."""
    answers = answers_of(case)
    return report(case.name, answers.worst(answers.coefficients, answers.elements), answers.bounds())


def report(name, worst, bounds):
    """Print a row. Return false if a number is above its bound."""
    good = all(w <= b for w, b in zip(worst, bounds))
    numbers = " | ".join([f"{'':10}"] * (3 - len(worst)) + [f"{w:10.1e}" for w in worst])
    print(f"{name:24} | {numbers} | {bounds[-1]:6.0e} |{'' if good else '  FAILED'}", flush=True)
    return good


def planted(answers):
    """Yield the errors: name, coefficients and elements with the error, and the index in `worst` that must detect it."""
    coefficients, elements, bound = answers.coefficients, answers.elements, answers.case.bound
    wanted = answers.their_coefficients
    steps = [wanted[:, 0], np.maximum(wanted[:, 1], 1e-6 * wanted[:, 0]), np.ones(len(wanted))]
    for i, name in enumerate(("scattering", "absorption", "cosine")):
        changed = coefficients.copy()
        # The error affects a single wavelength.
        changed[1, i] += 2 * COEFFICIENT_BOUND * steps[i][1]
        yield name, changed, elements, 1 if name == "cosine" else 0
    for i, name in enumerate(ELEMENTS):
        changed = elements.copy()
        changed[1, i] += 2 * bound * elements[1, 0]
        yield name, coefficients, changed, 2
    signs = np.array([1, 1, 1, 1, -1, 1])[:, None]
    # S34 vanishes for spheres much smaller than the wavelength.
    if (np.abs(answers.their_elements[:, 4]) / answers.their_elements[:, 0]).max() > bound:
        yield "sign of S34", coefficients, elements * signs, 2
    yield "1 % larger", coefficients, 1.01 * elements, 2
    shifted = [np.interp(answers.degrees + 0.5, answers.degrees, row) for row in elements.reshape(-1, elements.shape[-1])]
    yield "angles by 0.5°", coefficients, np.reshape(shifted, elements.shape), 2


def power(case):
    """Apply every error to a case. Return false if an error is not detected. One row cannot detect the sign of S34."""
    answers = answers_of(case)
    missed, tried, signs = [], 0, False
    for name, coefficients, elements, i in planted(answers):
        tried += 1
        signs |= name == "sign of S34"
        if answers.worst(coefficients, elements)[i] <= answers.bounds()[i]:
            missed.append(name)
    if not signs and case.name != "polystyrene, 20 nm":
        missed.append("sign of S34, which this row must be able to detect")
    print(f"{case.name:24} | {tried} errors | {'NOT DETECTED: ' + ', '.join(missed) if missed else 'all detected'}", flush=True)
    return not missed and tried > 0


def gold(power):
    """Compare a sphere that is so large that, away from the forward direction, it is a mirror everywhere.

    Its scattering by an angle t equals Mitsuba's reflection by gold at an angle of incidence of (180 - t)/2 degrees.
    """
    mi.set_variant("scalar_spectral_polarized")
    # x = 2950 at the longest wavelength.
    toml = "particles.kinds = [{ index = 0.4242, k = 2.4721, sizes.single = { radius_nm = 2.1e5 }, amount.per_m3 = 1 }]"
    # The remaining difference is due to the curvature of the sphere, of order x^(-2/3).
    degrees, bound = np.linspace(60, 170, 23), 3e-3
    mine = sunstone(toml, degrees)[1][0]

    def worst(elements):
        most = 0.0
        for column, degree in zip(elements.T, degrees):
            m = mi.mueller.specular_reflection(float(np.sin(np.radians(degree / 2))), mi.Complex2f(0.4242, 2.4721))
            m = np.array(m, float).reshape(4, 4)
            want = np.array([m[0, 1], m[2, 2], m[2, 3], -m[3, 2], m[3, 3]]) / m[0, 0]
            found = np.array([column[1], column[3], column[4], column[4], column[5]]) / column[0]
            most = max(most, abs(found - want).max())
        return most

    if not power:
        return report("large gold (Mitsuba)", [worst(mine)], [bound])
    missed = []
    # S22 is S11 here, and only ratios are compared.
    for i in (1, 3, 4, 5):
        for name, change in {"2 bounds": 2 * bound * mine[0], "sign": -2 * mine[i]}.items():
            changed = mine.copy()
            changed[i] += change
            if worst(changed) <= bound:
                missed.append(f"{name} of {ELEMENTS[i]}")
    print(f"{'large gold (Mitsuba)':24} | 8 errors | {'NOT DETECTED: ' + ', '.join(missed) if missed else 'all detected'}; "
          "1 % larger cannot be detected, because only ratios are compared")
    return not missed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", help="check only rows whose name contains this text")
    parser.add_argument("--power", action="store_true", help="check that every row detects the planted errors")
    parser.add_argument("--both", action="store_true", help="compare, and check that planted errors are detected")
    options = parser.parse_args()
    print(f"miepython {miepython.__version__}, Mitsuba {mi.__version__}")
    wanted = [case for case in cases() if not options.only or options.only in case.name]
    if not wanted:
        sys.exit(f"no row has a name that contains {options.only!r}")
    failed = 0
    for planted in [False, True] if options.both else [options.power]:
        if not planted:
            print(f"{'medium':24} | {'mu_s, mu_a':>10} | {'g':>10} | {'|dS|/S11':>10} | {'bound':>6} |")
        failed += sum(not (power if planted else check)(case) for case in wanted)
        if not options.only:
            failed += not gold(planted)
    if failed:
        sys.exit(f"{failed} rows failed")


if __name__ == "__main__":
    main()

"""Test whether two noisy images have the same expected value, with three tests of known false-alarm probability.

Both sides have means and standard errors per pixel. Those of Mitsuba are estimated from `batches` renders with separate seeds, so
that a difference divided by its error follows Student's t, which `gaussian_from_t` maps to a unit Gaussian.

1. chi2: the sum of all z^2; detects differences anywhere.
2. max: the largest |z| among n pixels; detects single wrong pixels.
3. gain: (ours / theirs) - 1 fitted to the whole image; detects wrong factors and signs far below the noise of a pixel.

The p-value of a comparison is three times the smallest of the three (Bonferroni). The cross-check as a whole fails if any of its
m comparisons has p < SIGNIFICANCE / m. (planted.py fits named errors to all elements of a pair together; the same total
probability is divided over these fits and the comparisons.)
"""

import math
from dataclasses import dataclass

import numpy as np

SIGNIFICANCE = 1e-3
# Both programs use single precision: differences below this fraction of the brightest pixel are ignored.
ROUNDING = 1e-5


@dataclass
class Comparison:
    """Result of one comparison."""

    pixels: int
    max_z: float
    chi2_per_dof: float
    gain: float
    gain_error: float
    p: float


def mean_and_error(batches):
    """Return the mean over the first axis and its standard error."""
    batches = np.asarray(batches, np.float64)
    return batches.mean(0), batches.std(0, ddof=1) / math.sqrt(len(batches))


def z_scores(ours, ours_error, theirs, theirs_error, batches, scale, our_batches=None):
    """Return differences in units of their error, as unit Gaussians; their variance; and where noise exceeds rounding.

    `scale` is the largest intensity of both images. `our_batches` is the number of renders that Sunstone's error was estimated
    from (None: thousands of samples).
    """
    var_a, var_b = ours_error**2, theirs_error**2
    floor = (ROUNDING * scale) ** 2
    variance = np.maximum(var_a + var_b + floor, 1e-300)
    # Welch and Satterthwaite's degrees of freedom: Mitsuba's error is an estimate from few renders, Sunstone's mostly from
    # thousands of samples. Pixels without noise (rounding errors only) count as Gaussian.
    spread = (var_b / variance) ** 2 / (batches - 1)
    if our_batches:
        spread += (var_a / variance) ** 2 / (our_batches - 1)
    dof = 1 / np.maximum(spread, 1e-6 / (batches - 1))
    return gaussian_from_t((ours - theirs) / np.sqrt(variance), dof), variance, var_a + var_b > floor


def compare(ours, ours_error, theirs, theirs_error, batches, scale, our_batches=None):
    """Compare two images; see `z_scores`."""
    ours, ours_error, theirs, theirs_error = (np.ravel(a) for a in (ours, ours_error, theirs, theirs_error))
    z, variance, noisy = z_scores(ours, ours_error, theirs, theirs_error, batches, scale, our_batches)
    var_a, var_b = ours_error**2, theirs_error**2
    n = int(noisy.sum())
    chi2 = float((z[noisy] ** 2).sum())
    p_chi2 = chi2_p_value(chi2, n) if n else 1.0
    max_z = float(np.abs(z).max())
    p_max = -math.expm1(z.size * math.log1p(-two_sided(max_z))) if max_z else 1.0
    gain, gain_error = fit_gain(ours, theirs, var_a, var_b, variance)
    p_gain = two_sided(gain / gain_error) if gain_error < math.inf else 1.0
    p = min(1.0, 3 * min(p_chi2, p_max, p_gain))
    return Comparison(z.size, max_z, chi2 / n if n else 0.0, gain, gain_error, p)


def fit_gain(ours, theirs, var_a, var_b, variance):
    """Return the relative excess of Sunstone over the reference, and its standard error.

    The pattern is the inverse-variance mean of both, because its noise is uncorrelated with that of the difference.
    """
    weight = np.where(var_a + var_b > 0, var_b / np.maximum(var_a + var_b, 1e-300), 0.5)
    pattern = weight * ours + (1 - weight) * theirs
    power = float((pattern**2).sum())
    if power == 0:
        return 0.0, math.inf
    gain = float((pattern * (ours - theirs)).sum()) / power
    return gain, math.sqrt(float((pattern**2 * variance).sum())) / power


def gaussian_from_t(t, dof):
    """Return the unit Gaussian with the tail probability of Student's t (Wallace 1959)."""
    return np.sign(t) * (8 * dof + 1) / (8 * dof + 3) * np.sqrt(dof * np.log1p(t**2 / dof))


def two_sided(z):
    """Return the probability that a unit Gaussian exceeds |z| in magnitude."""
    return math.erfc(abs(z) / math.sqrt(2))


def chi2_p_value(chi2, dof):
    """Return the probability of a larger chi squared (Wilson and Hilferty 1931; accurate for dof above about ten)."""
    z = ((chi2 / dof) ** (1 / 3) - (1 - 2 / (9 * dof))) / math.sqrt(2 / (9 * dof))
    return math.erfc(z / math.sqrt(2)) / 2

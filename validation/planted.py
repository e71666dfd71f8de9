"""Planted errors that a comparison of images must detect, their smallest sizes, and which comparison can detect them.

Every error is a linear change of Sunstone's image: x becomes x + D. Its amount is fitted to the whole pair, all elements
together: with P = D of the noise-free image (estimated by the inverse-variance mean of both sides, whose noise is uncorrelated
with that of their difference d),

    amount = sum(w P d) / S,   S = sum(w P^2) - the noise's share of it,   error = sqrt(Var sum(w P d)) / S,

where 1 is the error as planted. With d's variance v, the weights w = 1/(v + v's mean over the image) limit the influence of
single noisy pixels; without the mean, pixels whose variance is underestimated at random would dominate. The variance comes from
Mitsuba's seeds, so that noise common to pixels and elements counts; Sunstone's noise has no seeds and is assumed to be similar.
So each pair determines what it can detect: an error is detected in all but a thousandth of runs if it exceeds the limit of
significance by `MARGIN` standard errors. Then it must be detected. `check` also requires at least the number of such pairs that
the error's floor gives, so that a weakened comparison fails too.

The fits of `FITTED` also judge the comparison itself: they reveal a rotation of a frame that is too small to affect any single
pixel.
"""

import functools
from dataclasses import dataclass

import numpy as np

import comparison
from frames import rotate

# Smallest planted errors.
INTENSITY, FRAME_DEG, BINS = 0.01, 0.5, 0.5
# Error that even a few rare paths must reveal.
STRONG = 0.06
# Number of standard errors by which a detectable error exceeds the limit of significance.
MARGIN = 3.1
FRAME = np.radians(FRAME_DEG)


@dataclass
class Fit:
    """Amount of an error (1 is the error as planted), and the probability that noise causes such an amount."""

    error: str
    amount: float
    sigma: float
    p: float


def matrices(pair, image):
    """Return images of 16 elements as matrices; None for fewer elements."""
    return image.reshape(*image.shape[:-1], 4, 4) if len(pair.elements) == 16 else None


def turned_out(pair, image):
    """Rotate the frame at the camera."""
    if len(pair.elements) == 4:
        return rotate(image, FRAME)
    m = matrices(pair, image)
    return None if m is None else rotate(m.swapaxes(-1, -2), FRAME).swapaxes(-1, -2).reshape(image.shape)


def turned_in(pair, image):
    """Rotate the frame at the light."""
    m = matrices(pair, image)
    return None if m is None else rotate(m, FRAME).reshape(image.shape)


def later(pair, image, bins):
    """Delay all light by `bins` time bins; fractions are divided between neighbouring bins."""
    if not pair.timed:
        return None
    moved = np.concatenate([np.zeros_like(image[..., :1, :]), image[..., :-1, :]], axis=-2)
    return (1 - bins) * image + bins * moved


def rows_flipped(pair, image, i):
    """Flip the sign of a Stokes element, or of a row of the matrix."""
    n = len(pair.elements)
    return None if n < 4 else image * np.where(np.arange(n) * 4 // n == i, -1.0, 1.0)


def last_column_flipped(pair, image):
    """Flip the sign of the matrix's last column."""
    return image * np.where(np.arange(16) % 4 == 3, -1.0, 1.0) if len(pair.elements) == 16 else None


# Fitted in every comparison.
FITTED = {
    f"intensity {INTENSITY:.0%}": lambda pair, x: (1 + INTENSITY) * x,
    f"frame {FRAME_DEG}°": turned_out,
    f"frame of light {FRAME_DEG}°": turned_in,
    f"{BINS} bin": lambda pair, x: later(pair, x, BINS),
}
# Only planted. Errors that cannot be computed from Sunstone's image (another wavelength, medium, state of the lamp) come with the
# pair.
PLANTED = FITTED | {
    f"intensity {STRONG:.0%}": lambda pair, x: (1 + STRONG) * x,
    "1 bin": lambda pair, x: later(pair, x, 1),
    "s1 flipped": lambda pair, x: rows_flipped(pair, x, 1),
    "s2 flipped": lambda pair, x: rows_flipped(pair, x, 2),
    "s3 flipped": lambda pair, x: rows_flipped(pair, x, 3),
    "column flipped": last_column_flipped,
}


def changes(pair):
    """Return the errors that apply to a pair, as functions of its compared images."""
    image = pair.images()[0]
    known = {name: lambda x, change=change: change(pair, x) for name, change in PLANTED.items()}
    for name, wrong in pair.wrong.items():
        step = pair.blocks(wrong) - image
        known[f"wrong {name}"] = lambda x, step=step: x + step
    return {name: change for name, change in known.items() if change(image) is not None}


def noise_of(name, change, a, b, weight):
    """Return the noise's share of sum(w P^2) and its standard deviation, for images of variances a and b."""
    if name.startswith("wrong "):
        # Both images of the step are Sunstone's.
        variance = 2 * a
    else:
        best = share(a, b) ** 2 * a + (1 - share(a, b)) ** 2 * b
        # Effect of a linear change on independent noise, estimated with random signs.
        random, rounds, variance = np.random.default_rng(1), 4, 0.0
        for _ in range(rounds):
            noise = random.choice([-1.0, 1.0], best.shape) * np.sqrt(best)
            variance = variance + (change(noise) - noise) ** 2 / rounds
    variance = weight * variance
    return variance.sum(), np.sqrt(2 * (variance**2).sum())


@functools.cache
def least_t(seeds, limit):
    """Return Student's t above which p is below a limit."""
    t = np.linspace(0, 100, 2001)
    p = np.vectorize(comparison.two_sided)(comparison.gaussian_from_t(t, seeds - 1))
    return float(t[np.argmax(p < limit)])


def share(a, b):
    """Return the weight of the first of two values of variances a and b in their inverse-variance mean."""
    return np.where(a + b > 0, b / np.maximum(a + b, 1e-300), 0.5)


class Detector:
    """Smallest amount of one error that a pair can detect."""

    def __init__(self, pair, name, change):
        self.name, self.change = name, change
        ours, ours_error, theirs, theirs_error = pair.images()
        a, b = ours_error**2, theirs_error**2
        best = share(a, b) * ours + (1 - share(a, b)) * theirs
        plain = change(best) - best
        v = a + b
        w = 1 / np.maximum(v + v.mean(axis=tuple(range(v.ndim - 1)), keepdims=True), 1e-300)
        self.pattern = w / w.max() * plain
        power = (self.pattern * plain).sum()
        noise, stray = noise_of(name, change, a, b, w / w.max())
        self.signal = power - noise if power - noise > 4 * stray else 0.0
        seeds = pair.seeds()
        self.seeds = len(seeds)
        theirs_variance = np.tensordot(seeds, self.pattern, self.pattern.ndim).var(ddof=1) / self.seeds
        weigh = lambda variance: (self.pattern**2 * variance).sum()
        ours_variance = theirs_variance * weigh(a) / weigh(b) if weigh(b) > 0 else weigh(a)
        floor = weigh((comparison.ROUNDING * np.abs(theirs).max()) ** 2)
        self.deviation = np.sqrt(theirs_variance + ours_variance + floor)
        self.difference = ours - theirs

    def fit(self, planted=None):
        """Fit the difference, or the difference plus `planted`, the change of Sunstone's image by an error."""
        difference = self.difference if planted is None else self.difference + planted
        t = (self.pattern * difference).sum() / max(self.deviation, 1e-300)
        p = comparison.two_sided(float(comparison.gaussian_from_t(t, self.seeds - 1)))
        sigma = self.deviation / self.signal if self.signal > 0 else np.inf
        return Fit(self.name, t * sigma if sigma < np.inf else 0.0, sigma, p)

    def detectable(self, limit):
        """Return the amount that is detected in all but a thousandth of runs, where p must be below the limit, or infinity."""
        if self.signal <= 0:
            return np.inf
        return (least_t(self.seeds, limit) + MARGIN) * self.deviation / self.signal


def fits(pair):
    """Return the fits of FITTED that apply to a pair."""
    return [Detector(pair, name, change).fit() for name, change in changes(pair).items() if name in FITTED]


def limit(results):
    """Return the limit of significance of p, over all rows and fits together."""
    rows = sum(len(pair.elements) for pair in results)
    return comparison.SIGNIFICANCE / (rows + sum(len(fits(pair)) for pair in results))


def judge(results):
    """Print the fits; return true if no error is significant."""
    least, good = limit(results), True
    print(f"\n{'scene':32} {'error':20} {'amount (1: as planted)':>24} {'p-value':>8}  verdict")
    for pair in results:
        for fit in fits(pair):
            good &= fit.p >= least
            amount = f"{fit.amount:+.3f} ± {fit.sigma:.3f}" if fit.sigma < 100 else "(no signal)"
            print(f"{pair.title:32} {fit.error:20} {amount:>24} {fit.p:8.2g}  {'agree' if fit.p >= least else 'DIFFER'}")
    return good


def check(results, floors):
    """Apply every error to every pair; return true if all checks pass.

    An error must be detected in each pair that can detect it, at least as many pairs as its floor must be able to, and every pair
    must detect some error. Prints the detected errors, and for pairs that cannot detect an error, the size from which they could.
    """
    if not results:
        print("no results to apply errors to: run the comparison first")
        return False
    least, tried, good = limit(results), 0, True
    table, blind = {name: [] for name in floors}, []
    for pair in results:
        detectors = {name: Detector(pair, name, change) for name, change in changes(pair).items()}
        shown = 0
        for name, detector in detectors.items():
            size = detector.detectable(least)
            ours = pair.images()[0]
            step = detector.change(ours) - ours
            p = min(d.fit(step).p for d in detectors.values() if d.name in FITTED)
            found = p < least or any(c.p < least for *_, c in pair.compare(step))
            able = size <= 1
            tried += 1
            shown += found
            table.setdefault(name, []).append((pair.title, able, found, size))
        if not shown:
            blind.append(pair.title)
    for name, entries in table.items():
        able = [e for e in entries if e[1]]
        missed = [title for title, _, found, _ in able if not found]
        floor = floors.get(name, 1)
        few = len(able) < floor
        good &= not missed and not few
        worst = max((size for *_, size in able), default=np.inf)
        print(f"{name:20} detected in {len(able) - len(missed)} of {len(able)} pairs that can detect it (floor {floor}); the "
              f"least sensitive detects {worst:.2f} of it{'; TOO FEW CAN' if few else ''}")
        for title in missed:
            print(f"{'':20} NOT DETECTED in {title}")
        from_on = lambda size: "no signal" if size == np.inf else f"from {size:.1f} times its size"
        unable = [f"{title} ({from_on(size)})" for title, ok, _, size in entries if not ok]
        if unable:
            print(f"{'':20} cannot detect it: {', '.join(unable)}")
    if blind:
        print(f"detect nothing: {', '.join(blind)}")
    print(f"{tried} errors planted in {len(results)} pairs: {'all detected' if good and not blind else 'FAILED'}")
    return good and not blind and tried > 0

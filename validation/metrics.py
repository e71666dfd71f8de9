#!/usr/bin/env python3
"""Compare SSIM and PSNR of scikit-image with the numbers in the tests of src/apply/metrics/ssim.rs, on the same images.

    python3 validation/metrics.py [--power]

--power gives scikit-image images that differ by 1e-9; this difference must be detected.
"""

import re
import sys

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import numpy as np
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity

# The tests have twelve decimals.
CLOSE = 1e-11


def picture(seed, width, height):
    """Return waves with noise from a linear congruential generator."""
    state, out = seed, np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            state = (state * 1103515245 + 12345) % (1 << 31)
            out[y, x] = 0.5 + 0.3 * np.sin(x / 5) * np.cos(y / 7) + 0.2 * (state / 2**31 - 0.5)
    return out


def ssim(a, b, data_range):
    """Return SSIM with the parameters of Wang et al. (2004)."""
    return structural_similarity(a, b, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=data_range)


def main():
    if {"-h", "--help"} & set(sys.argv):
        sys.exit(__doc__)
    power = "--power" in sys.argv
    a, b = picture(1, 32, 24), picture(2, 32, 24)
    flatter = 0.7 * a + 0.1
    if power:
        b, flatter = b + 1e-9 * np.arange(32), flatter + 1e-9 * np.arange(32)
    theirs = [ssim(a, b, 1.0), ssim(a, flatter, 1.0), ssim(a, b, 0.5), peak_signal_noise_ratio(a, b, data_range=1.0)]
    text = (environment.ROOT / "src/apply/metrics/ssim.rs").read_text()
    test = text[text.index("fn agrees_with_scikit_image") :]
    ours = [float(n) for n in re.findall(r"\d+\.\d{12}", test)[:4]]
    if len(ours) != len(theirs):
        sys.exit("the test in src/apply/metrics/ssim.rs does not contain four numbers")
    off = [abs(t - o) for t, o in zip(theirs, ours)]
    for t, o in zip(theirs, ours):
        print(f"scikit-image {t:.12f}, in the tests {o:.12f}")
    if (max(off) > CLOSE) != power:
        sys.exit("the planted difference was not detected" if power else "the values of scikit-image and of ssim.rs differ")
    print("the planted difference is detected" if power else "they agree")


if __name__ == "__main__":
    main()

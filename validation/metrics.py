"""SSIM and PSNR of scikit-image on the pictures of the tests in src/apply/metrics/ssim.rs, whose numbers stand there.

    pip install scikit-image
    python3 validation/metrics.py
"""

import numpy as np
import skimage
from skimage.metrics import peak_signal_noise_ratio, structural_similarity


def picture(seed, width, height):
    """Waves under noise of a linear congruential generator."""
    state, out = seed, np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            state = (state * 1103515245 + 12345) % (1 << 31)
            out[y, x] = 0.5 + 0.3 * np.sin(x / 5) * np.cos(y / 7) + 0.2 * (state / 2**31 - 0.5)
    return out


def ssim(a, b, data_range):
    """With the parameters of Wang et al. (2004)."""
    return structural_similarity(
        a, b, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=data_range
    )


a, b = picture(1, 32, 24), picture(2, 32, 24)
print(f"scikit-image {skimage.__version__}")
print(f"SSIM, range 1: {ssim(a, b, 1.0):.12f}")
print(f"SSIM of 0.7 a + 0.1, range 1: {ssim(a, 0.7 * a + 0.1, 1.0):.12f}")
print(f"SSIM, range 0.5: {ssim(a, b, 0.5):.12f}")
print(f"PSNR, peak 1: {peak_signal_noise_ratio(a, b, data_range=1.0):.12f} dB")

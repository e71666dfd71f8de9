//! Peak signal-to-noise ratio in dB: 10 log₁₀(peak² / mean squared difference).

use crate::map::Map;

/// Returns the PSNR of `image` against `truth` over the pixels of `mask` and all channels. `peak` is the
/// largest possible value. The result is infinite if the images are equal. The result is NaN if no pixel is
/// in the mask or if sizes differ.
pub fn psnr(image: &Map, truth: &Map, mask: &[bool], peak: f64) -> f64 {
    let mean = mean_squared_difference(image, truth, mask);
    10.0 * (peak * peak / mean).log10()
}

/// Returns the mean squared difference over the pixels of `mask` and all channels. The result is NaN without
/// pixels or if sizes differ.
pub fn mean_squared_difference(image: &Map, truth: &Map, mask: &[bool]) -> f64 {
    if image.data.len() != truth.data.len() || mask.len() * image.channels != image.data.len() {
        return f64::NAN;
    }
    let (mut sum, mut n) = (0.0, 0.0);
    let channels = image.channels.max(1);
    let pixels = image.data.chunks_exact(channels).zip(truth.data.chunks_exact(channels));
    for ((a, b), _) in pixels.zip(mask).filter(|(_, m)| **m) {
        sum += a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        n += channels as f64;
    }
    sum / n
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_difference_is_known_in_closed_form() {
        let truth = Map::from_fn(8, 4, 3, |x, y, out| out.fill((x + y) as f64));
        let image = Map::from_fn(8, 4, 3, |x, y, out| out.fill((x + y) as f64 + 0.1));
        let all = vec![true; 32];
        approx::assert_relative_eq!(psnr(&image, &truth, &all, 1.0), 20.0, epsilon = 1e-9);
        approx::assert_relative_eq!(psnr(&image, &truth, &all, 10.0), 40.0, epsilon = 1e-9);
        assert_eq!(psnr(&truth, &truth, &all, 1.0), f64::INFINITY);
        assert!(psnr(&image, &truth, &[false; 32], 1.0).is_nan());
        assert!(psnr(&image, &truth, &[true; 31], 1.0).is_nan());
    }

    #[test]
    fn only_the_mask_counts() {
        let truth = Map::from_fn(4, 1, 1, |_, _, out| out.fill(0.0));
        let image = Map::from_fn(4, 1, 1, |x, _, out| out.fill(x as f64));
        let mask = [false, true, true, false];
        approx::assert_relative_eq!(mean_squared_difference(&image, &truth, &mask), 2.5);
    }
}

//! Structural similarity (Wang, Bovik, Sheikh & Simoncelli 2004, eq. 13), with its published
//! parameters.
//!
//! SSIM = (2 μx μy + C1)(2 σxy + C2) / ((μx² + μy² + C1)(σx² + σy² + C2)), C1 = (0.01 L)², C2 =
//! (0.03 L)², with the range L of values. Means and covariances use a Gaussian window of 11 × 11
//! pixels with a standard deviation of 1.5 and weights of sum 1 (population covariances). Pixels
//! whose window leaves the image are ignored, as in the authors' program; channels are averaged.

use crate::map::Map;

/// Edge of the window, pixels.
pub const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;
const K1: f64 = 0.01;
const K2: f64 = 0.03;

/// Returns the mean of SSIM over channels and over the pixels of `mask` whose window lies within the image.
/// `range` is L, the difference of the largest and the smallest possible value. NaN without such pixels or if
/// sizes differ.
pub fn ssim(image: &Map, truth: &Map, mask: &[bool], range: f64) -> f64 {
    if image.data.len() != truth.data.len() || mask.len() * image.channels != image.data.len() {
        return f64::NAN;
    }
    let (w, h) = (image.width, image.height);
    let half = WINDOW / 2;
    let (mut sum, mut n) = (0.0, 0.0);
    for channel in 0..image.channels {
        let map = channel_map(image, truth, channel, range);
        for y in half..h.saturating_sub(half) {
            for x in half..w.saturating_sub(half) {
                if mask[y * w + x] {
                    sum += map[y * w + x];
                    n += 1.0;
                }
            }
        }
    }
    sum / n
}

/// Returns the SSIM of every pixel of a channel; values whose window leaves the image are meaningless.
fn channel_map(image: &Map, truth: &Map, channel: usize, range: f64) -> Vec<f64> {
    let of = |m: &Map| -> Vec<f64> { m.data.iter().skip(channel).step_by(m.channels).copied().collect() };
    let (x, y) = (of(image), of(truth));
    let product = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a * b).collect() };
    let blur = |v: &[f64]| blurred(v, image.width);
    let (mx, my) = (blur(&x), blur(&y));
    let (xx, yy, xy) = (blur(&product(&x, &x)), blur(&product(&y, &y)), blur(&product(&x, &y)));
    let (c1, c2) = ((K1 * range).powi(2), (K2 * range).powi(2));
    (0..x.len())
        .map(|i| {
            let (a, b) = (mx[i], my[i]);
            let (va, vb, cov) = (xx[i] - a * a, yy[i] - b * b, xy[i] - a * b);
            (2.0 * a * b + c1) * (2.0 * cov + c2) / ((a * a + b * b + c1) * (va + vb + c2))
        })
        .collect()
}

/// Applies the Gaussian window along rows and columns; zero beyond the image.
fn blurred(values: &[f64], width: usize) -> Vec<f64> {
    let half = WINDOW as isize / 2;
    let weight = |d: isize| (-0.5 * (d as f64 / SIGMA).powi(2)).exp();
    let sum: f64 = (-half..=half).map(weight).sum();
    let pass = |v: &[f64], across: bool| -> Vec<f64> {
        let height = v.len() / width.max(1);
        let mut out = vec![0.0; v.len()];
        for (i, o) in out.iter_mut().enumerate() {
            let (x, y) = ((i % width) as isize, (i / width) as isize);
            for d in -half..=half {
                let (x, y) = if across { (x + d, y) } else { (x, y + d) };
                if (0..width as isize).contains(&x) && (0..height as isize).contains(&y) {
                    *o += weight(d) / sum * v[y as usize * width + x as usize];
                }
            }
        }
        out
    };
    pass(&pass(values, true), false)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(seed: u64, w: usize, h: usize) -> Map {
        // A linear congruential generator, so that other programs can reproduce the image.
        let mut state = seed;
        Map::from_fn(w, h, 1, |x, y, out| {
            state = (state * 1103515245 + 12345) % (1 << 31);
            let noise = state as f64 / f64::from(1_u32 << 31);
            out[0] = 0.5 + 0.3 * (x as f64 / 5.0).sin() * (y as f64 / 7.0).cos() + 0.2 * (noise - 0.5);
        })
    }

    #[test]
    fn equal_images_score_one_and_constants_match_closed_forms() {
        let a = picture(1, 32, 24);
        let all = vec![true; a.data.len()];
        approx::assert_relative_eq!(ssim(&a, &a, &all, 1.0), 1.0, epsilon = 1e-12);
        // Constants: only the luminance term remains.
        let flat = |v: f64| Map::from_fn(20, 20, 2, |_, _, out| out.fill(v));
        let c1 = 1e-4;
        let expected = (2.0 * 0.3 * 0.6 + c1) / (0.09 + 0.36 + c1);
        approx::assert_relative_eq!(
            ssim(&flat(0.3), &flat(0.6), &[true; 400], 1.0),
            expected,
            epsilon = 1e-9
        );
        // A negative image changes the sign of covariances.
        let mirrored = Map { data: a.data.iter().map(|v| 1.0 - v).collect(), ..a.clone() };
        assert!(ssim(&mirrored, &a, &all, 1.0) < 0.0);
        assert!(ssim(&a, &picture(2, 8, 8), &all, 1.0).is_nan());
    }

    /// SSIM equals `structural_similarity(.., gaussian_weights=True, sigma=1.5,
    /// use_sample_covariance=False)` of scikit-image 0.26.0.
    #[test]
    fn agrees_with_scikit_image() {
        let (a, b) = (picture(1, 32, 24), picture(2, 32, 24));
        let flatter = Map { data: a.data.iter().map(|v| 0.7 * v + 0.1).collect(), ..a.clone() };
        let all = vec![true; a.data.len()];
        approx::assert_relative_eq!(ssim(&a, &b, &all, 1.0), 0.431706250239, epsilon = 1e-11);
        approx::assert_relative_eq!(ssim(&a, &flatter, &all, 1.0), 0.940174395066, epsilon = 1e-11);
        approx::assert_relative_eq!(ssim(&a, &b, &all, 0.5), 0.396497578353, epsilon = 1e-11);
        approx::assert_relative_eq!(
            crate::metrics::psnr::psnr(&a, &b, &all, 1.0),
            21.858893123273,
            epsilon = 1e-11
        );
    }
}

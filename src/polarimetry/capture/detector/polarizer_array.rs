//! The mosaic of polarizers on a sensor (division-of-focal-plane polarimeter). This module also demosaics the
//! frames.
//!
//! Sony's IMX250MZR has a wire-grid polarizer over each pixel, in blocks of 2×2:
//!
//! > 90°  45°
//! > 135°  0°
//!
//! (Sony Semiconductor Solutions, "Polarization image sensor technology: Polarsens"). Row 0 is the top row,
//! and column 0 is the left column. Images of the four polarizers are in the order of
//! [`ARRAY_DEG`](crate::capture::scheme::ARRAY_DEG), as in Baek & Heide (2021).
//!
//! Adjacent polarizers observe adjacent points, so edges of the scene cause false polarization. The methods
//! in this module do not avoid this error. Other methods replace the error by different errors (Zhang, Luo,
//! Liu & Cui 2016, "Image interpolation for division of focal plane polarimeters with intensity
//! correlation").

use super::error::{DetectorError, area};
use serde::{Deserialize, Serialize};

/// Index in `ARRAY_DEG` of the polarizer over a pixel (x, y), as `[y % 2][x % 2]`.
const LAYOUT: [[usize; 2]; 2] = [[2, 1], [3, 0]];

/// Returns the index (in `ARRAY_DEG`) of the polarizer over a pixel.
pub fn polarizer(x: usize, y: usize) -> usize {
    LAYOUT[y % 2][x % 2]
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Each 2×2 block becomes one pixel with the values of four polarizers. An odd last row or column is
    /// dropped.
    Superpixel,
    /// Every pixel receives the values of all four polarizers. Each value is the mean of the two or four
    /// nearest pixels.
    Bilinear,
}

/// Images of the four polarizers, with rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Images {
    /// Images in the order of `ARRAY_DEG`. Each image has `width`·`height` values.
    pub images: [Vec<f64>; 4],
    pub width: usize,
    pub height: usize,
}

/// Returns the raw frame of a sensor from one full-resolution image per polarizer.
///
/// # Errors
/// Returns [`DetectorError::Count`] unless all images have `width`·`height` values.
pub fn mosaic<T: Copy>(images: [&[T]; 4], width: usize, height: usize) -> Result<Vec<T>, DetectorError> {
    for image in images {
        area("an image of a polarizer", width, height, image.len())?;
    }
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    Ok(pixels.map(|(x, y)| images[polarizer(x, y)][y * width + x]).collect())
}

/// Demosaics a raw frame.
///
/// Non-finite values (from saturated pixels) have zero weight. A result without any finite value is NaN.
///
/// # Errors
/// Returns [`DetectorError::Count`] unless `raw` has `width`·`height` values.
pub fn demosaic(raw: &[f64], width: usize, height: usize, method: Method) -> Result<Images, DetectorError> {
    apart(raw, width, height, method, |weighted, weights, _| weighted / weights)
}

/// Returns the variances of the results of [`demosaic`] from the variances of independent pixels.
/// Neighbouring pixels of a bilinear image share raw pixels, so their errors are correlated. The variances do
/// not include this correlation.
///
/// # Errors
/// Returns [`DetectorError::Count`] unless `variance` has `width`·`height` values.
pub fn demosaic_variance(
    variance: &[f64],
    width: usize,
    height: usize,
    method: Method,
) -> Result<Images, DetectorError> {
    apart(variance, width, height, method, |_, weights, squared| squared / (weights * weights))
}

/// Demosaics a raw frame. `value` computes the result from Σ w v, Σ w and Σ w² v.
fn apart(
    raw: &[f64],
    width: usize,
    height: usize,
    method: Method,
    value: impl Fn(f64, f64, f64) -> f64,
) -> Result<Images, DetectorError> {
    area("a raw frame", width, height, raw.len())?;
    let side = match method {
        Method::Superpixel => 2,
        Method::Bilinear => 1,
    };
    let mut out =
        Images { images: std::array::from_fn(|_| Vec::new()), width: width / side, height: height / side };
    for (py, row) in LAYOUT.iter().enumerate() {
        for (px, polarizer) in row.iter().enumerate() {
            let image = &mut out.images[*polarizer];
            for y in 0..out.height {
                for x in 0..out.width {
                    let (mut weighted, mut weights, mut squared) = (0.0, 0.0, 0.0);
                    for (sy, wy) in nearest(y, py, height, method) {
                        for (sx, wx) in nearest(x, px, width, method) {
                            let (v, w) = (raw[sy * width + sx], wx * wy);
                            if v.is_finite() {
                                weighted += w * v;
                                weights += w;
                                squared += w * w * v;
                            }
                        }
                    }
                    image.push(value(weighted, weights, squared));
                }
            }
        }
    }
    Ok(out)
}

/// Returns the positions that contribute to position `at` of the result, with their weights. The positions
/// are below `size` and have the parity `parity`.
fn nearest(at: usize, parity: usize, size: usize, method: Method) -> impl Iterator<Item = (usize, f64)> {
    let places = match (method, at % 2 == parity) {
        (Method::Superpixel, _) => [Some((2 * at + parity, 1.0)), None],
        (Method::Bilinear, true) => [Some((at, 1.0)), None],
        (Method::Bilinear, false) => [at.checked_sub(1).map(|n| (n, 0.5)), Some((at + 1, 0.5))],
    };
    places.into_iter().flatten().filter(move |(n, _)| *n < size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::scheme::ARRAY_DEG;
    use proptest::prelude::*;

    const SIZE: [usize; 2] = [9, 7];

    /// Returns an image f(x, y, polarizer) for each polarizer.
    fn images([w, h]: [usize; 2], f: impl Fn(usize, usize, usize) -> f64) -> [Vec<f64>; 4] {
        std::array::from_fn(|p| (0..w * h).map(|i| f(i % w, i / w, p)).collect())
    }

    fn raw_of(images: &[Vec<f64>; 4], [w, h]: [usize; 2]) -> Vec<f64> {
        mosaic(images.each_ref().map(Vec::as_slice), w, h).expect("has the size")
    }

    #[test]
    fn layout_matches_the_sensor() {
        let raw = raw_of(&images([4, 4], |_, _, p| ARRAY_DEG[p]), [4, 4]);
        let (top, below) = ([90.0, 45.0, 90.0, 45.0], [135.0, 0.0, 135.0, 0.0]);
        assert_eq!(raw, [top, below, top, below].concat());
    }

    #[test]
    fn constant_images_are_recovered_up_to_the_borders() {
        for size in [SIZE, [2, 2], [2, 5], [6, 3]] {
            let raw = raw_of(&images(size, |_, _, p| p as f64 + 1.0), size);
            for method in [Method::Superpixel, Method::Bilinear] {
                let got = demosaic(&raw, size[0], size[1], method).expect("has the size");
                for (p, image) in got.images.iter().enumerate() {
                    assert_eq!(image.len(), got.width * got.height);
                    assert!(image.iter().all(|v| *v == p as f64 + 1.0), "{size:?} {method:?}");
                }
            }
        }
    }

    #[test]
    fn ramps_are_recovered_in_the_interior() {
        let [w, h] = SIZE;
        let ramps = images(SIZE, |x, y, p| (p as f64 - 1.5) * x as f64 + 3.0 * y as f64 + p as f64);
        let got = demosaic(&raw_of(&ramps, SIZE), w, h, Method::Bilinear).expect("has the size");
        assert_eq!((got.width, got.height), (w, h));
        for (got, want) in got.images.iter().zip(&ramps) {
            for i in (0..w * h).filter(|i| (1..w - 1).contains(&(i % w)) && (1..h - 1).contains(&(i / w))) {
                assert!((got[i] - want[i]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn superpixels_invert_the_mosaic_of_blocks() {
        let blocks = images([8, 6], |x, y, p| (x / 2 * 31 + y / 2 * 7 + p) as f64);
        let got = demosaic(&raw_of(&blocks, [8, 6]), 8, 6, Method::Superpixel).expect("has the size");
        assert_eq!((got.width, got.height), (4, 3));
        assert_eq!(got.images, images([4, 3], |x, y, p| (x * 31 + y * 7 + p) as f64));
    }

    /// Verifies the variances of means of one, two or four pixels of equal variance, also at the borders.
    #[test]
    fn variances_fall_with_the_pixels_that_are_averaged() {
        let got = demosaic_variance(&[4.0; 25], 5, 5, Method::Bilinear).expect("has the size");
        // Pixel (2, 2) has the 90° polarizer. The 45° polarizer is horizontally adjacent, the 135° polarizer
        // is vertically adjacent, and the 0° polarizer is diagonally adjacent.
        let inside: Vec<_> = got.images.iter().map(|v| v[12]).collect();
        assert_eq!(inside, [1.0, 2.0, 4.0, 2.0]);
        let corner: Vec<_> = got.images.iter().map(|v| v[0]).collect();
        assert_eq!(corner, [4.0; 4]);
    }

    #[test]
    fn saturated_pixels_are_left_out() {
        let mut raw = vec![1.0; 16];
        raw[5] = f64::NAN;
        let got = demosaic(&raw, 4, 4, Method::Bilinear).expect("has the size");
        assert!(got.images[0][5].is_nan());
        let others = got.images.iter().flatten().filter(|v| !v.is_nan());
        assert!(others.clone().all(|v| *v == 1.0));
        assert!(others.count() > 55);
        let got = demosaic(&raw, 4, 4, Method::Superpixel).expect("has the size");
        assert!(got.images[0][0].is_nan() && got.images[1][0] == 1.0);
    }

    proptest! {
        #[test]
        fn arbitrary_frames_never_panic(w in 0_usize..6, h in 0_usize..6, n in 0_usize..30, v in proptest::num::f64::ANY) {
            let raw = vec![v; n];
            for method in [Method::Superpixel, Method::Bilinear] {
                prop_assert_eq!(demosaic(&raw, w, h, method).is_ok(), n == w * h);
            }
            prop_assert_eq!(mosaic([&raw; 4].map(std::vec::Vec::as_slice), w, h).is_ok(), n == w * h);
        }
    }
}

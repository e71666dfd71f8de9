//! Scores that are computed from a single element or from the degree of polarization. No parameter of such a
//! score is learned, except possibly the sign.

use super::seen::{Scoring, Seen, group};
use crate::metrics::roc::area;
use crate::observation::Pixels;

/// Sums an element over wavelengths and time bins.
fn sum(p: &Pixels, pixel: usize, element: usize) -> f64 {
    let lanes = (0..p.wavelengths).flat_map(|lane| (0..p.bins).map(move |bin| (bin, lane)));
    lanes.map(|(bin, lane)| p.at(pixel, bin, element, lane)).sum()
}

/// The score -T22 of epipolar light, which measures preserved linear polarization at ±45°. The score of a
/// mirror is positive.
pub(super) struct Element22;

impl Scoring for Element22 {
    fn score(&self, seen: &Seen, pixel: usize) -> f64 {
        -sum(&seen.epipolar, pixel, 10)
    }
}

/// The score -T22/T00 of epipolar light, which does not depend on brightness.
pub(super) struct NormalizedElement22;

impl Scoring for NormalizedElement22 {
    fn score(&self, seen: &Seen, pixel: usize) -> f64 {
        let all = sum(&seen.epipolar, pixel, 0);
        if all > 0.0 { -sum(&seen.epipolar, pixel, 10) / all } else { 0.0 }
    }
}

/// The degree of polarization √(T10² + T20² + T30²)/T00 of all light under unpolarized illumination. The sign
/// of the score is learned from the training variants.
pub(super) struct DegreeOfPolarization {
    sign: f64,
}

impl DegreeOfPolarization {
    pub(super) fn learn(train: &[Seen]) -> Self {
        let plain = Self { sign: 1.0 };
        let groups = train.iter().map(|seen| group(&plain, seen));
        let (mut positive, mut negative) = (vec![], vec![]);
        for g in groups {
            positive.extend(g.positive);
            negative.extend(g.negative);
        }
        let sign = if area(&positive, &negative) < 0.5 { -1.0 } else { 1.0 };
        Self { sign }
    }
}

impl Scoring for DegreeOfPolarization {
    fn score(&self, seen: &Seen, pixel: usize) -> f64 {
        let p = &seen.polarimetric;
        let all = sum(p, pixel, 0);
        let polarized = [4, 8, 12].map(|e| sum(p, pixel, e).powi(2)).iter().sum::<f64>().sqrt();
        if all > 0.0 { self.sign * polarized / all } else { 0.0 }
    }
}

//! The common form of all methods: a linear estimate of the clear image from several features of a pixel.

use super::seen::Seen;
use crate::application::Method;
use crate::error::ApplyError;
use crate::observation::Pixels;
use crate::regression::least_squares::least_squares;
use crate::regression::moments::{Linear, Moments};

/// A method that recovers the image behind a scattering medium.
pub(super) trait Descattering: Sync {
    fn method(&self) -> Method;

    /// Returns the features of a pixel at a wavelength, and their standard errors.
    fn features(&self, seen: &Seen, pixel: usize, lane: usize) -> (Vec<f64>, Vec<f64>);

    /// Learns the weights at a wavelength, by least squares unless a method overrides it.
    fn learn(&self, train: &[Seen], lane: usize) -> Result<Linear, ApplyError> {
        Ok(least_squares(&Moments::sum(&self.moments(train, lane))))
    }

    /// Returns a note on the learned weights.
    fn note(&self, _fits: &[Linear]) -> Option<String> {
        None
    }

    /// Returns the moments of the pixels in the mask, one per variant.
    fn moments(&self, train: &[Seen], lane: usize) -> Vec<Moments> {
        train
            .iter()
            .map(|seen| {
                let (mut x, mut errors, mut y) = (vec![], vec![], vec![]);
                let mut count = 0;
                for pixel in (0..seen.mask.len()).filter(|p| seen.mask[*p]) {
                    let (features, error) = self.features(seen, pixel, lane);
                    count = features.len();
                    x.extend(features);
                    errors.extend(error);
                    y.push(seen.truth.data[pixel * seen.truth.channels + lane]);
                }
                Moments::of(count, &x, &errors, &y)
            })
            .collect()
    }
}

/// Returns Σₑ wₑ Tₑ over elements of a pixel (and all bins), and its standard error for independent errors of
/// the elements.
pub(super) fn weighed(p: &Pixels, pixel: usize, lane: usize, weights: &[(usize, f64)]) -> (f64, f64) {
    let (mut sum, mut variance) = (0.0, 0.0);
    for bin in 0..p.bins {
        for (element, w) in weights {
            sum += w * p.at(pixel, bin, *element, lane);
            variance += (w * p.error_at(pixel, bin, *element, lane)).powi(2);
        }
    }
    (sum, variance.sqrt())
}

/// Separates values and errors.
pub(super) fn apart(pairs: impl IntoIterator<Item = (f64, f64)>) -> (Vec<f64>, Vec<f64>) {
    pairs.into_iter().unzip()
}

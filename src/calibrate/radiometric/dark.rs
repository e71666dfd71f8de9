//! The dark frame, which contains the offset, dark current and noise of each pixel, and the pixels to
//! exclude.

use super::error::RadiometricError;
use super::stack::{Stack, check};
use crate::pixel_map::PixelMap;
use serde::{Deserialize, Serialize};

/// Ratio of standard deviation to median absolute deviation of a normal distribution.
const SIGMA_PER_MAD: f64 = 1.4826;

/// Readings of a camera without light.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Dark {
    pub exposures_s: Vec<f64>,
    /// Pixels whose dark signal is an outlier.
    pub hot: Vec<u32>,
    /// Pixels whose noise is an outlier.
    pub noisy: Vec<u32>,
    /// Pixels whose reading is the same in all frames.
    pub stuck: Vec<u32>,
    /// Offset at zero exposure in DN, or at the exposure of the dark frames if all dark frames have
    /// the same exposure.
    pub offset: PixelMap,
    pub offset_sigma: PixelMap,
    /// Variance between frames at the shortest exposure in DN².
    pub variance: PixelMap,
    pub variance_sigma: PixelMap,
    /// Dark current in DN/s. `None` unless the dark frames have at least two exposures.
    pub rate: Option<PixelMap>,
    pub rate_sigma: Option<PixelMap>,
}

fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    values.sort_by(f64::total_cmp);
    let n = values.len();
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}

impl Dark {
    /// Computes the dark frame from stacks at one or more exposures. Pixels that deviate by more than
    /// `limit` standard deviations are listed as outliers.
    ///
    /// Exposures are weighted by the sensor's noise. Standard errors use each pixel's noise at each exposure.
    ///
    /// # Errors
    /// Returns [`RadiometricError`] if frames are missing or do not match.
    pub fn of(stacks: &[Stack], limit: f64) -> Result<Self, RadiometricError> {
        check(&stacks.iter().collect::<Vec<_>>())?;
        let pixels = stacks[0].pixels();
        let weights: Vec<f64> = stacks
            .iter()
            .map(|s| {
                f64::from(s.frames()) / median((0..pixels).map(|p| s.variance(p)).collect()).max(1.0 / 12.0)
            })
            .collect();
        let sum =
            |f: &dyn Fn(&Stack) -> f64| -> f64 { stacks.iter().zip(&weights).map(|(s, w)| w * f(s)).sum() };
        let (s0, s1, s2) = (sum(&|_| 1.0), sum(&Stack::exposure_s), sum(&|s| s.exposure_s().powi(2)));
        let determinant = s0 * s2 - s1 * s1;
        let several = determinant > 1e-6 * s0 * s2;
        // Weights of the stacks' means in the offset and the rate.
        let parts: Vec<[f64; 2]> = stacks
            .iter()
            .zip(&weights)
            .map(|(s, w)| {
                if several {
                    let t = s.exposure_s();
                    [w * (s2 - s1 * t) / determinant, w * (s0 * t - s1) / determinant]
                } else {
                    [w / s0, 0.0]
                }
            })
            .collect();
        let by_exposure = |a: &&Stack, b: &&Stack| a.exposure_s().total_cmp(&b.exposure_s());
        let shortest = stacks.iter().min_by(by_exposure).unwrap_or(&stacks[0]);
        let longest = stacks.iter().max_by(by_exposure).unwrap_or(&stacks[0]);
        let freedom = f64::from(shortest.frames() - 1);
        let variance = |p: usize| shortest.variance(p);
        let value =
            |p: usize, k: usize| -> f64 { stacks.iter().zip(&parts).map(|(s, l)| l[k] * s.mean(p)).sum() };
        let sigma = |p: usize, k: usize| -> f64 {
            let each =
                stacks.iter().zip(&parts).map(|(s, l)| l[k].powi(2) * s.variance(p) / f64::from(s.frames()));
            each.sum::<f64>().sqrt()
        };
        let map = |f: &dyn Fn(usize) -> f64| (0..pixels).map(f).collect::<PixelMap>();
        let middle = median((0..pixels).map(|p| longest.mean(p)).collect());
        let noise = median((0..pixels).map(variance).collect());
        let apart = median((0..pixels).map(|p| (longest.mean(p) - middle).abs()).collect());
        let spread = (SIGMA_PER_MAD * apart).max((noise / f64::from(longest.frames())).sqrt());
        let few = 2.0 / (9.0 * freedom);
        let (mut hot, mut noisy, mut stuck) = (vec![], vec![], vec![]);
        for p in 0..pixels {
            let v = variance(p);
            // The cube root of a sample variance is nearly normally distributed (Wilson and Hilferty 1931).
            if v == 0.0 {
                stuck.push(p as u32);
            } else if longest.mean(p) - middle > limit * spread {
                hot.push(p as u32);
            } else if noise > 0.0 && (v / noise).cbrt() > 1.0 + limit * few.sqrt() {
                noisy.push(p as u32);
            }
        }
        if hot.len() + noisy.len() + stuck.len() == pixels {
            return Err(RadiometricError::NoPixel { hot: hot.len(), noisy: noisy.len(), stuck: stuck.len() });
        }
        let mut exposures_s: Vec<f64> = stacks.iter().map(Stack::exposure_s).collect();
        exposures_s.sort_by(f64::total_cmp);
        exposures_s.dedup();
        Ok(Self {
            exposures_s,
            hot,
            noisy,
            stuck,
            offset: map(&|p| value(p, 0)),
            offset_sigma: map(&|p| sigma(p, 0)),
            variance: map(&variance),
            variance_sigma: map(&|p| variance(p) * (2.0 / freedom).sqrt()),
            rate: several.then(|| map(&|p| value(p, 1))),
            rate_sigma: several.then(|| map(&|p| sigma(p, 1))),
        })
    }

    /// Returns a pixel's reading without light in DN.
    pub fn at(&self, pixel: usize, exposure_s: f64) -> f64 {
        self.offset.at(pixel) + self.rate.as_ref().map_or(0.0, |r| r.at(pixel) * exposure_s)
    }

    /// Returns the variance of [`Self::at`] due to the noise of the dark frames.
    ///
    /// The result ignores the covariance of offset and rate. Within the range of exposures, the result is
    /// therefore too large.
    pub fn variance_of_mean(&self, pixel: usize, exposure_s: f64) -> f64 {
        let rate = self.rate_sigma.as_ref().map_or(0.0, |r| r.at(pixel) * exposure_s);
        self.offset_sigma.at(pixel).powi(2) + rate.powi(2)
    }

    /// Returns the mean dark current of the usable pixels in DN/s, or 0 if the dark current is unknown.
    pub fn mean_rate(&self) -> f64 {
        let Some(rate) = &self.rate else { return 0.0 };
        let usable = self.usable();
        let used = (0..usable.len()).filter(|p| usable[*p]);
        let (sum, n) = used.fold((0.0, 0.0), |(sum, n), p| (sum + rate.at(p), n + 1.0));
        sum / n
    }

    pub fn usable(&self) -> Vec<bool> {
        let mut out = vec![true; self.offset.len()];
        for p in self.hot.iter().chain(&self.noisy).chain(&self.stuck) {
            if let Some(v) = out.get_mut(*p as usize) {
                *v = false;
            }
        }
        out
    }
}

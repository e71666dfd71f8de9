//! The flat field, which is each pixel's response relative to the mean.

use super::dark::Dark;
use super::levels::Level;
use super::linearity::Linearity;
use super::stack::Stack;
use super::transfer::Transfer;
use crate::pixel_map::PixelMap;
use serde::{Deserialize, Serialize};

/// Minimum and maximum of the signals that are used, as fractions of the saturation signal.
const USED: [f64; 2] = [0.05, 0.7];

#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Flat {
    /// Photoresponse non-uniformity (PRNU), which is the standard deviation of the response over pixels. The
    /// value excludes noise and includes non-uniformity of the light.
    pub prnu: f64,
    pub prnu_sigma: f64,
    /// Response relative to the mean, or NaN for unusable pixels.
    pub response: PixelMap,
    pub sigma: PixelMap,
}

impl Flat {
    /// Computes the response from uniformly lit stacks.
    ///
    /// # Errors
    /// Returns a message that names the missing frames if lit frames are missing.
    pub fn of(
        dark: &Dark,
        stacks: &[Stack],
        levels: &[Level],
        saturation: Option<f64>,
        linearity: &Linearity,
        transfer: &Transfer,
    ) -> Result<Self, String> {
        let top = saturation.unwrap_or_else(|| levels.iter().map(|l| l.signal).fold(0.0, f64::max) / USED[1]);
        let (usable, rate) = (dark.usable(), dark.mean_rate());
        let pixels = usable.len();
        let (mut sum, mut variance) = (vec![0.0; pixels], vec![0.0; pixels]);
        let (mut whole, mut of_offset) = (0.0, vec![0.0; pixels]);
        for s in stacks.iter().filter(|s| s.clipped() == 0.0 && s.light() > 0.0) {
            let signal = |p: usize| s.mean(p) - dark.at(p, s.exposure_s());
            let (n, total) =
                (0..pixels).filter(|p| usable[*p]).fold((0.0, 0.0), |(n, t), p| (n + 1.0, t + signal(p)));
            let mean = total / n;
            if !(USED[0] * top..=USED[1] * top).contains(&mean) {
                continue;
            }
            let linear = linearity.linear(mean);
            let noise = transfer.variance(linear + rate * s.exposure_s()) / f64::from(s.frames());
            // The weights minimize the variance of the ratio of the two sums.
            let w = linear / noise;
            whole += w * linear;
            for p in 0..pixels {
                sum[p] += w * linearity.linear(signal(p));
                variance[p] += w * w * noise;
                of_offset[p] += w * dark.variance_of_mean(p, s.exposure_s()).sqrt();
            }
        }
        if whole <= 0.0 {
            return Err(
                "flat field: no stack has uniform light at 5 to 70 % of saturation; capture such a stack"
                    .into(),
            );
        }
        let used: Vec<usize> = (0..pixels).filter(|p| usable[*p]).collect();
        let count = used.len() as f64;
        let mean = used.iter().map(|p| sum[*p]).sum::<f64>() / count;
        let response: Vec<f64> =
            (0..pixels).map(|p| if usable[p] { sum[p] / mean } else { f64::NAN }).collect();
        // The error of the dark frame is common to all stacks.
        let sigma: Vec<f64> = (0..pixels)
            .map(|p| {
                let r = (sum[p] / mean).max(0.0);
                (variance[p] * r + of_offset[p].powi(2)).sqrt() / mean
            })
            .collect();
        let spread = used.iter().map(|p| (response[*p] - 1.0).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        let noise = used.iter().map(|p| sigma[*p].powi(2)).sum::<f64>() / count;
        let prnu = (spread - noise).max(0.0).sqrt();
        let error = spread * (2.0 / (count - 1.0).max(1.0)).sqrt();
        Ok(Self {
            prnu,
            prnu_sigma: if prnu > 0.0 { error / (2.0 * prnu) } else { error.sqrt() },
            response: response.into_iter().collect(),
            sigma: sigma.into_iter().collect(),
        })
    }
}

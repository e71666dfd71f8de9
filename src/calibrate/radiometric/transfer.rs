//! Gain and read noise by photon transfer.
//!
//! Var y = σ² + y/g is fitted to the dark frames and to the levels up to 70 % of saturation (EMVA 1288,
//! 6.6). y includes the signals of light and dark current, because the electrons of both have shot noise.
//! If all dark frames have the same exposure, the dark current is part of σ².
//!
//! A variance that is estimated from n frames and P pixels has the relative standard error √(2/((n - 1) P)).
//! There are three smaller terms: the fourth cumulant of the Poisson distribution, the error of the mean
//! signal, and their covariance. These terms cancel except for σ²/(n P), which is negligible.

use super::levels::Level;
use super::linearity::Linearity;
use serde::{Deserialize, Serialize};

const USED: f64 = 0.7;
/// Variance of rounding to integers in DN².
const ROUNDING: f64 = 1.0 / 12.0;

/// The photon transfer curve.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Transfer {
    /// Gain g in e⁻/DN.
    pub gain_e_per_dn: f64,
    pub gain_sigma: f64,
    /// Read noise in e⁻, excluding rounding noise.
    pub read_noise_e: f64,
    /// Standard error of the read noise, or NaN if rounding noise dominates.
    pub read_noise_sigma: f64,
    /// Variance σ² in DN² of readings without electrons.
    pub dark_variance: f64,
    /// Covariance of σ² and 1/g, given by the elements (σ², σ²), (σ², 1/g) and (1/g, 1/g).
    pub covariance: [f64; 3],
    /// Full-well capacity, which is the number of electrons at saturation, if a level reached saturation.
    pub full_well_e: Option<f64>,
    /// Chi-squared, which is the sum of squared residuals, each divided by its variance.
    pub chi_squared: f64,
    pub freedom: usize,
}

impl Transfer {
    /// Returns the variance in DN² of a reading, including rounding noise. `signal` is the linear
    /// signal, including the dark current.
    pub fn variance(&self, signal: f64) -> f64 {
        self.dark_variance + signal.max(0.0) / self.gain_e_per_dn
    }

    /// Fits the curve to the levels' linearized signals.
    ///
    /// # Errors
    /// Returns a message that names the missing frames if there are too few levels.
    pub fn of(
        dark: &[Level],
        levels: &[Level],
        saturation: Option<f64>,
        linearity: &Linearity,
    ) -> Result<Self, String> {
        // Signal, variance, and degrees of freedom (2 / relative variance of the variance).
        let freedom = |l: &Level| (l.frames - 1.0) * l.pixels;
        let mut points: Vec<(f64, f64, f64)> =
            dark.iter().map(|l| (l.dark, l.variance, freedom(l))).collect();
        let without = points.iter().map(|p| p.1).fold(f64::INFINITY, f64::min);
        let most = saturation.map_or(f64::INFINITY, |s| USED * s);
        for l in levels.iter().filter(|l| l.signal <= most && l.clipped == 0.0 && l.light > 0.0) {
            let slope = linearity.slope(l.signal);
            points.push((linearity.linear(l.signal) + l.dark, l.variance * slope * slope, freedom(l)));
        }
        if points.len() <= dark.len() {
            return Err("gain: no light level is below saturation; capture frames with less light".into());
        }
        let brightest = points.iter().map(|p| p.0).fold(0.0, f64::max);
        let at_brightest = points.iter().find(|p| p.0 == brightest).map_or(without, |p| p.1);
        let (mut offset, mut slope) = (without.max(1e-12), (at_brightest - without).max(0.0) / brightest);
        let mut covariance = [0.0; 3];
        let mut chi_squared = 0.0;
        for _ in 0..5 {
            let weight = |p: &(f64, f64, f64)| p.2 / (2.0 * (offset + slope * p.0).max(1e-12).powi(2));
            let sum = |f: &dyn Fn(&(f64, f64, f64)) -> f64| -> f64 {
                points.iter().map(|p| weight(p) * f(p)).sum()
            };
            let (s0, s1, s2) = (sum(&|_| 1.0), sum(&|p| p.0), sum(&|p| p.0 * p.0));
            let (v0, v1) = (sum(&|p| p.1), sum(&|p| p.0 * p.1));
            let determinant = s0 * s2 - s1 * s1;
            covariance = [s2 / determinant, -s1 / determinant, s0 / determinant];
            let found = ((v0 * s2 - v1 * s1) / determinant, (s0 * v1 - s1 * v0) / determinant);
            chi_squared = sum(&|p| (p.1 - found.0 - found.1 * p.0).powi(2));
            (offset, slope) = (found.0.max(1e-12), found.1.max(0.0));
        }
        let message = slope.is_finite() && slope > 5.0 * covariance[2].sqrt();
        if !message {
            return Err(
                "gain: the noise does not increase with the light; take more frames or use more light".into(),
            );
        }
        let gain = 1.0 / slope;
        let electronic = offset - ROUNDING;
        let [vo, vs, ss] = covariance;
        let (read_noise_e, read_noise_sigma) = if electronic > 0.0 {
            let r = electronic.sqrt() * gain;
            // Error propagation of √(σ² - 1/12)/slope.
            let (by_offset, by_slope) = (0.5 * r / electronic, -r / slope);
            let v = by_offset.powi(2) * vo + 2.0 * by_offset * by_slope * vs + by_slope.powi(2) * ss;
            (r, v.sqrt())
        } else {
            (0.0, f64::NAN)
        };
        Ok(Self {
            gain_e_per_dn: gain,
            gain_sigma: gain * gain * ss.sqrt(),
            read_noise_e,
            read_noise_sigma,
            dark_variance: offset,
            covariance,
            full_well_e: saturation.map(|s| linearity.linear(s) * gain),
            chi_squared,
            freedom: points.len() - 2,
        })
    }
}

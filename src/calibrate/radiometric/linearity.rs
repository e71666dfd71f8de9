//! Nonlinearity of the signal as a function of light.

use super::levels::Level;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Maximum of the signals that are used, as a fraction of the saturation signal (EMVA 1288, 9.2: 95 %).
const USED: f64 = 0.95;

/// A polynomial y (1 + Σ c_j (y/Y)^j) that linearizes the signal y.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Linearity {
    /// Signal scale Y in DN.
    pub scale_dn: f64,
    /// Polynomial coefficients c₁, c₂, …
    pub coefficients: Vec<f64>,
    pub sigma: Vec<f64>,
    pub covariance: Vec<Vec<f64>>,
    /// Signal above the dark frame at zero light in DN. This signal is due to stray light, or to an exposure
    /// that is longer than stated.
    pub stray_dn: f64,
    pub stray_sigma: f64,
    /// DN per unit of light for small signals.
    pub response: f64,
    pub response_sigma: f64,
    /// Linearity error LE of EMVA 1288, which is the mean relative deviation of signals from the best
    /// straight line.
    pub linearity_error: f64,
    /// Chi-squared, which is the sum of squared residuals, each divided by its variance.
    pub chi_squared: f64,
    pub freedom: usize,
}

impl Linearity {
    /// Returns the polynomial of a linear camera, y ↦ y.
    pub fn none(scale_dn: f64) -> Self {
        Self {
            scale_dn,
            coefficients: vec![],
            sigma: vec![],
            covariance: vec![],
            stray_dn: 0.0,
            stray_sigma: f64::NAN,
            response: f64::NAN,
            response_sigma: f64::NAN,
            linearity_error: f64::NAN,
            chi_squared: 0.0,
            freedom: 0,
        }
    }

    /// Returns the linearized signal in DN.
    pub fn linear(&self, signal: f64) -> f64 {
        let u = signal / self.scale_dn;
        signal * (1.0 + self.coefficients.iter().rev().fold(0.0, |sum, c| (sum + c) * u))
    }

    /// Returns the derivative of [`Self::linear`].
    pub fn slope(&self, signal: f64) -> f64 {
        let u = signal / self.scale_dn;
        let terms = self.coefficients.iter().enumerate();
        1.0 + terms.map(|(j, c)| (j + 2) as f64 * c * u.powi(j as i32 + 1)).sum::<f64>()
    }

    /// Fits a polynomial of `degree` coefficients to levels below saturation.
    ///
    /// Without saturation, `scale_dn` is the largest signal. `light_sigma` is the relative standard error
    /// of the light of each level.
    ///
    /// # Errors
    /// Returns a message that states which levels are missing if there are too few levels.
    pub fn of(
        levels: &[Level],
        saturation: Option<f64>,
        degree: usize,
        light_sigma: f64,
    ) -> Result<Self, String> {
        let most = saturation.map_or(f64::INFINITY, |s| USED * s);
        let used: Vec<&Level> = levels
            .iter()
            .filter(|l| l.signal > 0.0 && l.signal <= most && l.clipped == 0.0 && l.light > 0.0)
            .collect();
        let top = used.iter().map(|l| l.signal).fold(0.0, f64::max);
        let scale_dn = saturation.unwrap_or(top);
        let unknown = degree + 2;
        let mut lights: Vec<f64> = used.iter().map(|l| l.light).collect();
        lights.dedup();
        if lights.len() <= unknown {
            return Err(format!(
                "linearity: {} light levels are below saturation, but a polynomial of degree {degree} needs at least {} levels",
                lights.len(),
                unknown + 1
            ));
        }
        // s H + stray - Σ c y u^j = y, with each row divided by the standard deviation of y. The effect
        // of the error of y in the sum is of second order.
        let greatest = lights[lights.len() - 1];
        let row = |l: &Level, k: usize| match k {
            0 => l.light / greatest,
            1 => 1.0,
            _ => -l.signal * (l.signal / scale_dn).powi(k as i32 - 1) / scale_dn,
        };
        let mut sigmas: Vec<f64> = vec![1.0; used.len()];
        let mut x = DVector::zeros(unknown);
        let mut inverse = DMatrix::identity(unknown, unknown);
        let mut chi_squared = 0.0;
        for round in 0..3 {
            let mut trial = Self::none(scale_dn);
            trial.coefficients = x.iter().skip(2).map(|c| c / scale_dn).collect();
            for (sigma, l) in sigmas.iter_mut().zip(&used) {
                let slope = if round == 0 { 1.0 } else { trial.slope(l.signal) };
                let noise = l.variance / (l.frames * l.pixels) * slope * slope;
                *sigma = (noise + (light_sigma * l.signal).powi(2)).sqrt();
            }
            let m = DMatrix::from_fn(used.len(), unknown, |i, k| row(used[i], k) / sigmas[i]);
            let y = DVector::from_fn(used.len(), |i, _| used[i].signal / sigmas[i]);
            let normal = m.transpose() * &m;
            let scale = DVector::from_fn(unknown, |k, _| 1.0 / normal[(k, k)].sqrt());
            let scaled = DMatrix::from_fn(unknown, unknown, |i, k| normal[(i, k)] * scale[i] * scale[k]);
            let solved = scaled.cholesky().map(|c| c.inverse());
            let Some(solved) = solved.filter(|s| s.iter().all(|v| v.is_finite() && v.abs() < 1e11)) else {
                return Err(
                    "linearity: the light levels are too close to each other; use a wider range".into()
                );
            };
            inverse = DMatrix::from_fn(unknown, unknown, |i, k| solved[(i, k)] * scale[i] * scale[k]);
            x = &inverse * (m.transpose() * &y);
            chi_squared = (&m * &x - y).norm_squared();
        }
        let sigma = |k: usize| inverse[(k, k)].sqrt();
        // The solution is c · Y, because the polynomial's columns contain an additional factor 1/Y.
        let coefficients = (2..unknown).map(|k| x[k] / scale_dn).collect();
        let over = scale_dn * scale_dn;
        Ok(Self {
            scale_dn,
            coefficients,
            sigma: (2..unknown).map(|k| sigma(k) / scale_dn).collect(),
            covariance: (2..unknown)
                .map(|i| (2..unknown).map(|k| inverse[(i, k)] / over).collect())
                .collect(),
            stray_dn: x[1],
            stray_sigma: sigma(1),
            response: x[0] / greatest,
            response_sigma: sigma(0) / greatest,
            linearity_error: from_line(&used),
            chi_squared,
            freedom: used.len() - unknown,
        })
    }
}

/// Returns the mean relative deviation from the straight line with the least sum of squared relative
/// deviations. Uses the levels above 5 % of the largest signal.
fn from_line(levels: &[&Level]) -> f64 {
    let top = levels.iter().map(|l| l.signal).fold(0.0, f64::max);
    let near: Vec<_> = levels.iter().filter(|l| l.signal >= 0.05 * top).collect();
    let sum = |f: &dyn Fn(&Level) -> f64| -> f64 { near.iter().map(|l| f(l) / (l.signal * l.signal)).sum() };
    let (s0, s1, s2) = (sum(&|_| 1.0), sum(&|l| l.light), sum(&|l| l.light * l.light));
    let (y0, y1) = (sum(&|l| l.signal), sum(&|l| l.signal * l.light));
    let determinant = s0 * s2 - s1 * s1;
    let (a, b) = ((y0 * s2 - y1 * s1) / determinant, (s0 * y1 - s1 * y0) / determinant);
    let off = |l: &Level| ((l.signal - a - b * l.light) / (a + b * l.light)).abs();
    near.iter().map(|l| off(l)).sum::<f64>() / near.len() as f64
}

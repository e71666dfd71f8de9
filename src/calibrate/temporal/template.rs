//! A measured response (see [`super::aligned`]).

use serde::{Deserialize, Serialize};

/// A measured response, which is the fraction of light in a bin as a function of the delay of the bin's
/// centre.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Template {
    pub step_ps: f64,
    /// Delay of the first grid point after the arrival of the light, in ps.
    pub first_ps: f64,
    /// For each grid point, the fraction of the light that is detected in a bin with its centre at this
    /// delay.
    pub share: Vec<f64>,
    /// Standard errors of the fractions, or NaN for fractions that are interpolated from neighbours.
    pub sigma: Vec<f64>,
    /// Probability of afterpulses. `share` excludes afterpulses.
    pub after_pulsing: f64,
}

impl Template {
    /// Returns the delay of the last grid point after the arrival of the light, in ps.
    pub fn end_ps(&self) -> f64 {
        self.first_ps + self.step_ps * self.share.len().saturating_sub(1) as f64
    }

    /// Returns the fraction of light in a bin whose centre is delayed by `t` ps, by Catmull–Rom
    /// interpolation. Outside the grid, the fraction is 0.
    pub fn share(&self, t: f64) -> f64 {
        let place = (t - self.first_ps) / self.step_ps;
        let at = |k: f64| {
            if k >= 0.0 { self.share.get(k as usize).copied().unwrap_or(0.0) } else { 0.0 }
        };
        let (k, u) = (place.floor(), place - place.floor());
        if !(-1.0..self.share.len() as f64).contains(&k) {
            return 0.0;
        }
        let [a, b, c, d] = [-1.0, 0.0, 1.0, 2.0].map(|i| at(k + i));
        b + 0.5 * u * (c - a + u * (2.0 * a - 5.0 * b + 4.0 * c - d + u * (3.0 * (b - c) + d - a)))
    }

    /// Returns the full width at half maximum in ps, including the bin width. The result is at least the grid
    /// step.
    pub fn fwhm_ps(&self) -> f64 {
        let Some((top, most)) = self.share.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)) else {
            return self.step_ps;
        };
        // Returns the number of grid steps from the maximum to the half-maximum crossing on one side.
        let side = |values: &mut dyn Iterator<Item = &f64>| {
            let mut last = *most;
            let mut place = 0.0;
            for v in values {
                if *v < 0.5 * most {
                    return place + (last - 0.5 * most) / (last - v);
                }
                (last, place) = (*v, place + 1.0);
            }
            place
        };
        let wide = side(&mut self.share[top + 1..].iter()) + side(&mut self.share[..top].iter().rev());
        wide.max(1.0) * self.step_ps
    }
}

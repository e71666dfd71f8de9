//! A response as it was measured, see [`super::aligned`].

use serde::{Deserialize, Serialize};

/// A measured response: shares of light in a bin whose middle is so much later than the light.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Template {
    /// Step of the grid, ps.
    pub step_ps: f64,
    /// Time of its first place, ps after the light.
    pub first_ps: f64,
    /// Shares of a bin.
    pub share: Vec<f64>,
    /// Their standard errors; NaN where no histogram had a bin, and the share is that of its neighbours.
    pub sigma: Vec<f64>,
    /// Probability of after-pulses, which are not in the shares.
    pub after_pulsing: f64,
}

impl Template {
    /// Time of its first place, ps.
    #[must_use]
    pub fn start_ps(&self) -> f64 {
        self.first_ps
    }

    /// Time of its last place, ps.
    #[must_use]
    pub fn end_ps(&self) -> f64 {
        self.first_ps + self.step_ps * self.share.len().saturating_sub(1) as f64
    }

    /// Share of light in a bin whose middle is `t` ps later: cubic between places (Catmull and Rom), 0 outside.
    #[must_use]
    pub fn share(&self, t: f64) -> f64 {
        let place = (t - self.first_ps) / self.step_ps;
        let at = |k: f64| {
            if k >= 0.0 {
                self.share.get(k as usize).copied().unwrap_or(0.0)
            } else {
                0.0
            }
        };
        let (k, u) = (place.floor(), place - place.floor());
        if !(-1.0..self.share.len() as f64).contains(&k) {
            return 0.0;
        }
        let [a, b, c, d] = [-1.0, 0.0, 1.0, 2.0].map(|i| at(k + i));
        b + 0.5 * u * (c - a + u * (2.0 * a - 5.0 * b + 4.0 * c - d + u * (3.0 * (b - c) + d - a)))
    }

    /// Full width at half maximum, ps, bins' own width included; the step if it has no maximum.
    #[must_use]
    pub fn fwhm_ps(&self) -> f64 {
        let Some((top, most)) = self.share.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)) else {
            return self.step_ps;
        };
        // Places from the top to where half of it is crossed, on one side.
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

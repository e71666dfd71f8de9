//! Time gating: light in one window of travel time, under full light.
//!
//! The window minimizes the loss on the training variants, for each wavelength. A gate that follows the depth
//! of objects, as in a scan over depth, is not included.

use super::linear::{Descattering, apart};
use super::seen::Seen;
use crate::application::Method;
use crate::error::ApplyError;
use crate::regression::least_squares::least_squares;
use crate::regression::moments::{Linear, Moments};
use nalgebra::DVector;

pub(super) struct TimeGating;

impl Descattering for TimeGating {
    fn method(&self) -> Method {
        Method { name: "time gating", source: "range gating" }
    }

    fn features(&self, seen: &Seen, pixel: usize, lane: usize) -> (Vec<f64>, Vec<f64>) {
        let p = &seen.transient;
        apart((0..p.bins).map(|bin| (p.at(pixel, bin, 0, lane), p.error_at(pixel, bin, 0, lane))))
    }

    fn learn(&self, train: &[Seen], lane: usize) -> Result<Linear, ApplyError> {
        let all = Moments::sum(&self.moments(train, lane));
        let bins = all.x.len();
        let windows = (0..bins).flat_map(|from| (from + 1..=bins).map(move |to| (from, to)));
        let fits = windows.map(|(from, to)| {
            let window = DVector::from_fn(bins, |i, _| f64::from(u8::from((from..to).contains(&i))));
            let projected = all.projected(&window);
            let fit = least_squares(&projected);
            let loss = projected.loss(&fit);
            let linear = Linear { weights: window * fit.weights[0], offset: fit.offset };
            (linear, loss)
        });
        let best = fits.min_by(|a, b| a.1.total_cmp(&b.1));
        best.map(|(fit, _)| fit).ok_or_else(|| ApplyError::Unsolved {
            method: "time gating",
            cause: "the slice has no time bins".into(),
        })
    }

    fn note(&self, fits: &[Linear]) -> Option<String> {
        let window = |fit: &Linear| {
            let open: Vec<usize> = (0..fit.weights.len()).filter(|i| fit.weights[*i] != 0.0).collect();
            Some(format!("{}..{}", open.first()?, open.last()? + 1))
        };
        let all: Option<Vec<String>> = fits.iter().map(window).collect();
        Some(format!("time gating: bins {} (per wavelength)", all?.join(", ")))
    }
}

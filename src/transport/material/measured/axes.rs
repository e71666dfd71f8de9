//! The angles and wavelengths of a table's entries, and the interpolation between entries.

use super::error::PbsdfError;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Maximum distance of an angle outside the valid range that is accepted as a rounding error, radians.
const TOLERANCE: f32 = 1e-3;

/// The axes of a table in the order of its dimensions. Angles are in radians, and vacuum wavelengths are in
/// nanometres.
#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// Azimuth of the difference vector, radians in [-π, π].
    pub phi_d: Vec<f32>,
    /// Polar angle of the difference vector, radians in [0, π/2].
    pub theta_d: Vec<f32>,
    /// Polar angle of the half vector, radians in [0, π/2].
    pub theta_h: Vec<f32>,
    /// Vacuum wavelengths in nanometres, ascending.
    pub wavelengths_nm: Vec<u16>,
}

/// Returns `count` evenly spaced values from `low` to `high`, both included.
fn evenly(low: f32, high: f32, count: usize) -> Vec<f32> {
    let last = count.saturating_sub(1).max(1) as f64;
    let (low, high) = (f64::from(low), f64::from(high));
    (0..count).map(|i| (low + (high - low) * (i as f64 / last)) as f32).collect()
}

/// Names of the angular axes with their ranges in radians.
pub(super) const ANGLES: [(&str, f32, f32); 3] =
    [("phi_d", -PI, PI), ("theta_d", 0.0, FRAC_PI_2), ("theta_h", 0.0, FRAC_PI_2)];

impl Axes {
    /// Creates axes of evenly spaced angles over the whole ranges. `counts` are the numbers of values of
    /// phi_d, theta_d and theta_h.
    pub fn even(counts: [usize; 3], wavelengths_nm: Vec<u16>) -> Self {
        let [phi_d, theta_d, theta_h] = [0, 1, 2].map(|k| even_axis(k, counts[k]));
        Self { phi_d, theta_d, theta_h, wavelengths_nm }
    }

    /// Returns the angular axes in the order of [`ANGLES`].
    pub(super) fn angles(&self) -> [&[f32]; 3] {
        [&self.phi_d, &self.theta_d, &self.theta_h]
    }

    /// Returns the number of elements with the same phi_d: theta_d × theta_h × wavelength × 16.
    ///
    /// # Errors
    /// Returns [`PbsdfError::TooLarge`] if the number of elements or the size of the table overflows.
    pub fn slab_len(&self) -> Result<usize, PbsdfError> {
        let parts = [self.theta_d.len(), self.theta_h.len(), self.wavelengths_nm.len()];
        let slab = parts.iter().try_fold(16, |n: usize, p| n.checked_mul(*p));
        slab.filter(|n| n.checked_mul(self.phi_d.len()).is_some_and(|n| n <= isize::MAX as usize / 4))
            .ok_or(PbsdfError::TooLarge)
    }

    /// Checks the ranges, order and lengths of the axes.
    ///
    /// # Errors
    /// Returns a [`PbsdfError`] if an axis is too short, not increasing or out of range, or if `phi_d` covers
    /// only half a circle.
    pub fn check(&self) -> Result<(), PbsdfError> {
        for (values, (axis, low, high)) in self.angles().into_iter().zip(ANGLES) {
            if values.len() < 2 {
                return Err(PbsdfError::ShortAxis(axis, values.len()));
            }
            let range = low - TOLERANCE..=high + TOLERANCE;
            if let Some(&value) = values.iter().find(|v| !range.contains(*v)) {
                return Err(PbsdfError::Angle { axis, value, low, high });
            }
            if let Some(w) = values.windows(2).find(|w| w[0] >= w[1]) {
                return Err(PbsdfError::Order { axis, before: w[0].into(), after: w[1].into() });
            }
        }
        let (first, last) = (self.phi_d[0], self.phi_d[self.phi_d.len() - 1]);
        if first + TAU - last > PI - TOLERANCE {
            return Err(PbsdfError::HalfCircle(first, last));
        }
        if self.wavelengths_nm.is_empty() {
            return Err(PbsdfError::NoWavelengths);
        }
        if let Some(w) = self.wavelengths_nm.windows(2).find(|w| w[0] >= w[1]) {
            return Err(PbsdfError::Order { axis: "wvls", before: w[0].into(), after: w[1].into() });
        }
        Ok(())
    }
}

/// Returns `count` evenly spaced values of the `k`-th axis in [`ANGLES`].
pub(super) fn even_axis(k: usize, count: usize) -> Vec<f32> {
    let (_, low, high) = ANGLES[k];
    evenly(low, high, count)
}

/// The indices of the two entries next to a value, and the interpolation weight of the second entry.
pub(super) type Between = (usize, usize, f32);

/// One checked axis, ready for lookup.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    nodes: Vec<f32>,
    /// Number of entries per radian if the entries are evenly spaced, otherwise `None`.
    rate: Option<f32>,
}

impl Axis {
    /// Creates an axis from two or more strictly ascending values.
    pub fn new(nodes: Vec<f32>) -> Self {
        let (first, last) = (nodes[0], nodes[nodes.len() - 1]);
        let step = (last - first) / (nodes.len() - 1) as f32;
        let even = nodes.iter().enumerate().all(|(i, v)| (v - (first + step * i as f32)).abs() < 0.01 * step);
        Self { nodes, rate: even.then(|| step.recip()) }
    }

    pub fn nodes(&self) -> &[f32] {
        &self.nodes
    }

    /// Returns the index of the entry at or below `x`. The value `x` may exceed the axis by a rounding error.
    #[inline]
    fn below(&self, x: f32) -> usize {
        let last = self.nodes.len() - 2;
        match self.rate {
            Some(rate) => {
                // The index is off by at most one, because the spacing of the entries is even to within a
                // hundredth of a step.
                let i = (((x - self.nodes[0]) * rate) as usize).min(last);
                if x < self.nodes[i] {
                    i.saturating_sub(1)
                } else if x >= self.nodes[i + 1] {
                    (i + 1).min(last)
                } else {
                    i
                }
            }
            None => self.nodes.partition_point(|n| *n <= x).saturating_sub(1).min(last),
        }
    }

    /// Returns the interpolation position of `x`, clamped to the ends of the axis.
    #[inline]
    pub fn place(&self, x: f32) -> Between {
        let i = self.below(x);
        let (a, b) = (self.nodes[i], self.nodes[i + 1]);
        (i, i + 1, ((x - a) / (b - a)).clamp(0.0, 1.0))
    }

    /// Returns the interpolation position of the angle `x` in [-π, π] on a periodic axis. On a periodic axis,
    /// the last and the first entry are adjacent.
    #[inline]
    pub fn place_around(&self, x: f32) -> Between {
        let last = self.nodes.len() - 1;
        let (first, end) = (self.nodes[0], self.nodes[last]);
        if x >= first && x <= end {
            return self.place(x);
        }
        let x = if x < first { x + TAU } else { x };
        let gap = (first + TAU - end).max(f32::MIN_POSITIVE);
        (last, 0, ((x - end) / gap).clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies that the fast path agrees with a search. Interpolation of the axis values at `x` must give
    /// `x`.
    #[test]
    fn positions_reproduce_values() {
        let even = Axis::new(even_axis(1, 91));
        let uneven = Axis::new((0..40).map(|i| FRAC_PI_2 * (i as f32 / 39.0).powi(2)).collect());
        assert!(even.rate.is_some() && uneven.rate.is_none());
        for axis in [even, uneven] {
            for k in 0..=10_000 {
                let x = FRAC_PI_2 * k as f32 / 10_000.0;
                let (i, j, t) = axis.place(x);
                let back = axis.nodes[i] * (1.0 - t) + axis.nodes[j] * t;
                assert!((back - x).abs() < 1e-6 && (0.0..=1.0).contains(&t), "{x}: {back}");
            }
            assert_eq!(axis.place(-0.5).2, 0.0);
            let (_, j, t) = axis.place(2.0);
            assert!(j == axis.nodes.len() - 1 && t == 1.0);
        }
    }

    /// Verifies that a periodic axis without an entry at +π is interpolated between the last and the first
    /// entry.
    #[test]
    fn periodic_axes_wrap_around() {
        let axis = Axis::new((0..8).map(|i| -PI + PI / 8.0 + TAU / 8.0 * i as f32).collect());
        let (i, j, t) = axis.place_around(PI);
        assert!((i, j) == (7, 0) && (t - 0.5).abs() < 1e-5);
        let (i, j, t) = axis.place_around(-PI);
        assert!((i, j) == (7, 0) && (t - 0.5).abs() < 1e-5);
        let closed = Axis::new(even_axis(0, 9));
        assert_eq!(closed.place_around(-PI).0, 0);
        let (_, j, t) = closed.place_around(PI);
        assert!(j == 8 && t == 1.0);
    }
}

//! Smoothed variances. A smoothed variance is the mean of the variances of a pixel and its neighbours.
//!
//! A standard error that is estimated from 16 samples has a relative uncertainty of at least a fifth. If rare
//! strong paths were missed, this standard error is far too small. The neighbours are likely to include such
//! paths.

use super::Values;
use super::around::around;

/// Returns the variances of all values. Pixels that are not `known` have the variance zero.
pub(super) fn variances(values: &Values, known: &[bool]) -> Vec<f32> {
    let own = squares(values, known);
    let mut near = around(&own, values.size, values.channels, 1, known);
    for ((near, own), p) in near.iter_mut().zip(&own).zip(0..) {
        let known: bool = known[p / values.channels];
        *near = if known { 0.5 * (*near + own) } else { 0.0 };
    }
    near
}

/// Returns the squares of the stated standard errors. Pixels that are not `known` have the square zero.
pub(super) fn squares(values: &Values, known: &[bool]) -> Vec<f32> {
    let square = |(i, e): (usize, &f32)| {
        if known[i / values.channels] { e * e } else { 0.0 }
    };
    values.error.iter().enumerate().map(square).collect()
}

//! Variances of pixels: the mean of their own and of those around them.
//!
//! A standard error of sixteen samples is itself known to a fifth at best, and is far too small where rare strong paths were
//! missed; that of the neighbours has met them more often.

use super::Values;
use super::around::around;

/// Variances of all numbers; zero in pixels that are not `known`.
#[must_use]
pub(super) fn variances(values: &Values, known: &[bool]) -> Vec<f32> {
    let own = squares(values, known);
    let mut near = around(&own, values.size, values.channels, 1, known);
    for ((near, own), p) in near.iter_mut().zip(&own).zip(0..) {
        let known: bool = known[p / values.channels];
        *near = if known { 0.5 * (*near + own) } else { 0.0 };
    }
    near
}

/// Squares of the stated errors.
#[must_use]
pub(super) fn squares(values: &Values, known: &[bool]) -> Vec<f32> {
    let square = |(i, e): (usize, &f32)| {
        if known[i / values.channels] { e * e } else { 0.0 }
    };
    values.error.iter().enumerate().map(square).collect()
}

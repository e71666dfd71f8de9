//! Angles between directions: how far off normals are.

use crate::map::Map;

/// Statistics of angular errors, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AngularErrors {
    /// Their mean.
    pub mean_deg: f64,
    /// Their median.
    pub median_deg: f64,
    /// Their root mean square.
    pub rms_deg: f64,
    /// Share of pixels within 5°.
    pub within_5_deg: f64,
    /// Pixels of which both directions are known.
    pub pixels: usize,
}

/// Errors of the directions of one map against those of another (three channels each, of any length above 0), over the pixels
/// of `mask` in which both are known; `None` if there is none, or sizes differ.
#[must_use]
pub fn angular_errors(found: &Map, truth: &Map, mask: &[bool]) -> Option<AngularErrors> {
    if found.channels != 3 || truth.channels != 3 || found.data.len() != truth.data.len() {
        return None;
    }
    let pairs = found
        .data
        .chunks_exact(3)
        .zip(truth.data.chunks_exact(3))
        .zip(mask);
    let mut all: Vec<f64> = pairs
        .filter(|(_, m)| **m)
        .map(|((a, b), _)| angle_deg(a, b))
        .filter(|v| v.is_finite())
        .collect();
    all.sort_by(f64::total_cmp);
    let n = all.len() as f64;
    let middle = |k: usize| all.get(k).copied();
    let median = 0.5 * (middle(all.len().checked_sub(1)? / 2)? + middle(all.len() / 2)?);
    Some(AngularErrors {
        mean_deg: all.iter().sum::<f64>() / n,
        median_deg: median,
        rms_deg: (all.iter().map(|v| v * v).sum::<f64>() / n).sqrt(),
        within_5_deg: all.iter().filter(|v| **v <= 5.0).count() as f64 / n,
        pixels: all.len(),
    })
}

/// Angle between two directions, degrees, as atan2(|a × b|, a · b): exact near 0 and 180° too. NaN of nothing.
#[must_use]
pub fn angle_deg(a: &[f64], b: &[f64]) -> f64 {
    let cross = |i: usize, j: usize| a[i] * b[j] - a[j] * b[i];
    let sine = (cross(1, 2).powi(2) + cross(2, 0).powi(2) + cross(0, 1).powi(2)).sqrt();
    let cosine: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    if sine == 0.0 && cosine == 0.0 {
        return f64::NAN;
    }
    sine.atan2(cosine).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_turns_are_found() {
        let turned = [0.0, 1e-7, 1.0, 4.0, 90.0, 179.999];
        let truth = Map::from_fn(6, 1, 3, |_, _, out| out.copy_from_slice(&[0.0, 0.0, 2.0]));
        let found = Map::from_fn(6, 1, 3, |x, _, out| {
            let t = f64::to_radians(turned[x]);
            out.copy_from_slice(&[t.sin(), 0.0, t.cos()]);
        });
        for (x, t) in turned.iter().enumerate() {
            approx::assert_relative_eq!(
                angle_deg(found.at(x, 0), truth.at(x, 0)),
                t,
                epsilon = 1e-12,
                max_relative = 1e-9
            );
        }
        let e = angular_errors(&found, &truth, &[true, false, true, true, true, false]).expect("four");
        assert_eq!(e.pixels, 4);
        approx::assert_relative_eq!(e.mean_deg, 95.0 / 4.0, epsilon = 1e-9);
        approx::assert_relative_eq!(e.median_deg, 2.5, epsilon = 1e-9);
        assert_eq!(e.within_5_deg, 0.75);
        assert_eq!(angular_errors(&found, &truth, &[false; 6]), None);
    }

    #[test]
    fn unknown_directions_do_not_count() {
        let truth = Map::from_fn(2, 1, 3, |_, _, out| out.copy_from_slice(&[0.0, 0.0, 1.0]));
        let found = Map::from_fn(2, 1, 3, |x, _, out| out.fill(if x == 0 { f64::NAN } else { 1.0 }));
        assert_eq!(angular_errors(&found, &truth, &[true; 2]).expect("one").pixels, 1);
    }
}

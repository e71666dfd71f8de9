//! Computes the errors of a shape over the pixels of an object. The errors are angles between normals, and
//! differences of depth.

use crate::map::Map;
use crate::metrics::angle::angle_deg;

/// Errors over the pixels with a known truth and a known estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Mean of the absolute errors, in degrees for normals and in metres for depths. The mean is NaN if there
    /// are no pixels.
    pub mean: f64,
    /// Median of the absolute errors. For an even number of errors, the lower of the two middle values.
    pub median: f64,
    /// Fraction of pixels that have an estimate, among the pixels with a known truth.
    pub coverage: f64,
}

/// Summarizes the errors of the pixels with a known truth. Pixels without an estimate have the error NaN.
fn summary(errors: impl Iterator<Item = f64>) -> Errors {
    let all: Vec<f64> = errors.collect();
    let mut known: Vec<f64> = all.iter().copied().filter(|e| e.is_finite()).collect();
    known.sort_by(f64::total_cmp);
    let n = known.len();
    Errors {
        mean: known.iter().sum::<f64>() / n as f64,
        median: known.get(n.saturating_sub(1) / 2).copied().unwrap_or(f64::NAN),
        coverage: n as f64 / all.len() as f64,
    }
}

/// Returns whether a pixel is in the mask, which has one channel and is nonzero inside. Without a mask,
/// returns true.
fn inside(mask: Option<&Map>, pixel: usize) -> bool {
    mask.is_none_or(|m| m.data.get(pixel).is_some_and(|v| *v != 0.0))
}

/// Returns the errors of normals, as angles to the true normals in degrees, over the pixels of `mask` that
/// have a true normal. Without a mask, all pixels are used.
pub fn angular(normals: &Map, truth: &Map, mask: Option<&Map>) -> Errors {
    let pairs = normals.data.chunks_exact(3).zip(truth.data.chunks_exact(3)).enumerate();
    let of = |(i, (n, t)): (usize, (&[f64], &[f64]))| {
        (t[0].is_finite() && inside(mask, i)).then(|| angle_deg(n, t))
    };
    summary(pairs.filter_map(of))
}

/// Returns the errors of depths, as absolute differences in metres, over the pixels of `mask` that have a
/// true depth. Without a mask, all pixels are used.
pub fn depth_errors(depth: &Map, truth: &Map, mask: Option<&Map>) -> Errors {
    let pairs = depth.data.iter().zip(&truth.data).enumerate();
    let of = |(i, (z, t)): (usize, (&f64, &f64))| (t.is_finite() && inside(mask, i)).then(|| (z - t).abs());
    summary(pairs.filter_map(of))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_medians_and_coverage() {
        let nan = f64::NAN;
        let map = |data: &[f64]| Map { width: data.len(), height: 1, channels: 1, data: data.to_vec() };
        let (got, truth) = (map(&[1.0, 2.5, nan, 4.0, 9.0]), map(&[1.0, 2.0, 3.0, 3.0, nan]));
        let e = depth_errors(&got, &truth, None);
        assert_eq!((e.mean, e.median, e.coverage), (0.5, 0.5, 0.75));
        let e = depth_errors(&got, &truth, Some(&map(&[0.0, 0.0, 1.0, 1.0, 1.0])));
        assert_eq!((e.mean, e.median, e.coverage), (1.0, 1.0, 0.5));
        assert!(depth_errors(&map(&[nan]), &map(&[1.0]), None).median.is_nan());
    }

    #[test]
    fn angles_are_degrees() {
        let of = |n: [f64; 3]| Map::from_fn(1, 1, 3, |_, _, o| o.copy_from_slice(&n));
        let e = angular(&of([0.0, 0.6, -0.8]), &of([0.0, 0.0, -1.0]), None);
        assert!((e.mean - 0.6_f64.asin().to_degrees()).abs() < 1e-12);
        let e = angular(&of([0.0, 0.0, 1.0]), &of([0.0, 0.0, -1.0]), None);
        assert!((e.median - 180.0).abs() < 1e-12 && e.coverage == 1.0);
    }
}

//! Computes the metrics of a scoring on a variant. The renderer's labels are the ground truth.

use super::score::Scored;
use super::seen::Target;
use crate::metrics::roc;

/// Minimum number of positives and minimum number of negatives in a bin. For smaller numbers, no area is
/// computed.
const FEW: usize = 5;

/// Returns the area under the ROC curve over all lit pixels and bins.
pub(super) fn area(scored: &Scored, target: Target) -> f64 {
    let [positive, negative] = scored.groups(target, |_| true);
    roc::area(&positive, &negative)
}

/// Returns the mean over bins of the area under the ROC curve within a bin. Returns NaN if no bin has enough
/// positives and negatives.
pub(super) fn area_by_bin(scored: &Scored, target: Target) -> f64 {
    let bins = scored.seen.pixels.bins;
    let areas: Vec<f64> = (0..bins)
        .map(|bin| scored.groups(target, |place| place % bins == bin))
        .filter(|[positive, negative]| positive.len() >= FEW && negative.len() >= FEW)
        .map(|[positive, negative]| roc::area(&positive, &negative))
        .collect();
    areas.iter().sum::<f64>() / areas.len() as f64
}

/// Returns F1 at the learned threshold, or NaN for a variant without light of the target.
pub(super) fn f1(scored: &Scored, target: Target) -> f64 {
    let counts = scored.counts(target);
    if counts.true_positive + counts.false_negative == 0 {
        return f64::NAN;
    }
    counts.f1()
}

/// Returns the correlation between the estimated light and the light of the target, over lit pixels and bins.
/// Images show the estimated light.
pub(super) fn correlation(scored: &Scored, target: Target) -> f64 {
    let seen = scored.seen;
    let pairs = seen.lit.iter().map(|place| (scored.light(target, *place), seen.light(target, *place)));
    pearson(&pairs.collect::<Vec<_>>())
}

/// Returns the correlation as in [`correlation`] for the sums over the bins of each pixel.
pub(super) fn correlation_in_total(scored: &Scored, target: Target) -> f64 {
    let seen = scored.seen;
    let mut sums = vec![(0.0, 0.0); seen.pixels.count()];
    let mut lit = vec![false; sums.len()];
    for place in &seen.lit {
        let pixel = place / seen.pixels.bins;
        lit[pixel] = true;
        sums[pixel].0 += scored.light(target, *place);
        sums[pixel].1 += seen.light(target, *place);
    }
    let pairs: Vec<(f64, f64)> = sums.into_iter().zip(lit).filter_map(|(s, l)| l.then_some(s)).collect();
    pearson(&pairs)
}

/// Returns Pearson's correlation. The result is 0 for a constant score and NaN for a constant truth.
fn pearson(pairs: &[(f64, f64)]) -> f64 {
    let n = pairs.len() as f64;
    let (a, b) = pairs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for (x, y) in pairs {
        let (x, y) = (x - a, y - b);
        (xx, yy, xy) = (xx + x * x, yy + y * y, xy + x * y);
    }
    if yy == 0.0 || n == 0.0 {
        f64::NAN
    } else if xx == 0.0 {
        0.0
    } else {
        xy / (xx * yy).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::pearson;

    #[test]
    fn pearson_matches_known_correlations() {
        let of = |x: &[f64], y: &[f64]| {
            let pairs: Vec<(f64, f64)> = x.iter().copied().zip(y.iter().copied()).collect();
            pearson(&pairs)
        };
        assert!((of(&[1.0, 2.0, 3.0], &[2.0, 4.0, 6.0]) - 1.0).abs() < 1e-12);
        assert!((of(&[1.0, 2.0, 3.0], &[3.0, 2.0, 1.0]) + 1.0).abs() < 1e-12);
        // The value 1/√(2 · 14/3) is computed by hand.
        let want = 1.0 / (2.0_f64 * 14.0 / 3.0).sqrt();
        assert!((of(&[1.0, 2.0, 3.0], &[1.0, 4.0, 2.0]) - want).abs() < 1e-12);
        assert_eq!(of(&[2.0, 2.0], &[0.0, 1.0]), 0.0);
        assert!(of(&[0.0, 1.0], &[2.0, 2.0]).is_nan() && of(&[], &[]).is_nan());
    }
}

//! Scores of places (pairs of a pixel and a bin). Higher scores mean more light of the target.

use super::seen::{Seen, TARGETS, Target};
use crate::metrics::precision_recall::Counts;
use crate::metrics::roc::area;

/// The quantity from which a score is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Measure {
    /// T33 of the bin. The value is positive for preserved circular polarization.
    Circular,
    /// T33/T00 of the bin.
    CircularShare,
    /// T30 + T33. The illumination is right-handed, and the value is the detected right-handed minus
    /// left-handed light. The measure requires two captures.
    CircularPair,
    /// T10 + T11. The illumination is horizontally polarized, and the value is the detected parallel minus
    /// crossed polarization. The measure requires two captures.
    LinearPair,
    /// T00 of the bin.
    Intensity,
    /// T33 summed over all bins.
    Integrated,
}

impl Measure {
    fn of(self, seen: &Seen, place: usize) -> f64 {
        let e = |element| seen.element(place, element);
        match self {
            Self::Circular => e(15),
            Self::CircularShare => {
                let all = e(0);
                if all > 0.0 { e(15) / all } else { 0.0 }
            }
            Self::CircularPair => e(12) + e(15),
            Self::LinearPair => e(4) + e(5),
            Self::Intensity => e(0),
            Self::Integrated => seen.integrated(place, 15),
        }
    }

    /// Returns the sign that physics determines for a target, or `None` if the sign must be learned.
    fn sign(self, target: Target) -> Option<f64> {
        match self {
            Self::LinearPair | Self::Intensity => None,
            _ => Some(if target == Target::Keeping { 1.0 } else { -1.0 }),
        }
    }
}

/// A measure with the learned signs and thresholds for the two targets.
pub(super) struct Scoring {
    measure: Measure,
    sign: [f64; 2],
    threshold: [f64; 2],
}

/// Number of candidate thresholds.
const STEPS: usize = 200;

impl Scoring {
    /// Learns undetermined signs from training variants. Also learns the thresholds with the largest F1.
    pub(super) fn learn(measure: Measure, train: &[Seen]) -> Self {
        let mut out = Self { measure, sign: [1.0; 2], threshold: [f64::INFINITY; 2] };
        for (i, target) in TARGETS.into_iter().enumerate() {
            out.sign[i] = measure.sign(target).unwrap_or_else(|| {
                let [positive, negative] = out.groups(train, target, |_| true);
                if area(&positive, &negative) < 0.5 { -1.0 } else { 1.0 }
            });
            let [positive, negative] = out.groups(train, target, |_| true);
            out.threshold[i] = best_threshold(&positive, &negative);
        }
        out
    }

    pub(super) fn score(&self, seen: &Seen, target: Target, place: usize) -> f64 {
        self.sign[usize::from(target == Target::Keeping)] * self.measure.of(seen, place)
    }

    pub(super) fn threshold(&self, target: Target) -> f64 {
        self.threshold[usize::from(target == Target::Keeping)]
    }

    /// Returns the scores of lit places of the target and the scores of all other lit places. Only places
    /// that satisfy `counts` are included.
    pub(super) fn groups<'a>(
        &self,
        all: impl IntoIterator<Item = &'a Seen>,
        target: Target,
        counts: impl Fn(usize) -> bool,
    ) -> [Vec<f64>; 2] {
        let mut out = [vec![], vec![]];
        for seen in all {
            for place in seen.lit.iter().filter(|p| counts(**p)) {
                let other = usize::from(!seen.is(target, *place));
                out[other].push(self.score(seen, target, *place));
            }
        }
        out
    }
}

/// Returns the threshold with the largest F1. The candidates are scores at evenly spaced ranks of the
/// positives. The result is infinite without positives.
fn best_threshold(positive: &[f64], negative: &[f64]) -> f64 {
    let mut positive: Vec<f64> = positive.iter().copied().filter(|v| v.is_finite()).collect();
    let mut negative: Vec<f64> = negative.iter().copied().filter(|v| v.is_finite()).collect();
    positive.sort_by(f64::total_cmp);
    negative.sort_by(f64::total_cmp);
    let above = |list: &[f64], t: f64| (list.len() - list.partition_point(|v| *v < t)) as f64;
    let mut best = (0.0, f64::INFINITY);
    for i in 0..STEPS.min(positive.len()) {
        let t = positive[i * positive.len() / STEPS.min(positive.len())];
        let (hits, alarms) = (above(&positive, t), above(&negative, t));
        let f1 = 2.0 * hits / (hits + alarms + positive.len() as f64);
        if f1 > best.0 {
            best = (f1, t);
        }
    }
    best.1
}

/// Counts true and false decisions of a scoring for the lit places of a variant.
pub(super) fn counts(scoring: &Scoring, seen: &Seen, target: Target) -> Counts {
    let threshold = scoring.threshold(target);
    Counts::of(seen.lit.iter().map(|place| {
        let decided = scoring.score(seen, target, *place) >= threshold;
        (decided, seen.is(target, *place))
    }))
}

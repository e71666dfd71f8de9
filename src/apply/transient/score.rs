//! Scores of places (pairs of a pixel and a bin). Higher scores mean more light of the target.

use super::linear::{Features, Fit};
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
    /// A linear combination of features.
    Linear(Features),
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
            Self::Linear(_) => unreachable!("a linear measure has an estimate for each place"),
        }
    }

    /// Returns the sign that physics determines for a target, or `None` if the sign must be learned.
    fn sign(self, target: Target) -> Option<f64> {
        match self {
            Self::LinearPair | Self::Intensity => None,
            Self::Linear(_) => Some(1.0),
            _ => Some(if target == Target::Keeping { 1.0 } else { -1.0 }),
        }
    }
}

/// A measure with what was learned for the two targets.
pub(super) struct Scoring {
    measure: Measure,
    /// The estimates of a linear measure.
    fit: Option<Fit>,
    sign: [f64; 2],
    threshold: [f64; 2],
}

/// Number of candidate thresholds.
const STEPS: usize = 200;

impl Scoring {
    /// Learns linear estimates and undetermined signs from training variants. Also learns the thresholds with the
    /// largest F1.
    pub(super) fn learn(measure: Measure, train: &[Seen]) -> Self {
        let fit = match measure {
            Measure::Linear(features) => Some(Fit::learn(features, train)),
            _ => None,
        };
        let sign = TARGETS.map(|target| measure.sign(target).unwrap_or(1.0));
        let mut out = Self { measure, fit, sign, threshold: [f64::INFINITY; 2] };
        let scored: Vec<Scored> = train.iter().map(|seen| out.of(seen)).collect();
        for (i, target) in TARGETS.into_iter().enumerate() {
            let [mut positive, mut negative] = [vec![], vec![]];
            for [p, n] in scored.iter().map(|s| s.groups(target, |_| true)) {
                positive.extend(p);
                negative.extend(n);
            }
            if measure.sign(target).is_none() && area(&positive, &negative) < 0.5 {
                out.sign[i] = -1.0;
                positive.iter_mut().chain(&mut negative).for_each(|v| *v = -*v);
            }
            out.threshold[i] = best_threshold(&positive, &negative);
        }
        out
    }

    /// Returns the scores of a variant.
    pub(super) fn of<'a>(&self, seen: &'a Seen) -> Scored<'a> {
        let of_measure = || {
            self.sign.map(|sign| {
                let places = 0..seen.pixels.count() * seen.pixels.bins;
                let scores: Vec<f64> = places.map(|place| sign * self.measure.of(seen, place)).collect();
                [scores.clone(), scores]
            })
        };
        let values = self.fit.as_ref().map_or_else(of_measure, |fit| fit.values(seen));
        Scored { seen, values, threshold: self.threshold }
    }
}

/// The scores of a variant.
pub(super) struct Scored<'a> {
    pub seen: &'a Seen,
    /// For each target, the score of every place and the estimated light of the target, in arbitrary units. For single
    /// elements, both are equal.
    values: [[Vec<f64>; 2]; 2],
    threshold: [f64; 2],
}

fn index(target: Target) -> usize {
    usize::from(target == Target::Keeping)
}

impl Scored<'_> {
    fn score(&self, target: Target, place: usize) -> f64 {
        self.values[index(target)][0][place]
    }

    /// Returns the estimated light of a target at a place, which is not negative.
    pub(super) fn light(&self, target: Target, place: usize) -> f64 {
        self.values[index(target)][1][place].max(0.0)
    }

    /// Returns the scores of lit places of the target and the scores of all other lit places. Only places
    /// that satisfy `counts` are included.
    pub(super) fn groups(&self, target: Target, counts: impl Fn(usize) -> bool) -> [Vec<f64>; 2] {
        let mut out = [vec![], vec![]];
        for place in self.seen.lit.iter().filter(|p| counts(**p)) {
            let other = usize::from(!self.seen.is(target, *place));
            out[other].push(self.score(target, *place));
        }
        out
    }

    /// Counts true and false decisions for the lit places.
    pub(super) fn counts(&self, target: Target) -> Counts {
        let threshold = self.threshold[index(target)];
        Counts::of(self.seen.lit.iter().map(|place| {
            let decided = self.score(target, *place) >= threshold;
            (decided, self.seen.is(target, *place))
        }))
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

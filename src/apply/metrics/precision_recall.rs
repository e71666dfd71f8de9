//! Precision and recall of binary decisions per pixel.

/// Numbers of correct and wrong decisions, by comparison with the ground truth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    pub true_positive: u64,
    pub false_positive: u64,
    pub false_negative: u64,
}

impl Counts {
    /// Counts the pairs (decision, truth) of each kind.
    pub fn of(pairs: impl IntoIterator<Item = (bool, bool)>) -> Self {
        let mut c = Self::default();
        for (decided, is) in pairs {
            match (decided, is) {
                (true, true) => c.true_positive += 1,
                (true, false) => c.false_positive += 1,
                (false, true) => c.false_negative += 1,
                (false, false) => {}
            }
        }
        c
    }

    /// Returns the fraction of positive decisions that are correct, or NaN without positive decisions.
    pub fn precision(&self) -> f64 {
        self.true_positive as f64 / (self.true_positive + self.false_positive) as f64
    }

    /// Returns the fraction of positives that receive a positive decision, or NaN without positives.
    pub fn recall(&self) -> f64 {
        self.true_positive as f64 / (self.true_positive + self.false_negative) as f64
    }

    /// Returns the harmonic mean of precision and recall (van Rijsbergen 1979): 2 TP / (2 TP + FP + FN).
    pub fn f1(&self) -> f64 {
        let right = 2 * self.true_positive;
        right as f64 / (right + self.false_positive + self.false_negative) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn precision_and_recall_of_a_known_table() {
        let pairs = [(true, 30, 10), (false, 20, 40)];
        let all = pairs.iter().flat_map(|&(decided, is, not)| {
            std::iter::repeat_n((decided, true), is).chain(std::iter::repeat_n((decided, false), not))
        });
        let c = Counts::of(all);
        assert_eq!((c.precision(), c.recall()), (0.75, 0.6));
        approx::assert_relative_eq!(c.f1(), 2.0 * 0.75 * 0.6 / 1.35, epsilon = 1e-12);
        assert!(Counts::of([]).precision().is_nan());
    }
}

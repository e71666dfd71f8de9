//! Variance of a pixel's total. The total is M00, summed over all entries of the slice for this pixel
//! (including light outside the time window) and averaged over wavelengths.
//!
//! All elements of a pixel use the same samples and are correlated. The error of the sum of these elements
//! therefore does not follow from the errors of the elements.

use optics::spectrum::Spectral;

/// Number of valid samples of a pixel (including samples without light), and number of independent groups.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counted {
    pub samples: u32,
    /// Number of groups. The number equals `samples` unless samples are stratified.
    pub groups: u32,
}

/// Sum of the totals of one pixel's sample groups, and sum of the squares of these totals.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TotalSums {
    pending: Spectral,
    /// Group of samples whose total has not been added to the sums yet.
    group: u32,
    sum: f64,
    square: f64,
}

impl TotalSums {
    /// Adds the total of one sample, per wavelength. All samples of a group must be added consecutively.
    #[inline(always)]
    pub fn add(&mut self, group: u32, total: Spectral) {
        if group != self.group {
            self.fold();
            self.group = group;
        }
        self.pending += total;
    }

    #[inline]
    fn fold(&mut self) {
        let total = f64::from(self.pending.reduce_add());
        self.sum += total;
        self.square += total * total;
        self.pending = Spectral::ZERO;
    }

    /// Returns the variance of the mean over samples and wavelengths (NaN for one group) and resets the sums.
    pub fn finish(&mut self, n: Counted, wavelengths: usize) -> f64 {
        self.fold();
        let Self { sum, square, .. } = std::mem::take(self);
        let groups = f64::from(n.groups);
        let spread = (square - sum * sum / groups).max(0.0);
        let samples = f64::from(n.samples) * wavelengths as f64;
        // Divide by samples², because the sums of the groups add up to the sum of the samples.
        spread * groups / (groups - 1.0) / (samples * samples)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies the variance for four groups of two samples at two wavelengths, where one group has no light.
    /// The variance of the mean of 0, 1, 2, 5 is 4.667/4.
    #[test]
    fn the_variance_is_computed_over_groups() {
        let mut sums = TotalSums::default();
        for (group, total) in [(1, 1.0), (2, 2.0), (3, 5.0)] {
            for share in [1.5, 0.5] {
                let value = total * share;
                sums.add(group, Spectral::new([0.5 * value, 1.5 * value, 0.0, 0.0]));
            }
        }
        let counted = |samples, groups| Counted { samples, groups };
        let variance = sums.finish(counted(8, 4), 2);
        assert!((variance - 14.0 / 12.0).abs() < 1e-12, "{variance}");
        assert_eq!(sums.finish(counted(8, 4), 2), 0.0);
        sums.add(0, Spectral::splat(1.0));
        assert!(sums.finish(counted(8, 1), 2).is_nan());
    }
}

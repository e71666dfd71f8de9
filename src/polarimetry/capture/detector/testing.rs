//! Computes sample moments and compares them with closed forms, with a tolerance of five standard errors.

/// Count, mean and unbiased variance of a sample.
pub struct Moments {
    pub n: f64,
    pub mean: f64,
    pub variance: f64,
}

impl Moments {
    pub fn of(values: impl Iterator<Item = f64>) -> Self {
        let (mut n, mut mean, mut squares) = (0.0, 0.0, 0.0);
        for v in values {
            // The algorithm of Welford (1962) avoids cancellation if the mean is far from zero.
            n += 1.0;
            let step = v - mean;
            mean += step / n;
            squares += step * (v - mean);
        }
        let variance = squares / (n - 1.0);
        Self { n, mean, variance }
    }

    /// Checks that the mean is `want` within 5·√(variance/n). `variance` is the true variance of a single
    /// value.
    pub fn assert_mean(&self, want: f64, variance: f64) {
        let off = (self.mean - want) / (variance / self.n).sqrt();
        assert!(off.abs() < 5.0, "the mean is {}, {off} standard errors from {want}", self.mean);
    }

    /// Checks that the variance is `want` within five standard errors. The squared standard error is Var
    /// s² ≈ (2σ⁴ + κ₄)/n, where κ₄ (`fourth`) is the fourth cumulant.
    pub fn assert_variance(&self, want: f64, fourth: f64) {
        let off = (self.variance - want) / ((2.0 * want * want + fourth) / self.n).sqrt();
        assert!(off.abs() < 5.0, "the variance is {}, {off} standard errors from {want}", self.variance);
    }
}

/// Checks that the moments are those of a Poisson distribution, all of whose cumulants equal `mean`.
pub fn poisson_moments(seen: &Moments, mean: f64) {
    seen.assert_mean(mean, mean);
    seen.assert_variance(mean, mean);
}

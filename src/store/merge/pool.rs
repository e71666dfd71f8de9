//! Pools the samples of one element with the equations of [`crate::merge`].

/// The pooled samples of one element.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pool {
    pub n: f64,
    pub mean: f64,
    /// Spread of the samples. For identically distributed samples, the spread is the sum of squared
    /// deviations from the mean. Otherwise, the spread is Σ N²e².
    spread: f64,
    /// Standard error in the store, for an element that has samples in only one input.
    only: Option<f64>,
}

impl Pool {
    pub fn add(&mut self, n: f64, mean: f64, std_error: f64, equal: bool) {
        if n <= 0.0 {
            return;
        }
        self.only = (self.n == 0.0).then_some(std_error);
        let total = self.n + n;
        let difference = mean - self.mean;
        if equal {
            self.spread +=
                std_error * std_error * n * (n - 1.0) + difference * difference * self.n * n / total;
        } else {
            self.spread += (n * std_error).powi(2);
        }
        self.mean += difference * n / total;
        self.n = total;
    }

    pub fn std_error(&self, equal: bool) -> f64 {
        match self.only {
            Some(only) => only,
            None if self.n == 0.0 => 0.0,
            None if equal => (self.spread / (self.n * (self.n - 1.0))).sqrt(),
            None => self.spread.sqrt() / self.n,
        }
    }
}

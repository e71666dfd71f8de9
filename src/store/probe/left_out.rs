//! Light that the result of a probe does not include.

use super::run::ProbeResult;
use tensor::array::Tensor;

/// Sums of the light that arrived outside the stored time bins, and of the light that the pulse shifted out of
/// them.
#[derive(Clone, Copy, Debug, Default)]
pub struct LeftOut([f64; 2]);

impl LeftOut {
    /// Returns the light that a result does not include.
    pub fn of(result: &ProbeResult) -> Self {
        let all = |tensor: &Option<Tensor>| tensor.iter().flat_map(|t| &t.data).map(|v| f64::from(*v)).sum();
        Self([&result.overflow, &result.shifted_out].map(all))
    }

    /// Adds the light that the result for other camera pixels does not include.
    pub fn add(&mut self, other: Self) {
        for (sum, more) in self.0.iter_mut().zip(other.0) {
            *sum += more;
        }
    }

    /// Returns one sentence for each kind of light.
    pub fn notes(self) -> impl Iterator<Item = String> {
        let what =
            ["arrived outside the stored time bins", "was shifted out of the stored time bins by the pulse"];
        what.into_iter().zip(self.0).filter(|(_, sum)| *sum != 0.0).map(|(what, sum)| {
            format!("the result does not include the light that {what}; the sum of this light is {sum:.6e}")
        })
    }
}

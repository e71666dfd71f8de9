//! Answers probes: the numbers of the command `sunstone probe`.

use crate::answer::Answer;
use crate::describe::axes;
use crate::error::ViewError;
use crate::request::ProbeRequest;
use serde_json::json;
use std::sync::Arc;
use store::probe::ProbeResult;
use store::zarr::StoredSlice;
use tensor::array::Tensor;

/// Maximum number of values of an answer. The page shows small results of probes, and larger ones as images.
const MOST: usize = 1 << 24;

/// Runs the probe of a request.
pub(crate) fn probe(slice: &StoredSlice, request: &ProbeRequest) -> Result<Answer, ViewError> {
    let result = request.probe()?.run(slice)?;
    let found = result.mean.data.len();
    if found > MOST {
        return Err(ViewError::Request(format!(
            "the result has {found} values, at most {MOST} are sent; select fewer entries, or sum over an axis"
        )));
    }
    let notes: Vec<String> = result.notes.iter().cloned().chain(LeftOut::of(&result).notes()).collect();
    let header = json!({
        "axes": axes(&result.mean.axes), "notes": notes, "fields": ["mean", "std_error"],
    });
    Ok(Answer::Arrays(header, vec![Arc::new(result.mean.data), Arc::new(result.std_error.data)]))
}

/// Light that a result does not include: light outside the stored time bins, and light that the pulse shifted
/// out of them.
#[derive(Clone, Copy, Default)]
pub(crate) struct LeftOut([f64; 2]);

impl LeftOut {
    pub(crate) fn of(result: &ProbeResult) -> Self {
        let all = |tensor: &Option<Tensor>| tensor.iter().flat_map(|t| &t.data).map(|v| f64::from(*v)).sum();
        Self([&result.overflow, &result.shifted_out].map(all))
    }

    pub(crate) fn add(&mut self, other: Self) {
        for (sum, more) in self.0.iter_mut().zip(other.0) {
            *sum += more;
        }
    }

    /// Returns one sentence for each kind of light.
    pub(crate) fn notes(self) -> impl Iterator<Item = String> {
        let what =
            ["arrived outside the stored time bins", "was shifted out of the stored time bins by the pulse"];
        what.into_iter().zip(self.0).filter(|(_, sum)| *sum != 0.0).map(|(what, sum)| {
            format!("the result does not include the light that {what}; the sum of this light is {sum:.6e}")
        })
    }
}

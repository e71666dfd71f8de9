//! From a question to its answer: a plan for every field, carried out.

use super::error::ProbeError;
use super::request::Probe;
use super::result::ProbeResult;
use super::{engine, plan};
use crate::zarr::StoredSlice;
use tensor::field::Field;

impl Probe {
    /// Probes a slice.
    ///
    /// # Errors
    /// If the probe does not fit the slice, the result does not fit in memory, or a chunk is damaged.
    pub fn run(&self, slice: &StoredSlice) -> Result<ProbeResult, ProbeError> {
        let plan = plan::Plan::new(self, slice, Field::Mean)?;
        let (mean, std_error, shifted_out) = engine::run(&plan, slice, Field::Mean, Field::StdError)?;
        let overflow = if slice.has(Field::Overflow) {
            let plan = plan::Plan::new(&self.without_time(), slice, Field::Overflow)?;
            Some(engine::run(&plan, slice, Field::Overflow, Field::OverflowStdError)?.0)
        } else {
            None
        };
        Ok(ProbeResult {
            mean,
            std_error,
            overflow,
            shifted_out,
            time: plan.time,
            notes: plan.notes,
        })
    }
}

//! From a question to its answer: a plan for every field, carried out.

use super::error::ProbeError;
use super::request::Probe;
use super::result::ProbeResult;
use super::{engine, plan};
use crate::doubt;
use crate::zarr::StoredSlice;
use tensor::axes::AxisKind;
use tensor::field::Field;

impl Probe {
    /// Probes a slice.
    ///
    /// # Errors
    /// If the probe does not fit the slice, the result does not fit in memory, or a chunk is damaged.
    pub fn run(&self, slice: &StoredSlice) -> Result<ProbeResult, ProbeError> {
        let mut plan = plan::Plan::new(self, slice, Field::Mean)?;
        plan.notes.extend(in_doubt(&plan, slice)?);
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

/// What the person should know of the error bars of the camera pixels that are read.
fn in_doubt(plan: &plan::Plan, slice: &StoredSlice) -> Result<Option<String>, ProbeError> {
    let read = |kind| {
        let axis = plan.axes.iter().find(|a| a.kind == kind)?;
        Some(axis.first..axis.end)
    };
    let pixels = read(AxisKind::Y).zip(read(AxisKind::X)).map(|(y, x)| [y, x]);
    let doubt = doubt::within(slice, pixels)?.filter(|d| d.doubtful > 0);
    Ok(doubt.map(|d| {
        format!(
            "errors of {} of {} lit pixels of `{}` cannot be trusted yet: neighbours have met light that these have not",
            d.doubtful,
            d.lit,
            slice.name()
        )
    }))
}

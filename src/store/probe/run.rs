//! Runs a probe: plans the probe and executes the plan for every field.

use super::error::ProbeError;
use super::request::Probe;
use super::{engine, plan};
use crate::doubt;
use crate::zarr::StoredSlice;
use std::ops::Range;
use tensor::array::Tensor;
use tensor::axes::AxisKind;
use tensor::field::Field;

#[derive(Clone, Debug, PartialEq)]
pub struct ProbeResult {
    /// Values in W/(m² sr nm) per unit projector drive. The tensor has the axes that the probe keeps.
    pub mean: Tensor,
    /// Standard errors of `mean` (see the module documentation), with the same shape and unit.
    pub std_error: Tensor,
    /// Result of the same probe for light outside the stored time bins, without a time axis. The value is
    /// `None` if the slice does not resolve time.
    pub overflow: Option<Tensor>,
    /// Light that the pulse shifted out of the stored time bins, without a time axis. The value is `None` if
    /// there is no pulse.
    pub shifted_out: Option<Tensor>,
    /// First edge and bin width of the time axis in picoseconds, if there is one.
    pub time: Option<(f64, f64)>,
    /// Notes for the user, for example that the pattern drives projector pixels that the slice does not keep.
    pub notes: Vec<String>,
}

impl Probe {
    /// Probes a slice.
    ///
    /// # Errors
    /// Returns an error if the slice lacks an axis of the probe, the result does not fit into memory, or a
    /// chunk is damaged.
    pub fn run(&self, slice: &StoredSlice) -> Result<ProbeResult, ProbeError> {
        let mut plan = plan::Plan::new(self, slice, Field::Mean)?;
        let of_overflow = if slice.has(Field::Overflow) {
            Some(plan::Plan::new(&self.without_time(), slice, Field::Overflow)?)
        } else {
            None
        };
        fetch(&plan, of_overflow.as_ref(), slice)?;
        plan.notes.extend(doubt::note(slice, pixels(&plan))?);
        let (mean, std_error, shifted_out) = engine::run(&plan, slice, Field::Mean, Field::StdError)?;
        let overflow = match of_overflow {
            Some(plan) => Some(engine::run(&plan, slice, Field::Overflow, Field::OverflowStdError)?.0),
            None => None,
        };
        Ok(ProbeResult { mean, std_error, overflow, shifted_out, time: plan.time, notes: plan.notes })
    }
}

/// If the store is at a URL, concurrently fetches the regions of all fields that the probe reads, up to a
/// memory limit.
fn fetch(plan: &plan::Plan, of_overflow: Option<&plan::Plan>, slice: &StoredSlice) -> Result<(), ProbeError> {
    let mut regions = vec![];
    let overflow = of_overflow.map(|plan| (plan, [Field::Overflow, Field::OverflowStdError]));
    for (plan, fields) in [Some((plan, [Field::Mean, Field::StdError])), overflow].into_iter().flatten() {
        let ranges = plan.axes.iter().map(|a| (a.first as u64, (a.end - a.first) as u64));
        let (start, shape): (Vec<u64>, Vec<u64>) = ranges.unzip();
        regions.extend(fields.map(|field| (field, start.clone(), shape.clone())));
    }
    if let Some([start, shape]) = doubt::around(slice, pixels(plan))? {
        regions.push((Field::TotalStdError, start, shape));
    }
    Ok(slice.fetch_together(&regions)?)
}

/// Returns the ranges of camera rows and columns that the plan reads, or `None` for a slice without camera
/// axes.
fn pixels(plan: &plan::Plan) -> Option<[Range<usize>; 2]> {
    let read = |kind| {
        let axis = plan.axes.iter().find(|a| a.kind == kind)?;
        Some(axis.first..axis.end)
    };
    read(AxisKind::Y).zip(read(AxisKind::X)).map(|(y, x)| [y, x])
}

//! Answers probes: the numbers of the command `sunstone probe`.

use crate::answer::Answer;
use crate::describe::axes;
use crate::error::ViewError;
use crate::image::MOST;
use crate::request::ProbeRequest;
use serde_json::json;
use std::sync::Arc;
use store::probe::{CoordRange, LeftOut};
use store::zarr::StoredSlice;
use tensor::axes::{Axis, AxisKind};

/// Runs the probe of a request.
pub(crate) fn probe(slice: &StoredSlice, request: &ProbeRequest) -> Result<Answer, ViewError> {
    let probe = request.probe()?;
    // An upper bound: the entries nearest to the ends of a range may be outside of it.
    let kept = |axis: &Axis| match probe.select.iter().find(|s| s.axis == axis.kind).map(|s| s.range) {
        _ if probe.sum.contains(&axis.kind) => 1,
        Some(CoordRange::Nearest(_)) => 1,
        Some(CoordRange::Between(a, b)) => axis.coords.iter().filter(|c| (a..=b).contains(*c)).count() + 2,
        None if axis.kind == AxisKind::StokesIn && probe.stokes.is_some() => 1,
        None if matches!(axis.kind, AxisKind::V | AxisKind::U) && probe.pattern.is_some() => 1,
        None => axis.coords.len(),
    };
    let lengths = slice.layout().axes.iter().map(|axis| kept(axis).min(axis.coords.len()));
    let most = lengths.fold(1, usize::saturating_mul);
    if most > MOST {
        return Err(ViewError::Request(format!(
            "the result has {most} values, at most {MOST} are sent; select fewer entries, or sum over an axis"
        )));
    }
    let result = probe.run(slice)?;
    let notes: Vec<String> = result.notes.iter().cloned().chain(LeftOut::of(&result).notes()).collect();
    let header = json!({
        "axes": axes(&result.mean.axes), "notes": notes, "fields": ["mean", "std_error"],
    });
    Ok(Answer::Arrays(header, vec![Arc::new(result.mean.data), Arc::new(result.std_error.data)]))
}

//! Converts a probe of a slice to one weighted sum. The sum has targets and weights for every entry of every
//! axis.

use super::error::ProbeError;
use super::pattern;
use super::request::{CoordRange, Probe, Pulse, Selection};
use crate::zarr::StoredSlice;
use base::spectral_table::BEYOND_NM;
use tensor::axes::{Axis, AxisKind, SliceLayout};
use tensor::field::Field;

/// Maximum number of elements of a result.
const MAX_ELEMENTS: u128 = 1 << 30;
/// Maximum duration of half a pulse in time bins. A pulse has at most 2 × `MAX_KERNEL` + 1 samples.
const MAX_KERNEL: f64 = 1e6;

/// An entry's contribution to the result: the index of the target slot along an axis, and the entry's weight.
pub(super) type Share = (usize, f64);

pub(super) struct AxisPlan {
    pub(super) kind: AxisKind,
    /// Index of the first entry to read.
    pub(super) first: usize,
    /// Index of the last entry to read, plus 1.
    pub(super) end: usize,
    /// Targets and weights of each of the entries `first..end`.
    pub(super) targets: Vec<Vec<Share>>,
    /// Number of slots along this axis in the result, or 1 if the axis is removed. A convolved axis has an
    /// additional last slot for light that leaves the stored bins.
    pub(super) slots: usize,
}

/// The weighted sum that a probe computes.
pub(super) struct Plan {
    pub(super) axes: Vec<AxisPlan>,
    /// Weights of all entries (v, u), row-major, if a pattern contracts them.
    pub(super) joint: Option<Vec<f64>>,
    /// Axes that the result keeps.
    pub(super) kept: Vec<Axis>,
    /// Whether the axis t has an additional slot for light that leaves the stored bins.
    pub(super) convolved: bool,
    pub(super) time: Option<(f64, f64)>,
    pub(super) notes: Vec<String>,
}

/// The effect of contraction, convolution and selection on an axis.
enum Step {
    /// Keeps the entries `first..end`, and removes the axis if `drop` is true.
    Range { first: usize, end: usize, drop: bool },
    /// Contracts the axis with one weight per entry.
    Weights(Vec<f64>),
    /// Contracts the axis with weight 1 per entry, because `joint` contains the weights.
    Joint,
}

impl Plan {
    /// Plans a probe of one field of a slice.
    pub(super) fn new(probe: &Probe, slice: &StoredSlice, field: Field) -> Result<Self, ProbeError> {
        let layout = slice.field_layout(field)?;
        let mut plan =
            Self { axes: vec![], joint: None, kept: vec![], convolved: false, time: None, notes: vec![] };
        check_axes(probe, layout)?;
        plan.joint = joint_weights(probe, slice, layout, &mut plan.notes)?;
        let kernel = probe.pulse.as_ref().map(|p| kernel(p, layout)).transpose()?;
        for axis in &layout.axes {
            let summed = probe.sum.contains(&axis.kind);
            let step = match (axis.kind, &probe.stokes) {
                (AxisKind::StokesIn, Some(p)) => Step::Weights(p.map(f64::from).into()),
                (AxisKind::V | AxisKind::U, _) if plan.joint.is_some() => Step::Joint,
                _ => range(probe, axis)?,
            };
            let n = axis.coords.len();
            let axis_plan = match step {
                Step::Weights(weights) if weights.len() == n => {
                    reduced(axis.kind, 0, weights.into_iter().map(|w| vec![(0, w)]).collect())
                }
                Step::Weights(weights) => {
                    let reason = format!("the slice has {n} entries, but expected {} entries", weights.len());
                    return Err(ProbeError::Selection { axis: axis.kind.name(), reason });
                }
                Step::Joint => reduced(axis.kind, 0, vec![vec![(0, 1.0)]; n]),
                Step::Range { first, end, drop } => {
                    let keep = !(drop || summed);
                    if keep {
                        let coords = axis.coords[first..end].to_vec();
                        let chunk = axis.chunk.clamp(1, coords.len() as u64);
                        plan.kept.push(Axis { kind: axis.kind, coords, chunk });
                    }
                    if axis.kind == AxisKind::T && keep {
                        plan.time = layout.time.map(|(start, bin)| (start + first as f64 * bin, bin));
                    }
                    match &kernel {
                        Some(kernel) if axis.kind == AxisKind::T => {
                            plan.convolved = true;
                            convolved(kernel, n, first..end, keep)
                        }
                        _ if keep => AxisPlan {
                            kind: axis.kind,
                            first,
                            end,
                            targets: (0..end - first).map(|i| vec![(i, 1.0)]).collect(),
                            slots: end - first,
                        },
                        _ => reduced(axis.kind, first, vec![vec![(0, 1.0)]; end - first]),
                    }
                }
            };
            plan.axes.push(axis_plan);
        }
        let elements: u128 = plan.axes.iter().map(|a| a.slots as u128).product();
        if elements > MAX_ELEMENTS {
            return Err(ProbeError::TooLarge { elements });
        }
        Ok(plan)
    }
}

fn reduced(kind: AxisKind, first: usize, targets: Vec<Vec<Share>>) -> AxisPlan {
    AxisPlan { kind, first, end: first + targets.len(), targets, slots: 1 }
}

/// Returns the plan of the time axis that convolves the time bins with the kernel. Light that leaves the
/// stored bins is added to the last slot. Light in stored bins that are not selected is ignored.
fn convolved(kernel: &[(i64, f64)], bins: usize, range: std::ops::Range<usize>, keep: bool) -> AxisPlan {
    let slots = if keep { range.len() + 1 } else { 2 };
    let targets = (0..bins)
        .map(|i| {
            let mut row: Vec<Share> = Vec::new();
            let mut add = |slot: usize, w: f64| match row.iter_mut().find(|(s, _)| *s == slot) {
                Some((_, sum)) => *sum += w,
                None => row.push((slot, w)),
            };
            let mut outside = 0.0;
            for &(offset, w) in kernel {
                match usize::try_from(i as i64 + offset) {
                    Ok(j) if range.contains(&j) => add(if keep { j - range.start } else { 0 }, w),
                    Ok(j) if j < bins => {}
                    _ => outside += w,
                }
            }
            if outside != 0.0 {
                add(slots - 1, outside);
            }
            row
        })
        .collect();
    AxisPlan { kind: AxisKind::T, first: 0, end: bins, targets, slots }
}

/// Returns the pulse as pairs of delay (in time bins) and weight. The sum of the weights is 1.
fn kernel(pulse: &Pulse, layout: &SliceLayout) -> Result<Vec<(i64, f64)>, ProbeError> {
    let fault = |reason: &str| Err(ProbeError::Pulse { slice: layout.name.clone(), reason: reason.into() });
    let Some((_, bin_ps)) = layout.time.filter(|(_, bin)| *bin > 0.0) else {
        return fault("the slice is not time-resolved: render the slice with time bins");
    };
    let weights: Vec<(i64, f64)> = match pulse {
        Pulse::Gaussian { fwhm_ps } => {
            let fwhm_in_sigma = (8.0 * std::f64::consts::LN_2).sqrt();
            let sigma = fwhm_ps / fwhm_in_sigma / bin_ps;
            let reach = (6.0 * sigma).ceil();
            if !(0.0..=MAX_KERNEL).contains(&reach) {
                let widest = MAX_KERNEL / 6.0 * fwhm_in_sigma * bin_ps;
                return fault(&format!(
                    "the pulse has a width of {fwhm_ps} ps; expected 0 to {widest:.0} ps"
                ));
            }
            let gauss = |k: i64| {
                if k == 0 { 1.0 } else { (-0.5 * (k as f64 / sigma).powi(2)).exp() }
            };
            (-(reach as i64)..=reach as i64).map(|k| (k, gauss(k))).collect()
        }
        Pulse::Samples(samples) => samples.iter().enumerate().map(|(k, w)| (k as i64, *w)).collect(),
    };
    let sum: f64 = weights.iter().map(|(_, w)| w).sum();
    let most = 2.0 * MAX_KERNEL + 1.0;
    if weights.len() as f64 > most || !(sum.is_finite() && sum > 0.0) {
        let found = weights.len();
        return fault(&format!(
            "the pulse has {found} samples with the sum {sum}; expected at most {most} samples with a positive, finite sum"
        ));
    }
    Ok(weights.into_iter().map(|(k, w)| (k, w / sum)).filter(|(_, w)| *w != 0.0).collect())
}

fn check_axes(probe: &Probe, layout: &SliceLayout) -> Result<(), ProbeError> {
    for (i, Selection { axis, range }) in probe.select.iter().enumerate() {
        let fault = |reason: &str| ProbeError::Selection { axis: axis.name(), reason: reason.into() };
        if probe.select[..i].iter().any(|s| s.axis == *axis) {
            return Err(fault("the axis is selected twice: use one selection per axis"));
        }
        let by_pattern = matches!(axis, AxisKind::V | AxisKind::U) && probe.pattern.is_some();
        let by_stokes = *axis == AxisKind::StokesIn && probe.stokes.is_some();
        if by_pattern {
            return Err(fault("a pattern already contracts the axis: remove the selection or the pattern"));
        }
        if by_stokes {
            return Err(fault(
                "a Stokes state already contracts the axis: remove the selection or the Stokes state",
            ));
        }
        // Intensity slices contain M00 only, so selecting element 0 has no effect.
        let is_m00 = matches!(axis, AxisKind::StokesOut | AxisKind::StokesIn)
            && *range == CoordRange::Nearest(0.0)
            && layout.find(AxisKind::StokesIn).is_none();
        if layout.find(*axis).is_none() && !is_m00 {
            let available: Vec<&str> = layout.axes.iter().map(|a| a.kind.name()).collect();
            return Err(ProbeError::NoAxis {
                slice: layout.name.clone(),
                axis: axis.name(),
                available: available.join(", "),
            });
        }
    }
    let resolved = layout.find(AxisKind::StokesIn).is_some();
    if !resolved && probe.stokes.is_some_and(|p| p != [1.0, 0.0, 0.0, 0.0]) {
        return Err(ProbeError::Stokes { slice: layout.name.clone() });
    }
    Ok(())
}

/// Returns the selected entries of an axis.
fn range(probe: &Probe, axis: &Axis) -> Result<Step, ProbeError> {
    let n = axis.coords.len();
    let Some(selection) = probe.select.iter().find(|s| s.axis == axis.kind) else {
        return Ok(Step::Range { first: 0, end: n, drop: false });
    };
    let distance = |i: usize, value: f64| (axis.coords[i] - value).abs();
    // For a coordinate halfway between two entries, a range begins with the later entry, so ranges may be
    // given by bin edges.
    let nearest_from = |value: f64| {
        let i = axis.nearest(value);
        if i + 1 < n && distance(i + 1, value) <= distance(i, value) { i + 1 } else { i }
    };
    // A coordinate may be up to half a spacing beyond the axis, and a wavelength up to a few nanometres.
    let spacing = axis.coords.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
    let slack = if axis.kind == AxisKind::Wavelength {
        BEYOND_NM
    } else if n < 2 {
        f64::INFINITY
    } else {
        spacing / 2.0
    };
    let (low, high) = (axis.coords[0] - slack, axis.coords[n - 1] + slack);
    let outside = |from: f64, to: f64| {
        let reason = if from.is_nan() || to.is_nan() {
            "not a number".to_owned()
        } else {
            let (a, b) = (axis.coords[0], axis.coords[n - 1]);
            let units = Some(axis.kind.units()).filter(|units| *units != "1");
            let units = units.map_or(String::new(), |units| format!(" {units}"));
            let asked = if from == to { from.to_string() } else { format!("{from}:{to}") };
            format!("the value {asked} is outside the range {a} to {b}{units}")
        };
        ProbeError::Selection { axis: axis.kind.name(), reason }
    };
    match selection.range {
        CoordRange::Nearest(value) => {
            if !(value >= low && value <= high) {
                return Err(outside(value, value));
            }
            let first = axis.nearest(value);
            Ok(Step::Range { first, end: first + 1, drop: true })
        }
        CoordRange::Between(from, to) => {
            if !(from <= high && to >= low && from <= to) {
                return Err(outside(from, to));
            }
            let first = if from == f64::NEG_INFINITY { 0 } else { nearest_from(from) };
            let last = if to == f64::INFINITY { n - 1 } else { axis.nearest(to) };
            Ok(Step::Range { first, end: last.max(first) + 1, drop: false })
        }
    }
}

/// Returns the mean drive of the pattern over the pixels of every entry (v, u), or `None` if no contraction
/// is necessary.
fn joint_weights(
    probe: &Probe,
    slice: &StoredSlice,
    layout: &SliceLayout,
    notes: &mut Vec<String>,
) -> Result<Option<Vec<f64>>, ProbeError> {
    let Some(pattern) = &probe.pattern else {
        return Ok(None);
    };
    let fault = |reason: String| ProbeError::Pattern {
        slice: layout.name.clone(),
        width: pattern.width,
        height: pattern.height,
        reason,
    };
    if pattern.values.len() as u64 != u64::from(pattern.width) * u64::from(pattern.height) {
        return Err(fault(format!(
            "the pattern has {} values; expected width × height values",
            pattern.values.len()
        )));
    }
    let (Some(v), Some(u)) = (layout.find(AxisKind::V), layout.find(AxisKind::U)) else {
        return if pattern.is_full_on() {
            Ok(None)
        } else {
            let reason = "the projector pixels of the slice are already summed: render the slice with `projector = \"all\"`";
            Err(fault(reason.into()))
        };
    };
    let numbers = |key: &str| -> Option<[u32; 2]> {
        let list = slice.attributes().get(key)?.as_array()?;
        let get = |i: usize| list.get(i)?.as_u64().and_then(|n| u32::try_from(n).ok());
        Some([get(0)?, get(1)?])
    };
    if let Some([w, h]) = numbers("projector_size")
        && [w, h] != [pattern.width, pattern.height]
    {
        return Err(fault(format!("the projector has {w} × {h} pixels: use a pattern of this size")));
    }
    let bin = numbers("projector_bin");
    let along = |axis: usize, bin: Option<u32>, total| {
        pattern::pixels(&layout.axes[axis].coords, bin, total).map_err(&fault)
    };
    let rows = along(v, bin.map(|b| b[1]), pattern.height)?;
    let columns = along(u, bin.map(|b| b[0]), pattern.width)?;
    let mut kept = vec![false; pattern.values.len()];
    let mut weights = Vec::with_capacity(rows.len() * columns.len());
    for &r in &rows {
        for &c in &columns {
            weights.push(pattern.mean(c, r));
            for y in r.0..=r.1 {
                let row = y as usize * pattern.width as usize;
                kept[row + c.0 as usize..=row + c.1 as usize].fill(true);
            }
        }
    }
    let lost = kept.iter().zip(&pattern.values).filter(|(kept, p)| !**kept && **p != 0.0).count();
    if lost > 0 {
        notes.push(format!(
            "the pattern uses {lost} projector pixels that slice `{}` does not contain, so the light of these pixels is missing",
            layout.name
        ));
    }
    Ok(Some(weights))
}

//! Checks coordinates and attributes when a store is opened or created.
//!
//! The files of a store may have been edited or truncated. The checks ensure that coordinates are finite and
//! increasing, and that attributes that the program reads have the right type. Other attributes may have any
//! value.

use serde_json::{Map, Value};
use tensor::axes::{Axis, AxisKind, SliceLayout};
use tensor::part::{self, Part};

/// Maximum number of rows and of columns of a camera.
const MAX_CAMERA: u64 = 1 << 15;
/// Maximum number of chunks of sample counts: one per pixel for a camera of 4096 × 4096 pixels.
const MAX_SAMPLE_CHUNKS: u64 = 1 << 24;

/// Returns the fault in the coordinates of an axis, if any.
pub(super) fn coordinates_fault(axis: &Axis) -> Option<String> {
    let coords = &axis.coords;
    if let Some(bad) = coords.iter().find(|c| !c.is_finite()) {
        return Some(format!("coordinate {bad} is not a finite number"));
    }
    let falls = |pair: &[f64]| matches!(pair, [a, b] if a >= b);
    if let Some([a, b]) = coords.windows(2).find(|pair| falls(pair)) {
        return Some(format!("coordinates must increase, but {b} follows {a}"));
    }
    let (least, most) = match axis.kind {
        AxisKind::Y | AxisKind::X | AxisKind::V | AxisKind::U | AxisKind::Bounces => {
            (0.0, f64::from(u32::MAX - 1))
        }
        AxisKind::T => (f64::MIN, f64::MAX),
        AxisKind::Component => (0.0, 1.0),
        AxisKind::Label => (0.0, f64::from(tensor::label::COUNT - 1)),
        AxisKind::StokesOut | AxisKind::StokesIn => (0.0, 3.0),
        AxisKind::Wavelength => (f64::MIN_POSITIVE, f64::MAX),
    };
    // Coordinates are increasing, so checking the ends is enough.
    let ends = [coords.first(), coords.last()].into_iter().flatten();
    let mut outside = ends.filter(|c| !(least..=most).contains(*c));
    outside.next().map(|bad| format!("coordinate {bad} is outside the valid range {least} to {most}"))
}

/// Returns the fault in the time bins of a layout, if any. A fault is an invalid bin width, or a coordinate
/// of the axis t that is not the centre of a bin.
pub(super) fn time_fault(layout: &SliceLayout) -> Option<String> {
    let axis = layout.find(AxisKind::T).map(|i| &layout.axes[i]);
    let (axis, (start, bin)) = match (axis, layout.time) {
        (None, None) => return None,
        (Some(axis), Some(time)) => (axis, time),
        (Some(_), None) => {
            return Some("axis `t` requires the attributes `time_start_ps` and `time_bin_ps`".into());
        }
        (None, Some(_)) => {
            return Some("the attributes `time_start_ps` and `time_bin_ps` require axis `t`".into());
        }
    };
    if !(start.is_finite() && bin.is_finite() && bin > 0.0) {
        return Some(format!(
            "time bins of {bin} ps from {start} ps are invalid: both numbers must be finite, and `time_bin_ps` positive"
        ));
    }
    // If a slice keeps only some of the bins, the start of the bins is a sum with rounding error.
    let off = |(i, c): (usize, &f64)| (start + (i as f64 + 0.5) * bin - c).abs() > 1e-6 * (bin + c.abs());
    axis.coords.iter().enumerate().any(off).then(|| {
        format!("the coordinates of axis `t` are not the centres of bins of {bin} ps from {start} ps")
    })
}

/// Returns the fault in the shape and chunk of the sample counts, if any.
pub(super) fn samples_fault(shape: &[u64], chunk: &[u64]) -> Option<String> {
    let [rows, columns] = shape else {
        return Some(format!("the shape of the sample counts is {shape:?}, expected (rows, columns)"));
    };
    let chunks: u64 = shape.iter().zip(chunk).map(|(n, c)| n.div_ceil(*c)).product();
    if [rows, columns].into_iter().any(|n| !(1..=MAX_CAMERA).contains(n)) || chunks > MAX_SAMPLE_CHUNKS {
        return Some(format!(
            "the sample counts have shape {shape:?} in chunks of {chunk:?}; expected 1 to {MAX_CAMERA} rows and columns, and at most \
             {MAX_SAMPLE_CHUNKS} chunks"
        ));
    }
    None
}

/// Returns the fault in a slice's camera axes, if any. `samples` is the shape (rows, columns) of the sample
/// counts.
pub(super) fn camera_fault(layout: &SliceLayout, samples: [u64; 2]) -> Option<String> {
    let beyond = |kind, limit: u64| {
        let axis = &layout.axes[layout.find(kind)?];
        let last = axis.coords.last().filter(|c| **c > limit as f64 - 1.0)?;
        let name = kind.name();
        Some(format!("axis `{name}` reaches pixel {last}, but the sample counts have only {limit} pixels"))
    };
    beyond(AxisKind::Y, samples[0]).or_else(|| beyond(AxisKind::X, samples[1]))
}

/// The required type of an attribute.
#[derive(Clone, Copy)]
enum Form {
    Text,
    /// A nonnegative integer.
    Count,
    /// A positive integer.
    Positive,
    /// A finite nonnegative number, such as a duration.
    Duration,
    /// A list of integers, such as seeds.
    Seeds,
    /// Two positive integers.
    Pair,
}

impl Form {
    fn holds(self, value: &Value) -> bool {
        let positive = |v: &Value| v.as_u64().is_some_and(|n| (1..=u64::from(u32::MAX)).contains(&n));
        let list = |f: &dyn Fn(&Value) -> bool| value.as_array().is_some_and(|l| l.iter().all(f));
        match self {
            Self::Text => value.is_string(),
            Self::Count => value.is_u64(),
            Self::Positive => positive(value),
            Self::Duration => value.as_f64().is_some_and(|s| s.is_finite() && s >= 0.0),
            Self::Seeds => list(&|v| v.is_u64() || v.is_i64()),
            Self::Pair => list(&positive) && value.as_array().is_some_and(|l| l.len() == 2),
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Text => "a text",
            Self::Count => "a non-negative integer",
            Self::Positive => "a positive integer",
            Self::Duration => "a number of seconds",
            Self::Seeds => "a list of integers",
            Self::Pair => "two positive integers",
        }
    }
}

const OF_ROOT: [(&str, Form); 10] = [
    ("scene_sha256", Form::Text),
    ("status", Form::Text),
    ("seeds", Form::Seeds),
    ("samples_per_pixel", Form::Count),
    ("replicates_per_pixel", Form::Positive),
    ("discarded_samples", Form::Count),
    ("rays", Form::Count),
    ("tile", Form::Positive),
    ("max_depth", Form::Positive),
    ("wall_time_s", Form::Duration),
];

const OF_SLICES: [(&str, Form); 4] = [
    ("projector_selection", Form::Text),
    ("projector_size", Form::Pair),
    ("projector_bin", Form::Pair),
    ("pixels_per_element", Form::Positive),
];

/// Returns the fault in the attributes of the root group, if any.
pub(super) fn root_fault(attributes: &Map<String, Value>) -> Option<String> {
    let part = attributes.get(part::ATTRIBUTE);
    if let Some(value) = part.filter(|value| Part::from_json(value).is_none()) {
        return Some(format!("attribute `{}` is {value}, not a valid part of a render", part::ATTRIBUTE));
    }
    attributes_fault(attributes, &OF_ROOT)
}

/// Returns the fault in the attributes of a slice's group, if any.
pub(super) fn slice_fault(attributes: &Map<String, Value>) -> Option<String> {
    attributes_fault(attributes, &OF_SLICES)
}

fn attributes_fault(attributes: &Map<String, Value>, forms: &[(&str, Form)]) -> Option<String> {
    forms.iter().find_map(|(key, form)| {
        let value = attributes.get(*key).filter(|v| !form.holds(v))?;
        let mut shown = value.to_string();
        if shown.chars().count() > 60 {
            shown = shown.chars().take(60).chain(['…']).collect();
        }
        Some(format!("attribute `{key}` is {shown}, expected {}", form.words()))
    })
}

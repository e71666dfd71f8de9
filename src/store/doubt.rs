//! Counts pixels of a stored slice whose error estimates are unreliable, as defined in [`tensor::doubt`].

use crate::zarr::{AccessError, StoredSlice};
use serde_json::Value;
use std::ops::Range;
use tensor::array::Tensor;
use tensor::axes::Axis;
use tensor::doubt::{Doubt, doubtful};
use tensor::field::Field;

/// Returns the number of pixels with unreliable error estimates. Returns `None` if the slice has no errors of
/// totals, or if they do not have exactly the axes y and x.
///
/// # Errors
/// Returns an error if the errors of totals cannot be read.
pub fn of(slice: &StoredSlice) -> Result<Option<Doubt>, AccessError> {
    within(slice, None)
}

/// Returns the region (first index and shape) of the errors of totals from which [`within`] computes its
/// result. The region contains the pixels of the box `pixels` and their neighbours. Returns `None` in the
/// same cases as [`of`].
///
/// # Errors
/// Returns the same errors as [`of`].
pub fn around(
    slice: &StoredSlice,
    pixels: Option<[Range<usize>; 2]>,
) -> Result<Option<[Vec<u64>; 2]>, AccessError> {
    if !slice.has(Field::TotalStdError) {
        return Ok(None);
    }
    let [height, width] = slice.field_layout(Field::TotalStdError)?.shape()[..] else {
        return Ok(None);
    };
    let [rows, columns] = pixels.unwrap_or([0..height as usize, 0..width as usize]);
    let wider =
        |of: &Range<usize>, length: u64| of.start.saturating_sub(1) as u64..(of.end as u64 + 1).min(length);
    let read = [wider(&rows, height), wider(&columns, width)];
    let start = read.iter().map(|r| r.start).collect();
    Ok(Some([start, read.iter().map(|r| r.end - r.start).collect()]))
}

/// Returns the same numbers as [`of`], but only for the pixels in a box of rows and columns.
///
/// # Errors
/// Returns the same errors as [`of`].
pub fn within(slice: &StoredSlice, pixels: Option<[Range<usize>; 2]>) -> Result<Option<Doubt>, AccessError> {
    let Some([start, shape]) = around(slice, pixels.clone())? else {
        return Ok(None);
    };
    let layout = slice.field_layout(Field::TotalStdError)?;
    let read = [0, 1].map(|i| start[i] as usize..(start[i] + shape[i]) as usize);
    let all = layout.shape();
    let [rows, columns] = pixels.unwrap_or([0..all[0] as usize, 0..all[1] as usize]);
    let part =
        |i: usize| Axis { coords: layout.axes[i].coords[read[i].clone()].to_vec(), ..layout.axes[i].clone() };
    let errors = Tensor {
        name: layout.name.clone(),
        axes: vec![part(0), part(1)],
        data: slice.read(Field::TotalStdError, &start, &shape)?,
    };
    let width = read[1].len();
    let within = |of: &Range<usize>, read: &Range<usize>| of.start - read.start..of.end - read.start;
    let (rows, columns) = (within(&rows, &read[0]), within(&columns, &read[1]));
    let single = slice.attributes().get("pixels_per_element").and_then(Value::as_u64);
    let marks = doubtful(&errors, single == Some(1));
    let mut all = Doubt::default();
    for row in rows {
        let part = row * width + columns.start..row * width + columns.end;
        let of_row = Doubt::of(&errors.data[part.clone()], &marks[part]);
        all.lit += of_row.lit;
        all.doubtful += of_row.doubtful;
    }
    Ok(Some(all))
}

/// Returns a note if error estimates in a box of rows and columns are unreliable.
///
/// # Errors
/// Returns the same errors as [`of`].
pub fn note(slice: &StoredSlice, pixels: Option<[Range<usize>; 2]>) -> Result<Option<String>, AccessError> {
    let doubt = within(slice, pixels)?.filter(|d| d.doubtful > 0);
    Ok(doubt.map(|d| {
        format!(
            "unreliable error estimates (too few samples) in {} of {} lit pixels of `{}`: neighbouring pixels found light that these pixels \
             missed",
            d.doubtful,
            d.lit,
            slice.name()
        )
    }))
}

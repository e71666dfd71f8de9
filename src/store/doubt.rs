//! Which error bars of a stored slice cannot be trusted yet: see [`tensor::doubt`].

use crate::zarr::{AccessError, StoredSlice};
use serde_json::Value;
use std::ops::Range;
use tensor::doubt::{Doubt, doubtful};
use tensor::field::Field;

/// How many pixels of a slice are in doubt; `None` where the slice does not keep the errors of totals, or not by pixels.
///
/// # Errors
/// If these cannot be read.
pub fn of(slice: &StoredSlice) -> Result<Option<Doubt>, AccessError> {
    within(slice, None)
}

/// [`of`] the pixels in a box of rows and columns.
///
/// # Errors
/// As [`of`].
pub fn within(slice: &StoredSlice, pixels: Option<[Range<usize>; 2]>) -> Result<Option<Doubt>, AccessError> {
    if !slice.has(Field::TotalStdError) {
        return Ok(None);
    }
    let errors = slice.read_all(Field::TotalStdError)?;
    let [height, width] = errors.shape()[..] else {
        return Ok(None);
    };
    let single = slice
        .attributes()
        .get("pixels_per_element")
        .and_then(Value::as_u64);
    let marks = doubtful(&errors, single == Some(1));
    let [rows, columns] = pixels.unwrap_or([0..height, 0..width]);
    let mut all = Doubt::default();
    for row in rows {
        let part = row * width + columns.start..row * width + columns.end;
        let of_row = Doubt::of(&errors.data[part.clone()], &marks[part]);
        all.lit += of_row.lit;
        all.doubtful += of_row.doubtful;
    }
    Ok(Some(all))
}

//! Reads unfinished stores. Values without samples are NaN, never zero.

use super::chunked::ChunkedArray;
use super::error::AccessError;
use std::sync::Arc;
use tensor::axes::{self, AxisKind, SliceLayout};
use tensor::part::Part;

/// Indicates which values of a slice can be read.
pub(super) enum Values {
    /// All values can be read.
    All,
    /// No values can be read, because some may be missing. If the store is a part of a render, the variant
    /// contains this part.
    Unfinished(Option<Part>),
    /// Values of camera pixels with samples can be read. The variant contains the sample counts. Without
    /// sample counts, no values can be read.
    Sampled(Option<Arc<ChunkedArray<u32>>>),
}

/// In a region, replaces the values of camera pixels without samples by NaN. If the field does not resolve
/// pixels, replaces all values by NaN. `single` is true if each element belongs to one pixel.
pub(super) fn hide(
    samples: Option<&ChunkedArray<u32>>,
    layout: &SliceLayout,
    single: bool,
    start: &[u64],
    shape: &[u64],
    data: &mut [f32],
) -> Result<(), AccessError> {
    let camera = layout.find(AxisKind::Y).zip(layout.find(AxisKind::X));
    let (Some(samples), Some((0, 1))) = (samples, camera) else {
        data.fill(f32::NAN);
        return Ok(());
    };
    let pixels = |axis: usize| {
        let coords = &layout.axes[axis].coords;
        let all = if single {
            coords.iter().map(|&c| (c as u32, c as u32)).collect()
        } else {
            axes::boxes(coords).unwrap_or_default()
        };
        let part = start[axis] as usize..(start[axis] + shape[axis]) as usize;
        all.get(part).map(<[_]>::to_vec).unwrap_or_default()
    };
    let (rows, columns) = (pixels(0), pixels(1));
    let [Some(height), Some(width)] = [&rows, &columns].map(|p| p.last().map(|last| u64::from(last.1) + 1))
    else {
        data.fill(f32::NAN);
        return Ok(());
    };
    let counts = samples.read(&[0, 0], &[height, width])?;
    let sampled = |y: u32, x: u32| counts[(u64::from(y) * width + u64::from(x)) as usize] > 0;
    let inner = data.len() / (rows.len() * columns.len()).max(1);
    let elements = rows.iter().flat_map(|row| columns.iter().map(move |column| (row, column)));
    for ((row, column), values) in elements.zip(data.chunks_mut(inner.max(1))) {
        if !(row.0..=row.1).all(|y| (column.0..=column.1).all(|x| sampled(y, x))) {
            values.fill(f32::NAN);
        }
    }
    Ok(())
}

//! Computes the means of camera elements' totals from the stored means of all entries, because means of
//! totals are not stored.

use crate::zarr::{AccessError, StoredSlice};
use rayon::prelude::*;
use tensor::axes::AxisKind;
use tensor::field::Field;

/// Returns the total of every camera element, row-major. A total is M00, summed over all other axes and
/// averaged over wavelengths.
pub(super) fn means(slice: &StoredSlice) -> Result<Vec<f64>, AccessError> {
    let shape = slice.field_layout(Field::TotalStdError)?.shape();
    let mut totals = vec![0.0; shape.iter().product::<u64>() as usize];
    for field in [Field::Mean, Field::Overflow] {
        if !slice.has(field) {
            continue;
        }
        let layout = slice.field_layout(field)?;
        let stokes: Vec<usize> =
            [AxisKind::StokesOut, AxisKind::StokesIn].iter().filter_map(|kind| layout.find(*kind)).collect();
        let wavelengths = layout.find(AxisKind::Wavelength).map_or(1, |i| layout.axes[i].len());
        let chunks: Vec<_> =
            slice.chunks(field)?.filter(|(start, _)| stokes.iter().all(|i| start[*i] == 0)).collect();
        let sums = chunks.into_par_iter().map(|(start, mut size)| {
            stokes.iter().for_each(|i| size[*i] = 1);
            let values = slice.read(field, &start, &size)?;
            let inner = size[2..].iter().product::<u64>() as usize;
            let sums: Vec<f64> = values
                .chunks_exact(inner)
                .map(|element| element.iter().map(|v| f64::from(*v)).sum())
                .collect();
            Ok((start, size, sums))
        });
        // Sum in the order of the chunks, so that the result does not depend on the number of threads.
        for (start, size, sums) in sums.collect::<Result<Vec<_>, AccessError>>()? {
            for (row, sums) in (start[0]..).zip(sums.chunks_exact(size[1] as usize)) {
                let first = (row * shape[1] + start[1]) as usize;
                for (total, sum) in totals[first..].iter_mut().zip(sums) {
                    *total += sum / wavelengths as f64;
                }
            }
        }
    }
    Ok(totals)
}

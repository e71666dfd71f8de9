//! Reads and writes the sample counts per camera pixel of a store.

use super::TensorStore;
use super::chunked::ChunkedArray;
use super::error::AccessError;
use std::sync::Arc;

impl TensorStore {
    /// Returns the shape and the chunk shape of the sample counts, both as (rows, columns), or `None` if the
    /// store has no sample counts.
    pub fn samples_shape(&self) -> Option<([u64; 2], [u64; 2])> {
        let array = self.samples.as_ref()?;
        let pair = |v: &[u64]| [v[0], v[1]];
        Some((pair(array.shape()), pair(&array.chunk)))
    }

    pub(super) fn samples(&self) -> Result<&Arc<ChunkedArray<u32>>, AccessError> {
        self.samples.as_ref().ok_or_else(|| AccessError::NoSamples { path: self.path().to_owned() })
    }

    /// Writes the sample counts of the region that begins at pixel `start` and has the shape `shape`, both as
    /// (row, column). Counts are row-major.
    ///
    /// # Errors
    /// Returns an error if the store has no sample counts, the region is outside the array, or writing fails.
    pub fn write_samples(&self, start: [u64; 2], shape: [u64; 2], counts: &[u32]) -> Result<(), AccessError> {
        self.samples()?.write(&start, &shape, counts, None)
    }

    /// Reads the sample counts of the region that begins at pixel `start` and has the shape `shape`, both as
    /// (row, column). Counts are row-major.
    ///
    /// # Errors
    /// Returns an error if the store has no sample counts, the region is outside the array, or a chunk is
    /// damaged.
    pub fn read_samples(&self, start: [u64; 2], shape: [u64; 2]) -> Result<Vec<u32>, AccessError> {
        self.samples()?.read(&start, &shape)
    }
}

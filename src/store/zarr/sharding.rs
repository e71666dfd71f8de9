//! Creates sharded stores from stores with one file per chunk. A sharded store contains the same values in
//! fewer files.
//!
//! A shard is assembled in memory and written atomically, so every existing shard is complete. An interrupted
//! copy therefore resumes with the next shard.

use super::build::{New, SampleGrid};
use super::chunked::{ChunkedArray, Number};
use super::coding::{self, Frame};
use super::error::{AccessError, CreateError, OpenError};
use super::shard::Builder;
use super::shard_grid::{Sharded, Sharding, Shardings};
use super::shard_shape::{self, Limits};
use super::sparse_frame::{self, Content};
use super::{StoredSlice, TensorStore};
use rayon::prelude::*;
use std::path::Path;
use tensor::axes::{AxisKind, SliceLayout};
use tensor::field::Field;
use tensor::region::{self, Window};

/// Number of shards that are assembled concurrently.
const AT_ONCE: usize = 4;

impl TensorStore {
    /// Returns whether any array of the store is sharded.
    ///
    /// # Errors
    /// Returns an error if a slice cannot be opened.
    pub fn is_sharded(&self) -> Result<bool, OpenError> {
        for name in self.slice_names() {
            if self.slice(name)?.is_sharded() {
                return Ok(true);
            }
        }
        Ok(self.samples.as_ref().is_some_and(|s| s.sharded.is_some()))
    }

    /// Creates a sharded store at `path` with the content of a finished store. Resuming works as in
    /// [`TensorStore::create_from`].
    pub(crate) fn create_sharded<E>(
        path: &Path,
        of: &Self,
        replace: bool,
        origin: &str,
        limits: Limits,
    ) -> Result<(), E>
    where
        E: From<CreateError> + From<OpenError> + From<AccessError>,
    {
        let slices: Vec<StoredSlice> =
            of.slice_names().iter().map(|name| of.slice(name)).collect::<Result<_, _>>()?;
        let layouts: Vec<_> =
            slices.iter().map(|slice| (slice.layout().clone(), slice.written_attributes())).collect();
        let mut shardings = Shardings::new();
        for slice in &slices {
            let camera = camera_axes(slice.layout());
            for field in Field::ALL.into_iter().filter(|f| slice.has(*f)) {
                let node = format!("{}/{}", slice.name(), field.name());
                shardings.insert(node, chosen(&slice.field(field)?.1, camera, limits));
            }
        }
        if let Some(samples) = &of.samples {
            shardings.insert("samples".into(), chosen(samples, 2, limits));
        }
        let samples = of.samples_shape().map(|(shape, chunk)| SampleGrid::new(shape, chunk));
        let new = New { slices: &layouts, attributes: &of.attributes(), samples, shardings: &shardings };
        let fill = |store: &Self| -> Result<(), E> {
            for slice in &slices {
                let target = store.slice(slice.name())?;
                for field in Field::ALL.into_iter().filter(|f| slice.has(*f)) {
                    fill(&target.field(field)?.1, &slice.field(field)?.1)?;
                }
            }
            // Copy the sample counts last, because values without samples do not count as rendered.
            if let (Some(target), Some(source)) = (&store.samples, &of.samples) {
                fill(target, source)?;
            }
            Ok(store.finish()?)
        };
        Self::create_new(path, new, replace, Some(origin), fill).map(drop)
    }
}

impl StoredSlice {
    /// Returns whether the arrays of the slice are sharded.
    pub fn is_sharded(&self) -> bool {
        self.field(Field::Mean).is_ok_and(|(_, mean)| mean.sharded.is_some())
    }
}

fn camera_axes(layout: &SliceLayout) -> usize {
    let of_camera = |kind| matches!(kind, AxisKind::Y | AxisKind::X);
    layout.axes.iter().take_while(|axis| of_camera(axis.kind)).count()
}

/// Chooses the sharding of an array of a finished store.
fn chosen<T: Number>(array: &ChunkedArray<T>, camera: usize, limits: Limits) -> Sharding {
    let sizes: Vec<u64> =
        region::chunks(array.shape(), &array.chunk).map(|(start, _)| array.stored_size(&start)).collect();
    let array = shard_shape::Array { shape: array.shape(), chunk: &array.chunk, camera, sizes: &sizes };
    shard_shape::choose(&array, limits)
}

/// Writes all missing shards of the array `target`.
fn fill<T: Number>(target: &ChunkedArray<T>, source: &ChunkedArray<T>) -> Result<(), AccessError> {
    let Some(sharded) = &target.sharded else {
        return Ok(());
    };
    let grid = target.shard_grid(sharded);
    let all: Vec<Vec<u64>> = region::indices(&vec![0; grid.len()], &grid).collect();
    // Process several shards concurrently, so that one shard is assembled while another shard is written. The
    // number of concurrent shards limits the memory.
    for some in all.chunks(AT_ONCE) {
        some.par_iter().try_for_each(|shard| write(target, sharded, shard, source))?;
    }
    Ok(())
}

fn write<T: Number>(
    target: &ChunkedArray<T>,
    sharded: &Sharded,
    shard: &[u64],
    source: &ChunkedArray<T>,
) -> Result<(), AccessError> {
    let storage = &target.storage;
    let key = target.array.chunk_key(shard);
    if storage.is_stored(&key) {
        return Ok(());
    }
    let chunks = target.chunks_of(sharded, shard);
    let frames = chunks
        .par_iter()
        .filter(|(start, _)| source.is_listed(start))
        .map(|(start, size)| frames(target, sharded, start, size, &source.read(start, size)?))
        .collect::<Result<Vec<_>, AccessError>>()?;
    let mut builder = Builder::new(sharded.frames);
    for (number, frame) in frames.into_iter().flatten() {
        builder.push(number, &frame);
    }
    let Some((bytes, checksum)) = builder.finish() else {
        return Ok(());
    };
    let written = storage.write_shard(&key, bytes.into(), checksum);
    written.map_err(|e| AccessError::of_write(&target.path, &e))
}

/// Returns the sealed frames of the chunk that begins at `start`, with the number of each frame in the shard.
fn frames<T: Number>(
    target: &ChunkedArray<T>,
    sharded: &Sharded,
    start: &[u64],
    size: &[u64],
    values: &[T],
) -> Result<Vec<(usize, Vec<u8>)>, AccessError> {
    let failed = |cause: String| AccessError::Write { path: target.path.clone(), cause };
    if cfg!(target_endian = "big") {
        return Err(failed("shards can be written only on little-endian machines".into()));
    }
    let zeros = vec![0; start.len()];
    let mut piece = vec![T::default(); region::volume(&sharded.inner).unwrap_or(0)];
    let mut all = vec![];
    for index in target.units(start, size) {
        let (origin, valid) = region::chunk_box(target.shape(), &sharded.inner, &index);
        let at: Vec<u64> = origin.iter().zip(start).map(|(o, s)| o - s).collect();
        if valid != sharded.inner {
            piece.fill(T::default());
        }
        let (from, into) = (Window { shape: size, at: &at }, Window { shape: &sharded.inner, at: &zeros });
        region::copy(values, from, &mut piece, into, &valid);
        let bytes: &[u8] = bytemuck::cast_slice(&piece);
        let content = sparse_frame::encode(bytes, None);
        // A chunk with negative zeros is stored, as in an unsharded chunk that also has other values.
        if content == Content::Zero {
            continue;
        }
        let frame = coding::encode(bytes, content, Frame::Sealed).map_err(|e| failed(e.to_string()))?;
        all.push((sharded.place(&index).1, frame));
    }
    Ok(all)
}

//! Implements a chunked array of a store. Several threads may read and write any regions concurrently.
//!
//! Each chunk is a file, or part of a shard ([`super::sharded`]).
//!
//! Before a chunk file is decoded, the reader checks that the file is exactly one Zstandard frame of the
//! declared size (RFC 8878, section 3.1.1). A damaged file is therefore an error and never causes an
//! allocation of an invalid size. The checksum after the frame (CRC-32C, Zarr's `crc32c` codec) detects
//! damage inside the frame. Computing the checksum is fast, because it covers the compressed bytes and not
//! the larger decompressed data.

use std::marker::PhantomData;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde_json::{Map, Value, json};

use super::array::{self, Array};
use super::atomic::AtomicDirectory;
use super::coding::{self, Frame};
use super::coordinates;
use super::error::{AccessError, CreateError, OpenError};
use super::shard_grid::{Sharded, Sharding};
use super::sparse_frame::{self, Content};
use tensor::region::{self, Window};
use tensor::sink::STRETCH;

/// Number of locks per array. The same chunk always uses the same lock.
const STRIPES: usize = 64;
/// Maximum number of elements of a chunk. Metadata with a larger chunk is refused before an allocation.
const MAX_CHUNK: usize = 1 << 28;
/// Size, in bytes, above which the program tests whether memory suffices before the allocation.
const LARGE: usize = 1 << 28;

/// A type of array elements.
pub(super) trait Number: bytemuck::Pod + Default + PartialEq + Send + Sync {
    const NAME: &'static str;
    /// Returns zero as a JSON value.
    fn zero() -> Value;
}

macro_rules! numbers {
    ($($number:ty => $name:literal),*) => {$(
        impl Number for $number {
            const NAME: &'static str = $name;
            fn zero() -> Value {
                json!(Self::default())
            }
        }
    )*};
}
numbers!(f32 => "float32", f64 => "float64", i32 => "int32", i64 => "int64", u16 => "uint16", u32 => "uint32");

/// An open array of numbers.
pub(super) struct ChunkedArray<T> {
    pub(super) storage: Arc<AtomicDirectory>,
    pub(super) array: Array,
    pub(super) path: PathBuf,
    /// Shape of the block of elements that is read and written together. A block of a sharded array consists
    /// of several chunks of a shard.
    pub(super) chunk: Vec<u64>,
    /// Shards of the array, or `None` if the array is not sharded.
    pub(super) sharded: Option<Sharded>,
    locks: Vec<Mutex<()>>,
    number: PhantomData<T>,
}

/// Properties of a new array, for [`ChunkedArray::create`].
pub(super) struct Description<'a> {
    pub(super) shape: Vec<u64>,
    pub(super) chunk: Vec<u64>,
    pub(super) names: Vec<&'a str>,
    pub(super) attributes: Map<String, Value>,
    /// Sharding of the array, or `None` for one file per chunk.
    pub(super) sharding: Option<Sharding>,
}

impl<T: Number> ChunkedArray<T> {
    /// Writes the metadata of a new array of zeros at `node` (such as `/steady/mean`), and opens the array.
    pub(super) fn create(
        storage: &Arc<AtomicDirectory>,
        node: &str,
        description: Description,
    ) -> Result<Self, CreateError> {
        let path = node_path(storage, node);
        let failed = |cause: String| CreateError::Write { path: path.clone(), cause };
        let Description { shape, chunk, names, mut attributes, sharding } = description;
        let mut stored = chunk;
        if let Some(sharding) = &sharding {
            attributes.insert(coding::CHUNK.into(), sharding.chunk.clone().into());
            stored.clone_from(&sharding.shard);
        }
        let inner = sharding.as_ref().map(|s| &s.inner[..]);
        let json = array::describe([&shape, &stored], inner, (T::NAME, T::zero()), &names, &attributes);
        storage
            .write(&description_key(node), format!("{json:#}").into())
            .map_err(|e| failed(e.to_string()))?;
        Self::of(storage, node, &json).map_err(failed)
    }

    /// Opens an existing array and checks its data type, dimension names, chunk grid and codecs.
    pub(super) fn open(storage: &Arc<AtomicDirectory>, node: &str) -> Result<Self, OpenError> {
        let damaged = |reason: String| OpenError::Damaged { path: node_path(storage, node), reason };
        if !storage.has_description(node)? {
            return Err(damaged("the metadata file zarr.json is missing".into()));
        }
        let bytes = storage.read(&description_key(node)).map_err(|e| damaged(e.to_string()))?;
        let json = serde_json::from_slice(&bytes.unwrap_or_default());
        let json = json.map_err(|e| damaged(format!("invalid JSON: {e}")))?;
        Self::of(storage, node, &json).map_err(damaged)
    }

    /// Returns the array at `node` with the metadata `json`, or a description of the fault in the metadata.
    fn of(storage: &Arc<AtomicDirectory>, node: &str, json: &Value) -> Result<Self, String> {
        let array = Array::of(node, T::NAME, json)?;
        if region::volume(&array.shape).is_none_or(|n| n.checked_mul(size_of::<T>()).is_none()) {
            return Err(format!("an array of shape {:?} has too many elements", array.shape));
        }
        let stored = array.stored.clone();
        let (chunk, sharded) = match &array.inner {
            None => (stored, None),
            Some(inner) => {
                let chunk = array.attributes.get(coding::CHUNK).and_then(Value::as_array);
                let chunk: Option<Vec<u64>> = chunk.and_then(|list| list.iter().map(Value::as_u64).collect());
                let chunk = chunk.unwrap_or_default();
                let sharded = Sharded::of(inner.clone(), &chunk, stored, &array.shape);
                (chunk, Some(sharded.ok_or("the chunks do not fit into the shards")?))
            }
        };
        let inside = chunk.len() == array.shape.len()
            && chunk.iter().zip(&array.shape).all(|(c, n)| (1..=*n).contains(c))
            && region::volume(&chunk).is_some_and(|n| n <= MAX_CHUNK);
        if !inside {
            return Err(format!(
                "the chunks have shape {chunk:?}; expected chunks within the shape {:?} of the array, of at most {MAX_CHUNK} elements",
                array.shape
            ));
        }
        Ok(Self {
            storage: storage.clone(),
            array,
            path: node_path(storage, node),
            chunk,
            sharded,
            locks: (0..STRIPES).map(|_| Mutex::new(())).collect(),
            number: PhantomData,
        })
    }

    pub(super) fn shape(&self) -> &[u64] {
        &self.array.shape
    }

    /// Returns the dimension names, or "" for a dimension without a name.
    pub(super) fn names(&self) -> Vec<String> {
        self.array.names.clone()
    }

    /// Returns `n` coordinates from the array's metadata, or `None` if the metadata does not contain
    /// coordinates.
    pub(super) fn describe(&self, n: u64) -> Option<Vec<f64>> {
        coordinates::read(&self.array.attributes, n as usize)
    }

    pub(super) fn check(&self, start: &[u64], shape: &[u64]) -> Result<usize, AccessError> {
        let inside = region::contains(self.shape(), start, shape);
        region::volume(shape).filter(|_| inside).ok_or_else(|| AccessError::Region {
            path: self.path.clone(),
            start: start.to_vec(),
            shape: shape.to_vec(),
            array: self.shape().to_vec(),
        })
    }

    /// Allocates an array of zeros.
    fn zeros(&self, elements: usize) -> Result<Vec<T>, AccessError> {
        // A large allocation is tested first, because a failure of `vec!` would abort the process.
        let large = elements.saturating_mul(size_of::<T>()) > LARGE;
        if large && Vec::<T>::new().try_reserve_exact(elements).is_err() {
            return Err(AccessError::Memory { path: self.path.clone(), elements });
        }
        Ok(vec![T::default(); elements])
    }

    /// Returns the shape of a unit. A unit is the block that is encoded as one frame: an unsharded chunk, or
    /// a chunk in a shard.
    pub(super) fn unit(&self) -> &[u64] {
        self.sharded.as_ref().map_or(&self.chunk, |s| &s.inner)
    }

    /// Returns the indices of the units that a region intersects, in the order of their positions in files.
    pub(super) fn units(&self, start: &[u64], shape: &[u64]) -> Vec<Vec<u64>> {
        let mut all = vec![];
        if !shape.contains(&0) {
            match &self.sharded {
                None => within(&[&self.chunk], start, shape, &mut all),
                Some(s) => within(&[&s.shard, &self.chunk, &s.inner], start, shape, &mut all),
            }
        }
        all
    }

    /// Calls `f` for every unit that a region intersects. The arguments of `f` are the index of the unit, the
    /// start and the shape of the overlap, the start of the unit, and whether the region covers the unit
    /// completely.
    fn for_units(
        &self,
        units: &[Vec<u64>],
        start: &[u64],
        shape: &[u64],
        mut f: impl FnMut(&[u64], &[u64], &[u64], &[u64], bool) -> Result<(), AccessError>,
    ) -> Result<(), AccessError> {
        for index in units {
            let (origin, valid) = region::chunk_box(self.shape(), self.unit(), index);
            let axes = 0..start.len();
            let from: Vec<u64> = axes.clone().map(|a| start[a].max(origin[a])).collect();
            let size: Vec<u64> =
                axes.map(|a| (start[a] + shape[a]).min(origin[a] + valid[a]) - from[a]).collect();
            let whole = size == valid;
            f(index, &from, &size, &origin, whole)?;
        }
        Ok(())
    }

    /// Reads the values of a region, row-major.
    pub(super) fn read(&self, start: &[u64], shape: &[u64]) -> Result<Vec<T>, AccessError> {
        let mut values = self.zeros(self.check(start, shape)?)?;
        let units = self.units(start, shape);
        for units in self.batches(&units) {
            let asks = self.asks(units)?;
            let (mut at, mut ahead) = (0, 0);
            self.for_units(units, start, shape, |index, from, size, origin, _| {
                if at == ahead && ahead < asks.len() {
                    ahead += self.fetch_ahead(&asks[at..], index)?;
                }
                at += 1;
                if let Some(chunk) = self.read_unit(index)? {
                    let inner = difference(from, origin);
                    let outer = difference(from, start);
                    let source = Window { shape: self.unit(), at: &inner };
                    region::copy(&chunk, source, &mut values, Window { shape, at: &outer }, size);
                }
                Ok(())
            })?;
        }
        Ok(values)
    }

    /// Writes a region, row-major. Elements of the intersected chunks outside the region keep their values.
    /// For `touched`, see [`sparse_frame::encode`].
    pub(super) fn write(
        &self,
        start: &[u64],
        shape: &[u64],
        values: &[T],
        touched: Option<&[u64]>,
    ) -> Result<(), AccessError> {
        let expected = self.check(start, shape)?;
        if values.len() != expected {
            return Err(AccessError::Length { path: self.path.clone(), expected, found: values.len() });
        }
        if self.sharded.is_some() {
            return Err(AccessError::Sharded { path: self.path.clone() });
        }
        let zero = T::default();
        let units = self.units(start, shape);
        self.for_units(&units, start, shape, |index, from, size, origin, whole| {
            let _guard = self.lock(index);
            if shape == self.chunk && origin == start {
                // The region is exactly one chunk, so the values need not be copied.
                let enough = |bits: &&[u64]| bits.len() * 64 * STRETCH >= size_of_val(values);
                return self.store(index, values, touched.filter(enough));
            }
            let old = if whole { None } else { self.read_unit(index)? };
            let elements = self.chunk.iter().product::<u64>() as usize;
            let mut chunk = old.unwrap_or_else(|| vec![zero; elements]);
            let inner = difference(from, origin);
            let outer = difference(from, start);
            let target = Window { shape: &self.chunk, at: &inner };
            region::copy(values, Window { shape, at: &outer }, &mut chunk, target, size);
            self.store(index, &chunk, None)
        })
    }

    /// Stores the values of a chunk, or removes the chunk's file if all values are zero.
    fn store(&self, index: &[u64], chunk: &[T], touched: Option<&[u64]>) -> Result<(), AccessError> {
        let failed = |cause: String| AccessError::Write { path: self.path.clone(), cause };
        let mut swapped;
        let mut bytes: &[u8] = bytemuck::cast_slice(chunk);
        if self.array.coding.swapped {
            swapped = bytes.to_vec();
            swap::<T>(&mut swapped);
            bytes = &swapped;
        }
        let content = sparse_frame::encode(bytes, touched);
        // A chunk that contains only zeros and negative zeros is not stored.
        let zero = T::default();
        let key = self.array.chunk_key(index);
        if content == Content::Zero || content == Content::Dense && chunk.iter().all(|v| *v == zero) {
            let removed = self.storage.remove(&key);
            return removed.map_err(|e| AccessError::of_write(&self.path, &e));
        }
        let coded = coding::encode(bytes, content, self.array.coding.frame);
        let coded = coded.map_err(|e| failed(e.to_string()))?;
        let stored = self.storage.write(&key, coded.into());
        stored.map_err(|e| AccessError::of_write(&self.path, &e))
    }

    /// Reads the values of one unit. At the edge of the array, the values include the padding. Returns `None`
    /// if the unit is not stored because all values are zero.
    fn read_unit(&self, index: &[u64]) -> Result<Option<Vec<T>>, AccessError> {
        if let Some(sharded) = &self.sharded {
            let bytes = self.read_piece(sharded, index)?;
            return bytes.map(|bytes| self.decode(index, &bytes)).transpose();
        }
        let key = self.array.chunk_key(index);
        let read = self.storage.read(&key);
        let bytes = read.map_err(|e| AccessError::of_chunk(&self.path, index, &e))?;
        bytes.map(|bytes| self.decode(index, &bytes)).transpose()
    }

    /// Decodes the bytes of a unit.
    fn decode(&self, index: &[u64], bytes: &[u8]) -> Result<Vec<T>, AccessError> {
        let failed =
            |cause: String| AccessError::Chunk { path: self.path.clone(), chunk: index.to_vec(), cause };
        let frame = match &self.sharded {
            Some(_) => Frame::Sealed,
            None => self.array.coding.frame,
        };
        let elements = self.unit().iter().product::<u64>() as usize;
        let mut values = vec![T::default(); elements];
        let out: &mut [u8] = bytemuck::cast_slice_mut(&mut values);
        coding::decode(bytes, frame, out).map_err(failed)?;
        if self.array.coding.swapped {
            swap::<T>(out);
        }
        Ok(values)
    }

    fn lock(&self, index: &[u64]) -> MutexGuard<'_, ()> {
        let hash = index.iter().fold(0_u64, |h, &i| h.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(i));
        let stripe = (hash ^ (hash >> 29)) as usize % STRIPES;
        self.locks[stripe].lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn difference(a: &[u64], b: &[u64]) -> Vec<u64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// Appends to `all` the indices of the innermost units that a region intersects, in the order of the outer
/// units. `units` are the shapes of nested units, outermost first.
fn within(units: &[&[u64]], start: &[u64], shape: &[u64], all: &mut Vec<Vec<u64>>) {
    let Some((unit, smaller)) = units.split_first() else {
        return;
    };
    let axes = 0..start.len();
    let end = |a: usize| start[a] + shape[a];
    let lo: Vec<u64> = axes.clone().map(|a| start[a] / unit[a]).collect();
    let hi: Vec<u64> = axes.clone().map(|a| end(a).div_ceil(unit[a])).collect();
    for index in region::indices(&lo, &hi) {
        if smaller.is_empty() {
            all.push(index);
            continue;
        }
        let from: Vec<u64> = axes.clone().map(|a| start[a].max(index[a] * unit[a])).collect();
        let size: Vec<u64> = axes.clone().map(|a| end(a).min((index[a] + 1) * unit[a]) - from[a]).collect();
        within(smaller, &from, &size, all);
    }
}

/// Reverses the bytes of every number.
fn swap<T>(bytes: &mut [u8]) {
    bytes.chunks_exact_mut(size_of::<T>()).for_each(<[u8]>::reverse);
}

fn description_key(node: &str) -> String {
    format!("{}/zarr.json", node.trim_start_matches('/'))
}

fn node_path(storage: &AtomicDirectory, node: &str) -> PathBuf {
    storage.root.join(node.trim_start_matches('/'))
}

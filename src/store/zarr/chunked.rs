//! One chunked array of the store: reads and writes of any region, chunk by chunk, from many threads.
//!
//! Chunks are a file each, or lie in shards ([`super::sharded`]).
//!
//! A chunk file is checked before it is decoded: it must be exactly one Zstandard frame (RFC 8878, section 3.1.1)
//! whose declared size is that of the chunk. A damaged file is therefore an error and never an allocation of a
//! nonsensical size; damage inside the frame is found by the checksum behind it (CRC-32C, the `crc32c` codec of Zarr),
//! which takes no time, being over what is stored and not over its many zeros.

use std::marker::PhantomData;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde_json::{Map, Value};

use zarrs::array::{
    Array, ArrayBuilder, ArrayMetadataOptions, ArrayToBytesCodecTraits, ChunkKeySeparator, CodecChain,
    CodecOptions, ElementOwned, data_type,
};

use super::atomic::AtomicDirectory;
use super::coding::{self, Coding};
use super::coordinates;
use super::error::{AccessError, CreateError, OpenError};
use super::shard_grid::{Sharded, Sharding};
use super::sparse_frame::{self, Content};
use tensor::region::{self, Window};
use tensor::sink::STRETCH;

/// Locks per array; a chunk always takes the same one.
const STRIPES: usize = 64;
/// A chunk may not hold more elements than this (a damaged description is refused before it allocates).
const MAX_CHUNK: usize = 1 << 28;
/// Reads of more bytes than this are tried for memory first.
const LARGE: usize = 1 << 28;

/// A number type that arrays are made of.
pub(super) trait Number: ElementOwned + bytemuck::Pod + Default + PartialEq + Send + Sync {
    /// Name of the Zarr data type.
    const NAME: &'static str;
    /// The data type.
    fn data_type() -> zarrs::array::DataType;
}

macro_rules! numbers {
    ($($number:ty => $name:ident),*) => {$(
        impl Number for $number {
            const NAME: &'static str = stringify!($name);
            fn data_type() -> zarrs::array::DataType {
                data_type::$name()
            }
        }
    )*};
}
numbers!(f32 => float32, f64 => float64, i32 => int32, i64 => int64, u16 => uint16, u32 => uint32);

/// An open array of numbers.
pub(super) struct ChunkedArray<T> {
    pub(super) array: Array<AtomicDirectory>,
    pub(super) path: PathBuf,
    /// What is written and read together; in a shard, several of its chunks.
    pub(super) chunk: Vec<u64>,
    /// Of an array in shards.
    pub(super) sharded: Option<Sharded>,
    coding: Coding,
    codecs: Arc<CodecChain>,
    locks: Vec<Mutex<()>>,
    options: CodecOptions,
    number: PhantomData<T>,
}

/// What an array is, for [`ChunkedArray::create`].
pub(super) struct Description<'a> {
    pub(super) shape: Vec<u64>,
    pub(super) chunk: Vec<u64>,
    pub(super) names: Vec<&'a str>,
    pub(super) attributes: Map<String, Value>,
    /// `None` of an array of chunks that are a file each.
    pub(super) sharding: Option<Sharding>,
}

impl<T: Number> ChunkedArray<T> {
    /// Writes the description of a new array, all zero, at `node` (such as `/steady/mean`) and opens it.
    pub(super) fn create(
        storage: &Arc<AtomicDirectory>,
        node: &str,
        description: Description,
    ) -> Result<Self, CreateError> {
        let path = node_path(storage, node);
        let failed = |cause: String| CreateError::Write {
            path: path.clone(),
            cause,
        };
        let fill = zarrs::array::FillValue::new(vec![0; size_of::<T>()]);
        let Description {
            shape,
            chunk,
            names,
            mut attributes,
            sharding,
        } = description;
        let chunk = sharding.as_ref().map_or(chunk, |s| s.chunk.clone());
        let stored = sharding.as_ref().map_or(&chunk, |s| &s.shard).clone();
        let mut builder = ArrayBuilder::new(shape, stored, T::data_type(), fill);
        match &sharding {
            None => builder
                .array_to_bytes_codec(coding::numbers())
                .bytes_to_bytes_codecs(coding::frame()),
            Some(sharding) => {
                attributes.insert(coding::CHUNK.into(), chunk.clone().into());
                builder.array_to_bytes_codec(coding::shard(&sharding.inner))
            }
        };
        let array = builder
            // All chunks in one directory: one each per chunk would take longer to make than the chunks.
            .chunk_key_encoding_default_separator(ChunkKeySeparator::Dot)
            .dimension_names(Some(names))
            .attributes(attributes)
            .build(storage.clone(), node)
            .map_err(|e| failed(e.to_string()))?;
        let options = ArrayMetadataOptions::default().with_include_zarrs_metadata(false);
        array
            .store_metadata_opt(&options)
            .map_err(|e| failed(e.to_string()))?;
        let sharded = sharding.and_then(|s| Sharded::new(s.inner, s.shard));
        Ok(Self::over(array, path, chunk, sharded, Coding::SealedFrame))
    }

    /// Opens an existing array and checks that it is one of ours: data type, dimension names, chunk grid, codecs.
    pub(super) fn open(storage: &Arc<AtomicDirectory>, node: &str) -> Result<Self, OpenError> {
        let path = node_path(storage, node);
        let damaged = |reason: String| OpenError::Damaged {
            path: path.clone(),
            reason,
        };
        if !storage.has_description(node)? {
            return Err(damaged("its description zarr.json is missing".into()));
        }
        let array = Array::open(storage.clone(), node).map_err(|e| damaged(e.to_string()))?;
        let json = serde_json::to_value(array.metadata()).map_err(|e| damaged(e.to_string()))?;
        if json["data_type"] != T::NAME {
            return Err(damaged(format!(
                "its data type is {}, not {}",
                json["data_type"],
                T::NAME
            )));
        }
        if array.fill_value().as_ne_bytes().iter().any(|b| *b != 0) {
            return Err(damaged(format!(
                "what it does not store is {}, not 0",
                json["fill_value"]
            )));
        }
        if region::volume(array.shape()).is_none_or(|n| n.checked_mul(size_of::<T>()).is_none()) {
            return Err(damaged(format!(
                "its shape {:?} has more elements than can be counted",
                array.shape()
            )));
        }
        let lengths =
            |json: &Value| -> Option<Vec<u64>> { json.as_array()?.iter().map(Value::as_u64).collect() };
        let stored = lengths(&json["chunk_grid"]["configuration"]["chunk_shape"]).unwrap_or_default();
        let (coding, inner) = coding::of(&json["codecs"]).map_err(damaged)?;
        let (chunk, sharded) = match inner {
            None => (stored, None),
            Some(inner) => {
                let chunk = lengths(&json["attributes"][coding::CHUNK]).unwrap_or_default();
                let sharded = Sharded::of(inner, &chunk, stored, array.shape());
                let sharded =
                    sharded.ok_or_else(|| damaged("its chunks do not fit into its shards".into()))?;
                (chunk, Some(sharded))
            }
        };
        let inside = chunk.len() == array.shape().len()
            && chunk.iter().zip(array.shape()).all(|(c, n)| (1..=*n).contains(c))
            && region::volume(&chunk).is_some_and(|n| n <= MAX_CHUNK);
        if !inside {
            return Err(damaged(
                "its chunk grid is not a regular one of chunks within its shape".into(),
            ));
        }
        Ok(Self::over(array, path, chunk, sharded, coding))
    }

    fn over(
        array: Array<AtomicDirectory>,
        path: PathBuf,
        chunk: Vec<u64>,
        sharded: Option<Sharded>,
        coding: Coding,
    ) -> Self {
        let codecs = match &sharded {
            Some(_) => Arc::new(coding::chain()),
            None => array.codecs(),
        };
        Self {
            array,
            path,
            chunk,
            sharded,
            coding,
            codecs,
            locks: (0..STRIPES).map(|_| Mutex::new(())).collect(),
            // Locks are held while a chunk is coded, so coding must not wander off into other tasks of the pool.
            options: CodecOptions::default()
                .with_concurrent_target(1)
                .with_store_empty_chunks(false),
            number: PhantomData,
        }
    }

    /// Length of every axis.
    pub(super) fn shape(&self) -> &[u64] {
        self.array.shape()
    }

    /// Length of a chunk along every axis.
    pub(super) fn chunk(&self) -> &[u64] {
        &self.chunk
    }

    /// Directory of the array.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Dimension names; a dimension without a name gives "".
    pub(super) fn names(&self) -> Vec<String> {
        let names = self.array.dimension_names().as_deref().unwrap_or_default();
        names.iter().map(|n| n.clone().unwrap_or_default()).collect()
    }

    /// `n` coordinates that the array's description tells, if it does.
    pub(super) fn told(&self, n: u64) -> Option<Vec<f64>> {
        coordinates::read(self.array.attributes(), n as usize)
    }

    pub(super) fn check(&self, start: &[u64], shape: &[u64]) -> Result<usize, AccessError> {
        let inside = region::contains(self.shape(), start, shape);
        region::volume(shape)
            .filter(|_| inside)
            .ok_or_else(|| AccessError::Region {
                path: self.path.clone(),
                start: start.to_vec(),
                shape: shape.to_vec(),
                array: self.shape().to_vec(),
            })
    }

    /// Room for values, all zero.
    fn zeros(&self, elements: usize) -> Result<Vec<T>, AccessError> {
        // A large claim is tried first: where it fails, zeros would end the process.
        let large = elements.saturating_mul(size_of::<T>()) > LARGE;
        if large && Vec::<T>::new().try_reserve_exact(elements).is_err() {
            return Err(AccessError::Memory {
                path: self.path.clone(),
                elements,
            });
        }
        Ok(vec![T::default(); elements])
    }

    /// What is coded together: a chunk, or one of a shard.
    pub(super) fn unit(&self) -> &[u64] {
        self.sharded.as_ref().map_or(&self.chunk, |s| &s.inner)
    }

    /// Indices of the units that a region touches, in the order in which they lie in their files.
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

    /// Calls `f(unit's index, overlap start, overlap shape, unit's start, unit is wholly covered)` for units that a region touches.
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
            let size: Vec<u64> = axes
                .map(|a| (start[a] + shape[a]).min(origin[a] + valid[a]) - from[a])
                .collect();
            let whole = size == valid;
            f(index, &from, &size, &origin, whole)?;
        }
        Ok(())
    }

    /// The values of a region, row-major.
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
                    let source = Window {
                        shape: self.unit(),
                        at: &inner,
                    };
                    region::copy(&chunk, source, &mut values, Window { shape, at: &outer }, size);
                }
                Ok(())
            })?;
        }
        Ok(values)
    }

    /// Writes a region, row-major. Other elements of the chunks it touches keep their values. For `touched` see
    /// [`sparse_frame::encode`].
    pub(super) fn write(
        &self,
        start: &[u64],
        shape: &[u64],
        values: &[T],
        touched: Option<&[u64]>,
    ) -> Result<(), AccessError> {
        let expected = self.check(start, shape)?;
        if values.len() != expected {
            return Err(AccessError::Length {
                path: self.path.clone(),
                expected,
                found: values.len(),
            });
        }
        if self.sharded.is_some() {
            return Err(AccessError::Sharded {
                path: self.path.clone(),
            });
        }
        let zero = T::default();
        let units = self.units(start, shape);
        self.for_units(&units, start, shape, |index, from, size, origin, whole| {
            let _guard = self.lock(index);
            if shape == self.chunk && origin == start {
                // The region is this chunk and nothing else: no copy.
                let enough = |bits: &&[u64]| bits.len() * 64 * STRETCH >= size_of_val(values);
                return self.store(index, values, touched.filter(enough));
            }
            let old = if whole { None } else { self.read_unit(index)? };
            let elements = self.chunk.iter().product::<u64>() as usize;
            let mut chunk = old.unwrap_or_else(|| vec![zero; elements]);
            let inner = difference(from, origin);
            let outer = difference(from, start);
            let target = Window {
                shape: &self.chunk,
                at: &inner,
            };
            region::copy(values, Window { shape, at: &outer }, &mut chunk, target, size);
            self.store(index, &chunk, None)
        })
    }

    /// Stores the values of one whole chunk; erases it where they are all zero.
    fn store(&self, index: &[u64], chunk: &[T], touched: Option<&[u64]>) -> Result<(), AccessError> {
        let failed = |cause: String| AccessError::Write {
            path: self.path.clone(),
            cause,
        };
        let bytes: &[u8] = bytemuck::cast_slice(chunk);
        let content = sparse_frame::encode(bytes, touched);
        // Negative zeros are zeros as well.
        let zero = T::default();
        if content == Content::Zero || content == Content::Dense && chunk.iter().all(|v| *v == zero) {
            let removed = self.array.storage().remove(self.array.chunk_key(index).as_str());
            return removed.map_err(|e| AccessError::of_write(&self.path, &e));
        }
        if self.coding == Coding::Plain || cfg!(target_endian = "big") {
            let stored = self.array.store_chunk_opt(index, chunk.to_vec(), &self.options);
            return stored.map_err(|e| failed(e.to_string()));
        }
        let mut frame = coding::encode(bytes, content).map_err(|e| failed(e.to_string()))?;
        if self.coding == Coding::SealedFrame {
            coding::seal(&mut frame);
        }
        let key = self.array.chunk_key(index);
        let stored = self.array.storage().write(key.as_str(), frame.into());
        stored.map_err(|e| AccessError::of_write(&self.path, &e))
    }

    /// The values of one whole unit (padded at the edge of the array), `None` if it is not stored (all zero).
    fn read_unit(&self, index: &[u64]) -> Result<Option<Vec<T>>, AccessError> {
        if let Some(sharded) = &self.sharded {
            let bytes = self.read_piece(sharded, index)?;
            return bytes.map(|bytes| self.decode(index, &bytes)).transpose();
        }
        let key = self.array.chunk_key(index);
        let read = self.array.storage().read(key.as_str());
        let bytes = read.map_err(|e| AccessError::of_chunk(&self.path, index, &e))?;
        bytes.map(|bytes| self.decode(index, &bytes)).transpose()
    }

    /// The values that the bytes of a unit mean.
    fn decode(&self, index: &[u64], bytes: &[u8]) -> Result<Vec<T>, AccessError> {
        let failed = |cause: String| AccessError::Chunk {
            path: self.path.clone(),
            chunk: index.to_vec(),
            cause,
        };
        let elements = self.unit().iter().product::<u64>() as usize;
        let expected = (elements * size_of::<T>()) as u64;
        let declared = match self.coding {
            Coding::Plain => Some(bytes.len() as u64),
            Coding::Frame => sparse_frame::content_size(bytes),
            Coding::SealedFrame => {
                sparse_frame::content_size(&bytes[..bytes.len().saturating_sub(coding::SEAL)])
            }
        };
        if declared != Some(expected) {
            let found = declared.map_or("no complete Zstandard frame".into(), |n| format!("{n} bytes"));
            return Err(failed(format!("it holds {found} instead of {expected} bytes")));
        }
        let nonzero = |n: &u64| NonZeroU64::new(*n);
        let shape: Option<Vec<NonZeroU64>> = self.unit().iter().map(nonzero).collect();
        let shape = shape.ok_or_else(|| failed("it is empty".into()))?;
        let (data_type, fill) = (self.array.data_type(), self.array.fill_value());
        let bytes = std::borrow::Cow::Borrowed(bytes);
        let decoded = self.codecs.decode(bytes, &shape, data_type, fill, &self.options);
        let decoded = decoded.map_err(|e| failed(e.to_string()))?;
        let values = T::from_array_bytes(data_type, decoded).map_err(|e| failed(e.to_string()))?;
        if values.len() == elements {
            Ok(values)
        } else {
            Err(failed(format!(
                "it holds {} elements instead of {elements}",
                values.len()
            )))
        }
    }

    fn lock(&self, index: &[u64]) -> MutexGuard<'_, ()> {
        let hash = index.iter().fold(0_u64, |h, &i| {
            h.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(i)
        });
        let stripe = (hash ^ (hash >> 29)) as usize % STRIPES;
        self.locks[stripe].lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn difference(a: &[u64], b: &[u64]) -> Vec<u64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// Indices of the last of these units, one within the other, that a region touches: all of the first one's first, and so on.
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
        let size: Vec<u64> = axes
            .clone()
            .map(|a| end(a).min((index[a] + 1) * unit[a]) - from[a])
            .collect();
        within(smaller, &from, &size, all);
    }
}

fn node_path(storage: &AtomicDirectory, node: &str) -> PathBuf {
    storage.root().join(node.trim_start_matches('/'))
}

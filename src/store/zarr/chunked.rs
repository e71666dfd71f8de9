//! One chunked array of the store: reads and writes of any region, chunk by chunk, from many threads.
//!
//! A chunk file is checked before it is decoded: it must be exactly one Zstandard frame (RFC 8878, section 3.1.1)
//! whose declared size is that of the chunk. A damaged file is therefore an error and never an allocation of a
//! nonsensical size; damage inside the frame is found by the checksum behind it (CRC-32C, the `crc32c` codec of Zarr),
//! which takes no time, being over what is stored and not over its many zeros.

use std::cell::RefCell;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde_json::{Map, Value};

use zarrs::array::codec::{BytesCodec, Crc32cCodec, ZstdCodec};
use zarrs::array::{
    Array, ArrayBuilder, ArrayMetadataOptions, ArrayToBytesCodecTraits, ChunkKeySeparator, CodecOptions,
    ElementOwned, data_type,
};

use super::atomic::AtomicDirectory;
use super::error::{AccessError, CreateError, OpenError};
use super::sparse_frame::{self, Content};
use tensor::region::{self, Window};
use tensor::sink::STRETCH;

/// Zstandard level: noise of floating point numbers gets 8 % smaller at 1 and not at all at higher ones, only slower.
const LEVEL: i32 = -2;
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

thread_local! {
    /// A compression context takes longer to make than to use on a small chunk.
    static COMPRESSOR: RefCell<Option<zstd::bulk::Compressor<'static>>> = const { RefCell::new(None) };
}

/// One Zstandard frame with its size.
fn compress(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    COMPRESSOR.with_borrow_mut(|slot| {
        let compressor = match slot {
            Some(c) => c,
            None => slot.insert(zstd::bulk::Compressor::new(LEVEL)?),
        };
        compressor.compress(bytes)
    })
}

/// How the numbers of a chunk become the bytes of its file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coding {
    /// As they are.
    Plain,
    /// A Zstandard frame.
    Frame,
    /// A Zstandard frame and its CRC-32C.
    SealedFrame,
}

/// Bytes of a CRC-32C.
pub(super) const SEAL: usize = 4;

/// An open array of numbers.
pub(super) struct ChunkedArray<T> {
    pub(super) array: Array<AtomicDirectory>,
    pub(super) path: PathBuf,
    pub(super) chunk: Vec<u64>,
    coding: Coding,
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
        let array = ArrayBuilder::new(description.shape, description.chunk.clone(), T::data_type(), fill)
            .array_to_bytes_codec(Arc::new(BytesCodec::little()))
            .bytes_to_bytes_codecs(vec![
                Arc::new(ZstdCodec::new(LEVEL, false)),
                Arc::new(Crc32cCodec::new()),
            ])
            // All chunks in one directory: one each per chunk would take longer to make than the chunks.
            .chunk_key_encoding_default_separator(ChunkKeySeparator::Dot)
            .dimension_names(Some(description.names))
            .attributes(description.attributes)
            .build(storage.clone(), node)
            .map_err(|e| failed(e.to_string()))?;
        let options = ArrayMetadataOptions::default().with_include_zarrs_metadata(false);
        array
            .store_metadata_opt(&options)
            .map_err(|e| failed(e.to_string()))?;
        Ok(Self::over(array, path, description.chunk, Coding::SealedFrame))
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
        // What takes no options may be named by its name alone.
        let codecs: Vec<&str> = json["codecs"].as_array().map_or(Vec::new(), |list| {
            list.iter()
                .filter_map(|c| c["name"].as_str().or(c.as_str()))
                .collect()
        });
        let coding = match codecs[..] {
            ["bytes", "zstd", "crc32c"] => Coding::SealedFrame,
            ["bytes", "zstd"] => Coding::Frame,
            ["bytes"] => Coding::Plain,
            _ => {
                return Err(damaged(format!(
                    "its codecs {codecs:?} are not `bytes`, `zstd` and `crc32c`"
                )));
            }
        };
        let chunk: Option<Vec<u64>> = json["chunk_grid"]["configuration"]["chunk_shape"]
            .as_array()
            .and_then(|list| list.iter().map(Value::as_u64).collect());
        let chunk = match chunk {
            Some(chunk)
                if chunk.len() == array.shape().len()
                    && chunk.iter().zip(array.shape()).all(|(c, n)| (1..=*n).contains(c))
                    && region::volume(&chunk).is_some_and(|n| n <= MAX_CHUNK) =>
            {
                chunk
            }
            _ => {
                return Err(damaged(
                    "its chunk grid is not a regular one of chunks within its shape".into(),
                ));
            }
        };
        Ok(Self::over(array, path, chunk, coding))
    }

    fn over(array: Array<AtomicDirectory>, path: PathBuf, chunk: Vec<u64>, coding: Coding) -> Self {
        Self {
            array,
            path,
            chunk,
            coding,
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

    fn check(&self, start: &[u64], shape: &[u64]) -> Result<usize, AccessError> {
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

    /// Calls `f(chunk index, overlap start, overlap shape, chunk start, chunk is wholly covered)` for every chunk
    /// that a region touches.
    fn for_chunks(
        &self,
        start: &[u64],
        shape: &[u64],
        mut f: impl FnMut(&[u64], &[u64], &[u64], &[u64], bool) -> Result<(), AccessError>,
    ) -> Result<(), AccessError> {
        if shape.contains(&0) {
            return Ok(());
        }
        let axes = 0..start.len();
        let lo: Vec<u64> = axes.clone().map(|a| start[a] / self.chunk[a]).collect();
        let hi: Vec<u64> = axes
            .clone()
            .map(|a| (start[a] + shape[a]).div_ceil(self.chunk[a]))
            .collect();
        for index in region::indices(&lo, &hi) {
            let (origin, valid) = region::chunk_box(self.shape(), &self.chunk, &index);
            let from: Vec<u64> = axes.clone().map(|a| start[a].max(origin[a])).collect();
            let size: Vec<u64> = axes
                .clone()
                .map(|a| (start[a] + shape[a]).min(origin[a] + valid[a]) - from[a])
                .collect();
            let whole = size == valid;
            f(&index, &from, &size, &origin, whole)?;
        }
        Ok(())
    }

    /// The values of a region, row-major.
    pub(super) fn read(&self, start: &[u64], shape: &[u64]) -> Result<Vec<T>, AccessError> {
        let mut values = self.zeros(self.check(start, shape)?)?;
        let keys = self.keys_ahead(start, shape)?;
        let (mut at, mut ahead) = (0, 0);
        self.for_chunks(start, shape, |index, from, size, origin, _| {
            if at == ahead && ahead < keys.len() {
                ahead += self.fetch_ahead(&keys[at..], index)?;
            }
            at += 1;
            if let Some(chunk) = self.read_chunk(index)? {
                let inner = difference(from, origin);
                let outer = difference(from, start);
                let source = Window {
                    shape: &self.chunk,
                    at: &inner,
                };
                region::copy(&chunk, source, &mut values, Window { shape, at: &outer }, size);
            }
            Ok(())
        })?;
        Ok(values)
    }

    /// Files of the chunks that a region touches, in the order in which they are read, where they are worth fetching ahead.
    pub(super) fn keys_ahead(&self, start: &[u64], shape: &[u64]) -> Result<Vec<String>, AccessError> {
        let mut keys = vec![];
        if self.array.storage().remote().is_some() {
            self.for_chunks(start, shape, |index, _, _, _, _| {
                keys.push(self.array.chunk_key(index).as_str().to_owned());
                Ok(())
            })?;
        }
        Ok(keys)
    }

    /// Fetches the first ones of these files ahead, `index` being the first one's, and says how many.
    pub(super) fn fetch_ahead(&self, keys: &[String], index: &[u64]) -> Result<usize, AccessError> {
        let fetched = self.array.storage().fetch_ahead(keys);
        fetched.map_err(|e| AccessError::of_chunk(&self.path, index, &e))
    }

    /// Fetches the files of the first ones of several regions ahead, of several arrays of one store, and says of how many regions.
    pub(super) fn fetch_regions(
        arrays: &[&Self],
        regions: &[(Vec<u64>, Vec<u64>)],
    ) -> Result<usize, AccessError> {
        let Some(first) = arrays.first().filter(|a| a.array.storage().remote().is_some()) else {
            return Ok(regions.len());
        };
        let mut keys = vec![];
        let mut ends = vec![];
        for (start, shape) in regions {
            for array in arrays {
                array.check(start, shape)?;
                keys.extend(array.keys_ahead(start, shape)?);
            }
            ends.push(keys.len());
        }
        let fetched = first.fetch_ahead(&keys, &[])?;
        Ok(ends.iter().filter(|end| **end <= fetched).count().max(1))
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
        let zero = T::default();
        self.for_chunks(start, shape, |index, from, size, origin, whole| {
            let _guard = self.lock(index);
            if shape == self.chunk && origin == start {
                // The region is this chunk and nothing else: no copy.
                let enough = |bits: &&[u64]| bits.len() * 64 * STRETCH >= size_of_val(values);
                return self.store(index, values, touched.filter(enough));
            }
            let old = if whole { None } else { self.read_chunk(index)? };
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
        // What zarrs' codecs would make, without a copy of the values and a new context for every chunk.
        let mut frame = match content {
            Content::Sparse(frame) => frame,
            _ => compress(bytes).map_err(|e| failed(e.to_string()))?,
        };
        if self.coding == Coding::SealedFrame {
            frame.extend(crc32c::crc32c(&frame).to_le_bytes());
        }
        let key = self.array.chunk_key(index);
        let stored = self.array.storage().write(key.as_str(), frame.into());
        stored.map_err(|e| AccessError::of_write(&self.path, &e))
    }

    /// The values of one whole chunk (padded at the edge of the array), `None` if it is not stored (all zero).
    fn read_chunk(&self, index: &[u64]) -> Result<Option<Vec<T>>, AccessError> {
        let failed = |cause: String| AccessError::Chunk {
            path: self.path.clone(),
            chunk: index.to_vec(),
            cause,
        };
        let key = self.array.chunk_key(index);
        let read = self.array.storage().read(key.as_str());
        let Some(bytes) = read.map_err(|e| AccessError::of_chunk(&self.path, index, &e))? else {
            return Ok(None);
        };
        let elements = self.chunk.iter().product::<u64>() as usize;
        let expected = (elements * size_of::<T>()) as u64;
        let declared = match self.coding {
            Coding::Plain => Some(bytes.len() as u64),
            Coding::Frame => sparse_frame::content_size(&bytes),
            Coding::SealedFrame => sparse_frame::content_size(&bytes[..bytes.len().saturating_sub(SEAL)]),
        };
        if declared != Some(expected) {
            let found = declared.map_or("no complete Zstandard frame".into(), |n| format!("{n} bytes"));
            return Err(failed(format!("it holds {found} instead of {expected} bytes")));
        }
        let shape = self.array.chunk_shape(index).map_err(|e| failed(e.to_string()))?;
        let (data_type, fill) = (self.array.data_type(), self.array.fill_value());
        let decoded = self
            .array
            .codecs()
            .decode(
                std::borrow::Cow::Borrowed(&bytes[..]),
                &shape,
                data_type,
                fill,
                &self.options,
            )
            .map_err(|e| failed(e.to_string()))?;
        let values = T::from_array_bytes(data_type, decoded).map_err(|e| failed(e.to_string()))?;
        if values.len() == elements {
            Ok(Some(values))
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

fn node_path(storage: &AtomicDirectory, node: &str) -> PathBuf {
    storage.root().join(node.trim_start_matches('/'))
}

//! Reads sharded arrays: caches the tails of shards, and reads single chunks.

use super::chunked::{ChunkedArray, Number};
use super::error::AccessError;
use super::shard::{self, Piece};
use super::shard_grid::{Contents, Sharded};
use crate::place::Ask;
use bytes::Bytes;
use std::sync::Arc;
use tensor::region;

/// Number of shards that are read concurrently.
const AT_ONCE: usize = 64;

pub(super) struct Region<'a, T> {
    pub(super) array: &'a ChunkedArray<T>,
    pub(super) start: Vec<u64>,
    pub(super) shape: Vec<u64>,
}

impl<T: Number> ChunkedArray<T> {
    /// Concurrently reads the tails of the shards `all` that are not in the cache. All shards belong to
    /// arrays of one store.
    fn open_shards(all: &[(&Self, &Sharded, Vec<u64>)]) -> Result<(), AccessError> {
        let mut wanted: Vec<&(&Self, &Sharded, Vec<u64>)> = vec![];
        for one @ (array, sharded, index) in all {
            let twice = wanted.iter().any(|w| std::ptr::eq(w.0, *array) && w.2 == *index);
            if !twice && !sharded.kept().contains_key(index) {
                wanted.push(one);
            }
        }
        let Some((first, _, index)) = wanted.first() else {
            return Ok(());
        };
        let key = |(array, sharded, index): &&(&Self, &Sharded, Vec<u64>)| {
            (array.array.chunk_key(index), sharded.frames)
        };
        let keys: Vec<_> = wanted.iter().map(key).collect();
        let tails = first.storage.read_tails(&keys);
        let tails = tails.map_err(|e| AccessError::of_shard(&first.path, index, &e))?;
        for ((array, sharded, index), tail) in wanted.into_iter().zip(tails) {
            let tail = tail.map_err(|e| AccessError::of_shard(&array.path, index, &e))?;
            let contents = |tail: super::atomic::Tail| {
                let pieces = shard::parse(&tail.bytes, tail.size, sharded.frames);
                let pieces = pieces
                    .map_err(|e| AccessError::of_shard(&array.path, index, &std::io::Error::other(e)))?;
                let whole = tail.whole;
                Ok(Arc::new(Contents { pieces, whole }))
            };
            sharded.keep(index.clone(), tail.map(contents).transpose()?);
        }
        Ok(())
    }

    fn contents(&self, sharded: &Sharded, shard: &[u64]) -> Result<Option<Arc<Contents>>, AccessError> {
        if let Some(kept) = sharded.kept().get(shard) {
            return Ok(kept.clone());
        }
        Self::open_shards(&[(self, sharded, shard.to_vec())])?;
        Ok(sharded.kept().get(shard).cloned().flatten())
    }

    /// Reads the bytes of a chunk in a shard. Returns `None` if the chunk is not stored because all values
    /// are zero.
    pub(super) fn read_piece(&self, sharded: &Sharded, index: &[u64]) -> Result<Option<Bytes>, AccessError> {
        let (shard, number) = sharded.place(index);
        let Some(contents) = self.contents(sharded, &shard)? else {
            return Ok(None);
        };
        let Some(piece) = contents.pieces[number] else {
            return Ok(None);
        };
        let range = piece.range();
        let bytes = if let Some(whole) = &contents.whole {
            whole.slice(range.start as usize..range.end as usize)
        } else {
            let key = self.array.chunk_key(&shard);
            let read = self.storage.read_part(&key, range);
            read.map_err(|e| AccessError::of_chunk(&self.path, index, &e))?.unwrap_or_default()
        };
        match piece.fault(&bytes) {
            None => Ok(Some(bytes)),
            Some(reason) => Err(AccessError::Chunk {
                path: self.path.clone(),
                chunk: index.to_vec(),
                cause: format!("of {}: {reason}", self.array.chunk_key(&shard)),
            }),
        }
    }

    /// Divides a list of units into consecutive batches. The units of a batch belong to a limited number of
    /// shards.
    pub(super) fn batches<'a>(&self, units: &'a [Vec<u64>]) -> Vec<&'a [Vec<u64>]> {
        let Some(sharded) = &self.sharded else {
            return vec![units];
        };
        let (mut all, mut from, mut shards) = (vec![], 0, 0);
        let mut last = None;
        for (n, index) in units.iter().enumerate() {
            let (shard, _) = sharded.place(index);
            if last.as_ref() != Some(&shard) {
                if shards == AT_ONCE {
                    all.push(&units[from..n]);
                    (from, shards) = (n, 0);
                }
                shards += 1;
                last = Some(shard);
            }
        }
        all.push(&units[from..]);
        all
    }

    /// Returns the requests for the bytes of units, or an empty list for a local store, where fetching ahead
    /// has no benefit.
    pub(super) fn asks(&self, units: &[Vec<u64>]) -> Result<Vec<(String, Ask)>, AccessError> {
        if self.storage.remote.is_none() {
            return Ok(vec![]);
        }
        if let Some(sharded) = &self.sharded {
            let mut shards: Vec<_> = units.iter().map(|i| (self, sharded, sharded.place(i).0)).collect();
            shards.dedup_by(|a, b| a.2 == b.2);
            Self::open_shards(&shards)?;
        }
        units.iter().map(|index| self.ask(index)).collect()
    }

    fn ask(&self, index: &[u64]) -> Result<(String, Ask), AccessError> {
        let Some(sharded) = &self.sharded else {
            return Ok((self.array.chunk_key(index), Ask::Whole));
        };
        let (shard, number) = sharded.place(index);
        let contents = self.contents(sharded, &shard)?;
        let piece = contents.filter(|c| c.whole.is_none()).and_then(|c| c.pieces[number]);
        let key = self.array.chunk_key(&shard);
        // Nothing is requested for chunks that are not stored or are already in memory.
        Ok((key, Ask::Bytes(piece.map_or(0..0, Piece::range))))
    }

    /// Fetches the bytes of the first requests of `asks` ahead, up to a limit. Returns the number of requests
    /// whose bytes were fetched. `index` is the chunk index of the first request.
    pub(super) fn fetch_ahead(&self, asks: &[(String, Ask)], index: &[u64]) -> Result<usize, AccessError> {
        let fetched = self.storage.fetch_ahead(asks);
        fetched.map_err(|e| AccessError::of_chunk(&self.path, index, &e))
    }

    /// Fetches the units of the first regions ahead, up to a limit. Each element of `regions` contains
    /// regions of one or more arrays of one store. Returns the number of fetched elements.
    pub(super) fn fetch_regions(regions: &[Vec<Region<T>>]) -> Result<usize, AccessError> {
        let first = regions.first().and_then(|r| r.first()).map(|r| r.array);
        let Some(first) = first.filter(|a| a.storage.remote.is_some()) else {
            return Ok(regions.len());
        };
        let mut shards: Vec<(&Self, &Sharded, Vec<u64>)> = vec![];
        let mut units = vec![];
        for region in regions {
            let mut of_region = vec![];
            let mut more = vec![];
            for Region { array, start, shape } in region {
                array.check(start, shape)?;
                let found = array.units(start, shape);
                if let Some(sharded) = &array.sharded {
                    let mut new: Vec<_> =
                        found.iter().map(|i| (*array, sharded, sharded.place(i).0)).collect();
                    new.dedup_by(|a, b| a.2 == b.2);
                    more.extend(new);
                }
                of_region.extend(found.into_iter().map(|index| (*array, index)));
            }
            if shards.len() + more.len() > AT_ONCE {
                break;
            }
            shards.extend(more);
            units.push(of_region);
        }
        Self::open_shards(&shards)?;
        let (mut asks, mut ends) = (vec![], vec![]);
        for of_region in units {
            for (array, index) in of_region {
                asks.push(array.ask(&index)?);
            }
            ends.push(asks.len());
        }
        let fetched = first.fetch_ahead(&asks, &[])?;
        Ok(ends.iter().filter(|end| **end <= fetched).count().max(1))
    }

    /// Returns the number of shards along each axis.
    pub(super) fn shard_grid(&self, sharded: &Sharded) -> Vec<u64> {
        let along = self.shape().iter().zip(&sharded.shard);
        along.map(|(n, s)| n.div_ceil(*s)).collect()
    }

    /// Returns the start and the shape of every chunk ([`ChunkedArray::chunk`]) of a shard, clipped to the
    /// array, in row-major order.
    pub(super) fn chunks_of(&self, sharded: &Sharded, shard: &[u64]) -> Vec<(Vec<u64>, Vec<u64>)> {
        let (origin, size) = region::chunk_box(self.shape(), &sharded.shard, shard);
        let chunks = region::chunks(&size, &self.chunk);
        let moved = |(start, size): (Vec<u64>, Vec<u64>)| {
            let start = start.iter().zip(&origin).map(|(s, o)| s + o).collect();
            (start, size)
        };
        chunks.map(moved).collect()
    }
}

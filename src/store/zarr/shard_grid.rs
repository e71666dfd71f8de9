//! Represents the sharding of an array: shapes of shards and chunks, and a cache of the tails of shards.

use super::shard::{self, Piece};
use bytes::Bytes;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Maximum number of shard tails in the cache of an array. A tail has a size of about 10 kB.
const KEPT: usize = 256;
/// The shapes of shards and chunks of an array.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Sharding {
    /// Shape of a chunk in a shard.
    pub(super) inner: Vec<u64>,
    /// Shape of the block that is read together ([`ChunkedArray::chunk`]).
    pub(super) chunk: Vec<u64>,
    pub(super) shard: Vec<u64>,
}

/// Shardings of arrays by node, such as `steady/mean`.
pub(super) type Shardings = HashMap<String, Sharding>;

/// The parsed tail of a shard.
#[derive(Debug)]
pub(super) struct Contents {
    pub(super) pieces: Vec<Option<Piece>>,
    /// The complete shard, if the shard is small and was fetched.
    pub(super) whole: Option<Bytes>,
}

/// The shards of an open array.
pub(super) struct Sharded {
    pub(super) inner: Vec<u64>,
    pub(super) shard: Vec<u64>,
    /// Number of chunks per shard.
    pub(super) frames: usize,
    /// Cached tails of shards by shard index. A value is `None` for a shard of zeros, which has no file.
    kept: Mutex<HashMap<Vec<u64>, Option<Arc<Contents>>>>,
}

impl Sharded {
    pub(super) fn new(inner: Vec<u64>, shard: Vec<u64>) -> Option<Self> {
        Some(Self { frames: shard::frames(&shard, &inner)?, inner, shard, kept: Mutex::default() })
    }

    /// Creates the shards of an array of shape `shape` as [`Self::new`] does. Returns `None` unless `inner`
    /// divides `chunk` and `chunk` divides `shard` along every axis.
    pub(super) fn of(inner: Vec<u64>, chunk: &[u64], shard: Vec<u64>, shape: &[u64]) -> Option<Self> {
        let axes = [inner.len(), chunk.len(), shard.len()] == [shape.len(); 3];
        let fits = axes
            && (0..shape.len()).all(|a| {
                let (i, c, s) = (inner[a], chunk[a], shard[a]);
                i > 0 && c > 0 && c % i == 0 && s % c == 0 && s < shape[a].saturating_add(c)
            });
        if fits { Self::new(inner, shard) } else { None }
    }

    /// Returns the index of the shard that contains a chunk, and the chunk's number in the shard.
    pub(super) fn place(&self, index: &[u64]) -> (Vec<u64>, usize) {
        let mut number = 0;
        let mut shard = Vec::with_capacity(index.len());
        for (a, i) in index.iter().enumerate() {
            let along = self.shard[a] / self.inner[a];
            shard.push(i / along);
            number = number * along as usize + (i % along) as usize;
        }
        (shard, number)
    }

    pub(super) fn kept(&self) -> MutexGuard<'_, HashMap<Vec<u64>, Option<Arc<Contents>>>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn keep(&self, index: Vec<u64>, contents: Option<Arc<Contents>>) {
        let mut kept = self.kept();
        if kept.len() >= KEPT {
            kept.clear();
        }
        kept.insert(index, contents);
    }
}

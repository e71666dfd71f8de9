//! How an array lies in shards: lengths of these and of their chunks, and what is known of each that was read from.

use super::shard::{self, Piece};
use bytes::Bytes;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Tails that are kept of an array, each some 10 kB.
const KEPT: usize = 256;
/// How an array is cut.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Sharding {
    /// Lengths of a chunk in a shard.
    pub(super) inner: Vec<u64>,
    /// Lengths of what is read together ([`ChunkedArray::chunk`]).
    pub(super) chunk: Vec<u64>,
    /// Lengths of a shard.
    pub(super) shard: Vec<u64>,
}

/// Arrays that lie in shards, by their nodes, such as `steady/mean`.
pub(super) type Shardings = HashMap<String, Sharding>;

/// What the tail of a shard says.
#[derive(Debug)]
pub(super) struct Contents {
    pub(super) pieces: Vec<Option<Piece>>,
    /// The shard, where it is small and was fetched.
    pub(super) whole: Option<Bytes>,
}

/// The shards of an open array.
pub(super) struct Sharded {
    pub(super) inner: Vec<u64>,
    pub(super) shard: Vec<u64>,
    /// Chunks of a shard.
    pub(super) frames: usize,
    /// By the index of the shard; `None` of one of zeros.
    kept: Mutex<HashMap<Vec<u64>, Option<Arc<Contents>>>>,
}

impl Sharded {
    pub(super) fn new(inner: Vec<u64>, shard: Vec<u64>) -> Option<Self> {
        Some(Self {
            frames: shard::frames(&shard, &inner)?,
            inner,
            shard,
            kept: Mutex::default(),
        })
    }

    /// [`Self::new`] of an array of this shape, if the chunks of a shard make up whole `chunk`s, and these whole shards.
    pub(super) fn of(inner: Vec<u64>, chunk: &[u64], shard: Vec<u64>, shape: &[u64]) -> Option<Self> {
        let axes = [inner.len(), chunk.len(), shard.len()] == [shape.len(); 3];
        let fits = axes
            && (0..shape.len()).all(|a| {
                let (i, c, s) = (inner[a], chunk[a], shard[a]);
                i > 0 && c > 0 && c % i == 0 && s % c == 0 && s < shape[a].saturating_add(c)
            });
        if fits { Self::new(inner, shard) } else { None }
    }

    /// The index of the shard of a chunk, and the chunk's number in it.
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

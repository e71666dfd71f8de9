//! Handles the files of chunks: paths, existence, and copies from other stores.

use super::chunked::{ChunkedArray, Number};
use super::coding::SEAL;
use super::error::AccessError;
use std::path::PathBuf;

impl<T: Number> ChunkedArray<T> {
    /// Returns the index in the chunk grid of the chunk that begins at `start`.
    fn index_of(&self, start: &[u64]) -> Vec<u64> {
        start.iter().zip(&self.chunk).map(|(s, c)| s / c).collect()
    }

    /// Returns the path of the chunk that begins at `start`.
    pub(super) fn file_of(&self, start: &[u64]) -> PathBuf {
        let key = self.array.chunk_key(&self.index_of(start));
        self.storage.root.join(&key)
    }

    /// Copies the file of the chunk that begins at `start` from an array with the same metadata, after
    /// verifying the chunk's checksum.
    pub(super) fn copy(&self, start: &[u64], from: &Self) -> Result<(), AccessError> {
        let index = self.index_of(start);
        let key = self.array.chunk_key(&index);
        let lost =
            |cause: String| AccessError::Chunk { path: from.path.clone(), chunk: index.clone(), cause };
        let read = from.storage.read(&key);
        let bytes = read.map_err(|e| AccessError::of_chunk(&from.path, &index, &e))?;
        let bytes = bytes.ok_or_else(|| lost("the file is missing".into()))?;
        let sound = bytes
            .split_last_chunk::<SEAL>()
            .is_some_and(|(frame, seal)| crc32c::crc32c(frame) == u32::from_le_bytes(*seal));
        if !sound {
            return Err(lost("checksum mismatch".into()));
        }
        let stored = self.storage.write(&key, bytes);
        stored.map_err(|e| AccessError::of_write(&self.path, &e))
    }

    /// Returns whether the manifest lists a file of the chunk that begins at `start`. Without a manifest,
    /// returns whether the file exists.
    pub(super) fn is_listed(&self, start: &[u64]) -> bool {
        let key = self.array.chunk_key(&self.index_of(start));
        let listed = self.storage.lists(&key);
        listed.unwrap_or_else(|| self.is_stored(start))
    }

    /// Returns whether the chunk that begins at `start` has a file.
    pub(super) fn is_stored(&self, start: &[u64]) -> bool {
        let key = self.array.chunk_key(&self.index_of(start));
        self.storage.is_stored(&key)
    }

    /// Returns the size of the file of the chunk that begins at `start`, from the manifest, or 0 if there is
    /// no file.
    pub(super) fn stored_size(&self, start: &[u64]) -> u64 {
        let key = self.array.chunk_key(&self.index_of(start));
        self.storage.size(&key).unwrap_or(0)
    }
}

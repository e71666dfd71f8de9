//! Storage of slices: Zarr v3 stores, probe, merge, shards, and NumPy and OpenEXR files.

pub mod denoised;
pub mod doubt;
pub mod exr;
pub mod matching_stores;
pub mod merge;
pub mod npz_layers;
pub mod numpy;
pub mod objects;
pub mod place;
pub mod probe;
pub mod refusal;
pub mod shard;
pub mod sink;
pub mod zarr;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks a value. It is valid even after the panic of another thread, because locked values change in one step.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod damage;
#[cfg(test)]
pub(crate) mod fixture;

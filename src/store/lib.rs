//! Storage of slices: Zarr v3 stores, probes, merges and shards, and NumPy and OpenEXR files.

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

#[cfg(test)]
mod damage;

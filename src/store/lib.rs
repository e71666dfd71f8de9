//! Slices on disk, and what is done with them there: Zarr v3 stores, probing, merging, NumPy's and OpenEXR's files.

pub mod exr;
pub mod merge;
pub mod numpy;
pub mod probe;
pub mod sink;
pub mod zarr;

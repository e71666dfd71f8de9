//! Creates new stores. First checks the slices, and then writes all metadata before any values.

use super::atomic::AtomicDirectory;
use super::check;
use super::chunked::{ChunkedArray, Description};
use super::describe;
use super::error::CreateError;
use super::shard_grid::Shardings;
use serde_json::{Map, Value};
use std::path::Path;
use std::sync::Arc;
use tensor::axes::SliceLayout;

/// The grid of the sample counts per camera pixel (array `samples`, u32 over y, x).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleGrid {
    pub camera: [u32; 2],
    /// Edge length of a tile in camera pixels. A chunk is one tile.
    pub tile: u32,
}

impl SampleGrid {
    /// Returns the grid of sample counts with the given shape and chunk shape, both as (rows, columns).
    pub(crate) fn new(shape: [u64; 2], chunk: [u64; 2]) -> Self {
        Self { camera: [shape[1] as u32, shape[0] as u32], tile: chunk[0].max(chunk[1]) as u32 }
    }
}

/// Name of the file that contains the origin of a store while the store is being created. The name begins
/// with a dot, so the file is not part of the store.
pub(super) const ORIGIN: &str = ".sunstone-origin";

pub(super) fn check_slices(slices: &[(SliceLayout, Map<String, Value>)]) -> Result<(), CreateError> {
    for (i, (layout, attributes)) in slices.iter().enumerate() {
        let fault = |reason: &str| CreateError::Slice { name: layout.name.clone(), reason: reason.into() };
        if let Some(reason) = describe::name_fault(&layout.name) {
            return Err(fault(reason));
        }
        if slices[..i].iter().any(|(other, _)| other.name == layout.name) {
            return Err(fault("two slices have this name: rename one of the slices"));
        }
        for axis in &layout.axes {
            if axis.is_empty() {
                let name = axis.kind.name();
                return Err(fault(&format!("axis `{name}` has no entries: keep at least one entry")));
            }
            if axis.chunk == 0 {
                let name = axis.kind.name();
                return Err(fault(&format!("the chunk length of axis `{name}` is 0: use at least 1")));
            }
            if let Some(reason) = check::coordinates_fault(axis) {
                return Err(fault(&format!("axis `{}`: {reason}", axis.kind.name())));
            }
        }
        if let Some(reason) = check::time_fault(layout).or_else(|| check::slice_fault(attributes)) {
            return Err(fault(&reason));
        }
    }
    Ok(())
}

/// The content of a new store.
#[derive(Clone, Copy)]
pub(super) struct New<'a> {
    pub(super) slices: &'a [(SliceLayout, Map<String, Value>)],
    pub(super) attributes: &'a Map<String, Value>,
    pub(super) samples: Option<SampleGrid>,
    pub(super) shardings: &'a Shardings,
}

pub(super) fn build(path: &Path, new: New) -> Result<(), CreateError> {
    let New { slices, attributes, samples, shardings } = new;
    let names: Vec<String> = slices.iter().map(|(layout, _)| layout.name.clone()).collect();
    describe::create_root(path, &names, attributes)?;
    let storage = Arc::new(AtomicDirectory::new(path));
    if let Some(SampleGrid { camera: [w, h], tile }) = samples {
        let chunk = |n: u32| u64::from(tile.clamp(1, n.max(1)));
        let attributes = describe::labelled("1", "samples that count per camera pixel");
        let description = Description {
            shape: vec![u64::from(h), u64::from(w)],
            chunk: vec![chunk(h), chunk(w)],
            // In `xarray.open_datatree`, dimensions of the root apply to all groups. A slice may cover only a
            // part of the camera, so the dimensions of the sample counts must not be named `y` and `x`.
            names: vec!["camera_y", "camera_x"],
            attributes,
            sharding: shardings.get("samples").cloned(),
        };
        ChunkedArray::<u32>::create(&storage, "/samples", description)?;
    }
    for (layout, attributes) in slices {
        describe::create_slice(&storage, layout, attributes, shardings)?;
    }
    describe::consolidate(path, &names).map_err(|e| CreateError::write(path, e))
}

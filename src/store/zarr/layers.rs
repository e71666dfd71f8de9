//! Stores ground-truth layers on disk, as a Zarr v3 group that `xarray.open_zarr(path)` opens directly.
//!
//! The group contains one array per layer over `y` and `x`. Layers with several numbers per pixel have the
//! additional axis `vector` (x, y, z) or `wavelength`. Each axis has a coordinate array. The attribute
//! `labels` of an array of object numbers or material numbers lists the names of the objects or materials.
//! The group is written atomically. The group has a manifest, as stores of slices have, so that `verify`
//! accepts the group.

use super::atomic::AtomicDirectory;
use super::chunked::{Description, Number};
use super::describe::{create_filled, group_json, inline, labelled};
use super::description::{read_json, write_json};
use super::error::CreateError;
use super::manifest::Manifest;
use base::lock::Lock;
use base::staging;
use serde_json::{Map, Value, json};
use std::path::Path;
use std::sync::Arc;
use tensor::layers::{Layer, LayerSet, LayerValues, Parts};

/// Name of the group attribute that lists the layers.
const LAYERS: &str = "layers";

/// Maximum edge length of a chunk, in pixels.
const CHUNK: u64 = 512;

/// Writes layers and attributes of the group. If `replace` is true, existing layers at the path are replaced.
/// Any other content at the path is refused.
///
/// # Errors
/// Returns [`CreateError`] if the path exists and may not be replaced, or writing fails.
pub fn write_layers(
    path: &Path,
    set: &LayerSet,
    attributes: &Map<String, Value>,
    replace: bool,
) -> Result<(), CreateError> {
    let path = path.to_owned();
    let exists = || std::fs::symlink_metadata(&path).is_ok();
    if exists() && !replace {
        return Err(CreateError::Exists { path });
    }
    let _lock = Lock::take(&path).map_err(|e| CreateError::locked(&path, e))?;
    let io = |e: std::io::Error| CreateError::Write { path: path.clone(), cause: e.to_string() };
    staging::recover(&path).map_err(io)?;
    if exists() && !replace {
        return Err(CreateError::Exists { path });
    }
    if exists() && !holds_layers(&path) {
        return Err(CreateError::NotAStore { path });
    }
    let part = staging::part_of(&path);
    staging::remove(&part).map_err(io)?;
    let made = fill(&part, set, attributes)
        .and_then(|()| Manifest::write(&part).map_err(io))
        .and_then(|()| staging::put(&part, &path).map_err(io));
    if made.is_err() {
        let _ = staging::remove(&part);
    }
    made
}

/// Returns whether [`write_layers`] wrote the group at a path.
fn holds_layers(path: &Path) -> bool {
    read_json(&path.join("zarr.json")).is_ok_and(|json| json["attributes"][LAYERS].is_array())
}

/// Writes the group's attributes, arrays and consolidated metadata.
fn fill(root: &Path, set: &LayerSet, attributes: &Map<String, Value>) -> Result<(), CreateError> {
    let mut attributes = attributes.clone();
    let names: Vec<&str> = set.layers.iter().map(|l| l.name).collect();
    attributes.insert(LAYERS.into(), json!(names));
    let mut group = group_json(&attributes);
    write_json(&root.join("zarr.json"), &group)?;
    let storage = Arc::new(AtomicDirectory::new(root));
    let [w, h] = set.size;
    let pixels = |n: u32| (0..n).map(f64::from).collect::<Vec<_>>();
    let is_used = |parts| set.layers.iter().any(|l| l.parts == parts);
    coordinate(&storage, "y", "pixel", "camera row (pixel centre)", &pixels(h), None)?;
    coordinate(&storage, "x", "pixel", "camera column (pixel centre)", &pixels(w), None)?;
    let mut all = vec!["y", "x"];
    if is_used(Parts::Vector) {
        let labels = json!(["x", "y", "z"]);
        coordinate(&storage, "vector", "1", "coordinate, world", &[0_i64, 1, 2], Some(labels))?;
        all.push("vector");
    }
    if is_used(Parts::Wavelengths) {
        let nm = &set.wavelengths_nm;
        coordinate(&storage, "wavelength", "nm", "vacuum wavelength", nm, None)?;
        all.push("wavelength");
    }
    for layer in &set.layers {
        match &layer.values {
            LayerValues::Real(values) => array(&storage, set, layer, values)?,
            LayerValues::Number(values) => array(&storage, set, layer, values)?,
        }
        all.push(layer.name);
    }
    let mut metadata = Map::new();
    for name in all {
        let at = root.join(name).join("zarr.json");
        let json = read_json(&at).map_err(|e| CreateError::write(&at, e))?;
        metadata.insert(name.into(), json);
    }
    group["consolidated_metadata"] = inline(metadata);
    write_json(&root.join("zarr.json"), &group)
}

fn describe(units: &str, long_name: &str, labels: Option<Value>) -> Map<String, Value> {
    let mut attributes = labelled(units, long_name);
    if let Some(labels) = labels {
        attributes.insert("labels".into(), labels);
    }
    attributes
}

fn coordinate<T: Number>(
    storage: &Arc<AtomicDirectory>,
    name: &str,
    units: &str,
    long_name: &str,
    values: &[T],
    labels: Option<Value>,
) -> Result<(), CreateError> {
    let n = values.len() as u64;
    let description = Description {
        shape: vec![n],
        chunk: vec![n],
        names: vec![name],
        attributes: describe(units, long_name, labels),
        sharding: None,
    };
    create_filled(storage, &format!("/{name}"), description, values)
}

fn array<T: Number>(
    storage: &Arc<AtomicDirectory>,
    set: &LayerSet,
    layer: &Layer,
    values: &[T],
) -> Result<(), CreateError> {
    let shape = set.shape(layer);
    let mut names = vec!["y", "x"];
    match layer.parts {
        Parts::One => {}
        Parts::Vector => names.push("vector"),
        Parts::Wavelengths => names.push("wavelength"),
    }
    let description = Description {
        chunk: shape.iter().map(|n| (*n).min(CHUNK)).collect(),
        shape,
        names,
        attributes: describe(layer.units, layer.long_name, layer.labels.as_ref().map(|l| json!(l))),
        sharding: None,
    };
    create_filled(storage, &format!("/{}", layer.name), description, values)
}

//! Reads and writes the Zarr v3 metadata of a store: groups, coordinate arrays and consolidated metadata.
//!
//! The directory follows the Zarr v3 core specification, and `xarray`'s conventions for names and
//! coordinates. The root contains the root group (`zarr.json`) and the array `samples/`. A slice consists of:
//! - `NAME/zarr.json`, the group.
//! - `NAME/{mean,std_error}/`.
//! - `NAME/{overflow,overflow_std_error}/` if time is resolved.
//! - `NAME/total_std_error/` for renders.
//! - One coordinate array per axis.
//!
//! All arrays except coordinates may be sharded. Each group contains `consolidated_metadata` in the inline
//! form of zarr-python 3, so that readers open the group with one read.

use std::path::Path;
use std::sync::Arc;

use serde_json::{Map, Value, json};

use super::atomic::AtomicDirectory;
use super::check;
use super::chunked::{ChunkedArray, Description, Number};
use super::coordinates;
use super::description::{read_json, to_bytes, write_json};
use super::error::{CreateError, OpenError};
use super::shard_grid::Shardings;
use crate::place::Ask;
use base::whole_file;
use tensor::axes::{Axis, AxisKind, SliceLayout};
use tensor::field::Field;
use tensor::label;

pub const VALUE_UNITS: &str = "W m-2 sr-1 nm-1 per unit projector drive";
/// Name of the root attribute that lists the slices.
const SLICES: &str = "slices";
/// Maximum number of coordinates of an axis in a valid store.
const MAX_AXIS: u64 = 1 << 24;

/// Returns the fault in a slice's name, if any.
pub(super) fn name_fault(name: &str) -> Option<&'static str> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
    if name.is_empty() {
        Some("a name must not be empty")
    } else if !name.chars().all(plain) {
        Some("a name may contain only letters, digits, `_`, `-` and `.`")
    } else if name.starts_with('.') || name.starts_with("__") {
        Some("a name must not begin with `.` or `__`")
    } else if ["samples", "zarr.json", "c"].contains(&name) {
        Some("this name is reserved for the store's own arrays")
    } else {
        None
    }
}

pub(super) fn group_json(attributes: &Map<String, Value>) -> Value {
    json!({"zarr_format": 3, "node_type": "group", "attributes": attributes})
}

/// Returns consolidated metadata in the inline form of zarr-python 3.
pub(super) fn inline(metadata: Map<String, Value>) -> Value {
    json!({"kind": "inline", "must_understand": false, "metadata": metadata})
}

/// Returns the attributes `units` and `long_name` of an array.
pub(super) fn labelled(units: &str, long_name: &str) -> Map<String, Value> {
    Map::from_iter([("units".to_owned(), json!(units)), ("long_name".to_owned(), json!(long_name))])
}

/// Returns the attributes of a group's metadata, or `None` if the attributes are not a table.
pub(super) fn attributes_of(json: &Value) -> Option<Map<String, Value>> {
    match json.get("attributes") {
        None => Some(Map::new()),
        Some(value) => value.as_object().cloned(),
    }
}

/// Returns the names of the slices from the root's metadata, or `None` if the metadata does not belong to a
/// Sunstone store.
pub(super) fn slice_names_of(json: &Value) -> Option<Vec<String>> {
    let names = json["attributes"][SLICES].as_array()?;
    names.iter().map(|n| n.as_str().filter(|n| name_fault(n).is_none()).map(str::to_owned)).collect()
}

pub(super) fn create_root(
    root: &Path,
    names: &[String],
    attributes: &Map<String, Value>,
) -> Result<(), CreateError> {
    let mut attributes = attributes.clone();
    attributes.insert(SLICES.into(), json!(names));
    write_json(&root.join("zarr.json"), &group_json(&attributes))
}

/// Writes the group of a slice with all its arrays, whose values are zero.
pub(super) fn create_slice(
    storage: &Arc<AtomicDirectory>,
    layout: &SliceLayout,
    attributes: &Map<String, Value>,
    shardings: &Shardings,
) -> Result<(), CreateError> {
    let name = &layout.name;
    let mut attributes = attributes.clone();
    if let Some((start_ps, bin_ps)) = layout.time {
        attributes.insert("time_start_ps".into(), json!(start_ps));
        attributes.insert("time_bin_ps".into(), json!(bin_ps));
    }
    write_json(&storage.root.join(name).join("zarr.json"), &group_json(&attributes))?;
    for axis in &layout.axes {
        create_coordinates(storage, name, axis, !shardings.is_empty())?;
    }
    for field in Field::ALL {
        let Some(layout) = field.layout_in(layout) else {
            continue;
        };
        let description = Description {
            shape: layout.shape(),
            chunk: layout.chunk_shape(),
            names: layout.axes.iter().map(|a| a.kind.name()).collect(),
            attributes: labelled(VALUE_UNITS, field.long_name()),
            sharding: shardings.get(&format!("{name}/{}", field.name())).cloned(),
        };
        ChunkedArray::<f32>::create(storage, &format!("/{name}/{}", field.name()), description)?;
    }
    Ok(())
}

/// Returns whether the coordinates of an axis are stored as integers.
fn is_index(kind: AxisKind) -> bool {
    matches!(
        kind,
        AxisKind::Bounces | AxisKind::Component | AxisKind::Label | AxisKind::StokesOut | AxisKind::StokesIn
    )
}

/// Writes the coordinates of an axis. If `tell` is true, the metadata also contains the coordinates.
fn create_coordinates(
    storage: &Arc<AtomicDirectory>,
    slice: &str,
    axis: &Axis,
    tell: bool,
) -> Result<(), CreateError> {
    let kind = axis.kind;
    let mut attributes = labelled(kind.units(), kind.long_name());
    match kind {
        AxisKind::StokesOut | AxisKind::StokesIn => {
            attributes.insert("labels".into(), json!(["s0", "s1", "s2", "s3"]));
        }
        AxisKind::Component => {
            attributes.insert("labels".into(), json!(["direct", "indirect"]));
        }
        AxisKind::Label => {
            // Write the bits as the CF conventions specify, and the name of every combination of bits.
            let (masks, names): (Vec<u8>, Vec<&str>) = label::BITS.into_iter().unzip();
            attributes.insert("flag_masks".into(), json!(masks));
            attributes.insert("flag_meanings".into(), json!(names.join(" ")));
            let sets: Vec<String> = axis.coords.iter().map(|c| label::name(*c as u8)).collect();
            attributes.insert("labels".into(), json!(sets));
        }
        _ => {}
    }
    attributes.extend(tell.then(|| coordinates::describe(&axis.coords)).flatten());
    let node = format!("/{slice}/{}", kind.name());
    let description = Description {
        shape: vec![axis.len()],
        chunk: vec![axis.len()],
        names: vec![kind.name()],
        attributes,
        sharding: None,
    };
    if is_index(kind) {
        let values: Vec<i64> = axis.coords.iter().map(|&c| c as i64).collect();
        create_filled(storage, &node, description, &values)
    } else {
        create_filled(storage, &node, description, &axis.coords)
    }
}

/// Creates an array with the given values at `node`.
pub(super) fn create_filled<T: Number>(
    storage: &Arc<AtomicDirectory>,
    node: &str,
    description: Description,
    values: &[T],
) -> Result<(), CreateError> {
    let shape = description.shape.clone();
    let array = ChunkedArray::<T>::create(storage, node, description)?;
    let written = array.write(&vec![0; shape.len()], &shape, values, None);
    written.map_err(|e| CreateError::write(&array.path, e))
}

/// Reads and checks the coordinates of an axis, which must have `expected` entries and has chunks of `chunk`
/// entries.
fn read_axis(
    storage: &Arc<AtomicDirectory>,
    slice: &str,
    kind: AxisKind,
    [expected, chunk]: [u64; 2],
) -> Result<Axis, OpenError> {
    let node = format!("/{slice}/{}", kind.name());
    let checked = |coords: Vec<f64>| {
        let axis = Axis { kind, coords, chunk };
        match check::coordinates_fault(&axis) {
            Some(reason) => Err(OpenError::damaged(&storage.root.join(slice).join(kind.name()), reason)),
            None => Ok(axis),
        }
    };
    if is_index(kind) {
        checked(read_coordinates::<i64>(storage, &node, expected, |v| v as f64)?)
    } else {
        checked(read_coordinates::<f64>(storage, &node, expected, |v| v)?)
    }
}

/// Reads `expected` coordinates from the metadata of the coordinate array. If the metadata does not contain
/// them, reads the array's values.
fn read_coordinates<T: Number>(
    storage: &Arc<AtomicDirectory>,
    node: &str,
    expected: u64,
    convert: impl Fn(T) -> f64,
) -> Result<Vec<f64>, OpenError> {
    let array = ChunkedArray::<T>::open(storage, node)?;
    let n = match array.shape() {
        [n] if *n == expected && (1..=MAX_AXIS).contains(n) => *n,
        shape => {
            let reason = format!("the array has shape {shape:?}, but the axis has {expected} entries");
            return Err(OpenError::damaged(&array.path, reason));
        }
    };
    if let Some(coords) = array.describe(n) {
        return Ok(coords);
    }
    let values = array.read(&[0], &[n]).map_err(|e| OpenError::damaged(&array.path, e))?;
    Ok(values.into_iter().map(convert).collect())
}

/// Reconstructs the layout of a slice from its `mean` array, its coordinate arrays and its attributes.
pub(super) fn read_layout(
    storage: &Arc<AtomicDirectory>,
    slice: &str,
    mean: &ChunkedArray<f32>,
    attributes: &Map<String, Value>,
) -> Result<SliceLayout, OpenError> {
    let damaged = |reason: String| OpenError::Damaged { path: mean.path.clone(), reason };
    let names = mean.names();
    if names.len() != mean.shape().len() {
        return Err(damaged(format!(
            "the array has {} dimension names, but {} dimensions",
            names.len(),
            mean.shape().len()
        )));
    }
    let coordinates = names.iter().filter(|n| !storage.tells(&format!("{slice}/{n}")));
    let coordinates = coordinates.map(|n| (format!("{slice}/{n}/c.0"), Ask::Whole));
    let fetched = storage.fetch_ahead(&coordinates.collect::<Vec<_>>());
    fetched.map_err(|e| OpenError::of_read(&mean.path, &e))?;
    let mut axes: Vec<Axis> = Vec::new();
    for (i, name) in names.iter().enumerate() {
        let kind = AxisKind::from_name(name)
            .ok_or_else(|| damaged(format!("the array has an unknown dimension `{name}`")))?;
        let order = |k: AxisKind| AxisKind::ALL.iter().position(|a| *a == k);
        if axes.last().is_some_and(|last| order(last.kind) >= order(kind)) {
            return Err(damaged(format!("the dimensions {names:?} are not in storage order")));
        }
        axes.push(read_axis(storage, slice, kind, [mean.shape()[i], mean.chunk[i]])?);
    }
    let number = |key: &str| match attributes.get(key) {
        None => Ok(None),
        Some(value) => value.as_f64().map(Some).ok_or_else(|| {
            damaged(format!("the attribute `{key}` of the slice is {value}, expected a number"))
        }),
    };
    let (start, bin) = (number("time_start_ps")?, number("time_bin_ps")?);
    let layout = SliceLayout {
        name: slice.to_owned(),
        axes,
        time: start.zip(bin),
        // Stores of earlier versions have no errors of totals.
        totals: storage.has_node(&format!("{slice}/{}", Field::TotalStdError.name())),
    };
    match check::time_fault(&layout) {
        Some(reason) => Err(damaged(reason)),
        None => Ok(layout),
    }
}

/// Replaces the attributes of the root group, except the list of slices and the consolidated metadata.
pub(super) fn set_root_attributes(
    storage: &AtomicDirectory,
    attributes: &Map<String, Value>,
) -> Result<(), OpenError> {
    let mut json = storage.json("zarr.json")?;
    let names = json["attributes"][SLICES].clone();
    let mut attributes = attributes.clone();
    attributes.insert(SLICES.into(), names);
    json["attributes"] = Value::Object(attributes);
    storage
        .write("zarr.json", to_bytes(&json).into())
        .map_err(|e| OpenError::of_write(&storage.root.join("zarr.json"), &e))
}

/// Writes inline consolidated metadata into the root group and the group of every slice.
pub(super) fn consolidate(root: &Path, names: &[String]) -> Result<(), OpenError> {
    let write = |path: &Path, json: &Value| {
        whole_file::write(path, &to_bytes(json)).map_err(|e| OpenError::io(path, e))
    };
    let mut below_root = Map::new();
    if root.join("samples/zarr.json").is_file() {
        below_root.insert("samples".into(), read_json(&root.join("samples/zarr.json"))?);
    }
    for name in names {
        let directory = root.join(name);
        let mut group = read_json(&directory.join("zarr.json"))?;
        let mut below_group = Map::new();
        let mut children: Vec<String> = std::fs::read_dir(&directory)
            .map_err(|e| OpenError::io(&directory, e))?
            .filter_map(|e| e.ok()?.file_name().into_string().ok())
            .filter(|child| directory.join(child).join("zarr.json").is_file())
            .collect();
        children.sort();
        for child in children {
            let json = read_json(&directory.join(&child).join("zarr.json"))?;
            below_root.insert(format!("{name}/{child}"), json.clone());
            below_group.insert(child, json);
        }
        group["consolidated_metadata"] = inline(below_group);
        write(&directory.join("zarr.json"), &group)?;
        group["consolidated_metadata"] = inline(Map::new());
        below_root.insert(name.clone(), group);
    }
    let path = root.join("zarr.json");
    let mut json = read_json(&path)?;
    json["consolidated_metadata"] = inline(below_root);
    write(&path, &json)
}

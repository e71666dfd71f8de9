//! Describes stores for the page: axes, coordinates and attributes. `page/src/model.ts` defines the structure.

use crate::error::ViewError;
use crate::frames::columns;
use crate::open::Shown;
use serde_json::{Value, json};
use store::zarr::VALUE_UNITS;
use tensor::axes::Axis;

/// Attributes of the root that the page does not use, because they are long.
const LEFT_OUT: [&str; 3] = ["scene", "figures", "slices"];

/// Returns the description of all stores.
pub(crate) fn describe(stores: &[Shown], is_static: bool) -> Result<Value, ViewError> {
    let all: Vec<Value> =
        stores.iter().enumerate().map(|(id, shown)| store(id, shown)).collect::<Result<_, _>>()?;
    Ok(json!({
        "version": env!("CARGO_PKG_VERSION"),
        "stores": all,
        "isStatic": is_static,
        "valueUnits": VALUE_UNITS,
    }))
}

fn store(id: usize, shown: &Shown) -> Result<Value, ViewError> {
    let path = shown.path.display().to_string();
    let name = shown.path.file_name().map_or(path.clone(), |n| n.to_string_lossy().into_owned());
    if shown.is_captures {
        let frames = shown.frames()?;
        let layout = frames.layout();
        let axes: Vec<Value> = layout
            .axes
            .iter()
            .map(|a| json!({"name": a.name, "units": a.units, "coords": a.coords}))
            .collect();
        let captures = json!({"axes": axes, "runAxes": layout.run_axes, "columns": columns(&frames)});
        return Ok(json!({
            "id": id, "name": name, "path": path, "kind": "captures", "finished": true,
            "attributes": frames.attributes(), "slices": [], "captures": captures,
        }));
    }
    let store = shown.tensor()?;
    let mut attributes = store.attributes();
    attributes.retain(|key, _| !LEFT_OUT.contains(&key.as_str()));
    let mut slices = vec![];
    for name in store.slice_names() {
        let slice = store.slice(name)?;
        slices.push(json!({
            "name": name,
            "axes": axes(&slice.layout().axes),
            "attributes": slice.attributes(),
        }));
    }
    Ok(json!({
        "id": id, "name": name, "path": path, "kind": "tensor", "finished": store.is_finished(),
        "attributes": attributes, "slices": slices,
    }))
}

/// Returns axes with their units and coordinates.
pub(crate) fn axes(axes: &[Axis]) -> Value {
    axes.iter().map(|a| json!({"kind": a.kind.name(), "units": a.kind.units(), "coords": a.coords})).collect()
}

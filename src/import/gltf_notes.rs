//! Notes about unused contents of a glTF document: extensions, and keys that the importer does not read.

use gltf::json::Value;

use super::error::ImportError;
use super::notes::Notes;

pub(super) const INSTANCING: &str = "EXT_mesh_gpu_instancing";
pub(super) const VISIBILITY: &str = "KHR_node_visibility";

/// Extensions that the mesh importer or the material reader supports.
const READ: [&str; 7] =
    [DRACO, INSTANCING, VISIBILITY, MESHOPT[0], MESHOPT[1], "KHR_mesh_quantization", "KHR_texture_transform"];

/// Extensions that compress buffer views.
pub(super) const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
pub(super) const DRACO: &str = "KHR_draco_mesh_compression";

/// Prefixes of extensions that do not affect triangles.
const NO_GEOMETRY: [&str; 14] = [
    "KHR_materials_",
    "EXT_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "MSFT_texture_",
    "MSFT_packing_",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_xmp",
    "KHR_animation_",
    "KHR_audio",
    "KHR_physics_",
    "KHR_techniques_webgl",
    "AGI_",
];

/// Known keys of each kind of object. The lists contain the keys that are read and the keys that do not
/// affect surfaces. Names, bounds of the data and the application-specific `extras` do not affect surfaces.
const KEYS: [(&str, &[&str]); 7] = [
    ("scenes", &["name", "nodes"]),
    ("nodes", &["name", "children", "mesh", "skin", "weights", "matrix", "translation", "rotation", "scale"]),
    ("meshes", &["name", "primitives", "weights"]),
    (
        "accessors",
        &[
            "name",
            "bufferView",
            "byteOffset",
            "componentType",
            "normalized",
            "count",
            "type",
            "min",
            "max",
            "sparse",
        ],
    ),
    ("bufferViews", &["name", "buffer", "byteOffset", "byteLength", "byteStride", "target"]),
    ("buffers", &["name", "uri", "byteLength"]),
    ("skins", &["name", "joints", "inverseBindMatrices", "skeleton"]),
];

/// Known top-level keys of the document. Materials and their parts are checked separately.
const TOP: [&str; 13] = [
    "asset",
    "scene",
    "scenes",
    "nodes",
    "meshes",
    "accessors",
    "bufferViews",
    "buffers",
    "skins",
    "materials",
    "textures",
    "images",
    "samplers",
];

/// Attributes of morph targets. Tangents are not read, because the other attributes determine them.
const TARGET: [&str; 3] = ["POSITION", "NORMAL", "TANGENT"];

const PRIMITIVE: [&str; 5] = ["attributes", "indices", "material", "mode", "targets"];

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// Adds notes about contents that are not used.
///
/// # Errors
/// Returns [`ImportError`] if the document requires an extension that can affect its triangles.
pub(super) fn read(document: &Value, notes: &mut Notes) -> Result<(), ImportError> {
    let names = |key: &str| -> Vec<&str> { list(&document[key]).iter().filter_map(Value::as_str).collect() };
    let is_known = |name: &str| READ.contains(&name) || NO_GEOMETRY.iter().any(|n| name.starts_with(n));
    for name in names("extensionsRequired") {
        if !is_known(name) {
            let what = format!("the file requires the unsupported extension {name}");
            return Err(ImportError::new(what, "export the file again without the extension"));
        }
    }
    let mut account = Account { notes };
    if let Some(top) = document.as_object() {
        for (key, value) in top {
            let is_read = TOP.contains(&key.as_str()) || key.starts_with("extensions") || key == "extras";
            let size = value.as_array().map_or(1, Vec::len);
            if !is_read && size > 0 {
                let more = if key == "animations" { ": the rest pose is imported" } else { "" };
                account.notes.add(format!("`{key}` is not used{more}"));
            }
        }
    }
    account.object(&document["asset"], "asset", &["version", "minVersion", "generator", "copyright"]);
    account.extensions(document, "the document");
    for (kind, keys) in KEYS {
        for item in list(&document[kind]) {
            account.object(item, kind, keys);
            for primitive in list(&item["primitives"]) {
                account.object(primitive, "primitives", &PRIMITIVE);
                let keys = ["bufferView", "attributes"];
                account.object(&primitive["extensions"][DRACO], DRACO, &keys);
                account.attributes(&primitive["attributes"]);
                for target in list(&primitive["targets"]) {
                    account.object(target, "targets", &TARGET);
                }
            }
            if let Some(sparse) = item.get("sparse") {
                account.object(sparse, "sparse", &["count", "indices", "values"]);
                account.object(&sparse["indices"], "indices", &["bufferView", "byteOffset", "componentType"]);
                account.object(&sparse["values"], "values", &["bufferView", "byteOffset"]);
            }
            let read = [(INSTANCING, "attributes"), (VISIBILITY, "visible")];
            for (name, key) in read {
                account.object(&item["extensions"][name], name, &[key]);
            }
            for name in MESHOPT {
                let keys = [
                    "buffer",
                    "byteOffset",
                    "byteLength",
                    "byteStride",
                    "count",
                    "mode",
                    "filter",
                    "fallback",
                ];
                account.object(&item["extensions"][name], name, &keys);
            }
            account.object(
                &item["extensions"][INSTANCING]["attributes"],
                INSTANCING,
                &["TRANSLATION", "ROTATION", "SCALE"],
            );
        }
    }
    Ok(())
}

struct Account<'a> {
    notes: &'a mut Notes,
}

impl Account<'_> {
    fn object(&mut self, item: &Value, kind: &str, keys: &[&str]) {
        for key in item.as_object().into_iter().flat_map(|o| o.keys()) {
            let is_read = keys.contains(&key.as_str()) || ["extensions", "extras"].contains(&key.as_str());
            if !is_read {
                self.notes.add(format!("`{key}` of `{kind}` is not used"));
            }
        }
        self.extensions(item, &format!("`{kind}`"));
    }

    fn extensions(&mut self, item: &Value, place: &str) {
        for name in item["extensions"].as_object().into_iter().flat_map(|o| o.keys()) {
            if !READ.contains(&name.as_str()) {
                self.notes.add(format!("the extension {name} of {place} is not used"));
            }
        }
    }

    fn attributes(&mut self, attributes: &Value) {
        for name in attributes.as_object().into_iter().flat_map(|o| o.keys()) {
            let is_read = ["POSITION", "NORMAL", "TEXCOORD_0"].contains(&name.as_str())
                || name.starts_with("JOINTS_")
                || name.starts_with("WEIGHTS_");
            // Tangents follow from normals and texture coordinates (section 3.7.2.1).
            if !is_read && name != "TANGENT" {
                self.notes.add(format!("the attribute {name} is not used"));
            }
        }
    }
}

//! Finds materials that depend on texture coordinates.

use base::locate::Located;
use std::collections::BTreeMap;
use syntax::material::MaterialFile;

/// Returns the names of the materials that read an image, themselves or through another material.
pub fn with_images(materials: &BTreeMap<String, Located<MaterialFile>>) -> Vec<&str> {
    let values: BTreeMap<&str, toml::Value> = materials
        .iter()
        .filter_map(|(name, m)| Some((name.as_str(), toml::Value::try_from(&**m).ok()?)))
        .collect();
    let reads = |name: &&str| reads_image(&values[name], &values, values.len());
    values.keys().copied().filter(|name| reads(name)).collect()
}

/// Returns whether a value contains an image, or the name of a material that reads an image. `depth` is the
/// maximum number of names to follow, because materials may refer to each other in a circle until they are
/// checked.
fn reads_image(value: &toml::Value, all: &BTreeMap<&str, toml::Value>, depth: usize) -> bool {
    match value {
        toml::Value::Table(table) => {
            table.contains_key("image") || table.values().any(|v| reads_image(v, all, depth))
        }
        toml::Value::Array(list) => list.iter().any(|v| reads_image(v, all, depth)),
        toml::Value::String(name) => {
            depth > 0 && all.get(name.as_str()).is_some_and(|m| reads_image(m, all, depth - 1))
        }
        _ => false,
    }
}

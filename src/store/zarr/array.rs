//! Reads and writes the metadata of an array, which is a `zarr.json` file (Zarr v3 core specification, "Array
//! metadata"). Only the features of Sunstone's stores are supported: a regular grid of chunks, fill value
//! zero, and the codecs of [`super::coding`]. Other features are refused.

use super::coding::{self, Coding, name};
use serde_json::{Map, Value, json};

/// Known keys of the metadata. Other keys are allowed if their values contain `must_understand: false`.
const KEYS: [&str; 11] = [
    "zarr_format",
    "node_type",
    "shape",
    "data_type",
    "chunk_grid",
    "chunk_key_encoding",
    "fill_value",
    "codecs",
    "attributes",
    "storage_transformers",
    "dimension_names",
];

/// Parsed metadata of an array.
#[derive(Clone, Debug)]
pub(super) struct Array {
    pub(super) shape: Vec<u64>,
    /// Shape of the block of elements in a file: a chunk or a shard.
    pub(super) stored: Vec<u64>,
    pub(super) coding: Coding,
    /// Shape of a chunk in a shard, or `None` if the array is not sharded.
    pub(super) inner: Option<Vec<u64>>,
    pub(super) attributes: Map<String, Value>,
    /// Name of each dimension, or "" for a dimension without a name.
    pub(super) names: Vec<String>,
    /// Prefix of all chunk keys.
    prefix: String,
    /// Separator between the chunk indices in a key.
    separator: char,
}

/// Returns the metadata of a new array. A file contains a chunk or, if `inner` is given, a shard of chunks of
/// shape `inner`. All files of an array are in one directory, because creating a directory per chunk would
/// take longer than writing the chunks.
pub(super) fn describe(
    [shape, stored]: [&[u64]; 2],
    inner: Option<&[u64]>,
    (data_type, zero): (&str, Value),
    names: &[&str],
    attributes: &Map<String, Value>,
) -> Value {
    json!({
        "zarr_format": 3,
        "node_type": "array",
        "shape": shape,
        "data_type": data_type,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": stored}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "."}},
        "fill_value": zero,
        "codecs": coding::describe(inner),
        "attributes": attributes,
        "dimension_names": names,
    })
}

impl Array {
    /// Parses the metadata of the array at `node`, such as `/steady/mean`. If the metadata is invalid,
    /// returns a description of the fault.
    pub(super) fn of(node: &str, data_type: &str, json: &Value) -> Result<Self, String> {
        let lengths =
            |json: &Value| -> Option<Vec<u64>> { json.as_array()?.iter().map(Value::as_u64).collect() };
        let keys = json.as_object().ok_or("the metadata is not a JSON object")?;
        for (key, value) in keys {
            if !KEYS.contains(&key.as_str()) && value["must_understand"] != false {
                return Err(format!("the metadata has an unknown key `{key}`"));
            }
        }
        if json["zarr_format"] != 3 || json["node_type"] != "array" {
            return Err(format!(
                "the metadata does not describe an array of Zarr format 3: `zarr_format` is {} and `node_type` is {}",
                json["zarr_format"], json["node_type"]
            ));
        }
        if name(&json["data_type"]) != Some(data_type) {
            return Err(format!("the data type is {}, expected {data_type}", json["data_type"]));
        }
        if !is_zero(&json["fill_value"]) {
            return Err(format!("the fill value is {}, expected 0", json["fill_value"]));
        }
        let transformers = json.get("storage_transformers").and_then(Value::as_array);
        if transformers.is_some_and(|list| !list.is_empty()) {
            return Err("storage transformers are not supported".into());
        }
        let shape = lengths(&json["shape"]).ok_or("the array has no shape")?;
        let grid = Some(&json["chunk_grid"]).filter(|grid| name(grid) == Some("regular"));
        let stored = grid.and_then(|grid| lengths(&grid["configuration"]["chunk_shape"]));
        let stored = stored.filter(|stored| stored.len() == shape.len());
        let stored = stored.ok_or_else(|| {
            format!("the chunk grid must be regular and match the dimensions, got {}", json["chunk_grid"])
        })?;
        let (coding, inner) = coding::of(&json["codecs"])?;
        let names = match json.get("dimension_names").and_then(Value::as_array) {
            None => vec![String::new(); shape.len()],
            Some(names) => names.iter().map(|n| n.as_str().unwrap_or_default().to_owned()).collect(),
        };
        if names.len() != shape.len() {
            return Err(format!(
                "the array has {} dimension names, but {} dimensions",
                names.len(),
                shape.len()
            ));
        }
        let keys = &json["chunk_key_encoding"];
        let (beginning, usual) = match name(keys) {
            Some("default") => ("c", '/'),
            Some("v2") => ("", '.'),
            _ => return Err(format!("the chunk key encoding must be `default` or `v2`, got {keys}")),
        };
        let separator = match keys["configuration"]["separator"].as_str() {
            None => usual,
            Some("/") => '/',
            Some(".") => '.',
            Some(other) => {
                return Err(format!("the separator of chunk keys is {other:?}, expected \"/\" or \".\""));
            }
        };
        let node = node.trim_start_matches('/');
        Ok(Self {
            shape,
            stored,
            coding,
            inner,
            attributes: json["attributes"].as_object().cloned().unwrap_or_default(),
            names,
            prefix: format!("{node}/{beginning}"),
            separator,
        })
    }

    /// Returns the path of a chunk's or shard's file relative to the root of the store.
    pub(super) fn chunk_key(&self, index: &[u64]) -> String {
        let mut key = self.prefix.clone();
        for number in index {
            if !key.ends_with('/') {
                key.push(self.separator);
            }
            key.push_str(&number.to_string());
        }
        // An array without dimensions has one chunk, whose key has no indices.
        if key.ends_with('/') {
            key.push('0');
        }
        key
    }
}

/// Returns whether a fill value is positive zero, that is, whether all its bits are zero.
fn is_zero(value: &Value) -> bool {
    match value {
        Value::Number(number) => number.as_f64().is_some_and(|x| x.to_bits() == 0),
        Value::String(bits) => bits
            .strip_prefix("0x")
            .is_some_and(|digits| !digits.is_empty() && digits.bytes().all(|b| b == b'0')),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn json() -> Value {
        let shape = [4, 6];
        let names = ["y", "x"];
        describe([&shape, &[2, 3]], None, ("float32", json!(0.0)), &names, &Map::new())
    }

    #[test]
    fn chunk_keys_follow_the_specification() {
        let key = |encoding: Value, index: &[u64]| {
            let mut json = json();
            json["chunk_key_encoding"] = encoding;
            Array::of("/a/mean", "float32", &json).map(|array| array.chunk_key(index))
        };
        // Section "Chunk key encoding": `default` has the prefix "c" and the separator "/" by default. `v2`
        // has no prefix and the separator ".".
        for (encoding, expected) in [
            (json!("default"), "a/mean/c/1/20"),
            (json!({"name": "default", "configuration": {"separator": "."}}), "a/mean/c.1.20"),
            (json!({"name": "v2"}), "a/mean/1.20"),
            (json!({"name": "v2", "configuration": {"separator": "/"}}), "a/mean/1/20"),
        ] {
            assert_eq!(key(encoding, &[1, 20]).as_deref(), Ok(expected));
        }
        assert_eq!(key(json!("default"), &[]).as_deref(), Ok("a/mean/c"));
        assert_eq!(key(json!("v2"), &[]).as_deref(), Ok("a/mean/0"));
        assert!(key(json!({"name": "default", "configuration": {"separator": "-"}}), &[]).is_err());
    }

    #[test]
    fn unsupported_metadata_is_refused() {
        let read = |key: &str, value: Value| {
            let mut json = json();
            json[key] = value;
            Array::of("/a", "float32", &json).map(|array| array.names)
        };
        assert_eq!(read("extra", json!({"must_understand": false})).unwrap(), ["y", "x"]);
        assert_eq!(read("dimension_names", json!([null, "x"])).unwrap(), ["", "x"]);
        assert_eq!(read("dimension_names", Value::Null).unwrap(), ["", ""]);
        assert!(read("fill_value", json!("0x00000000")).is_ok());
        for (key, value, word) in [
            ("extra", json!({}), "`extra`"),
            ("zarr_format", json!(2), "format 3"),
            ("node_type", json!("group"), "an array"),
            ("data_type", json!("float64"), "data type"),
            ("fill_value", json!(-0.0), "expected 0"),
            ("fill_value", json!(1), "expected 0"),
            ("fill_value", json!("NaN"), "expected 0"),
            ("fill_value", json!("0x80000000"), "expected 0"),
            ("storage_transformers", json!([{"name": "a"}]), "transformers"),
            ("shape", json!([4, -6]), "shape"),
            ("chunk_grid", json!({"name": "rectangular", "configuration": {"chunk_shape": [2, 3]}}), "grid"),
            ("chunk_grid", json!({"name": "regular", "configuration": {"chunk_shape": [2]}}), "grid"),
            ("dimension_names", json!(["y"]), "names"),
            ("codecs", json!(["bytes", "gzip"]), "codecs"),
            ("codecs", json!(["bytes"]), "endian"),
        ] {
            let message = read(key, value).unwrap_err();
            assert!(message.contains(word), "{key}: {message}");
        }
    }
}

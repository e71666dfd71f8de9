//! `[vary]`: named parameters of a scene file whose values differ between its variants.
//!
//! ```toml
//! [vary.milk]
//! path = "media.milk.milk.concentration"
//! values = [0, 0.0008, 0.0015]
//!
//! [vary.place]
//! path = "objects.doll.transform.translate"
//! range = { min = [-0.06, 0.006, -0.02], max = [-0.04, 0.006, 0] }
//! every = 3
//! ```
//!
//! Variant k uses the list entry ⌊k / every⌋, cyclically. For a range, one value is drawn uniformly for
//! each ⌊k / every⌋. The values of variant k do not depend on the rest of the file. [`crate::variant`]
//! substitutes the values.

use super::values::{any_of, schema};
use base::locate::Located;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::SeqAccessDeserializer;
use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;

/// A parameter: the values to replace and their replacements.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParameterFile {
    /// Path of the value to replace: dotted keys, as in TOML. List elements are addressed by their `name`, or
    /// by index from 0: `objects."the doll".transform.translate.0`. If `path` is a list, the values at all
    /// paths are replaced by the same value.
    pub path: Located<PathsFile>,
    /// Values of the variants, of the type that the path requires.
    pub values: Option<Located<Vec<AnyValue>>>,
    /// Range from which a number, or a list of numbers, is drawn uniformly.
    pub range: Option<Located<RangeFile>>,
    /// Number of consecutive variants that share a value. Default: 1.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    #[schemars(range(min = 1))]
    pub every: Located<u64>,
}

/// Bounds of the drawn numbers. The bounds are numbers, or lists of the same length as the value in the scene
/// file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RangeFile {
    /// Lower bound.
    pub min: AnyValue,
    /// Upper bound.
    pub max: AnyValue,
}

/// One path, or a list of several paths.
#[derive(Clone, Debug, PartialEq)]
pub struct PathsFile(pub Vec<String>);

/// Any TOML value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct AnyValue(pub toml::Value);

fn one() -> Located<u64> {
    1.into()
}

fn is_one(value: &Located<u64>) -> bool {
    **value == 1
}

schema!(AnyValue, "AnyValue", |_| json_schema!({"description": "A value that is valid at the path."}));

any_of!(PathsFile, "a path such as \"media.milk.milk.concentration\", or a list of paths", {
    fn visit_str<E: de::Error>(self, v: &str) -> Result<PathsFile, E> {
        Ok(PathsFile(vec![v.to_owned()]))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<PathsFile, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(seq)).map(PathsFile)
    }
});

impl Serialize for PathsFile {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match &self.0[..] {
            [one] => s.serialize_str(one),
            list => list.serialize(s),
        }
    }
}

schema!(
    PathsFile,
    "Paths",
    |_| json_schema!({"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]})
);

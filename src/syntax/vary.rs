//! `[vary]`: named parameters of a scene file, of which its variants have other values.
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
//! Variant k has entry ⌊k / every⌋ of the list (which begins again at its end), or is drawn from the range, evenly and for
//! every ⌊k / every⌋ anew; the same numbers for the same k, whatever else the file says. [`crate::variant`] puts them in.

use base::locate::Located;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;

/// A parameter: what it sets, and to what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParameterFile {
    /// Where in the file the value stands that it replaces: keys with dots between them, as in TOML. Things in lists go by their
    /// `name`, or count from 0: `objects."the doll".transform.translate.0`. Several places take the same value.
    pub path: Located<PathsFile>,
    /// A value for each variant in turn, all of the kind that stands there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub values: Option<Located<Vec<AnyValue>>>,
    /// A number, or a list of numbers, drawn evenly.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<Located<RangeFile>>,
    /// So many variants in a row have the same value.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    #[schemars(range(min = 1))]
    pub every: Located<u64>,
}

/// What numbers are drawn between: numbers, or lists of as many numbers as the scene's value has.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RangeFile {
    /// Least.
    pub min: AnyValue,
    /// Largest.
    pub max: AnyValue,
}

/// One path, or several.
#[derive(Clone, Debug, PartialEq)]
pub struct PathsFile(pub Vec<String>);

/// Any value that TOML knows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct AnyValue(pub toml::Value);

fn one() -> Located<u64> {
    1.into()
}

fn is_one(value: &Located<u64>) -> bool {
    **value == 1
}

impl JsonSchema for AnyValue {
    fn schema_name() -> Cow<'static, str> {
        "AnyValue".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({"description": "A value that is valid at the path."})
    }
}

impl<'de> Deserialize<'de> for PathsFile {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct V;
        impl<'de> Visitor<'de> for V {
            type Value = PathsFile;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a path such as \"media.milk.milk.concentration\", or a list of paths")
            }
            fn visit_str<E: de::Error>(self, v: &str) -> Result<PathsFile, E> {
                Ok(PathsFile(vec![v.to_owned()]))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<PathsFile, A::Error> {
                let mut list = vec![];
                while let Some(path) = seq.next_element()? {
                    list.push(path);
                }
                Ok(PathsFile(list))
            }
        }
        d.deserialize_any(V)
    }
}

impl Serialize for PathsFile {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match &self.0[..] {
            [one] => s.serialize_str(one),
            list => list.serialize(s),
        }
    }
}

impl JsonSchema for PathsFile {
    fn schema_name() -> Cow<'static, str> {
        "Paths".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]})
    }
}

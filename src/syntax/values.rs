//! Values of a scene file that can be written in more than one form.
//!
//! Each value has its own visitor, so that errors keep their location in the file. Serde's untagged enums
//! lose the location.

use base::locate::Located;
use base::spectral_table::SpectralTable;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{self, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;

/// Implements deserialization of a value with several forms. A method of a [`Visitor`] reads each form.
macro_rules! any_of {
    ($value:ident, $expected:literal, { $($visit:tt)* }) => {
        impl<'de> Deserialize<'de> for $value {
            fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
                struct V;
                impl<'de> Visitor<'de> for V {
                    type Value = $value;
                    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                        f.write_str($expected)
                    }
                    $($visit)*
                }
                d.deserialize_any(V)
            }
        }
    };
}
pub(super) use any_of;

/// Implements `JsonSchema` for a value: name and schema.
macro_rules! schema {
    ($value:ident, $name:literal, $schema:expr) => {
        impl JsonSchema for $value {
            fn schema_name() -> Cow<'static, str> {
                $name.into()
            }
            fn json_schema(generator: &mut SchemaGenerator) -> Schema {
                let schema: fn(&mut SchemaGenerator) -> Schema = $schema;
                schema(generator)
            }
        }
    };
}
pub(super) use schema;

/// Implements `From` for each form of a value.
macro_rules! from {
    ($($form:ty => $value:ident::$variant:ident,)*) => {
        $(impl From<$form> for $value {
            fn from(form: $form) -> Self {
                Self::$variant(form)
            }
        })*
    };
}
pub(super) use from;

/// A spectrum: one number for all wavelengths, a list with one number per wavelength, or a table.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum SpectrumFile {
    /// One number for all wavelengths.
    Scalar(f64),
    /// One number per wavelength of the file.
    PerWavelength(Vec<f64>),
    /// A table with its own wavelengths.
    Table(SpectrumTable),
}

/// A spectrum table: `{ nm = [400, 550, 700], values = [0.1, 0.2, 0.8] }`. Values are interpolated linearly
/// between entries and constant beyond them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpectrumTable {
    /// Vacuum wavelengths in nanometres, increasing.
    pub nm: Vec<f64>,
    /// One value per wavelength of `nm`.
    pub values: Vec<f64>,
}

impl SpectrumTable {
    /// Returns the table in a form that can be interpolated.
    pub fn table(&self) -> SpectralTable<'_> {
        SpectralTable { nm: &self.nm, values: &self.values }
    }
}

/// A refractive index: a spectrum, or a name of the optical constants.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum IndexFile {
    /// Refractive index as one number, one number per wavelength, or a table.
    Values(SpectrumFile),
    /// Name of a substance in the optical constants.
    Named(String),
}

/// Travel time of a slice: `"sum"` or bins.
#[derive(Clone, Debug, PartialEq)]
pub enum TimeFile {
    /// Sum over all travel times.
    Sum,
    /// Bins of travel time.
    Bins(TimeBins),
}

/// Bins of travel time: `{ start_ps, bin_ps, bins }`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TimeBins {
    /// Lower edge of the first bin in picoseconds. Default: 0.
    #[serde(default, skip_serializing_if = "is_default")]
    pub start_ps: f64,
    /// Bin width in picoseconds.
    pub bin_ps: Located<f64>,
    /// Number of bins.
    pub bins: Located<u32>,
}

/// A bin size: `n` or `[n_x, n_y]` pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BinSize(pub [u32; 2]);

pub(super) fn one() -> f64 {
    1.0
}

pub(super) fn is_one(value: &f64) -> bool {
    *value == 1.0
}

/// Returns true if a value equals the default of its type: `false`, 0 or empty.
pub(super) fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

from! { f64 => SpectrumFile::Scalar, Vec<f64> => SpectrumFile::PerWavelength, }

impl<const N: usize> From<[f64; N]> for SpectrumFile {
    fn from(list: [f64; N]) -> Self {
        Self::PerWavelength(list.into())
    }
}

impl<T: Into<SpectrumFile>> From<T> for IndexFile {
    fn from(spectrum: T) -> Self {
        Self::Values(spectrum.into())
    }
}

impl From<&str> for IndexFile {
    fn from(name: &str) -> Self {
        Self::Named(name.to_owned())
    }
}

pub(super) struct SpectrumVisitor;

impl<'de> Visitor<'de> for SpectrumVisitor {
    type Value = SpectrumFile;
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a number, a list with one number per wavelength, or { nm = [..], values = [..] }")
    }
    fn visit_f64<E: de::Error>(self, v: f64) -> Result<SpectrumFile, E> {
        Ok(SpectrumFile::Scalar(v))
    }
    fn visit_i64<E: de::Error>(self, v: i64) -> Result<SpectrumFile, E> {
        Ok(SpectrumFile::Scalar(v as f64))
    }
    fn visit_u64<E: de::Error>(self, v: u64) -> Result<SpectrumFile, E> {
        Ok(SpectrumFile::Scalar(v as f64))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<SpectrumFile, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(seq)).map(SpectrumFile::PerWavelength)
    }
    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<SpectrumFile, A::Error> {
        SpectrumTable::deserialize(MapAccessDeserializer::new(map)).map(SpectrumFile::Table)
    }
}

impl<'de> Deserialize<'de> for SpectrumFile {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        d.deserialize_any(SpectrumVisitor)
    }
}

schema!(SpectrumFile, "Spectrum", |g| {
    let table = g.subschema_for::<SpectrumTable>();
    json_schema!({
        "description": "One number for all wavelengths, a list with one number per wavelength, or a table.",
        "anyOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}}, table]
    })
});

any_of!(IndexFile, "a number, a list with one number per wavelength, or a name such as \"N-BK7\"", {
    fn visit_str<E: de::Error>(self, v: &str) -> Result<IndexFile, E> {
        Ok(IndexFile::Named(v.to_owned()))
    }
    fn visit_f64<E: de::Error>(self, v: f64) -> Result<IndexFile, E> {
        SpectrumVisitor.visit_f64(v).map(IndexFile::Values)
    }
    fn visit_i64<E: de::Error>(self, v: i64) -> Result<IndexFile, E> {
        SpectrumVisitor.visit_i64(v).map(IndexFile::Values)
    }
    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<IndexFile, A::Error> {
        SpectrumVisitor.visit_seq(seq).map(IndexFile::Values)
    }
    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<IndexFile, A::Error> {
        SpectrumVisitor.visit_map(map).map(IndexFile::Values)
    }
});

schema!(IndexFile, "RefractiveIndex", |g| {
    let spectrum = g.subschema_for::<SpectrumFile>();
    json_schema!({"anyOf": [spectrum, {"type": "string", "description": "The name of a material with built-in optical constants."}]})
});

any_of!(TimeFile, "\"sum\" or { start_ps, bin_ps, bins }", {
    fn visit_str<E: de::Error>(self, v: &str) -> Result<TimeFile, E> {
        match v {
            "sum" => Ok(TimeFile::Sum),
            _ => Err(E::invalid_value(de::Unexpected::Str(v), &self)),
        }
    }
    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<TimeFile, A::Error> {
        TimeBins::deserialize(MapAccessDeserializer::new(map)).map(TimeFile::Bins)
    }
});

impl Serialize for TimeFile {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Sum => s.serialize_str("sum"),
            Self::Bins(bins) => bins.serialize(s),
        }
    }
}

schema!(TimeFile, "Time", |g| {
    let bins = g.subschema_for::<TimeBins>();
    json_schema!({"anyOf": [{"const": "sum"}, bins]})
});

any_of!(BinSize, "an integer number of pixels n, or [n_x, n_y]", {
    fn visit_i64<E: de::Error>(self, v: i64) -> Result<BinSize, E> {
        u32::try_from(v)
            .map(|n| BinSize([n, n]))
            .map_err(|_| E::invalid_value(de::Unexpected::Signed(v), &self))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<BinSize, A::Error> {
        let missing = |n| de::Error::invalid_length(n, &"two integers [n_x, n_y]");
        let x = seq.next_element()?.ok_or_else(|| missing(0))?;
        let y = seq.next_element()?.ok_or_else(|| missing(1))?;
        match seq.next_element::<u32>()? {
            None => Ok(BinSize([x, y])),
            Some(_) => Err(missing(3)),
        }
    }
});

impl Serialize for BinSize {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            [x, y] if x == y => s.serialize_u32(x),
            size => size.serialize(s),
        }
    }
}

schema!(BinSize, "BinSize", |_| json_schema!({
    "description": "n or [n_x, n_y] pixels.",
    "anyOf": [
        {"type": "integer", "minimum": 1},
        {"type": "array", "items": {"type": "integer", "minimum": 1}, "minItems": 2, "maxItems": 2}
    ]
}));

//! Deserializes tables and never accepts a list in place of a table.
//!
//! Serde accepts a list for a struct, with the fields in order of declaration. For example, serde would read
//! `distortion = [0.1, 0.2, 0, 0, 0]` in an order that no user expects. [`Strict`] wraps a deserializer and
//! all values that are read through the deserializer. [`Strict`] refuses a list where a struct is expected.
//! The error has the list's location.

use serde::de::{
    self, DeserializeSeed, Deserializer, EnumAccess, Error, MapAccess, SeqAccess, Unexpected, VariantAccess,
    Visitor,
};
use std::fmt;

/// A deserializer, visitor or access object that refuses lists in place of tables.
pub struct Strict<T> {
    inner: T,
    /// Names of the fields, if a struct is expected.
    fields: Option<&'static [&'static str]>,
}

impl<T> Strict<T> {
    pub fn new(inner: T) -> Self {
        Self { inner, fields: None }
    }

    fn table(inner: T, fields: &'static [&'static str]) -> Self {
        Self { inner, fields: Some(fields) }
    }
}

/// Start of the error message for a list in place of a table.
pub const WANTED: &str = "expected a table, {";

/// The expected table in the error message, described by its field names.
struct Table(&'static [&'static str]);

impl de::Expected for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            [] => write!(f, "a table, {{ }}"),
            [one] => write!(f, "a table, {{ {one} = .. }}"),
            [one, two] => write!(f, "a table, {{ {one} = .., {two} = .. }}"),
            [one, two, ..] => write!(f, "a table, {{ {one} = .., {two} = .., .. }}"),
        }
    }
}

macro_rules! forwarded {
    ($($method:ident $(($($argument:ident: $of:ty),*))?)*) => {
        $(fn $method<V: Visitor<'de>>(self $($(, $argument: $of)*)?, visitor: V) -> Result<V::Value, D::Error> {
            self.inner.$method($($($argument,)*)? Strict::new(visitor))
        })*
    };
}

impl<'de, D: Deserializer<'de>> Deserializer<'de> for Strict<D> {
    type Error = D::Error;

    forwarded! {
        deserialize_any deserialize_bool deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64 deserialize_i128
        deserialize_u8 deserialize_u16 deserialize_u32 deserialize_u64 deserialize_u128 deserialize_f32 deserialize_f64
        deserialize_char deserialize_str deserialize_string deserialize_bytes deserialize_byte_buf deserialize_option
        deserialize_unit deserialize_seq deserialize_map deserialize_identifier deserialize_ignored_any
        deserialize_unit_struct(name: &'static str) deserialize_newtype_struct(name: &'static str)
        deserialize_tuple(len: usize) deserialize_tuple_struct(name: &'static str, len: usize)
        deserialize_enum(name: &'static str, variants: &'static [&'static str])
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, D::Error> {
        self.inner.deserialize_struct(name, fields, Strict::table(visitor, fields))
    }

    fn is_human_readable(&self) -> bool {
        self.inner.is_human_readable()
    }
}

macro_rules! visits {
    ($($method:ident: $value:ty,)*) => {
        $(fn $method<E: Error>(self, v: $value) -> Result<V::Value, E> {
            self.inner.$method(v)
        })*
    };
}

impl<'de, V: Visitor<'de>> Visitor<'de> for Strict<V> {
    type Value = V::Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.inner.expecting(f)
    }

    visits! {
        visit_bool: bool,
        visit_i8: i8, visit_i16: i16, visit_i32: i32, visit_i64: i64, visit_i128: i128,
        visit_u8: u8, visit_u16: u16, visit_u32: u32, visit_u64: u64, visit_u128: u128,
        visit_f32: f32, visit_f64: f64, visit_char: char,
        visit_str: &str, visit_borrowed_str: &'de str, visit_string: String,
        visit_bytes: &[u8], visit_borrowed_bytes: &'de [u8], visit_byte_buf: Vec<u8>,
    }

    fn visit_none<E: Error>(self) -> Result<V::Value, E> {
        self.inner.visit_none()
    }

    fn visit_unit<E: Error>(self) -> Result<V::Value, E> {
        self.inner.visit_unit()
    }

    fn visit_some<D: Deserializer<'de>>(self, d: D) -> Result<V::Value, D::Error> {
        self.inner.visit_some(Strict::new(d))
    }

    fn visit_newtype_struct<D: Deserializer<'de>>(self, d: D) -> Result<V::Value, D::Error> {
        self.inner.visit_newtype_struct(Strict::new(d))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<V::Value, A::Error> {
        match self.fields {
            Some(fields) => Err(A::Error::invalid_type(Unexpected::Seq, &Table(fields))),
            None => self.inner.visit_seq(Strict::new(seq)),
        }
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<V::Value, A::Error> {
        self.inner.visit_map(Strict::new(map))
    }

    fn visit_enum<A: EnumAccess<'de>>(self, data: A) -> Result<V::Value, A::Error> {
        self.inner.visit_enum(Strict::new(data))
    }
}

impl<'de, S: DeserializeSeed<'de>> DeserializeSeed<'de> for Strict<S> {
    type Value = S::Value;

    fn deserialize<D: Deserializer<'de>>(self, d: D) -> Result<S::Value, D::Error> {
        self.inner.deserialize(Strict::new(d))
    }
}

impl<'de, A: SeqAccess<'de>> SeqAccess<'de> for Strict<A> {
    type Error = A::Error;

    fn next_element_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, A::Error> {
        self.inner.next_element_seed(Strict::new(seed))
    }
}

impl<'de, A: MapAccess<'de>> MapAccess<'de> for Strict<A> {
    type Error = A::Error;

    fn next_key_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, A::Error> {
        self.inner.next_key_seed(Strict::new(seed))
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, A::Error> {
        self.inner.next_value_seed(Strict::new(seed))
    }
}

impl<'de, A: EnumAccess<'de>> EnumAccess<'de> for Strict<A> {
    type Error = A::Error;
    type Variant = Strict<A::Variant>;

    fn variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<(S::Value, Self::Variant), A::Error> {
        let (value, variant) = self.inner.variant_seed(Strict::new(seed))?;
        Ok((value, Strict::new(variant)))
    }
}

impl<'de, A: VariantAccess<'de>> VariantAccess<'de> for Strict<A> {
    type Error = A::Error;

    fn unit_variant(self) -> Result<(), A::Error> {
        self.inner.unit_variant()
    }

    fn newtype_variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<S::Value, A::Error> {
        self.inner.newtype_variant_seed(Strict::new(seed))
    }

    fn tuple_variant<V: Visitor<'de>>(self, len: usize, visitor: V) -> Result<V::Value, A::Error> {
        self.inner.tuple_variant(len, Strict::new(visitor))
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, A::Error> {
        self.inner.struct_variant(fields, Strict::table(visitor, fields))
    }
}

#[cfg(test)]
mod tests {
    use crate::document::parse;
    use crate::locate::Located;
    use serde::Deserialize;
    use std::path::Path;

    #[derive(Debug, Default, Deserialize, PartialEq)]
    #[serde(default)]
    struct Point {
        x: f64,
        y: f64,
    }

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(rename_all = "snake_case")]
    enum Shape {
        Ball(Located<Point>),
        Box { size: f64 },
        Pair(f64, f64),
    }

    #[derive(Debug, Deserialize, PartialEq)]
    struct File {
        at: Option<Located<Point>>,
        #[serde(default)]
        shapes: Vec<Located<Shape>>,
        #[serde(default)]
        corner: [f64; 2],
        #[serde(default)]
        pairs: Vec<(f64, String)>,
    }

    fn read(text: &str) -> Result<File, (usize, usize, String)> {
        parse(Path::new("a.toml"), text, |_| String::new()).map_err(|e| {
            let (line, column) = e.line_column().expect("a place");
            (line, column, e.message)
        })
    }

    #[test]
    fn tables_and_lists_are_read() {
        let text = "corner = [1, 2]\npairs = [[1, \"a\"], [2, \"b\"]]\n[at]\nx = 1\n[[shapes]]\nball = { y = 2 }\n\
                    [[shapes]]\nbox.size = 3\n[[shapes]]\npair = [1, 2]\n";
        let file = read(text).expect("reads");
        assert_eq!(file.at.as_deref(), Some(&Point { x: 1.0, y: 0.0 }));
        assert_eq!(file.at.expect("there").span(), text.find("[at]").map_or(0..0, |i| i..i + 4));
        assert_eq!((file.corner, file.pairs.len(), file.shapes.len()), ([1.0, 2.0], 2, 3));
    }

    #[test]
    fn a_list_in_place_of_a_table_is_refused_with_its_position() {
        let cases = [
            ("at = [1, 2]", (1, 6)),
            ("\nat = []", (2, 6)),
            ("shapes = [{ ball = [1, 2] }]", (1, 20)),
            ("shapes = [{ ball = { x = 1 } }, { box = [3] }]", (1, 41)),
        ];
        for (text, place) in cases {
            let (line, column, message) = read(text).expect_err(text);
            assert_eq!((line, column), place, "{text}: {message}");
            assert!(message.contains(super::WANTED), "{message}");
        }
        let (.., message) = read("at = [1, 2]").expect_err("a list");
        assert_eq!(message, "found a list, expected a table, { x = .., y = .. }");
    }
}

//! Parses TOML documents. Errors state the file, the line, the column and the fix. Lists in place of tables
//! are refused.

use crate::input;
use crate::locate::InputError;
use crate::tables::{self, Strict};
use serde::de::DeserializeOwned;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Reads the text of a user's file. Error messages contain `what` (the kind of file) and the fix `fix`.
///
/// # Errors
/// Returns [`InputError`] without a location, if the file cannot be read.
pub fn read(path: &Path, what: &str, fix: &str) -> Result<String, InputError> {
    input::read_text(path)
        .map_err(|e| InputError::new(path, "", None, format!("cannot read the {what}: {e}"), fix))
}

/// Parses a document. `fix` returns the fix for an error message.
///
/// # Errors
/// Returns [`InputError`] at the location where the text is not valid TOML or does not match the type.
pub fn parse<T: DeserializeOwned>(
    path: &Path,
    text: &str,
    fix: impl FnOnce(&str) -> String,
) -> Result<T, InputError> {
    fault(path, text, fix, toml::Deserializer::parse(text).and_then(|d| T::deserialize(Strict::new(d))))
}

/// Parses a table as [`parse`] parses a document. The values of the table come from `text`, even if the table
/// was assembled from several places. Errors state the location in `text`.
///
/// # Errors
/// Returns [`InputError`] at the location that does not match the type.
pub fn parse_table<T: DeserializeOwned>(
    path: &Path,
    text: &str,
    table: Spanned<DeTable<'_>>,
    fix: impl FnOnce(&str) -> String,
) -> Result<T, InputError> {
    fault(path, text, fix, T::deserialize(Strict::new(toml::Deserializer::from(table))))
}

/// Converts a parse error to an [`InputError`].
fn fault<T>(
    path: &Path,
    text: &str,
    fix: impl FnOnce(&str) -> String,
    read: Result<T, toml::de::Error>,
) -> Result<T, InputError> {
    read.map_err(|e| {
        let mut help = fix(e.message());
        if e.message().contains(tables::WANTED) {
            help = format!("use a table of named values, such as {{ name = value }}; {help}");
        }
        let message = plain(&e.message().lines().collect::<Vec<_>>().join("; "));
        InputError::new(path, text, e.span(), message, help)
    })
}

/// Words of serde's messages, and the words for users, who know keys, tables and lists but no Rust types.
const WORDS: [(&str, &str); 18] = [
    ("unknown field `", "unknown key `"),
    ("unknown variant `", "unknown name `"),
    ("missing field `", "missing key `"),
    ("duplicate field `", "duplicate key `"),
    ("invalid type: ", "found "),
    ("invalid value: ", "found "),
    ("found integer `", "found the number `"),
    ("found floating point `", "found the number `"),
    ("found boolean `", "found `"),
    ("found string ", "found the text "),
    ("found map,", "found a table,"),
    ("found sequence,", "found a list,"),
    ("expected a map", "expected a table"),
    ("expected a sequence", "expected a list"),
    ("expected an array of length ", "expected a list of length "),
    ("expected struct ", "expected a table, "),
    ("invalid length ", "found a list of length "),
    ("expected a boolean", "expected true or false"),
];

/// Rust's types of numbers, and their descriptions.
const NUMBERS: [(&str, &str); 10] = [
    ("u8", "a whole number from 0 to 255"),
    ("u16", "a whole number from 0 to 65535"),
    ("u32", "a whole number from 0 to 4294967295"),
    ("u64", "a whole number of 0 or more"),
    ("usize", "a whole number of 0 or more"),
    ("i32", "a whole number"),
    ("i64", "a whole number"),
    ("isize", "a whole number"),
    ("f32", "a number"),
    ("f64", "a number"),
];

/// Replaces the words of serde and of Rust in a message.
pub fn plain(message: &str) -> String {
    let mut message = message.to_owned();
    for (word, better) in WORDS {
        message = message.replace(word, better);
    }
    for (of_rust, number) in NUMBERS {
        if let Some(start) = message.strip_suffix(&format!("expected {of_rust}")) {
            message = format!("{start}expected {number}");
        }
    }
    message
}

/// Converts an error in the text of a document that exists only in code. The location becomes the path of a
/// key after the document's description, such as `scene in code: objects[0].material`, because users never saw
/// the text.
pub fn in_code(what: &str, e: InputError) -> InputError {
    // A key that is missing at the top level has the place of the whole document.
    let whole = |span: &&Range<usize>| span.start > 0 || !e.message.starts_with("missing key");
    let key = e.span.as_ref().filter(whole).and_then(|span| key_at(&e.text, span.start));
    let file = match (key, &e.span) {
        (Some(key), _) => format!("{what}: {key}").into(),
        (None, Some(_)) => what.into(),
        (None, None) => e.file,
    };
    InputError { file, text: "".into(), span: None, ..e }
}

/// Returns the path of the innermost key whose name or value contains a byte offset of a document, such as
/// `objects[0].material`. Returns `None` outside all keys and for text that is not valid TOML.
fn key_at(text: &str, at: usize) -> Option<String> {
    let table = DeTable::parse(text).ok()?;
    within(table.get_ref(), at, "").map(|(_, path)| path)
}

/// Returns the length and the path of the shortest range in a table that contains a place.
fn within(table: &DeTable<'_>, at: usize, parent: &str) -> Option<(usize, String)> {
    let entries = table.iter().map(|(key, value)| {
        let dot = if parent.is_empty() { "" } else { "." };
        let path = format!("{parent}{dot}{}", key.get_ref());
        let own = key.span().contains(&at).then(|| (key.span().len(), path.clone()));
        shorter(own, within_value(value, at, path))
    });
    entries.reduce(shorter).flatten()
}

fn within_value(value: &Spanned<DeValue<'_>>, at: usize, path: String) -> Option<(usize, String)> {
    let inner = match value.get_ref() {
        DeValue::Table(table) => within(table, at, &path),
        DeValue::Array(list) => {
            let entries = list.iter().enumerate();
            entries.map(|(i, v)| within_value(v, at, format!("{path}[{i}]"))).reduce(shorter).flatten()
        }
        _ => None,
    };
    shorter(inner, value.span().contains(&at).then(|| (value.span().len(), path)))
}

/// Returns the shorter of two ranges.
fn shorter(a: Option<(usize, String)>, b: Option<(usize, String)>) -> Option<(usize, String)> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if b.0 < a.0 { b } else { a }),
        (a, b) => a.or(b),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_innermost_key_of_a_place_is_found() {
        let text = "a = 1\n[materials.p.diffuse]\nalbedo = [0.1, 0.2]\n[[objects]]\nname = \"x\"\n[[objects]]\n\
                    shape = { sphere = { r = 2 } }\n";
        for (word, path) in [
            ("a =", Some("a")),
            ("diffuse", Some("materials.p.diffuse")),
            ("0.2", Some("materials.p.diffuse.albedo[1]")),
            ("\"x\"", Some("objects[0].name")),
            ("2 }", Some("objects[1].shape.sphere.r")),
        ] {
            let at = text.find(word).expect("a word");
            assert_eq!(key_at(text, at).as_deref(), path, "{word}");
        }
        assert_eq!(key_at("a = ", 0), None);
    }

    #[test]
    fn messages_have_no_words_of_rust() {
        #[derive(serde::Deserialize, Debug)]
        #[serde(deny_unknown_fields)]
        #[expect(dead_code, reason = "only parsed")]
        struct Wanted {
            n: u32,
            x: Option<f32>,
            list: Option<Vec<String>>,
        }
        for (text, message) in [
            ("n = -1", "found the number `-1`, expected a whole number from 0 to 4294967295"),
            ("n = 1.5", "found the number `1.5`, expected a whole number from 0 to 4294967295"),
            ("n = 1\nx = \"a\"", "found the text \"a\", expected a number"),
            ("n = 1\nlist = { a = 1 }", "found a table, expected a list"),
            ("x = 1", "missing key `n`"),
            ("n = 1\nz = 1", "unknown key `z`, expected one of `n`, `x`, `list`"),
        ] {
            let fault = parse::<Wanted>(Path::new("f"), text, str::to_owned).expect_err(text);
            assert_eq!(fault.message, message);
        }
    }
}

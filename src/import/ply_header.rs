//! Parses the header of a PLY file: elements and their properties.

use super::error::ImportError;
use super::notes::Notes;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Property {
    pub name: String,
    pub kind: Kind,
    /// Type of the count before a list, or `None` for a single number.
    pub list: Option<Kind>,
}

#[derive(Clone, Debug)]
pub(super) struct Element {
    pub name: String,
    pub count: usize,
    pub properties: Vec<Property>,
}

#[derive(Debug)]
pub(super) struct Header {
    pub format: Format,
    pub elements: Vec<Element>,
    pub body: usize,
}

const FIX: &str = "export the mesh again as PLY 1.0";

/// Parses a header. Adds a note for each texture name in a comment.
pub(super) fn read(bytes: &[u8], notes: &mut Notes) -> Result<Header, ImportError> {
    let mut at = if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
    // The first line ending applies to all lines, because in binary files the first row can begin with a
    // byte that equals a line ending.
    let magic = bytes[at..].get(..3).filter(|m| m == b"ply");
    let line_end: &[u8] = match (magic, bytes.get(at + 3..)) {
        (Some(_), Some([b'\r', b'\n', ..])) => b"\r\n",
        (Some(_), Some([b'\r', ..])) => b"\r",
        (Some(_), Some([b'\n' | b' ' | b'\t', ..])) => b"\n",
        _ => return Err(ImportError::new("the first line is not `ply`", FIX).at_line(1)),
    };
    let mut format = None;
    let mut elements: Vec<Element> = vec![];
    for number in 1.. {
        let rest = &bytes[at..];
        let length = rest.windows(line_end.len()).position(|w| w == line_end);
        let Some(length) = length else {
            return Err(ImportError::new("the header has no line `end_header`", FIX).at_line(number));
        };
        at += length + line_end.len();
        let line = String::from_utf8_lossy(&rest[..length]);
        let words: Vec<&str> = line.split_whitespace().collect();
        let bad = |what: String| ImportError::new(what, FIX).at_line(number);
        match words[..] {
            [] | ["ply"] if number == 1 || words.is_empty() => {}
            ["obj_info", ..] => {}
            ["comment", kind, ..] if kind.eq_ignore_ascii_case("TextureFile") => {
                notes.add(format!("the texture in `{}` is not used", line.trim()));
            }
            ["comment", ..] => {}
            ["format", name, version] => {
                format = Some(match name {
                    "ascii" => Format::Ascii,
                    "binary_little_endian" => Format::LittleEndian,
                    "binary_big_endian" => Format::BigEndian,
                    _ => return Err(bad(format!("unknown format {name:?}"))),
                });
                if version != "1.0" {
                    return Err(bad(format!("expected format version 1.0, got {version}")));
                }
            }
            ["element", name, count] => elements.push(Element {
                name: name.to_owned(),
                count: count
                    .parse()
                    .map_err(|_| bad(format!("element {name:?} has an invalid count {count:?}")))?,
                properties: vec![],
            }),
            ["property", ref kinds @ .., name] => {
                let known = |kind: &str| {
                    Kind::named(kind).ok_or_else(|| bad(format!("unknown type {kind:?} of {name:?}")))
                };
                let (list, kind) = match *kinds {
                    [kind] => (None, known(kind)?),
                    ["list", count, kind] => (Some(known(count)?), known(kind)?),
                    _ => return Err(bad(format!("invalid property declaration `{}`", line.trim()))),
                };
                let element = elements
                    .last_mut()
                    .ok_or_else(|| bad(format!("property {name:?} precedes all elements")))?;
                if element.properties.iter().any(|p| p.name == name) {
                    return Err(bad(format!("element {:?} has two properties named {name:?}", element.name)));
                }
                element.properties.push(Property { name: name.to_owned(), kind, list });
            }
            ["end_header"] => {
                let format = format.ok_or_else(|| bad("the header has no line `format`".into()))?;
                check_counts(&elements, format, bytes.len() - at)?;
                return Ok(Header { format, elements, body: at });
            }
            _ => return Err(bad(format!("unknown header line `{}`", line.trim()))),
        }
    }
    unreachable!("every line shortens the rest of the header");
}

/// Refuses counts that exceed the file's length, before memory is allocated.
fn check_counts(elements: &[Element], format: Format, length: usize) -> Result<(), ImportError> {
    let mut least = 0_usize;
    for (i, element) in elements.iter().enumerate() {
        let Element { name, count, properties } = element;
        if elements[..i].iter().any(|e| e.name == *name) {
            return Err(ImportError::new(format!("duplicate element {name:?}"), FIX));
        }
        let row: usize = properties
            .iter()
            .map(|p| match format {
                // A number needs at least a digit and a space.
                Format::Ascii => 2,
                _ => p.list.unwrap_or(p.kind).size(),
            })
            .sum();
        if row == 0 && *count > 0 {
            let what = format!("the {count} rows of {name:?} have no properties");
            return Err(ImportError::new(what, FIX));
        }
        least = least.saturating_add(row.saturating_mul(*count));
        // The last number needs no following space.
        if least > length + 1 {
            let what = format!(
                "the header declares {count} rows of {name:?} and at least {} bytes of data, but only {length} bytes follow the header",
                least - 1
            );
            return Err(ImportError::new(what, "the file is truncated: export or copy the file again"));
        }
    }
    Ok(())
}

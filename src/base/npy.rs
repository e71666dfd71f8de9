//! Headers of NumPy's `.npy` files, and the numbers after the headers (numpy.lib.format, versions 1.0 to
//! 3.0).

use std::io::{self, Read, Write};

/// First bytes of a `.npy` file.
pub const SIGNATURE: &[u8] = b"\x93NUMPY";

/// Type of an array's numbers, with the size of a number in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    Float4,
    Float8,
    Unsigned(usize),
    Signed(usize),
}

impl Element {
    pub fn size(self) -> usize {
        match self {
            Self::Float4 => 4,
            Self::Float8 => 8,
            Self::Unsigned(n) | Self::Signed(n) => n,
        }
    }

    /// Converts the bytes of one number to `f64`. Integers above 2⁵³ are rounded.
    pub fn number(self, bytes: &[u8], big_endian: bool) -> f64 {
        let size = self.size();
        let mut word = [0_u8; 8];
        word[..size].copy_from_slice(&bytes[..size]);
        if big_endian {
            word[..size].reverse();
        }
        let bits = u64::from_le_bytes(word);
        let unused = 64 - 8 * size;
        match self {
            Self::Float4 => f64::from(f32::from_bits(bits as u32)),
            Self::Float8 => f64::from_bits(bits),
            Self::Unsigned(_) => bits as f64,
            Self::Signed(_) => (((bits << unused) as i64) >> unused) as f64,
        }
    }
}

/// A number type that NumPy arrays can contain.
pub trait NumpyNumber {
    /// NumPy's type string on this machine, for example `<f4`.
    const TYPE: &str;
}

macro_rules! numbers {
    ($($number:ty: $little:literal, $big:literal;)*) => {$(
        impl NumpyNumber for $number {
            const TYPE: &str = if cfg!(target_endian = "big") { $big } else { $little };
        }
    )*};
}
numbers! { f32: "<f4", ">f4"; f64: "<f8", ">f8"; i32: "<i4", ">i4"; u32: "<u4", ">u4"; }

/// Header of a `.npy` file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// Length of every axis.
    pub shape: Vec<usize>,
    /// Whether the first index varies fastest in the file, as in a saved transpose.
    pub column_major: bool,
    /// NumPy's type string, for example `<f8`, or `None` for records.
    pub kind: Option<String>,
}

impl Header {
    /// Reads a header. The elements follow the header.
    ///
    /// # Errors
    /// Returns an error if reading fails, or if the bytes are not a valid header.
    pub fn read(reader: &mut impl Read) -> io::Result<Self> {
        let mut start = [0; 8];
        match reader.read_exact(&mut start) {
            Err(e) if e.kind() != io::ErrorKind::UnexpectedEof => return Err(e),
            Ok(()) if start.starts_with(SIGNATURE) => {}
            _ => return Err(invalid("the file does not begin with the signature of the NPY format")),
        }
        let length = match start[6..] {
            [1, 0] => {
                let mut bytes = [0; 2];
                reader.read_exact(&mut bytes)?;
                u64::from(u16::from_le_bytes(bytes))
            }
            [2 | 3, 0] => {
                let mut bytes = [0; 4];
                reader.read_exact(&mut bytes)?;
                u64::from(u32::from_le_bytes(bytes))
            }
            _ => return Err(invalid(&format!("unsupported version: ({}, {})", start[6], start[7]))),
        };
        let mut text = String::new();
        // The text grows as it is read, because the header of a damaged file may claim any length.
        if reader.take(length).read_to_string(&mut text)? as u64 != length {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        header(&text)
            .ok_or_else(|| invalid("the header is not a dictionary of descr, fortran_order and shape"))
    }

    /// Returns the type of the elements and whether the elements are big-endian. Returns `None` if the
    /// elements are not numbers of a supported type.
    pub fn element(&self) -> Option<(Element, bool)> {
        let kind = self.kind.as_deref()?;
        let (order, kind) = kind.split_at_checked(1)?;
        let element = match kind {
            "f4" => Element::Float4,
            "f8" => Element::Float8,
            "u1" => Element::Unsigned(1),
            "u2" => Element::Unsigned(2),
            "u4" => Element::Unsigned(4),
            "u8" => Element::Unsigned(8),
            "i1" => Element::Signed(1),
            "i2" => Element::Signed(2),
            "i4" => Element::Signed(4),
            "i8" => Element::Signed(8),
            _ => return None,
        };
        match order {
            "<" | "|" => Some((element, false)),
            ">" => Some((element, true)),
            "=" => Some((element, cfg!(target_endian = "big"))),
            _ => None,
        }
    }

    /// Converts the elements after the header to `f64`, in the order of the file. Returns `None` if the
    /// elements are not numbers, or if there are fewer elements than the shape requires.
    pub fn numbers(&self, elements: &[u8]) -> Option<Vec<f64>> {
        let (element, big_endian) = self.element()?;
        let count = self.shape.iter().try_fold(1_usize, |n, len| n.checked_mul(*len))?;
        let all = elements.get(..count.checked_mul(element.size())?)?;
        Some(all.chunks_exact(element.size()).map(|bytes| element.number(bytes, big_endian)).collect())
    }
}

/// Writes the header of a row-major array. `kind` is NumPy's type string.
///
/// # Errors
/// Returns an error if the writer fails.
pub fn write_header(writer: &mut impl Write, kind: &str, shape: &[usize]) -> io::Result<()> {
    let axes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({axes}), }}");
    // The elements begin at a multiple of 64 bytes. Ten bytes precede the text.
    while (10 + text.len() + 1) % 64 != 0 {
        text.push(' ');
    }
    text.push('\n');
    writer.write_all(SIGNATURE)?;
    writer.write_all(&[1, 0])?;
    writer.write_all(&(text.len() as u16).to_le_bytes())?;
    writer.write_all(text.as_bytes())
}

fn invalid(message: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, message)
}

/// A Python literal of the kinds that occur in headers.
enum Literal<'a> {
    Text(&'a str),
    /// A number, `True`, `False` or `None`.
    Word(&'a str),
    /// A list or a tuple.
    List(Vec<Self>),
    Dictionary(Vec<(Self, Self)>),
}

fn header(text: &str) -> Option<Header> {
    let mut rest = text;
    let Literal::Dictionary(entries) = literal(&mut rest, 0)? else {
        return None;
    };
    if !rest.trim_start().is_empty() {
        return None;
    }
    let (mut kind, mut column_major, mut shape) = (None, None, None);
    for (key, value) in entries {
        match (key, value) {
            (Literal::Text("descr"), Literal::Text(text)) => kind = Some(Some(text.to_owned())),
            (Literal::Text("descr"), Literal::List(_)) => kind = Some(None),
            (Literal::Text("fortran_order"), Literal::Word(word @ ("True" | "False"))) => {
                column_major = Some(word == "True");
            }
            (Literal::Text("shape"), Literal::List(axes)) => {
                let length = |axis: Literal| match axis {
                    // Python 2 wrote large numbers with the suffix L.
                    Literal::Word(word) => word.strip_suffix('L').unwrap_or(word).parse().ok(),
                    _ => None,
                };
                shape = axes.into_iter().map(length).collect::<Option<Vec<usize>>>();
            }
            _ => return None,
        }
    }
    Some(Header { shape: shape?, column_major: column_major?, kind: kind? })
}

/// Removes a literal from the start of `rest` and returns the literal.
fn literal<'a>(rest: &mut &'a str, depth: usize) -> Option<Literal<'a>> {
    *rest = rest.trim_start();
    let first = rest.chars().next().filter(|_| depth < 16)?;
    match first {
        '\'' | '"' => {
            let end = 1 + rest[1..].find(first)?;
            let text = &rest[1..end];
            *rest = &rest[end + 1..];
            // Names of records may contain escaped characters, which this parser does not support.
            (!text.contains('\\')).then_some(Literal::Text(text))
        }
        '(' | '[' => {
            let last = if first == '(' { ')' } else { ']' };
            list(rest, last, |rest| literal(rest, depth + 1)).map(Literal::List)
        }
        '{' => {
            let entry = |rest: &mut &'a str| {
                let key = literal(rest, depth + 1)?;
                *rest = rest.trim_start().strip_prefix(':')?;
                Some((key, literal(rest, depth + 1)?))
            };
            list(rest, '}', entry).map(Literal::Dictionary)
        }
        _ => {
            let end = rest.find(|c: char| !c.is_ascii_alphanumeric()).filter(|end| *end > 0)?;
            let word = &rest[..end];
            *rest = &rest[end..];
            Some(Literal::Word(word))
        }
    }
}

/// Removes a bracketed list of entries, separated by commas, from the start of `rest` and returns the
/// entries. `last` is the closing bracket.
fn list<'a, T>(
    rest: &mut &'a str,
    last: char,
    mut entry: impl FnMut(&mut &'a str) -> Option<T>,
) -> Option<Vec<T>> {
    let mut found = vec![];
    *rest = rest[1..].trim_start();
    loop {
        if let Some(after) = rest.strip_prefix(last) {
            *rest = after;
            return Some(found);
        }
        found.push(entry(rest)?);
        *rest = rest.trim_start();
        match rest.strip_prefix(',') {
            Some(after) => *rest = after.trim_start(),
            None if rest.starts_with(last) => {}
            None => return None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn file(version: u8, text: &str) -> Vec<u8> {
        let length = (text.len() as u32).to_le_bytes();
        let length = if version == 1 { &length[..2] } else { &length[..] };
        [SIGNATURE, &[version, 0], length, text.as_bytes()].concat()
    }

    fn read(text: &str) -> Option<Header> {
        Header::read(&mut &file(1, text)[..]).ok()
    }

    /// Verifies that headers are read as numpy.save writes them (NumPy 2.2, and NumPy 1.6 with Python 2).
    #[test]
    fn headers_of_numpy_are_read() {
        let text = "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }      \n";
        let want = Header { shape: vec![2, 3], column_major: false, kind: Some("<f8".into()) };
        for version in 1..=3 {
            assert_eq!(Header::read(&mut &file(version, text)[..]).unwrap(), want);
        }
        let old = read("{'descr': '>i4', 'fortran_order': True, 'shape': (7L,), }\n").unwrap();
        assert_eq!((&old.shape[..], old.column_major), (&[7][..], true));
        assert_eq!(old.element(), Some((Element::Signed(4), true)));
        let number = read("{'descr': '|u1', 'fortran_order': False, 'shape': (), }\n").unwrap();
        assert_eq!(number.numbers(&[200]), Some(vec![200.0]));
        assert_eq!(number.numbers(&[]), None);
        let records =
            "{'descr': [('x', '<f8'), ('y', '<i2', (3,))], 'fortran_order': False, 'shape': (4,), }\n";
        assert_eq!(read(records).unwrap().kind, None);
    }

    #[test]
    fn other_headers_are_refused() {
        for text in [
            "",
            "{'descr': '<f8', 'fortran_order': False}",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (-2,)}",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999,)}",
            "{'descr': '<f8', 'fortran_order': 0, 'shape': (2,)}",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (2 2)}",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (2,)} x",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (2,), 'more': 1}",
            "((((((((((((((((((((((((((((((((",
        ] {
            assert_eq!(read(text), None, "{text}");
        }
        assert_eq!(Header::read(&mut &file(4, "{}")[..]).unwrap_err().kind(), io::ErrorKind::InvalidData);
        let cut = file(2, "{'descr'");
        assert!(Header::read(&mut &cut[..cut.len() - 1]).is_err());
    }

    #[test]
    fn numbers_of_all_types_are_converted() {
        let of = |kind: &str, bytes: &[u8]| {
            let shape = vec![bytes.len() / kind[2..].parse::<usize>().unwrap()];
            Header { shape, column_major: false, kind: Some(kind.into()) }.numbers(bytes)
        };
        assert_eq!(of("<f4", &1.5_f32.to_le_bytes()), Some(vec![1.5]));
        assert_eq!(of(">f8", &(-2.25_f64).to_be_bytes()), Some(vec![-2.25]));
        assert_eq!(of("|i1", &[0xff, 0x7f]), Some(vec![-1.0, 127.0]));
        assert_eq!(of("<i2", &(-300_i16).to_le_bytes()), Some(vec![-300.0]));
        assert_eq!(of(">i8", &(-5_i64).to_be_bytes()), Some(vec![-5.0]));
        assert_eq!(of("<u8", &(1_u64 << 40).to_le_bytes()), Some(vec![(1_u64 << 40) as f64]));
        assert_eq!(of("<c8", &[0; 8]), None);
    }

    proptest! {
        #[test]
        fn written_headers_are_read_back(shape in prop::collection::vec(0_usize..1 << 40, 0..9)) {
            let mut bytes = vec![];
            write_header(&mut bytes, f32::TYPE, &shape).unwrap();
            prop_assert_eq!(bytes.len() % 64, 0);
            let header = Header::read(&mut &bytes[..]).unwrap();
            prop_assert_eq!(header, Header { shape, column_major: false, kind: Some(f32::TYPE.into()) });
        }
    }
}

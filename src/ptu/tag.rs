//! One tag of a header. A tag has a name, an index in a list, and a value of one of eleven types.
//!
//! A tag has 48 bytes: name (32 bytes, padded with zeros), index (i32, −1 without a list), type (u32), and
//! value (8 bytes). For types whose code ends in `FFFF`, the last 8 bytes contain the length of the value,
//! and the value follows the tag.

/// Size of a tag in bytes, without the value that follows it.
pub const SIZE: usize = 48;

/// Name of the tag that ends a header.
pub const LAST: &str = "Header_End";

/// Maximum length of a name in bytes.
pub const LONGEST_NAME: usize = 32;

#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    Empty,
    Bool(bool),
    Int(i64),
    /// A set of 64 flags.
    Bits(u64),
    Color(u64),
    Float(f64),
    /// A time in days since 30 December 1899, 0 h.
    Time(f64),
    Floats(Vec<f64>),
    /// A text in the code page Windows-1252.
    Text(String),
    /// A text in UTF-16.
    Wide(String),
    Blob(Vec<u8>),
}

mod code {
    pub const EMPTY: u32 = 0xffff_0008;
    pub const BOOL: u32 = 0x0000_0008;
    pub const INT: u32 = 0x1000_0008;
    pub const BITS: u32 = 0x1100_0008;
    pub const COLOR: u32 = 0x1200_0008;
    pub const FLOAT: u32 = 0x2000_0008;
    pub const TIME: u32 = 0x2100_0008;
    pub const FLOATS: u32 = 0x2001_ffff;
    pub const TEXT: u32 = 0x4001_ffff;
    pub const WIDE: u32 = 0x4002_ffff;
    pub const BLOB: u32 = 0xffff_ffff;
}

/// Returns whether the values of a type follow the tag.
pub(super) fn is_long(kind: u32) -> bool {
    matches!(kind, code::FLOATS | code::TEXT | code::WIDE | code::BLOB)
}

/// Windows-1252 characters from 0x80 to 0x9f. Five undefined bytes map to the code points with the same
/// values.
const ANSI: [char; 32] = [
    '€', '\u{81}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{8d}', 'Ž', '\u{8f}', '\u{90}',
    '‘', '’', '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{9d}', 'ž', 'Ÿ',
];

fn from_ansi(bytes: &[u8]) -> String {
    let character = |b: &u8| match b {
        0x80..=0x9f => ANSI[usize::from(b - 0x80)],
        b => char::from(*b),
    };
    bytes.iter().map(character).collect()
}

/// Encodes a text in Windows-1252, or returns `None` if a character is missing from this code page.
fn to_ansi(text: &str) -> Option<Vec<u8>> {
    let byte = |c: char| match ANSI.iter().position(|a| *a == c) {
        Some(i) => Some(0x80 + i as u8),
        None => u8::try_from(c).ok().filter(|b| !(0x80..=0x9f).contains(b)),
    };
    text.chars().map(byte).collect()
}

impl Value {
    /// Creates a text value in Windows-1252 if possible, otherwise in UTF-16.
    pub fn text(text: &str) -> Self {
        match to_ansi(text) {
            Some(_) => Self::Text(text.to_owned()),
            None => Self::Wide(text.to_owned()),
        }
    }

    /// Decodes a value from the 8 bytes of a tag or from the bytes that follow the tag. Returns a message
    /// if the bytes are invalid.
    pub(super) fn read(kind: u32, word: [u8; 8], long: Vec<u8>) -> Result<Self, String> {
        let (int, float) = (u64::from_le_bytes(word), f64::from_le_bytes(word));
        let until_zeros = |bytes: &[u8]| {
            let end = bytes.iter().rposition(|b| *b != 0).map_or(0, |i| i + 1);
            from_ansi(&bytes[..end])
        };
        Ok(match kind {
            code::EMPTY => Self::Empty,
            code::BOOL => Self::Bool(int != 0),
            code::INT => Self::Int(int as i64),
            code::BITS => Self::Bits(int),
            code::COLOR => Self::Color(int),
            code::FLOAT => Self::Float(float),
            code::TIME => Self::Time(float),
            code::FLOATS => {
                let (numbers, rest) = long.as_chunks::<8>();
                if !rest.is_empty() {
                    return Err(format!(
                        "a list of numbers of {} bytes; expected a multiple of 8 bytes",
                        long.len()
                    ));
                }
                Self::Floats(numbers.iter().map(|b| f64::from_le_bytes(*b)).collect())
            }
            code::TEXT => Self::Text(until_zeros(&long)),
            code::WIDE => {
                let (units, rest) = long.as_chunks::<2>();
                let units: Vec<u16> = units.iter().map(|b| u16::from_le_bytes(*b)).collect();
                let text = String::from_utf16(&units).ok().filter(|_| rest.is_empty());
                let text = text.ok_or("a text that is not UTF-16")?;
                Self::Wide(text.trim_end_matches('\0').to_owned())
            }
            code::BLOB => Self::Blob(long),
            _ => return Err(format!("a value of unknown type {kind:#010x}")),
        })
    }

    /// Returns the type, the 8 bytes and the bytes after the tag. Returns a message if the value cannot be
    /// encoded.
    fn write(&self) -> Result<(u32, [u8; 8], Vec<u8>), String> {
        // Texts end with a zero byte. All values are padded to multiples of 8 bytes.
        let long = |kind, mut bytes: Vec<u8>| {
            bytes.resize(bytes.len().next_multiple_of(8), 0);
            Ok((kind, (bytes.len() as u64).to_le_bytes(), bytes))
        };
        let word = |kind, word: u64| Ok((kind, word.to_le_bytes(), vec![]));
        match self {
            Self::Empty => word(code::EMPTY, 0),
            Self::Bool(b) => word(code::BOOL, u64::from(*b)),
            Self::Int(i) => word(code::INT, *i as u64),
            Self::Bits(b) => word(code::BITS, *b),
            Self::Color(c) => word(code::COLOR, *c),
            Self::Float(f) => word(code::FLOAT, f.to_bits()),
            Self::Time(f) => word(code::TIME, f.to_bits()),
            Self::Floats(f) => long(code::FLOATS, f.iter().flat_map(|f| f.to_le_bytes()).collect()),
            Self::Text(t) => {
                let mut bytes =
                    to_ansi(t).ok_or("the text has a character that Windows-1252 cannot encode")?;
                bytes.push(0);
                long(code::TEXT, bytes)
            }
            Self::Wide(t) => {
                let units = t.encode_utf16().chain([0]);
                long(code::WIDE, units.flat_map(u16::to_le_bytes).collect())
            }
            Self::Blob(b) => long(code::BLOB, b.clone()),
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Tag {
    /// Name, at most 32 bytes of ASCII.
    pub name: String,
    /// Index in a list of tags with the same name, or −1 without a list.
    pub index: i32,
    pub value: Value,
}

impl Tag {
    /// Creates a tag outside any list.
    pub fn new(name: &str, value: Value) -> Self {
        Self { name: name.to_owned(), index: -1, value }
    }

    /// Appends the encoded tag to `out`, or returns a message if the tag cannot be encoded.
    pub(super) fn write(&self, out: &mut Vec<u8>) -> Result<(), String> {
        let Self { name, index, value } = self;
        if name.is_empty() || name.len() > LONGEST_NAME || !name.bytes().all(|b| b.is_ascii_graphic()) {
            return Err(format!("tag {name:?}: expected a name of 1 to 32 visible ASCII characters"));
        }
        let (kind, word, long) = value.write().map_err(|e| format!("tag {name}: {e}"))?;
        let mut padded = [0; LONGEST_NAME];
        padded[..name.len()].copy_from_slice(name.as_bytes());
        out.extend_from_slice(&padded);
        out.extend_from_slice(&index.to_le_bytes());
        out.extend_from_slice(&kind.to_le_bytes());
        out.extend_from_slice(&word);
        out.extend_from_slice(&long);
        Ok(())
    }
}

//! Reads Mitsuba's tensor files, which are containers of named arrays, in place.
//!
//! All numbers are little-endian. The file begins with `"tensor_file\0"`, the version (two u8, 1.0) and the
//! number of fields (u32). Each field consists of:
//! - the length of the name (u16),
//! - the name,
//! - the number of dimensions (u16),
//! - the type (u8),
//! - the offset of the data from the start of the file (u64),
//! - the size of each dimension (u64).
//!
//! Data are row-major and usually aligned to 8 bytes, but the reader does not rely on the alignment.
//!
//! Sizes in the header are not trusted. The reader allocates nothing and checks every byte range against the
//! file size.

use super::error::PbsdfError;
use std::ops::Range;

/// The first bytes of each tensor file.
pub(super) const MAGIC: &[u8; 12] = b"tensor_file\0";

/// Number of bytes before the first field.
pub(super) const HEAD: usize = 18;

/// Element types of tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dtype {
    U16,
    F32,
}

impl Dtype {
    /// Returns the code of the type in the file.
    pub fn code(self) -> u8 {
        match self {
            Self::U16 => 3,
            Self::F32 => 10,
        }
    }

    /// Returns the size of an element of this type in bytes.
    pub fn size(self) -> usize {
        match self {
            Self::U16 => 2,
            Self::F32 => 4,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::U16 => "u16",
            Self::F32 => "f32",
        }
    }
}

fn type_name(code: u8) -> String {
    let names = ["u8", "i8", "u16", "i16", "u32", "i32", "u64", "i64", "f16", "f32", "f64"];
    usize::from(code)
        .checked_sub(1)
        .and_then(|i| names.get(i))
        .map_or_else(|| format!("{code} (unknown)"), |n| (*n).to_owned())
}

/// Removes `count` bytes from the front of `bytes` and returns the removed bytes. Returns `None` if there are
/// too few bytes.
fn take<'a>(bytes: &mut &'a [u8], count: usize) -> Option<&'a [u8]> {
    let (head, tail) = bytes.split_at_checked(count)?;
    *bytes = tail;
    Some(head)
}

fn number<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    take(bytes, N)?.try_into().ok()
}

/// An unchecked field of the header.
#[derive(Clone, Copy)]
struct Entry<'a> {
    name: &'a [u8],
    code: u8,
    offset: u64,
    /// Size of each dimension, as little-endian u64.
    shape: &'a [u8],
}

fn entry<'a>(bytes: &mut &'a [u8]) -> Option<Entry<'a>> {
    let length = u16::from_le_bytes(number(bytes)?);
    let name = take(bytes, length.into())?;
    let dimensions = u16::from_le_bytes(number(bytes)?);
    let [code] = number(bytes)?;
    let offset = u64::from_le_bytes(number(bytes)?);
    let shape = take(bytes, usize::from(dimensions) * 8)?;
    Some(Entry { name, code, offset, shape })
}

/// A field whose data range is inside the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field<'a> {
    pub dtype: Dtype,
    /// Byte range of the field's data. The range is empty if the shape contains a zero.
    pub range: Range<usize>,
    shape: &'a [u8],
}

impl Field<'_> {
    /// Returns the size of each dimension.
    pub fn shape(&self) -> impl ExactSizeIterator<Item = u64> + '_ {
        let word = |w: &[u8]| w.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b));
        self.shape.chunks_exact(8).map(word)
    }

    /// Formats the shape as text, truncated after 8 dimensions.
    pub(super) fn shape_text(&self) -> String {
        let mut parts: Vec<String> = self.shape().take(8).map(|n| n.to_string()).collect();
        if self.shape().len() > 8 {
            parts.push("…".into());
        }
        format!("({})", parts.join(", "))
    }
}

#[derive(Clone, Copy, Debug)]
pub struct TensorFile<'a> {
    bytes: &'a [u8],
    count: u32,
}

impl<'a> TensorFile<'a> {
    /// Checks the magic bytes, the version, and the completeness of the header.
    ///
    /// # Errors
    /// Returns a [`PbsdfError`] if the magic bytes or the version differ, or if the header is incomplete.
    pub fn new(bytes: &'a [u8]) -> Result<Self, PbsdfError> {
        if !bytes.starts_with(MAGIC) {
            return Err(PbsdfError::Magic);
        }
        let rest = bytes.get(MAGIC.len()..HEAD).ok_or(PbsdfError::Header)?;
        if rest[..2] != [1, 0] {
            return Err(PbsdfError::Version(rest[0], rest[1]));
        }
        let count = u32::from_le_bytes([rest[2], rest[3], rest[4], rest[5]]);
        let file = Self { bytes, count };
        file.header_end()?;
        Ok(file)
    }

    /// Returns the end of the header, in bytes from the start of the file.
    ///
    /// # Errors
    /// Returns [`PbsdfError::Header`] if the header is incomplete.
    pub fn header_end(&self) -> Result<usize, PbsdfError> {
        let mut at = &self.bytes[HEAD..];
        // A field has at least 13 bytes, so even for an invalid count of billions the loop stops at the end
        // of the file.
        for _ in 0..self.count {
            entry(&mut at).ok_or(PbsdfError::Header)?;
        }
        Ok(self.bytes.len() - at.len())
    }

    /// Returns the field with this name, after checking its type, shape and byte range.
    ///
    /// # Errors
    /// Returns a [`PbsdfError`] if the field is missing, occurs twice, has another type or exceeds the file,
    /// or if the header is incomplete.
    pub fn field(&self, name: &'static str, dtype: Dtype) -> Result<Field<'a>, PbsdfError> {
        let mut at = &self.bytes[HEAD..];
        let mut found = None;
        for _ in 0..self.count {
            let e = entry(&mut at).ok_or(PbsdfError::Header)?;
            if e.name == name.as_bytes() && found.replace(e).is_some() {
                return Err(PbsdfError::Twice(name));
            }
        }
        let e = found.ok_or(PbsdfError::Missing(name))?;
        if e.code != dtype.code() {
            return Err(PbsdfError::Type { field: name, found: type_name(e.code), want: dtype.name() });
        }
        let mut field = Field { dtype, range: 0..0, shape: e.shape };
        // A dimension of size zero means that there are no data, for any offset and any other dimensions.
        if field.shape().any(|n| n == 0) {
            return Ok(field);
        }
        let bytes = field.shape().try_fold(dtype.size() as u64, u64::checked_mul).unwrap_or(u64::MAX);
        let end = u128::from(e.offset) + u128::from(bytes);
        if end > self.bytes.len() as u128 {
            return Err(PbsdfError::Truncated { field: name, start: e.offset, end, size: self.bytes.len() });
        }
        // The sum does not overflow, because both values are at most the length of the slice.
        field.range = e.offset as usize..(e.offset + bytes) as usize;
        Ok(field)
    }
}

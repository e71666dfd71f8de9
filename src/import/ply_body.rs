//! Reads the rows of a PLY file.

use super::ply_header::{Element, Format, Kind};
use rayon::prelude::*;

/// Minimum number of rows per parallel task.
const SHARE: usize = 1 << 14;

/// Size of a triangle in binary files, in bytes: a count of one byte and three indices of four bytes.
const TRIANGLE: usize = 13;

/// The data after the header of a PLY file, with a read position.
pub(super) struct Body<'a> {
    pub format: Format,
    bytes: &'a [u8],
    at: usize,
    /// Number of rows whose lines contain more values than the header declares.
    pub surplus: usize,
}

impl<'a> Body<'a> {
    pub fn new(format: Format, bytes: &'a [u8]) -> Self {
        Self { format, bytes, at: 0, surplus: 0 }
    }

    /// Creates a body whose data has been read completely.
    pub fn through(bytes: &'a [u8]) -> Self {
        Self { format: Format::Ascii, bytes, at: bytes.len(), surplus: 0 }
    }

    /// Returns the number of lines read in an ASCII file.
    pub fn lines(&self) -> usize {
        let read = &self.bytes[..self.at];
        let is_end = |w: &[u8]| w[0] == b'\n' || (w[0] == b'\r' && w.get(1) != Some(&b'\n'));
        (0..read.len()).filter(|&i| is_end(&read[i..])).count()
    }

    /// Returns the number of unread bytes, without surrounding spaces in ASCII files.
    pub fn rest(&self) -> usize {
        let rest = &self.bytes[self.at..];
        match self.format {
            Format::Ascii => rest.trim_ascii().len(),
            _ => rest.len(),
        }
    }

    /// Ends a row. In ASCII files, skips the rest of the line and returns whether the rest was not empty.
    pub fn end_row(&mut self) -> bool {
        if self.format != Format::Ascii {
            return false;
        }
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(|b| matches!(b, b'\n' | b'\r'));
        let line = &rest[..length.unwrap_or(rest.len())];
        self.at += line.len();
        !line.trim_ascii().is_empty()
    }

    fn word(&mut self) -> Result<&'a str, String> {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|b| !b.is_ascii_whitespace());
        let start = start.ok_or("the file is truncated")?;
        let word = &rest[start..];
        let length = word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len());
        self.at += start + length;
        std::str::from_utf8(&word[..length]).map_err(|_| "a number is not valid UTF-8 text".into())
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let bytes = self.bytes[self.at..].get(..count);
        self.at += count.min(self.bytes.len() - self.at);
        bytes.ok_or_else(|| "the file is truncated".into())
    }

    /// Reads a number and rounds it to single precision.
    pub fn float(&mut self, kind: Kind) -> Result<f32, String> {
        if self.format == Format::Ascii {
            let word = self.word()?;
            let value = match kind {
                Kind::F32 => word.parse::<f32>().ok(),
                _ => word.parse::<f64>().ok().map(|v| v as f32),
            };
            return value.ok_or_else(|| format!("{word:?} is not a number"));
        }
        let big = self.format == Format::BigEndian;
        Ok(float(self.take(kind.size())?, kind, big))
    }

    pub fn integer(&mut self, kind: Kind) -> Result<i64, String> {
        let value = if self.format == Format::Ascii {
            let word = self.word()?;
            if let Ok(value) = word.parse() {
                return Ok(value);
            }
            word.parse::<f64>().map_err(|_| format!("{word:?} is not an integer"))?
        } else {
            let big = self.format == Format::BigEndian;
            double(self.take(kind.size())?, kind, big)
        };
        // f64 represents integers exactly up to 2^53, and indices are below 2^32.
        if value.fract() == 0.0 && value.abs() < 1e15 {
            Ok(value as i64)
        } else {
            Err(format!("{value} is not an integer"))
        }
    }

    /// Reads `count` vertex indices and appends them to `out`.
    pub fn corners(&mut self, kind: Kind, count: usize, out: &mut Vec<u32>) -> Result<(), String> {
        if self.format == Format::Ascii || !matches!(kind, Kind::I32 | Kind::U32) {
            for _ in 0..count {
                out.push(index(self.integer(kind)?)?);
            }
            return Ok(());
        }
        let big = self.format == Format::BigEndian;
        for bytes in self.take(count.saturating_mul(4))?.as_chunks::<4>().0 {
            let i = if big { u32::from_be_bytes(*bytes) } else { u32::from_le_bytes(*bytes) };
            out.push(match kind {
                Kind::I32 => index(i64::from(i as i32))?,
                _ => i,
            });
        }
        Ok(())
    }

    pub fn count(&mut self, kind: Kind) -> Result<usize, String> {
        let count = self.integer(kind)?;
        usize::try_from(count).map_err(|_| format!("invalid list length {count}"))
    }

    /// Skips a list or a single number.
    pub fn skip(&mut self, kind: Kind, list: Option<Kind>) -> Result<(), String> {
        let count = list.map_or(Ok(1), |kind| self.count(kind))?;
        match self.format {
            Format::Ascii => (0..count).try_for_each(|_| self.float(kind).map(|_| ())),
            _ => self.take(count.saturating_mul(kind.size())).map(|_| ()),
        }
    }

    /// Reads the given columns of an element that contains no lists. Missing columns are 0.
    pub fn table<const N: usize>(
        &mut self,
        element: &Element,
        columns: [Option<usize>; N],
    ) -> Result<Vec<[f32; N]>, String> {
        let properties = &element.properties;
        if self.format == Format::Ascii || properties.iter().any(|p| p.list.is_some()) {
            let mut rows = Vec::with_capacity(element.count);
            for _ in 0..element.count {
                let mut row = [0.0; N];
                for (i, p) in properties.iter().enumerate() {
                    match columns.iter().position(|c| *c == Some(i)) {
                        Some(slot) => row[slot] = self.float(p.kind)?,
                        None => self.skip(p.kind, p.list)?,
                    }
                }
                rows.push(row);
                self.surplus += usize::from(self.end_row());
            }
            return Ok(rows);
        }
        let mut offsets = vec![];
        let mut size = 0;
        for p in properties {
            offsets.push((size, p.kind));
            size += p.kind.size();
        }
        let places = columns.map(|c| c.map(|i| offsets[i]));
        let table = self.take(size.saturating_mul(element.count))?;
        let big = self.format == Format::BigEndian;
        let row = |bytes: &[u8]| {
            places.map(|place| place.map_or(0.0, |(at, kind)| float(&bytes[at..at + kind.size()], kind, big)))
        };
        Ok(table.par_chunks_exact(size).with_min_len(SHARE).map(row).collect())
    }

    /// Reads binary faces that are all triangles: one list per face, with a count of one byte and
    /// indices of four bytes. Returns `None` if the faces have another form.
    pub fn triangles(&mut self, element: &Element) -> Option<Vec<[u32; 3]>> {
        let [list] = &element.properties[..] else {
            return None;
        };
        let (Some(Kind::U8 | Kind::I8), Kind::I32 | Kind::U32) = (list.list, list.kind) else {
            return None;
        };
        if self.format == Format::Ascii {
            return None;
        }
        let big = self.format == Format::BigEndian;
        let most = if list.kind == Kind::I32 { i32::MAX as u32 } else { u32::MAX };
        let size = element.count.checked_mul(TRIANGLE)?;
        let (rows, _) = self.bytes[self.at..].get(..size)?.as_chunks::<TRIANGLE>();
        let index = |b: &[u8; 4]| {
            let i = if big { u32::from_be_bytes(*b) } else { u32::from_le_bytes(*b) };
            (i <= most).then_some(i)
        };
        let corners = |row: &[u8; TRIANGLE]| {
            let (corners, _) = row[1..].as_chunks::<4>();
            let corners = [index(&corners[0])?, index(&corners[1])?, index(&corners[2])?];
            (row[0] == 3).then_some(corners)
        };
        let triangles: Option<Vec<_>> = rows.par_iter().with_min_len(SHARE).map(corners).collect();
        self.at += triangles.as_ref().map_or(0, |_| size);
        triangles
    }
}

/// Converts a vertex index to u32, or returns an error message if the index is out of range.
pub(super) fn index(corner: i64) -> Result<u32, String> {
    u32::try_from(corner).map_err(|_| format!("invalid vertex index {corner} in a face"))
}

#[inline]
fn float(bytes: &[u8], kind: Kind, big: bool) -> f32 {
    match kind {
        // Keep the exact bits of f32 values.
        Kind::F32 => f32::from_bits(bits(bytes, big) as u32),
        _ => double(bytes, kind, big) as f32,
    }
}

fn double(bytes: &[u8], kind: Kind, big: bool) -> f64 {
    let bits = bits(bytes, big);
    match kind {
        Kind::I8 => f64::from(bits as i8),
        Kind::U8 => f64::from(bits as u8),
        Kind::I16 => f64::from(bits as i16),
        Kind::U16 => f64::from(bits as u16),
        Kind::I32 => f64::from(bits as i32),
        Kind::U32 => f64::from(bits as u32),
        Kind::F32 => f64::from(f32::from_bits(bits as u32)),
        Kind::F64 => f64::from_bits(bits),
    }
}

#[inline]
fn bits(bytes: &[u8], big: bool) -> u64 {
    let mut word = [0; 8];
    let n = bytes.len();
    word[..n].copy_from_slice(bytes);
    if big {
        word[..n].reverse();
    }
    u64::from_le_bytes(word)
}

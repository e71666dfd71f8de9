//! The header of a `.ptu` file, which consists of magic, version, and tags up to `Header_End`.

use super::error::PtuError;
use super::record::{Mode, RecordType};
use super::tag::{self, LAST, Tag, Value};
use std::io::Read;
use std::path::Path;

/// First bytes of a file.
pub const MAGIC: [u8; 8] = *b"PQTTTR\0\0";

/// Maximum size of a header in bytes. Real headers have a few thousand bytes.
pub const MOST: u64 = 64 << 20;

const DAMAGED: &str = "the file is damaged or truncated: copy the file again from the instrument's computer";

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Header {
    /// Version of the format as stored (for example `1.0.00`).
    pub version: String,
    /// Tags in file order, without `Header_End`.
    pub tags: Vec<Tag>,
}

/// A source of known length, and the current read position.
struct Bytes<'a, R> {
    source: R,
    file: &'a Path,
    at: u64,
    length: u64,
}

impl<R: Read> Bytes<'_, R> {
    fn error(&self, what: impl Into<String>, fix: &str) -> PtuError {
        PtuError::new(self.file, self.at, what, fix)
    }

    fn fill(&mut self, out: &mut [u8], what: &str) -> Result<(), PtuError> {
        if self.length - self.at < out.len() as u64 {
            return Err(self.error(format!("the file ends inside {what}"), DAMAGED));
        }
        self.source.read_exact(out).map_err(|e| PtuError::io(self.file, self.at, &e))?;
        self.at += out.len() as u64;
        Ok(())
    }
}

/// Reads a header from the start of a file of `length` bytes. Returns the header and the offset of
/// the first record in bytes.
///
/// A size in the header that exceeds the length of the file does not cause a memory allocation.
///
/// # Errors
/// Returns [`PtuError`] with the offset of the invalid tag.
pub(super) fn read(source: impl Read, length: u64, file: &Path) -> Result<(Header, u64), PtuError> {
    let mut bytes = Bytes { source, file, at: 0, length };
    let (mut magic, mut version) = ([0; 8], [0; 8]);
    if length < 16 {
        return Err(
            bytes.error("the file is too short for a .ptu file", "pass a .ptu file from PicoQuant software")
        );
    }
    bytes.fill(&mut magic, "the magic")?;
    if magic != MAGIC {
        bytes.at = 0;
        return Err(
            bytes.error("the file does not begin with PQTTTR", "pass a .ptu file from PicoQuant software")
        );
    }
    bytes.fill(&mut version, "the version")?;
    let mut header = Header { version: ascii(&version), tags: vec![] };
    loop {
        let begin = bytes.at;
        if begin > MOST {
            return Err(bytes.error("the header does not end within 64 MiB", DAMAGED));
        }
        let mut head = [0; tag::SIZE];
        bytes.fill(&mut head, "the header, before Header_End")?;
        let name = ascii(&head[..32]);
        let [index, kind] =
            [32, 36].map(|i| u32::from_le_bytes([head[i], head[i + 1], head[i + 2], head[i + 3]]));
        if name == LAST {
            return Ok((header, bytes.at));
        }
        let word: [u8; 8] = head[40..].try_into().unwrap_or_default();
        let mut long = vec![];
        if tag::is_long(kind) {
            let size = u64::from_le_bytes(word);
            let most = (bytes.length - bytes.at).min(MOST);
            if size > most {
                bytes.at = begin;
                let what = format!("tag {name:?} has a value of {size} bytes; expected at most {most} bytes");
                return Err(bytes.error(what, DAMAGED));
            }
            long = vec![0; size as usize];
            bytes.fill(&mut long, "the value of a tag")?;
        }
        let value = Value::read(kind, word, long).map_err(|e| {
            bytes.at = begin;
            bytes.error(format!("tag {name:?} has {e}"), DAMAGED)
        })?;
        let index = index as i32;
        header.tags.push(Tag { name, index, value });
    }
}

/// Decodes ASCII up to the first zero byte. Non-ASCII bytes are replaced.
fn ascii(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

impl Header {
    /// Returns the value of the first tag named `name`.
    pub fn get(&self, name: &str) -> Option<&Value> {
        self.tags.iter().find(|t| t.name == name).map(|t| &t.value)
    }

    /// Returns the values of all tags named `name`, in file order.
    pub fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Value> {
        self.tags.iter().filter(move |t| t.name == name).map(|t| &t.value)
    }

    /// Returns the value of a tag of integer or flags type, or `None` for other types.
    pub fn int(&self, name: &str) -> Option<i64> {
        match self.get(name)? {
            Value::Int(i) => Some(*i),
            Value::Bits(b) => i64::try_from(*b).ok(),
            _ => None,
        }
    }

    /// Returns an integer, flags, float or boolean (1 or 0) as a number. Several types are accepted
    /// because programs write the same tag with different types.
    pub fn number(&self, name: &str) -> Option<f64> {
        match self.get(name)? {
            Value::Int(i) => Some(*i as f64),
            Value::Bits(b) => Some(*b as f64),
            Value::Float(f) => Some(*f),
            Value::Bool(b) => Some(f64::from(u8::from(*b))),
            _ => None,
        }
    }

    /// Returns the value of a tag of either text type.
    pub fn text(&self, name: &str) -> Option<&str> {
        match self.get(name)? {
            Value::Text(t) | Value::Wide(t) => Some(t),
            _ => None,
        }
    }

    /// Returns the duration of a count of `dtime` (T3) or of the time tag (T2) in seconds, if positive.
    pub fn resolution_s(&self, mode: Mode) -> Option<f64> {
        let name = match mode {
            Mode::T2 => "MeasDesc_GlobalResolution",
            Mode::T3 => "MeasDesc_Resolution",
        };
        self.number(name).filter(|s| s.is_finite() && *s > 0.0)
    }

    /// Returns the duration of a count of the time tag in seconds, if positive. In T3, a count is one laser
    /// period.
    pub fn global_resolution_s(&self) -> Option<f64> {
        self.resolution_s(Mode::T2)
    }

    /// Returns the record type.
    ///
    /// # Errors
    /// Returns [`PtuError`] in these cases:
    /// - the header states no type or an unknown type;
    /// - the type contradicts `Measurement_Mode`;
    /// - the records are not 32 bits long.
    pub fn record_type(&self, file: &Path) -> Result<RecordType, PtuError> {
        let wrong = |what: String, fix: &str| PtuError::of_request(file, what, fix);
        let Some(code) = self.int("TTResultFormat_TTTRRecType") else {
            let what = "the header does not define the record type (TTResultFormat_TTTRRecType)";
            return Err(wrong(what.into(), DAMAGED));
        };
        match self.int("TTResultFormat_BitsPerRecord") {
            None | Some(0 | 32) => {}
            Some(bits) => {
                return Err(wrong(format!("records have {bits} bits"), "pass a file with 32-bit records"));
            }
        }
        let known = u32::try_from(code).ok().and_then(RecordType::of_code);
        let record = known.ok_or_else(|| {
            let names: Vec<&str> = RecordType::ALL.iter().map(|r| r.name()).collect();
            let fix = format!("supported types: {}", names.join(", "));
            wrong(format!("unknown record type {code:#x}"), &fix)
        })?;
        let mode = match record.mode() {
            Mode::T2 => 2.0,
            Mode::T3 => 3.0,
        };
        match self.number("Measurement_Mode") {
            Some(stated) if stated != mode => Err(wrong(
                format!(
                    "Measurement_Mode is T{stated}, but the record type is {} (TTResultFormat_TTTRRecType)",
                    record.name()
                ),
                DAMAGED,
            )),
            _ => Ok(record),
        }
    }

    /// Encodes the header, including `Header_End`.
    ///
    /// # Errors
    /// Returns a message if a name is too long, if a text does not fit its type, or if `Header_End` is among
    /// the tags.
    pub fn write(&self) -> Result<Vec<u8>, String> {
        let mut out = MAGIC.to_vec();
        let mut version = [0; 8];
        let text = self.version.as_bytes();
        if text.len() > 8 || !text.is_ascii() {
            return Err(format!("version {:?}: expected at most 8 ASCII characters", self.version));
        }
        version[..text.len()].copy_from_slice(text);
        out.extend_from_slice(&version);
        for tag in &self.tags {
            if tag.name == LAST {
                return Err(format!("tag {LAST} is reserved and is written automatically; remove the tag"));
            }
            tag.write(&mut out)?;
        }
        Tag::new(LAST, Value::Empty).write(&mut out)?;
        Ok(out)
    }
}

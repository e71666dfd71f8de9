//! Reports of 64 bytes, and messages in one or more of them.

use super::super::line::LineError;
use std::time::Duration;

/// Bytes of a report.
pub const REPORT: usize = 64;
/// Longest message that is taken, bytes after its head.
const LONGEST: usize = 512;
/// Bits of the first byte.
const READ: u8 = 0x80;
const REPLY: u8 = 0x40;
const NACK: u8 = 0x20;

/// A line of reports, both ways.
pub trait HidLine: Send {
    /// Sends one report.
    ///
    /// # Errors
    /// [`LineError`].
    fn write(&mut self, report: &[u8; REPORT]) -> Result<(), LineError>;

    /// Waits for one.
    ///
    /// # Errors
    /// [`LineError`] after `within` at the latest.
    fn read(&mut self, within: Duration) -> Result<[u8; REPORT], LineError>;

    /// Opens it anew after it was gone.
    ///
    /// # Errors
    /// [`LineError`].
    fn reopen(&mut self) -> Result<(), LineError>;
}

/// A message: of the host, whose payload begins with the command's code, or of the controller, whose payload is the answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// It asks for an answer with data, or is one.
    pub read: bool,
    /// The controller says no.
    pub refused: bool,
    /// Its number, which the answer repeats.
    pub number: u8,
    /// What follows the head.
    pub payload: Vec<u8>,
}

impl Message {
    /// A command or question of the host; an answer is asked for in either case.
    #[must_use]
    pub fn host(read: bool, number: u8, code: u16, data: &[u8]) -> Self {
        let mut payload = code.to_le_bytes().to_vec();
        payload.extend(data);
        Self {
            read,
            refused: false,
            number,
            payload,
        }
    }

    /// Its reports: flags, number, length of the payload (little-endian), payload; the last one is filled with zeros.
    #[must_use]
    pub fn reports(&self) -> Vec<[u8; REPORT]> {
        let flags = REPLY | if self.read { READ } else { 0 } | if self.refused { NACK } else { 0 };
        let mut bytes = vec![flags, self.number];
        bytes.extend((self.payload.len() as u16).to_le_bytes());
        bytes.extend(&self.payload);
        let report = |chunk: &[u8]| {
            let mut report = [0; REPORT];
            report[..chunk.len()].copy_from_slice(chunk);
            report
        };
        bytes.chunks(REPORT).map(report).collect()
    }
}

/// Puts messages together from reports.
#[derive(Clone, Debug, Default)]
pub struct Assembler {
    bytes: Vec<u8>,
}

impl Assembler {
    /// Forgets a message that has begun.
    pub fn clear(&mut self) {
        self.bytes.clear();
    }

    /// The message that a report completes, if it does. Reports that begin no message are passed over.
    pub fn feed(&mut self, report: &[u8; REPORT]) -> Option<Message> {
        if self.bytes.is_empty() {
            let (flags, length) = (report[0], u16::from_le_bytes([report[2], report[3]]));
            // Reserved bits, another destination, or a length that no message has: noise.
            if flags & 0x1F != 0 || usize::from(length) > LONGEST {
                return None;
            }
        }
        self.bytes.extend(report);
        let end = 4 + usize::from(u16::from_le_bytes([self.bytes[2], self.bytes[3]]));
        if self.bytes.len() < end {
            return None;
        }
        let message = Message {
            read: self.bytes[0] & READ != 0,
            refused: self.bytes[0] & NACK != 0,
            number: self.bytes[1],
            payload: self.bytes[4..end].to_vec(),
        };
        self.bytes.clear();
        Some(message)
    }
}

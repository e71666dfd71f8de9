//! HID reports of 64 bytes, and messages that span one or more reports.

use super::super::line::LineError;
use std::time::Duration;

/// Size of a report in bytes.
pub const REPORT: usize = 64;
/// Longest accepted message, in bytes after its header.
const LONGEST: usize = 512;
/// Bits of the first byte of a message.
const READ: u8 = 0x80;
const REPLY: u8 = 0x40;
const NACK: u8 = 0x20;

/// A bidirectional channel for HID reports.
pub trait HidLine: Send {
    /// Sends one report.
    ///
    /// # Errors
    /// Returns [`LineError`] if the device is disconnected.
    fn write(&mut self, report: &[u8; REPORT]) -> Result<(), LineError>;

    /// Waits for one report.
    ///
    /// # Errors
    /// Returns [`LineError`] if no report arrives within the time `within`, or if the device is disconnected.
    fn read(&mut self, within: Duration) -> Result<[u8; REPORT], LineError>;

    /// Reopens the device after a disconnection.
    ///
    /// # Errors
    /// Returns [`LineError`] if the device cannot be opened.
    fn reopen(&mut self) -> Result<(), LineError>;
}

/// A message between host and controller. The host's payload begins with the command code. The controller's
/// payload is the reply data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Whether the message requests data or returns data.
    pub read: bool,
    /// Whether the controller refused the command (NACK).
    pub refused: bool,
    /// Sequence number, which the reply repeats.
    pub number: u8,
    /// Bytes after the header.
    pub payload: Vec<u8>,
}

impl Message {
    /// Creates a command or query of the host. Commands and queries both request a reply.
    pub fn host(read: bool, number: u8, code: u16, data: &[u8]) -> Self {
        let mut payload = code.to_le_bytes().to_vec();
        payload.extend(data);
        Self { read, refused: false, number, payload }
    }

    /// Encodes reports with flags, number, payload length (little-endian) and payload, padded with zeros.
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

/// Assembles messages from reports.
#[derive(Clone, Debug, Default)]
pub struct Assembler {
    bytes: Vec<u8>,
}

impl Assembler {
    /// Discards a partial message.
    pub fn clear(&mut self) {
        self.bytes.clear();
    }

    /// Adds a report. Returns the message that the report completes. Skips reports that do not begin a
    /// message.
    pub fn feed(&mut self, report: &[u8; REPORT]) -> Option<Message> {
        if self.bytes.is_empty() {
            let (flags, length) = (report[0], u16::from_le_bytes([report[2], report[3]]));
            // Reserved bits, another destination or an impossible length show that the report does not begin
            // with a message header.
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

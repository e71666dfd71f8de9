//! The journal of a run, with one JSON event per line in chronological order. If the journal has a line for a
//! frame, the frame is on disk.
//!
//! Only the writer appends to the journal and syncs it to disk. If a crash truncates a line, the line is
//! ignored and its frame is captured again. The journal is not part of the store's content, because times,
//! retries and interruptions differ between runs.

use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;

/// File name in the store.
pub const FILE: &str = ".session.jsonl";

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// The run starts or resumes.
    Begin {
        /// The first frame to capture.
        frame: u32,
        wall_s: f64,
    },
    /// A frame is on disk.
    Frame(FrameRecord),
    /// A step failed and is retried.
    Retry {
        frame: u32,
        /// The message of the [`crate::instrument::Failure`].
        failure: String,
        run_s: f64,
    },
    /// The run waits for a condition.
    Suspend { frame: u32, why: String, run_s: f64 },
    /// The wall clock jumped. Wall times before and after the jump cannot be compared, but run times can.
    ClockJump {
        /// Size of the jump in seconds.
        by_s: f64,
        run_s: f64,
    },
    /// All frames are on disk.
    End { wall_s: f64 },
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    pub frame: u32,
    /// CRC-32C of the frame's values as little-endian 32-bit integers.
    pub crc: u32,
    /// Encoder angles in degrees, in the order of the stages' names.
    pub angles_deg: Vec<f64>,
    /// Direction of the beam as measured by the mirrors' sensors, in degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pointing_deg: Option<[f64; 2]>,
    /// Number of laser pulses during the photon count.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulses: Option<u64>,
    /// CRC-32C of the time tags, if the run stores time tags.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tags_crc: Option<u32>,
    /// Temperatures of the instruments that have a sensor, in degrees Celsius. NaN values are omitted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub temperatures_c: Vec<(String, f64)>,
    /// The instrument's own frame number.
    pub number: u64,
    /// Seconds since the start of the run.
    pub run_s: f64,
    /// Wall time in seconds since 1970.
    pub wall_s: f64,
}

/// A journal that is open for appending.
#[derive(Debug)]
pub struct Journal {
    file: File,
}

impl Journal {
    /// Opens or creates the journal of a store for appending.
    ///
    /// # Errors
    /// Returns an error if the journal cannot be opened or created.
    pub fn open(store: &Path) -> io::Result<Self> {
        let path = store.join(FILE);
        let torn = match std::fs::read(&path) {
            Ok(bytes) => !bytes.is_empty() && !bytes.ends_with(b"\n"),
            Err(e) if e.kind() == io::ErrorKind::NotFound => false,
            Err(e) => return Err(e),
        };
        let mut file = OpenOptions::new().create(true).append(true).open(&path)?;
        if torn {
            file.write_all(b"\n")?;
        }
        Ok(Self { file })
    }

    /// Appends events and waits until they are on disk.
    ///
    /// # Errors
    /// Returns an error if the events cannot be written or synced.
    pub fn append(&mut self, events: &[Event]) -> io::Result<()> {
        let mut text = String::new();
        for event in events {
            text.push_str(&serde_json::to_string(event)?);
            text.push('\n');
        }
        self.file.write_all(text.as_bytes())?;
        self.file.sync_data()
    }
}

/// Calls `f` for every complete event of a store's journal, in order. A missing journal has no events.
///
/// # Errors
/// Returns an error if the journal cannot be read.
pub fn read(store: &Path, mut f: impl FnMut(Event)) -> io::Result<()> {
    let file = match base::input::open(&store.join(FILE)) {
        Ok(file) => file,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(e),
    };
    let mut reader = BufReader::new(file);
    let mut line = vec![];
    loop {
        line.clear();
        if io::Read::take(&mut reader, 1 << 20).read_until(b'\n', &mut line)? == 0 {
            return Ok(());
        }
        if let Ok(event) = serde_json::from_slice(&line) {
            f(event);
        }
    }
}

/// Returns the result of `keep` for the last record of each frame on disk. The frames are numbered from 0 and
/// end before the first missing frame.
///
/// `keep` selects the data that stay in memory, because a run can have half a million frames.
///
/// # Errors
/// Returns the same errors as [`read`].
pub fn frames<T>(store: &Path, keep: impl Fn(FrameRecord) -> T) -> io::Result<Vec<T>> {
    let mut found = vec![];
    read(store, |event| {
        if let Event::Frame(record) = event {
            let n = record.frame as usize;
            if n <= found.len() {
                found.truncate(n);
                found.push(keep(record));
            }
        }
    })?;
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(frame: u32) -> FrameRecord {
        FrameRecord {
            frame,
            crc: 7,
            angles_deg: vec![1.5],
            pointing_deg: None,
            pulses: None,
            tags_crc: None,
            temperatures_c: vec![],
            number: 3,
            run_s: 0.5,
            wall_s: 1e9,
        }
    }

    #[test]
    fn incomplete_lines_are_ignored_and_gaps_end_the_run() {
        let dir = tempfile::tempdir().expect("a folder");
        let store = dir.path();
        let mut journal = Journal::open(store).expect("opens");
        journal.append(&[Event::Frame(record(0)), Event::Frame(record(1))]).expect("appends");
        drop(journal);
        let path = store.join(FILE);
        let whole = std::fs::read(&path).expect("reads");
        std::fs::write(&path, &whole[..whole.len() - 5]).expect("writes");
        assert_eq!(frames(store, |r| r).expect("reads"), [record(0)]);
        let mut journal = Journal::open(store).expect("opens");
        journal.append(&[Event::Frame(record(2))]).expect("appends");
        assert_eq!(frames(store, |r| r).expect("reads"), [record(0)]);
        journal.append(&[Event::Frame(record(1))]).expect("appends");
        assert_eq!(frames(store, |r| r).expect("reads"), [record(0), record(1)]);
    }
}

//! The journal of a run: an event a line, JSON, in the order in which it happened; a frame's line is the proof that it is on
//! disk.
//!
//! Appended and synced to the disk by the writer alone. A line that a crash tore is no event: its frame is taken again. It
//! lies in the store under a name that is no part of the store's content, because it has what differs from one run to the
//! next: times, retries, interruptions.

use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

/// Its name in the store.
pub const FILE: &str = ".session.jsonl";

/// What happens in a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// A run begins, or goes on at a frame.
    Begin {
        /// The frame that is taken first.
        frame: u32,
        /// Seconds since 1970 by the wall's clock.
        wall_s: f64,
    },
    /// A frame is on disk.
    Frame(FrameRecord),
    /// A step failed and is tried again.
    Retry {
        /// The frame.
        frame: u32,
        /// What failed, as a [`crate::instrument::Failure`] says it.
        failure: String,
        /// Seconds since the run's begin.
        run_s: f64,
    },
    /// The run waits for a condition.
    Suspend {
        /// The frame.
        frame: u32,
        /// What for.
        why: String,
        /// Seconds since the run's begin.
        run_s: f64,
    },
    /// The wall's clock jumped: its times are not comparable across this line, the run's are.
    ClockJump {
        /// By how much, seconds.
        by_s: f64,
        /// Seconds since the run's begin.
        run_s: f64,
    },
    /// All frames are there.
    End {
        /// Seconds since 1970.
        wall_s: f64,
    },
}

/// What is known of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    /// Its number.
    pub frame: u32,
    /// CRC-32C of its numbers, 32 bits each, little-endian.
    pub crc: u32,
    /// Angles that stages' encoders read, degrees, by stage in the order of their names.
    pub angles_deg: Vec<f64>,
    /// Where the mirrors' sensors say that the beam points, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pointing_deg: Option<[f64; 2]>,
    /// Laser pulses while photons were counted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulses: Option<u64>,
    /// CRC-32C of its time tags, where these are kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tags_crc: Option<u32>,
    /// Temperatures of instruments that know theirs, degrees Celsius; NaN is not written.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub temperatures_c: Vec<(String, f64)>,
    /// The instrument's own count of frames.
    pub number: u64,
    /// Seconds since the run's begin.
    pub run_s: f64,
    /// Seconds since 1970 by the wall's clock.
    pub wall_s: f64,
}

/// An open journal.
#[derive(Debug)]
pub struct Journal {
    file: File,
}

fn file_of(store: &Path) -> PathBuf {
    store.join(FILE)
}

impl Journal {
    /// Opens the journal of a store, or begins it, to append.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn open(store: &Path) -> io::Result<Self> {
        let path = file_of(store);
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

    /// Appends events and waits until the disk has them.
    ///
    /// # Errors
    /// If the file system refuses.
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

/// Calls `f` for every whole event of a store's journal, in order. Without a journal there are none.
///
/// # Errors
/// If it cannot be read.
pub fn read(store: &Path, mut f: impl FnMut(Event)) -> io::Result<()> {
    let file = match base::input::open(&file_of(store)) {
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

/// What `keep` keeps of the records of the frames that are on disk: 0, 1, … without a gap, of each the last one. A night has
/// half a million of them.
///
/// # Errors
/// As [`read`].
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
    fn torn_lines_are_no_events_and_gaps_end_the_run() {
        let dir = tempfile::tempdir().expect("a folder");
        let store = dir.path();
        let mut journal = Journal::open(store).expect("opens");
        journal
            .append(&[Event::Frame(record(0)), Event::Frame(record(1))])
            .expect("appends");
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

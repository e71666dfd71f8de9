//! The journal of a render: which tiles are finished, so that a killed render resumes.
//!
//! An append-only file of JSON lines beside the store's groups. A tile's line is appended after all its chunks are in
//! place; a line torn by a crash is ignored, and that tile is simply rendered again to the same bytes.

use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Name of the journal inside the store's folder.
const FILE: &str = ".sunstone-progress";

/// What is known of one finished tile.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, PartialEq)]
pub struct TileRecord {
    /// Tile number, row-major.
    pub tile: u32,
    /// Camera samples taken.
    pub samples: u64,
    /// Samples thrown away because a value was not finite.
    pub discarded: u64,
    /// Rays traced.
    pub rays: u64,
    /// Seconds of one thread.
    pub seconds: f64,
}

/// An open journal.
pub struct Journal {
    path: PathBuf,
    file: Mutex<File>,
}

impl Journal {
    /// Opens (or begins) the journal of the store at `store` and returns what it holds.
    ///
    /// # Errors
    /// If the file cannot be read or written.
    pub fn open(store: &Path) -> std::io::Result<(Self, Vec<TileRecord>)> {
        let path = store.join(FILE);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(e) => return Err(e),
        };
        let records = text
            .lines()
            .filter_map(|l| serde_json::from_str(l).ok())
            .collect();
        let mut file = OpenOptions::new().create(true).append(true).open(&path)?;
        if !text.is_empty() && !text.ends_with('\n') {
            file.write_all(b"\n")?;
        }
        let file = Mutex::new(file);
        Ok((Self { path, file }, records))
    }

    /// Notes a finished tile.
    ///
    /// # Errors
    /// If the line cannot be written.
    pub fn push(&self, record: &TileRecord) -> std::io::Result<()> {
        let mut line = serde_json::to_string(record)?;
        line.push('\n');
        // A poisoned lock means another thread died between two whole lines; the file is still sound.
        let mut file = self
            .file
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        file.write_all(line.as_bytes())
    }

    /// Removes the journal: the render is complete.
    ///
    /// # Errors
    /// If the file cannot be removed.
    pub fn remove(self) -> std::io::Result<()> {
        std::fs::remove_file(self.path)
    }

    /// True if the store at `store` has a journal, that is, an unfinished render.
    #[must_use]
    pub fn exists(store: &Path) -> bool {
        store.join(FILE).exists()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_torn_line_is_ignored() {
        let dir = tempfile::tempdir().unwrap();
        let record = |tile| TileRecord {
            tile,
            samples: 10,
            discarded: 0,
            rays: 20,
            seconds: 0.5,
        };
        let (journal, old) = Journal::open(dir.path()).unwrap();
        assert!(old.is_empty());
        journal.push(&record(3)).unwrap();
        drop(journal);
        let path = dir.path().join(FILE);
        let mut text = std::fs::read_to_string(&path).unwrap();
        text.push_str("{\"tile\": 4, \"sam");
        std::fs::write(&path, text).unwrap();
        let (journal, old) = Journal::open(dir.path()).unwrap();
        assert_eq!(old, [record(3)]);
        journal.push(&record(5)).unwrap();
        drop(journal);
        let (_, old) = Journal::open(dir.path()).unwrap();
        assert_eq!(old, [record(3), record(5)]);
    }
}

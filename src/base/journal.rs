//! Journal of the completed parts of a long task, so that a killed task can resume.
//!
//! The journal is an append-only file of JSON lines in the output folder. The line of a part is appended
//! after all files of the part are written. If a crash truncates a line, the line is ignored, and the part is
//! computed again with an identical result.

use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

const FILE: &str = ".sunstone-progress";

#[derive(Debug)]
pub struct Journal<T> {
    path: PathBuf,
    file: Mutex<File>,
    record: PhantomData<fn(&T)>,
}

impl<T: Serialize + DeserializeOwned> Journal<T> {
    /// Opens or creates the journal in the folder `of` and returns its records.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read or written.
    pub fn open(of: &Path) -> std::io::Result<(Self, Vec<T>)> {
        let path = of.join(FILE);
        let text = text(of)?;
        let records = records(&text);
        let mut file = OpenOptions::new().create(true).append(true).open(&path)?;
        if !text.is_empty() && !text.ends_with('\n') {
            file.write_all(b"\n")?;
        }
        let file = Mutex::new(file);
        let record = PhantomData;
        Ok((Self { path, file, record }, records))
    }

    /// Records a completed part.
    ///
    /// # Errors
    /// Returns an error if the line cannot be written.
    pub fn push(&self, record: &T) -> std::io::Result<()> {
        let mut line = serde_json::to_string(record)?;
        line.push('\n');
        // After another thread's panic, the file is still valid, because each line is written with one call.
        let mut file = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        file.write_all(line.as_bytes())
    }

    /// Removes the journal of a complete task.
    ///
    /// # Errors
    /// Returns an error if the file cannot be removed.
    pub fn remove(self) -> std::io::Result<()> {
        std::fs::remove_file(self.path)
    }
}

/// Returns the records of the journal in the folder `of`, which another process may be writing. Incomplete
/// lines are ignored. A folder without a journal has no records.
///
/// # Errors
/// Returns an error if the file cannot be read.
pub fn read<T: DeserializeOwned>(of: &Path) -> std::io::Result<Vec<T>> {
    Ok(records(&text(of)?))
}

/// Returns the text of the journal in a folder. The text is empty if there is no journal.
fn text(of: &Path) -> std::io::Result<String> {
    match crate::input::read_text(&of.join(FILE)) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(String::new()),
        read => read,
    }
}

fn records<T: DeserializeOwned>(text: &str) -> Vec<T> {
    text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

/// Returns whether the folder `of` has a journal, that is, contains unfinished work.
pub fn exists(of: &Path) -> bool {
    of.join(FILE).exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_incomplete_line_is_ignored() {
        let dir = tempfile::tempdir().unwrap();
        let record = |tile: u32| [tile, 10, 20];
        let (journal, old) = Journal::<[u32; 3]>::open(dir.path()).unwrap();
        assert!(old.is_empty());
        journal.push(&record(3)).unwrap();
        drop(journal);
        let path = dir.path().join(FILE);
        let mut text = std::fs::read_to_string(&path).unwrap();
        text.push_str("[4, 1");
        std::fs::write(&path, text).unwrap();
        let (journal, old) = Journal::open(dir.path()).unwrap();
        assert_eq!(old, [record(3)]);
        journal.push(&record(5)).unwrap();
        drop(journal);
        let (_, old) = Journal::<[u32; 3]>::open(dir.path()).unwrap();
        assert_eq!(old, [record(3), record(5)]);
    }
}

//! Represents a calibration file as a tree that does not depend on the file's syntax, and locates errors in
//! the file.

use super::{npz, yaml};
use base::locate::InputError;
use serde_json::Value;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum size of a text file in bytes. The usual size of a calibration file is a few kilobytes.
const LARGEST: u64 = 64 << 20;

const FIX: &str = "give a calibration as .yaml, .yml, .json or .npz";

pub(super) struct Document {
    pub(super) file: PathBuf,
    /// The text of the calibration file, or an empty text for binary files.
    text: Arc<str>,
    pub(super) root: Value,
}

impl Document {
    /// Reads a file in the format that its extension indicates.
    pub(super) fn load(path: &Path) -> Result<Self, InputError> {
        let failed = |message: String| InputError::new(path, "", None, message, FIX);
        let mut bytes = vec![];
        base::input::open(path)
            .and_then(|f| f.take(LARGEST + 1).read_to_end(&mut bytes))
            .map_err(|e| failed(format!("cannot read the calibration: {e}")))?;
        if bytes.len() as u64 > LARGEST {
            return Err(failed("the calibration is larger than 64 MiB".into()));
        }
        Self::parse(path, bytes)
    }

    pub(super) fn parse(path: &Path, bytes: Vec<u8>) -> Result<Self, InputError> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        let error = |text: &str, at: Option<usize>, message: String| {
            InputError::new(path, text, at.map(|at| at..at), message, FIX)
        };
        let (text, root) = if extension == "npz" {
            let root = npz::read(bytes).map_err(|e| error("", None, e))?;
            (String::new(), root)
        } else {
            let text = String::from_utf8(bytes)
                .map_err(|e| error("", None, format!("the calibration is not UTF-8 text: {e}")))?;
            let root = if extension == "json" {
                serde_json::from_str(&text).map_err(|e| {
                    let line = text.split_inclusive('\n').take(e.line().saturating_sub(1));
                    let at = line.map(str::len).sum::<usize>() + e.column().saturating_sub(1);
                    error(&text, Some(boundary(&text, at)), format!("invalid JSON: {e}"))
                })?
            } else {
                yaml::read(&text).map_err(|(at, e)| {
                    error(&text, Some(boundary(&text, at)), format!("invalid YAML: {e}"))
                })?
            };
            (text, root)
        };
        Ok(Self { file: path.to_owned(), text: text.into(), root })
    }

    /// Returns an error located at the last key of the path `keys`.
    pub(super) fn error(&self, keys: &[String], message: &str, help: &str) -> InputError {
        let named = if keys.is_empty() { String::new() } else { format!("`{}`: ", keys.join(".")) };
        InputError::new(&self.file, self.text.clone(), self.find(keys), format!("{named}{message}"), help)
    }

    /// Returns the location of the last key of the path `keys`. The search for each key starts after the
    /// location of the previous key.
    fn find(&self, keys: &[String]) -> Option<std::ops::Range<usize>> {
        let mut span = None;
        let mut from = 0;
        for key in keys {
            let is_key = |at: &usize| {
                let before = self.text[..*at].chars().next_back();
                let after = self.text[*at + key.len()..].trim_start_matches(['"', '\'', ' ']);
                before.is_none_or(|c| !c.is_alphanumeric() && c != '_') && after.starts_with(':')
            };
            let at = self.text[from..].match_indices(key.as_str()).map(|(i, _)| from + i).find(is_key)?;
            from = at + key.len();
            span = Some(at..from);
        }
        span
    }
}

/// Returns the last character boundary at or before the byte offset `at`.
fn boundary(text: &str, at: usize) -> usize {
    let mut at = at.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

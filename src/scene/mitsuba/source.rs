//! Stores the texts of a Mitsuba scene and its included files, and the errors in these texts.
//!
//! Locations are byte offsets into the concatenation of all texts in reading order. One number therefore
//! identifies both the file and the offset in the file.

use base::locate::InputError;
use std::cell::RefCell;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum number of errors that are recorded.
const MOST_PROBLEMS: usize = 50;

const MOST_NODES: u32 = 4_000_000;

struct Text {
    start: usize,
    file: PathBuf,
    text: Arc<str>,
}

/// The texts of all files, beginning with the main file, and all recorded errors.
#[derive(Default)]
pub(super) struct Source {
    texts: RefCell<Vec<Text>>,
    problems: RefCell<Vec<InputError>>,
}

impl Source {
    pub fn new(file: &Path, text: &str) -> Self {
        let source = Self::default();
        source.add(file, text);
        source
    }

    /// Adds a file and returns the offset of its first byte in the concatenation.
    pub fn add(&self, file: &Path, text: &str) -> usize {
        let mut texts = self.texts.borrow_mut();
        let start = texts.last().map_or(0, |t| t.start + t.text.len() + 1);
        texts.push(Text { start, file: file.to_owned(), text: text.into() });
        start
    }

    /// Returns the path and the text of the main file.
    pub fn main(&self) -> (PathBuf, Arc<str>) {
        self.texts
            .borrow()
            .first()
            .map_or_else(|| (PathBuf::new(), "".into()), |t| (t.file.clone(), t.text.clone()))
    }

    pub fn error(&self, span: &Range<usize>, message: impl Into<String>, help: &str) -> InputError {
        let (file, text) = self.main();
        self.placed(InputError::new(file, text, Some(span.clone()), message, help))
    }

    /// Converts an error's location from an offset in the concatenation to a file and an offset in the file.
    pub fn placed(&self, e: InputError) -> InputError {
        let texts = self.texts.borrow();
        let Some(span) = e.span.clone() else {
            return e;
        };
        let Some(text) = texts.iter().rfind(|t| t.start <= span.start) else {
            return e;
        };
        let within = |at: usize| (at - text.start).min(text.text.len());
        InputError {
            file: text.file.clone(),
            text: text.text.clone(),
            span: Some(within(span.start)..within(span.end.max(span.start))),
            ..e
        }
    }

    /// Records an error, so that reading can continue.
    pub fn report(&self, e: InputError) {
        let mut problems = self.problems.borrow_mut();
        let answer = |p: &InputError| p.file == e.file && p.span == e.span && p.message == e.message;
        if problems.len() < MOST_PROBLEMS && !problems.iter().any(answer) {
            problems.push(e);
        }
    }

    /// Returns the value of a result, or records its error and returns `None`.
    pub fn accept<T>(&self, result: Result<T, InputError>) -> Option<T> {
        result.map_err(|e| self.report(e)).ok()
    }

    pub fn any_problem(&self) -> bool {
        !self.problems.borrow().is_empty()
    }

    /// Removes and returns all errors, sorted by file and offset.
    pub fn problems(&self) -> Vec<InputError> {
        let mut problems = self.problems.take();
        let texts = self.texts.borrow();
        let number = |e: &InputError| texts.iter().position(|t| t.file == e.file);
        problems.sort_by_key(|e| (number(e), e.span.as_ref().map(|s| s.start)));
        problems
    }
}

/// Parses the elements of a file whose first byte has the offset `start`.
pub(super) fn parse<'t>(
    source: &Source,
    start: usize,
    text: &'t str,
) -> Result<roxmltree::Document<'t>, InputError> {
    let options = roxmltree::ParsingOptions { nodes_limit: MOST_NODES, ..Default::default() };
    roxmltree::Document::parse_with_options(text, options).map_err(|e| {
        let at = start + offset(text, e.pos());
        let message = e.to_string();
        let message = message.split(" at ").next().unwrap_or(&message);
        source.error(
            &(at..at),
            format!("invalid XML: {message}"),
            "correct the file; see Mitsuba's documentation of the scene format",
        )
    })
}

/// Returns the byte offset of a position that is given by line and column, both counted from 1. Columns are
/// in characters.
fn offset(text: &str, pos: roxmltree::TextPos) -> usize {
    let mut line_start = 0;
    for _ in 1..pos.row {
        match text[line_start..].find('\n') {
            Some(end) => line_start += end + 1,
            None => return text.len(),
        }
    }
    let column = pos.col.saturating_sub(1) as usize;
    text[line_start..].char_indices().nth(column).map_or(text.len(), |(i, _)| line_start + i)
}

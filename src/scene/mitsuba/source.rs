//! The text of a Mitsuba scene, with included files, and the errors found in it.
//!
//! Locations are byte offsets into the concatenation of all texts in reading order, so one number identifies
//! file and offset.

use base::locate::InputError;
use std::cell::RefCell;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum number of errors that are reported.
const MOST_PROBLEMS: usize = 50;

struct Text {
    start: usize,
    file: PathBuf,
    text: Arc<str>,
}

/// All files, the main file first, and all errors so far.
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

    /// Adds a file and returns the offset of its first byte.
    pub fn add(&self, file: &Path, text: &str) -> usize {
        let mut texts = self.texts.borrow_mut();
        let start = texts.last().map_or(0, |t| t.start + t.text.len() + 1);
        texts.push(Text { start, file: file.to_owned(), text: text.into() });
        start
    }

    /// Returns the main file and its text.
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

    /// Converts an error's location from the concatenation to a file and its offset.
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

//! Notes for the user about contents of a file that are not used.

/// Notes in order of occurrence, with the count of equal notes.
#[derive(Clone, Debug, Default)]
pub(super) struct Notes(Vec<(String, usize)>);

impl Notes {
    /// Adds a note, or increments the count of an equal note.
    pub fn add(&mut self, note: impl Into<String>) {
        self.add_times(note, 1);
    }

    /// Adds a note about `times` items. Adds nothing if `times` is 0.
    pub fn add_times(&mut self, note: impl Into<String>, times: usize) {
        let note = note.into();
        match self.0.iter_mut().find(|(known, _)| *known == note) {
            _ if times == 0 => {}
            Some((_, count)) => *count += times,
            None => self.0.push((note, times)),
        }
    }

    /// Returns one sentence per note.
    pub fn into_sentences(self) -> Vec<String> {
        let sentence = |(note, times): (String, usize)| match times {
            1 => note,
            _ => format!("{note} ({times} times)"),
        };
        self.0.into_iter().map(sentence).collect()
    }
}

//! What a file holds that is not used, for people.

/// Notes in the order in which they were found, equal ones counted.
#[derive(Clone, Debug, Default)]
pub(super) struct Notes(Vec<(String, usize)>);

impl Notes {
    /// Adds a note; the same one again is only counted.
    pub fn add(&mut self, note: impl Into<String>) {
        self.add_times(note, 1);
    }

    /// Adds a note that holds for `times` things; for none of them there is no note.
    pub fn add_times(&mut self, note: impl Into<String>, times: usize) {
        let note = note.into();
        match self.0.iter_mut().find(|(known, _)| *known == note) {
            _ if times == 0 => {}
            Some((_, count)) => *count += times,
            None => self.0.push((note, times)),
        }
    }

    /// One sentence for each note.
    pub fn into_sentences(self) -> Vec<String> {
        let sentence = |(note, times): (String, usize)| match times {
            1 => note,
            _ => format!("{note} ({times} times)"),
        };
        self.0.into_iter().map(sentence).collect()
    }
}

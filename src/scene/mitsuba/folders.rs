//! Where a Mitsuba scene's files are, and other names of what it holds.

use std::ops::Range;
use std::path::{Path, PathBuf};

/// Most bytes of a text that a scene includes.
const MOST_BYTES: u64 = 256 << 20;

/// `<alias id="…" as="…"/>`: another name of an id.
pub(super) struct Alias {
    pub id: String,
    pub other: String,
    pub span: Range<usize>,
}

/// The folders in which files are looked for, as Mitsuba does: those of `<path>`, the last one first, then the scene's own.
#[derive(Clone)]
pub(super) struct Folders(Vec<PathBuf>);

impl Folders {
    /// The folder of a scene.
    pub fn of(scene: &Path) -> Self {
        let path = std::path::absolute(scene).unwrap_or_else(|_| scene.to_owned());
        Self(vec![path.parent().unwrap_or(Path::new("")).to_owned()])
    }

    /// Looks in this folder first from now on.
    pub fn prepend(&mut self, folder: PathBuf) {
        self.0.insert(0, folder);
    }

    /// The path of a file: where it is, or where the scene's own folder would have it.
    pub fn find(&self, name: &str) -> PathBuf {
        let mut paths = self.0.iter().map(|folder| folder.join(name));
        let own = paths.clone().next_back().unwrap_or_default();
        paths.find(|path| path.exists()).unwrap_or(own)
    }
}

/// Text of a file; neither a pipe nor a folder nor more than [`MOST_BYTES`].
pub(super) fn read_text(path: &Path) -> std::io::Result<String> {
    let meta = std::fs::metadata(path)?;
    if !meta.is_file() {
        return Err(std::io::Error::other("expected a file"));
    }
    if meta.len() > MOST_BYTES {
        return Err(std::io::Error::other("the file is too large for a scene"));
    }
    std::fs::read_to_string(path)
}

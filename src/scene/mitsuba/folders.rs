//! Finds files in the search folders of a Mitsuba scene, and defines aliases of ids and relative paths.

use std::ops::Range;
use std::path::{Component, Path, PathBuf};

/// Maximum size in bytes of an included text file.
const MOST_BYTES: u64 = 256 << 20;

/// An additional name of an id, from `<alias id="…" as="…"/>`.
pub(super) struct Alias {
    pub id: String,
    pub other: String,
    pub span: Range<usize>,
}

/// Search folders in Mitsuba's order. The folders of `<path>` elements come first, in reverse order of the
/// elements. The scene's own folder is the last.
#[derive(Clone)]
pub(super) struct Folders(Vec<PathBuf>);

impl Folders {
    /// Creates a list that contains only the folder of a scene.
    pub fn of(scene: &Path) -> Self {
        let path = std::path::absolute(scene).unwrap_or_else(|_| scene.to_owned());
        Self(vec![path.parent().unwrap_or(Path::new("")).to_owned()])
    }

    /// Adds a folder, which is searched before all other folders.
    pub fn prepend(&mut self, folder: PathBuf) {
        self.0.insert(0, folder);
    }

    /// Searches the folders for a file and returns its path. If no folder contains the file, returns the path
    /// in the scene's own folder.
    pub fn find(&self, name: &str) -> PathBuf {
        let mut paths = self.0.iter().map(|folder| folder.join(name));
        let own = paths.clone().next_back().unwrap_or_default();
        paths.find(|path| path.exists()).unwrap_or(own)
    }
}

/// Reads the text of a regular file of at most [`MOST_BYTES`].
pub(super) fn read_text(path: &Path) -> std::io::Result<String> {
    let meta = std::fs::metadata(path)?;
    if !meta.is_file() {
        return Err(std::io::Error::other("expected a regular file"));
    }
    if meta.len() > MOST_BYTES {
        return Err(std::io::Error::other("the file is larger than 256 MiB"));
    }
    std::fs::read_to_string(path)
}

/// Returns the relative path from the absolute path `folder` to the absolute path `path`.
pub(super) fn relative(folder: &Path, path: &Path) -> PathBuf {
    let path = normal(path);
    let folder = normal(folder);
    let (a, b): (Vec<Component>, Vec<Component>) =
        (folder.components().collect(), path.components().collect());
    let shared = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    if shared == 0 {
        return path;
    }
    let up = a[shared..].iter().map(|_| Component::ParentDir);
    up.chain(b[shared..].iter().copied()).collect()
}

/// Removes `.` from a path, and `..` if the removal does not change the meaning of the path.
fn normal(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if out.file_name().is_some() => {
                out.pop();
            }
            other => out.push(other),
        }
    }
    out
}

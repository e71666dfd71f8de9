//! Relative paths.

use std::path::{Component, Path, PathBuf};

/// Returns the path from `folder` to `path`, both absolute.
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

/// Removes `.` and, where that is safe, `..` from a path.
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

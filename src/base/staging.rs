//! Atomic creation of folders, which are built next to the destination under a hidden name and then renamed.
//!
//! A killed process may leave two folders: `.NAME.part` (unfinished work, to be resumed or restarted) and
//! `.NAME.old` (a replaced folder, to be deleted). The next process that holds the destination's
//! [`super::lock::Lock`] handles both folders.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

fn beside(path: &Path, kind: &str) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{kind}"))
}

/// Returns the path of the unfinished folder, which is `.NAME.part` next to the destination.
pub fn part_of(path: &Path) -> PathBuf {
    beside(path, "part")
}

/// Removes a folder if it exists.
///
/// # Errors
/// Returns the error of the file system.
pub fn remove(folder: &Path) -> io::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(e) if e.kind() != ErrorKind::NotFound => Err(e),
        _ => Ok(()),
    }
}

/// Completes or reverts the replacement of the folder at `path`, if the process that replaced it was killed.
/// Deletes the old folder if the new folder is at `path`, and otherwise moves the old folder back to `path`.
/// Only the holder of the lock may call this function.
///
/// # Errors
/// Returns the error of the file system.
pub fn recover(path: &Path) -> io::Result<()> {
    let old = beside(path, "old");
    if fs::symlink_metadata(&old).is_err() {
        return Ok(());
    }
    if fs::symlink_metadata(path).is_err() {
        return fs::rename(&old, path);
    }
    remove(&old)
}

/// Renames the folder `part` to `path` and replaces an existing folder. The replacement is atomic if the
/// system supports it.
///
/// # Errors
/// Returns the error of the file system. If the replacement itself fails, the old folder remains at `path`.
pub fn put(part: &Path, path: &Path) -> io::Result<()> {
    if fs::symlink_metadata(path).is_err() {
        return fs::rename(part, path);
    }
    let old = beside(path, "old");
    remove(&old)?;
    if exchange(part, path).is_ok() {
        // Rename the old folder, so that it is recognized after a crash as a folder to delete.
        fs::rename(part, &old)?;
        return remove(&old);
    }
    fs::rename(path, &old)?;
    if let Err(e) = fs::rename(part, path) {
        let _ = fs::rename(&old, path);
        return Err(e);
    }
    remove(&old)
}

#[cfg(any(target_os = "linux", target_os = "android", target_os = "macos"))]
fn exchange(a: &Path, b: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE)?)
}

#[cfg(not(any(target_os = "linux", target_os = "android", target_os = "macos")))]
fn exchange(_: &Path, _: &Path) -> io::Result<()> {
    Err(ErrorKind::Unsupported.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(path: &Path, content: &str) {
        fs::create_dir_all(path).expect("a folder");
        fs::write(path.join("f"), content).expect("writes");
    }

    fn content(path: &Path) -> String {
        fs::read_to_string(path.join("f")).expect("reads")
    }

    #[test]
    fn put_replaces_an_existing_folder() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("s");
        for new in ["one", "two"] {
            folder(&part_of(&path), new);
            put(&part_of(&path), &path).expect("is put");
            assert_eq!(content(&path), new);
        }
        assert_eq!(fs::read_dir(dir.path()).expect("lists").count(), 1);
    }

    #[test]
    fn recover_restores_or_removes_the_old_folder() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("s");
        folder(&dir.path().join(".s.old"), "old");
        recover(&path).expect("comes back");
        assert_eq!(content(&path), "old");
        folder(&dir.path().join(".s.old"), "older");
        recover(&path).expect("goes");
        assert_eq!(content(&path), "old");
        assert_eq!(fs::read_dir(dir.path()).expect("lists").count(), 1);
        recover(&path).expect("nothing to do");
    }
}

//! Folders that appear whole: made beside their place under a name that no reader looks for, then put there in one step.
//!
//! What a killed process left is found by the next one that works on the same place (which holds its [`super::lock::Lock`]):
//! `.NAME.part`, work to go on with, or to begin again, and `.NAME.old`, what was on its way out.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

fn beside(path: &Path, kind: &str) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{kind}"))
}

/// Where a folder is made before it is complete: `.NAME.part` beside it.
#[must_use]
pub fn part_of(path: &Path) -> PathBuf {
    beside(path, "part")
}

/// Removes a folder if it is there.
///
/// # Errors
/// If the file system refuses.
pub fn remove(folder: &Path) -> io::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(e) if e.kind() != ErrorKind::NotFound => Err(e),
        _ => Ok(()),
    }
}

/// Puts what a process that was killed while it replaced the folder at `path` had moved away back, or removes it where the
/// new one had come. Only the holder of the place's lock may call it.
///
/// # Errors
/// If the file system refuses.
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

/// Gives the folder `part` the name `path`, in the place of what has it. Where the system can exchange two names at once,
/// there is no moment at which nothing has it.
///
/// # Errors
/// If the file system refuses; the old folder is where it was.
pub fn put(part: &Path, path: &Path) -> io::Result<()> {
    if fs::symlink_metadata(path).is_err() {
        return fs::rename(part, path);
    }
    let old = beside(path, "old");
    remove(&old)?;
    if exchange(part, path).is_ok() {
        // Under the other name, by which it is known as what may go.
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
    fn a_folder_takes_the_place_of_another() {
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
    fn what_was_on_its_way_out_comes_back_or_goes() {
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

//! Writes the files of a scene atomically.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Contents of a file of an exported scene.
#[derive(Clone, Debug)]
pub enum Contents {
    Bytes(Vec<u8>),
    /// A copy of the file at the given path, which can be too large for memory.
    CopyOf(PathBuf),
}

#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    #[error(
        "{0} exists and is not an empty folder; choose another folder, or pass --force to write into this folder"
    )]
    Occupied(PathBuf),
    #[error("{0} exists; choose another name, or pass --force to replace the file")]
    Exists(PathBuf),
    #[error("cannot write {0}: {1}; check that the folder is writable and the disk is not full")]
    Io(PathBuf, io::Error),
}

/// Writes files into a new folder, which is created atomically after all files are written. If `force` is
/// true, the folder may already contain files. Each file then atomically replaces a file of the same name, in
/// the order of `files`. The file that refers to the other files must be the last.
///
/// # Errors
/// Returns [`WriteError`] if a file cannot be written. After an error, a new folder is not created.
pub(super) fn write(folder: &Path, files: &[(String, Contents)], force: bool) -> Result<(), WriteError> {
    let at = |path: &Path| {
        let path = path.to_owned();
        move |e| WriteError::Io(path, e)
    };
    let occupied = match fs::read_dir(folder) {
        Ok(mut entries) => entries.next().is_some(),
        Err(e) if e.kind() == io::ErrorKind::NotFound => false,
        Err(_) => return Err(WriteError::Occupied(folder.to_owned())),
    };
    if occupied && !force {
        return Err(WriteError::Occupied(folder.to_owned()));
    }
    let absolute = std::path::absolute(folder).map_err(at(folder))?;
    let parent = absolute.parent().unwrap_or(&absolute);
    fs::create_dir_all(parent).map_err(at(parent))?;
    let temporary = |at: &Path, name: &str| at.join(format!(".{name}.{}.tmp", std::process::id()));
    if occupied {
        for (name, contents) in files {
            let (path, beside) = (absolute.join(name), temporary(&absolute, name));
            let done = fill(&beside, contents).and_then(|()| fs::rename(&beside, &path));
            cleaned(done, || fs::remove_file(&beside)).map_err(at(&path))?;
        }
        return Ok(());
    }
    let fresh = temporary(parent, &absolute.file_name().unwrap_or_default().to_string_lossy());
    let fill_all = || {
        fs::create_dir(&fresh)?;
        for (name, contents) in files {
            fill(&fresh.join(name), contents)?;
        }
        // Replace an empty folder, but not a folder that was filled in the meantime.
        match fs::remove_dir(&absolute) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
            _ => fs::rename(&fresh, &absolute),
        }
    };
    cleaned(fill_all(), || fs::remove_dir_all(&fresh)).map_err(at(folder))
}

fn fill(path: &Path, contents: &Contents) -> io::Result<()> {
    match contents {
        Contents::Bytes(bytes) => fs::write(path, bytes),
        Contents::CopyOf(source) => fs::copy(source, path).map(drop),
    }
}

/// If a write failed, removes its remains. Returns the result of the write.
fn cleaned(done: io::Result<()>, remove: impl FnOnce() -> io::Result<()>) -> io::Result<()> {
    if done.is_err() {
        let _ = remove();
    }
    done
}

/// Writes one file atomically.
///
/// # Errors
/// Returns [`WriteError`] if the file exists and `force` is not set, or if the file system reports an error.
pub(super) fn write_one(path: &Path, contents: &Contents, force: bool) -> Result<(), WriteError> {
    if path.exists() && !force {
        return Err(WriteError::Exists(path.to_owned()));
    }
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|e| WriteError::Io(folder.to_owned(), e))?;
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let beside = path.with_file_name(format!(".{name}.{}.tmp", std::process::id()));
    let done = fill(&beside, contents).and_then(|()| fs::rename(&beside, path));
    cleaned(done, || fs::remove_file(&beside)).map_err(|e| WriteError::Io(path.to_owned(), e))
}

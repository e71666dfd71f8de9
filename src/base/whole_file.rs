//! Writes files atomically: a file is written completely or not at all.
//!
//! Bytes are written to a temporary file (`.NAME.PID-N.tmp`) next to the destination. The temporary file is
//! then renamed to the destination. If the process is killed, the destination is either the old file or the
//! complete new file. The temporary file may remain. Files are not synchronized to disk, so a power failure
//! may damage them.

use crate::input;
use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

static COUNTER: AtomicU64 = AtomicU64::new(0);

/// Returns a path for a temporary file next to `path`. The name is unique in this process and among running
/// processes.
pub fn temporary_beside(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let n = COUNTER.fetch_add(1, Ordering::Relaxed);
    path.with_file_name(format!(".{name}.{}-{n}.tmp", std::process::id()))
}

/// Returns whether a name has the form of the names that [`temporary_beside`] returns.
pub fn is_temporary(name: &str) -> bool {
    name.starts_with('.') && name.ends_with(".tmp")
}

/// Returns whether two paths refer to the same existing file or folder, even if the paths contain links.
pub fn is_same(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a_path), Ok(b_path)) => a_path == b_path || is_same_node(a, b),
        _ => false,
    }
}

/// Resolves symbolic links and dots in a path whose last components need not exist.
pub fn real(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut found = PathBuf::new();
    for part in absolute.components() {
        match part {
            Component::ParentDir => {
                found.pop();
            }
            part => found.push(part),
        }
        found = found.canonicalize().unwrap_or(found);
    }
    found
}

/// Returns whether two paths refer to the same inode. An inode can have several paths because of hard links.
#[cfg(unix)]
fn is_same_node(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let node = |path: &Path| fs::metadata(path).map(|m| (m.dev(), m.ino())).ok();
    node(a).is_some_and(|of_a| node(b) == Some(of_a))
}

#[cfg(not(unix))]
fn is_same_node(_: &Path, _: &Path) -> bool {
    false
}

/// Writes a file atomically: writes a temporary file in the same directory and then renames the file. Creates
/// missing directories.
///
/// # Errors
/// Returns the error of the file system. The old file, if any, is unchanged.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    // Retry, because another process that opens a store for writing may remove the temporary file.
    let mut attempts = 3;
    loop {
        attempts -= 1;
        match put(path, |file| file.write_all(bytes)) {
            Err(e) if e.kind() == ErrorKind::NotFound && attempts > 0 => {}
            result => return result,
        }
    }
}

/// Removes temporary files that killed processes left, and writes a file as [`write()`] does, through a
/// buffered writer.
///
/// # Errors
/// Returns the same errors as [`write()`], and the errors of `fill`.
pub fn write_with(path: &Path, fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
    sweep(path);
    put(path, fill)
}

/// Removes temporary files of `path` whose processes have ended, and ignores errors.
fn sweep(path: &Path) {
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let begin = format!(".{}.", path.file_name().unwrap_or_default().to_string_lossy());
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let numbers = name.strip_prefix(&begin).and_then(|rest| rest.strip_suffix(".tmp"));
        let process = numbers.and_then(|n| n.split_once('-')?.0.parse().ok());
        if process.is_some_and(|id| !is_running(id)) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Returns whether a process with this id may be running.
fn is_running(id: i32) -> bool {
    #[cfg(unix)]
    {
        use rustix::io::Errno;
        use rustix::process::{Pid, test_kill_process};
        // A process of another user exists even if it cannot be signalled.
        Pid::from_raw(id).is_some_and(|pid| test_kill_process(pid) != Err(Errno::SRCH))
    }
    #[cfg(not(unix))]
    {
        let _ = id;
        true
    }
}

fn put(path: &Path, fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
    if input::is_special(path) {
        return Err(io::Error::new(ErrorKind::InvalidInput, "expected a file, got a device or pipe"));
    }
    let parent = path.parent().unwrap_or(Path::new(""));
    let made: Vec<&Path> =
        parent.ancestors().take_while(|a| !a.as_os_str().is_empty() && !a.exists()).collect();
    let temporary = temporary_beside(path);
    let result = (|| {
        fs::create_dir_all(parent)?;
        let mut file = BufWriter::new(File::create(&temporary)?);
        fill(&mut file)?;
        file.into_inner().map_err(io::IntoInnerError::into_error)?;
        fs::rename(&temporary, path)
    })();
    if result.is_err() {
        let _ = fs::remove_file(&temporary);
        // Remove the folders created for the file, unless they are in use.
        let _ = made.iter().try_for_each(fs::remove_dir);
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn temporary_files_of_dead_processes_are_removed() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("f.npy");
        // No process has the largest ID. Two of the names belong to this process or to another file.
        let mine = format!(".f.npy.{}-99.tmp", std::process::id());
        let names = [".f.npy.2147483647-0.tmp", &mine, ".g.npy.2147483647-0.tmp"];
        names.iter().for_each(|name| fs::write(dir.path().join(name), b"half").expect("writes"));
        write_with(&path, |file| file.write_all(b"whole")).expect("writes");
        assert!(!dir.path().join(names[0]).exists());
        assert!(names[1..].iter().all(|name| dir.path().join(name).exists()));
    }

    #[test]
    fn files_are_replaced_without_leaving_temporary_files() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("f");
        write(&path, b"one").expect("writes");
        write(&path, b"two").expect("writes");
        assert_eq!(fs::read(&path).expect("reads"), b"two");
        assert_eq!(fs::read_dir(dir.path()).expect("lists").count(), 1);
        let failed = write_with(&path, |file| {
            file.write_all(b"half")?;
            Err(io::Error::other("no more"))
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&path).expect("reads"), b"two");
        assert_eq!(fs::read_dir(dir.path()).expect("lists").count(), 1);
    }
}

//! Exclusive locks on outputs, so that each path has at most one writer.
//!
//! A lock is an advisory lock of the operating system on the file `.NAME.lock` next to the output. The file
//! contains the holder's host and process. The system releases the lock when the holder exits for any reason,
//! so a stale lock file does not block others. The holder removes the file when it is done.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Number of attempts to read the holder from a lock file.
const TRIES: u32 = 100;
/// Time between two attempts to read the holder.
const WAIT: Duration = Duration::from_millis(2);

/// A lock that is held until it is dropped.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    /// Closing the file releases the lock.
    _file: File,
}

/// Reason why a lock was not acquired.
#[derive(Debug)]
pub enum LockError {
    /// Another holder has the lock. Contains the name of the holder, for example `process 12 on host`.
    Held(String),
    Io(io::Error),
}

/// Returns the path of an output's lock file: `.NAME.lock` in the same folder.
pub fn file_of(output: &Path) -> PathBuf {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    output.with_file_name(format!(".{name}.lock"))
}

impl Lock {
    /// Locks an output. The output need not exist. Missing parent folders are created. Symbolic links are
    /// followed.
    ///
    /// # Errors
    /// Returns [`LockError`] if another process or another thread of this process holds the lock, or the
    /// file system fails.
    pub fn take(output: &Path) -> Result<Self, LockError> {
        let real = output.canonicalize().unwrap_or_else(|_| output.to_owned());
        let path = file_of(&real);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(LockError::Io)?;
        }
        loop {
            let mut file = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .open(&path)
                .map_err(LockError::Io)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(LockError::Held(holder(file)));
                }
                Err(TryLockError::Error(e)) => return Err(LockError::Io(e)),
            }
            // A previous holder may have removed the file after this process opened it, so that the lock is
            // on a deleted file.
            if !is_file_at(&file, &path) {
                continue;
            }
            let who = holder_name() + "\n";
            file.set_len(0)
                .and_then(|()| file.rewind())
                .and_then(|()| file.write_all(who.as_bytes()))
                .map_err(LockError::Io)?;
            return Ok(Self { path, _file: file });
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Remove the file while it is locked. A process that has already opened the file detects the removal.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Returns the holder of a lock from the lock file. Retries if the holder has not yet written the file.
fn holder(mut file: File) -> String {
    for _ in 0..TRIES {
        let mut text = String::new();
        let read = file.rewind().and_then(|()| (&mut file).take(200).read_to_string(&mut text));
        if read.is_ok() && text.ends_with('\n') {
            return text.trim().to_owned();
        }
        std::thread::sleep(WAIT);
    }
    "another process".to_owned()
}

/// Returns whether an open file is still the file at a path.
fn is_file_at(file: &File, path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let (Ok(a), Ok(b)) = (file.metadata(), std::fs::metadata(path)) else {
            return false;
        };
        (a.dev(), a.ino()) == (b.dev(), b.ino())
    }
    #[cfg(not(unix))]
    {
        // On this system, open files cannot be removed, so the file is still at the path.
        let _ = file;
        path.exists()
    }
}

/// Returns the name of this process as a lock holder, for example `process 12 on host`.
pub fn holder_name() -> String {
    format!("process {} on {}", std::process::id(), host())
}

fn host() -> String {
    #[cfg(unix)]
    let name = rustix::system::uname().nodename().to_string_lossy().into_owned();
    #[cfg(not(unix))]
    let name = std::env::var("COMPUTERNAME").unwrap_or_else(|_| "this machine".into());
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_is_exclusive_and_leaves_no_file() {
        let dir = tempfile::tempdir().expect("a folder");
        let output = dir.path().join("a/s.zarr");
        let first = Lock::take(&output).expect("free");
        let Err(LockError::Held(who)) = Lock::take(&output) else {
            panic!("two locks");
        };
        assert!(who.contains(&format!("process {} on ", std::process::id())), "{who}");
        Lock::take(&dir.path().join("a/other.zarr")).expect("another place");
        drop(first);
        Lock::take(&output).expect("free again");
        assert_eq!(std::fs::read_dir(dir.path().join("a")).expect("lists").count(), 0);
    }

    #[test]
    fn a_stale_lock_is_taken_over() {
        let dir = tempfile::tempdir().expect("a folder");
        let output = dir.path().join("s.zarr");
        std::fs::write(file_of(&output), "process 1 on elsewhere\n").expect("writes");
        Lock::take(&output).expect("nobody holds it");
    }

    /// Verifies that a symbolic link and its target have the same lock.
    #[cfg(unix)]
    #[test]
    fn a_link_and_its_target_share_a_lock() {
        let dir = tempfile::tempdir().expect("a folder");
        let (store, link) = (dir.path().join("s.zarr"), dir.path().join("l.zarr"));
        std::fs::create_dir(&store).expect("a folder");
        std::os::unix::fs::symlink(&store, &link).expect("a link");
        let _held = Lock::take(&store).expect("free");
        assert!(matches!(Lock::take(&link), Err(LockError::Held(_))));
    }

    /// Verifies that concurrent threads never hold the lock at the same time.
    #[test]
    fn threads_never_hold_the_lock_together() {
        let dir = tempfile::tempdir().expect("a folder");
        let output = dir.path().join("s.zarr");
        let inside = std::sync::atomic::AtomicU32::new(0);
        let taken = std::sync::atomic::AtomicU32::new(0);
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..500 {
                        if let Ok(_lock) = Lock::take(&output) {
                            let before = inside.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
                            assert_eq!(before, 0);
                            taken.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
                            inside.fetch_sub(1, std::sync::atomic::Ordering::SeqCst);
                        }
                    }
                });
            }
        });
        assert!(taken.into_inner() > 0);
    }
}

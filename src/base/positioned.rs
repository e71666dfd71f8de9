//! Reads and writes files at given offsets, so that several threads can access one file concurrently.
//!
//! On systems without positioned I/O, a lock serializes the accesses.

use std::fs::File;
use std::io;

/// Fills `out` with the bytes of the file from offset `at`. The file position is undefined afterwards.
///
/// # Errors
/// Returns an error if the file system reports an error, or if the file is too short.
pub fn read_exact_at(file: &File, out: &mut [u8], at: u64) -> io::Result<()> {
    #[cfg(unix)]
    {
        std::os::unix::fs::FileExt::read_exact_at(file, out, at)
    }
    #[cfg(not(unix))]
    {
        use std::io::{Read, Seek, SeekFrom};
        let _turn = turn();
        let mut file = file;
        file.seek(SeekFrom::Start(at))?;
        file.read_exact(out)
    }
}

/// Writes all bytes to the file from offset `at`. The file position is undefined afterwards.
///
/// # Errors
/// Returns the error of the file system.
pub fn write_all_at(file: &File, bytes: &[u8], at: u64) -> io::Result<()> {
    #[cfg(unix)]
    {
        std::os::unix::fs::FileExt::write_all_at(file, bytes, at)
    }
    #[cfg(not(unix))]
    {
        use std::io::{Seek, SeekFrom, Write};
        let _turn = turn();
        let mut file = file;
        file.seek(SeekFrom::Start(at))?;
        file.write_all(bytes)
    }
}

#[cfg(not(unix))]
fn turn() -> std::sync::MutexGuard<'static, ()> {
    static TURN: std::sync::Mutex<()> = std::sync::Mutex::new(());
    TURN.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn concurrent_writes_at_different_positions_do_not_mix() {
        let file = tempfile::tempfile().expect("a file");
        std::thread::scope(|s| {
            for k in 0..8_u8 {
                let file = &file;
                s.spawn(move || write_all_at(file, &[k; 1000], 1000 * u64::from(k)).expect("writes"));
            }
        });
        for k in (0..8_u8).rev() {
            let mut out = [0; 1000];
            read_exact_at(&file, &mut out, 1000 * u64::from(k)).expect("reads");
            assert_eq!(out, [k; 1000]);
        }
        let ended = read_exact_at(&file, &mut [0; 2], 7999).expect_err("an end");
        assert_eq!(ended.kind(), io::ErrorKind::UnexpectedEof);
    }
}

//! Reads input files, which must be regular files.
//!
//! A read from a pipe without a writer, or from `/dev/zero`, never ends. Anything other than a regular file
//! is therefore refused without being opened. The size of text files is limited, because a sparse file can
//! report any size.

use std::fs::{File, FileType};
use std::io::{self, Error, ErrorKind, Read};
use std::path::Path;

/// Maximum size of a text file (scene, table or other document), in bytes.
pub const MOST_TEXT: u64 = 256 << 20;

/// Returns whether a path refers to an existing item other than a regular file or a folder (for example, a
/// pipe or a device).
pub fn is_special(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir())
}

/// Opens a regular file for reading.
///
/// # Errors
/// Returns an error if the path is not a regular file, or on a file system error.
pub fn open(path: &Path) -> io::Result<File> {
    let kind = std::fs::metadata(path)?.file_type();
    if !kind.is_file() {
        return Err(Error::new(ErrorKind::InvalidInput, format!("expected a file, got {}", name(kind))));
    }
    File::open(path)
}

/// Reads an entire regular file.
///
/// # Errors
/// Returns the same errors as [`open`], and an error if there is not enough memory.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut file = open(path)?;
    let length = file.metadata()?.len();
    // Check the size first, because some systems overcommit memory and kill the process that uses the memory.
    if length > memory() {
        return Err(ErrorKind::OutOfMemory.into());
    }
    let mut bytes = vec![];
    let room = usize::try_from(length).map_err(|_| ErrorKind::OutOfMemory)?;
    bytes.try_reserve_exact(room).map_err(|_| ErrorKind::OutOfMemory)?;
    // Limit the number of bytes read, because the file may grow in the meantime or report no length.
    file.by_ref().take(length.max(MOST_TEXT)).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads a regular file that contains at most [`MOST_TEXT`] bytes of text.
///
/// # Errors
/// Returns the same errors as [`open`], and an error if the file is larger than the limit or not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    let file = open(path)?;
    let mut text = String::new();
    let length = file.take(MOST_TEXT + 1).read_to_string(&mut text)?;
    if length as u64 > MOST_TEXT {
        let message = format!("the file is larger than {} MiB, the maximum for text files", MOST_TEXT >> 20);
        return Err(Error::new(ErrorKind::FileTooLarge, message));
    }
    Ok(text)
}

/// Returns the machine's memory in bytes, or the maximum value if the memory is unknown.
fn memory() -> u64 {
    #[cfg(target_os = "linux")]
    {
        let answer = rustix::system::sysinfo();
        #[allow(clippy::useless_conversion)] // 32 bits on some systems
        u64::try_from(answer.totalram).map_or(u64::MAX, |n| n.saturating_mul(u64::from(answer.mem_unit)))
    }
    #[cfg(not(target_os = "linux"))]
    {
        u64::MAX
    }
}

/// Returns the name of a file type for messages.
fn name(kind: FileType) -> &'static str {
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_fifo() {
            return "a pipe";
        }
        if kind.is_socket() {
            return "a socket";
        }
        if kind.is_char_device() || kind.is_block_device() {
            return "a device";
        }
    }
    if kind.is_dir() { "a folder" } else { "a special file" }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_are_opened() {
        let dir = tempfile::tempdir().expect("a folder");
        let file = dir.path().join("f");
        std::fs::write(&file, "text").expect("writes");
        assert_eq!(read(&file).expect("reads"), b"text");
        assert_eq!(read_text(&file).expect("reads"), "text");
        let refusal = |path: &Path| open(path).expect_err("refused").to_string();
        assert_eq!(refusal(Path::new("/dev/zero")), "expected a file, got a device");
        assert_eq!(refusal(dir.path()), "expected a file, got a folder");
        let status = std::process::Command::new("mkfifo").arg(dir.path().join("p")).status();
        if status.is_ok_and(|s| s.success()) {
            assert_eq!(refusal(&dir.path().join("p")), "expected a file, got a pipe");
            assert!(is_special(&dir.path().join("p")));
        }
        assert!(!is_special(&file) && !is_special(dir.path()));
        std::fs::write(&file, [0xff, 0xfe]).expect("writes");
        assert!(read_text(&file).is_err());
    }

    #[test]
    fn text_size_is_limited() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        file.as_file().set_len(1 << 40).expect("sparse");
        assert!(read_text(file.path()).expect_err("too large").to_string().contains("256 MiB"));
    }
}

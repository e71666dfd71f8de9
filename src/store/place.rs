//! Where a store lies: in a folder, or below an address of an object store (`s3://`, `gs://`, `az://`, `http(s)://`).
//!
//! A path that begins with a scheme is an address; everything else is a folder. What an object store refuses is told by
//! [`Refusal`].

use crate::refusal::Refusal;
use bytes::Bytes;
use std::io;
use std::path::{Path, PathBuf};

pub(crate) use crate::objects::Ask;
pub(crate) use crate::objects::Objects;

/// The scheme of an address as of a web page or a bucket, at least two letters before `://`; `None` for a path.
#[must_use]
pub fn scheme(path: &Path) -> Option<&str> {
    let (scheme, _) = path.to_str()?.split_once("://")?;
    let plain = |c: char| c.is_ascii_alphanumeric() || "+-.".contains(c);
    (scheme.len() > 1 && scheme.chars().all(plain)).then_some(scheme)
}

/// Whether a path is an address, and no file or folder of this machine.
#[must_use]
pub fn is_address(path: &Path) -> bool {
    scheme(path).is_some()
}

/// A place of a store.
#[derive(Debug)]
pub(crate) enum Place {
    Folder(PathBuf),
    Objects(Objects),
}

impl Place {
    /// The place that a path or an address names; nothing is asked yet.
    pub(crate) fn of(path: &Path) -> Result<Self, Refusal> {
        match scheme(path) {
            None => Ok(Self::Folder(path.to_owned())),
            Some(scheme) => Ok(Self::Objects(Objects::open(scheme, path)?)),
        }
    }

    /// Reads a file of this machine whole; `None` where there is none.
    pub(crate) fn read_file(path: &Path) -> io::Result<Option<Bytes>> {
        match base::input::read(path) {
            Ok(bytes) => Ok(Some(bytes.into())),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(e),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_told_from_paths() {
        for (text, found) in [
            ("s3://bucket/a.zarr", Some("s3")),
            ("https://host/a.zarr", Some("https")),
            ("a.zarr", None),
            ("/tmp/s3:/a", None),
            ("c://a", None),
            ("out/s3://a", None),
        ] {
            assert_eq!(scheme(Path::new(text)), found, "{text}");
        }
    }

    #[test]
    fn schemes_that_are_not_known_are_refused() {
        let refusal = Place::of(Path::new("ftp://host/a.zarr")).expect_err("refused");
        assert!(refusal.to_string().contains("ftp://"), "{refusal}");
    }
}

//! Represents the location of a store: a folder, or a URL of an object store (`s3://`, `gs://`, `az://`,
//! `http(s)://`).
//!
//! A path that begins with a scheme is a URL. Every other path is a folder. Object stores report errors as a
//! [`Refusal`].

use crate::refusal::Refusal;
use bytes::Bytes;
use std::io;
use std::path::{Path, PathBuf};

pub(crate) use crate::objects::Ask;
pub(crate) use crate::objects::Objects;

/// Returns the scheme of a URL, that is, at least two characters before `://`. Returns `None` for a local
/// path.
pub fn scheme(path: &Path) -> Option<&str> {
    let (scheme, _) = path.to_str()?.split_once("://")?;
    let plain = |c: char| c.is_ascii_alphanumeric() || "+-.".contains(c);
    (scheme.len() > 1 && scheme.chars().all(plain)).then_some(scheme)
}

/// Returns whether a path is a URL of an object store and not a local path.
pub fn is_address(path: &Path) -> bool {
    scheme(path).is_some()
}

/// The location of a store: a local folder, or the objects at a URL.
#[derive(Debug)]
pub(crate) enum Place {
    Folder(PathBuf),
    Objects(Objects),
}

impl Place {
    /// Returns the location for a path or a URL, without accessing the location.
    pub(crate) fn of(path: &Path) -> Result<Self, Refusal> {
        match scheme(path) {
            None => Ok(Self::Folder(path.to_owned())),
            Some(scheme) => Ok(Self::Objects(Objects::open(scheme, path)?)),
        }
    }

    /// Reads a local file. Returns `None` if the file does not exist.
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
    fn addresses_are_distinguished_from_paths() {
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
    fn unknown_schemes_are_refused() {
        let refusal = Place::of(Path::new("ftp://host/a.zarr")).expect_err("refused");
        assert!(refusal.to_string().contains("ftp://"), "{refusal}");
    }
}

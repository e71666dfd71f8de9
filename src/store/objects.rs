//! Defines the interface to object stores. Clients implement [`ObjectClient`], and [`install`] registers the
//! function that opens a client.
//!
//! The clients for S3, Google Cloud Storage, Azure and web servers are in the crate `sunstone-objects`. The
//! separate crate keeps the many dependencies of the clients out of this crate. Without a client, every URL
//! is refused.

#[cfg(test)]
pub(crate) mod fake;
pub(crate) mod lock;
#[cfg(test)]
mod tests;

use crate::refusal::Refusal;
use bytes::Bytes;
use std::fmt;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// The part of an object to read.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Ask {
    /// All bytes of the object.
    Whole,
    /// The bytes in a range of byte offsets.
    Bytes(Range<u64>),
    /// The given number of bytes at the end of the object. The second value is the object's size, if known.
    End(u64, Option<u64>),
}

impl Ask {
    /// Returns the requested part of an object, given all bytes of the object.
    pub fn of(&self, whole: &Bytes) -> Bytes {
        let size = whole.len();
        let at = |offset: u64| usize::try_from(offset).map_or(size, |o| o.min(size));
        match self {
            Self::Whole => whole.clone(),
            Self::Bytes(range) => whole.slice(at(range.start)..at(range.end).max(at(range.start))),
            Self::End(length, _) => whole.slice(size - at(*length)..),
        }
    }
}

/// The version of an object, used to make a put conditional.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Version {
    pub e_tag: Option<String>,
    /// Version number, if the store numbers versions.
    pub version: Option<String>,
}

#[derive(Clone, Debug)]
pub enum Condition {
    /// The object does not exist (`If-None-Match: *`).
    Absent,
    /// The object exists in the given version (`If-Match`).
    Is(Version),
}

/// The result of a conditional put.
#[derive(Debug)]
pub enum Put {
    /// The object was written and now has the given version.
    Done(Version),
    /// The condition does not hold. If the response to an earlier request for the same put was lost, the
    /// object may be the result of that request.
    Other,
}

/// The client of an object store, for the objects below one URL. Keys are relative to the URL. Calls block
/// until the response arrives.
pub trait ObjectClient: Send + Sync + fmt::Debug {
    /// Reads parts of objects. Returns the bytes and the size of each object, in the order of the requests,
    /// or `None` for an object that does not exist.
    ///
    /// # Errors
    /// Returns an error if the store refuses the request or cannot be reached.
    fn ask(&self, asks: Vec<(String, Ask)>) -> Result<Vec<Option<(Bytes, u64)>>, Refusal>;

    /// Lists the keys and sizes of all objects, sorted by key.
    ///
    /// # Errors
    /// Returns an error if the store refuses the request or cannot be reached.
    fn list(&self) -> Result<Vec<(String, u64)>, Refusal>;

    /// Checks that the store accepts writes.
    ///
    /// # Errors
    /// Returns an error if the store is read-only.
    fn may_be_written(&self) -> Result<(), Refusal>;

    /// Writes objects, and replaces existing objects. Each object is written atomically.
    ///
    /// # Errors
    /// Returns an error if the store refuses the request or cannot be reached.
    fn put_many(&self, objects: Vec<(String, Bytes)>) -> Result<(), Refusal>;

    /// Writes an object if `condition` holds.
    ///
    /// # Errors
    /// Returns an error if the store refuses the request or cannot be reached.
    fn put_if(&self, key: &str, bytes: Bytes, condition: Condition) -> Result<Put, Refusal>;

    /// Reads an object and its version. Returns `None` if the object does not exist.
    ///
    /// # Errors
    /// Returns an error if the store refuses the request or cannot be reached.
    fn get_version(&self, key: &str) -> Result<Option<(Bytes, Version)>, Refusal>;

    /// Removes objects. Objects that do not exist are ignored.
    ///
    /// # Errors
    /// Returns an error if the store refuses the request or cannot be reached.
    fn delete(&self, keys: Vec<String>) -> Result<(), Refusal>;
}

/// Function that opens a client for the objects below a URL, given the scheme and the URL.
pub type Open = fn(&str, &Path) -> Result<Arc<dyn ObjectClient>, Refusal>;

static OPEN: OnceLock<Open> = OnceLock::new();

/// Registers, for this process, the function that opens clients of object stores. Later calls have no effect.
pub fn install(open: Open) {
    let _ = OPEN.set(open);
}

/// The objects below a URL, with their client.
#[derive(Clone, Debug)]
pub(crate) struct Objects(Arc<dyn ObjectClient>);

impl Objects {
    /// Returns the objects below a URL, without sending a request.
    pub(crate) fn open(scheme: &str, address: &Path) -> Result<Self, Refusal> {
        #[cfg(test)]
        if let Some(client) = fake::open(scheme, address) {
            return Ok(Self(client));
        }
        let open = OPEN.get().ok_or_else(|| {
            Refusal::new(
                format!("this program was built without support for object stores and cannot open {scheme}://"),
                "build the program with `cargo build --release --features object-stores`, or copy the store to a folder",
            )
        })?;
        open(scheme, address).map(Self)
    }

    /// Reads a whole object.
    pub(crate) fn get(&self, key: &str) -> Result<Option<Bytes>, Refusal> {
        Ok(self.get_many(&[key.to_owned()])?.pop().flatten())
    }

    /// Reads whole objects, in the order of `keys`.
    pub(crate) fn get_many(&self, keys: &[String]) -> Result<Vec<Option<Bytes>>, Refusal> {
        let asks = keys.iter().map(|key| (key.clone(), Ask::Whole)).collect();
        let found = self.0.ask(asks)?;
        Ok(found.into_iter().map(|f| f.map(|(bytes, _)| bytes)).collect())
    }

    /// Writes one object.
    pub(crate) fn put(&self, key: &str, bytes: Bytes) -> Result<(), Refusal> {
        self.0.put_many(vec![(key.to_owned(), bytes)])
    }

    /// Writes an object if there is no object with the given key.
    pub(crate) fn put_new(&self, key: &str, bytes: Bytes) -> Result<Put, Refusal> {
        self.0.put_if(key, bytes, Condition::Absent)
    }

    /// Replaces an object if it still has the version `old`.
    pub(crate) fn put_over(&self, key: &str, bytes: Bytes, old: Version) -> Result<Put, Refusal> {
        self.0.put_if(key, bytes, Condition::Is(old))
    }
}

impl std::ops::Deref for Objects {
    type Target = dyn ObjectClient;

    fn deref(&self) -> &Self::Target {
        &*self.0
    }
}

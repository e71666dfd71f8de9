//! Implements object stores in memory for tests:
//! - `memory://NAME/..` has no faults.
//! - `flaky://NAME/..` loses responses to conditional puts.
//! - `mortal://NAME/..` makes a limited number of changes and then fails, like a killed process.

use super::{Ask, Condition, ObjectClient, Put, Version};
use crate::refusal::Refusal;
use bytes::Bytes;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

/// The objects of a bucket, with their versions.
#[derive(Debug, Default)]
pub(crate) struct Bucket {
    objects: Mutex<BTreeMap<String, (Bytes, u64)>>,
    version: AtomicU64,
    /// Number of further changes that `mortal://` makes before it fails.
    life: Arc<AtomicI64>,
    requests: AtomicU64,
}

static BUCKETS: LazyLock<Mutex<HashMap<String, Arc<Bucket>>>> = LazyLock::new(Mutex::default);

pub(crate) fn memory(name: &str) -> Arc<Bucket> {
    let mut all = BUCKETS.lock().unwrap_or_else(PoisonError::into_inner);
    all.entry(name.to_owned()).or_default().clone()
}

/// Returns the number of further changes that `mortal://NAME/..` makes before it fails.
pub(crate) fn life(name: &str) -> Arc<AtomicI64> {
    memory(name).life.clone()
}

/// Returns the number of requests that a bucket has received.
pub(crate) fn requests(name: &str) -> u64 {
    memory(name).requests.load(Ordering::Relaxed)
}

pub(crate) fn put(bucket: &Bucket, key: &str, bytes: Vec<u8>) {
    bucket.set(key, bytes.into());
}

pub(crate) fn remove(bucket: &Bucket, key: &str) {
    bucket.objects().remove(key);
}

/// Writes the files of a folder below `memory://NAME/PATH`.
pub(crate) fn upload(folder: &Path, name: &str, path: &str) {
    for (file, bytes) in crate::zarr::tests::files(folder) {
        put(&memory(name), &format!("{path}/{}", file.display()), bytes);
    }
}

/// Opens a URL with one of the test schemes. Returns `None` for other schemes.
pub(super) fn open(scheme: &str, address: &Path) -> Option<Arc<dyn ObjectClient>> {
    let kind = match scheme {
        "memory" => Kind::Sound,
        "flaky" => Kind::Flaky(AtomicU64::new(0)),
        "mortal" => Kind::Mortal,
        _ => return None,
    };
    let (_, rest) = address.to_str()?.split_once("://")?;
    let (name, path) = rest.trim_end_matches('/').split_once('/').unwrap_or((rest, ""));
    let below = if path.is_empty() { String::new() } else { format!("{path}/") };
    Some(Arc::new(Fake { bucket: memory(name), below, kind }))
}

impl Bucket {
    fn objects(&self) -> MutexGuard<'_, BTreeMap<String, (Bytes, u64)>> {
        self.objects.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set(&self, key: &str, bytes: Bytes) -> u64 {
        let version = self.version.fetch_add(1, Ordering::Relaxed);
        self.objects().insert(key.to_owned(), (bytes, version));
        version
    }
}

#[derive(Debug)]
enum Kind {
    Sound,
    Flaky(AtomicU64),
    Mortal,
}

#[derive(Debug)]
struct Fake {
    bucket: Arc<Bucket>,
    below: String,
    kind: Kind,
}

fn version(number: u64) -> Version {
    Version { e_tag: Some(number.to_string()), version: None }
}

impl Fake {
    fn key(&self, key: &str) -> String {
        format!("{}{key}", self.below)
    }

    /// Counts a request and its changes. Refuses the request if no more changes are allowed.
    fn request(&self, changes: i64) -> Result<(), Refusal> {
        self.bucket.requests.fetch_add(1, Ordering::Relaxed);
        if matches!(self.kind, Kind::Mortal) && self.bucket.life.fetch_sub(changes, Ordering::Relaxed) <= 0 {
            self.bucket.life.fetch_add(changes, Ordering::Relaxed);
            return Err(Refusal::new("killed", "start it again"));
        }
        Ok(())
    }
}

impl ObjectClient for Fake {
    fn ask(&self, asks: Vec<(String, Ask)>) -> Result<Vec<Option<(Bytes, u64)>>, Refusal> {
        asks.into_iter()
            .map(|(key, ask)| {
                self.request(0)?;
                let found = self.bucket.objects().get(&self.key(&key)).cloned();
                Ok(found.map(|(whole, _)| (ask.of(&whole), whole.len() as u64)))
            })
            .collect()
    }

    fn list(&self) -> Result<Vec<(String, u64)>, Refusal> {
        self.request(0)?;
        let all = self.bucket.objects();
        Ok(all
            .iter()
            .filter_map(|(key, (bytes, _))| {
                Some((key.strip_prefix(&self.below)?.to_owned(), bytes.len() as u64))
            })
            .collect())
    }

    fn may_be_written(&self) -> Result<(), Refusal> {
        Ok(())
    }

    fn put_many(&self, objects: Vec<(String, Bytes)>) -> Result<(), Refusal> {
        for (key, bytes) in objects {
            self.request(1)?;
            self.bucket.set(&self.key(&key), bytes);
        }
        Ok(())
    }

    fn put_if(&self, key: &str, bytes: Bytes, condition: Condition) -> Result<Put, Refusal> {
        self.request(1)?;
        let key = self.key(key);
        let old = self.bucket.objects().get(&key).map(|(_, number)| version(*number));
        let holds = match condition {
            Condition::Absent => old.is_none(),
            Condition::Is(wanted) => old == Some(wanted),
        };
        if !holds {
            return Ok(Put::Other);
        }
        let new = self.bucket.set(&key, bytes);
        match &self.kind {
            Kind::Flaky(count) if count.fetch_add(1, Ordering::Relaxed) % 2 == 0 => Ok(Put::Other),
            _ => Ok(Put::Done(version(new))),
        }
    }

    fn get_version(&self, key: &str) -> Result<Option<(Bytes, Version)>, Refusal> {
        self.request(0)?;
        let found = self.bucket.objects().get(&self.key(key)).cloned();
        Ok(found.map(|(bytes, number)| (bytes, version(number))))
    }

    fn delete(&self, keys: Vec<String>) -> Result<(), Refusal> {
        for key in keys {
            self.request(1)?;
            self.bucket.objects().remove(&self.key(&key));
        }
        Ok(())
    }
}

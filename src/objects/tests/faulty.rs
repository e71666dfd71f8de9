//! In-memory object stores that fail temporarily, as servers and networks do, or permanently, as a killed
//! process does.

use super::super::Key;
use super::memory;
use futures_util::stream::{self, BoxStream, StreamExt, TryStreamExt};
use object_store::memory::InMemory;
use object_store::{
    CopyOptions, Error, GetOptions, GetResult, GetResultPayload, ListResult, MultipartUpload, ObjectMeta,
    ObjectStore, ObjectStoreExt, PutMultipartOptions, PutOptions, PutPayload, PutResult, Result,
};
use std::collections::HashMap;
use std::fmt;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

static LIVES: LazyLock<Mutex<HashMap<String, Arc<AtomicI64>>>> = LazyLock::new(Mutex::default);

/// Returns the number of changes that the store `mortal://NAME/..` still makes before it fails.
pub(crate) fn life(name: &str) -> Arc<AtomicI64> {
    let mut lives = LIVES.lock().unwrap_or_else(PoisonError::into_inner);
    lives.entry(name.to_owned()).or_default().clone()
}

/// The store `memory://NAME/..` with simulated failures.
#[derive(Clone, Debug)]
pub(crate) struct Faulty {
    inner: Arc<InMemory>,
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    /// Fails temporarily. Of ten requests, two consecutive requests and the response to a third request are
    /// lost.
    Flaky(Arc<AtomicU64>),
    /// Fails permanently after a number of changes.
    Mortal(Arc<AtomicI64>),
}

enum Fate {
    Done,
    Unheard,
    Unanswered,
}

/// Returns the object store of test URLs `flaky://NAME/..` and `mortal://NAME/..`.
pub(crate) fn faulty(scheme: &str, name: &str) -> Arc<Faulty> {
    Arc::new(Faulty {
        inner: memory(name),
        kind: match scheme {
            "flaky" => Kind::Flaky(Arc::default()),
            _ => Kind::Mortal(life(name)),
        },
    })
}

fn lost() -> Error {
    Error::Generic { store: "flaky", source: "connection closed".into() }
}

impl Faulty {
    fn fate(&self, changes: i64) -> Result<Fate> {
        match &self.kind {
            Kind::Flaky(count) => Ok(match count.fetch_add(1, Ordering::Relaxed) % 10 {
                3 | 4 => Fate::Unheard,
                7 => Fate::Unanswered,
                _ => Fate::Done,
            }),
            Kind::Mortal(left) if left.load(Ordering::Relaxed) <= 0 => {
                Err(Error::PermissionDenied { path: String::new(), source: "killed".into() })
            }
            Kind::Mortal(left) => {
                left.fetch_sub(changes, Ordering::Relaxed);
                Ok(Fate::Done)
            }
        }
    }
}

impl fmt::Display for Faulty {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Faulty")
    }
}

#[async_trait::async_trait]
impl ObjectStore for Faulty {
    async fn put_opts(&self, key: &Key, payload: PutPayload, options: PutOptions) -> Result<PutResult> {
        match self.fate(1)? {
            Fate::Unheard => Err(lost()),
            Fate::Done => self.inner.put_opts(key, payload, options).await,
            Fate::Unanswered => {
                self.inner.put_opts(key, payload, options).await?;
                Err(lost())
            }
        }
    }

    async fn put_multipart_opts(
        &self,
        key: &Key,
        options: PutMultipartOptions,
    ) -> Result<Box<dyn MultipartUpload>> {
        self.inner.put_multipart_opts(key, options).await
    }

    async fn get_opts(&self, key: &Key, options: GetOptions) -> Result<GetResult> {
        let fate = self.fate(0)?;
        if matches!(fate, Fate::Unheard) {
            return Err(lost());
        }
        let mut found = self.inner.get_opts(key, options).await?;
        if matches!(fate, Fate::Unanswered) {
            found.payload = GetResultPayload::Stream(stream::iter([Err(lost())]).boxed());
        }
        Ok(found)
    }

    fn delete_stream(&self, keys: BoxStream<'static, Result<Key>>) -> BoxStream<'static, Result<Key>> {
        if let Kind::Mortal(_) = self.kind {
            let store = self.clone();
            let delete = move |key: Key| {
                let store = store.clone();
                async move {
                    store.fate(1)?;
                    store.inner.delete(&key).await?;
                    Ok(key)
                }
            };
            return keys.and_then(delete).boxed();
        }
        match self.fate(1) {
            Ok(Fate::Done) => self.inner.delete_stream(keys),
            Ok(Fate::Unanswered) => self.inner.delete_stream(keys).chain(stream::iter([Err(lost())])).boxed(),
            _ => stream::iter([Err(lost())]).boxed(),
        }
    }

    fn list(&self, prefix: Option<&Key>) -> BoxStream<'static, Result<ObjectMeta>> {
        match self.fate(0) {
            Ok(Fate::Done) => self.inner.list(prefix),
            Ok(_) => self.inner.list(prefix).take(1).chain(stream::iter([Err(lost())])).boxed(),
            Err(e) => stream::iter([Err(e)]).boxed(),
        }
    }

    async fn list_with_delimiter(&self, prefix: Option<&Key>) -> Result<ListResult> {
        self.inner.list_with_delimiter(prefix).await
    }

    async fn copy_opts(&self, from: &Key, to: &Key, options: CopyOptions) -> Result<()> {
        self.inner.copy_opts(from, to, options).await
    }
}

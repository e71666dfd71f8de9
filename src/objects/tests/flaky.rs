//! In-memory object stores that fail temporarily, like servers and networks.

use super::memory;
use crate::Key;
use futures_util::stream::{self, BoxStream, StreamExt};
use object_store::memory::InMemory;
use object_store::{
    CopyOptions, Error, GetOptions, GetResult, GetResultPayload, ListResult, MultipartUpload, ObjectMeta,
    ObjectStore, PutMultipartOptions, PutOptions, PutPayload, PutResult, Result,
};
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The store `memory://NAME/..` with failures: of ten requests, one is lost and the response of another is lost.
#[derive(Debug)]
pub(crate) struct Flaky {
    inner: Arc<InMemory>,
    requests: AtomicU64,
}

enum Fate {
    Done,
    Unheard,
    Unanswered,
}

/// Returns the object store of test addresses `flaky://NAME/..`.
pub(crate) fn flaky(name: &str) -> Arc<Flaky> {
    Arc::new(Flaky { inner: memory(name), requests: AtomicU64::new(0) })
}

fn lost() -> Error {
    Error::Generic { store: "flaky", source: "connection closed".into() }
}

impl Flaky {
    fn fate(&self) -> Fate {
        match self.requests.fetch_add(1, Ordering::Relaxed) % 10 {
            3 => Fate::Unheard,
            7 => Fate::Unanswered,
            _ => Fate::Done,
        }
    }
}

impl fmt::Display for Flaky {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Flaky")
    }
}

#[async_trait::async_trait]
impl ObjectStore for Flaky {
    async fn put_opts(&self, key: &Key, payload: PutPayload, options: PutOptions) -> Result<PutResult> {
        match self.fate() {
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
        let fate = self.fate();
        let mut found = self.inner.get_opts(key, options).await?;
        if !matches!(fate, Fate::Done) {
            // The client itself retries until a response begins.
            found.payload = GetResultPayload::Stream(stream::iter([Err(lost())]).boxed());
        }
        Ok(found)
    }

    fn delete_stream(&self, keys: BoxStream<'static, Result<Key>>) -> BoxStream<'static, Result<Key>> {
        match self.fate() {
            Fate::Done => self.inner.delete_stream(keys),
            Fate::Unanswered => self.inner.delete_stream(keys).chain(stream::iter([Err(lost())])).boxed(),
            Fate::Unheard => stream::iter([Err(lost())]).boxed(),
        }
    }

    fn list(&self, prefix: Option<&Key>) -> BoxStream<'static, Result<ObjectMeta>> {
        match self.fate() {
            Fate::Done => self.inner.list(prefix),
            _ => self.inner.list(prefix).take(1).chain(stream::iter([Err(lost())])).boxed(),
        }
    }

    async fn list_with_delimiter(&self, prefix: Option<&Key>) -> Result<ListResult> {
        self.inner.list_with_delimiter(prefix).await
    }

    async fn copy_opts(&self, from: &Key, to: &Key, options: CopyOptions) -> Result<()> {
        self.inner.copy_opts(from, to, options).await
    }
}

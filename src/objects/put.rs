//! Writes and removes objects. Each object is written atomically.

use super::{AT_ONCE, Key, Objects, again, wait};
use bytes::Bytes;
use futures_util::stream::{self, StreamExt, TryStreamExt};
use object_store::{Error, ObjectStoreExt, PutMode, PutOptions, UpdateVersion};
use store::objects::{Condition, Put, Version};
use store::refusal::Refusal;

impl Objects {
    pub(crate) fn check_writable(&self) -> Result<(), Refusal> {
        if self.scheme.starts_with("http") {
            return Err(Refusal::new(
                format!("{}:// is a read-only web server", self.scheme),
                "write to a local folder or to an object store (s3://, gs://, az://)",
            ));
        }
        Ok(())
    }

    pub(crate) fn write(&self, all: Vec<(String, Bytes)>) -> Result<(), Refusal> {
        let all: Vec<(Key, Bytes)> = all.into_iter().map(|(key, bytes)| (self.key(&key), bytes)).collect();
        let store = self.store.clone();
        let put = async move {
            stream::iter(all.into_iter().map(Ok))
                .try_for_each_concurrent(AT_ONCE, |(key, bytes)| {
                    let store = store.clone();
                    async move { again(|| store.put(&key, bytes.clone().into())).await.map(drop) }
                })
                .await
        };
        wait(put)?.map_err(|e| self.refusal(&e))
    }

    pub(crate) fn write_if(&self, key: &str, bytes: Bytes, condition: Condition) -> Result<Put, Refusal> {
        let (store, key) = (self.store.clone(), self.key(key));
        // A replaced object may be missing; for a new object, a missing path means that the bucket does not
        // exist.
        let (replaces, mode) = match condition {
            Condition::Absent => (false, PutMode::Create),
            Condition::Is(Version { e_tag, version }) => {
                (true, PutMode::Update(UpdateVersion { e_tag, version }))
            }
        };
        let options = PutOptions::from(mode);
        let put = async move { again(|| store.put_opts(&key, bytes.clone().into(), options.clone())).await };
        match wait(put)? {
            Ok(result) => Ok(Put::Done(Version { e_tag: result.e_tag, version: result.version })),
            Err(Error::AlreadyExists { .. } | Error::Precondition { .. }) => Ok(Put::Other),
            Err(Error::NotFound { .. }) if replaces => Ok(Put::Other),
            Err(e) => Err(self.refusal(&e)),
        }
    }

    pub(crate) fn read_version(&self, key: &str) -> Result<Option<(Bytes, Version)>, Refusal> {
        let (store, key) = (self.store.clone(), self.key(key));
        let get = async move {
            let found = again(|| async {
                let found = store.get(&key).await?;
                let version =
                    Version { e_tag: found.meta.e_tag.clone(), version: found.meta.version.clone() };
                Ok((found.bytes().await?, version))
            });
            match found.await {
                Ok(found) => Ok(Some(found)),
                Err(Error::NotFound { .. }) => Ok(None),
                Err(e) => Err(e),
            }
        };
        wait(get)?.map_err(|e| self.refusal(&e))
    }

    pub(crate) fn remove(&self, keys: Vec<String>) -> Result<(), Refusal> {
        if keys.is_empty() {
            return Ok(());
        }
        let keys: Vec<Key> = keys.iter().map(|key| self.key(key)).collect();
        let store = self.store.clone();
        let delete = async move {
            again(|| async {
                let all = stream::iter(keys.clone().into_iter().map(Ok)).boxed();
                let mut gone = store.delete_stream(all);
                while let Some(result) = gone.next().await {
                    match result {
                        Ok(_) | Err(Error::NotFound { .. }) => {}
                        Err(e) => return Err(e),
                    }
                }
                Ok(())
            })
            .await
        };
        wait(delete)?.map_err(|e| self.refusal(&e))
    }
}

//! Objects that are written: a put appears whole or not at all, and may hang on what is there.

use super::{AT_ONCE, Key, Objects, again, wait};
use crate::refusal::Refusal;
use bytes::Bytes;
use futures_util::stream::{self, StreamExt, TryStreamExt};
use object_store::{Error, ObjectStoreExt, PutMode, PutOptions, UpdateVersion};

/// A put that hangs on what is there.
pub(crate) enum Put {
    /// It is there now, in this version.
    Done(UpdateVersion),
    /// Something else is; or itself, put by a request whose answer was lost.
    Other,
}

impl Objects {
    /// Refuses places that are read only.
    pub(crate) fn may_be_written(&self) -> Result<(), Refusal> {
        if self.scheme.starts_with("http") {
            return Err(Refusal::new(
                format!("{}:// is a web server, which is read only", self.scheme),
                "write to a folder or to an object store (s3://, gs://, az://)",
            ));
        }
        Ok(())
    }

    /// Puts an object, whatever was there.
    pub(crate) fn put(&self, key: &str, bytes: Bytes) -> Result<(), Refusal> {
        self.put_many(vec![(key.to_owned(), bytes)])
    }

    /// Puts objects beside each other.
    pub(crate) fn put_many(&self, all: Vec<(String, Bytes)>) -> Result<(), Refusal> {
        self.note(all.len());
        let all: Vec<(Key, Bytes)> = all
            .into_iter()
            .map(|(key, bytes)| (self.key(&key), bytes))
            .collect();
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

    fn put_if(&self, key: &str, bytes: Bytes, mode: PutMode) -> Result<Put, Refusal> {
        self.note(1);
        let (store, key) = (self.store.clone(), self.key(key));
        // What is to be replaced may be gone; where there was to be nothing, it is the bucket that is not there.
        let replaces = matches!(mode, PutMode::Update(_));
        let options = PutOptions::from(mode);
        let put = async move { again(|| store.put_opts(&key, bytes.clone().into(), options.clone())).await };
        match wait(put)? {
            Ok(result) => Ok(Put::Done(result.into())),
            Err(Error::AlreadyExists { .. } | Error::Precondition { .. }) => Ok(Put::Other),
            Err(Error::NotFound { .. }) if replaces => Ok(Put::Other),
            Err(e) => Err(self.refusal(&e)),
        }
    }

    /// Puts an object where none is (`If-None-Match: *`).
    pub(crate) fn put_new(&self, key: &str, bytes: Bytes) -> Result<Put, Refusal> {
        self.put_if(key, bytes, PutMode::Create)
    }

    /// Puts an object in the place of one version of it (`If-Match`).
    pub(crate) fn put_over(&self, key: &str, bytes: Bytes, old: UpdateVersion) -> Result<Put, Refusal> {
        self.put_if(key, bytes, PutMode::Update(old))
    }

    /// An object with its version.
    pub(crate) fn get_version(&self, key: &str) -> Result<Option<(Bytes, UpdateVersion)>, Refusal> {
        self.note(1);
        let (store, key) = (self.store.clone(), self.key(key));
        let get = async move {
            let found = again(|| async {
                let found = store.get(&key).await?;
                let version = UpdateVersion {
                    e_tag: found.meta.e_tag.clone(),
                    version: found.meta.version.clone(),
                };
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

    /// Removes objects, whether they are there or not.
    pub(crate) fn delete(&self, keys: Vec<String>) -> Result<(), Refusal> {
        if keys.is_empty() {
            return Ok(());
        }
        // A thousand go in one request, where the store takes so many.
        self.note(keys.len().div_ceil(1000));
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

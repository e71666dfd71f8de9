//! A client of object stores, which reads whole objects or byte ranges, and lists, writes and removes
//! objects. Each object is written atomically.

use super::{AT_ONCE, Key, Objects, again, chain, wait};
use bytes::Bytes;
use futures_util::stream::{self, StreamExt, TryStreamExt};
use object_store::{
    Error, GetOptions, GetRange, ObjectStore, ObjectStoreExt, PutMode, PutOptions, UpdateVersion,
};
use store::objects::{Ask, Condition, ObjectClient, Put, Version};
use store::refusal::Refusal;

/// Maximum size, in bytes, of an object that is read. No file of a Sunstone store is larger.
const LARGEST: u64 = 4 << 30;

/// Converts a request to a form of byte range that the servers of a URL scheme support. Returns `None` for a
/// whole object.
fn range(ask: &Ask, scheme: &str) -> Option<GetRange> {
    match ask {
        Ask::Whole => None,
        Ask::Bytes(range) => Some(GetRange::Bounded(range.clone())),
        // Azure does not support suffix ranges.
        Ask::End(length, Some(size)) if scheme == "az" => {
            Some(GetRange::Bounded(size.saturating_sub(*length)..*size))
        }
        Ask::End(length, _) => Some(GetRange::Suffix(*length)),
    }
}

impl ObjectClient for Objects {
    fn ask(&self, asks: Vec<(String, Ask)>) -> Result<Vec<Option<(Bytes, u64)>>, Refusal> {
        let scheme = self.scheme.clone();
        let asks: Vec<(Key, Ask)> = asks.into_iter().map(|(key, ask)| (self.key(&key), ask)).collect();
        let store = self.store.clone();
        let all = async move {
            stream::iter(asks)
                .map(|(key, ask)| {
                    let (store, range) = (store.clone(), range(&ask, &scheme));
                    async move {
                        match fetch(&*store, &key, range).await {
                            // Plain web servers may not support ranges.
                            Err(Error::NotSupported { .. }) if ask != Ask::Whole => {
                                let whole = fetch(&*store, &key, None).await?;
                                Ok(whole.map(|(bytes, size)| (ask.of(&bytes), size)))
                            }
                            found => found,
                        }
                    }
                })
                .buffered(AT_ONCE)
                .try_collect()
                .await
        };
        wait(all)?.map_err(|e| self.refusal(&e))
    }

    fn list(&self) -> Result<Vec<(String, u64)>, Refusal> {
        let (store, below) = (self.store.clone(), self.below.clone());
        let prefix = below.clone();
        let list = async move { again(|| store.list(Some(&prefix)).try_collect::<Vec<_>>()).await };
        let all = wait(list)?.map_err(|e| self.refusal(&e))?;
        let name = |key: &Key| Some(key.prefix_match(&below)?.collect::<Key>().to_string());
        let mut names: Vec<(String, u64)> =
            all.iter().filter_map(|meta| Some((name(&meta.location)?, meta.size))).collect();
        names.sort_unstable();
        Ok(names)
    }

    fn may_be_written(&self) -> Result<(), Refusal> {
        if self.scheme.starts_with("http") {
            return Err(Refusal::new(
                format!("{}:// addresses are read-only", self.scheme),
                "write to a local folder or to an object store (s3://, gs://, az://)",
            ));
        }
        Ok(())
    }

    fn put_many(&self, all: Vec<(String, Bytes)>) -> Result<(), Refusal> {
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

    fn put_if(&self, key: &str, bytes: Bytes, condition: Condition) -> Result<Put, Refusal> {
        let (store, key) = (self.store.clone(), self.key(key));
        // The object to replace may not exist. If a new object is written, a missing path means that the
        // bucket does not exist.
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

    fn get_version(&self, key: &str) -> Result<Option<(Bytes, Version)>, Refusal> {
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

    fn delete(&self, keys: Vec<String>) -> Result<(), Refusal> {
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

async fn fetch(
    store: &dyn ObjectStore,
    key: &Key,
    range: Option<GetRange>,
) -> Result<Option<(Bytes, u64)>, Error> {
    let options = || GetOptions { range: range.clone(), ..GetOptions::default() };
    // The client library retries most failures, but not if the connection closes during an error response.
    let read = again(|| async {
        let found = store.get_opts(key, options()).await?;
        let size = found.meta.size;
        let fits = found.range.end.saturating_sub(found.range.start) <= LARGEST;
        Ok((if fits { Some(found.bytes().await?) } else { None }, size))
    });
    match read.await {
        Ok((Some(bytes), size)) => Ok(Some((bytes, size))),
        Ok((None, size)) => {
            let source = format!(
                "the object {key} has {size} bytes, but a file of a store has at most {LARGEST} bytes"
            );
            Err(Error::Generic { store: "object", source: source.into() })
        }
        Err(e @ Error::NotFound { .. }) if !chain(&e).contains("NoSuchBucket") => Ok(None),
        Err(e) => Err(e),
    }
}

//! Reads objects, whole or in part, concurrently.

use super::{AT_ONCE, ATTEMPTS, Key, Objects, chain, up_to, wait};
use bytes::Bytes;
use futures_util::stream::{self, StreamExt, TryStreamExt};
use object_store::{Error, GetOptions, GetRange, ObjectStore};
use store::objects::Ask;
use store::refusal::Refusal;

/// Maximum size of an object to read; no file of a store is larger.
const LARGEST: u64 = 4 << 30;

/// Converts a request to a range that the servers of a scheme support.
fn range(ask: &Ask, scheme: &str) -> Option<GetRange> {
    match ask {
        Ask::Whole => None,
        Ask::Bytes(range) => Some(GetRange::Bounded(range.clone())),
        // Azure has no suffix ranges.
        Ask::End(length, Some(size)) if scheme == "az" => {
            Some(GetRange::Bounded(size.saturating_sub(*length)..*size))
        }
        Ask::End(length, _) => Some(GetRange::Suffix(*length)),
    }
}

impl Objects {
    pub(crate) fn read(&self, asks: Vec<(String, Ask)>) -> Result<Vec<Option<(Bytes, u64)>>, Refusal> {
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
}

async fn fetch(
    store: &dyn ObjectStore,
    key: &Key,
    range: Option<GetRange>,
) -> Result<Option<(Bytes, u64)>, Error> {
    let mut attempts = ATTEMPTS;
    loop {
        attempts -= 1;
        let options = || GetOptions { range: range.clone(), ..GetOptions::default() };
        // The client itself retries, except when a reused connection was closed.
        let found = match up_to(2, || store.get_opts(key, options())).await {
            Ok(found) => found,
            Err(e @ Error::NotFound { .. }) if !chain(&e).contains("NoSuchBucket") => return Ok(None),
            Err(e) => return Err(e),
        };
        let size = found.meta.size;
        if found.range.end.saturating_sub(found.range.start) > LARGEST {
            let source = format!("{key} has {size} bytes, more than any file of a store");
            return Err(Error::Generic { store: "object", source: source.into() });
        }
        match found.bytes().await {
            Err(Error::Generic { .. }) if attempts > 0 => {}
            result => return result.map(|bytes| Some((bytes, size))),
        }
    }
}

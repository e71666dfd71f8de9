//! Objects that are read, whole or some of their bytes, beside each other.

use super::{AT_ONCE, ATTEMPTS, Key, Objects, chain, up_to, wait};
use crate::refusal::Refusal;
use bytes::Bytes;
use futures_util::stream::{self, StreamExt, TryStreamExt};
use object_store::{Error, GetOptions, GetRange, ObjectStore};
use std::ops::Range;

/// Largest object that is read: no file of a store is larger.
const LARGEST: u64 = 4 << 30;

/// What is asked of an object.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Ask {
    /// All of it.
    Whole,
    /// These bytes.
    Bytes(Range<u64>),
    /// So many of its last bytes, of so many that it should have where that is known.
    End(u64, Option<u64>),
}

impl Ask {
    /// What a server of the scheme is told.
    fn range(&self, scheme: &str) -> Option<GetRange> {
        match self {
            Self::Whole => None,
            Self::Bytes(range) => Some(GetRange::Bounded(range.clone())),
            // Azure knows no ranges that count from the end.
            Self::End(length, Some(size)) if scheme == "az" => {
                Some(GetRange::Bounded(size.saturating_sub(*length)..*size))
            }
            Self::End(length, _) => Some(GetRange::Suffix(*length)),
        }
    }

    /// Of a whole object, what was asked for.
    fn of(&self, whole: &Bytes) -> Bytes {
        let size = whole.len();
        let at = |offset: u64| usize::try_from(offset).map_or(size, |o| o.min(size));
        match self {
            Self::Whole => whole.clone(),
            Self::Bytes(range) => whole.slice(at(range.start)..at(range.end).max(at(range.start))),
            Self::End(length, _) => whole.slice(size - at(*length)..),
        }
    }
}

impl Objects {
    /// An object whole; `None` where there is none.
    pub(crate) fn get(&self, key: &str) -> Result<Option<Bytes>, Refusal> {
        Ok(self.get_many(&[key.to_owned()])?.pop().flatten())
    }

    /// Objects whole, in their order.
    pub(crate) fn get_many(&self, keys: &[String]) -> Result<Vec<Option<Bytes>>, Refusal> {
        let asks = keys.iter().map(|key| (key.clone(), Ask::Whole)).collect();
        let found = self.ask(asks)?;
        Ok(found.into_iter().map(|f| f.map(|(bytes, _)| bytes)).collect())
    }

    /// What is asked of objects, in its order, with the sizes of the objects.
    pub(crate) fn ask(&self, asks: Vec<(String, Ask)>) -> Result<Vec<Option<(Bytes, u64)>>, Refusal> {
        self.note(asks.len());
        let scheme = self.scheme.clone();
        let asks: Vec<(Key, Ask)> = asks.into_iter().map(|(key, ask)| (self.key(&key), ask)).collect();
        let store = self.store.clone();
        let all = async move {
            stream::iter(asks)
                .map(|(key, ask)| {
                    let (store, range) = (store.clone(), ask.range(&scheme));
                    async move {
                        match fetch(&*store, &key, range).await {
                            // Plain web servers may know files alone.
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
        let options = || GetOptions {
            range: range.clone(),
            ..GetOptions::default()
        };
        // The client has asked again itself, but where a connection was closed the moment that it was used.
        let found = match up_to(2, || store.get_opts(key, options())).await {
            Ok(found) => found,
            Err(e @ Error::NotFound { .. }) if !chain(&e).contains("NoSuchBucket") => return Ok(None),
            Err(e) => return Err(e),
        };
        let size = found.meta.size;
        if found.range.end.saturating_sub(found.range.start) > LARGEST {
            let source = format!("{key} has {size} bytes, which no file of a store has");
            return Err(Error::Generic {
                store: "object",
                source: source.into(),
            });
        }
        match found.bytes().await {
            Err(Error::Generic { .. }) if attempts > 0 => {}
            result => return result.map(|bytes| Some((bytes, size))),
        }
    }
}

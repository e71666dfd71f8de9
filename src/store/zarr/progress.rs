//! Records the finished tiles of a render, in a journal in the store's folder, or in one object per tile at
//! the store's URL.

use super::TensorStore;
use super::atomic::AtomicDirectory;
use super::remote_store::PROGRESS;
use base::journal::{self, Journal};
use std::io;
use std::sync::Arc;
use tensor::sink::TileRecord;

#[derive(Debug)]
pub(crate) enum Progress {
    File(Journal<TileRecord>),
    Objects(Arc<AtomicDirectory>),
}

impl Progress {
    /// Opens or creates the journal of a store that is open for writing, and returns its records.
    pub(crate) fn open(store: &TensorStore) -> io::Result<(Self, Vec<TileRecord>)> {
        let Some(remote) = &store.storage.remote else {
            let (journal, done) = Journal::open(store.path())?;
            return Ok((Self::File(journal), done));
        };
        let found = remote.objects().get_many(&remote.stored_below(PROGRESS))?;
        let records = found.iter().flatten();
        let records = records.filter_map(|bytes| serde_json::from_slice(bytes).ok());
        Ok((Self::Objects(store.storage.clone()), records.collect()))
    }

    /// Records a finished tile.
    pub(crate) fn push(&self, record: &TileRecord) -> io::Result<()> {
        match self {
            Self::File(journal) => journal.push(record),
            Self::Objects(storage) => {
                let text = serde_json::to_vec(record)?;
                storage.write(&format!("{PROGRESS}{}", record.tile), text.into())
            }
        }
    }

    /// Removes the journal after all tiles are finished.
    pub(crate) fn remove(self) -> io::Result<()> {
        match self {
            Self::File(journal) => journal.remove(),
            Self::Objects(storage) => match &storage.remote {
                Some(remote) => Ok(remote.erase(remote.stored_below(PROGRESS))?),
                None => Ok(()),
            },
        }
    }

    /// Returns whether a store that is open for writing has a journal, that is, whether its render is
    /// unfinished.
    pub(crate) fn exists(store: &TensorStore) -> bool {
        match &store.storage.remote {
            None => journal::exists(store.path()),
            Some(remote) => !remote.stored_below(PROGRESS).is_empty(),
        }
    }
}

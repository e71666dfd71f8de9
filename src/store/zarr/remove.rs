//! Removes stores, and locks folders or URLs that contain several stores.

use super::build::ORIGIN;
use super::error::CreateError;
use super::is_store;
use super::remote_store::{self, Held, ROOT};
use crate::place::Objects;
use crate::refusal::Refusal;
use base::lock::Lock;
use base::staging;
use std::path::{Path, PathBuf};

#[derive(Debug, thiserror::Error)]
pub enum RemoveError {
    #[error(
        "{path} is not a Sunstone store, so it was not removed: pass the path of a store made by `sunstone render`"
    )]
    NotAStore { path: PathBuf },
    /// Another process writes at the path, or the lock cannot be checked.
    #[error(transparent)]
    Locked(#[from] CreateError),
    #[error("cannot remove {path}: {refusal}")]
    Remote { path: PathBuf, refusal: Refusal },
    #[error("cannot remove {path}: {cause}; check the permissions of the folder")]
    Io { path: PathBuf, cause: std::io::Error },
}

impl RemoveError {
    /// Returns whether the cause is a system error.
    pub fn is_of_system(&self) -> bool {
        matches!(self, Self::Io { .. })
    }
}

/// The lock of a folder or a URL that contains several stores. The lock is held until the value is dropped.
#[derive(Debug)]
pub struct PlaceLock {
    _held: Held,
}

impl PlaceLock {
    /// Takes the lock.
    ///
    /// # Errors
    /// Returns an error if another process holds the lock, or the lock cannot be acquired.
    pub fn take(path: &Path) -> Result<Self, CreateError> {
        let refused = |refusal| CreateError::Remote { path: path.to_owned(), refusal };
        let held = match remote_store::objects_of(path).map_err(refused)? {
            Some(objects) => {
                objects.may_be_written().map_err(refused)?;
                Held::Objects { _lock: remote_store::locked(path, &objects)? }
            }
            None => Held::File { _lock: Lock::take(path).map_err(|e| CreateError::locked(path, e))? },
        };
        Ok(Self { _held: held })
    }
}

/// Removes a finished or unfinished store, or a part of a render, from a folder or an object store. Returns
/// false if there is no store. After an interrupted removal, the store is not finished.
///
/// # Errors
/// Returns [`RemoveError`] if the path is not a store, another process writes the store, or the store cannot
/// be removed.
pub fn remove(path: &Path) -> Result<bool, RemoveError> {
    let refused = |refusal| RemoveError::Remote { path: path.to_owned(), refusal };
    if let Some(objects) = remote_store::objects_of(path).map_err(refused)? {
        objects.may_be_written().map_err(refused)?;
        if objects.list().map_err(refused)?.is_empty() {
            return Ok(false);
        }
        let _lock = remote_store::locked(path, &objects)?;
        return remove_objects(path, &objects).map_err(refused)?;
    }
    if std::fs::symlink_metadata(path).is_err() {
        return Ok(false);
    }
    if !is_store(path) {
        return Err(not_a_store(path));
    }
    let _lock = Lock::take(path).map_err(|e| CreateError::locked(path, e))?;
    let io = |cause| RemoveError::Io { path: path.to_owned(), cause };
    // If the process is killed after the rename, the creation of the next store at the same path removes the
    // leftover.
    let part = staging::part_of(path);
    staging::remove(&part).map_err(io)?;
    std::fs::rename(path, &part).map_err(io)?;
    staging::remove(&part).map_err(io)?;
    Ok(true)
}

fn not_a_store(path: &Path) -> RemoveError {
    RemoveError::NotAStore { path: path.to_owned() }
}

/// Removes the objects of a store at a URL. The caller holds the lock of the URL.
fn remove_objects(path: &Path, objects: &Objects) -> Result<Result<bool, RemoveError>, Refusal> {
    let names: Vec<String> = remote_store::found(objects)?.into_keys().collect();
    if names.is_empty() {
        return Ok(Ok(false));
    }
    let is_begun = names.iter().any(|name| name == ORIGIN);
    let root = objects.get(ROOT)?;
    if !is_begun && !root.is_some_and(|bytes| remote_store::is_root(path, &bytes)) {
        return Ok(Err(not_a_store(path)));
    }
    // With the marker, the URL counts as an unfinished store until all objects are removed.
    objects.put(ORIGIN, vec![].into())?;
    remote_store::delete(objects, names.into_iter())?;
    objects.delete(vec![ORIGIN.to_owned()])?;
    Ok(Ok(true))
}

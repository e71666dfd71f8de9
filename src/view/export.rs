//! Exports stores as a folder that any web server can host: the page, a description, and sharded copies of
//! the stores. The page computes its numbers from the shards.

use crate::describe::describe;
use crate::error::ViewError;
use crate::open::Shown;
use crate::page;
use base::lock::Lock;
use base::{staging, whole_file};
use serde_json::json;
use std::path::{Path, PathBuf};
use store::shard::shard;
use store::zarr::{CreateError, OpenError, around, verify};

/// File that marks the folder of an export. The page finds it, and reads the stores from files.
const DESCRIPTION: &str = "data/describe.json";

/// Writes an export of finished stores to `folder`. The folder appears when it is complete. If `replace` is
/// true, it may replace an earlier export.
///
/// # Errors
/// Returns an error if a store is unfinished or contains captures, if the folder exists, or if writing fails.
pub fn export(stores: &[PathBuf], folder: &Path, replace: bool) -> Result<(), ViewError> {
    if stores.is_empty() {
        return Err(ViewError::NoStore);
    }
    let shown: Vec<Shown> = stores.iter().map(|path| Shown::new(path)).collect::<Result<_, _>>()?;
    for store in &shown {
        if store.is_captures {
            return Err(ViewError::Captures { path: store.path.clone() });
        }
        if !store.tensor()?.is_finished() {
            return Err(OpenError::Unfinished { path: store.path.clone() }.into());
        }
    }
    let folder = &whole_file::real(folder);
    if let Some(store) = stores.iter().find(|store| whole_file::real(store).starts_with(folder)) {
        return Err(ViewError::Contains { path: folder.to_owned(), store: store.clone() });
    }
    if let Some(store) = around(folder) {
        return Err(ViewError::Within { path: folder.to_owned(), store });
    }
    let _lock = Lock::take(folder).map_err(|e| CreateError::locked(folder, e))?;
    let failed = |cause| ViewError::Write { path: folder.to_owned(), cause };
    staging::recover(folder).map_err(failed)?;
    if std::fs::symlink_metadata(folder).is_ok() {
        if !replace {
            return Err(ViewError::Exists { path: folder.to_owned() });
        }
        if !folder.join(DESCRIPTION).is_file() {
            return Err(ViewError::NotAnExport { path: folder.to_owned() });
        }
    }
    let part = staging::part_of(folder);
    staging::remove(&part).map_err(failed)?;
    let write = || -> Result<(), ViewError> {
        std::fs::create_dir_all(part.join("data")).map_err(failed)?;
        for (name, bytes, _) in page::FILES {
            whole_file::write(&part.join(name), bytes).map_err(failed)?;
        }
        let mut description = describe(&shown, true)?;
        for (id, store) in shown.iter().enumerate() {
            let name = id.to_string();
            copy(store, &part.join("data").join(&name))?;
            description["stores"][id]["folder"] = json!(name);
            // The reader of the page does not have the author's folders.
            description["stores"][id]["path"] = description["stores"][id]["name"].clone();
        }
        whole_file::write(&part.join(DESCRIPTION), description.to_string().as_bytes()).map_err(failed)?;
        staging::put(&part, folder).map_err(failed)
    };
    write().inspect_err(|_| {
        let _ = staging::remove(&part);
    })
}

/// Copies a store into shards, or copies the files of a store that has shards already.
fn copy(shown: &Shown, to: &Path) -> Result<(), ViewError> {
    if !shown.tensor()?.is_sharded()? {
        shard(&shown.path, to, false)?;
        return Ok(());
    }
    let failed = |cause| ViewError::Write { path: to.to_owned(), cause };
    copy_folder(&shown.path, to).map_err(failed)?;
    match verify(to)?.faults.first() {
        Some(fault) => Err(ViewError::Faulty { path: shown.path.clone(), fault: fault.clone() }),
        None => Ok(()),
    }
}

/// Copies files and folders. Files that are not of the store remain, and are found when the copy is verified.
fn copy_folder(from: &Path, to: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy_folder(&entry.path(), &target)?;
        } else {
            std::fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}

//! Opens the inputs of commands. An input is a slice of a store, or an item of a file.

use crate::{Failure, bail};
use std::path::{Path, PathBuf};
use sunstone::store::probe::Selection;
use sunstone::store::zarr::{StoredSlice, TensorStore};

/// The input of `probe`: a slice of a store, or a part of a slice.
#[derive(clap::Args)]
pub struct Source {
    /// Store written by `render` or `merge`.
    pub store: PathBuf,
    /// Slice to read.
    pub slice: String,
    /// Keep part of an axis: AXIS=VALUE (nearest entry) or AXIS=FROM:TO, in the axis' unit. Repeatable.
    #[arg(short = 'k', long = "select")]
    pub select: Vec<Selection>,
    /// Also read an unfinished render: values that are not rendered yet are NaN.
    #[arg(long)]
    pub partial: bool,
}

/// Opens a store for reading. An unfinished store is an error unless `partial` is true.
pub fn store(path: &Path, partial: bool) -> Result<TensorStore, Failure> {
    let open = if partial { TensorStore::open_partial } else { TensorStore::open };
    open(path).map_err(Failure::input)
}

/// Returns the name of the selected item of a file, or of its only item. `kind` is the noun for the
/// items, singular and plural.
pub fn choose(file: &Path, kind: [&str; 2], names: &[String], name: Option<&str>) -> Result<String, Failure> {
    let ([one, several], file, known) = (kind, file.display(), names.join(", "));
    match (name, names) {
        (Some(name), _) if names.iter().any(|n| n == name) => Ok(name.to_owned()),
        (Some(name), _) => bail!("{file} has no {one} `{name}`; available: {known}"),
        (None, [name]) => Ok(name.clone()),
        (None, _) => bail!("{file} contains several {several}; choose one of them with --name: {known}"),
    }
}

/// Opens a store and a slice of the store.
pub fn slice(path: &Path, name: &str, partial: bool) -> Result<(TensorStore, StoredSlice), Failure> {
    let store = store(path, partial)?;
    let slice = store.slice(name).map_err(Failure::input)?;
    Ok((store, slice))
}

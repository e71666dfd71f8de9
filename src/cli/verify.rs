//! The `sunstone verify` command, which checks a store.

use crate::{Failure, print};
use std::path::PathBuf;
use sunstone::store::zarr;

/// Check that every file of a store exists, is complete and is unchanged.
///
/// Exits with 0 if the store is intact, 1 if any file is damaged (each is printed on a line), 2 if there is
/// no finished store to check.
#[derive(clap::Args)]
pub struct Arguments {
    /// Store written by `render`, `merge` or `probe`.
    store: PathBuf,
}

/// Maximum number of faults to print.
const SHOWN: usize = 20;

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let found = zarr::verify(&a.store).map_err(Failure::input)?;
    let (store, files) = (a.store.display(), found.files);
    if found.faults.is_empty() {
        let size = found.bytes as f64 / 1e6;
        if let Some(refusal) = &found.unlisted {
            eprintln!("note: cannot check for unexpected files in the store: {refusal}");
        }
        return print(&format!(
            "{store}: {}{files} files, {size:.1} MB, all intact",
            found.part.map_or(String::new(), |part| format!("{part} of a render, "))
        ));
    }
    let mut lines: Vec<String> = found.faults.iter().take(SHOWN).map(|f| format!("  {f}")).collect();
    if found.faults.len() > SHOWN {
        lines.push(format!("  … and {} more", found.faults.len() - SHOWN));
    }
    Err(Failure::failed(format!(
        "{store} is damaged in {} of {files} files:\n{}\nrender the scene again, or restore the store from a backup",
        found.faults.len(),
        lines.join("\n")
    )))
}

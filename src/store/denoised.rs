//! The mark of denoised stores: their values are pictures of what a render might say, not what it says.
//!
//! Whatever takes a store for truth, or goes on with its samples, refuses it.

use crate::zarr::TensorStore;
use std::path::PathBuf;

/// Root attribute that says how a store was denoised and of what.
pub const ATTRIBUTE: &str = "denoised";

/// A denoised store where a render is wanted.
#[derive(Debug, thiserror::Error)]
#[error("{path} is denoised, which is only for figures; use the original render{of}")]
pub struct Denoised {
    /// The store.
    pub path: PathBuf,
    /// What it was made of, in words.
    of: String,
}

/// Whether a store is denoised.
#[must_use]
pub fn is_denoised(store: &TensorStore) -> bool {
    store.attributes().contains_key(ATTRIBUTE)
}

/// Refuses a store that is denoised.
///
/// # Errors
/// [`Denoised`].
pub fn refuse(store: &TensorStore) -> Result<(), Denoised> {
    let Some(mark) = store.attributes().remove(ATTRIBUTE) else {
        return Ok(());
    };
    let sources = mark["of"].as_array().into_iter().flatten();
    let names: Vec<&str> = sources.filter_map(|source| source["path"].as_str()).collect();
    Err(Denoised {
        path: store.path().to_owned(),
        of: if names.is_empty() {
            String::new()
        } else {
            format!(" ({})", names.join(", "))
        },
    })
}

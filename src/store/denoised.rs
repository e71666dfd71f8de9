//! Defines the root attribute that marks denoised stores. The values of denoised stores are images for
//! figures, not unbiased estimates of radiance.
//!
//! Every function that uses a store as ground truth, or adds samples to a store, refuses denoised stores.

use crate::zarr::TensorStore;
use std::path::PathBuf;

/// Name of the root attribute with the method and the sources of a denoised store.
pub const ATTRIBUTE: &str = "denoised";

/// The error of a command that requires a render but was given a denoised store.
#[derive(Debug, thiserror::Error)]
#[error("{path} is denoised, and denoised values are only for figures; use the original render{of}")]
pub struct Denoised {
    pub path: PathBuf,
    /// Text that lists the paths of the original renders.
    of: String,
}

pub fn is_denoised(store: &TensorStore) -> bool {
    store.attributes().contains_key(ATTRIBUTE)
}

/// Refuses a denoised store.
///
/// # Errors
/// Returns [`Denoised`] if the store is denoised.
pub fn refuse(store: &TensorStore) -> Result<(), Denoised> {
    let Some(mark) = store.attributes().remove(ATTRIBUTE) else {
        return Ok(());
    };
    let sources = mark["of"].as_array().into_iter().flatten();
    let names: Vec<&str> = sources.filter_map(|source| source["path"].as_str()).collect();
    Err(Denoised {
        path: store.path().to_owned(),
        of: if names.is_empty() { String::new() } else { format!(" ({})", names.join(", ")) },
    })
}

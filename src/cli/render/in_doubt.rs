//! Reports unreliable error estimates of a finished render.

use crate::Failure;
use std::path::Path;
use sunstone::store::doubt;
use sunstone::store::zarr::TensorStore;

/// Returns a note on the slice with the largest share of lit pixels whose error estimates are unreliable. The
/// note is empty if that share is at most 0.1 %.
pub(super) fn in_doubt(path: &Path) -> Result<String, Failure> {
    let store = TensorStore::open(path).map_err(Failure::failed)?;
    let mut most = (0.001, String::new());
    for name in store.slice_names() {
        let slice = store.slice(name).map_err(Failure::failed)?;
        if let Some(doubt) = doubt::of(&slice).map_err(Failure::failed)?
            && doubt.share() > most.0
        {
            let percent = 100.0 * doubt.share();
            let message = format!(
                ", {percent:.1} % unreliable error estimates (too few samples) in slice {name} (see sunstone info)"
            );
            most = (doubt.share(), message);
        }
    }
    Ok(most.1)
}

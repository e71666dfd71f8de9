//! Merges that wait for servers: more chunks at once than the machine has cores.

use crate::place::is_address;
use std::path::{Path, PathBuf};

/// Chunks at once. Each takes the memory of one chunk of every input, some 100 MB at most.
const THREADS: usize = 8;

/// Does work on as many threads as it takes to keep the way to the stores busy, where any of these lies below an address.
pub(crate) fn many<T: Send>(inputs: &[PathBuf], out: &Path, work: impl FnOnce() -> T + Send) -> T {
    let far = is_address(out) || inputs.iter().any(|input| is_address(input));
    let more = rayon::current_num_threads() < THREADS;
    let pool = (far && more).then(|| rayon::ThreadPoolBuilder::new().num_threads(THREADS).build());
    match pool {
        Some(Ok(pool)) => pool.install(work),
        _ => work(),
    }
}

//! Thread pool for merges over a network, which process more chunks concurrently than the machine has cores.

use crate::place::is_address;
use std::path::{Path, PathBuf};

/// Number of concurrent chunks. Each needs the memory of one chunk of every input, about 100 MB at most.
const THREADS: usize = 8;

/// Runs `work` on enough threads to use the bandwidth to object stores, if any of the stores is at an
/// address.
pub(crate) fn many<T: Send>(inputs: &[PathBuf], out: &Path, work: impl FnOnce() -> T + Send) -> T {
    let far = is_address(out) || inputs.iter().any(|input| is_address(input));
    let more = rayon::current_num_threads() < THREADS;
    let pool = (far && more).then(|| rayon::ThreadPoolBuilder::new().num_threads(THREADS).build());
    match pool {
        Some(Ok(pool)) => pool.install(work),
        _ => work(),
    }
}

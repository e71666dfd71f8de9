//! Runs work without Python's global interpreter lock (GIL). The work can run in a forked process.
//!
//! A fork copies only one thread. The child process therefore has the queue of rayon's global pool, but no
//! worker threads, and work in this pool would never run. Work in a child process runs on a separate pool.

use crate::error::failed;
use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;
use std::sync::OnceLock;

/// ID of the process that imported the module. Rayon's global pool has worker threads only in this process.
static IMPORTER: OnceLock<u32> = OnceLock::new();

/// Records which process imports the module.
pub fn imported() {
    IMPORTER.get_or_init(std::process::id);
}

/// Runs work on `threads` new threads. 0 means one thread per core.
fn on_own_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|e| failed(format!("cannot start threads: {e}; use fewer threads")))?;
    Ok(pool.install(work))
}

/// Runs work that may use rayon's global pool. In a forked process, the work runs on new threads.
pub fn fork_safe<T: Send>(work: impl FnOnce() -> T + Send) -> PyResult<T> {
    if IMPORTER.get() == Some(&std::process::id()) { Ok(work()) } else { on_own_threads(0, work) }
}

/// Runs work by [`fork_safe`] while other Python threads run.
pub fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    py.detach(|| fork_safe(work))
}

/// Runs work on `threads` new threads while other Python threads run. 0 means one thread per core.
pub fn off_python<T: Send>(py: Python<'_>, threads: usize, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    py.detach(|| on_own_threads(threads, work))
}

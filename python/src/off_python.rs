//! Work without Python's lock, which also runs in a forked process.
//!
//! A fork copies one thread: of rayon's global pool, the child has the queue and none of the workers, and waits for ever. In
//! a child, work therefore runs on a pool of its own.

use crate::error::failed;
use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;
use std::sync::OnceLock;

/// The process that imported the module: its global pool has workers.
static IMPORTER: OnceLock<u32> = OnceLock::new();

/// Notes which process imports the module.
pub fn imported() {
    IMPORTER.get_or_init(std::process::id);
}

/// Does work on `threads` threads of its own (0: as many as cores).
fn on_own_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|e| failed(format!("cannot start threads: {e}")))?;
    Ok(pool.install(work))
}

/// Does work that may use rayon's global pool; in a forked process, on threads of its own.
pub fn fork_safe<T: Send>(work: impl FnOnce() -> T + Send) -> PyResult<T> {
    if IMPORTER.get() == Some(&std::process::id()) {
        Ok(work())
    } else {
        on_own_threads(0, work)
    }
}

/// Does work while other threads of Python run; see [`fork_safe`].
pub fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    py.detach(|| fork_safe(work))
}

/// Does work while other threads of Python run, on threads of its own (0: as many as cores).
pub fn off_python<T: Send>(py: Python<'_>, threads: usize, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    py.detach(|| on_own_threads(threads, work))
}

//! Work without Python's lock.

use crate::error::failed;
use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;

/// Does work while other threads of Python go on, on threads of its own (0: as many as cores), so that it also works in a
/// process that was forked.
pub fn off_python<T: Send>(py: Python<'_>, threads: usize, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    py.detach(|| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        pool.map(|pool| pool.install(work))
    })
    .map_err(|e| failed(format!("cannot start threads: {e}")))
}

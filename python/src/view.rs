//! The explorer of stores.

use crate::error::{failed, input};
use crate::off_python;
use pyo3::prelude::*;
use std::path::PathBuf;
use sunstone::view::Viewer;

/// Start the explorer of stores; return its URL. It serves until the process ends.
#[pyfunction]
pub fn start_view(py: Python<'_>, stores: Vec<PathBuf>, port: u16) -> PyResult<String> {
    off_python::detached(py, || match Viewer::start(&stores, port) {
        Ok(viewer) => Ok(viewer.url().to_owned()),
        Err(e) if e.is_of_system() => Err(failed(e)),
        Err(e) => Err(input(e)),
    })?
}

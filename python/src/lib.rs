//! The extension module `pysunstone._native`: Sunstone's public face with Python's types, and no logic of its own beyond their
//! conversion. What people use is the package `pysunstone` around it, which says what everything means.

mod analysis;
mod capture;
mod error;
mod off_python;
mod picture;
mod render;
mod rig;
mod scene;
mod watch;

use pyo3::prelude::*;

/// Runs the command line `sunstone` in this process; returns its exit code.
#[pyfunction]
fn command(py: Python<'_>, words: Vec<std::ffi::OsString>) -> u8 {
    py.detach(|| sunstone::cli::run_words(words))
}

#[pymodule]
fn _native(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    error::register(m)?;
    rig::register(m)?;
    m.add_class::<scene::Scene>()?;
    m.add_class::<capture::Scheme>()?;
    m.add_function(wrap_pyfunction!(command, m)?)?;
    m.add_function(wrap_pyfunction!(render::render_store, m)?)?;
    m.add_function(wrap_pyfunction!(render::render_arrays, m)?)?;
    m.add_function(wrap_pyfunction!(picture::encode_image, m)?)?;
    m.add_function(wrap_pyfunction!(analysis::quantities, m)?)?;
    m.add_function(wrap_pyfunction!(analysis::decompose, m)?)?;
    m.add_function(wrap_pyfunction!(capture::simulate, m)?)?;
    m.add_function(wrap_pyfunction!(capture::reconstruct, m)?)?;
    Ok(())
}

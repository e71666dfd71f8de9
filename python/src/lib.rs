//! The extension module `pysunstone._native`, which converts between Python types and Sunstone's public API,
//! without other logic. Users import the package `pysunstone`, which documents the interface.

mod analysis;
mod apply;
mod capture;
mod detector;
mod error;
mod lanes;
mod learn;
mod material;
mod medium;
mod mitsuba;
mod off_python;
mod picture;
mod render;
mod rig;
mod scene;
mod shape;
mod view;
mod watch;

use pyo3::prelude::*;

/// Run the command `sunstone` in this process; return its exit code.
#[pyfunction]
fn command(py: Python<'_>, words: Vec<std::ffi::OsString>) -> PyResult<u8> {
    off_python::detached(py, || cli::run_words(words))
}

#[pymodule]
fn _native(m: &Bound<'_, PyModule>) -> PyResult<()> {
    off_python::imported();
    sunstone::objects::install();
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    error::register(m)?;
    rig::register(m)?;
    m.add_class::<scene::Scene>()?;
    m.add_class::<capture::Scheme>()?;
    m.add_class::<learn::LearningData>()?;
    m.add_class::<material::Material>()?;
    m.add_class::<shape::Devices>()?;
    m.add_class::<medium::Medium>()?;
    m.add_function(wrap_pyfunction!(command, m)?)?;
    m.add_function(wrap_pyfunction!(render::render_store, m)?)?;
    m.add_function(wrap_pyfunction!(render::render_arrays, m)?)?;
    m.add_function(wrap_pyfunction!(picture::encode_image, m)?)?;
    m.add_function(wrap_pyfunction!(view::start_view, m)?)?;
    m.add_function(wrap_pyfunction!(picture::rgb_weights, m)?)?;
    m.add_function(wrap_pyfunction!(analysis::quantities, m)?)?;
    m.add_function(wrap_pyfunction!(analysis::decompose, m)?)?;
    m.add_function(wrap_pyfunction!(capture::simulate, m)?)?;
    m.add_function(wrap_pyfunction!(capture::reconstruct, m)?)?;
    m.add_function(wrap_pyfunction!(detector::capture, m)?)?;
    m.add_function(wrap_pyfunction!(learn::learn, m)?)?;
    m.add_function(wrap_pyfunction!(mitsuba::import_mitsuba, m)?)?;
    m.add_function(wrap_pyfunction!(apply::applications_json, m)?)?;
    m.add_function(wrap_pyfunction!(apply::run_application, m)?)?;
    m.add_function(wrap_pyfunction!(shape::code_patterns, m)?)?;
    m.add_function(wrap_pyfunction!(shape::decode_columns, m)?)?;
    m.add_function(wrap_pyfunction!(shape::triangulate, m)?)?;
    m.add_function(wrap_pyfunction!(shape::normals_of_depth, m)?)?;
    m.add_function(wrap_pyfunction!(shape::polarization_cues, m)?)?;
    m.add_function(wrap_pyfunction!(shape::normals_of_cues, m)?)?;
    Ok(())
}

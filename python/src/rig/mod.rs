//! Provides rigs to Python. A session can use instruments of the rig file and Python instruments.

mod arrays;
mod check;
mod fault;
mod given;
mod own;
mod session;
mod values;

use pyo3::prelude::*;

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<session::RigSession>()?;
    m.add_class::<own::RigStage>()?;
    m.add_class::<own::RigProjector>()?;
    m.add_class::<own::RigCamera>()?;
    m.add_class::<own::RigGalvo>()?;
    m.add_class::<own::RigLaser>()?;
    m.add_class::<own::RigCounter>()?;
    m.add_function(wrap_pyfunction!(session::rig_open, m)?)?;
    m.add_function(wrap_pyfunction!(session::rig_cost, m)?)?;
    m.add_function(wrap_pyfunction!(session::rig_run, m)?)?;
    m.add_function(wrap_pyfunction!(check::rig_check, m)?)?;
    Ok(())
}

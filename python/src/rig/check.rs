//! Conformance checks for Python instruments.

use super::fault::Thrown;
use super::own::{RigCamera, RigCounter, RigGalvo, RigLaser, RigProjector, RigStage};
use crate::error::input;
use crate::watch::watched;
use pyo3::prelude::*;
use sunstone::rig::conformance::{self, Report};

/// Check an instrument of a kind; return the names of the checks and the faults found.
#[pyfunction]
pub fn rig_check<'py>(
    py: Python<'py>,
    kind: &str,
    name: &str,
    object: &Bound<'py, PyAny>,
) -> PyResult<Vec<(&'static str, Option<String>)>> {
    // Runs a check on an instrument of the rig or on a Python instrument.
    macro_rules! checked {
        ($own:ident, $check:path) => {{
            let mut device = $own::lend(name, object, &Thrown::default())?;
            let report = watched(py, None, |_| $check(device.as_mut()));
            $own::give_back(object, Some(device));
            report?
        }};
    }
    let Report(checks) = match kind {
        "stage" => checked!(RigStage, conformance::rotation_stage),
        "projector" => checked!(RigProjector, conformance::pattern_projector),
        "camera" => checked!(RigCamera, conformance::area_camera),
        "galvo" => checked!(RigGalvo, conformance::galvo_scanner),
        "laser" => checked!(RigLaser, conformance::pulsed_laser),
        "counter" => checked!(RigCounter, conformance::photon_counter::photon_counter),
        other => return Err(input(format!("unknown kind of instrument `{other}`"))),
    };
    Ok(checks.into_iter().map(|c| (c.name, c.fault)).collect())
}

//! Conformance checks for Python instruments.

use super::fault::Thrown;
use super::given;
use super::own::{RigCamera, RigCounter, RigGalvo, RigLaser, RigProjector, RigStage};
use crate::error::input;
use crate::watch::looked_on;
use pyo3::prelude::*;
use sunstone::rig::conformance::{self, Report};
use sunstone::rig::instrument::{
    AreaCamera, GalvoScanner, PatternProjector, PhotonCounter, PulsedLaser, RotationStage,
};

/// Runs a check on an instrument of the rig or on a Python instrument.
macro_rules! checked {
    ($py:ident, $name:ident, $object:ident, $own:ident, $given:ident, $device:ident, $check:path) => {{
        let (mut device, own): (Box<dyn $device>, bool) = match $own::lend($object) {
            Some(lent) => (lent?, true),
            None => (Box::new(given::$given::new($name, $object, &Thrown::default())?), false),
        };
        let report = looked_on($py, None, |_| $check(device.as_mut()));
        if own {
            $own::give_back($object, device);
        }
        report?
    }};
}

/// Check an instrument of a kind; return the names of the checks and the faults found.
#[pyfunction]
pub fn rig_check<'py>(
    py: Python<'py>,
    kind: &str,
    name: &str,
    object: &Bound<'py, PyAny>,
) -> PyResult<Vec<(&'static str, Option<String>)>> {
    let Report(checks) = match kind {
        "stage" => checked!(py, name, object, RigStage, Stage, RotationStage, conformance::rotation_stage),
        "projector" => {
            checked!(
                py,
                name,
                object,
                RigProjector,
                Projector,
                PatternProjector,
                conformance::pattern_projector
            )
        }
        "camera" => checked!(py, name, object, RigCamera, Camera, AreaCamera, conformance::area_camera),
        "galvo" => checked!(py, name, object, RigGalvo, Galvo, GalvoScanner, conformance::galvo_scanner),
        "laser" => checked!(py, name, object, RigLaser, Laser, PulsedLaser, conformance::pulsed_laser),
        "counter" => {
            checked!(
                py,
                name,
                object,
                RigCounter,
                Counter,
                PhotonCounter,
                conformance::photon_counter::photon_counter
            )
        }
        other => return Err(input(format!("unknown kind of instrument `{other}`"))),
    };
    Ok(checks.into_iter().map(|c| (c.name, c.fault)).collect())
}

//! Sessions: a plan, a rig file, and instruments of the file and of Python.

use super::fault::Thrown;
use super::given;
use super::own::{RigCamera, RigCounter, RigGalvo, RigLaser, RigProjector, RigStage};
use crate::error::{failed, input, located};
use crate::watch::looked_on;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use sunstone::rig::instrument::RotationStage;
use sunstone::rig::session::lab::{Rig, Stage};
use sunstone::rig::session::run::{self, RunError};
use sunstone::rig::session::run_store;
use sunstone::rigs::prepared::{Existing, PrepareError, Prepared};

/// A plan with its rig.
#[pyclass(frozen, module = "pysunstone._native")]
pub struct RigSession {
    prepared: Prepared,
    /// The rig without its instruments, which Python owns: its clock and a simulated bench's connections.
    bare: Mutex<Option<Rig>>,
    sample: Option<String>,
}

fn prepare(py: Python<'_>, e: &PrepareError) -> PyErr {
    match e {
        PrepareError::Input(e) => located(py, e),
        PrepareError::Wrong(e) => input(e),
        PrepareError::Failed(e) | PrepareError::Interrupted(e) => failed(e),
    }
}

/// Load plan and rig, and connect the instruments of the rig file except the given ones. Return the session
/// and its instruments by name. `progress` reports the render that a simulated bench plays.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "Python gives them by name")]
pub fn rig_open<'py>(
    py: Python<'py>,
    plan: PathBuf,
    rig: Option<PathBuf>,
    given: Vec<String>,
    sample: Option<String>,
    bench: PathBuf,
    dry: bool,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<(RigSession, Bound<'py, PyDict>)> {
    let mut prepared = Prepared::load(&plan, rig.as_ref()).map_err(|e| prepare(py, &e))?;
    if let Some(sample) = &sample {
        prepared.put_sample(sample).map_err(|e| prepare(py, &e))?;
    }
    let made = looked_on(py, progress, |seen| prepared.assemble(&given, dry, &bench, seen))?;
    let mut rig = made.map_err(|e| prepare(py, &e))?;
    let own = PyDict::new(py);
    for (name, stage) in std::mem::take(&mut rig.stages) {
        own.set_item(name, Bound::new(py, RigStage::new(stage.device))?)?;
    }
    if let Some(device) = rig.projector.take() {
        own.set_item("projector", Bound::new(py, RigProjector::new(device))?)?;
    }
    if let Some(device) = rig.camera.take() {
        own.set_item("camera", Bound::new(py, RigCamera::new(device))?)?;
    }
    if let Some(device) = rig.galvo.take() {
        own.set_item("galvo", Bound::new(py, RigGalvo::new(device))?)?;
    }
    if let Some(device) = rig.laser.take() {
        own.set_item("laser", Bound::new(py, RigLaser::new(device))?)?;
    }
    if let Some(device) = rig.counter.take() {
        own.set_item("counter", Bound::new(py, RigCounter::new(device))?)?;
    }
    let session = RigSession { prepared, bare: Mutex::new(Some(rig)), sample };
    Ok((session, own))
}

/// A rig whose instruments are lent by Python objects; they are returned when it is dropped.
struct Lent<'a, 'py> {
    session: &'a RigSession,
    objects: BTreeMap<String, Bound<'py, PyAny>>,
    rig: Option<Rig>,
}

impl<'a, 'py> Lent<'a, 'py> {
    fn new(session: &'a RigSession, instruments: &Bound<'py, PyDict>, thrown: &Thrown) -> PyResult<Self> {
        let bare = session.bare.lock().unwrap_or_else(PoisonError::into_inner).take();
        let bare = bare.ok_or_else(|| input("the session is running; wait until it ends"))?;
        let mut lent = Self { session, objects: instruments.extract()?, rig: Some(bare) };
        for (name, object) in &lent.objects {
            if let Some(rig) = &mut lent.rig {
                lend(rig, session, name, object, thrown)?;
            }
        }
        Ok(lent)
    }
}

impl Drop for Lent<'_, '_> {
    fn drop(&mut self) {
        let Some(mut rig) = self.rig.take() else {
            return;
        };
        for (name, object) in &self.objects {
            match name.as_str() {
                "projector" => {
                    rig.projector.take().into_iter().for_each(|d| RigProjector::give_back(object, d));
                }
                "camera" => rig.camera.take().into_iter().for_each(|d| RigCamera::give_back(object, d)),
                "galvo" => rig.galvo.take().into_iter().for_each(|d| RigGalvo::give_back(object, d)),
                "laser" => rig.laser.take().into_iter().for_each(|d| RigLaser::give_back(object, d)),
                "counter" => rig.counter.take().into_iter().for_each(|d| RigCounter::give_back(object, d)),
                stage => {
                    let device = rig.stages.remove(stage).map(|s| s.device);
                    device.into_iter().for_each(|d| RigStage::give_back(object, d));
                }
            }
        }
        *self.session.bare.lock().unwrap_or_else(PoisonError::into_inner) = Some(rig);
    }
}

/// Adds an object to a rig as the instrument with this name.
fn lend(
    rig: &mut Rig,
    session: &RigSession,
    name: &str,
    object: &Bound<'_, PyAny>,
    thrown: &Thrown,
) -> PyResult<()> {
    match name {
        "projector" => {
            rig.projector = Some(match RigProjector::lend(object) {
                Some(own) => own?,
                None => Box::new(given::Projector::new(name, object, thrown)?),
            });
        }
        "camera" => {
            rig.camera = Some(match RigCamera::lend(object) {
                Some(own) => own?,
                None => Box::new(given::Camera::new(name, object, thrown)?),
            });
        }
        "galvo" => {
            rig.galvo = Some(match RigGalvo::lend(object) {
                Some(own) => own?,
                None => Box::new(given::Galvo::new(name, object, thrown)?),
            });
        }
        "laser" => {
            rig.laser = Some(match RigLaser::lend(object) {
                Some(own) => own?,
                None => Box::new(given::Laser::new(name, object, thrown)?),
            });
        }
        "counter" => {
            rig.counter = Some(match RigCounter::lend(object) {
                Some(own) => own?,
                None => Box::new(given::Counter::new(name, object, thrown)?),
            });
        }
        stage => {
            let device: Box<dyn RotationStage> = match RigStage::lend(object) {
                Some(own) => own?,
                None => Box::new(given::Stage::new(name, object, thrown)?),
            };
            let approach_deg = session.prepared.approach_deg(stage);
            rig.stages.insert(stage.to_owned(), Stage { device, approach_deg });
        }
    }
    Ok(())
}

/// Return the cost of a run: frames, seconds (also while stages move), bytes; and the element stages.
#[pyfunction]
pub fn rig_cost<'py>(
    py: Python<'py>,
    session: &RigSession,
    instruments: &Bound<'py, PyDict>,
) -> PyResult<(u64, f64, f64, u64)> {
    let thrown = Thrown::default();
    let lent = Lent::new(session, instruments, &thrown)?;
    let Some(rig) = &lent.rig else {
        return Err(input("the session is running"));
    };
    let steps = session.prepared.steps(rig).map_err(|e| prepare(py, &e))?;
    let cost = steps.cost(rig);
    Ok((cost.frames, cost.duration.as_secs_f64(), cost.moving.as_secs_f64(), cost.bytes))
}

/// Reason why a run ended early.
enum Ended {
    Prepare(PrepareError),
    Run(RunError),
    Disk(String),
    Python(PyErr),
}

/// Take all missing frames. Return their number, the number of failed attempts, and the seconds of the rig's
/// clock. The session runs on another thread; this one checks signals.
#[pyfunction]
pub fn rig_run<'py>(
    py: Python<'py>,
    session: &RigSession,
    instruments: &Bound<'py, PyDict>,
    output: PathBuf,
    resume: bool,
    force: bool,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<(u32, u32, f64)> {
    let existing = match (resume, force) {
        (true, true) => return Err(input("resume and force cannot be combined")),
        (true, false) => Existing::Resume,
        (false, true) => Existing::Replace,
        (false, false) => Existing::Refuse,
    };
    let thrown = Thrown::default();
    let mut lent = Lent::new(session, instruments, &thrown)?;
    let Some(rig) = &mut lent.rig else {
        return Err(input("the session is running"));
    };
    let (prepared, sample) = (&session.prepared, session.sample.as_deref());
    let done = looked_on(py, progress, |seen| {
        seen.calls_python().map_err(Ended::Python)?;
        let steps = prepared.steps(rig).map_err(Ended::Prepare)?;
        let begun = prepared.begin(&output, &steps, existing, sample);
        let (store, recovered) = begun.map_err(Ended::Prepare)?;
        let message = &mut |p: &run::Progress<'_>| seen.tell(p.done, p.frames);
        let outcome = run::run(rig, &steps, store, recovered, seen.stop(), message).map_err(Ended::Run)?;
        run_store::finish(&output, &steps).map_err(|e| Ended::Disk(e.to_string()))?;
        Ok(outcome)
    })?;
    drop(lent);
    match done {
        Ok(outcome) => Ok((outcome.taken, outcome.retries, outcome.elapsed.as_secs_f64())),
        Err(Ended::Prepare(e)) => Err(prepare(py, &e)),
        Err(Ended::Run(RunError::Instrument(failure))) => {
            let rest =
                format!("all earlier frames are saved in {}; resume with resume=True", output.display());
            Err(thrown.raise(py, &failure, &rest))
        }
        Err(Ended::Run(e)) => Err(failed(e)),
        Err(Ended::Disk(e)) => Err(failed(e)),
        Err(Ended::Python(e)) => Err(e),
    }
}

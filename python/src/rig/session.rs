//! Runs sessions. A session has a plan with a rig file. A session uses instruments of this file and Python
//! instruments.

use super::fault::Thrown;
use super::own::{RigCamera, RigCounter, RigGalvo, RigLaser, RigProjector, RigStage};
use crate::error::{failed, input, located};
use crate::watch::watched;
use pyo3::PyClass;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use sunstone::rig::session::lab::{Rig, Stage};
use sunstone::rig::session::run::{self, RunError};
use sunstone::rig::session::run_store;
use sunstone::rigs::prepared::{Existing, PrepareError, Prepared};

/// A measurement plan with its rig.
#[pyclass(frozen, module = "pysunstone._native")]
pub struct RigSession {
    prepared: Prepared,
    /// The rig without its instruments. Python owns the instruments. The rig contains the clock and the
    /// connections of a simulated bench.
    bare: Mutex<Option<Rig>>,
    sample: Option<String>,
}

fn prepare(e: PrepareError) -> PyErr {
    match e {
        PrepareError::Input(e) => located(e),
        PrepareError::Wrong(e) => input(e),
        PrepareError::Failed(e) | PrepareError::Interrupted(e) => failed(e),
    }
}

/// Load a plan and its rig. Connect the instruments of the rig file, except the instruments named in `given`.
/// Return the session and the connected instruments by name. `progress` is called during the render for a
/// simulated bench.
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
    let mut prepared = Prepared::load(&plan, rig.as_ref()).map_err(prepare)?;
    if let Some(sample) = &sample {
        prepared.put_sample(sample).map_err(prepare)?;
    }
    let made = watched(py, progress, |seen| prepared.assemble(&given, dry, &bench, seen))?;
    let mut rig = made.map_err(prepare)?;
    let own = PyDict::new(py);
    for (name, stage) in std::mem::take(&mut rig.stages) {
        add(&own, &name, Some(RigStage::new(stage.device)))?;
    }
    add(&own, "projector", rig.projector.take().map(RigProjector::new))?;
    add(&own, "camera", rig.camera.take().map(RigCamera::new))?;
    add(&own, "galvo", rig.galvo.take().map(RigGalvo::new))?;
    add(&own, "laser", rig.laser.take().map(RigLaser::new))?;
    add(&own, "counter", rig.counter.take().map(RigCounter::new))?;
    let session = RigSession { prepared, bare: Mutex::new(Some(rig)), sample };
    Ok((session, own))
}

/// Adds an instrument, if there is one, to the dictionary `own`.
fn add<C>(own: &Bound<'_, PyDict>, name: &str, instrument: Option<C>) -> PyResult<()>
where
    C: PyClass + Into<PyClassInitializer<C>>,
{
    instrument.map_or(Ok(()), |i| own.set_item(name, Bound::new(own.py(), i)?))
}

/// A rig that uses the instruments of Python objects. The instruments are returned to these objects when
/// the rig is dropped.
struct Lent<'a, 'py> {
    session: &'a RigSession,
    objects: BTreeMap<String, Bound<'py, PyAny>>,
    rig: Option<Rig>,
}

impl<'a, 'py> Lent<'a, 'py> {
    fn new(session: &'a RigSession, instruments: &Bound<'py, PyDict>, thrown: &Thrown) -> PyResult<Self> {
        let bare = session.bare.lock().unwrap_or_else(PoisonError::into_inner).take();
        let bare =
            bare.ok_or_else(|| input("the session is already running; wait until the session ends"))?;
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
                "projector" => RigProjector::give_back(object, rig.projector.take()),
                "camera" => RigCamera::give_back(object, rig.camera.take()),
                "galvo" => RigGalvo::give_back(object, rig.galvo.take()),
                "laser" => RigLaser::give_back(object, rig.laser.take()),
                "counter" => RigCounter::give_back(object, rig.counter.take()),
                stage => RigStage::give_back(object, rig.stages.remove(stage).map(|s| s.device)),
            }
        }
        *self.session.bare.lock().unwrap_or_else(PoisonError::into_inner) = Some(rig);
    }
}

/// Adds an object to a rig as the instrument called `name`.
fn lend(
    rig: &mut Rig,
    session: &RigSession,
    name: &str,
    object: &Bound<'_, PyAny>,
    thrown: &Thrown,
) -> PyResult<()> {
    match name {
        "projector" => rig.projector = Some(RigProjector::lend(name, object, thrown)?),
        "camera" => rig.camera = Some(RigCamera::lend(name, object, thrown)?),
        "galvo" => rig.galvo = Some(RigGalvo::lend(name, object, thrown)?),
        "laser" => rig.laser = Some(RigLaser::lend(name, object, thrown)?),
        "counter" => rig.counter = Some(RigCounter::lend(name, object, thrown)?),
        stage => {
            let device = RigStage::lend(name, object, thrown)?;
            let approach_deg = session.prepared.approach_deg(stage);
            rig.stages.insert(stage.to_owned(), Stage { device, approach_deg });
        }
    }
    Ok(())
}

/// Return the cost of a run: number of frames, duration in seconds, duration of stage moves in seconds, and
/// number of bytes.
#[pyfunction]
pub fn rig_cost(session: &RigSession, instruments: &Bound<'_, PyDict>) -> PyResult<(u64, f64, f64, u64)> {
    let thrown = Thrown::default();
    let lent = Lent::new(session, instruments, &thrown)?;
    let Some(rig) = &lent.rig else {
        return Err(input("the session is already running; wait until the session ends"));
    };
    let steps = session.prepared.steps(rig).map_err(prepare)?;
    let cost = steps.cost(rig);
    Ok((cost.frames, cost.duration.as_secs_f64(), cost.moving.as_secs_f64(), cost.bytes))
}

/// Capture all missing frames. Return the number of captured frames, the number of failed attempts, and the
/// duration in seconds by the rig's clock. The session runs on another thread, while the calling thread
/// checks signals.
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
        (true, true) => {
            return Err(input("resume and force cannot be combined; pass only one of these arguments"));
        }
        (true, false) => Existing::Resume,
        (false, true) => Existing::Replace,
        (false, false) => Existing::Refuse,
    };
    let thrown = Thrown::default();
    let mut lent = Lent::new(session, instruments, &thrown)?;
    let Some(rig) = &mut lent.rig else {
        return Err(input("the session is already running; wait until the session ends"));
    };
    let (prepared, sample) = (&session.prepared, session.sample.as_deref());
    watched(py, progress, |seen| {
        seen.calls_python()?;
        let steps = prepared.steps(rig).map_err(prepare)?;
        let (store, recovered) = prepared.begin(&output, &steps, existing, sample).map_err(prepare)?;
        let message = &mut |p: &run::Progress<'_>| seen.tell(p.done, p.frames);
        let outcome = run::run(rig, &steps, store, recovered, seen.stop(), message).map_err(|e| match e {
            RunError::Instrument(failure) => {
                let saved = format!("all earlier frames are saved in {}", output.display());
                let rest = format!("{saved}; resume with resume=True");
                Python::attach(|py| thrown.raise(py, &failure, &rest))
            }
            e => failed(e),
        })?;
        run_store::finish(&output, &steps).map_err(failed)?;
        Ok((outcome.taken, outcome.retries, outcome.elapsed.as_secs_f64()))
    })?
}

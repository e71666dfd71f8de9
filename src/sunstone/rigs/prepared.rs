//! Prepares a plan and its rig for instruments and for the store of a run. `sunstone rig` and the Python
//! package use this module.

use super::{BenchError, tensor_of};
use base::locate::InputError;
use base::whole_file::is_same;
use rig::session::assemble;
use rig::session::lab::Rig;
use rig::session::plan::{self, Plan, Work};
use rig::session::rig_file::{self, RigPlan, Scene, sample_of};
use rig::session::run_store::{self, RunStoreError};
use rig::session::steps::Steps;
use rig::session::writer::{self, Recovered};
use rig::simulated::light::Scenery;
use std::path::{Path, PathBuf};
use store::zarr::frames::FrameStore;
use transport::render::schedule::Watch;

/// The reason why a plan or the store of a run cannot be prepared.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// A file is invalid.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The request is invalid.
    #[error("{0}")]
    Wrong(String),
    /// An instrument, the disk or a render failed.
    #[error("{0}")]
    Failed(String),
    /// The render for a bench was interrupted.
    #[error("{0}")]
    Interrupted(String),
}

fn wrong(e: impl std::fmt::Display) -> PrepareError {
    PrepareError::Wrong(e.to_string())
}

fn failed(e: impl std::fmt::Display) -> PrepareError {
    PrepareError::Failed(e.to_string())
}

/// The action if the store of a run exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// Refuse the existing store with an error.
    Refuse,
    /// Resume the run in the existing store.
    Resume,
    /// Replace the existing store.
    Replace,
}

/// A measurement plan with its rig.
pub struct Prepared {
    pub plan: Plan,
    pub rig: RigPlan,
    /// Input files, which must not be overwritten.
    pub inputs: Vec<PathBuf>,
}

impl Prepared {
    /// Reads a plan and its rig file. The rig file is `rig`, or the file that the plan names.
    ///
    /// # Errors
    /// Returns [`PrepareError`] if a file is invalid or no rig is named.
    pub fn load(path: &Path, rig: Option<&PathBuf>) -> Result<Self, PrepareError> {
        let plan = plan::load(path)?;
        let named = rig.or(plan.rig.as_ref()).cloned().ok_or_else(|| {
            wrong(format!("{}: the plan has no rig; add rig = \"rig.toml\", or pass --rig", path.display()))
        })?;
        let rig = rig_file::load(&named)?;
        Ok(Self { plan, rig, inputs: vec![path.to_owned(), named] })
    }

    /// Places a known sample (air, mirror or polarizer) on a simulated bench, and changes the noise seed.
    ///
    /// # Errors
    /// Returns [`PrepareError::Wrong`] if no sample has this name.
    pub fn put_sample(&mut self, sample: &str) -> Result<(), PrepareError> {
        let mueller = sample_of(sample)
            .ok_or_else(|| wrong(format!("unknown sample `{sample}`; use air, mirror or polarizer")))?;
        if let Some(bench) = &mut self.rig.bench {
            bench.scene = Scene::Sample(mueller);
            // Each sample has its own noise.
            let letters = std::array::from_fn(|i| sample.as_bytes().get(i).copied().unwrap_or(0));
            bench.seed = bench.seed.wrapping_add(u64::from_le_bytes(letters));
        }
        Ok(())
    }

    /// Returns the overshoot, in degrees, with which a stage approaches its targets.
    pub fn approach_deg(&self, stage: &str) -> f64 {
        let file = self.rig.stages.get(stage);
        file.map_or(rig_file::APPROACH_DEG, |s| s.approach_deg)
    }

    /// Returns the instruments of the rig file, except the instruments in `given`, which the caller provides.
    /// For a bench with a scene, the scene is first rendered into `folder`. If `dry` is true, the scene is
    /// not rendered and the sample is black.
    ///
    /// # Errors
    /// Returns [`PrepareError`] if an instrument or the render of a bench fails.
    pub fn assemble(
        &self,
        given: &[String],
        dry: bool,
        folder: &Path,
        watch: &dyn Watch,
    ) -> Result<Rig, PrepareError> {
        let rest = without(&self.rig, given);
        let Some(bench) = &self.rig.bench else {
            if let Some(name) = assemble::simulated(&rest) {
                return Err(wrong(format!(
                    "{}: `{name}` is simulated, but there is no [bench]; add [bench] with the tensor, scene or sample to simulate",
                    self.inputs[1].display()
                )));
            }
            return assemble::assemble(&rest, None).map_err(failed);
        };
        let size = match &self.plan.work {
            Work::Camera(_) => self.rig.camera.as_ref().map_or([1, 1], |(_, c)| c.size),
            Work::Scan(work) => work.points,
        };
        let size = size.map(|n| n as usize);
        let scenery = if dry {
            // Nothing is captured, so the sample is irrelevant.
            Scenery::sample([0.0; 16], size)
        } else {
            let tensor = tensor_of(&self.rig, &self.plan, bench, folder, watch);
            let tensor = tensor.map_err(|e| match e {
                BenchError::Scene(e) => PrepareError::from(e),
                BenchError::Interrupted => PrepareError::Interrupted(e.to_string()),
                BenchError::Render(e) => failed(e),
            })?;
            assemble::scenery(bench, size, tensor.as_deref()).map_err(wrong)?
        };
        let world = assemble::bench(&self.rig, bench, &self.plan, scenery).map_err(wrong)?;
        assemble::assemble(&rest, Some(&world)).map_err(failed)
    }

    /// Returns the steps of the plan for a rig.
    ///
    /// # Errors
    /// Returns [`PrepareError::Wrong`] if the rig cannot execute the plan.
    pub fn steps(&self, rig: &Rig) -> Result<Steps, PrepareError> {
        let made = match &self.rig.geometry {
            Some(geometry) => geometry.with(|g| Steps::new(self.plan.clone(), rig, Some(g))),
            None => Steps::new(self.plan.clone(), rig, None),
        };
        made.map_err(wrong)
    }

    /// Creates or resumes the store of a run. Returns the store and its intact frames.
    ///
    /// # Errors
    /// Returns [`PrepareError`] if the store exists, belongs to another run, is finished, is an input, or
    /// cannot be written.
    pub fn begin(
        &self,
        output: &Path,
        steps: &Steps,
        existing: Existing,
        sample: Option<&str>,
    ) -> Result<(FrameStore, Recovered), PrepareError> {
        self.spare_inputs(output)?;
        if output.exists() && existing == Existing::Refuse {
            return Err(wrong(format!(
                "{} already exists: resume the run, replace the store (force), or choose another name",
                output.display()
            )));
        }
        let store = match existing {
            Existing::Resume => run_store::resume(output, steps, &self.rig, sample),
            _ => run_store::create(output, steps, &self.rig, sample, existing == Existing::Replace),
        };
        let store = store.map_err(|e| match &e {
            RunStoreError::Create(cause) if cause.is_of_system() => failed(e),
            _ => wrong(e),
        })?;
        let recovered = writer::recover(&store).map_err(|e| failed(format!("{}: {e}", output.display())))?;
        Ok((store, recovered))
    }

    /// Refuses an output path that is an input file.
    fn spare_inputs(&self, output: &Path) -> Result<(), PrepareError> {
        let tensor = self.rig.bench.as_ref().and_then(|b| match &b.scene {
            Scene::Tensor(path) => Some(path),
            _ => None,
        });
        let real = |p: &Path| p.canonicalize().unwrap_or_else(|_| p.to_owned());
        for input in self.inputs.iter().chain(tensor) {
            let above = output.exists() && real(input).starts_with(real(output));
            if is_same(input, output) || above {
                return Err(wrong(format!(
                    "{}: this output is or contains an input ({}); choose another output",
                    output.display(),
                    input.display()
                )));
            }
        }
        Ok(())
    }
}

/// Returns a rig file without the instruments in `given`.
fn without(rig: &RigPlan, given: &[String]) -> RigPlan {
    let mut rest = rig.clone();
    for name in given {
        match name.as_str() {
            "projector" => rest.projector = None,
            "camera" => rest.camera = None,
            "galvo" => rest.galvo = None,
            "laser" => rest.laser = None,
            "counter" => rest.counter = None,
            stage => {
                rest.stages.remove(stage);
            }
        }
    }
    rest
}

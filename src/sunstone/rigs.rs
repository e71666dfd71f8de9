//! Supports rigs whose simulated bench uses a scene. The scene is rendered to the tensor that the
//! simulated sensors capture.
//!
//! This module is part of the public API crate because the crate `rig` does not use the renderer.

pub mod prepared;

use base::locate::InputError;
use rig::session::plan::{Plan, Work};
use rig::session::rig_file::{BenchPlan, RigPlan, Scene};
use scene::SceneBuilder;
use scene::syntax::Syntax;
use scene::syntax::scene::SceneFile;
use scene::syntax::slice::{ProjectorSelectFile, SliceFile};
use std::path::{Path, PathBuf};
use store::sink::{SinkError, Target, is_finished};
use transport::render::schedule::{RenderError, Watch};

/// The reason why a bench has no tensor.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    #[error(transparent)]
    Scene(#[from] InputError),
    #[error(transparent)]
    Render(#[from] RenderError<SinkError>),
    /// The user interrupted the render of the scene.
    #[error("interrupted while rendering the bench's tensor; run the command again to resume")]
    Interrupted,
}

/// Returns the scene of a bench, with the device resolutions of the rig and only the slice that the bench
/// needs.
fn scene_of(rig: &RigPlan, plan: &Plan, slice: &str, path: &Path) -> Result<SceneFile, InputError> {
    let text = scene::read(path)?;
    let mut file = SceneFile::read(path, &text)?;
    let slice = SliceFile::new(slice).mueller();
    let slice = match &plan.work {
        Work::Camera(_) => {
            if let Some((_, camera)) = &rig.camera {
                file.camera = located(&file.camera, |c| c.resolution = camera.size.into());
            }
            if let (Some((_, show)), Some(projector)) = (&rig.projector, &file.projector) {
                file.projector = Some(located(projector, |p| p.resolution = Some(show.size.into())));
            }
            slice.projector(ProjectorSelectFile::All)
        }
        Work::Scan(work) => {
            file.camera = located(&file.camera, |c| c.resolution = work.points.into());
            slice.projector(ProjectorSelectFile::Coaxial).time(work.offset_ps, work.bin_ps, work.bins)
        }
    };
    file.slices = vec![slice.into()];
    file.figures.clear();
    Ok(file)
}

fn located<T: Clone>(
    old: &base::locate::Located<T>,
    change: impl FnOnce(&mut T),
) -> base::locate::Located<T> {
    let mut new = (**old).clone();
    change(&mut new);
    new.into()
}

/// Returns the store of a bench's tensor. Renders the scene into `folder` unless the store exists in this
/// folder. The store's name contains all values on which the tensor depends. Returns `None` if the bench uses
/// a sample.
///
/// # Errors
/// Returns [`BenchError`] if the scene is invalid or the render stopped.
pub fn tensor_of(
    rig: &RigPlan,
    plan: &Plan,
    bench: &BenchPlan,
    folder: &Path,
    watch: &dyn Watch,
) -> Result<Option<PathBuf>, BenchError> {
    let (path, spp) = match &bench.scene {
        Scene::Sample(_) => return Ok(None),
        Scene::Tensor(path) => return Ok(Some(path.clone())),
        Scene::Scene(path, spp) => (path, spp),
    };
    let mut file = scene_of(rig, plan, &bench.slice, path)?;
    if let Some(spp) = spp {
        file.render.spp = (*spp).into();
    }
    let built = SceneBuilder::from(file).folder(path.parent().unwrap_or(Path::new(""))).build()?;
    let hash = &built.sha256[..12.min(built.sha256.len())];
    let target = folder.join(format!("{}-{hash}-{}.zarr", built.name, built.settings.spp));
    if is_finished(&target) {
        return Ok(Some(target));
    }
    let resume = target.exists();
    let render = crate::render::Render::new(&built).watch(watch);
    let summary = render.to_target(&Target { path: target.clone(), resume, ..Target::default() })?;
    if summary.complete { Ok(Some(target)) } else { Err(BenchError::Interrupted) }
}

//! Rigs whose bench plays a scene: the scene is rendered to the tensor that the simulated sensors play.
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

/// Why a bench has no tensor.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The scene is wrong.
    #[error(transparent)]
    Scene(#[from] InputError),
    /// The render failed.
    #[error(transparent)]
    Render(#[from] RenderError<SinkError>),
    /// Ctrl-C.
    #[error("interrupted while rendering the bench's tensor; run the command again to resume")]
    Interrupted,
}

/// The scene that a bench plays, with the devices' pixels that the rig has and the one slice that is played; `None` where the
/// bench plays something else.
///
/// # Errors
/// [`InputError`] of the scene.
pub fn scene_of(rig: &RigPlan, plan: &Plan, bench: &BenchPlan) -> Result<Option<SceneFile>, InputError> {
    let Scene::Scene(path, spp) = &bench.scene else {
        return Ok(None);
    };
    let text = scene::read(path)?;
    let mut file = SceneFile::read(path, &text)?;
    let slice = SliceFile::new(&bench.slice).mueller();
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
            slice
                .projector(ProjectorSelectFile::Coaxial)
                .time(work.offset_ps, work.bin_ps, work.bins)
        }
    };
    file.slices = vec![slice.into()];
    file.figures.clear();
    if let Some(spp) = spp {
        file.render.spp = (*spp).into();
    }
    Ok(Some(file))
}

fn located<T: Clone>(
    old: &base::locate::Located<T>,
    change: impl FnOnce(&mut T),
) -> base::locate::Located<T> {
    let mut new = (**old).clone();
    change(&mut new);
    new.into()
}

/// The store of the tensor that a bench plays: rendered into `folder` unless it is there, under a name of all that it depends
/// on. `None` where the bench plays a sample.
///
/// # Errors
/// [`BenchError`].
pub fn tensor_of(
    rig: &RigPlan,
    plan: &Plan,
    bench: &BenchPlan,
    folder: &Path,
    watch: &dyn Watch,
) -> Result<Option<PathBuf>, BenchError> {
    let path = match &bench.scene {
        Scene::Sample(_) => return Ok(None),
        Scene::Tensor(path) => return Ok(Some(path.clone())),
        Scene::Scene(path, _) => path,
    };
    let Some(file) = scene_of(rig, plan, bench)? else {
        return Ok(None);
    };
    let built = SceneBuilder::from(file)
        .folder(path.parent().unwrap_or(Path::new("")))
        .build()?;
    let hash = &built.sha256[..12.min(built.sha256.len())];
    let target = folder.join(format!("{}-{hash}-{}.zarr", built.name, built.settings.spp));
    if is_finished(&target) {
        return Ok(Some(target));
    }
    let resume = target.exists();
    let render = crate::render::Render::new(&built).watch(watch);
    let summary = render.to_target(&Target {
        path: target.clone(),
        resume,
        ..Target::default()
    })?;
    if summary.complete {
        Ok(Some(target))
    } else {
        Err(BenchError::Interrupted)
    }
}

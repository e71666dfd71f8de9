//! Renders of scenes and their variants at any size, kept in a folder: what is finished is not rendered again, what was cut off goes
//! on where it was.
//!
//! A render is named by scene, variant, seed, size, samples, the hash of its scene, which changes with all that it shows, and the first
//! digits of the seed that its random numbers come from, which is another one for every variant.

use apply::application::Size;
use base::locate::{InputError, Located};
use optics::sampling::mix::mix;
use scene::syntax::Syntax;
use scene::syntax::scene::SceneFile;
use scene::syntax::slice::CameraSelectFile;
use scene::syntax::variant::{self, Variant};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use store::sink::{SinkError, Target};
use store::zarr::{CreateError, OpenError, TensorStore};
use transport::render::schedule::{RenderError, Watch};
use transport::scene::Scene;

use crate::render::Render;

/// Seed of renders that are the truth: none of the seeds that methods see.
pub const TRUTH_SEED: u64 = 1 << 32;

/// Groups of samples that standard errors are estimated from, at least.
const REPLICATES: u32 = 8;

/// After how long it is told that another process works at a render: it may but look whether that is finished.
const PATIENCE: Duration = Duration::from_secs(2);

/// 2⁶⁴ over the golden ratio, the step of SplitMix64.
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// Between two looks.
const PAUSE: Duration = Duration::from_millis(50);

/// Why there is no render.
#[derive(Debug, thiserror::Error)]
pub enum StudioError {
    /// The scene file, or a variant of it, is wrong.
    #[error(transparent)]
    Scene(#[from] InputError),
    /// The scene file lacks what is asked for.
    #[error("{file}: {what}; {fix}")]
    Lacks {
        /// The scene file.
        file: PathBuf,
        /// What is wrong.
        what: String,
        /// How to fix it.
        fix: String,
    },
    /// A render stopped.
    #[error(transparent)]
    Render(#[from] RenderError<SinkError>),
    /// The user stopped it; what is finished stays.
    #[error("stopped; run the same command again to resume")]
    Interrupted,
    /// A render cannot be read back.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// What is kept under a render's name is not that render.
    #[error("{cause}; or delete {path} and run the same command again to render it")]
    Kept {
        /// Where the render is to be.
        path: PathBuf,
        /// What is wrong with it.
        cause: Box<dyn std::error::Error + Send + Sync>,
    },
}

/// Renders of one scene file.
pub struct Studio<'a> {
    path: PathBuf,
    text: String,
    renders: &'a Path,
    watch: &'a dyn Watch,
    rendered: usize,
}

impl<'a> Studio<'a> {
    /// Of a scene file, into a folder of renders.
    ///
    /// # Errors
    /// [`StudioError::Scene`] if it cannot be read.
    pub fn open(path: &Path, renders: &'a Path, watch: &'a dyn Watch) -> Result<Self, StudioError> {
        Ok(Self {
            text: scene::read(path)?,
            path: path.to_owned(),
            renders,
            watch,
            rendered: 0,
        })
    }

    /// Renders that were made now, not taken from the folder.
    #[must_use]
    pub fn rendered(&self) -> usize {
        self.rendered
    }

    /// A variant's file with its values; without a number the scene file itself.
    ///
    /// # Errors
    /// [`StudioError::Scene`].
    pub fn variant(&self, number: Option<u64>) -> Result<Variant, StudioError> {
        Ok(match number {
            Some(number) => variant::read(&self.path, &self.text, number)?,
            None => Variant {
                file: SceneFile::read(&self.path, &self.text)?,
                values: BTreeMap::new(),
            },
        })
    }

    /// The scene of a variant, its camera so large, with these slices alone.
    ///
    /// # Errors
    /// [`StudioError::Scene`], [`StudioError::Lacks`].
    pub fn scene(&self, variant: &Variant, pixels: u32, slices: &[&str]) -> Result<Scene, StudioError> {
        let file = self.sized(&variant.file, pixels, slices)?;
        Ok(scene::from_file(&self.path, &self.text, &file)?)
    }

    /// A finished store of a variant ([`Self::variant`] of the same number).
    ///
    /// # Errors
    /// [`StudioError`].
    pub fn render(
        &mut self,
        number: Option<u64>,
        variant: &Variant,
        seed: u64,
        size: Size,
        slices: &[&str],
    ) -> Result<TensorStore, StudioError> {
        let sized = Variant {
            file: self.sized(&variant.file, size.pixels, slices)?,
            values: variant.values.clone(),
        };
        let mut scene = match number {
            Some(number) => scene::from_variant(&self.path, &self.text, &sized, number)?,
            None => scene::from_file(&self.path, &self.text, &sized.file)?,
        };
        scene.settings.seed = drawn_from(number, seed);
        scene.settings.spp = size.spp.max(1);
        scene.settings.replicates = scene.settings.replicates.min(REPLICATES);
        let path = self.renders.join(file_name(&scene, number, seed));
        let begun = Instant::now();
        let mut told = false;
        let summary = loop {
            let target = Target {
                resume: path.exists(),
                path: path.clone(),
                replace: false,
            };
            match Render::new(&scene).watch(self.watch).to_target(&target) {
                // Whoever holds it renders the same, and lets go of it when it ends, however that comes.
                Err(e) if is_locked(&e) => {
                    if !told && begun.elapsed() > PATIENCE {
                        tracing::warn!("waiting for another process that is rendering {}", path.display());
                        told = true;
                    }
                    std::thread::sleep(PAUSE);
                }
                made => break made.map_err(|e| kept(&path, e))?,
            }
            if self.watch.interrupted() {
                return Err(StudioError::Interrupted);
            }
        };
        if !summary.complete {
            return Err(StudioError::Interrupted);
        }
        self.rendered += usize::from(summary.samples > 0);
        Ok(TensorStore::open(&path)?)
    }

    /// A file with these slices alone, its camera's longer side so many pixels; rows, columns and blocks of slices stay where they
    /// are in the picture.
    fn sized(&self, file: &SceneFile, pixels: u32, slices: &[&str]) -> Result<SceneFile, StudioError> {
        let mut file = file.clone();
        let known: Vec<&str> = file.slices.iter().map(|f| f.name.as_str()).collect();
        if let Some(missing) = slices.iter().find(|s| !known.contains(s)) {
            let fix = format!("available: {}", known.join(", "));
            return Err(self.lacks(format!("unknown slice `{missing}`"), fix));
        }
        file.slices.retain(|s| slices.contains(&s.name.as_str()));
        file.figures.clear();
        let mut camera = (*file.camera).clone();
        let old = *camera.resolution;
        let [w, h] = old;
        let widths = [&camera.fov_x_deg, &camera.fov_y_deg, &camera.orthographic_width];
        if widths.iter().all(|v| v.is_none()) || w == 0 || h == 0 {
            return Err(self.lacks(
                "the camera has no field of view, so it cannot be rendered at another size".into(),
                "set fov_x_deg or fov_y_deg".into(),
            ));
        }
        let scaled = |n: u32| (u64::from(n) * u64::from(pixels) / u64::from(w.max(h))).max(1) as u32;
        let new = [scaled(w), scaled(h)];
        camera.resolution = new.into();
        file.camera = Located::at(file.camera.span(), camera);
        if new != old {
            for located in &mut file.slices {
                let mut slice = (**located).clone();
                let camera = resized(&slice.camera, old, new);
                slice.camera = Located::at(slice.camera.span(), camera);
                *located = Located::at(located.span(), slice);
            }
        }
        Ok(file)
    }

    /// The error of a scene that lacks something.
    #[must_use]
    pub fn lacks(&self, what: String, fix: String) -> StudioError {
        StudioError::Lacks {
            file: self.path.clone(),
            what,
            fix,
        }
    }
}

/// Rows, columns and blocks of a camera of another size: the pixels whose middle lies there. Bins keep their size.
fn resized(of: &CameraSelectFile, old: [u32; 2], new: [u32; 2]) -> CameraSelectFile {
    let at = |i: u32, axis: usize| {
        let [old, new] = [old[axis], new[axis]].map(u64::from);
        let middle = (2 * u64::from(i) + 1) * new / (2 * old.max(1));
        // What lies outside is told where it is read.
        if u64::from(i) < old { middle as u32 } else { i }
    };
    let all = |list: &[u32], axis| {
        let mut list: Vec<u32> = list.iter().map(|i| at(*i, axis)).collect();
        list.dedup();
        list
    };
    match of {
        CameraSelectFile::Rows(rows) => CameraSelectFile::Rows(all(rows, 1)),
        CameraSelectFile::Columns(columns) => CameraSelectFile::Columns(all(columns, 0)),
        CameraSelectFile::Block([x, y, w, h]) => {
            let length = |n: u32, axis: usize| {
                let [old, new] = [old[axis], new[axis]].map(u64::from);
                (u64::from(n) * new / old.max(1)).max(1) as u32
            };
            CameraSelectFile::Block([at(*x, 0), at(*y, 1), length(*w, 0), length(*h, 1)])
        }
        other => other.clone(),
    }
}

fn is_locked(e: &RenderError<SinkError>) -> bool {
    matches!(
        e,
        RenderError::Sink(
            SinkError::Create(CreateError::Locked { .. }) | SinkError::Open(OpenError::Locked { .. })
        )
    )
}

/// Something else under a render's name is told with its fix: nothing that is kept is deleted by itself.
fn kept(path: &Path, e: RenderError<SinkError>) -> StudioError {
    match e {
        RenderError::Sink(
            SinkError::Create(
                CreateError::Exists { .. } | CreateError::NotAStore { .. } | CreateError::Within { .. },
            )
            | SinkError::Open(
                OpenError::NotAStore { .. } | OpenError::Missing { .. } | OpenError::Damaged { .. },
            )
            | SinkError::Mismatch { .. }
            | SinkError::Denoised(_),
        ) => StudioError::Kept {
            path: path.to_owned(),
            cause: Box::new(e),
        },
        e => e.into(),
    }
}

/// What a variant's render of a seed draws its random numbers from: with one seed for all variants pixels where nothing moved would have
/// the same noise, and methods would be judged on the noise that they learnt from. The scene file itself keeps its seed.
fn drawn_from(number: Option<u64>, seed: u64) -> u64 {
    // Odd and so one to one in the number: variants of one seed never share random numbers.
    number.map_or(seed, |n| mix(mix(seed.wrapping_add(STEP)) ^ n.wrapping_mul(STEP)))
}

fn file_name(scene: &Scene, number: Option<u64>, seed: u64) -> String {
    let [w, h] = scene.camera.resolution;
    let hash: String = scene.sha256.chars().take(16).collect();
    let seed = if seed == TRUTH_SEED {
        "truth".to_owned()
    } else {
        format!("seed{seed}")
    };
    let variant = number.map_or(String::new(), |n| format!("_variant{n}"));
    let drawn = scene.settings.seed >> 32;
    format!(
        "{}{variant}_{seed}_{w}x{h}_{}spp_{hash}_{drawn:08x}.zarr",
        scene.name, scene.settings.spp
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_stay_where_they_are() {
        let rows = |r: &[u32], old, new| match resized(&CameraSelectFile::Rows(r.into()), old, new) {
            CameraSelectFile::Rows(r) => r,
            _ => vec![],
        };
        // Row 150 of 256 lies at 150.5 / 256 of the height: in row 37 of 64 and row 301 of 512.
        assert_eq!(rows(&[150], [256, 256], [64, 64]), [37]);
        assert_eq!(rows(&[150], [256, 256], [512, 512]), [301]);
        assert_eq!(rows(&[0, 1, 255], [256, 256], [64, 64]), [0, 63]);
        // What the scene has wrong stays wrong.
        assert_eq!(rows(&[999], [256, 256], [64, 64]), [999]);
    }
}

//! Renders scenes and their variants at any size into a folder. A finished render is not repeated, and an
//! unfinished render is resumed.
//!
//! The name of a render contains scene name, variant, seed, size, samples, scene hash, and the first digits
//! of the seed of the random numbers. The seed of the random numbers differs between variants.

use apply::application::Size;
use base::locate::{InputError, Located};
use optics::sampling::mix::mix;
use scene::syntax::Syntax;
use scene::syntax::scene::SceneFile;
use scene::syntax::slice::CameraSelectFile;
use scene::syntax::variant::{self, Variant};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use store::denoised::is_denoised;
use store::sink::{SinkError, Target};
use store::zarr::{CreateError, OpenError, TensorStore};
use transport::render::schedule::{RenderError, Watch};
use transport::scene::Scene;

use crate::cost::{Clock, Cost};
use crate::denoise::{DenoiseError, denoise};
use crate::render::Render;

/// Seed of ground-truth renders. This seed differs from all seeds of the renders that methods receive.
pub const TRUTH_SEED: u64 = 1 << 32;

/// Minimum number of sample groups for the estimation of standard errors.
const REPLICATES: u32 = 8;

/// Time after which the wait for another process is reported. Shorter waits also occur if another
/// process only checks whether a render is finished.
const PATIENCE: Duration = Duration::from_secs(2);

/// The increment of SplitMix64, which is the odd number closest to 2⁶⁴ divided by the golden ratio.
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// Interval between attempts to lock a store.
const PAUSE: Duration = Duration::from_millis(50);

/// The reason why a scene was not rendered.
#[derive(Debug, thiserror::Error)]
pub enum StudioError {
    /// The scene file, or a variant of it, is invalid.
    #[error(transparent)]
    Scene(#[from] InputError),
    /// The scene file lacks a requested slice or another item.
    #[error("{file}: {what}; {fix}")]
    Lacks { file: PathBuf, what: String, fix: String },
    #[error(transparent)]
    Render(#[from] RenderError<SinkError>),
    /// The user stopped the render. Finished tiles are kept.
    #[error("stopped; run the same command again to resume")]
    Interrupted,
    /// A render cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Renders cannot be denoised.
    #[error(transparent)]
    Denoise(Box<DenoiseError>),
    /// The store at the render's path belongs to another render.
    #[error("{cause}; or delete {path} and run the same command again to repeat the render")]
    Kept {
        /// Path of the store.
        path: PathBuf,
        cause: Box<dyn std::error::Error + Send + Sync>,
    },
}

pub struct Studio<'a> {
    path: PathBuf,
    text: String,
    renders: &'a Path,
    watch: &'a dyn Watch,
    rendered: usize,
    costs: Vec<(String, Cost)>,
}

impl<'a> Studio<'a> {
    /// Opens a scene file with a folder for renders.
    ///
    /// # Errors
    /// Returns [`StudioError::Scene`] if the scene file cannot be read.
    pub fn open(path: &Path, renders: &'a Path, watch: &'a dyn Watch) -> Result<Self, StudioError> {
        Ok(Self {
            text: scene::read(path)?,
            path: path.to_owned(),
            renders,
            watch,
            rendered: 0,
            costs: vec![],
        })
    }

    /// Returns the number of new renders, excluding reused finished renders.
    pub fn rendered(&self) -> usize {
        self.rendered
    }

    /// Returns the file name and the cost of every new render and of every newly denoised store. The cost of a
    /// resumed render excludes earlier runs.
    pub fn costs(&self) -> &[(String, Cost)] {
        &self.costs
    }

    /// Returns the scene file and the values of the variant with this number. Without a number, returns the
    /// scene file itself.
    ///
    /// # Errors
    /// Returns [`StudioError::Scene`] if the variant is invalid or does not exist.
    pub fn variant(&self, number: Option<u64>) -> Result<Variant, StudioError> {
        Ok(match number {
            Some(number) => variant::read(&self.path, &self.text, number)?,
            None => Variant { file: SceneFile::read(&self.path, &self.text)?, values: BTreeMap::new() },
        })
    }

    /// Builds the scene of a variant with only the given slices. The longer side of the camera
    /// image has `pixels` pixels.
    ///
    /// # Errors
    /// Returns [`StudioError::Scene`] if the scene is invalid. Returns [`StudioError::Lacks`] if a slice is
    /// missing.
    pub fn scene(&self, variant: &Variant, pixels: u32, slices: &[&str]) -> Result<Scene, StudioError> {
        let file = self.sized(&variant.file, pixels, slices)?;
        Ok(scene::from_file(&self.path, &self.text, &file)?)
    }

    /// Returns the finished store of a variant, and renders the variant first if necessary. `variant` must be
    /// the result of [`Self::variant`] for `number`.
    ///
    /// # Errors
    /// Returns [`StudioError`] if the scene is invalid or the render stopped.
    pub fn render(
        &mut self,
        number: Option<u64>,
        variant: &Variant,
        seed: u64,
        size: Size,
        slices: &[&str],
    ) -> Result<TensorStore, StudioError> {
        let sized =
            Variant { file: self.sized(&variant.file, size.pixels, slices)?, values: variant.values.clone() };
        let mut scene = match number {
            Some(number) => scene::from_variant(&self.path, &self.text, &sized, number)?,
            None => scene::from_file(&self.path, &self.text, &sized.file)?,
        };
        scene.change_settings(|s| {
            (s.seed, s.spp) = (drawn_from(number, seed), size.spp.max(1));
            s.replicates = s.replicates.min(REPLICATES);
        });
        let path = self.renders.join(file_name(&scene, number, seed));
        let (begun, clock) = (Instant::now(), Clock::start());
        let mut message = false;
        let summary = loop {
            let target = Target { resume: path.exists(), path: path.clone(), replace: false };
            match Render::new(&scene).watch(self.watch).to_target(&target) {
                // The holder of the lock renders the same data, and releases the lock whenever its process
                // ends.
                Err(e) if is_locked(&e) => {
                    if !message && begun.elapsed() > PATIENCE {
                        tracing::warn!("waiting for another process that is rendering {}", path.display());
                        message = true;
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
        if summary.samples > 0 {
            self.rendered += 1;
            self.costs.push((name_of(&path), clock.cost()));
        }
        Ok(TensorStore::open(&path)?)
    }

    /// Returns the denoised store of a variant. The store is denoised from two renders with half of the samples
    /// each, with the seeds `seed` and `seed` + 1. The renders and the denoised store are reused. The name of
    /// the denoised store contains a digest of the manifests of both renders.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::render`], and [`StudioError::Denoise`].
    pub fn denoised(
        &mut self,
        number: Option<u64>,
        variant: &Variant,
        seed: u64,
        size: Size,
        slices: &[&str],
    ) -> Result<TensorStore, StudioError> {
        let half = Size { spp: size.spp.div_ceil(2), ..size };
        let first = self.render(number, variant, seed, half, slices)?;
        let second = self.render(number, variant, seed.wrapping_add(1), half, slices)?;
        let both = format!("{}\n{}", first.fingerprint(), second.fingerprint());
        let digest: String = Sha256::digest(both).iter().take(4).map(|b| format!("{b:02x}")).collect();
        let renders = [first.path().to_owned(), second.path().to_owned()];
        let stem = renders[0].file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let path = self.renders.join(format!("{stem}_denoised_{digest}.zarr"));
        let clock = Clock::start();
        while !path.exists() {
            match denoise(&renders, &path, false) {
                Ok(_) => self.costs.push((name_of(&path), clock.cost())),
                // Another process denoises the same renders. The result appears when it is finished.
                Err(DenoiseError::Create(CreateError::Locked { .. } | CreateError::Exists { .. })) => {
                    std::thread::sleep(PAUSE);
                }
                Err(e) => return Err(StudioError::Denoise(Box::new(e))),
            }
            if self.watch.interrupted() {
                return Err(StudioError::Interrupted);
            }
        }
        let store = TensorStore::open(&path)
            .map_err(|e| StudioError::Kept { path: path.clone(), cause: Box::new(e) })?;
        if is_denoised(&store) && store.is_finished() {
            return Ok(store);
        }
        let cause = "the store is not a finished denoised store".into();
        Err(StudioError::Kept { path, cause })
    }

    /// Returns a scene file with only the given slices, in which the longer side of the camera
    /// image has `pixels` pixels. Rows, columns and blocks of slices are rescaled with the image.
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
                "the scene's camera has no field of view, so the scene cannot be rendered at another size"
                    .into(),
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

    /// Returns the error for a scene that lacks an item.
    pub fn lacks(&self, what: String, fix: String) -> StudioError {
        StudioError::Lacks { file: self.path.clone(), what, fix }
    }
}

/// Rescales rows, columns and blocks to another camera size. Each selected pixel is replaced by the pixel of
/// the new image that contains its centre. Bins keep their size.
fn resized(of: &CameraSelectFile, old: [u32; 2], new: [u32; 2]) -> CameraSelectFile {
    let at = |i: u32, axis: usize| {
        let [old, new] = [old[axis], new[axis]].map(u64::from);
        let middle = (2 * u64::from(i) + 1) * new / (2 * old.max(1));
        // An index outside the image is kept, so that the parser reports the index.
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

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn is_locked(e: &RenderError<SinkError>) -> bool {
    matches!(
        e,
        RenderError::Sink(
            SinkError::Create(CreateError::Locked { .. }) | SinkError::Open(OpenError::Locked { .. })
        )
    )
}

/// Converts a render error to [`StudioError::Kept`] if another store exists at the render's path. Existing
/// stores are never deleted automatically.
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
        ) => StudioError::Kept { path: path.to_owned(), cause: Box::new(e) },
        e => e.into(),
    }
}

/// Returns the seed of the random numbers of a variant's render. With one seed for all variants, pixels that
/// do not change between variants would have equal noise. Methods would then be tested on their training
/// noise. The scene file without a variant keeps its seed.
fn drawn_from(number: Option<u64>, seed: u64) -> u64 {
    // The factor is odd, so the map is one-to-one in the number. Variants of one seed therefore never share
    // random numbers.
    number.map_or(seed, |n| mix(mix(seed.wrapping_add(STEP)) ^ n.wrapping_mul(STEP)))
}

fn file_name(scene: &Scene, number: Option<u64>, seed: u64) -> String {
    let [w, h] = scene.camera.resolution;
    let hash: String = scene.sha256.chars().take(16).collect();
    let seed = if seed == TRUTH_SEED { "truth".to_owned() } else { format!("seed{seed}") };
    let variant = number.map_or(String::new(), |n| format!("_variant{n}"));
    let drawn = scene.settings.seed >> 32;
    format!("{}{variant}_{seed}_{w}x{h}_{}spp_{hash}_{drawn:08x}.zarr", scene.name, scene.settings.spp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_keep_their_relative_positions() {
        let rows = |r: &[u32], old, new| match resized(&CameraSelectFile::Rows(r.into()), old, new) {
            CameraSelectFile::Rows(r) => r,
            _ => vec![],
        };
        // Row 150 of 256 is at 150.5 / 256 of the height. This position is in row 37 of 64 and in row 301 of
        // 512.
        assert_eq!(rows(&[150], [256, 256], [64, 64]), [37]);
        assert_eq!(rows(&[150], [256, 256], [512, 512]), [301]);
        assert_eq!(rows(&[0, 1, 255], [256, 256], [64, 64]), [0, 63]);
        // An invalid index stays invalid.
        assert_eq!(rows(&[999], [256, 256], [64, 64]), [999]);
    }
}

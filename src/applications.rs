//! Applications from scene files: variants and seeds are rendered into a folder, where they stay, and given to the methods of
//! [`apply`].
//!
//! A render is named by variant, seed, size, samples and the hash of its scene, which changes with all that it shows. What is
//! finished is not rendered again; what was cut off goes on where it was. Delete the folder to render anew.

pub mod report;
pub mod truth;

use apply::application::{Application, Outcome, Plan, Score, Size, Truth};
use apply::comparison::{Row, compare};
use apply::error::ApplyError;
use apply::map::Map;
use apply::observation::{Observation, Slice};
use apply::pinhole::Rig;
use base::locate::InputError;
use scene::syntax::scene::SceneFile;
use scene::syntax::slice::CameraSelectFile;
use scene::syntax::variant::{self, Variant};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use store::sink::{SinkError, Target};
use store::zarr::{AccessError, OpenError, TensorStore};
use tensor::axes::AxisKind;
use tensor::field::Field;
use transport::render::layers;
use transport::render::schedule::{RenderError, Watch};
use transport::scene::Scene;

use crate::render::Render;

/// Seed of renders that are the truth: none of the seeds that methods see.
const TRUTH_SEED: u64 = 1 << 32;

/// Groups of samples that standard errors are estimated from, at least.
const REPLICATES: u32 = 8;

/// Where to and how to run.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Folder of scenes.
    pub scenes: PathBuf,
    /// Folder of renders.
    pub renders: PathBuf,
    /// At the plan's preview size, else its full size.
    pub preview: bool,
    /// Seeds, from 1 on.
    pub seeds: u64,
}

/// Why an application was not run to its end.
#[derive(Debug, thiserror::Error)]
pub enum ApplicationError {
    /// The scene file, or a variant of it, is wrong.
    #[error(transparent)]
    Scene(#[from] InputError),
    /// The scene file lacks what the plan names.
    #[error("{file}: {what}; {mend}")]
    Plan {
        /// The scene file.
        file: PathBuf,
        /// What is wrong.
        what: String,
        /// How to mend it.
        mend: String,
    },
    /// There is nothing to average over.
    #[error("no seeds: give 1 or more")]
    NoSeeds,
    /// A render stopped.
    #[error(transparent)]
    Render(#[from] RenderError<SinkError>),
    /// The user stopped it; what is finished stays.
    #[error("stopped; run the same command again to go on")]
    Interrupted,
    /// A render cannot be read back.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// A slice of one cannot be read back.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The methods found what they were given wanting.
    #[error(transparent)]
    Apply(#[from] ApplyError),
}

/// What came out.
#[derive(Clone, Debug)]
pub struct Report {
    /// The table: metrics one after the other, methods in their order.
    pub rows: Vec<Row>,
    /// All scores, with their seeds.
    pub scores: Vec<(u64, Score)>,
    /// Pictures and notes of the first seed.
    pub first: Outcome,
    /// Size of the renders.
    pub size: Size,
    /// Seeds.
    pub seeds: u64,
    /// Renders that were made now, not taken from the folder.
    pub rendered: usize,
}

/// Renders what an application needs, and runs it once for each seed.
///
/// # Errors
/// [`ApplicationError`].
pub fn run(
    application: &dyn Application,
    settings: &Settings,
    watch: &dyn Watch,
) -> Result<Report, ApplicationError> {
    if settings.seeds == 0 {
        return Err(ApplicationError::NoSeeds);
    }
    let plan = application.plan();
    let size = if settings.preview { plan.preview } else { plan.full };
    let path = settings.scenes.join(plan.scene);
    let mut studio = Studio {
        text: scene::read(&path)?,
        path,
        plan: &plan,
        size,
        settings,
        watch,
        rendered: 0,
        truths: BTreeMap::new(),
    };
    let (mut runs, mut scores, mut first) = (vec![], vec![], None);
    for seed in 1..=settings.seeds {
        let mut all = |variants: &[u64]| -> Result<Vec<Observation>, ApplicationError> {
            variants.iter().map(|v| studio.observe(*v, seed)).collect()
        };
        let (train, test) = (all(&plan.train)?, all(&plan.test)?);
        let outcome = application.run(&train, &test)?;
        scores.extend(outcome.scores.iter().map(|s| (seed, s.clone())));
        runs.push(outcome.scores.clone());
        first.get_or_insert(outcome);
    }
    Ok(Report {
        rows: compare(application, &runs),
        scores,
        first: first.unwrap_or_default(),
        size,
        seeds: settings.seeds,
        rendered: studio.rendered,
    })
}

/// What no method may see of a variant but to learn from it and to be judged by it.
#[derive(Clone, Default)]
struct Known {
    rig: Option<Rig>,
    maps: BTreeMap<String, Map>,
    slices: BTreeMap<String, Slice>,
}

/// Renders variants of one scene file.
struct Studio<'a> {
    path: PathBuf,
    text: String,
    plan: &'a Plan,
    size: Size,
    settings: &'a Settings,
    watch: &'a dyn Watch,
    rendered: usize,
    /// What is known by variant: it is the same for all seeds.
    truths: BTreeMap<u64, Known>,
}

impl Studio<'_> {
    fn observe(&mut self, number: u64, seed: u64) -> Result<Observation, ApplicationError> {
        let variant = variant::read(&self.path, &self.text, number)?;
        let values = variant.values.iter().filter_map(|(name, v)| {
            let value = v.as_float().or_else(|| v.as_integer().map(|i| i as f64))?;
            Some((name.clone(), value))
        });
        let values = values.collect();
        let slices = self.plan.slices.clone();
        let store = self.render(number, &variant, seed, self.size.spp, &slices)?;
        let known = self.truth(number, &variant)?;
        let mut observation = Observation {
            variant: number,
            seed,
            values,
            rig: known.rig,
            slices: known.slices,
            truth: known.maps,
        };
        for name in slices {
            observation.slices.insert(name.to_owned(), read(&store, name)?);
        }
        Ok(observation)
    }

    fn truth(&mut self, number: u64, variant: &Variant) -> Result<Known, ApplicationError> {
        if let Some(known) = self.truths.get(&number) {
            return Ok(known.clone());
        }
        let file = self.sized(variant, &[])?;
        let mut scene = scene::from_file(&self.path, &self.text, &file)?;
        scene.keep_texture_coordinates();
        let mut known = Known {
            rig: truth::rig(&scene),
            ..Known::default()
        };
        for truth in &self.plan.truth {
            let (name, map) = match *truth {
                Truth::Slice { name, slice, samples } => {
                    let spp = self.size.spp.saturating_mul(samples);
                    let store = self.render(number, variant, TRUTH_SEED, spp, &[slice])?;
                    known.slices.insert(name.to_owned(), read(&store, slice)?);
                    continue;
                }
                Truth::Layer { name, layer, through } => {
                    let options = layers::Options {
                        through,
                        ..layers::Options::default()
                    };
                    let map = truth::layer(&layers::layers(&scene, options), layer);
                    (
                        name,
                        map.ok_or_else(|| self.lacks(format!("there is no layer `{layer}`")))?,
                    )
                }
                Truth::Reference {
                    name,
                    slice,
                    of,
                    samples,
                } => (name, self.reference(of(number), slice, samples)?),
                Truth::Material { name, of } => {
                    if let Some(unknown) = of.iter().find(|m| !file.materials.contains_key(**m)) {
                        return Err(self.lacks(format!("there is no material `{unknown}`")));
                    }
                    (name, truth::material(&scene, of))
                }
                Truth::Object(name) => (name, truth::object(&scene)),
                Truth::Texture(name) => (name, truth::texture(&scene)),
            };
            known.maps.insert(name.to_owned(), map);
        }
        self.truths.insert(number, known.clone());
        Ok(known)
    }

    /// M00 of a slice of a variant, a channel a wavelength.
    fn reference(&mut self, number: u64, slice: &'static str, samples: u32) -> Result<Map, ApplicationError> {
        let variant = variant::read(&self.path, &self.text, number)?;
        let spp = self.size.spp.saturating_mul(samples);
        let store = self.render(number, &variant, TRUTH_SEED, spp, &[slice])?;
        let mean = store.slice(slice)?.read_all(Field::Mean)?;
        let intensity = mean
            .select(AxisKind::StokesOut, 0)
            .select(AxisKind::StokesIn, 0)
            .sum(AxisKind::T);
        let of = |kind| intensity.extent(kind);
        Ok(Map::from_fn(
            of(AxisKind::X),
            of(AxisKind::Y),
            of(AxisKind::Wavelength),
            |x, y, out| {
                for (lane, o) in out.iter_mut().enumerate() {
                    let place = [(AxisKind::X, x), (AxisKind::Y, y), (AxisKind::Wavelength, lane)];
                    *o = f64::from(intensity.at(&place));
                }
            },
        ))
    }

    /// A finished store of a variant.
    fn render(
        &mut self,
        number: u64,
        variant: &Variant,
        seed: u64,
        spp: u32,
        slices: &[&'static str],
    ) -> Result<TensorStore, ApplicationError> {
        let variant = Variant {
            file: self.sized(variant, slices)?,
            values: variant.values.clone(),
        };
        let mut scene = scene::from_variant(&self.path, &self.text, &variant, number)?;
        scene.settings.seed = seed;
        scene.settings.spp = spp.max(1);
        scene.settings.replicates = scene.settings.replicates.min(REPLICATES);
        let path = self.settings.renders.join(self.file_name(&scene, number, seed));
        let target = Target {
            resume: path.exists(),
            path,
            replace: false,
        };
        let summary = Render::new(&scene).watch(self.watch).to_target(&target)?;
        if !summary.complete {
            return Err(ApplicationError::Interrupted);
        }
        self.rendered += usize::from(summary.samples > 0);
        Ok(TensorStore::open(&target.path)?)
    }

    fn file_name(&self, scene: &Scene, number: u64, seed: u64) -> String {
        let [w, h] = scene.camera.resolution;
        let hash: String = scene.sha256.chars().take(16).collect();
        let seed = if seed == TRUTH_SEED {
            "truth".to_owned()
        } else {
            format!("seed{seed}")
        };
        format!(
            "{}_variant{number}_{seed}_{w}x{h}_{}spp_{hash}.zarr",
            scene.name, scene.settings.spp
        )
    }

    /// The variant's file with these slices alone, its camera as large as the plan says.
    fn sized(&self, variant: &Variant, slices: &[&'static str]) -> Result<SceneFile, ApplicationError> {
        let mut file = variant.file.clone();
        if let Some(missing) = slices
            .iter()
            .find(|s| !file.slices.iter().any(|f| f.name.as_str() == **s))
        {
            return Err(self.lacks(format!("there is no slice `{missing}`")));
        }
        file.slices.retain(|s| slices.contains(&s.name.as_str()));
        file.figures.clear();
        let mut camera = (*file.camera).clone();
        let [w, h] = *camera.resolution;
        if camera.fov_x_deg.is_none() && camera.fov_y_deg.is_none() || w == 0 || h == 0 {
            return Err(self.lacks("the camera has no field of view to be rendered at another size".into()));
        }
        let scaled =
            |n: u32| (u64::from(n) * u64::from(self.size.pixels) / u64::from(w.max(h))).max(1) as u32;
        camera.resolution = [scaled(w), scaled(h)].into();
        for slice in &mut file.slices {
            if let Some(camera) = moved(&slice.camera, [w, h], [scaled(w), scaled(h)]) {
                let mut changed = (**slice).clone();
                changed.camera = base::locate::Located::at(slice.camera.span(), camera);
                *slice = base::locate::Located::at(slice.span(), changed);
            }
        }
        file.camera = base::locate::Located::at(file.camera.span(), camera);
        Ok(file)
    }

    fn lacks(&self, what: String) -> ApplicationError {
        ApplicationError::Plan {
            file: self.path.clone(),
            what,
            mend: "give back the scene file that came with the program".into(),
        }
    }
}

/// Rows and columns where they are in the image of a camera of another size; `None` of other choices. A number past the end stays past
/// the end, which the scene's reader refuses.
fn moved(kept: &CameraSelectFile, from: [u32; 2], to: [u32; 2]) -> Option<CameraSelectFile> {
    let all = |list: &[u32], axis: usize| -> Vec<u32> {
        let place = |at: &u32| u64::from(*at) * u64::from(to[axis]) / u64::from(from[axis]);
        list.iter().map(|at| place(at) as u32).collect()
    };
    match kept {
        CameraSelectFile::Rows(rows) => Some(CameraSelectFile::Rows(all(rows, 1))),
        CameraSelectFile::Columns(columns) => Some(CameraSelectFile::Columns(all(columns, 0))),
        _ => None,
    }
}

/// A slice of a finished store.
fn read(store: &TensorStore, name: &str) -> Result<Slice, ApplicationError> {
    let stored = store.slice(name)?;
    Ok(Slice {
        mean: stored.read_all(Field::Mean)?,
        error: stored.read_all(Field::StdError)?,
    })
}

/// Where scenes are, seen from a folder: `scenes` in it, or in one of those that it is in.
#[must_use]
pub fn find_scenes(from: &Path, scene: &str) -> Option<PathBuf> {
    from.ancestors()
        .map(|folder| folder.join("scenes"))
        .find(|s| s.join(scene).is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_columns_stay_where_they_are() {
        let rows = CameraSelectFile::Rows(vec![0, 77, 127, 128]);
        let CameraSelectFile::Rows(at) = moved(&rows, [200, 128], [100, 64]).expect("rows") else {
            panic!("rows stay rows");
        };
        assert_eq!(at, [0, 38, 63, 64]);
        let columns = CameraSelectFile::Columns(vec![50]);
        let CameraSelectFile::Columns(at) = moved(&columns, [200, 128], [400, 256]).expect("columns") else {
            panic!("columns stay columns");
        };
        assert_eq!(at, [100]);
        assert!(moved(&CameraSelectFile::All, [200, 128], [100, 64]).is_none());
    }
}

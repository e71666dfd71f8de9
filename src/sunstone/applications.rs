//! Runs applications on scene files. Renders the variants and seeds of an application into a folder, and
//! passes the renders to the methods of [`apply`].
//!
//! The name of a render contains its variant, seed, image size, samples per pixel and scene hash. A finished
//! render is not repeated, and an unfinished render is resumed. Delete the folder to repeat all renders.

pub mod chain;
pub mod curves;
pub mod links;
pub mod report;
pub mod truth;

use apply::application::{Application, Outcome, Plan, Score, Size, Truth};
use apply::comparison::{Row, compare};
use apply::error::ApplyError;
use apply::map::Map;
use apply::observation::{Observation, Slice};
use apply::pinhole::Rig;
use links::{Links, LinksError, Through};
use scene::syntax::variant::Variant;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use store::zarr::{AccessError, OpenError, TensorStore};
use tensor::field::Field;
use tensor::layers::LayerSet;
use transport::render::layers;
use transport::render::schedule::Watch;

use crate::studio::{Studio, StudioError, TRUTH_SEED};

/// Maximum number of seeds of a run.
pub const MOST_SEEDS: u64 = 1000;

#[derive(Clone, Debug)]
pub struct Settings {
    pub scenes: PathBuf,
    pub renders: PathBuf,
    /// Whether to render at the plan's preview size instead of its full size.
    pub preview: bool,
    /// Number of seeds. The seeds are 1, 2, ….
    pub seeds: u64,
    /// Capture chains. Each chain adds a table to the report, after the table of the rendered slices.
    pub links: Links,
}

/// The reason why an application was not completed.
#[derive(Debug, thiserror::Error)]
pub enum ApplicationError {
    /// The scene file is invalid, or a render of the scene stopped.
    #[error(transparent)]
    Studio(#[from] StudioError),
    /// The number of seeds is out of range.
    #[error("expected 1 to {MOST_SEEDS} seeds, got {0}")]
    Seeds(u64),
    /// A render cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// A slice of a render cannot be read.
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error(transparent)]
    Captured(#[from] LinksError),
    /// The application's methods refuse their input.
    #[error(transparent)]
    Apply(#[from] ApplyError),
}

/// The results of a run of an application.
#[derive(Clone, Debug)]
pub struct Report {
    /// Rows of the table, grouped by metric. Within a metric, methods are in the application's order.
    pub rows: Vec<Row>,
    /// All scores, each with the seed of its render.
    pub scores: Vec<(u64, Score)>,
    pub first: Outcome,
    pub size: Size,
    /// Number of seeds.
    pub seeds: u64,
    /// Results of the methods on captured slices.
    pub through: Vec<Through>,
    /// Number of renders that this run made, excluding reused finished renders.
    pub rendered: usize,
}

/// Renders the data of an application, and runs the application once for each seed.
///
/// # Errors
/// Returns [`ApplicationError`] if a render or a method fails.
pub fn run(
    application: &Application,
    settings: &Settings,
    watch: &dyn Watch,
) -> Result<Report, ApplicationError> {
    Run::new(application, settings, watch)?.report()
}

/// An application with its settings and data.
pub struct Run<'a> {
    application: &'a Application,
    settings: &'a Settings,
    watch: &'a dyn Watch,
    observer: Observer<'a>,
}

impl<'a> Run<'a> {
    /// Prepares a run without rendering.
    ///
    /// # Errors
    /// Returns [`ApplicationError::Seeds`] if the number of seeds is out of range. Returns
    /// [`ApplicationError::Studio`] if the scene file cannot be read.
    pub fn new(
        application: &'a Application,
        settings: &'a Settings,
        watch: &'a dyn Watch,
    ) -> Result<Self, ApplicationError> {
        if !(1..=MOST_SEEDS).contains(&settings.seeds) {
            return Err(ApplicationError::Seeds(settings.seeds));
        }
        let plan = application.plan.clone();
        let size = if settings.preview { plan.preview } else { plan.full };
        let path = settings.scenes.join(plan.scene);
        Ok(Self {
            application,
            settings,
            watch,
            observer: Observer {
                studio: Studio::open(&path, &settings.renders, watch)?,
                plan,
                size,
                truths: BTreeMap::new(),
                stores: BTreeMap::new(),
            },
        })
    }

    /// Renders missing data. Returns a text that identifies the input of all methods, except the capture
    /// configurations. The text changes whenever a scene, a render or the image size changes. The text does
    /// not identify the methods, because the program's version identifies them.
    ///
    /// # Errors
    /// Returns [`ApplicationError`] if a render fails.
    pub fn inputs(&mut self) -> Result<String, ApplicationError> {
        let Self { application, settings, observer, .. } = self;
        let Size { pixels, spp } = observer.size;
        let (name, seeds) = (application.name, settings.seeds);
        let mut out = format!("{name}, {pixels} pixels, {spp} samples, seeds 1 to {seeds}\n");
        let variants = [&observer.plan.train[..], &observer.plan.test].concat();
        for number in variants {
            let variant = observer.studio.variant(Some(number))?;
            out += &format!("variant {number} {:?}\n", variant.values);
            let wanted = (1..=seeds).map(|seed| observer.of_seed(number, seed));
            let wanted: Vec<Wanted> = wanted.chain(observer.of_truth(number)).collect();
            let wanted = wanted.into_iter().filter(|w| !w.slices.is_empty());
            let wanted: Vec<Wanted> = wanted.collect();
            // Without a render of the variant, no store name contains its scene hash.
            if wanted.iter().all(|w| w.variant != number) {
                let scene = observer.studio.scene(&variant, pixels, &[])?;
                out += &format!("scene {}\n", scene.sha256);
            }
            for wanted in wanted {
                if !observer.stores.contains_key(&wanted) {
                    let store = observer.store(&wanted)?;
                    observer.stores.insert(wanted, store);
                }
            }
        }
        for (wanted, store) in &observer.stores {
            let name = store.path().file_name().unwrap_or_default().to_string_lossy();
            out += &format!("{wanted:?} {name} {}\n", store.fingerprint());
        }
        Ok(out)
    }

    /// Renders missing data, and runs the application once for each seed.
    ///
    /// # Errors
    /// Returns [`ApplicationError`] if a render or a method fails.
    pub fn report(self) -> Result<Report, ApplicationError> {
        let Self { application, settings, watch, mut observer } = self;
        let (train, test) = (observer.plan.train.clone(), observer.plan.test.clone());
        let (mut scores, mut first) = (vec![], None);
        let mut through = vec![];
        for seed in 1..=settings.seeds {
            let mut all = |variants: &[u64]| -> Result<Vec<Observation>, ApplicationError> {
                variants.iter().map(|v| observer.observe(*v, seed)).collect()
            };
            let (train, test) = (all(&train)?, all(&test)?);
            let outcome = (application.run)(&train, &test)?;
            links::capture(application, &settings.links, &train, &test, watch, &mut through)?;
            scores.extend(outcome.scores.iter().map(|s| (seed, s.clone())));
            first.get_or_insert(outcome);
        }
        Ok(Report {
            rows: compare(application, &scores),
            scores,
            first: first.unwrap_or_default(),
            through: through.into_iter().map(|t| t.compared(application)).collect(),
            size: observer.size,
            seeds: settings.seeds,
            rendered: observer.studio.rendered(),
        })
    }

    /// Returns the number of renders that this run made, excluding reused finished renders.
    pub fn rendered(&self) -> usize {
        self.observer.studio.rendered()
    }
}

/// Ground truth of a variant. Methods may use ground truth only for training and scoring.
#[derive(Clone, Default)]
struct Known {
    rig: Option<Rig>,
    maps: BTreeMap<String, Map>,
    slices: BTreeMap<String, Slice>,
}

/// Identifies a render that the run needs.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Wanted {
    variant: u64,
    seed: u64,
    spp: u32,
    slices: Vec<&'static str>,
}

struct Observer<'a> {
    studio: Studio<'a>,
    plan: Plan,
    size: Size,
    /// Ground truth of each variant, identical for all seeds.
    truths: BTreeMap<u64, Known>,
    /// Finished stores that have not been read yet.
    stores: BTreeMap<Wanted, TensorStore>,
}

impl Observer<'_> {
    fn observe(&mut self, number: u64, seed: u64) -> Result<Observation, ApplicationError> {
        let variant = self.studio.variant(Some(number))?;
        let values = variant.values.iter().filter_map(|(name, v)| {
            let value = v.as_float().or_else(|| v.as_integer().map(|i| i as f64))?;
            Some((name.clone(), value))
        });
        let values = values.collect();
        let words = variant.values.iter();
        let words = words.filter_map(|(name, v)| Some((name.clone(), v.as_str()?.to_owned())));
        let words = words.collect();
        let known = self.truth(number, &variant)?;
        let mut observation = Observation {
            variant: number,
            seed,
            values,
            words,
            rig: known.rig,
            slices: known.slices,
            truth: known.maps,
        };
        let wanted = self.of_seed(number, seed);
        if !wanted.slices.is_empty() {
            let store = self.store(&wanted)?;
            for name in wanted.slices {
                observation.slices.insert(name.to_owned(), read(&store, name)?);
            }
        }
        Ok(observation)
    }

    fn truth(&mut self, number: u64, variant: &Variant) -> Result<Known, ApplicationError> {
        if let Some(known) = self.truths.get(&number) {
            return Ok(known.clone());
        }
        let mut scene = self.studio.scene(variant, self.size.pixels, &[])?;
        scene.keep_texture_coordinates();
        let mut known = Known { rig: truth::rig(&scene), ..Known::default() };
        // Layers of the first surfaces, and of the surfaces behind smooth interfaces.
        let mut sets: [Option<LayerSet>; 2] = [None, None];
        for truth in self.plan.truth.clone() {
            let (name, map) = match truth {
                Truth::Slice { name, slice, .. } => {
                    if let Some(wanted) = self.of_slice(number, &truth) {
                        let store = self.store(&wanted)?;
                        known.slices.insert(name.to_owned(), read(&store, slice)?);
                    }
                    continue;
                }
                Truth::Layer { name, layer, through } => {
                    let options = layers::Options { through, ..layers::Options::default() };
                    let set =
                        sets[usize::from(through)].get_or_insert_with(|| layers::layers(&scene, options));
                    let map = truth::layer(set, layer);
                    (name, map.ok_or_else(|| self.lacks(format!("unknown layer `{layer}`")))?)
                }
                Truth::Material { name, of } => {
                    if let Some(unknown) = of.iter().find(|m| !variant.file.materials.contains_key(**m)) {
                        return Err(self.lacks(format!("unknown material `{unknown}`")));
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

    /// Identifies the render of a variant that is the input of the methods.
    fn of_seed(&self, variant: u64, seed: u64) -> Wanted {
        Wanted { variant, seed, spp: self.size.spp, slices: self.plan.slices.clone() }
    }

    /// Identifies the renders from which a variant's ground truth is computed.
    fn of_truth(&self, variant: u64) -> impl Iterator<Item = Wanted> {
        self.plan.truth.iter().filter_map(move |t| self.of_slice(variant, t))
    }

    fn of_slice(&self, variant: u64, truth: &Truth) -> Option<Wanted> {
        let Truth::Slice { slice, of, samples, .. } = truth else {
            return None;
        };
        Some(Wanted {
            variant: of(variant),
            seed: TRUTH_SEED,
            spp: self.size.spp.saturating_mul(*samples),
            slices: vec![slice],
        })
    }

    /// Returns the finished store of a render.
    fn store(&mut self, wanted: &Wanted) -> Result<TensorStore, ApplicationError> {
        if let Some(store) = self.stores.remove(wanted) {
            return Ok(store);
        }
        let Wanted { variant: number, seed, spp, ref slices } = *wanted;
        let variant = self.studio.variant(Some(number))?;
        let size = Size { spp, ..self.size };
        Ok(self.studio.render(Some(number), &variant, seed, size, slices)?)
    }

    fn lacks(&self, what: String) -> ApplicationError {
        let fix = "restore the scene file shipped with Sunstone".to_owned();
        self.studio.lacks(what, fix).into()
    }
}

/// Reads a slice of a finished store.
fn read(store: &TensorStore, name: &str) -> Result<Slice, ApplicationError> {
    let stored = store.slice(name)?;
    Ok(Slice { mean: stored.read_all(Field::Mean)?, error: stored.read_all(Field::StdError)? })
}

/// Finds the folder `scenes` that contains the file `scene`. Searches `from` first, then the parent folders
/// of `from`, starting with the nearest parent.
pub fn find_scenes(from: &Path, scene: &str) -> Option<PathBuf> {
    from.ancestors().map(|folder| folder.join("scenes")).find(|s| s.join(scene).is_file())
}

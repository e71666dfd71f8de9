//! Renders: from a scene to a store on disk, to arrays in memory, or into any other sink.

use rayon::ThreadPoolBuilder;
use serde_json::{Value, json};
use std::convert::Infallible;
use std::path::Path;
use store::sink::ZarrSink;
pub use store::sink::{SinkError, Target};
use tensor::memory::Arrays;
pub use tensor::part::Part;
use tensor::sink::Sink;
pub use tensor::sink::Summary;
use transport::render::schedule::{self, Share};
pub use transport::render::schedule::{Unwatched, Watch};
use transport::scene::Scene;

/// Why a render into a store stopped.
pub type RenderError = schedule::RenderError<SinkError>;

/// A render of all slices of a scene, which says where to and how.
///
/// The same scene, seed and samples give the same bits, whatever the number of threads and the sink.
///
/// ```
/// use sunstone::{Camera, Field, Material, Object, Projector, Render, SceneBuilder, Slice};
///
/// let light = Camera::look_at([0.3, 0.0, 2.0], [0.0; 3]).fov_x_deg(40.0).resolution(16, 16);
/// let scene = SceneBuilder::new()
///     .camera(Camera::look_at([0.0, 0.0, 2.0], [0.0; 3]).fov_x_deg(30.0).resolution(8, 8))
///     .projector(Projector::new(light))
///     .material("wall", Material::diffuse(0.5))
///     .object(Object::rectangle([-1.0, -1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]).material("wall"))
///     .slice(Slice::new("photo"))
///     .spp(4)
///     .build()?;
/// let arrays = Render::new(&scene).to_arrays()?;
/// let photo = arrays.get("photo", Field::Mean).expect("the slice of the scene");
/// assert_eq!(photo.shape(), [8, 8, 3]); // y, x, wavelength
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Render<'a> {
    scene: &'a Scene,
    watch: &'a dyn Watch,
    attributes: Vec<(&'a str, Value)>,
    share: Share<'a>,
    threads: Option<usize>,
}

impl<'a> Render<'a> {
    /// Of a scene, on the threads of the current rayon pool, unwatched.
    #[must_use]
    pub fn new(scene: &'a Scene) -> Self {
        let version = env!("CARGO_PKG_VERSION");
        Self {
            scene,
            watch: &Unwatched,
            attributes: vec![
                ("source", json!(format!("sunstone {version}"))),
                ("version", json!(version)),
            ],
            share: Share::default(),
            threads: None,
        }
    }

    /// Reports to `watch` once a tile, and ends when it says so.
    #[must_use]
    pub fn watch(mut self, watch: &'a dyn Watch) -> Self {
        self.watch = watch;
        self
    }

    /// Notes something beside the provenance that every render notes: an attribute of a store.
    #[must_use]
    pub fn attribute(mut self, name: &'a str, value: Value) -> Self {
        self.attributes.push((name, value));
        self
    }

    /// A part of it alone: its tiles get the bits that they have in the whole, all others stay zero. A store says which part
    /// it is and reads as no finished render; [`store::merge::merge`] joins a complete set to the bytes of the whole.
    #[must_use]
    pub fn part(mut self, part: Part) -> Self {
        self.share.part = Some(part);
        self
    }

    /// With so many samples of the pixels of each tile, row by row, in place of one number for all: a tile gets the bits that it has in a
    /// render of its number everywhere, and tiles of none stay zero. The scene's settings hold the largest number.
    #[must_use]
    pub fn samples(mut self, samples: &'a [u32]) -> Self {
        self.share.samples = Some(samples);
        self
    }

    /// With walks from the light that all parts K of N make together, by files in a folder that their machines share: otherwise each
    /// part makes all of them for itself. Nobody waits for a part that is not running, and no bit changes.
    #[must_use]
    pub fn shared_light(mut self, folder: &'a Path) -> Self {
        self.share.light = Some(folder);
        self
    }

    /// On so many threads of its own.
    #[must_use]
    pub fn threads(mut self, threads: usize) -> Self {
        self.threads = Some(threads);
        self
    }

    /// Into a sink.
    ///
    /// # Errors
    /// [`schedule::RenderError`]: the scene keeps nothing, has no such part, threads cannot be started, or the sink refuses.
    pub fn into_sink<S: Sink + Send>(self, sink: &mut S) -> Result<Summary, schedule::RenderError<S::Error>> {
        let run = |sink: &mut S| schedule::render(self.scene, &self.attributes, self.share, sink, self.watch);
        match self.threads {
            None => run(sink),
            Some(threads) => ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .map_err(|e| schedule::RenderError::Threads(e.to_string()))?
                .install(|| run(sink)),
        }
    }

    /// Into arrays in memory: all fields of all slices.
    ///
    /// # Errors
    /// [`schedule::RenderError`]: the scene keeps nothing, or threads cannot be started.
    pub fn to_arrays(self) -> Result<Arrays, schedule::RenderError<Infallible>> {
        let mut arrays = Arrays::default();
        self.into_sink(&mut arrays)?;
        Ok(arrays)
    }

    /// Into a new Zarr store, which must not exist yet.
    ///
    /// # Errors
    /// [`RenderError`]; what was finished stays on disk and can be resumed ([`Self::to_target`]).
    pub fn to_store(self, path: &Path) -> Result<Summary, RenderError> {
        self.to_target(&Target {
            path: path.to_owned(),
            ..Target::default()
        })
    }

    /// Into a Zarr store that is made, replaced or resumed.
    ///
    /// # Errors
    /// [`RenderError`]; what was finished stays on disk and can be resumed.
    pub fn to_target(self, target: &Target) -> Result<Summary, RenderError> {
        self.into_sink(&mut ZarrSink::new(target.clone()))
    }
}

/// What a render is to do otherwise than its scene says: what is `None` stays, and all slices do where none is named.
#[derive(Clone, Debug, Default)]
pub struct Choices {
    /// Samples per camera pixel.
    pub spp: Option<u32>,
    /// Least number of independent groups of samples.
    pub replicates: Option<u32>,
    /// Random seed.
    pub seed: Option<u64>,
    /// Names of the slices that are kept.
    pub slices: Option<Vec<String>>,
}

/// Most samples and groups of them that may be asked for.
const MOST_SAMPLES: u32 = 1 << 30;

impl Choices {
    /// Changes a scene, wholly or not at all. `dashes` stand before the names of choices in messages: those of a command, or
    /// nothing.
    ///
    /// # Errors
    /// A message that names the choice, what is wrong with it and the fix.
    pub fn apply(&self, scene: &mut Scene, dashes: &str) -> Result<(), String> {
        for (name, given) in [("spp", self.spp), ("replicates", self.replicates)] {
            if let Some(n) = given.filter(|n| !(1..=MOST_SAMPLES).contains(n)) {
                return Err(format!("{dashes}{name}: expected 1 to {MOST_SAMPLES}, got {n}"));
            }
        }
        if let Some(names) = &self.slices {
            let known: Vec<&str> = scene.slices.iter().map(|s| s.name.as_str()).collect();
            if let Some(unknown) = names.iter().find(|n| !known.contains(&n.as_str())) {
                return Err(format!(
                    "{dashes}slices: unknown slice `{unknown}`; available: {}",
                    known.join(", ")
                ));
            }
            scene.slices.retain(|s| names.contains(&s.name));
        }
        let settings = &mut scene.settings;
        settings.spp = self.spp.unwrap_or(settings.spp);
        settings.replicates = self.replicates.unwrap_or(settings.replicates);
        settings.seed = self.seed.unwrap_or(settings.seed);
        Ok(())
    }
}

/// Most threads that may be asked for: as many as the machine can make use of, and then some, not so many that it does nothing
/// else.
#[must_use]
pub fn most_threads() -> usize {
    8 * cores()
}

/// Threads that the machine runs at once.
#[must_use]
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Whether the system refused a render into a store, as a full disk does, and not what was asked for.
#[must_use]
pub fn is_of_system(e: &RenderError) -> bool {
    match e {
        RenderError::Threads(_) | RenderError::Sink(SinkError::Access(_) | SinkError::Journal { .. }) => true,
        RenderError::Sink(SinkError::Create(cause)) => cause.is_of_system(),
        RenderError::Sink(_) | RenderError::NoSlices | RenderError::Part(_) => false,
    }
}

/// Renders all slices of a scene into a store, on the current rayon thread pool.
///
/// # Errors
/// [`RenderError`]; what was finished stays on disk and can be resumed.
pub fn render(scene: &Scene, target: &Target, watch: &dyn Watch) -> Result<Summary, RenderError> {
    Render::new(scene).watch(watch).to_target(target)
}

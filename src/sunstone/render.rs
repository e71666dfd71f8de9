//! Renders a scene into a store on disk, into arrays in memory, or into any other sink.

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

/// The reason why a render into a store stopped.
pub type RenderError = schedule::RenderError<SinkError>;

/// A render of all slices of a scene, with its options and destination.
///
/// The same scene, seed and samples give bit-identical results for any number of threads and any sink.
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
    /// Creates a render of a scene on the threads of the current rayon pool, without a watch.
    pub fn new(scene: &'a Scene) -> Self {
        let version = env!("CARGO_PKG_VERSION");
        Self {
            scene,
            watch: &Unwatched,
            attributes: vec![("source", json!(format!("sunstone {version}"))), ("version", json!(version))],
            share: Share::default(),
            threads: None,
        }
    }

    /// Returns the scene that is rendered.
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// Reports each finished tile to `watch`, which can stop the render.
    pub fn watch(mut self, watch: &'a dyn Watch) -> Self {
        self.watch = watch;
        self
    }

    /// Adds an attribute of the store, in addition to the provenance that every render records.
    pub fn attribute(mut self, name: &'a str, value: Value) -> Self {
        self.attributes.push((name, value));
        self
    }

    /// Renders only a part of the tiles. These tiles are bit-identical to those of the whole render, and all
    /// other tiles stay zero. The store records the part and cannot be opened as a finished render.
    /// [`store::merge::merge`] joins all parts. The merged store equals the whole render byte for byte.
    pub fn part(mut self, part: Part) -> Self {
        self.share.part = Some(part);
        self
    }

    /// Sets the samples per pixel of each tile, row by row, instead of one number for all tiles. A tile with
    /// N samples is bit-identical to the same tile of a render in which all tiles have N samples. Tiles with
    /// 0 samples stay zero. The settings stored with the scene contain the largest number of samples.
    pub fn samples(mut self, samples: &'a [u32]) -> Self {
        self.share.samples = Some(samples);
        self
    }

    /// Shares the light paths between all parts K of N, through files in a folder that all machines can
    /// access. Without this option, each part traces all light paths. Parts never block on one another, and
    /// the output is bit-identical.
    pub fn shared_light(mut self, folder: &'a Path) -> Self {
        self.share.light = Some(folder);
        self
    }

    /// Renders on a separate pool of `threads` threads.
    pub fn threads(mut self, threads: usize) -> Self {
        self.threads = Some(threads);
        self
    }

    /// Renders into a sink.
    ///
    /// # Errors
    /// Returns [`schedule::RenderError`] if the scene has no slices, if the part does not exist, if threads
    /// cannot be started, or if the sink fails.
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

    /// Renders all fields of all slices into arrays in memory.
    ///
    /// # Errors
    /// Returns [`schedule::RenderError`] if the scene has no slices, or if threads cannot be started.
    pub fn to_arrays(self) -> Result<Arrays, schedule::RenderError<Infallible>> {
        let mut arrays = Arrays::default();
        self.into_sink(&mut arrays)?;
        Ok(arrays)
    }

    /// Renders into a new Zarr store. The path must not exist.
    ///
    /// # Errors
    /// Returns [`RenderError`] if the render stopped. Finished tiles stay on disk, and [`Self::to_target`]
    /// can resume the render.
    pub fn to_store(self, path: &Path) -> Result<Summary, RenderError> {
        self.to_target(&Target { path: path.to_owned(), ..Target::default() })
    }

    /// Renders into a Zarr store that is created, replaced or resumed.
    ///
    /// # Errors
    /// Returns [`RenderError`] if the render stopped. Finished tiles stay on disk and the render can be
    /// resumed.
    pub fn to_target(self, target: &Target) -> Result<Summary, RenderError> {
        self.into_sink(&mut ZarrSink::new(target.clone()))
    }
}

/// Settings that override the settings of a scene. `None` keeps the scene's setting. Without slice names, all
/// slices are kept.
#[derive(Clone, Debug, Default)]
pub struct Choices {
    /// Samples per camera pixel.
    pub spp: Option<u32>,
    /// Minimum number of independent groups of samples, for standard errors.
    pub replicates: Option<u32>,
    pub seed: Option<u64>,
    /// Names of the slices to keep.
    pub slices: Option<Vec<String>>,
}

/// Maximum number of samples per pixel, and of groups of samples.
const MOST_SAMPLES: u32 = 1 << 30;

impl Choices {
    /// Applies the choices to a scene. If one choice is invalid, the scene does not change.
    /// `dashes` is the prefix of option names in messages, such as `--`, or empty.
    ///
    /// # Errors
    /// Returns a message with the name of the invalid choice, the fault and the fix.
    pub fn apply(&self, scene: &mut Scene, dashes: &str) -> Result<(), String> {
        for (name, given) in [("spp", self.spp), ("replicates", self.replicates)] {
            if let Some(n) = given.filter(|n| !(1..=MOST_SAMPLES).contains(n)) {
                return Err(format!("{dashes}{name}: expected a number from 1 to {MOST_SAMPLES}, got {n}"));
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
            scene.change_slices(|all| all.retain(|s| names.contains(&s.name)));
        }
        scene.change_settings(|s| {
            s.spp = self.spp.unwrap_or(s.spp);
            s.replicates = self.replicates.unwrap_or(s.replicates);
            s.seed = self.seed.unwrap_or(s.seed);
        });
        Ok(())
    }
}

/// Returns the maximum number of threads that a user can request. This number is larger than the number of
/// cores, but is small enough not to overload the machine.
pub fn most_threads() -> usize {
    8 * cores()
}

/// Returns the number of threads that the machine runs concurrently.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Returns whether a system error, such as a full disk, stopped a render into a store. Returns false if the
/// request is the cause.
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
/// Returns [`RenderError`] if the render stopped. Finished tiles stay on disk and the render can be resumed.
pub fn render(scene: &Scene, target: &Target, watch: &dyn Watch) -> Result<Summary, RenderError> {
    Render::new(scene).watch(watch).to_target(target)
}

//! What an application is: scenes and slices that it needs, methods that it compares, numbers that it is judged by.
//!
//! Whoever runs one renders the variants that its [`Plan`] names, as many times as there are seeds, and gives it what came
//! out. It sees tensors and maps; no scene, no renderer, no file.

use crate::chain::few::Task;
use crate::error::ApplyError;
use crate::map::Map;
use crate::observation::Observation;

/// An application of the tensor, with the methods that are published for the same task.
pub trait Application: Send + Sync {
    /// One word, as the command line takes it.
    fn name(&self) -> &'static str;

    /// What it shows, a sentence.
    fn shows(&self) -> &'static str;

    /// What it needs.
    fn plan(&self) -> Plan;

    /// All methods; the first is the one that the others are compared with.
    fn methods(&self) -> Vec<Method>;

    /// What pictures are of besides methods and truths, by the names that stand for a method there: elements that are drawn as they are.
    fn drawn(&self) -> Vec<&'static str> {
        Vec::new()
    }

    /// All numbers that methods are judged by; the first is the one that counts.
    fn metrics(&self) -> Vec<Metric>;

    /// Fits every method on `train` and judges it on `test`: one seed's observations each.
    ///
    /// # Errors
    /// [`ApplyError`].
    fn run(&self, train: &[Observation], test: &[Observation]) -> Result<Outcome, ApplyError>;

    /// What the first method makes of Mueller matrices, where that is a few linear functionals of them, learnt from `train`: captures can
    /// then be chosen for it.
    ///
    /// # Errors
    /// [`ApplyError`].
    fn task(&self, _train: &[Observation]) -> Result<Option<Task>, ApplyError> {
        Ok(None)
    }
}

/// What an application needs to be rendered.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Scene file, below the folder of scenes.
    pub scene: &'static str,
    /// Variants to learn from.
    pub train: Vec<u64>,
    /// Variants to be judged on, none of which is in `train`.
    pub test: Vec<u64>,
    /// Slices of every variant, by name. None where seeds are of something else than renders, as of a detector: truth alone is rendered.
    pub slices: Vec<&'static str>,
    /// Ground truth of every variant.
    pub truth: Vec<Truth>,
    /// Size of a render for a first look.
    pub preview: Size,
    /// Size of a render for numbers.
    pub full: Size,
}

/// Where a truth map comes from, and its name.
#[derive(Clone, Copy, Debug)]
pub enum Truth {
    /// Share of a pixel in which the first surface behind smooth glass and water is of one of these materials.
    Material {
        /// Name of the map.
        name: &'static str,
        /// Names of the materials.
        of: &'static [&'static str],
    },
    /// Number of the object, counted from 0, that is seen so by the pixel's centre; NaN of nothing.
    Object(&'static str),
    /// Texture coordinates of that surface, two channels.
    Texture(&'static str),
    /// A layer of the scene's geometry and materials by its name in `sunstone layers`, of what most of 4 x 4 rays a pixel meet; NaN, or
    /// -1 of numbers, where there is nothing.
    Layer {
        /// Name of the map.
        name: &'static str,
        /// Name of the layer.
        layer: &'static str,
        /// Of what stands behind smooth interfaces and sheets.
        through: bool,
    },
    /// A slice of the variant or of another one, rendered with a seed of its own: it is with the observation's slices, by this name.
    Slice {
        /// Name of the truth.
        name: &'static str,
        /// Slice.
        slice: &'static str,
        /// The variant that it is of: [`itself`], or what is the truth of a variant.
        of: fn(u64) -> u64,
        /// Samples, as a multiple of those of the rest.
        samples: u32,
    },
}

/// The variant that is told of, for [`Truth::Slice`].
#[must_use]
pub fn itself(variant: u64) -> u64 {
    variant
}

/// Size of a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Pixels of the longer side of the camera; the other in proportion.
    pub pixels: u32,
    /// Samples per pixel.
    pub spp: u32,
}

/// A method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Method {
    /// Its name in tables.
    pub name: &'static str,
    /// Where it was published, or that it is new here.
    pub source: &'static str,
}

impl Method {
    /// By its name in tables, and where it was published.
    #[must_use]
    pub const fn new(name: &'static str, source: &'static str) -> Self {
        Self { name, source }
    }
}

/// A number that methods are judged by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Metric {
    /// Its name in tables.
    pub name: &'static str,
    /// Its unit, empty if it has none.
    pub unit: &'static str,
    /// Whether more is better.
    pub more_is_better: bool,
}

impl Metric {
    /// By its name in tables, and its unit.
    #[must_use]
    pub const fn new(name: &'static str, unit: &'static str, more_is_better: bool) -> Self {
        Self {
            name,
            unit,
            more_is_better,
        }
    }
}

/// What one method is worth on one variant.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// Name of the method.
    pub method: &'static str,
    /// Name of the metric.
    pub metric: &'static str,
    /// Variant that it was judged on.
    pub variant: u64,
    /// Its worth; NaN where the metric says nothing of this variant.
    pub value: f64,
}

impl Score {
    /// What a method is worth on a variant, metric by metric.
    pub fn each<'a>(
        method: &'static str,
        variant: u64,
        metrics: impl IntoIterator<Item = &'a Metric>,
        values: impl IntoIterator<Item = f64>,
    ) -> impl Iterator<Item = Self> {
        metrics.into_iter().zip(values).map(move |(metric, value)| Self {
            method,
            metric: metric.name,
            variant,
            value,
        })
    }
}

/// A picture of what a method made.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Name of the method.
    pub method: &'static str,
    /// What it shows, fit for a file name.
    pub name: &'static str,
    /// Variant that it is of; nothing of what was learnt.
    pub variant: Option<u64>,
    /// Whether it is in a unit that all methods share, so that they are drawn side by side on one scale.
    pub shared: bool,
    /// The picture.
    pub map: Map,
}

/// What a run gave.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Scores of all methods on all test variants.
    pub scores: Vec<Score>,
    /// Pictures.
    pub pictures: Vec<Picture>,
    /// What a reader should know of this run, a sentence each.
    pub notes: Vec<String>,
}

//! Defines applications. An application states the scenes and slices that it needs, the methods that it
//! compares, and its metrics.
//!
//! The caller renders the variants of the [`Plan`], once per seed, and passes the results. An application
//! uses tensors and maps. An application does not read scenes or files, and does not render.

use crate::chain::few::Task;
use crate::error::ApplyError;
use crate::map::Map;
use crate::observation::Observation;

/// An application of the transport tensor, with published methods for the same task as baselines.
#[derive(Clone, Debug)]
pub struct Application {
    /// Name of the application on the command line, a single word.
    pub name: &'static str,
    /// A sentence that states what the application shows.
    pub shows: &'static str,
    pub plan: Plan,
    /// All methods. The first method is compared with all other methods.
    pub methods: Vec<Method>,
    /// Names of images that belong neither to a method nor to a truth map, such as elements that are drawn
    /// directly.
    pub drawn: Vec<&'static str>,
    /// All metrics. The first metric is the main metric.
    pub metrics: Vec<Metric>,
    pub run: Run,
    /// Function that learns the task of the first method from training observations. Captures can be
    /// optimized for this task. The value is `None` unless the first method computes a few linear functionals
    /// of Mueller matrices.
    pub task: Option<Learn>,
}

/// A function that learns a task from training observations.
pub type Learn = fn(&[Observation]) -> Result<Task, ApplyError>;

/// A function that fits every method to the first list of observations and tests the methods on the second
/// list. All observations have the same seed.
pub type Run = fn(&[Observation], &[Observation]) -> Result<Outcome, ApplyError>;

/// The renders that an application needs.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Path of the scene file, relative to the folder of scenes.
    pub scene: &'static str,
    pub train: Vec<u64>,
    /// Variants for testing, none of which is in `train`.
    pub test: Vec<u64>,
    /// Names of the slices of every variant. If the list is empty, only the ground truth is rendered. An
    /// example is an application whose seeds select detector noise instead of renders.
    pub slices: Vec<&'static str>,
    pub truth: Vec<Truth>,
    pub preview: Size,
    /// Size of the renders from which the results are computed.
    pub full: Size,
}

/// The source and the name of a ground-truth map.
#[derive(Clone, Copy, Debug)]
pub enum Truth {
    /// Fraction of each pixel's area in which the first visible surface has one of these materials.
    /// Smooth glass and water in front of the surface are ignored.
    Material {
        name: &'static str,
        /// Names of the materials.
        of: &'static [&'static str],
    },
    /// Index of the object at each pixel's centre, counted from 0. The index is NaN if there is no object.
    /// Smooth glass and water in front of the object are ignored.
    Object(&'static str),
    /// Texture coordinates, in two channels, of the surface that [`Truth::Object`] refers to.
    Texture(&'static str),
    /// A layer of `sunstone layers`. A pixel has the value of the object that most of the 4 x 4 rays of the
    /// pixel hit. Pixels without an object are NaN, or -1 in layers of object indices.
    Layer {
        name: &'static str,
        layer: &'static str,
        /// Whether the layer shows the surfaces behind smooth interfaces and sheets.
        through: bool,
    },
    /// A slice of the same variant or of another variant, rendered with a separate seed. The slice is added
    /// to the observation under the slice's name.
    Slice {
        name: &'static str,
        slice: &'static str,
        /// Returns the variant to render for a given variant. The function [`itself`] returns the given
        /// variant.
        of: fn(u64) -> u64,
        /// Number of samples, as a multiple of the number of samples of other renders.
        samples: u32,
    },
}

/// Returns the given variant, for use in [`Truth::Slice`].
pub fn itself(variant: u64) -> u64 {
    variant
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Number of pixels of the longer side of the camera image. The scene defines the aspect ratio.
    pub pixels: u32,
    /// Samples per pixel.
    pub spp: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Method {
    pub name: &'static str,
    /// Publication of the method, or a note that states that the method is new.
    pub source: &'static str,
}

impl Method {
    /// Returns a method with the given name and publication.
    pub const fn new(name: &'static str, source: &'static str) -> Self {
        Self { name, source }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Metric {
    pub name: &'static str,
    /// Unit of the metric, empty for a number without a unit.
    pub unit: &'static str,
    pub more_is_better: bool,
}

impl Metric {
    pub const fn new(name: &'static str, unit: &'static str, more_is_better: bool) -> Self {
        Self { name, unit, more_is_better }
    }
}

/// The score of one method on one variant.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    pub method: &'static str,
    pub metric: &'static str,
    pub variant: u64,
    /// Value of the score, NaN if the metric is undefined for this variant.
    pub value: f64,
}

impl Score {
    /// Returns the scores of a method on a variant, one per metric.
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

/// An image of a method's result.
#[derive(Clone, Debug)]
pub struct Picture {
    pub method: &'static str,
    /// Short description of the content, suitable for a file name.
    pub name: &'static str,
    /// Variant of the image, or `None` for an image of learned quantities.
    pub variant: Option<u64>,
    /// Whether the images of all methods have the same unit. Images with the same unit are drawn side by side
    /// on a common scale.
    pub shared: bool,
    pub map: Map,
}

/// The results of a run.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Scores of all methods on all test variants.
    pub scores: Vec<Score>,
    pub pictures: Vec<Picture>,
    /// Notes for the reader, one sentence each.
    pub notes: Vec<String>,
}

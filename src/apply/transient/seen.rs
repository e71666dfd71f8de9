//! A variant's transient Mueller matrices, and the ground truth of the variant's light. Labels and numbers of
//! reflections determine the ground truth.

use crate::error::ApplyError;
use crate::observation::{Observation, Pixels};
use crate::paths::Labelled;
use tensor::axes::AxisKind;

/// Name of the slice that the methods use.
pub(super) const TRANSIENT: &str = "transient";
/// Name of the truth slice.
pub(super) const LABELLED: &str = "labelled";

/// Minimum light of a lit place (a pixel and a bin), relative to the pixel's mean light per bin. Smaller
/// values are noise of the labelled render.
const LEAST: f64 = 0.01;

/// The change of circular polarization along a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    /// An odd number of specular reflections.
    Inverting,
    /// An even number of specular reflections.
    Keeping,
}

pub(super) const TARGETS: [Target; 2] = [Target::Inverting, Target::Keeping];

/// One variant with one seed. Places are pairs of a pixel and a bin, with the index `pixel * bins + bin`.
pub(super) struct Seen {
    pub variant: u64,
    pub pixels: Pixels,
    /// Places that are lit according to the labels.
    pub lit: Vec<usize>,
    /// Light in W/(m² sr nm) after only specular reflections. The first list contains light after an odd
    /// number of reflections. The second list contains light after an even number of reflections.
    labelled: [Vec<f64>; 2],
    all: Vec<f64>,
}

impl Seen {
    pub(super) fn new(o: &Observation) -> Result<Self, ApplyError> {
        let pixels = o.pixels(TRANSIENT, true)?;
        let labels = Labelled::of(o, LABELLED)?;
        let sizes = [AxisKind::X, AxisKind::Y, AxisKind::T, AxisKind::Wavelength];
        if sizes.map(|kind| labels.tensor.extent(kind))
            != [pixels.width, pixels.height, pixels.bins, pixels.wavelengths]
        {
            return Err(o.sizes(format!("slices `{TRANSIENT}` and `{LABELLED}`")));
        }
        let places = pixels.count() * pixels.bins;
        let mut labelled = [vec![0.0; places], vec![0.0; places]];
        let mut all = vec![0.0; places];
        labels.walk(|pixel, bin, kind, value| {
            let (place, path) = (pixel * pixels.bins + bin, labels.kinds[kind]);
            all[place] += value;
            if path.all_specular() {
                labelled[usize::from(path.bounces.is_multiple_of(2))][place] += value;
            }
        });
        let mean = all.iter().sum::<f64>() / pixels.count().max(1) as f64;
        let lit = (0..places).filter(|p| all[*p] > 0.0 && all[*p] >= LEAST * mean).collect();
        Ok(Self { variant: o.variant, pixels, lit, labelled, all })
    }

    /// Returns the light at a place after only specular reflections. `target` selects odd or even numbers of
    /// reflections.
    pub(super) fn light(&self, target: Target, place: usize) -> f64 {
        self.labelled[usize::from(target == Target::Keeping)][place]
    }

    /// Returns the share of the light at a place that belongs to `target`, or 0 without light.
    pub(super) fn share(&self, target: Target, place: usize) -> f64 {
        if self.all[place] > 0.0 { self.light(target, place) / self.all[place] } else { 0.0 }
    }

    /// Returns whether most of the light at a place belongs to `target`.
    pub(super) fn is(&self, target: Target, place: usize) -> bool {
        self.light(target, place) > 0.5 * self.all[place]
    }

    /// Returns element 4 i + j at a place, summed over wavelengths.
    pub(super) fn element(&self, place: usize, element: usize) -> f64 {
        let (pixel, bin) = (place / self.pixels.bins, place % self.pixels.bins);
        (0..self.pixels.wavelengths).map(|lane| self.pixels.at(pixel, bin, element, lane)).sum()
    }

    /// Returns element 4 i + j, summed over wavelengths and over the bins of the place's pixel.
    pub(super) fn integrated(&self, place: usize, element: usize) -> f64 {
        let first = place - place % self.pixels.bins;
        (first..first + self.pixels.bins).map(|p| self.element(p, element)).sum()
    }
}

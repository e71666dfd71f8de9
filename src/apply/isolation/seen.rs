//! The data of one variant for detectors. The data contains the images of all elements of every light
//! component, and the ground truth of each task.

use super::element::{Element, Part, Space, Time};
use super::task::Task;
use crate::error::ApplyError;
use crate::metrics::isolation::{Class, classes};
use crate::observation::{Observation, Pixels};
use crate::paths::Paths;
use std::collections::BTreeMap;

/// Name of the slice with all light as matrices, without time bins.
pub const POLARIMETRIC: &str = "polarimetric";
/// Name of the slice with epipolar light.
pub const EPIPOLAR: &str = "epipolar";
/// Name of the slice with all light in bins of travel time, as matrices or intensities.
pub const TRANSIENT: &str = "transient";
/// Name of the slice with epipolar light as matrices, in the same bins as [`TRANSIENT`].
pub const GATED: &str = "gated";
/// Name of the ground-truth slice, which contains intensity by label and number of bounces.
pub const PATHS: &str = "paths";

/// Numbers of bins after a pixel's first light at which early and late light are separated.
pub const CUTS: [usize; 3] = [0, 1, 3];

/// The first light of a pixel is in the first bin whose value is at least this fraction of the pixel's
/// brightest bin.
const FIRST: f64 = 0.1;

pub struct Seen {
    pub variant: u64,
    pub width: usize,
    pub height: usize,
    /// Images of each light component, summed over wavelengths: `[element 4 i + j][pixel]`. A component of
    /// intensities has a single image.
    images: BTreeMap<Part, Vec<Vec<f64>>>,
    /// Ground truth of each task.
    pub truth: Vec<Truth>,
}

/// The ground truth of a task, per pixel.
pub struct Truth {
    /// Share of the task's light in each pixel, or 0 outside the task's region.
    pub share: Vec<f64>,
    /// Class of each pixel for detection.
    pub classes: Vec<Class>,
}

/// Returns the pixels whose value in a truth map passes a test.
///
/// # Errors
/// [`ApplyError::Missing`] if the observation does not contain the map.
pub fn within(o: &Observation, map: &str, holds: impl Fn(&[f64]) -> bool) -> Result<Vec<bool>, ApplyError> {
    let map = o.truth(map)?;
    Ok(map.data.chunks_exact(map.channels.max(1)).map(holds).collect())
}

/// A function that returns whether a bin of a pixel is included.
type Kept<'a> = dyn Fn(usize, usize) -> bool + 'a;

/// Returns images `[element][pixel]`, summed over wavelengths and over the bins that `keep` selects.
fn images(p: &Pixels, keep: impl Fn(usize, usize) -> bool) -> Vec<Vec<f64>> {
    let image = |e: usize| {
        let value = |pixel: usize| {
            let bins = (0..p.bins).filter(|b| keep(pixel, *b));
            bins.flat_map(|b| (0..p.wavelengths).map(move |lane| p.at(pixel, b, e, lane))).sum()
        };
        (0..p.count()).map(value).collect()
    };
    (0..p.elements).map(image).collect()
}

fn less(all: &[Vec<f64>], part: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let images = all.iter().zip(part);
    images.map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect()
}

fn first_light(p: &Pixels) -> Vec<usize> {
    (0..p.count())
        .map(|pixel| {
            let brightest = (0..p.bins).map(|b| p.light(pixel, b)).fold(0.0, f64::max);
            (0..p.bins).find(|b| p.light(pixel, *b) >= FIRST * brightest).unwrap_or(0)
        })
        .collect()
}

/// The available slices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sight {
    /// The slices [`POLARIMETRIC`], [`EPIPOLAR`] and [`TRANSIENT`] of all light.
    Space,
    /// The slices of `Space`, and [`GATED`].
    SpaceAndTime,
    /// Only the slice [`TRANSIENT`], as matrices, for a coaxial rig.
    Coaxial,
}

type Images = BTreeMap<Part, Vec<Vec<f64>>>;

/// Returns the image size and the images of the light components (epipolar, early, late) that a
/// camera-projector rig captures.
fn in_space(o: &Observation, timed: bool) -> Result<(Images, [usize; 2]), ApplyError> {
    let polarimetric = o.pixels(POLARIMETRIC, true)?;
    let size = [polarimetric.width, polarimetric.height];
    let check = |p: Pixels| {
        if [p.width, p.height] == size { Ok(p) } else { Err(o.sizes("slices")) }
    };
    let all = images(&polarimetric, |_, _| true);
    let epipolar = images(&check(o.pixels(EPIPOLAR, true)?)?, |_, _| true);
    let transient = check(o.pixels(TRANSIENT, false)?)?;
    let gated = if timed { Some(check(o.pixels(GATED, true)?)?) } else { None };
    if gated.as_ref().is_some_and(|g| (g.bins, g.elements) != (transient.bins, transient.elements)) {
        return Err(o.sizes("slices in time"));
    }
    let first = first_light(&transient);
    let mut parts = BTreeMap::new();
    for cut in CUTS {
        let early = |pixel: usize, bin: usize| bin <= first[pixel] + cut;
        let late = |pixel: usize, bin: usize| bin > first[pixel] + cut;
        let windows: [(Time, &Kept); 2] = [(Time::Early(cut), &early), (Time::Late(cut), &late)];
        for (time, keep) in windows {
            let whole = images(&transient, keep);
            if let Some(gated) = &gated {
                let near = images(gated, keep);
                parts.insert((Space::NonEpipolar, time), less(&whole, &near));
                parts.insert((Space::Epipolar, time), near);
            }
            parts.insert((Space::All, time), whole);
        }
    }
    parts.insert((Space::NonEpipolar, Time::All), less(&all, &epipolar));
    parts.insert((Space::Epipolar, Time::All), epipolar);
    parts.insert((Space::All, Time::All), all);
    Ok((parts, size))
}

/// Returns the image size and the images of a coaxial rig. There is one image per time bin, and one image of
/// all light.
fn coaxial(o: &Observation) -> Result<(Images, [usize; 2]), ApplyError> {
    let transient = o.pixels(TRANSIENT, true)?;
    let mut parts = BTreeMap::new();
    for bin in 0..transient.bins {
        parts.insert((Space::All, Time::At(bin)), images(&transient, |_, b| b == bin));
    }
    parts.insert((Space::All, Time::All), images(&transient, |_, _| true));
    Ok((parts, [transient.width, transient.height]))
}

impl Seen {
    /// Reads the slices of a variant and the ground truth of the tasks.
    ///
    /// # Errors
    /// [`ApplyError`] if a slice or truth map is missing, or lacks the required axes or size.
    pub fn new(o: &Observation, tasks: &[Task], sight: Sight) -> Result<Self, ApplyError> {
        let (parts, [width, height]) = match sight {
            Sight::Space => in_space(o, false)?,
            Sight::SpaceAndTime => in_space(o, true)?,
            Sight::Coaxial => coaxial(o)?,
        };
        let paths = Paths::read(o, PATHS)?;
        if (paths.width, paths.height) != (width, height) {
            return Err(o.sizes("slices and truth"));
        }
        let everything = paths.all().data;
        let mut truth = vec![];
        for task in tasks {
            let mut light = paths.of(task.light).data;
            if let Some(region) = task.region {
                let within = region(o)?;
                if within.len() != light.len() {
                    return Err(o.sizes("slices and truth maps"));
                }
                for (light, within) in light.iter_mut().zip(&within) {
                    if !within {
                        *light = 0.0;
                    }
                }
            }
            let classes = classes(&light, &everything, task.share);
            let share = |(light, (all, class)): (&f64, (&f64, &Class))| {
                if *class == Class::Dark { 0.0 } else { light / all }
            };
            let share = light.iter().zip(everything.iter().zip(&classes)).map(share).collect();
            truth.push(Truth { share, classes });
        }
        Ok(Self { variant: o.variant, width, height, images: parts, truth })
    }

    /// Returns the available light components, each with the number of its elements.
    pub fn parts(&self) -> impl Iterator<Item = (Part, usize)> {
        self.images.iter().map(|(part, images)| (*part, images.len()))
    }

    /// Returns an element as a signed image, or `None` if the element is not available.
    pub fn image(&self, e: Element) -> Option<Vec<f64>> {
        let images = self.images.get(&e.part)?;
        let sign = if e.negative { -1.0 } else { 1.0 };
        if !e.magnitude {
            let plain = images.get(4 * e.index[0] + e.index[1])?;
            return Some(plain.iter().map(|v| sign * v).collect());
        }
        // The linear Stokes elements 1 and 2 mix under rotation.
        let mixed = |i: usize| if i == 1 || i == 2 { 1..=2 } else { i..=i };
        let together: Vec<&Vec<f64>> = mixed(e.index[0])
            .flat_map(|i| mixed(e.index[1]).map(move |j| 4 * i + j))
            .map(|k| images.get(k))
            .collect::<Option<_>>()?;
        let length = |p: usize| together.iter().map(|m| m[p].powi(2)).sum::<f64>().sqrt();
        Some((0..self.width * self.height).map(|p| sign * length(p)).collect())
    }

    /// Returns (0,0) of all light.
    pub fn photograph(&self) -> &[f64] {
        &self.images[&(Space::All, Time::All)][0]
    }

    /// Returns the images, averaged over those of 3 × 3 pixels that are in the image. The result contains no
    /// ground truth.
    pub fn averaged(&self) -> Self {
        let [w, h] = [self.width, self.height];
        let mean = |image: &Vec<f64>| -> Vec<f64> {
            let of = |p: usize| {
                let (x, y) = (p % w, p / w);
                let near = y.saturating_sub(1)..(y + 2).min(h);
                let near = near.map(|j| &image[j * w + x.saturating_sub(1)..j * w + (x + 2).min(w)]);
                let (sum, n) =
                    near.fold((0.0, 0), |(s, n), row| (s + row.iter().sum::<f64>(), n + row.len()));
                sum / n as f64
            };
            (0..w * h).map(of).collect()
        };
        let images = self.images.iter().map(|(part, images)| (*part, images.iter().map(mean).collect()));
        Self { variant: self.variant, width: w, height: h, images: images.collect(), truth: vec![] }
    }

    /// Returns an image divided by the photograph. Pixels in which the photograph is dark are 0.
    pub fn over_photograph(&self, image: &[f64]) -> Vec<f64> {
        let photograph = self.photograph();
        let share = |(v, all): (&f64, &f64)| if *all > 0.0 { v / all } else { 0.0 };
        image.iter().zip(photograph).map(share).collect()
    }
}

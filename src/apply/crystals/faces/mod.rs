//! Measures the surface profile of crystals (Baek & Heide 2021, Fig. 7) by the element −(3,3) of epipolar
//! light. Reflection from rough faces causes this element. The profile is compared with the renderer's
//! labels. A second comparison uses the closed form of a single reflection at the true normals.
//!
//! One reflection by glass at an angle below Brewster's angle reverses the handedness of circular
//! polarization, so (3,3) is negative. A diffuse ground behind the crystal does not preserve circular
//! polarization. The paths of internal reflections have various lengths, so the crystal's retardance changes
//! the polarization of each reflection differently. The method learns nothing. Training variants are listed
//! because every application requires training variants.

pub mod predicted;

use super::mineral::Mineral;
use super::predicted::MIDDLE;
use crate::application::{Application, Method, Metric, Outcome, Picture, Plan, Score, Size, Truth, itself};
use crate::error::ApplyError;
use crate::map::Map;
use crate::metrics::isolation::{classes, correlation, parted};
use crate::metrics::roc::area;
use crate::observation::{self, Observation, Pixels};
use crate::paths::{Path, Paths};
use nalgebra::Vector3;
use predicted::Glass;

const METRICS: [Metric; 5] = [
    Metric::new("correlation with one reflection at the true normals", "", true),
    Metric::new("surface light, area under the curve", "", true),
    Metric::new("correlation with the surface's light", "", true),
    Metric::new("correlation with what stands behind", "", false),
    Metric::new("edges of faces, area under the curve", "", true),
];

/// An image that is evaluated as a surface profile.
#[derive(Clone, Copy)]
enum Image {
    /// The element 4 i + j of epipolar light, times a sign.
    Epipolar(usize, f64),
    /// An element of all light, times a sign.
    All(usize, f64),
    /// An element of non-epipolar light, times a sign.
    Other(usize, f64),
    /// The closed form for the true normals.
    Predicted,
}

const METHODS: [(Method, Image); 7] = [
    (Method::new("-(3,3), epipolar", "Baek & Heide 2021"), Image::Epipolar(15, -1.0)),
    (Method::new("-(3,3), all light", "without spatial probing"), Image::All(15, -1.0)),
    (Method::new("-(3,3), non-epipolar", "the rest"), Image::Other(15, -1.0)),
    (Method::new("(1,1), epipolar", "a pair of linear polarizers"), Image::Epipolar(5, 1.0)),
    (Method::new("intensity, epipolar", "O'Toole et al. 2012"), Image::Epipolar(0, 1.0)),
    (Method::new("intensity", "a photo"), Image::All(0, 1.0)),
    (Method::new("true normals", "closed form, a bound"), Image::Predicted),
];

/// Minimum fraction of surface-reflected light in a positive pixel.
const SHARE: f64 = 0.1;

/// Minimum fraction of a pixel's area that the crystal covers. Other pixels are not evaluated.
const WHOLE: f64 = 0.999;

/// Minimum cosine between the normals of two pixels of the same face (1°).
const SAME_FACE_COS: f64 = 0.999_848;
const UNLIKE: f64 = 0.984_808;

pub(crate) fn application() -> Application {
    let layer = |name, layer| Truth::Layer { name, layer, through: false };
    Application {
        name: "crystals-faces",
        shows: "the profile of a crystal's rough faces in -(3,3) of epipolar light, compared with true normals and labels (Fig. 7)",
        plan: Plan {
            scene: "crystals/faces.toml",
            train: vec![0],
            // Variants 1 to 3 were used to define the metrics.
            test: (4..11).collect(),
            slices: vec!["polarimetric", "epipolar"],
            truth: vec![
                Truth::Material { name: "crystal", of: &["quartz"] },
                layer("normal", "geometric_normal"),
                layer("position", "position"),
                Truth::Slice { name: "paths", slice: "paths", of: itself, samples: 1 },
            ],
            preview: Size { pixels: 64, spp: 512 },
            full: Size { pixels: 128, spp: 1024 },
        },
        methods: METHODS.iter().map(|m| m.0).collect(),
        drawn: vec![],
        metrics: METRICS.to_vec(),
        run,
        task: None,
    }
}

fn run(train: &[Observation], test: &[Observation]) -> Result<Outcome, ApplyError> {
    let [_, test] = observation::seen(train, test, Seen::new)?;
    let mut outcome = Outcome::default();
    for seen in &test {
        for (method, image) in METHODS {
            let values = seen.values(image);
            let scores = Score::each(method.name, seen.variant, &METRICS, seen.judge(&values));
            outcome.scores.extend(scores);
            outcome.pictures.push(seen.picture(method.name, "image", &values));
        }
        outcome.pictures.push(seen.picture("true normals", "surface light", &seen.surface));
    }
    Ok(outcome)
}

/// Returns the pixels of the crystal whose normals equal the normals of all neighbouring crystal pixels.
fn of_one_face([w, h]: [usize; 2], is_face: &[bool], normal: &[Vector3<f64>]) -> Vec<usize> {
    let equal = |i: usize, j: usize| !is_face[j] || normal[i].dot(&normal[j]) > SAME_FACE_COS;
    let inner = |i: usize| {
        let (x, y) = (i % w, i / w);
        is_face[i]
            && (x == 0 || equal(i, i - 1))
            && (x + 1 == w || equal(i, i + 1))
            && (y == 0 || equal(i, i - w))
            && (y + 1 == h || equal(i, i + w))
    };
    (0..w * h).filter(|i| inner(*i)).collect()
}

struct Seen {
    variant: u64,
    size: [usize; 2],
    all: Pixels,
    epipolar: Pixels,
    /// Whether the crystal covers the whole pixel.
    is_face: Vec<bool>,
    /// Pixels whose neighbours are on the same face. At other pixels, the mean normal is not the
    /// normal of a face.
    faces: Vec<usize>,
    normal: Vec<Vector3<f64>>,
    /// −(3,3) according to the closed form, or 0 outside the crystal.
    predicted: Vec<f64>,
    /// Intensity of the light that the surface alone reflects, and intensity of all light.
    surface: Vec<f64>,
    total: Vec<f64>,
}

impl Seen {
    fn new(o: &Observation) -> Result<Self, ApplyError> {
        let rig = o.rig()?;
        let glass = Glass {
            index: Mineral::Quartz.indices(MIDDLE).iter().sum::<f64>() / 2.0,
            alpha: o.value("roughness")?,
        };
        let (all, epipolar) = (o.pixels("polarimetric", true)?, o.pixels("epipolar", true)?);
        let paths = Paths::read(o, "paths")?;
        let [share, normal, position] = ["crystal", "normal", "position"].map(|name| o.truth(name));
        let (share, normal, position) = (share?, normal?, position?);
        let size = rig.camera.resolution;
        let equal = [&all, &epipolar].iter().all(|p| [p.width, p.height] == size)
            && [(share, 1), (normal, 3), (position, 3)]
                .iter()
                .all(|(m, channels)| ([m.width, m.height], m.channels) == (size, *channels))
            && [paths.width, paths.height] == size;
        if !equal {
            return Err(o.sizes("the camera, slices and truth"));
        }
        let vector = |m: &Map, i: usize| Vector3::from_column_slice(&m.data[3 * i..3 * i + 3]);
        let count = size[0] * size[1];
        let normal: Vec<Vector3<f64>> = (0..count).map(|i| vector(normal, i)).collect();
        let is_face: Vec<bool> =
            (0..count).map(|i| share.data[i] >= WHOLE && normal[i].iter().all(|x| x.is_finite())).collect();
        let faces = of_one_face(size, &is_face, &normal);
        if faces.is_empty() {
            return Err(o.no_pixel("a single face of the crystal"));
        }
        let mut predicted = vec![0.0; count];
        for i in (0..count).filter(|i| is_face[*i]) {
            predicted[i] = glass.reflected(rig, vector(position, i), normal[i]);
        }
        Ok(Self {
            variant: o.variant,
            size,
            all,
            epipolar,
            faces,
            is_face,
            normal,
            predicted,
            surface: paths.of(Path::single_specular).data,
            total: paths.all().data,
        })
    }

    /// Returns an image, summed over wavelengths.
    fn values(&self, image: Image) -> Vec<f64> {
        let of = |p: &Pixels, i: usize, e: usize| (0..p.wavelengths).map(|k| p.at(i, 0, e, k)).sum::<f64>();
        (0..self.total.len())
            .map(|i| match image {
                Image::Epipolar(e, sign) => sign * of(&self.epipolar, i, e),
                Image::All(e, sign) => sign * of(&self.all, i, e),
                Image::Other(e, sign) => sign * (of(&self.all, i, e) - of(&self.epipolar, i, e)),
                Image::Predicted => self.predicted[i],
            })
            .collect()
    }

    fn judge(&self, image: &[f64]) -> [f64; METRICS.len()] {
        let of = |values: &[f64]| self.faces.iter().map(|i| values[*i]).collect::<Vec<f64>>();
        let behind: Vec<f64> = self.total.iter().zip(&self.surface).map(|(a, s)| a - s).collect();
        let (positive, negative) = parted(image, &classes(&self.surface, &self.total, SHARE));
        let seen = of(image);
        [
            correlation(&seen, &of(&self.predicted)),
            area(&positive, &negative),
            correlation(&seen, &of(&self.surface)),
            correlation(&seen, &of(&behind)).abs(),
            self.edges(image),
        ]
    }

    /// Returns the area under the ROC curve for detecting edges by the difference between two pixels at
    /// distance two. Pairs across an edge are positives, and pairs within a face are negatives.
    fn edges(&self, image: &[f64]) -> f64 {
        let [w, h] = self.size;
        let (mut across, mut within) = (vec![], vec![]);
        for (step, [columns, rows]) in [(1, [w.saturating_sub(2), h]), (w, [w, h.saturating_sub(2)])] {
            for a in (0..rows).flat_map(|y| (0..columns).map(move |x| y * w + x)) {
                let trio = [a, a + step, a + 2 * step];
                if !trio.iter().all(|i| self.is_face[*i]) {
                    continue;
                }
                let cos = |i: usize, j: usize| self.normal[trio[i]].dot(&self.normal[trio[j]]);
                let difference = (image[trio[0]] - image[trio[2]]).abs();
                if cos(0, 2) < UNLIKE {
                    across.push(difference);
                } else if cos(0, 1) > SAME_FACE_COS && cos(1, 2) > SAME_FACE_COS {
                    within.push(difference);
                }
            }
        }
        area(&across, &within)
    }

    fn picture(&self, method: &'static str, name: &'static str, values: &[f64]) -> Picture {
        let [w, h] = self.size;
        Picture {
            method,
            name,
            variant: Some(self.variant),
            shared: false,
            map: Map { width: w, height: h, channels: 1, data: values.to_vec() },
        }
    }
}

#[cfg(test)]
mod tests;

//! Decomposes the Mueller matrices of a variant of the slab for every kind of light.

use super::measured::{Decomposed, Measured, slab};
use super::mineral::Mineral;
use super::predicted::{Pixel, Slab};
use crate::error::ApplyError;
use crate::observation::{Observation, Pixels};
use nalgebra::{Matrix4, Vector3};
use rayon::prelude::*;
use tensor::axes::AxisKind;

/// The light whose matrix is decomposed. The matrix is first multiplied by the inverse of a matrix M₀.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Probe {
    /// Epipolar light, multiplied by the inverse matrix of the plate.
    Epipolar,
    NonEpipolar,
    /// The brighter of epipolar and non-epipolar light in each pixel.
    Brighter,
    /// All light, multiplied by the inverse matrix of the plate.
    All,
    /// All light, multiplied by the inverse matrix of an ideal mirror.
    AllBeforeMirror,
    /// All light, without correction.
    AllAsItIs,
}

/// Decompositions for every pixel of the slab and every wavelength.
pub(super) type Found = Vec<Vec<Option<Decomposed>>>;

pub(super) struct Seen {
    pub variant: u64,
    pub seed: u64,
    pub size: [usize; 2],
    pub mineral: Mineral,
    pub wavelengths: Vec<f64>,
    pub pixels: Vec<Pixel>,
    epipolar: Found,
    nonepipolar: Found,
    all: [Found; 3],
    /// For each pixel, whether epipolar light is brighter than non-epipolar light.
    along: Vec<bool>,
}

fn measured(p: &Pixels, pixel: usize, lane: usize) -> Measured {
    Measured {
        mean: Matrix4::from_fn(|i, j| p.at(pixel, 0, 4 * i + j, lane)),
        error: Matrix4::from_fn(|i, j| p.error_at(pixel, 0, 4 * i + j, lane)),
    }
}

impl Seen {
    pub(super) fn new(o: &Observation) -> Result<Self, ApplyError> {
        let rig = o.rig()?;
        let mineral = o.words.get("mineral").and_then(|name| Mineral::named(name));
        let mineral = mineral.ok_or_else(|| o.missing("known mineral in the parameter", "mineral"))?;
        let axis = Vector3::new(o.value("axis_x")?, o.value("axis_y")?, -1.0).normalize();
        let message = Slab { mineral, axis, thickness: o.value("thickness")? };
        let mean = &o.slice("polarimetric")?.mean;
        let wavelengths: Vec<f64> =
            mean.find(AxisKind::Wavelength).map(|at| mean.axes[at].coords.clone()).ok_or_else(|| {
                ApplyError::Axis { variant: o.variant, slice: "polarimetric".into(), axis: "wavelengths" }
            })?;
        let [polarimetric, epipolar, nonepipolar, without] =
            ["polarimetric", "epipolar", "nonepipolar", "without"].map(|name| o.pixels(name, true));
        let (polarimetric, epipolar, nonepipolar, without) =
            (polarimetric?, epipolar?, nonepipolar?, without?);
        let size = rig.camera.resolution;
        for p in [&polarimetric, &epipolar, &nonepipolar, &without] {
            if [p.width, p.height] != size || p.wavelengths != wavelengths.len() || p.bins != 1 {
                return Err(o.sizes("the camera and slices"));
            }
        }
        let pixels = message.pixels(&rig.camera, o, &wavelengths)?;
        if pixels.is_empty() {
            return Err(o.no_pixel("the slab through only its front and back faces"));
        }
        let plate = |pixel: usize, lane: usize| measured(&without, pixel, lane).mean.try_inverse();
        let mirror = Matrix4::from_diagonal(&[1.0, 1.0, -1.0, -1.0].into());
        let decomposed = |light: &Pixels, inverse: &(dyn Fn(usize, usize) -> Option<Matrix4<f64>> + Sync)| {
            let lane = |pixel: usize, lane: usize| {
                let m = measured(light, pixel, lane);
                (m.mean[(0, 0)] > 0.0).then(|| slab(&m, &inverse(pixel, lane)?))?
            };
            pixels
                .par_iter()
                .map(|p| (0..wavelengths.len()).map(|k| lane(p.pixel, k)).collect())
                .collect::<Found>()
        };
        let brightness =
            |light: &Pixels, pixel| -> f64 { (0..light.wavelengths).map(|k| light.at(pixel, 0, 0, k)).sum() };
        Ok(Self {
            variant: o.variant,
            seed: o.seed,
            size,
            mineral,
            epipolar: decomposed(&epipolar, &plate),
            nonepipolar: decomposed(&nonepipolar, &plate),
            all: [
                decomposed(&polarimetric, &plate),
                decomposed(&polarimetric, &|_, _| Some(mirror)),
                decomposed(&polarimetric, &|_, _| Some(Matrix4::identity())),
            ],
            along: pixels
                .iter()
                .map(|p| brightness(&epipolar, p.pixel) >= brightness(&nonepipolar, p.pixel))
                .collect(),
            wavelengths,
            pixels,
        })
    }

    /// Returns the decompositions of the slab's pixel with list index `i`, at every wavelength.
    pub(super) fn found(&self, probe: Probe, i: usize) -> &[Option<Decomposed>] {
        match probe {
            Probe::Epipolar => &self.epipolar[i],
            Probe::NonEpipolar => &self.nonepipolar[i],
            Probe::Brighter if self.along[i] => &self.epipolar[i],
            Probe::Brighter => &self.nonepipolar[i],
            Probe::All => &self.all[0][i],
            Probe::AllBeforeMirror => &self.all[1][i],
            Probe::AllAsItIs => &self.all[2][i],
        }
    }
}

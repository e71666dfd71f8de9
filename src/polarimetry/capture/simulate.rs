//! Simulates captures. For each capture of a scheme, the simulation computes a detector's readings of known
//! Mueller matrices.
//!
//! The forward model consists of one [`DesignMatrix`] per wavelength. Simulation and reconstruction therefore
//! use the same model, and differences between the known and the reconstructed matrices are due to noise
//! alone. Rays are given per wavelength along the optical axis, or per pixel and wavelength. In the second
//! case, the simulation includes errors of plates and mirrors that depend on direction. An example is the
//! error of the galvo of a coaxial rig.
//!
//! Readings are in the units of the matrices, after subtraction of the dark signal. Saturated readings are
//! NaN. Every number depends on the seed, the pixel and the measurement, but not on the number of threads.

use super::design_matrix::{DesignMatrix, ELEMENTS, rows};
use super::detector::cmos::{Cmos, Exposed};
use super::detector::error::{DetectorError, count, demand};
use super::detector::polarizer_array::{Method, demosaic, demosaic_variance, mosaic};
use super::detector::random::stream;
use super::detector::spad::Spad;
use super::element::Ray;
use super::scheme::Scheme;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// The order of pixels. The axes are rows from the top, columns, axes of separate captures (time bins,
/// projector pixels), and wavelengths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    pub height: usize,
    pub width: usize,
    /// Number of time bins, or of other images that are captured separately.
    pub times: usize,
    /// Number of wavelengths.
    pub lanes: usize,
}

impl Layout {
    /// Returns the number of matrices.
    pub fn pixels(&self) -> usize {
        let area = self.height.saturating_mul(self.width);
        area.saturating_mul(self.times).saturating_mul(self.lanes)
    }
}

/// The model of the detector, which converts intensities to readings.
#[derive(Clone, Debug, PartialEq)]
pub enum Noise {
    /// No noise.
    None,
    /// Normal noise of constant standard deviation.
    Gaussian {
        /// Standard deviation in the units of the matrices.
        sigma: f64,
    },
    /// A camera. Images at other times or wavelengths are separate frames.
    Cmos {
        camera: Cmos,
        /// Demosaicking method for a polarizer array, or `None` if every pixel records all four channels.
        demosaic: Option<Method>,
    },
    /// A diode per pixel. The counter of the diode has the time bins of the layout, which start at the laser
    /// pulse. Readings include the timing jitter (see [`super::detector::spad`]).
    Spad(Spad),
}

#[derive(Clone, Debug, PartialEq)]
pub struct Captured {
    /// Readings in the units of the matrices. The readings are sorted by measurement (as the rows of the
    /// design matrix), then by pixel.
    pub intensities: Vec<f32>,
    /// Variances of a camera's readings. Saturated readings have infinite variance. The value is `None` for a
    /// diode, because the estimated variance of bins without counts would be 0.
    pub variances: Option<Vec<f32>>,
    pub saturated: usize,
    /// Layout of the readings. With binning or superpixels, the layout has half the height and half the
    /// width.
    pub layout: Layout,
}

impl Captured {
    /// Returns the root mean square of the noise's standard deviation, in the units of the matrices. Returns
    /// `None` if the standard deviation is unknown, as for a diode.
    pub fn typical_noise(&self, noise: &Noise) -> Option<f64> {
        match (noise, &self.variances) {
            (Noise::None, _) => Some(0.0),
            (Noise::Gaussian { sigma }, _) => Some(*sigma),
            (_, Some(variances)) => {
                let known = variances.iter().copied().map(f64::from).filter(|v| v.is_finite());
                let (n, sum) = known.fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
                (n > 0.0).then(|| f64::sqrt(sum / n))
            }
            _ => None,
        }
    }
}

/// Simulates all captures of a scheme.
///
/// `matrices` holds 16 elements per pixel, row-major (Stokes out first), in the order of `layout`. `rays`
/// holds the ray of each wavelength, or the ray of each pixel and wavelength
/// ([`super::directions::Directions::rays`]). Cameras and diodes treat negative intensities (from unphysical
/// matrices) as zero.
///
/// # Errors
/// Returns [`DetectorError`] in the following cases:
/// - Lengths do not match `layout`.
/// - Settings are invalid or do not fit the layout.
/// - Values are not finite.
pub fn simulate(
    matrices: &[f64],
    layout: Layout,
    scheme: &Scheme,
    rays: &[Ray],
    noise: &Noise,
    seed: u64,
) -> Result<Captured, DetectorError> {
    let pixels = layout.pixels();
    let elements = pixels.saturating_mul(ELEMENTS);
    count("the elements of all matrices", elements, matrices.len())?;
    let all = layout.height.saturating_mul(layout.width).saturating_mul(layout.lanes);
    if rays.len() != all {
        count("the rays of all wavelengths", layout.lanes, rays.len())?;
    }
    // Random streams have 32-bit indices.
    count("the pixels of one capture", pixels.min(u32::MAX as usize), pixels)?;
    let keys = scheme.measurements().saturating_mul(layout.times.saturating_mul(layout.lanes));
    count("the frames of all captures", keys.min(u32::MAX as usize), keys)?;
    let job = Job {
        matrices,
        layout,
        rays,
        scheme,
        designs: if rays.len() == layout.lanes {
            let of = |ray| rows_of(&DesignMatrix::new(scheme, ray));
            rays.iter().map(of).collect()
        } else {
            vec![]
        },
        measurements: scheme.measurements(),
        seed,
    };
    match noise {
        Noise::None => Ok(job.gaussian(0.0)),
        Noise::Gaussian { sigma } => {
            let good = *sigma >= 0.0 && sigma.is_finite();
            demand("sigma", *sigma, good, "zero or a positive number")?;
            Ok(job.gaussian(*sigma))
        }
        Noise::Cmos { camera, demosaic } => {
            let method = demosaic.filter(|_| scheme.sensor.channels() == 4);
            job.camera(camera, method)
        }
        Noise::Spad(diode) => job.diode(diode),
    }
}

/// Returns the means of matrices over binned pixels. These means are the ground truth for captures of layout
/// `to`.
pub fn averaged(matrices: &[f64], from: Layout, to: Layout) -> Vec<f64> {
    let (fy, fx) = (from.height / to.height.max(1), from.width / to.width.max(1));
    let inner = from.times * from.lanes * ELEMENTS;
    let (fy, fx) = (fy.clamp(1, 2), fx.clamp(1, 2));
    if (fy, fx) == (1, 1) {
        return matrices.to_vec();
    }
    let mut out = vec![0.0; to.height * to.width * inner];
    let share = 1.0 / (fy * fx) as f64;
    for (place, out) in out.chunks_exact_mut(inner.max(1)).enumerate() {
        let (y, x) = (place / to.width, place % to.width);
        for k in 0..fy * fx {
            let at = ((y * fy + k / fx) * from.width + x * fx + k % fx) * inner;
            for (o, v) in out.iter_mut().zip(&matrices[at..at + inner]) {
                *o += share * v;
            }
        }
    }
    out
}

/// Returns the rows of a design matrix as contiguous arrays.
fn rows_of(design: &DesignMatrix) -> Vec<[f64; ELEMENTS]> {
    let of = |m| std::array::from_fn(|e| design.a[(m, e)]);
    (0..design.a.nrows()).map(of).collect()
}

/// The rows of one measurement. If every pixel has its own ray, the most recently computed row is cached.
struct Rows<'a> {
    job: &'a Job<'a>,
    m: usize,
    last: Option<(usize, [f64; ELEMENTS])>,
}

impl Rows<'_> {
    /// Returns the noise-free intensity at a pixel.
    fn clean(&mut self, pixel: usize) -> f64 {
        let job = self.job;
        let index = job.ray(pixel);
        let row = match (job.designs.get(index), self.last) {
            (Some(design), _) => design[self.m],
            (None, Some((i, row))) if i == index => row,
            _ => {
                let channels = job.scheme.sensor.channels();
                let sets = job.scheme.sets(self.m / channels);
                let mut all = rows(job.scheme, &sets, &job.rays[index]);
                let row = all.nth(self.m % channels).unwrap_or([0.0; ELEMENTS]);
                self.last = Some((index, row));
                row
            }
        };
        let matrix = &job.matrices[pixel * ELEMENTS..][..ELEMENTS];
        row.iter().zip(matrix).map(|(a, t)| a * t).sum()
    }
}

/// Data that all noise models share.
struct Job<'a> {
    matrices: &'a [f64],
    layout: Layout,
    rays: &'a [Ray],
    scheme: &'a Scheme,
    /// Rows of the design matrices, by wavelength, then by measurement. The list is empty if every pixel has
    /// its own ray.
    designs: Vec<Vec<[f64; ELEMENTS]>>,
    measurements: usize,
    seed: u64,
}

impl Job<'_> {
    /// Returns the index of a pixel's ray.
    fn ray(&self, pixel: usize) -> usize {
        let Layout { times, lanes, .. } = self.layout;
        if self.rays.len() == lanes { pixel % lanes } else { pixel / (times * lanes) * lanes + pixel % lanes }
    }

    /// Returns the rows of measurement `m`, which callers read for consecutive pixels.
    fn rows(&self, m: usize) -> Rows<'_> {
        Rows { job: self, m, last: None }
    }

    fn gaussian(&self, sigma: f64) -> Captured {
        let pixels = self.layout.pixels();
        let mut out = vec![0.0_f32; self.measurements * pixels];
        out.par_chunks_mut(pixels.max(1)).enumerate().for_each(|(m, out)| {
            let mut rows = self.rows(m);
            for (p, o) in out.iter_mut().enumerate() {
                let mut value = rows.clean(p);
                if sigma > 0.0 {
                    let z: f64 = StandardNormal.sample(&mut stream(self.seed, p as u32, m as u32));
                    value += sigma * z;
                }
                *o = value as f32;
            }
        });
        Captured { intensities: out, variances: None, saturated: 0, layout: self.layout }
    }

    fn camera(&self, camera: &Cmos, method: Option<Method>) -> Result<Captured, DetectorError> {
        camera.check()?;
        if method.is_some() {
            let need = "1, because `demosaic` is set";
            demand("binning", f64::from(camera.binning), camera.binning == 1, need)?;
        }
        let halved = camera.binning == 2 || method == Some(Method::Superpixel);
        let side = if halved { 2 } else { 1 };
        let Layout { height, width, times, lanes } = self.layout;
        let layout = Layout { height: height / side, width: width / side, ..self.layout };
        // Number of measurements per exposure.
        let group = if method.is_some() { 4 } else { 1 };
        let pixels = layout.pixels();
        let mut intensities = vec![0.0_f32; self.measurements * pixels];
        let mut variances = intensities.clone();
        let planes = (group * pixels).max(1);
        let exposure = |(g, (intensities, variances)): (usize, (&mut [f32], &mut [f32]))| {
            let mut saturated = 0;
            for inner in 0..times * lanes {
                let image = |m: usize| -> Vec<f64> {
                    let places = 0..height * width;
                    let mut rows = self.rows(m);
                    places.map(|yx| rows.clean(yx * times * lanes + inner)).collect()
                };
                let key = (g * times * lanes + inner) as u32;
                let nm = self.rays[inner % lanes].nm;
                let shoot = |image: &[f64]| camera.capture(image, width, height, nm, self.seed, key);
                let seen = match method {
                    None => vec![shoot(&image(g))?],
                    Some(method) => {
                        let channels: [Vec<f64>; 4] = std::array::from_fn(|c| image(4 * g + c));
                        let raw = mosaic(channels.each_ref().map(Vec::as_slice), width, height)?;
                        taken_apart(&shoot(&raw)?, method)?
                    }
                };
                for (c, exposed) in seen.iter().enumerate() {
                    saturated += exposed.saturated.iter().filter(|s| **s).count();
                    for yx in 0..layout.height * layout.width {
                        let at = c * pixels + yx * times * lanes + inner;
                        intensities[at] = exposed.radiance[yx] as f32;
                        variances[at] = exposed.variance[yx] as f32;
                    }
                }
            }
            Ok(saturated)
        };
        let saturated = intensities
            .par_chunks_mut(planes)
            .zip(variances.par_chunks_mut(planes))
            .enumerate()
            .map(exposure)
            .try_reduce(|| 0, |a, b| Ok(a + b))?;
        Ok(Captured { intensities, variances: Some(variances), saturated, layout })
    }

    fn diode(&self, diode: &Spad) -> Result<Captured, DetectorError> {
        diode.check()?;
        let Layout { times, lanes, .. } = self.layout;
        count("the time bins (`bins` of the diode)", diode.bins, times)?;
        let pixels = self.layout.pixels();
        let mut intensities = vec![0.0_f32; self.measurements * pixels];
        let capture = |(m, out): (usize, &mut [f32])| {
            let mut saturated = 0;
            let mut rows: Vec<Rows<'_>> = (0..lanes).map(|_| self.rows(m)).collect();
            for (yx, out) in out.chunks_exact_mut((times * lanes).max(1)).enumerate() {
                for (lane, rows) in rows.iter_mut().enumerate() {
                    let nm = self.rays[lane].nm;
                    let bins = 0..times;
                    let histogram = bins.map(|t| rows.clean((yx * times + t) * lanes + lane));
                    let rates = diode.rates(&histogram.collect::<Vec<_>>(), nm)?;
                    let mut stream = stream(self.seed, (yx * lanes + lane) as u32, m as u32);
                    let counts = diode.count(&rates, &mut stream)?;
                    for (t, found) in diode.estimate(&counts, nm)?.iter().enumerate() {
                        saturated += usize::from(found.saturated);
                        out[t * lanes + lane] = found.radiance as f32;
                    }
                }
            }
            Ok(saturated)
        };
        let saturated = intensities
            .par_chunks_mut(pixels.max(1))
            .enumerate()
            .map(capture)
            .try_reduce(|| 0, |a, b| Ok(a + b))?;
        Ok(Captured { intensities, variances: None, saturated, layout: self.layout })
    }
}

/// Returns the four channels of a raw frame. A position of a channel is marked as saturated if no valid pixel
/// contributes to this position.
fn taken_apart(raw: &Exposed, method: Method) -> Result<Vec<Exposed>, DetectorError> {
    let radiance = demosaic(&raw.radiance, raw.width, raw.height, method)?;
    let variance = demosaic_variance(&raw.variance, raw.width, raw.height, method)?;
    let (width, height) = (radiance.width, radiance.height);
    let known = |v: &f64| if v.is_nan() { f64::INFINITY } else { *v };
    let channels = radiance.images.into_iter().zip(variance.images);
    let exposed = channels.map(|(radiance, variance)| Exposed {
        saturated: radiance.iter().map(|v| v.is_nan()).collect(),
        variance: variance.iter().map(known).collect(),
        radiance,
        width,
        height,
    });
    Ok(exposed.collect())
}

#[cfg(test)]
mod tests;

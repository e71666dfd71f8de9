//! Reconstructs whole images. If all measurements have equal weight, the images are reconstructed by a fast
//! matrix product. If weights differ, each pixel is solved individually.
//!
//! A pixel is any item with one intensity per measurement: a position in an image, a time bin or a
//! wavelength. If the last axis is the wavelength, consecutive pixels cycle through the design matrices.
//! Estimates are f32 or f64, as the intensities are. Pixels that are solved individually use f64.

use super::estimator::LinearEstimate;
use super::product::Weights;
use super::second_moment::{Moment, root};
use super::weighted::{Estimated, estimate};
use crate::capture::design_matrix::{DesignMatrix, RankError};
use crate::capture::element::Ray;
use crate::capture::scheme::Scheme;
use crate::decompose::cloude::nearest;
use rayon::prelude::*;
use tensor::number::Number;

#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Standard deviation of an intensity. If `None`, errors are estimated from the residuals.
    pub noise: Option<f64>,
    /// Saturation level. If an intensity is at least this value, the intensity is ignored for its pixel.
    pub saturation: Option<f64>,
    /// Whether each matrix is replaced by the nearest realizable matrix (see [`crate::decompose::cloude`]).
    pub realizable: bool,
    /// Prior, which is the second moment of matrices with T00 = 1.
    pub prior: Option<Moment>,
}

/// Counts of reconstructed pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    pub pixels: usize,
    /// Number of pixels that are estimated without some of their measurements.
    pub partial: usize,
    /// Number of pixels whose remaining measurements do not determine a matrix. The results of these pixels
    /// are NaN.
    pub lost: usize,
}

impl Tally {
    /// Returns the sum of this tally and another tally.
    pub fn with(self, other: Self) -> Self {
        Self {
            pixels: self.pixels + other.pixels,
            partial: self.partial + other.partial,
            lost: self.lost + other.lost,
        }
    }
}

/// Number of precomputed estimators with a prior. The ratio of noise to brightness starts at 2^-24 and
/// increases by a factor of √2 per estimator.
const STEPS: i32 = 64;
const FIRST: i32 = -48;

/// The estimators of one wavelength.
struct Lane<T> {
    a: DesignMatrix,
    /// Least-squares estimator, or `None` below rank 16.
    least: Option<(Weights<T>, LinearEstimate)>,
    /// Estimators with the prior, sorted by the ratio of noise to brightness.
    priors: Vec<(Weights<T>, LinearEstimate)>,
    /// Expected sum of squared intensities at brightness 1, tr A S Aᵀ.
    expected: f64,
}

/// The estimators of all wavelengths of a scheme.
pub struct Reconstruction<T> {
    lanes: Vec<Lane<T>>,
    options: Options,
    root: Option<Moment>,
}

/// A pixel's estimate, and whether measurements of the pixel were ignored.
struct Solved {
    found: Option<Estimated>,
    partial: bool,
}

/// A number type of images. Loops over pixels of this type are compiled in this crate, together with the
/// matrix product. The compiler can therefore merge the loop and the product into one loop.
pub trait PixelNumber: Number {
    /// Computes [`Reconstruction::apply`] for this number type.
    fn reconstruct(
        estimates: &Reconstruction<Self>,
        intensities: &[Self],
        variances: Option<&[Self]>,
        out: &mut [Self],
        errors: Option<&mut [Self]>,
    ) -> Tally;
}

macro_rules! pixel_number {
    ($($number:ty),*) => {$(
        impl PixelNumber for $number {
            #[inline(never)]
            fn reconstruct(
                estimates: &Reconstruction<Self>,
                intensities: &[Self],
                variances: Option<&[Self]>,
                out: &mut [Self],
                errors: Option<&mut [Self]>,
            ) -> Tally {
                estimates.reconstruct(intensities, variances, out, errors)
            }
        }
    )*};
}

pixel_number!(f32, f64);

impl<T: Number> Reconstruction<T> {
    /// Prepares the estimators. There is one estimator per ray.
    ///
    /// # Errors
    /// Returns an error if the captures do not determine a Mueller matrix and there is no prior.
    pub fn new(scheme: &Scheme, rays: &[Ray], options: Options) -> Result<Self, RankError> {
        let lane = |ray: &Ray| -> Result<Lane<T>, RankError> {
            let a = DesignMatrix::new(scheme, ray);
            let least = LinearEstimate::least_squares(&a).map(|e| (Weights::new(&e), e));
            let (mut priors, mut expected) = (vec![], 0.0);
            if let Some(s) = &options.prior {
                let dynamic = nalgebra::DMatrix::from_fn(16, 16, |i, j| s[(i, j)]);
                expected = (&a.a * dynamic * a.a.transpose()).trace();
                priors.extend((0..STEPS).map(|i| {
                    let e = LinearEstimate::prior(&a, s, 2.0_f64.powf(f64::from(FIRST + i) / 2.0));
                    (Weights::new(&e), e)
                }));
            }
            let least = if options.prior.is_some() { least.ok() } else { Some(least?) };
            Ok(Lane { a, least, priors, expected })
        };
        Ok(Self {
            lanes: rays.iter().map(lane).collect::<Result<_, _>>()?,
            root: options.prior.as_ref().map(root),
            options,
        })
    }

    /// Returns the number of wavelengths that consecutive pixels cycle through.
    pub fn lanes(&self) -> usize {
        self.lanes.len()
    }

    /// Returns the number of intensities per pixel.
    pub fn measurements(&self) -> usize {
        self.lanes.first().map_or(0, |lane| lane.a.a.nrows())
    }
}

impl<T: PixelNumber> Reconstruction<T> {
    /// Reconstructs pixels. The first pixel has the first wavelength. `intensities` and `variances` are
    /// sorted by measurement, then by pixel. `out` receives 16 elements per pixel, and `errors` receives the
    /// standard errors of the elements.
    ///
    /// # Panics
    /// Panics if the lengths of the arguments do not match.
    pub fn apply(
        &self,
        intensities: &[T],
        variances: Option<&[T]>,
        out: &mut [T],
        errors: Option<&mut [T]>,
    ) -> Tally {
        T::reconstruct(self, intensities, variances, out, errors)
    }
}

impl<T: Number> Reconstruction<T> {
    fn reconstruct(
        &self,
        intensities: &[T],
        variances: Option<&[T]>,
        out: &mut [T],
        errors: Option<&mut [T]>,
    ) -> Tally {
        let pixels = out.len() / 16;
        assert_eq!(intensities.len(), pixels * self.measurements(), "one per measurement and pixel");
        let fast = variances.is_none() && self.options.prior.is_none();
        if let (true, [lane]) = (fast, self.lanes.as_slice()) {
            let finite = lane.least.as_ref().is_some_and(|(weights, _)| weights.apply(intensities, out));
            let plain = errors.is_none() && self.options.saturation.is_none() && !self.options.realizable;
            if plain && finite {
                return Tally { pixels, ..Tally::default() };
            }
        }
        let done = fast && self.lanes.len() == 1;
        let each = |(p, (out, errors)): (usize, (&mut [T], Option<&mut [T]>))| -> Tally {
            let lane = &self.lanes[p % self.lanes.len()];
            let at = |m: usize| intensities[m * pixels + p];
            let variance = |m: usize| variances.map(|v| v[m * pixels + p].get());
            let known = done.then(|| std::array::from_fn(|e| out[e].get()));
            let solved = self.pixel(lane, &at, &variance, known, errors.is_some());
            let lost = solved.found.is_none();
            let found =
                solved.found.unwrap_or(Estimated { elements: [f64::NAN; 16], errors: [f64::NAN; 16] });
            let elements = self.projected(found.elements);
            for (o, v) in out.iter_mut().zip(elements) {
                *o = T::new(v);
            }
            if let Some(errors) = errors {
                for (o, v) in errors.iter_mut().zip(found.errors) {
                    *o = T::new(v);
                }
            }
            Tally { pixels: 1, partial: usize::from(solved.partial && !lost), lost: usize::from(lost) }
        };
        let rows = out.par_chunks_exact_mut(16);
        match errors {
            Some(errors) => rows
                .zip(errors.par_chunks_exact_mut(16).map(Some))
                .enumerate()
                .with_min_len(256)
                .map(each)
                .reduce(Tally::default, Tally::with),
            None => rows
                .map(|row| (row, None))
                .enumerate()
                .with_min_len(256)
                .map(each)
                .reduce(Tally::default, Tally::with),
        }
    }

    fn projected(&self, elements: [f64; 16]) -> [f64; 16] {
        if !self.options.realizable {
            return elements;
        }
        let m = std::array::from_fn(|i| std::array::from_fn(|j| elements[4 * i + j]));
        nearest(&m).map_or(elements, |m| std::array::from_fn(|e| m[e / 4][e % 4]))
    }

    /// Solves one pixel. `known` is the result of the matrix product.
    fn pixel(
        &self,
        lane: &Lane<T>,
        at: &dyn Fn(usize) -> T,
        variance: &dyn Fn(usize) -> Option<f64>,
        known: Option<[f64; 16]>,
        errors: bool,
    ) -> Solved {
        let count = lane.a.a.nrows();
        let limit = self.options.saturation.unwrap_or(f64::INFINITY);
        let usable = |m: usize| {
            let x = at(m).get();
            x < limit && x.is_finite() && variance(m).is_none_or(|v| v > 0.0 && v.is_finite())
        };
        let partial = !(0..count).all(usable);
        let brightness = || {
            let noise = self.options.noise.unwrap_or(0.0);
            let used = (0..count).filter(|m| usable(*m));
            let (n, sum) = used.fold((0, 0.0), |(n, sum), m| (n + 1, sum + at(m).get().powi(2)));
            let share = lane.expected * f64::from(n) / count.max(1) as f64;
            let signal = sum - f64::from(n) * noise.powi(2);
            // If the signal is below the noise, the brightness is unknown. The value of a tenth of the noise
            // keeps the estimate near zero.
            (signal.max(0.01 * f64::from(n) * noise.powi(2)) / share.max(1e-300)).sqrt()
        };
        if partial || variance(0).is_some() {
            let scaled = self.root.map(|root| root * brightness());
            let sigma2 = self.options.noise.map_or(1.0, |s| s * s);
            let all = (0..count).map(|m| {
                let x = if usable(m) { at(m).get() } else { f64::NAN };
                (x, variance(m).unwrap_or(sigma2))
            });
            let mut found = estimate(&lane.a.a, all, scaled.as_ref());
            if let (Some(found), true) = (&mut found, variance(0).is_none() && self.options.noise.is_none()) {
                let left = self.left_over(lane, at, &usable, &found.elements);
                found.errors.iter_mut().for_each(|e| *e *= left);
            }
            return Solved { found, partial };
        }
        let (elements, covariance, scale) = if self.options.prior.is_some() {
            let noise = self.options.noise.unwrap_or(0.0);
            let s = brightness();
            let step =
                (2.0 * (noise / s).log2()).round().clamp(f64::from(FIRST), f64::from(FIRST + STEPS - 1));
            let index = if step.is_nan() { 0 } else { step as i32 - FIRST };
            let (weights, estimate) = &lane.priors[index as usize];
            let out = weights.one((0..count).map(at)).map(Number::get);
            (out, &estimate.covariance, noise)
        } else {
            let Some((weights, estimate)) = &lane.least else {
                return Solved { found: None, partial };
            };
            let out = known.unwrap_or_else(|| weights.one((0..count).map(at)).map(Number::get));
            let scale = match self.options.noise {
                Some(sigma) => sigma,
                None if errors => self.left_over(lane, at, &usable, &out),
                None => 0.0,
            };
            (out, &estimate.covariance, scale)
        };
        let found = Estimated {
            elements,
            errors: std::array::from_fn(|e| scale * covariance[(e, e)].max(0.0).sqrt()),
        };
        Solved { found: Some(found), partial }
    }

    /// Returns the standard deviation of the noise. The value is estimated from the residuals as √(Σ r²/(n -
    /// 16)), and is NaN without redundant measurements.
    fn left_over(
        &self,
        lane: &Lane<T>,
        at: &dyn Fn(usize) -> T,
        usable: &dyn Fn(usize) -> bool,
        elements: &[f64; 16],
    ) -> f64 {
        let (mut n, mut sum) = (0.0, 0.0);
        for m in (0..lane.a.a.nrows()).filter(|m| usable(*m)) {
            let predicted: f64 = (0..16).map(|e| lane.a.a[(m, e)] * elements[e]).sum();
            sum += (at(m).get() - predicted).powi(2);
            n += 1.0;
        }
        if n > 16.0 { (sum / (n - 16.0)).sqrt() } else { f64::NAN }
    }
}

#[cfg(test)]
mod tests;

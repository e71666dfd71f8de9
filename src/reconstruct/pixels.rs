//! Reconstruction of whole images, piece by piece: the fast product where all measurements are alike, pixel by pixel where
//! they are not.
//!
//! A pixel is anything that has one intensity a measurement: a place of an image, a time bin, a wavelength. Where the last
//! axis is the wavelength, pixels go round the designs. The estimate is f32 or f64 as the intensities are; what is solved
//! pixel by pixel is f64.

use super::estimator::LinearEstimate;
use super::loss::{Moment, root};
use super::product::Weights;
use super::weighted::{Estimated, estimate};
use crate::capture::design_matrix::{DesignMatrix, RankError};
use crate::capture::element::Ray;
use crate::capture::scheme::Scheme;
use crate::decompose::cloude::nearest;
use crate::tensor::numpy::Number;
use rayon::prelude::*;

/// How images are reconstructed.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Standard deviation of an intensity. Without it, errors come from what the estimate leaves over.
    pub noise: Option<f64>,
    /// Intensities from here on are saturated and left out, pixel by pixel.
    pub saturation: Option<f64>,
    /// Replace each matrix by the realizable one nearest to it (Cloude).
    pub realizable: bool,
    /// Second moment of matrices with T00 = 1.
    pub prior: Option<Moment>,
}

/// What became of the pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    pub pixels: usize,
    /// Estimated without some of their measurements.
    pub partial: usize,
    /// Not determined by what is left: NaN.
    pub lost: usize,
}

impl Tally {
    /// Both together.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self {
            pixels: self.pixels + other.pixels,
            partial: self.partial + other.partial,
            lost: self.lost + other.lost,
        }
    }
}

/// Halves of an octave of noise over brightness for which priors are at hand, from 2^-24 on.
const STEPS: i32 = 64;
const FIRST: i32 = -48;

/// What is known of one wavelength.
struct Lane<T> {
    a: DesignMatrix,
    /// Least squares; none below rank 16.
    least: Option<(Weights<T>, LinearEstimate)>,
    /// With the prior, by noise over brightness.
    priors: Vec<(Weights<T>, LinearEstimate)>,
    /// tr A S Aᵀ: intensities' expected sum of squares at brightness 1.
    expected: f64,
}

/// Estimates for all wavelengths of a scheme.
pub struct Reconstruction<T> {
    lanes: Vec<Lane<T>>,
    options: Options,
    root: Option<Moment>,
}

/// A pixel's estimate and whether some measurements were left out.
struct Solved {
    found: Option<Estimated>,
    partial: bool,
}

impl<T: Number> Reconstruction<T> {
    /// Prepares the estimates, one for each ray.
    ///
    /// # Errors
    /// If the captures do not determine a Mueller matrix and there is no prior.
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
            let least = if options.prior.is_some() {
                least.ok()
            } else {
                Some(least?)
            };
            Ok(Lane {
                a,
                least,
                priors,
                expected,
            })
        };
        Ok(Self {
            lanes: rays.iter().map(lane).collect::<Result<_, _>>()?,
            root: options.prior.as_ref().map(root),
            options,
        })
    }

    /// Wavelengths that pixels go round.
    #[must_use]
    pub fn lanes(&self) -> usize {
        self.lanes.len()
    }

    /// Intensities that a pixel has.
    #[must_use]
    pub fn measurements(&self) -> usize {
        self.lanes.first().map_or(0, |lane| lane.a.a.nrows())
    }

    /// Reconstructs pixels, the first of which has the first wavelength. `intensities`, and `variances` if there are any, hold
    /// the measurements one after the other, each for all pixels; `out` gets 16 elements a pixel, and `errors` their
    /// standard errors.
    ///
    /// # Panics
    /// If lengths do not agree.
    pub fn apply(
        &self,
        intensities: &[T],
        variances: Option<&[T]>,
        out: &mut [T],
        errors: Option<&mut [T]>,
    ) -> Tally {
        let pixels = out.len() / 16;
        assert_eq!(
            intensities.len(),
            pixels * self.measurements(),
            "one intensity a measurement and pixel"
        );
        let fast = variances.is_none() && self.options.prior.is_none();
        if let (true, [lane]) = (fast, self.lanes.as_slice()) {
            let finite = lane
                .least
                .as_ref()
                .is_some_and(|(weights, _)| weights.apply(intensities, out));
            let plain = errors.is_none() && self.options.saturation.is_none() && !self.options.realizable;
            if plain && finite {
                return Tally {
                    pixels,
                    ..Tally::default()
                };
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
            let found = solved.found.unwrap_or(Estimated {
                elements: [f64::NAN; 16],
                errors: [f64::NAN; 16],
            });
            let elements = self.projected(found.elements);
            for (o, v) in out.iter_mut().zip(elements) {
                *o = T::new(v);
            }
            if let Some(errors) = errors {
                for (o, v) in errors.iter_mut().zip(found.errors) {
                    *o = T::new(v);
                }
            }
            Tally {
                pixels: 1,
                partial: usize::from(solved.partial && !lost),
                lost: usize::from(lost),
            }
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

    /// One pixel. `known` is what the product gave.
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
            // Below the noise nothing says how bright a pixel is; a tenth of it keeps the estimate near zero.
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
            let step = (2.0 * (noise / s).log2())
                .round()
                .clamp(f64::from(FIRST), f64::from(FIRST + STEPS - 1));
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
        Solved {
            found: Some(found),
            partial,
        }
    }

    /// The noise's standard deviation as the residuals show it: √(Σ r²/(n - 16)); NaN without spare measurements.
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
        if n > 16.0 {
            (sum / (n - 16.0)).sqrt()
        } else {
            f64::NAN
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decompose::cloude::is_realizable;
    use crate::sampling::stream::Stream;
    use proptest::prelude::*;
    use rand_distr::{Distribution, StandardNormal};

    fn t(p: usize) -> [f64; 16] {
        std::array::from_fn(|e| {
            if e == 0 {
                1.0
            } else {
                ((p * 16 + e) as f64).sin() * 0.2
            }
        })
    }

    /// Intensities of pixels that go round the wavelengths.
    fn captured(scheme: &Scheme, rays: &[Ray], pixels: usize, sigma: f64) -> Vec<f64> {
        let designs: Vec<DesignMatrix> = rays.iter().map(|r| DesignMatrix::new(scheme, r)).collect();
        let count = scheme.measurements();
        let mut out = vec![0.0; count * pixels];
        for p in 0..pixels {
            let clean = designs[p % rays.len()].intensities(&t(p));
            let mut stream = Stream::new(1, p as u32, 0);
            for m in 0..count {
                let z: f64 = StandardNormal.sample(&mut stream);
                out[m * pixels + p] = clean[m] + sigma * z;
            }
        }
        out
    }

    fn rays() -> Vec<Ray> {
        [450.0, 550.0, 660.0].map(Ray::axial).to_vec()
    }

    fn chromatic(captures: usize) -> Scheme {
        let text = crate::capture::scheme_file::to_toml(&Scheme::qrpr(captures, false).expect("a scheme"));
        let text = text.expect("TOML").replace(
            "retardance_deg = 90.0",
            "retardance_deg = 90.0\nretardance_error_deg = [[450, 12], [550, 0], [660, -10]]",
        );
        crate::capture::scheme_file::from_toml(std::path::Path::new("c.toml"), &text).expect("a scheme")
    }

    fn worst(out: &[f64]) -> f64 {
        let off = |(p, m): (usize, &[f64])| (0..16).map(move |e| (m[e] - t(p)[e]).abs()).fold(0.0, f64::max);
        out.chunks(16).enumerate().map(off).fold(0.0, f64::max)
    }

    #[test]
    fn every_wavelength_has_its_own_optics() {
        let (scheme, rays) = (chromatic(20), rays());
        let clean = captured(&scheme, &rays, 300, 0.0);
        let mut out = vec![0.0; 300 * 16];
        let all = Reconstruction::new(&scheme, &rays, Options::default()).expect("rank 16");
        let tally = all.apply(&clean, None, &mut out, None);
        assert_eq!((tally.pixels, tally.partial, tally.lost), (300, 0, 0));
        assert!(worst(&out) < 1e-10);
        let wrong = Reconstruction::new(&scheme, &rays[1..2], Options::default()).expect("rank 16");
        wrong.apply(&clean, None, &mut out, None);
        assert!(worst(&out) > 1e-2);
    }

    /// Saturated and missing measurements cost only themselves; a pixel without enough of them is lost, not its neighbours.
    #[test]
    fn saturation_is_left_out_pixel_by_pixel() {
        let (scheme, rays) = (Scheme::drr(36, false).expect("a scheme"), rays()[..1].to_vec());
        let mut seen = captured(&scheme, &rays, 100, 0.0);
        let limit = 0.33;
        let mut clipped = 0;
        for (i, v) in seen.iter_mut().enumerate() {
            if i % 100 == 7 || (i % 100 == 9 && i > 300) {
                *v = f64::NAN;
            }
            if *v > limit {
                *v = limit;
                clipped += 1;
            }
        }
        assert!(clipped > 20);
        let options = Options {
            saturation: Some(limit),
            ..Options::default()
        };
        let mut out = vec![0.0; 1600];
        let tally = Reconstruction::new(&scheme, &rays, options)
            .expect("rank 16")
            .apply(&seen, None, &mut out, None);
        assert_eq!(tally.lost, 2);
        assert!(tally.partial > 5, "{tally:?}");
        for (p, m) in out.chunks(16).enumerate() {
            assert_eq!(m.iter().any(|v| v.is_nan()), p == 7 || p == 9);
        }
        out.drain(7 * 16..8 * 16);
        let good = out
            .chunks(16)
            .enumerate()
            .map(|(i, m)| (if i < 7 { i } else { i + 1 }, m))
            .filter(|(p, _)| *p != 9);
        for (p, m) in good {
            assert!((0..16).all(|e| (m[e] - t(p)[e]).abs() < 1e-6), "{p}");
        }
    }

    /// Stated errors are those that are made, however they are known: from σ, from a map of variances, from what is left over.
    #[test]
    fn errors_are_honest() {
        let (scheme, rays, pixels, sigma) = (chromatic(24), rays(), 6000, 1e-3);
        let seen = captured(&scheme, &rays, pixels, sigma);
        let variances = vec![sigma * sigma; seen.len()];
        for (noise, variances) in [
            (Some(sigma), None),
            (None, None),
            (None, Some(variances.as_slice())),
        ] {
            let options = Options {
                noise,
                ..Options::default()
            };
            let (mut out, mut errors) = (vec![0.0; pixels * 16], vec![0.0; pixels * 16]);
            let r = Reconstruction::new(&scheme, &rays, options).expect("rank 16");
            r.apply(&seen, variances, &mut out, Some(&mut errors));
            let (mut off, mut said) = ([0.0; 16], [0.0; 16]);
            for i in 0..pixels * 16 {
                off[i % 16] += (out[i] - t(i / 16)[i % 16]).powi(2);
                said[i % 16] += errors[i].powi(2);
            }
            for e in 0..16 {
                // The mean of 6000 squares of normal numbers has a relative error of √(2/6000); that of σ̂² over 8 spare
                // measurements adds √(2/8/6000).
                let ratio: f64 = off[e] / said[e];
                assert!(
                    (ratio - 1.0).abs() < 5.0 * (2.25_f64 / 6000.0).sqrt(),
                    "{noise:?} {e}: {ratio}"
                );
            }
        }
    }

    /// Projected matrices can exist, and those that could before are the same.
    #[test]
    fn projections_are_realizable() {
        let (scheme, rays, pixels) = (
            Scheme::drr(36, false).expect("a scheme"),
            rays()[..1].to_vec(),
            200,
        );
        let seen = captured(&scheme, &rays, pixels, 0.05);
        let (mut plain, mut projected) = (vec![0.0; pixels * 16], vec![0.0; pixels * 16]);
        for (realizable, out) in [(false, &mut plain), (true, &mut projected)] {
            let options = Options {
                realizable,
                ..Options::default()
            };
            Reconstruction::new(&scheme, &rays, options)
                .expect("rank 16")
                .apply(&seen, None, out, None);
        }
        let of = |m: &[f64]| std::array::from_fn(|i| std::array::from_fn(|j| m[4 * i + j]));
        let before = plain.chunks(16).filter(|m| is_realizable(&of(m), 1e-9)).count();
        assert!(before < pixels / 2, "{before}");
        assert!(projected.chunks(16).all(|m| is_realizable(&of(m), 1e-9)));
    }

    /// With few captures: no estimate without a prior, a good one with it, whatever the brightness.
    #[test]
    fn priors_serve_few_captures() {
        let (scheme, rays, pixels) = (
            Scheme::qrpr(8, false).expect("a scheme"),
            rays()[..1].to_vec(),
            400,
        );
        let plain = Reconstruction::<f64>::new(&scheme, &rays, Options::default());
        assert!(plain.err().expect("rank 8").to_string().contains("--prior"));
        // Matrices of three parameters.
        let truth = |p: usize| -> [f64; 16] {
            let (a, b) = ((p as f64).sin(), (p as f64 * 0.3).cos());
            let s = 10.0_f64.powi(p as i32 % 5);
            let mut t = [0.0; 16];
            (t[0], t[5], t[10], t[15], t[1], t[4]) =
                (s, s * 0.5 * a, s * 0.5 * a, s * 0.4 * a, s * 0.3 * b, s * 0.3 * b);
            t
        };
        let mut s = Moment::zeros();
        for p in 0..pixels {
            let t = nalgebra::SVector::<f64, 16>::from(truth(p)) / truth(p)[0];
            s += t * t.transpose() / pixels as f64;
        }
        let design = DesignMatrix::new(&scheme, &rays[0]);
        let mut seen = vec![0.0; 8 * pixels];
        for p in 0..pixels {
            let clean = design.intensities(&truth(p));
            (0..8).for_each(|m| seen[m * pixels + p] = clean[m]);
        }
        // One measurement of one pixel is missing: solved by itself.
        seen[3 * pixels + 11] = f64::NAN;
        let options = Options {
            prior: Some(s),
            noise: Some(1e-6),
            ..Options::default()
        };
        let mut out = vec![0.0; pixels * 16];
        let r = Reconstruction::new(&scheme, &rays, options).expect("a prior");
        let tally = r.apply(&seen, None, &mut out, None);
        assert_eq!((tally.partial, tally.lost), (1, 0));
        for (p, m) in out.chunks(16).enumerate() {
            let t = truth(p);
            assert!((0..16).all(|e| (m[e] - t[e]).abs() < 1e-3 * t[0]), "{p}: {m:?}");
        }
    }

    proptest! {
        /// Realizable matrices of any kind, captured without noise, come back from any built-in scheme of full rank, and
        /// projecting them changes nothing.
        #[test]
        fn realizable_matrices_come_back(
            raw in prop::array::uniform16(-1.0_f64..1.0),
            bright in -6_i32..6,
            kind in 0_usize..4,
            realizable in any::<bool>(),
        ) {
            let mut m: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| raw[4 * i + j]));
            m[0][0] = 1.0;
            let m = nearest(&m).expect("finite numbers");
            prop_assert!(is_realizable(&m, 1e-9));
            let t: [f64; 16] = std::array::from_fn(|e| m[e / 4][e % 4] * 10.0_f64.powi(bright));
            let scheme = match kind {
                0 => Scheme::drr(36, false),
                1 => Scheme::qrpr(24, false),
                2 => Scheme::qrpr(9, true),
                _ => Scheme::liquid_crystal(24, false),
            };
            let scheme = scheme.expect("a scheme");
            let ray = Ray::axial(550.0);
            let seen = DesignMatrix::new(&scheme, &ray).intensities(&t);
            let options = Options { realizable, ..Options::default() };
            let mut out = [0.0; 16];
            Reconstruction::new(&scheme, &[ray], options)
                .expect("rank 16")
                .apply(seen.as_slice(), None, &mut out, None);
            for e in 0..16 {
                prop_assert!((out[e] - t[e]).abs() < 1e-8 * t[0], "{} {e}: {} is not {}", scheme.name, out[e], t[e]);
            }
        }
    }
}

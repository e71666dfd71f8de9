//! Runs trials of capture schemes. A trial captures known Mueller matrices, reconstructs the matrices, and
//! compares the results with the truth.
//!
//! A scheme of rank 16 uses least squares. Below rank 16, a trial uses the prior if there is one,
//! otherwise the minimum-norm solution. All errors are relative to the mean T00 of the truth.

use crate::capture::design_matrix::{DesignMatrix, RankError};
use crate::capture::detector::error::DetectorError;
use crate::capture::directions::Directions;
use crate::capture::mueller_image::MuellerImage;
use crate::capture::scheme::Scheme;
use crate::capture::simulate::{Captured, Layout, Noise, averaged};
use crate::reconstruct::along_rays::{Places, reconstruct};
use crate::reconstruct::pixels::Options;
use crate::reconstruct::second_moment::Moment;
use nalgebra::DMatrix;

/// Fraction of the mean T00 above which a pixel is bright. Only bright pixels are used for errors of
/// normalized elements.
const BRIGHT: f64 = 0.1;

#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// The mean T00 is not positive, so relative errors are undefined.
    #[error("the mean M00 of the matrices is not positive; use matrices of a lit scene")]
    Dark,
    /// A prior requires the noise level, which is unknown.
    #[error(
        "a prior requires the noise of the intensities, but [spad] does not define this noise; set a standard deviation, or use [cmos]"
    )]
    NoiseUnknown,
    /// The minimum-norm solution needs one design matrix for all pixels.
    #[error(
        "the rank of the scheme is below 16, and the pixels have different rays; use a prior or more captures, or simulate rays along the optical axis"
    )]
    Oblique,
    /// `repeat` is 0.
    #[error("the number of trials is 0; use at least 1 trial")]
    NoTries,
    /// The simulation rejected its settings or data.
    #[error(transparent)]
    Detector(#[from] DetectorError),
    /// The captures do not determine a matrix.
    #[error(transparent)]
    Rank(#[from] RankError),
}

#[derive(Clone, Copy, Debug)]
pub struct Trial<'a> {
    /// The ground truth.
    pub image: &'a MuellerImage,
    /// The detector model.
    pub noise: &'a Noise,
    /// Second moment of matrices with T00 = 1, for schemes below rank 16.
    pub prior: Option<&'a Moment>,
    /// Number of trials per scheme, with consecutive seeds.
    pub repeat: u32,
    /// Seed of the first trial.
    pub seed: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EstimateKind {
    /// Least squares, for schemes of rank 16.
    LeastSquares,
    /// The estimator with the second moment of a prior.
    Prior,
    MinimumNorm,
}

impl EstimateKind {
    /// Returns the estimator's name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::LeastSquares => "least squares",
            Self::Prior => "prior",
            Self::MinimumNorm => "minimum norm",
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct SchemeResult {
    pub name: String,
    pub captures: usize,
    /// Rank of the design matrix. The rank is the smallest rank of all wavelengths.
    pub rank: usize,
    /// Condition number of the design matrix: the maximum over all wavelengths, or infinity below rank 16.
    pub condition: f64,
    pub estimate: EstimateKind,
    /// RMSE divided by the mean T00, for normal noise and rank 16. The value is computed from the closed form
    /// σ √(tr (AᵀA)⁻¹ / 16).
    pub predicted: Option<f64>,
    /// Root mean square error of all elements, divided by the mean T00 and averaged over all trials.
    pub rmse: f64,
    /// Standard error of `rmse`, or NaN for a single trial.
    pub rmse_error: f64,
    /// Mean absolute error of the 15 normalized elements T_ij/T00 (all but T00), over bright pixels.
    pub normalized: f64,
    /// Fraction of pixels that are not determined.
    pub lost: f64,
    /// Errors of the first trial, per pixel.
    pub errors: ErrorImage,
}

/// The error √(Σ ΔTij²) at every pixel, divided by the mean T00. The error is the root mean square over
/// wavelengths and further captures.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorImage {
    pub width: usize,
    /// Rows of `width` values, from the top. Values are NaN where a matrix is not determined.
    pub values: Vec<f32>,
}

/// Errors of reconstructed matrices relative to the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Mean T00 of the truth over pixels with a finite truth.
    pub mean: f64,
    /// Root mean square error of all 16 elements, divided by `mean`, over pixels with finite results.
    pub rmse: f64,
    /// Mean absolute error of the 15 normalized elements T_ij/T00 (all but T00), over pixels brighter than a
    /// tenth of `mean`.
    pub normalized: f64,
    /// Fraction of known pixels whose result is not finite.
    pub lost: f64,
}

/// Returns the mean T00 of an image. Errors are relative to this mean.
///
/// # Errors
/// Returns [`TrialError::Dark`] if the mean T00 is not positive.
pub fn brightness(image: &MuellerImage) -> Result<f64, TrialError> {
    let mean = image.mean();
    if mean > 0.0 && mean.is_finite() { Ok(mean) } else { Err(TrialError::Dark) }
}

impl Trial<'_> {
    /// Runs the trial for a scheme.
    ///
    /// # Errors
    /// Returns [`TrialError`] if `repeat` is 0, if the image is dark, or if captures cannot be simulated or
    /// reconstructed.
    pub fn run(&self, scheme: &Scheme) -> Result<SchemeResult, TrialError> {
        brightness(self.image)?;
        let image = self.image;
        // The design matrices are along the axis, although every pixel may have its own ray.
        let oblique = image.view != Directions::Axial;
        let axis = Directions::Axial.rays(image.layout, &image.wavelengths_nm());
        let designs: Vec<DesignMatrix> = axis.iter().map(|ray| DesignMatrix::new(scheme, ray)).collect();
        let rank = designs.iter().map(DesignMatrix::rank).min().unwrap_or(0);
        let estimate = match (rank, self.prior) {
            (16, _) => EstimateKind::LeastSquares,
            (_, Some(_)) => EstimateKind::Prior,
            _ if oblique => return Err(TrialError::Oblique),
            _ => EstimateKind::MinimumNorm,
        };
        let mut seen: Vec<Errors> = vec![];
        let mut first = None;
        for i in 0..self.repeat {
            let seed = self.seed.wrapping_add(u64::from(i));
            let captured = image.capture(scheme, self.noise, seed)?;
            let truth = averaged(&image.matrices, image.layout, captured.layout);
            let found = match estimate {
                EstimateKind::LeastSquares => self.estimated(scheme, &captured, None)?,
                EstimateKind::Prior => self.estimated(scheme, &captured, self.prior)?,
                EstimateKind::MinimumNorm => {
                    let exact = least_norm(&designs, &captured);
                    exact.into_iter().map(|v| v as f32).collect()
                }
            };
            let errors = compare(&truth, &found);
            first.get_or_insert_with(|| error_image(&truth, &found, captured.layout, errors.mean));
            seen.push(errors);
        }
        let n = seen.len() as f64;
        let mean = |of: fn(&Errors) -> f64| seen.iter().map(of).sum::<f64>() / n;
        let rmse = mean(|e| e.rmse);
        let scatter = seen.iter().map(|e| (e.rmse - rmse).powi(2)).sum::<f64>();
        Ok(SchemeResult {
            name: scheme.name.clone(),
            captures: scheme.captures(),
            rank,
            condition: designs.iter().map(DesignMatrix::condition).fold(0.0, f64::max),
            estimate,
            predicted: seen.first().and_then(|errors| predicted(&designs, self.noise, errors.mean)),
            rmse,
            rmse_error: (scatter / (n - 1.0) / n).sqrt(),
            normalized: mean(|e| e.normalized),
            lost: mean(|e| e.lost),
            errors: first.ok_or(TrialError::NoTries)?,
        })
    }

    /// Returns the reconstruction of captures, with 16 elements per pixel.
    fn estimated(
        &self,
        scheme: &Scheme,
        captured: &Captured,
        prior: Option<&Moment>,
    ) -> Result<Vec<f32>, TrialError> {
        let typical = captured.typical_noise(self.noise).filter(|s| *s > 0.0);
        if prior.is_some() && typical.is_none() && !matches!(self.noise, Noise::None) {
            return Err(TrialError::NoiseUnknown);
        }
        let options = Options { noise: typical, prior: prior.copied(), ..Options::default() };
        let mut out = vec![0.0; captured.layout.pixels() * 16];
        let layout = captured.layout;
        let places = Places {
            rays: &self.image.view.rays(layout, &self.image.wavelengths_nm()),
            times: layout.times,
            lanes: layout.lanes,
        };
        reconstruct(
            scheme,
            places,
            &options,
            &captured.intensities,
            captured.variances.as_deref(),
            &mut out,
            None,
        )?;
        Ok(out)
    }
}

/// Returns the predicted error σ √(tr (AᵀA)⁻¹ / 16) divided by the mean T00. The result is the root mean
/// square over the wavelengths.
fn predicted(designs: &[DesignMatrix], noise: &Noise, mean: f64) -> Option<f64> {
    let Noise::Gaussian { sigma } = noise else {
        return None;
    };
    let variance = designs.iter().map(|d| d.error_variance().ok()).sum::<Option<f64>>()?;
    Some(sigma * (variance / designs.len() as f64 / 16.0).sqrt() / mean)
}

/// Returns the minimum-norm solutions of captures, with 16 elements per pixel. `designs` holds one design
/// matrix per wavelength. The wavelengths alternate over the pixels.
pub fn least_norm(designs: &[DesignMatrix], captured: &Captured) -> Vec<f64> {
    let weights: Vec<DMatrix<f64>> = designs.iter().map(DesignMatrix::minimum_norm).collect();
    let pixels = captured.layout.pixels();
    let one = |p: usize| -> [f64; 16] {
        let w = &weights[p % weights.len()];
        let at = |m: usize| f64::from(captured.intensities[m * pixels + p]);
        std::array::from_fn(|e| (0..w.ncols()).map(|m| w[(e, m)] * at(m)).sum())
    };
    (0..pixels).flat_map(one).collect()
}

/// Returns pairs of true and reconstructed matrices, for pixels with a finite truth.
fn pairs<'a>(truth: &'a [f64], found: &'a [f32]) -> impl Iterator<Item = (&'a [f64], &'a [f32])> {
    let all = truth.chunks_exact(16).zip(found.chunks_exact(16));
    all.filter(|(t, _)| t.iter().all(|v| v.is_finite()))
}

fn is_found(m: &[f32]) -> bool {
    m.iter().all(|v| v.is_finite())
}

fn squared(t: &[f64], m: &[f32]) -> f64 {
    t.iter().zip(m).map(|(t, m)| (f64::from(*m) - t).powi(2)).sum()
}

/// Compares row-major matrices of 16 elements per pixel. Pixels with a non-finite truth are ignored.
pub fn compare(truth: &[f64], found: &[f32]) -> Errors {
    let (n, sum) = pairs(truth, found).fold((0.0, 0.0), |(n, sum), (t, _)| (n + 1.0, sum + t[0]));
    let mean = sum / n;
    let (mut known, mut squares) = (0.0, 0.0);
    let (mut lit, mut off) = (0.0, 0.0);
    for (t, m) in pairs(truth, found).filter(|(_, m)| is_found(m)) {
        known += 1.0;
        squares += squared(t, m);
        if t[0] > BRIGHT * mean && m[0] > 0.0 {
            lit += 1.0;
            let of = |e: usize| (f64::from(m[e]) / f64::from(m[0]) - t[e] / t[0]).abs();
            off += (1..16).map(of).sum::<f64>() / 15.0;
        }
    }
    Errors {
        mean,
        rmse: (squares / known / 16.0).sqrt() / mean,
        normalized: off / lit,
        lost: 1.0 - known / n,
    }
}

/// Returns the errors of reconstructed matrices per pixel, relative to the brightness `mean`. The pixels are
/// in the order of `layout`.
pub fn error_image(truth: &[f64], found: &[f32], layout: Layout, mean: f64) -> ErrorImage {
    let inner = layout.times * layout.lanes;
    let places = truth.chunks_exact((16 * inner).max(1)).zip(found.chunks_exact((16 * inner).max(1)));
    let values = places.map(|(t, m)| ((squared(t, m) / inner as f64).sqrt() / mean) as f32);
    ErrorImage { width: layout.width, values: values.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(pixels: usize) -> MuellerImage {
        let of = |i: usize| {
            let e = i % 16;
            if e == 0 { 2.0 } else { 0.3 * (i as f64).sin() }
        };
        MuellerImage::of_array((0..16 * pixels).map(of).collect(), vec![1, pixels], &[]).expect("an image")
    }

    /// Verifies that, without noise, a scheme of rank 16 recovers the truth. With noise, the error agrees
    /// with the closed form within 5 standard errors. For 400 pixels with 16 correlated errors each, the
    /// relative standard error is at most 1/√400.
    #[test]
    fn errors_are_as_predicted() {
        let image = image(400);
        let scheme = Scheme::drr(36, false).expect("a scheme");
        let mut trial = Trial { image: &image, noise: &Noise::None, prior: None, repeat: 2, seed: 1 };
        let clean = trial.run(&scheme).expect("a trial");
        assert!(clean.rmse < 1e-5 && clean.lost == 0.0 && clean.predicted.is_none());
        trial.noise = &Noise::Gaussian { sigma: 0.01 };
        let noisy = trial.run(&scheme).expect("a trial");
        let predicted = noisy.predicted.expect("is in closed form");
        assert!((noisy.rmse / predicted - 1.0).abs() < 5.0 / 20.0, "{noisy:?}");
        assert_eq!((noisy.rank, noisy.estimate), (16, EstimateKind::LeastSquares));
        assert_eq!((noisy.errors.width, noisy.errors.values.len()), (400, 400));
        let few = Scheme::drr(6, false).expect("a scheme");
        let few = trial.run(&few).expect("a trial");
        assert_eq!(few.estimate, EstimateKind::MinimumNorm);
        assert!(few.rmse > noisy.rmse && few.predicted.is_none());
    }

    /// Verifies the errors of three pixels. The first has an error of 0.1 in one of 16 elements, the second
    /// is not determined, and the third has an unknown truth.
    #[test]
    fn errors_of_three_known_pixels() {
        let mut truth = vec![0.0; 48];
        (truth[0], truth[16], truth[32]) = (2.0, 2.0, f64::NAN);
        let mut found: Vec<f32> = truth.iter().map(|v| *v as f32).collect();
        found[5] = 0.1;
        found[20] = f32::NAN;
        let errors = compare(&truth, &found);
        assert_eq!((errors.mean, errors.lost), (2.0, 0.5));
        assert!((errors.rmse - 0.1 / 4.0 / 2.0).abs() < 1e-8);
        assert!((errors.normalized - 0.1 / 2.0 / 15.0).abs() < 1e-8);
        let layout = Layout { height: 1, width: 3, times: 1, lanes: 1 };
        let map = error_image(&truth, &found, layout, errors.mean);
        assert!((map.values[0] - 0.05).abs() < 1e-7 && map.values[1].is_nan());
    }

    #[test]
    fn dark_images_and_zero_repeats_are_refused() {
        let scheme = Scheme::drr(36, false).expect("a scheme");
        let dark = MuellerImage::of_array(vec![0.0; 16], vec![], &[]).expect("an image");
        let lit = image(1);
        let of = |image, repeat| Trial { image, noise: &Noise::None, prior: None, repeat, seed: 0 };
        assert!(matches!(of(&dark, 1).run(&scheme), Err(TrialError::Dark)));
        assert!(matches!(of(&lit, 0).run(&scheme), Err(TrialError::NoTries)));
    }
}

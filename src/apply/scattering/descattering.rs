//! The descattering methods. Each method is a linear estimate of the clear image from several features of a
//! pixel.

use super::seen::Seen;
use crate::application::Method;
use crate::error::ApplyError;
use crate::observation::Pixels;
use crate::regression::lbfgs::minimize;
use crate::regression::least_squares::{least_squares, ridge_by_cross_validation, without_noise};
use crate::regression::moments::{Linear, Moments};
use nalgebra::DVector;

/// A method that recovers the image behind a scattering medium.
pub(super) struct Descattering {
    pub method: Method,
    features: Features,
    solver: Solver,
}

/// The features of a pixel at a wavelength.
#[derive(Clone, Copy)]
enum Features {
    /// All elements of epipolar light. The image is S = Σᵢⱼ Wᵢⱼ (Σₜ T(s, sₑ, i, j, t) + bᵢⱼ) (Baek & Heide
    /// 2021, the equation of section 6.3).
    Elements,
    /// All elements of epipolar light, in every bin of travel time.
    GatedElements,
    /// A photograph with illumination by all projector pixels: Σ over s' of T00.
    Photograph,
    /// T00 of light from the epipolar line of each camera pixel. This image excludes light that was scattered
    /// out of the epipolar plane (O'Toole, Raskar & Kutulakos 2012).
    EpipolarPhotograph,
    /// Active polarization descattering (Treibitz & Schechner 2009). The features are two images, captured
    /// with a parallel and a crossed analyzer. The illumination is polarized in the given Stokes element (1:
    /// horizontal, 3: right circular).
    ///
    /// Let S be the light from the objects and B the light from the medium, with degrees of polarization p_S
    /// and p_B. Then I_max = S (1 + p_S)/2 + B (1 + p_B)/2 and I_min = S (1 - p_S)/2 + B (1 - p_B)/2. Hence S
    /// = [I_min (1 + p_B) - I_max (1 - p_B)] / (p_B - p_S) (eq. 13 of the paper). S is linear in the two
    /// images. The degrees p_S and p_B, a gain and an offset are therefore learned together.
    Pair(usize),
    /// Polarized light striping (Gupta, Narasimhan & Schechner 2008). The features are the two images of
    /// [`Self::Pair`], captured while lines are projected one after the other. The lines are epipolar lines,
    /// as in the comparison of Baek & Heide (2021).
    EpipolarPair(usize),
    /// T00 of all light in every bin of travel time.
    Bins,
}

/// The algorithm for the weights.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Solver {
    /// L-BFGS, as in the paper.
    Lbfgs,
    /// The closed-form solution with minimum loss on the training variants.
    LeastSquares,
    /// Ridge regression, cross-validated over training variants.
    Ridge,
    /// Least squares with subtraction of the noise of the features.
    WithoutNoise,
    /// Time gating with the window of bins that has the least loss on the training variants. All pixels have
    /// the same gate. The gate does not depend on the depth of objects.
    Window,
}

const fn new(name: &'static str, source: &'static str, features: Features, solver: Solver) -> Descattering {
    Descattering { method: Method { name, source }, features, solver }
}

/// All methods. The methods that learn W and b come first. The baselines begin at index [`BASELINES`].
pub(super) const METHODS: [Descattering; 11] = [
    new("W, b by L-BFGS", "Baek & Heide 2021", Features::Elements, Solver::Lbfgs),
    new("W, b by least squares", "closed form of the same", Features::Elements, Solver::LeastSquares),
    new("W, b by ridge regression", "new here", Features::Elements, Solver::Ridge),
    new("W, b by errors in variables", "new here", Features::Elements, Solver::WithoutNoise),
    new("time-gated W, b by ridge regression", "new here", Features::GatedElements, Solver::Ridge),
    new("conventional", "a photograph", Features::Photograph, Solver::LeastSquares),
    new("epipolar confocal", "O'Toole et al. 2012", Features::EpipolarPhotograph, Solver::LeastSquares),
    new("cross-polarization, linear", "Treibitz & Schechner 2009", Features::Pair(1), Solver::LeastSquares),
    new(
        "cross-polarization, circular",
        "Treibitz & Schechner 2009, circular",
        Features::Pair(3),
        Solver::LeastSquares,
    ),
    new("polarized light striping", "Gupta et al. 2008", Features::EpipolarPair(1), Solver::LeastSquares),
    new("time gating", "range gating", Features::Bins, Solver::Window),
];

/// Index of the first baseline.
pub(super) const BASELINES: usize = 5;

impl Descattering {
    /// Returns the features of a pixel at a wavelength, and the standard errors of the features.
    pub(super) fn features(&self, seen: &Seen, pixel: usize, lane: usize) -> (Vec<f64>, Vec<f64>) {
        let all = |p: &Pixels, elements: usize| {
            let places = (0..p.bins).flat_map(|bin| (0..elements).map(move |e| (bin, e)));
            places.map(|(bin, e)| (p.at(pixel, bin, e, lane), p.error_at(pixel, bin, e, lane))).unzip()
        };
        let photograph = |p: &Pixels| [weighed(p, pixel, lane, &[(0, 1.0)])].into_iter().unzip();
        let pair = |p: &Pixels, k: usize| along_and_across(p, pixel, lane, k).into_iter().unzip();
        match self.features {
            Features::Elements => all(&seen.epipolar, 16),
            Features::GatedElements => all(&seen.gated, 16),
            Features::Photograph => photograph(&seen.polarimetric),
            Features::EpipolarPhotograph => photograph(&seen.epipolar),
            Features::Pair(k) => pair(&seen.polarimetric, k),
            Features::EpipolarPair(k) => pair(&seen.epipolar, k),
            Features::Bins => all(&seen.transient, 1),
        }
    }

    /// Learns the weights of the features at a wavelength.
    pub(super) fn learn(&self, train: &[Seen], lane: usize) -> Result<Linear, ApplyError> {
        let moments = self.moments(train, lane);
        let all = Moments::sum(&moments);
        let unsolved = |method, cause: &str| ApplyError::Unsolved { method, cause: cause.into() };
        match self.solver {
            Solver::Lbfgs => minimize(&all).map_err(|cause| unsolved("L-BFGS", cause)),
            Solver::LeastSquares => Ok(least_squares(&all)),
            Solver::Ridge => Ok(ridge_by_cross_validation(&moments).0),
            Solver::WithoutNoise => Ok(without_noise(&all).0),
            Solver::Window => {
                let cause = "the slice has no time bins; correct the slice in the scene file";
                best_window(&all).ok_or_else(|| unsolved(self.method.name, cause))
            }
        }
    }

    /// Returns the moments of the features of the pixels in the mask. The list contains one set of moments
    /// per variant.
    fn moments(&self, train: &[Seen], lane: usize) -> Vec<Moments> {
        let of = |seen: &Seen| {
            let (mut x, mut errors, mut y) = (vec![], vec![], vec![]);
            let mut count = 0;
            for pixel in (0..seen.mask.len()).filter(|p| seen.mask[*p]) {
                let (features, error) = self.features(seen, pixel, lane);
                count = features.len();
                x.extend(features);
                errors.extend(error);
                y.push(seen.truth.data[pixel * seen.truth.channels + lane]);
            }
            Moments::of(count, &x, &errors, &y)
        };
        train.iter().map(of).collect()
    }

    /// Returns a note on the learned weights.
    pub(super) fn note(&self, fits: &[Linear]) -> Option<String> {
        let window = |fit: &Linear| {
            let open: Vec<usize> = (0..fit.weights.len()).filter(|i| fit.weights[*i] != 0.0).collect();
            Some(format!("{}..{}", open.first()?, open.last()? + 1))
        };
        if self.solver != Solver::Window {
            return None;
        }
        let all: Option<Vec<String>> = fits.iter().map(window).collect();
        Some(format!("{}: bins {} (per wavelength)", self.method.name, all?.join(", ")))
    }
}

/// Fits every window of consecutive features, and returns the fit with the least loss.
fn best_window(all: &Moments) -> Option<Linear> {
    let bins = all.x.len();
    let windows = (0..bins).flat_map(|from| (from + 1..=bins).map(move |to| (from, to)));
    let fits = windows.map(|(from, to)| {
        let window = DVector::from_fn(bins, |i, _| f64::from(u8::from((from..to).contains(&i))));
        let projected = all.projected(&window);
        let fit = least_squares(&projected);
        (Linear { weights: window * fit.weights[0], offset: fit.offset }, projected.loss(&fit))
    });
    fits.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(fit, _)| fit)
}

/// Returns Σₑ wₑ Tₑ over the elements of a pixel, summed over all bins. The function also returns the
/// standard error of the sum. The errors of the elements are treated as independent.
pub(super) fn weighed(p: &Pixels, pixel: usize, lane: usize, weights: &[(usize, f64)]) -> (f64, f64) {
    let (mut sum, mut variance) = (0.0, 0.0);
    for bin in 0..p.bins {
        for (element, w) in weights {
            sum += w * p.at(pixel, bin, *element, lane);
            variance += (w * p.error_at(pixel, bin, *element, lane)).powi(2);
        }
    }
    (sum, variance.sqrt())
}

/// Returns the two images of [`Features::Pair`]. The illumination [1, 0, .., 1] is fully polarized in Stokes
/// element `k`, and the analyzers are [1, 0, .., ±1]/2.
pub(super) fn along_and_across(p: &Pixels, pixel: usize, lane: usize, k: usize) -> [(f64, f64); 2] {
    [0.5, -0.5].map(|sign| weighed(p, pixel, lane, &[(0, 0.5), (k, 0.5), (4 * k, sign), (5 * k, sign)]))
}

//! The descattering methods. Each method is a linear estimate of the clear image from several features of a
//! pixel.

use super::seen::Seen;
use crate::application::Method;
use crate::error::ApplyError;
use crate::map::window;
use crate::observation::Pixels;
use crate::regression::lbfgs::minimize;
use crate::regression::least_squares::{least_squares, ridge_by_cross_validation, without_noise};
use crate::regression::moments::{Linear, Moments};
use nalgebra::DMatrix;

/// A method that recovers the image behind a scattering medium.
pub(super) struct Descattering {
    pub method: Method,
    features: Features,
    solver: Solver,
    /// True if the means of the features over 3 × 3 pixels are further features.
    pub around: bool,
    /// True if the method is fitted to the truth of the test variant itself. The score is an upper bound of
    /// what linear functions of the features can reach, and not a result for new scenes.
    pub same_scene: bool,
}

/// The features of all pixels at a wavelength.
pub(super) struct Table {
    /// Number of features of a pixel.
    count: usize,
    /// Features of all pixels, and their standard errors, pixel by pixel.
    values: Vec<f64>,
    errors: Vec<f64>,
}

impl Table {
    /// Returns the features of a pixel.
    pub(super) fn of(&self, pixel: usize) -> &[f64] {
        &self.values[pixel * self.count..][..self.count]
    }

    fn errors_of(&self, pixel: usize) -> &[f64] {
        &self.errors[pixel * self.count..][..self.count]
    }

    /// Appends the means over those of 3 × 3 pixels that are in the image and in the mask.
    fn with_means(&self, seen: &Seen) -> Self {
        let [w, h] = [seen.truth.width, seen.truth.height];
        let (mut values, mut errors) = (vec![], vec![]);
        for pixel in 0..w * h {
            let near = window([w, h], [pixel % w, pixel / w], 1).map(|[i, j]| j * w + i);
            let near: Vec<usize> = near.filter(|p| *p == pixel || seen.mask[*p]).collect();
            let n = near.len() as f64;
            let sum = |value: &dyn Fn(usize) -> f64| near.iter().map(|p| value(*p)).sum::<f64>() / n;
            values.extend(self.of(pixel));
            values.extend((0..self.count).map(|f| sum(&|p| self.of(p)[f])));
            errors.extend(self.errors_of(pixel));
            errors.extend((0..self.count).map(|f| (sum(&|p| self.errors_of(p)[f].powi(2)) / n).sqrt()));
        }
        Self { count: 2 * self.count, values, errors }
    }
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
    /// T00 of all light in the [`NEAR`] bins around the bin in which the pixel's object is brightest in clear
    /// water. No laboratory knows this bin exactly in milk, so gates at this depth are an upper bound for gates
    /// that follow an estimated depth.
    BinsAtDepth,
    /// T00 of epipolar and of non-epipolar light.
    Space,
    /// The elements [`JOINT`] of epipolar and of non-epipolar light. The features of all methods that use
    /// space, polarization or both are linear functions of these features.
    SpacePolarization,
    /// [`Self::SpacePolarization`] and [`Self::Bins`].
    SpacePolarizationTime,
}

/// Bins of [`Features::BinsAtDepth`], relative to the bin of the pixel's object. Bins before the first bin and
/// after the last bin contain no light.
const NEAR: std::ops::RangeInclusive<isize> = -2..=2;

/// Elements of the joint methods, row-major: the diagonal, and the elements of [`Features::Pair`].
const JOINT: [usize; 8] = [0, 5, 10, 15, 1, 4, 3, 12];

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
    Descattering { method: Method { name, source }, features, solver, around: false, same_scene: false }
}

/// Returns a method with the means of the features over 3 × 3 pixels.
const fn with_means(name: &'static str, of: &Descattering) -> Descattering {
    let method = Method { name, source: of.method.source };
    Descattering { method, around: true, ..*of }
}

/// Returns a method that is fitted to the test variant itself. A single variant does not determine the free
/// number of ridge regression, so the weights are those of least squares.
const fn same_scene(name: &'static str, of: &Descattering) -> Descattering {
    let method = Method { name, source: of.method.source };
    let solver = if let Solver::Ridge = of.solver { Solver::LeastSquares } else { of.solver };
    Descattering { method, solver, same_scene: true, ..*of }
}

const NEW: &str = "new here";
const SPACE: Descattering = new("joint: space", NEW, Features::Space, Solver::Ridge);
const SPACE_POLARIZATION: Descattering =
    new("joint: space, polarization", NEW, Features::SpacePolarization, Solver::Ridge);
const ALL: Descattering =
    new("joint: space, polarization, time", NEW, Features::SpacePolarizationTime, Solver::Ridge);
const CONVENTIONAL: Descattering =
    new("conventional", "a photograph", Features::Photograph, Solver::LeastSquares);
const CONFOCAL: Descattering =
    new("epipolar confocal", "O'Toole et al. 2012", Features::EpipolarPhotograph, Solver::LeastSquares);
const LINEAR: Descattering =
    new("cross-polarization, linear", "Treibitz & Schechner 2009", Features::Pair(1), Solver::LeastSquares);
const CIRCULAR: Descattering = new(
    "cross-polarization, circular",
    "Treibitz & Schechner 2009, circular",
    Features::Pair(3),
    Solver::LeastSquares,
);
const STRIPING: Descattering =
    new("polarized light striping", "Gupta et al. 2008", Features::EpipolarPair(1), Solver::LeastSquares);
const GATING: Descattering = new("time gating", "range gating", Features::Bins, Solver::Window);
const GATING_AT_DEPTH: Descattering = new(
    "time gating at the true depth",
    "range gating that follows the depth",
    Features::BinsAtDepth,
    Solver::Window,
);
const PAPER: Descattering =
    new("W, b by least squares", "closed form of the same", Features::Elements, Solver::LeastSquares);

/// All methods. The methods that learn W and b come first, then the joint methods. The [`BASELINES`] follow, and
/// then methods that are fitted to the test variant itself.
pub(super) const METHODS: [Descattering; 32] = [
    new("W, b by L-BFGS", "Baek & Heide 2021", Features::Elements, Solver::Lbfgs),
    PAPER,
    new("W, b by ridge regression", NEW, Features::Elements, Solver::Ridge),
    new("W, b by errors in variables", NEW, Features::Elements, Solver::WithoutNoise),
    new("time-gated W, b by ridge regression", NEW, Features::GatedElements, Solver::Ridge),
    SPACE,
    SPACE_POLARIZATION,
    ALL,
    with_means("joint: space, polarization, time, 3 × 3", &ALL),
    CONVENTIONAL,
    CONFOCAL,
    LINEAR,
    CIRCULAR,
    STRIPING,
    GATING,
    GATING_AT_DEPTH,
    with_means("conventional, 3 × 3", &CONVENTIONAL),
    with_means("epipolar confocal, 3 × 3", &CONFOCAL),
    with_means("cross-polarization, linear, 3 × 3", &LINEAR),
    with_means("cross-polarization, circular, 3 × 3", &CIRCULAR),
    with_means("polarized light striping, 3 × 3", &STRIPING),
    with_means("time gating, 3 × 3", &GATING),
    with_means("time gating at the true depth, 3 × 3", &GATING_AT_DEPTH),
    same_scene("W, b by least squares, same scene", &PAPER),
    same_scene("joint: space, polarization, time, same scene", &ALL),
    same_scene("conventional, same scene", &CONVENTIONAL),
    same_scene("epipolar confocal, same scene", &CONFOCAL),
    same_scene("cross-polarization, linear, same scene", &LINEAR),
    same_scene("cross-polarization, circular, same scene", &CIRCULAR),
    same_scene("polarized light striping, same scene", &STRIPING),
    same_scene("time gating, same scene", &GATING),
    same_scene("time gating at the true depth, same scene", &GATING_AT_DEPTH),
];

/// Indices of the baselines.
pub(super) const BASELINES: std::ops::Range<usize> = 9..23;

impl Descattering {
    /// Returns true if the features are matrix elements in row-major order.
    pub(super) fn uses_elements(&self) -> bool {
        matches!(self.features, Features::Elements | Features::GatedElements)
    }

    /// Returns the features of all pixels at a wavelength.
    pub(super) fn table(&self, seen: &Seen, lane: usize) -> Table {
        let mut table = Table { count: 0, values: vec![], errors: vec![] };
        for pixel in 0..seen.mask.len() {
            let own = self.own_features(seen, pixel, lane);
            table.count = own.len();
            for (value, error) in own {
                table.values.push(value);
                table.errors.push(error);
            }
        }
        if self.around { table.with_means(seen) } else { table }
    }

    /// Returns the features of a pixel at a wavelength with their standard errors, without means over several
    /// pixels.
    fn own_features(&self, seen: &Seen, pixel: usize, lane: usize) -> Vec<(f64, f64)> {
        let at = |p: &Pixels, bin, e| (p.at(pixel, bin, e, lane), p.error_at(pixel, bin, e, lane));
        let all = |p: &Pixels, elements: usize| -> Vec<(f64, f64)> {
            (0..p.bins).flat_map(|bin| (0..elements).map(move |e| at(p, bin, e))).collect()
        };
        let photograph = |p: &Pixels| vec![weighed(p, pixel, lane, &[(0, 1.0)])];
        let pair = |p: &Pixels, k: usize| along_and_across(p, pixel, lane, k).to_vec();
        // Epipolar and non-epipolar light are independent, so their variances add up to that of all light.
        let parts = |e: usize| {
            let (all, part) = (at(&seen.polarimetric, 0, e), at(&seen.epipolar, 0, e));
            [part, (all.0 - part.0, (all.1.powi(2) - part.1.powi(2)).max(0.0).sqrt())]
        };
        let joint = || JOINT.into_iter().flat_map(parts);
        match self.features {
            Features::Elements => all(&seen.epipolar, 16),
            Features::GatedElements => all(&seen.gated, 16),
            Features::Photograph => photograph(&seen.polarimetric),
            Features::EpipolarPhotograph => photograph(&seen.epipolar),
            Features::Pair(k) => pair(&seen.polarimetric, k),
            Features::EpipolarPair(k) => pair(&seen.epipolar, k),
            Features::Bins => all(&seen.transient, 1),
            Features::BinsAtDepth => {
                let bin = |offset| usize::try_from(seen.arrival[pixel] as isize + offset).ok();
                let light = |bin: usize| (bin < seen.transient.bins).then(|| at(&seen.transient, bin, 0));
                NEAR.map(|offset| bin(offset).and_then(light).unwrap_or_default()).collect()
            }
            Features::Space => parts(0).to_vec(),
            Features::SpacePolarization => joint().collect(),
            Features::SpacePolarizationTime => joint().chain(all(&seen.transient, 1)).collect(),
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
                best_window(&all, self.around).ok_or_else(|| unsolved(self.method.name, cause))
            }
        }
    }

    /// Returns the moments of the features of the pixels in the mask. The list contains one set of moments
    /// per variant.
    fn moments(&self, train: &[Seen], lane: usize) -> Vec<Moments> {
        let of = |seen: &Seen| {
            let table = self.table(seen, lane);
            let (mut x, mut errors, mut y) = (vec![], vec![], vec![]);
            for pixel in (0..seen.mask.len()).filter(|p| seen.mask[*p]) {
                x.extend(table.of(pixel));
                errors.extend(table.errors_of(pixel));
                y.push(seen.truth.data[pixel * seen.truth.channels + lane]);
            }
            Moments::of(table.count, &x, &errors, &y)
        };
        train.iter().map(of).collect()
    }

    /// Returns a note on the learned weights.
    pub(super) fn note(&self, fits: &[Linear]) -> Option<String> {
        let window = |fit: &Linear| {
            let bins = fit.weights.len() / if self.around { 2 } else { 1 };
            let open: Vec<usize> = (0..bins).filter(|i| fit.weights[*i] != 0.0).collect();
            Some(format!("{}..{}", open.first()?, open.last()? + 1))
        };
        if self.solver != Solver::Window {
            return None;
        }
        let all: Option<Vec<String>> = fits.iter().map(window).collect();
        Some(format!("{}: bins {} (per wavelength)", self.method.name, all?.join(", ")))
    }
}

/// Fits every window of consecutive bins, and returns the fit with the least loss. `around` is true if the
/// means of all bins over several pixels follow the bins; then the means have a separate weight.
fn best_window(all: &Moments, around: bool) -> Option<Linear> {
    let parts = if around { 2 } else { 1 };
    let bins = all.x.len() / parts;
    let windows = (0..bins).flat_map(|from| (from + 1..=bins).map(move |to| (from, to)));
    let fits = windows.map(|(from, to)| {
        let window = DMatrix::from_fn(all.x.len(), parts, |i, part| {
            f64::from(u8::from((part * bins + from..part * bins + to).contains(&i)))
        });
        let projected = all.projected(&window);
        let fit = least_squares(&projected);
        (Linear { weights: window * &fit.weights, offset: fit.offset }, projected.loss(&fit))
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

//! Linear estimates of one light component from several features of a pixel.
//!
//! Features are Mueller elements of light components, divided by the photograph, and the brightness of the
//! photograph. Features of fewer dimensions are a subset of the features of more dimensions, so that methods
//! are nested: intensity ⊂ space, time or polarization ⊂ two dimensions ⊂ all dimensions.

use super::element::{Element, Space, Time};
use super::family::{Dimensions, Family, Isolation};
use super::seen::Seen;
use crate::metrics::isolation::{Class, DARK};
use crate::regression::least_squares::ridges_by_cross_validation;
use crate::regression::moments::{Linear, Moments};
use std::fmt;

/// The features of a linear method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Features {
    pub dimensions: Dimensions,
    /// Whether the features of the image that is averaged over 3 × 3 pixels are further features.
    pub around: bool,
}

/// Elements whose magnitudes are features. A magnitude combines the elements of rows or columns 1 and 2.
const MAGNITUDES: [[usize; 2]; 5] = [[0, 1], [1, 0], [1, 1], [1, 3], [3, 1]];

impl Features {
    /// Returns the features of all pixels, `[feature][pixel]`.
    pub(super) fn of(self, seen: &Seen) -> Vec<Vec<f64>> {
        let mut all = self.own(seen);
        if self.around {
            all.extend(self.own(&seen.averaged()));
        }
        all
    }

    /// Returns the features without those of averaged images.
    fn own(self, seen: &Seen) -> Vec<Vec<f64>> {
        let photograph = seen.photograph();
        let mean = photograph.iter().sum::<f64>() / photograph.len() as f64;
        let brightness = |v: &f64| (v / mean).max(DARK);
        let mut all: Vec<Vec<f64>> = vec![
            photograph.iter().map(brightness).collect(),
            photograph.iter().map(|v| brightness(v).ln()).collect(),
        ];
        for element in self.elements(seen) {
            let image = seen.image(element).unwrap_or_default();
            // The value of an element is at most that of (0,0). Larger quotients are noise.
            let share = |(v, all): (&f64, &f64)| {
                if *all > DARK * mean { (v / all).clamp(-1.0, 1.0) } else { 0.0 }
            };
            all.push(image.iter().zip(photograph).map(share).collect());
        }
        all
    }

    fn elements(self, seen: &Seen) -> Vec<Element> {
        let mut all = vec![];
        for (part, count) in seen.parts() {
            // Non-epipolar and late light are differences of other light components.
            let difference = part.0 == Space::NonEpipolar || matches!(part.1, Time::Late(_));
            if difference || !self.dimensions.resolve(part) {
                continue;
            }
            let count = if self.dimensions.polarization { count } else { 1 };
            let of = |index| Element { part, ..Element::of(part.0, index) };
            all.extend((0..count).map(|e| of([e / 4, e % 4])));
            if count == 16 && !matches!(part.1, Time::At(_)) {
                all.extend(MAGNITUDES.map(|index| of(index).magnitude()));
            }
        }
        all
    }

    /// Returns the features of the pixels that are not dark, example by example, and their number.
    fn examples(self, seen: &Seen) -> (Vec<f64>, usize) {
        let features = self.of(seen);
        let lit = lit(seen);
        (lit.flat_map(|p| features.iter().map(move |f| f[p])).collect(), features.len())
    }
}

/// Returns the pixels that are not dark. These pixels are equal for all tasks.
fn lit(seen: &Seen) -> impl Iterator<Item = usize> {
    let classes = &seen.truth[0].classes;
    (0..classes.len()).filter(|p| classes[*p] != Class::Dark)
}

/// A linear estimate.
pub(super) struct Fit(Linear);

/// Learns two estimates for each task by ridge regression: of the class (1 for positive pixels, 0 for negative
/// pixels) and of the component's share. A task has no estimates if no variant contains positive pixels.
pub(super) fn learn(features: Features, tasks: usize, train: &[Seen]) -> Vec<Option<[Fit; 2]>> {
    let moments = |seen: &Seen| {
        let (x, count) = features.examples(seen);
        let of = |value: &dyn Fn(usize) -> f64| lit(seen).map(value).collect::<Vec<f64>>();
        let targets = seen.truth[..tasks].iter().flat_map(|truth| {
            let class = of(&|p| f64::from(u8::from(truth.classes[p] == Class::Positive)));
            [class, of(&|p| truth.share[p])]
        });
        Moments::of_each(count, &x, targets)
    };
    let groups: Vec<Vec<Moments>> = train.iter().map(moments).collect();
    let mut fits = ridges_by_cross_validation(&groups).into_iter().map(|(fit, _)| Fit(fit));
    let task = |task: usize| {
        let pair = [fits.next()?, fits.next()?];
        let present = train.iter().any(|seen| seen.truth[task].classes.contains(&Class::Positive));
        present.then_some(pair)
    };
    (0..tasks).map(task).collect()
}

impl Fit {
    /// Returns the estimate for each pixel. `features` are those of [`Features::of`].
    pub(super) fn values(&self, features: &[Vec<f64>]) -> Vec<f64> {
        let of = |p: usize| {
            self.0.offset + features.iter().zip(self.0.weights.iter()).map(|(f, w)| f[p] * w).sum::<f64>()
        };
        (0..features.first().map_or(0, Vec::len)).map(of).collect()
    }
}

impl fmt::Display for Fit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a linear combination of {} features", self.0.weights.len())
    }
}

/// Returns a method. The dimensions are space, time and polarization.
const fn method(name: &'static str, [space, time, polarization]: [bool; 3], around: bool) -> Isolation {
    let dimensions = Dimensions { space, time, polarization };
    Isolation::new(name, "new here: ridge regression", Family::Linear(Features { dimensions, around }))
}

/// The joint method of a coaxial rig, and the linear methods that use fewer dimensions. The dimension space
/// is not available.
pub(crate) const COAXIAL: [Isolation; 8] = [
    method("linear: intensity", [false, false, false], false),
    method("linear: time", [false, true, false], false),
    method("linear: polarization", [false, false, true], false),
    method("joint: polarization, time", [false, true, true], false),
    method("linear: intensity, 3 × 3", [false, false, false], true),
    method("linear: time, 3 × 3", [false, true, false], true),
    method("linear: polarization, 3 × 3", [false, false, true], true),
    method("joint: polarization, time, 3 × 3", [false, true, true], true),
];

/// The linear methods that use the dimension space.
pub(crate) const IN_SPACE: [Isolation; 6] = [
    method("linear: space", [true, false, false], false),
    method("joint: space, time", [true, true, false], false),
    method("joint: space, polarization", [true, false, true], false),
    method("joint: space, polarization, time", [true, true, true], false),
    method("linear: space, 3 × 3", [true, false, false], true),
    method("joint: space, polarization, time, 3 × 3", [true, true, true], true),
];

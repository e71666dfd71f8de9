//! Linear estimates of the light of a target at a place (a pixel and a bin), from several features (new here).
//!
//! Features are Mueller elements of the bin, as they are and divided by (0,0). With time, the features of the two
//! neighbouring bins and of the sum over all bins are further features. Methods are nested: intensity ⊂ time or
//! polarization ⊂ both. The single elements of the other methods are a subset of the features of both.

use super::seen::{Seen, TARGETS};
use crate::map;
use crate::metrics::isolation::DARK;
use crate::regression::least_squares::ridges_by_cross_validation;
use crate::regression::moments::{Linear, Moments};

/// The features of a linear method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Features {
    pub time: bool,
    pub polarization: bool,
    /// Whether the features of the light that is averaged over 3 × 3 pixels are further features.
    pub around: bool,
}

/// Groups of elements 4 i + j whose magnitudes are features. A magnitude does not depend on the azimuth of a surface.
const MAGNITUDES: [&[usize]; 5] = [&[1, 2], &[4, 8], &[5, 6, 9, 10], &[7, 11], &[13, 14]];

/// The sixteen elements of the light, summed over wavelengths.
struct Light {
    bins: usize,
    /// Elements of each place.
    of_bins: Vec<[f64; 16]>,
    /// Elements of each pixel, summed over all bins.
    of_pixels: Vec<[f64; 16]>,
}

impl Light {
    fn new(seen: &Seen) -> Self {
        let bins = seen.pixels.bins;
        let elements = |place: usize| std::array::from_fn(|e| seen.element(place, e));
        let sums = |pixel: usize| std::array::from_fn(|e| seen.integrated(pixel * bins, e));
        Self {
            bins,
            of_bins: (0..seen.pixels.count() * bins).map(elements).collect(),
            of_pixels: (0..seen.pixels.count()).map(sums).collect(),
        }
    }

    /// Returns the light averaged over 3 × 3 pixels of an image of the given width and height.
    fn averaged(&self, [w, h]: [usize; 2]) -> Self {
        let windows: Vec<Vec<usize>> = (0..w * h)
            .map(|p| map::window([w, h], [p % w, p / w], 1).map(|[x, y]| y * w + x).collect())
            .collect();
        let mean = |window: &[usize], of: &dyn Fn(usize) -> [f64; 16]| {
            let mut sum = [0.0; 16];
            for pixel in window {
                sum.iter_mut().zip(of(*pixel)).for_each(|(s, v)| *s += v / window.len() as f64);
            }
            sum
        };
        let bins = self.bins;
        let place = |p: usize| mean(&windows[p / bins], &|pixel| self.of_bins[pixel * bins + p % bins]);
        Self {
            bins,
            of_bins: (0..self.of_bins.len()).map(place).collect(),
            of_pixels: windows.iter().map(|window| mean(window, &|pixel| self.of_pixels[pixel])).collect(),
        }
    }
}

impl Features {
    /// Returns the features of the lit places, place by place.
    fn of(self, seen: &Seen) -> Vec<Vec<f64>> {
        let own = Light::new(seen);
        let lit = &seen.lit;
        let mean = lit.iter().map(|place| own.of_bins[*place][0]).sum::<f64>() / lit.len().max(1) as f64;
        let around = self.around.then(|| own.averaged([seen.pixels.width, seen.pixels.height]));
        let all = |place: &usize| {
            let lights = std::iter::once(&own).chain(&around);
            lights.flat_map(|light| self.of_place(light, *place, mean)).collect()
        };
        lit.iter().map(all).collect()
    }

    /// Returns the features of a place. `mean` is the mean light of the lit places of the variant.
    fn of_place(self, light: &Light, place: usize, mean: f64) -> Vec<f64> {
        let mut out = vec![];
        let own = light.of_bins[place];
        let mut lights = vec![own];
        if self.time {
            // Outside the bins there is no light.
            let bin = place % light.bins;
            lights.push(if bin > 0 { light.of_bins[place - 1] } else { [0.0; 16] });
            lights.push(if bin + 1 < light.bins { light.of_bins[place + 1] } else { [0.0; 16] });
            lights.push(light.of_pixels[place / light.bins]);
        }
        for (i, m) in lights.iter().enumerate() {
            let bright = (m[0] / mean).max(DARK);
            out.extend([bright, bright.ln()]);
            if i > 0 {
                out.push(if own[0] > 0.0 && m[0] > 0.0 { own[0] / (own[0] + m[0]) } else { 0.0 });
            }
            if self.polarization {
                // The value of an element is at most that of (0,0). Larger quotients are noise.
                let share = |v: f64| if m[0] > DARK * mean { (v / m[0]).clamp(-1.0, 1.0) } else { 0.0 };
                out.extend(m[1..].iter().flat_map(|v| [v / mean, share(*v)]));
                let magnitude = |group: &&[usize]| group.iter().map(|e| m[*e] * m[*e]).sum::<f64>().sqrt();
                out.extend(MAGNITUDES.iter().map(|group| share(magnitude(group))));
            }
        }
        out
    }
}

/// Linear estimates for the two targets.
pub(super) struct Fit {
    features: Features,
    /// For each target, the estimate of the class (1 if most of the light is that of the target, 0 otherwise) and of
    /// the target's share of the light.
    estimates: [[Linear; 2]; 2],
}

impl Fit {
    /// Learns the estimates by ridge regression over the lit places of training variants. The regularization is chosen
    /// by cross-validation over the variants.
    pub(super) fn learn(features: Features, train: &[Seen]) -> Self {
        let moments = |seen: &Seen| {
            let x = features.of(seen);
            let of =
                |value: &dyn Fn(usize) -> f64| -> Vec<f64> { seen.lit.iter().map(|p| value(*p)).collect() };
            let targets = TARGETS.into_iter().flat_map(|target| {
                let class = of(&|p| f64::from(u8::from(seen.is(target, p))));
                [class, of(&|p| seen.share(target, p))]
            });
            Moments::of_each(x.first().map_or(0, Vec::len), &x.concat(), targets)
        };
        let groups: Vec<Vec<Moments>> = train.iter().filter(|s| !s.lit.is_empty()).map(moments).collect();
        let mut fits = ridges_by_cross_validation(&groups).into_iter().map(|(fit, _)| fit);
        let none = || Linear { weights: vec![].into(), offset: 0.0 };
        let estimates = TARGETS.map(|_| [0, 1].map(|_| fits.next().unwrap_or_else(none)));
        Self { features, estimates }
    }

    /// Returns for each target two estimates for every place that is lit: of the class and of the light of the target.
    /// Other places are NaN.
    pub(super) fn values(&self, seen: &Seen) -> [[Vec<f64>; 2]; 2] {
        let x = self.features.of(seen);
        let places = seen.pixels.count() * seen.pixels.bins;
        self.estimates.each_ref().map(|[class, share]| {
            let mut out = [vec![f64::NAN; places], vec![f64::NAN; places]];
            for (place, x) in seen.lit.iter().zip(&x) {
                out[0][*place] = class.of(x);
                out[1][*place] = share.of(x) * seen.element(*place, 0);
            }
            out
        })
    }
}

//! Linear estimates of the light of a target at a place (a pixel and a bin), from several features (new here).
//!
//! Features are Mueller elements of the bin, as they are and divided by (0,0). With time, the features of the two
//! neighbouring bins and of the sum over all bins are further features. Methods are nested: intensity ⊂ time or
//! polarization ⊂ both. The single elements of the other methods are a subset of the features of both.

use super::seen::{Seen, TARGETS, Target};
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

/// Returns the 16 elements of the light of a pixel in a bin, or in all bins.
fn elements(seen: &Seen, pixel: usize, bin: Option<usize>) -> [f64; 16] {
    let first = pixel * seen.pixels.bins;
    std::array::from_fn(|e| match bin {
        Some(bin) => seen.element(first + bin, e),
        None => seen.integrated(first, e),
    })
}

impl Features {
    /// Returns the features of a place. `mean` is the mean light of the lit places of the variant.
    fn of(self, seen: &Seen, place: usize, mean: f64) -> Vec<f64> {
        let (bins, w, h) = (seen.pixels.bins, seen.pixels.width, seen.pixels.height);
        let (pixel, bin) = (place / bins, place % bins);
        let mut out = vec![];
        self.add(&mut out, bins, bin, mean, |b| elements(seen, pixel, b));
        if self.around {
            let pixels: Vec<usize> =
                map::window([w, h], [pixel % w, pixel / w], 1).map(|[x, y]| y * w + x).collect();
            self.add(&mut out, bins, bin, mean, |b| {
                let mut sum = [0.0; 16];
                for p in &pixels {
                    let all = elements(seen, *p, b);
                    sum.iter_mut().zip(all).for_each(|(s, v)| *s += v / pixels.len() as f64);
                }
                sum
            });
        }
        out
    }

    fn add(
        self,
        out: &mut Vec<f64>,
        bins: usize,
        bin: usize,
        mean: f64,
        light: impl Fn(Option<usize>) -> [f64; 16],
    ) {
        let own = light(Some(bin));
        let mut lights = vec![own];
        if self.time {
            // Outside the bins there is no light.
            let beside = [bin.checked_sub(1), Some(bin + 1).filter(|b| *b < bins)];
            lights.extend(beside.map(|b| b.map_or([0.0; 16], |b| light(Some(b)))));
            lights.push(light(None));
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
    }
}

fn mean(seen: &Seen) -> f64 {
    seen.lit.iter().map(|place| seen.element(*place, 0)).sum::<f64>() / seen.lit.len().max(1) as f64
}

/// Linear estimates for the two targets.
pub(super) struct Fit {
    features: Features,
    /// For each target, the estimate of the class (1 if most of the light is that of the target, 0 otherwise) and of
    /// the target's share of the light.
    estimates: Vec<[Linear; 2]>,
}

impl Fit {
    /// Learns the estimates by ridge regression over the lit places of training variants. The regularization is chosen
    /// by cross-validation over the variants.
    pub(super) fn learn(features: Features, train: &[Seen]) -> Self {
        let moments = |seen: &Seen| -> Vec<Moments> {
            let mean = mean(seen);
            let x: Vec<Vec<f64>> = seen.lit.iter().map(|place| features.of(seen, *place, mean)).collect();
            let count = x.first().map_or(0, Vec::len);
            let x = x.concat();
            let none = Moments::of(count, &x, &[], &vec![0.0; seen.lit.len()]);
            let of =
                |value: &dyn Fn(usize) -> f64| -> Vec<f64> { seen.lit.iter().map(|p| value(*p)).collect() };
            let targets = TARGETS.into_iter().flat_map(|target| {
                let class = of(&|p| f64::from(u8::from(seen.is(target, p))));
                [class, of(&|p| seen.share(target, p))]
            });
            targets.map(|y| none.with_target(&x, &y)).collect()
        };
        let groups: Vec<Vec<Moments>> = train.iter().filter(|s| !s.lit.is_empty()).map(moments).collect();
        let mut fits = ridges_by_cross_validation(&groups).into_iter().map(|(fit, _)| fit);
        let none = || Linear { weights: vec![].into(), offset: 0.0 };
        let estimates = TARGETS.map(|_| [0, 1].map(|_| fits.next().unwrap_or_else(none))).into();
        Self { features, estimates }
    }

    /// Returns two estimates for every place that is lit: of the class and of the light of the target. Other places are
    /// NaN.
    pub(super) fn values(&self, seen: &Seen, target: Target) -> [Vec<f64>; 2] {
        let mean = mean(seen);
        let [class, share] = &self.estimates[usize::from(target == Target::Keeping)];
        let places = seen.pixels.count() * seen.pixels.bins;
        let mut out = [vec![f64::NAN; places], vec![f64::NAN; places]];
        for place in &seen.lit {
            let x = self.features.of(seen, *place, mean);
            out[0][*place] = class.of(&x);
            out[1][*place] = share.of(&x) * seen.element(*place, 0);
        }
        out
    }
}

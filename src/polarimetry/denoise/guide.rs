//! The guide image. The denoiser compares the few channels per pixel of this image to find similar pixels.
//!
//! For images of Mueller matrices or intensities at several wavelengths, the guide is the image itself. If a
//! slice resolves time bins, bounces or projector pixels, the guide is the sum over these entries. The guide
//! of such a slice also holds the profile of M00 along these entries, in at most `PROFILE` groups of
//! neighbouring entries. Pixels at different depths therefore differ. Variances are summed on the assumption
//! that entries are independent.

use super::outliers::{neighbours, outliers, replace};
use super::{Size, Values};
use tensor::axes::{Axis, AxisKind};

/// Fraction of neighbours with light, over all renders. Above this fraction, a pixel is assumed to be lit. In
/// dark regions, few pixels receive a path, and averaging would spread the light of a path over a visible
/// spot.
const LIT: f64 = 0.25;

/// Maximum number of groups of a profile.
const PROFILE: usize = 256;

/// The channels of each render. Pixels are compared by these channels.
pub struct Guide {
    pub size: Size,
    /// One or two renders. The renders are scaled so that the largest value is at most 1.
    pub renders: Vec<Values>,
    /// Weight of each render in the mean. The sum of the weights is 1.
    pub shares: Vec<f32>,
    /// For each element, the channel of M00 at the same wavelength. The noise of this channel is the
    /// reference. The channels after the elements hold the profile.
    pub judge: Vec<usize>,
    /// Whether all values of a pixel are finite. The values of all other pixels are zero in the guide.
    pub known: Vec<bool>,
    /// For each render, whether each pixel is replaced by the mean of the pixel's neighbours.
    pub outliers: Vec<Vec<bool>>,
    /// Whether a pixel has zero standard error and is not averaged. The value is false for a dark pixel if
    /// more than a quarter of the pixel's neighbours received light. A dark pixel among lit pixels is dark
    /// because no sampled path carried light to the pixel. Without averaging, the dark pixel would remain a
    /// black dot.
    pub still: Vec<bool>,
}

/// Accumulates the values of one render, block by block.
pub struct GuideBuilder {
    size: Size,
    plan: Plan,
    mean: Vec<f64>,
    variance: Vec<f64>,
}

/// The mapping from entries of a pixel to channels.
struct Plan {
    kinds: Vec<AxisKind>,
    shape: Vec<usize>,
    /// Number of channels of the matrix or intensity, without the `groups` channels of the profile.
    matrix: usize,
    groups: usize,
    /// Number of entries that are summed or grouped.
    others: usize,
    lanes: usize,
}

fn is_kept(kind: AxisKind) -> bool {
    matches!(kind, AxisKind::StokesOut | AxisKind::StokesIn | AxisKind::Wavelength)
}

impl Plan {
    /// Builds the mapping for the axes that follow rows and columns.
    fn new(axes: &[Axis]) -> Self {
        let count = |kept: bool| {
            let some = axes.iter().filter(|a| is_kept(a.kind) == kept);
            some.map(|a| a.coords.len()).product::<usize>()
        };
        let lanes = axes.iter().find(|a| a.kind == AxisKind::Wavelength);
        let others = count(false);
        Self {
            kinds: axes.iter().map(|a| a.kind).collect(),
            shape: axes.iter().map(|a| a.coords.len()).collect(),
            matrix: count(true),
            groups: if others > 1 { others.min(PROFILE) } else { 0 },
            others,
            lanes: lanes.map_or(1, |a| a.coords.len()),
        }
    }

    /// Returns the channels to which an entry is added. The first channel is in the sum, and the second is in
    /// the profile.
    fn channels(&self, index: &[usize]) -> (usize, Option<usize>) {
        let (mut kept, mut other) = (0, 0);
        for ((kind, n), i) in self.kinds.iter().zip(&self.shape).zip(index) {
            let into = if is_kept(*kind) { &mut kept } else { &mut other };
            *into = *into * n + i;
        }
        // Wavelengths are the last axis, so the entries of M00 come first.
        let profile = (self.groups > 0 && kept < self.lanes).then(|| other * self.groups / self.others);
        (kept, profile.map(|g| self.matrix + g))
    }
}

impl GuideBuilder {
    /// Creates a builder for pixels with entries along `axes`. These axes follow rows and columns.
    pub fn new(size: Size, axes: &[Axis]) -> Self {
        let plan = Plan::new(axes);
        let n = size[0] * size[1] * (plan.matrix + plan.groups);
        Self { size, plan, mean: vec![0.0; n], variance: vec![0.0; n] }
    }

    /// Adds a block of entries of all pixels. The block is given by its first index and its shape.
    pub fn add(&mut self, start: &[u64], shape: &[u64], mean: &[f32], error: &[f32]) {
        let lo = vec![0; shape.len()];
        let targets: Vec<_> = tensor::region::indices(&lo, shape)
            .map(|index| {
                let index: Vec<usize> = index.iter().zip(start).map(|(i, s)| (i + s) as usize).collect();
                self.plan.channels(&index)
            })
            .collect();
        let (n, channels) = (targets.len(), self.plan.matrix + self.plan.groups);
        if n == 0 {
            return;
        }
        let lanes = self.plan.lanes as f64;
        for (p, (mean, error)) in mean.chunks_exact(n).zip(error.chunks_exact(n)).enumerate() {
            let at = p * channels;
            for ((&(kept, profile), m), e) in targets.iter().zip(mean).zip(error) {
                let (m, v) = (f64::from(*m), f64::from(*e).powi(2));
                self.mean[at + kept] += m;
                self.variance[at + kept] += v;
                if let Some(c) = profile {
                    self.mean[at + c] += m;
                    // All wavelengths use the same paths, so standard errors are added instead of variances.
                    self.variance[at + c] += lanes * v;
                }
            }
        }
    }
}

impl GuideBuilder {
    /// Marks each pixel that has a non-finite entry in `numbers` as unknown. Does not add any of `numbers` to
    /// the guide.
    pub fn look(&mut self, numbers: &[f32]) {
        let channels = self.plan.matrix + self.plan.groups;
        let of_pixel = numbers.len() / (self.size[0] * self.size[1]).max(1);
        for (p, numbers) in numbers.chunks_exact(of_pixel.max(1)).enumerate() {
            if numbers.iter().any(|x| !x.is_finite()) {
                self.mean[p * channels..][..channels].fill(f64::NAN);
            }
        }
    }
}

impl Guide {
    /// Builds the guide from renders with weights that sum to 1.
    pub fn new(renders: Vec<GuideBuilder>, shares: Vec<f32>) -> Self {
        let (size, first) = (renders[0].size, &renders[0].plan);
        let (matrix, lanes, channels) = (first.matrix, first.lanes, first.matrix + first.groups);
        let judge = (0..matrix).map(|c| c % lanes).collect();
        let pixels = size[0] * size[1];
        let every = |test: &dyn Fn(f64, f64) -> bool| -> Vec<bool> {
            let of = |p: usize, r: &GuideBuilder| {
                (p * channels..(p + 1) * channels).all(|c| test(r.mean[c], r.variance[c]))
            };
            (0..pixels).map(|p| renders.iter().all(|r| of(p, r))).collect()
        };
        let known = every(&|m, v| m.is_finite() && v.is_finite());
        let met =
            |p: usize, r: &GuideBuilder| r.mean[p * channels..(p + 1) * channels].iter().any(|m| *m != 0.0);
        // A pixel that is dark at random has a standard error of zero, which is meaningless.
        let speck = |p: usize| {
            let near = neighbours(p, size).flat_map(|q| renders.iter().map(move |r| met(q, r)));
            let (lit, all) = near.fold((0.0, 0.0), |(lit, all), m| (lit + f64::from(u8::from(m)), all + 1.0));
            lit > LIT * all && !renders.iter().any(|r| met(p, r))
        };
        let exact = every(&|_, v| v == 0.0);
        let still = (0..pixels).map(|p| exact[p] && !speck(p)).collect();
        let largest =
            renders.iter().flat_map(|r| r.mean.iter().zip(&r.variance)).map(|(m, v)| m.abs().max(v.sqrt()));
        let scale = unit(largest.filter(|x| x.is_finite()).fold(0.0, f64::max));
        let finite = |p: usize, x: f64| {
            if known[p / channels.max(1)] { (x * scale) as f32 } else { 0.0 }
        };
        let values = |r: GuideBuilder| Values {
            size,
            channels,
            mean: r.mean.iter().enumerate().map(|(i, m)| finite(i, *m)).collect(),
            error: r.variance.iter().enumerate().map(|(i, v)| finite(i, v.sqrt())).collect(),
        };
        let mut renders: Vec<Values> = renders.into_iter().map(values).collect();
        let outliers = outliers(&renders, lanes, &known);
        for (render, outliers) in renders.iter_mut().zip(&outliers) {
            replace(render, outliers, &known);
        }
        Self { size, renders, shares, judge, known, outliers, still }
    }
}

/// Returns a power of two that scales the largest number to the range 1/2 .. 1. Multiplication by this power
/// is exact.
pub(super) fn unit(largest: f64) -> f64 {
    if largest > 0.0 && largest.is_finite() {
        2.0_f64.powi((-(largest.log2().floor() as i32) - 1).clamp(-1000, 1000))
    } else {
        1.0
    }
}

//! Computes the distance between two pixels relative to their errors.
//!
//! For pixels p and q and each element c with light or noise, the distance is
//!
//! > d²(p, q) = mean_c [(u_c(p) - u_c(q))² - 2 min(V_c(p), V_c(q))] / (V_c(p) + V_c(q)),
//!
//! where u is the rendered value and V its variance. d² is averaged over the pixels of two patches. For equal
//! light with equal noise, d² is 0 on average. Where the light differs by more than its standard errors, d²
//! is large.
//!
//! The formula follows Rousselle et al. (2012, eq. 4), with 2 min(V(p), V(q)) in place of V(p) + min(V(p),
//! V(q)). The distance is therefore symmetric. Two pixels of different brightness have the same weight in
//! each other's mean. With an asymmetric distance, the denoised image would be too dark. An element with much
//! less noise than M00 of its wavelength is treated as if it had a hundredth of M00's standard error.
//!
//! Profiles, for example over time, have light in few of many entries. A mean of ratios would not detect a
//! shift of the light by one entry. The distance of profiles is therefore the ratio of sums,
//!
//! > d²(p, q) = Σ_g [(u_g(p) - u_g(q))² - 2 min(V_g(p), V_g(q))] / Σ_g (V_g(p) + V_g(q)),
//!
//! and the larger of the two distances d² is used.

use super::guide::Guide;
use super::{REACH, Size};
use rayon::prelude::*;
use std::ops::Range;

/// Number of separate partial sums. Because this number is constant, the order of summation is the same for
/// every vector width.
pub(super) const LANES: usize = 8;

/// Number of offsets of the window along an axis.
const SIDE: usize = 2 * REACH + 1;
pub const WINDOW: usize = SIDE * SIDE;
/// Index of the offset from a pixel to itself.
pub const MIDDLE: usize = WINDOW / 2;

/// Largest d² of one element.
const FAR: f32 = 1e6;

/// Smallest variance of an element relative to the variance of M00.
const QUIET: f32 = 1e-4;

/// Returns the distance in rows and columns from a pixel to the neighbour with offset index `o`.
pub fn offset(o: usize) -> [isize; 2] {
    [o / SIDE, o % SIDE].map(|i| i as isize - REACH as isize)
}

/// Returns the neighbour of pixel `p` with offset index `o`, or `None` if the neighbour is outside the image.
pub fn neighbour(p: usize, o: usize, [height, width]: Size) -> Option<usize> {
    let [dy, dx] = offset(o);
    let y = (p / width).checked_add_signed(dy).filter(|y| *y < height)?;
    let x = (p % width).checked_add_signed(dx).filter(|x| *x < width)?;
    Some(y * width + x)
}

/// The distance d² of two pixels, and its derivatives. A derivative is the increase of d² if the value of
/// every element of one pixel increases by one standard error.
#[derive(Clone, Copy, Debug, Default)]
struct Pair {
    d2: f32,
    slopes: [f32; 2],
}

/// The distance d² of each pair of pixels within [`super::REACH`].
pub struct Likeness {
    size: Size,
    /// For each offset before the middle offset, an image of pixel pairs. A pair consists of a pixel and the
    /// pixel at that offset.
    planes: Vec<Vec<Pair>>,
}

impl Likeness {
    /// Computes the distances for one render of a guide, with patches of radius `patch` pixels. Unknown
    /// pixels are ignored.
    pub fn new(guide: &Guide, render: usize, patch: usize) -> Self {
        let (size, elements) = (guide.size, guide.judge.len());
        let matrix = Noise::new(guide, render, 0..elements);
        let profile = Noise::new(guide, render, elements..guide.renders[render].channels);
        let planes = (0..MIDDLE).into_par_iter().map(|o| {
            let of = |pair: &dyn Fn(usize, usize) -> Sums| {
                let sum = |p: usize| {
                    let q = neighbour(p, o, size).filter(|q| guide.known[p] && guide.known[*q]);
                    q.map_or(Sums::default(), |q| pair(p, q))
                };
                let sums: Vec<Sums> = (0..guide.known.len()).map(sum).collect();
                patches(&sums, size, patch)
            };
            let mut plane = of(&|p, q| matrix.elements(p, q));
            if profile.channels > 0 {
                for (pair, profile) in plane.iter_mut().zip(of(&|p, q| profile.profile(p, q))) {
                    if profile.d2 > pair.d2 {
                        *pair = profile;
                    }
                }
            }
            plane
        });
        Self { size, planes: planes.collect() }
    }

    /// Returns d² of a pixel and its neighbour `q` at offset `o`. Also returns the derivative of d² with
    /// respect to the noise of the pixel.
    pub fn of(&self, p: usize, o: usize, q: usize) -> [f32; 2] {
        debug_assert_eq!(neighbour(p, o, self.size), Some(q));
        match o {
            MIDDLE => [0.0; 2],
            o if o < MIDDLE => [self.planes[o][p].d2, self.planes[o][p].slopes[0]],
            o => {
                let pair = &self.planes[WINDOW - 1 - o][q];
                [pair.d2, pair.slopes[1]]
            }
        }
    }
}

/// Numerator and denominator of d², summed over two pixels.
#[derive(Clone, Copy, Default)]
struct Sums {
    d2: f32,
    /// Denominator of d². The denominator is the number of elements with light or noise, or the sum of the
    /// variances of a profile.
    under: f32,
    slopes: [f32; 2],
}

/// Returns d² of patches. The derivative is known only with respect to the noise of the central pixel.
fn patches(sums: &[Sums], [height, width]: Size, patch: usize) -> Vec<Pair> {
    let mut across = vec![[0.0_f32; 2]; sums.len()];
    let mut out = Vec::with_capacity(sums.len());
    for (p, a) in across.iter_mut().enumerate() {
        let (row, x) = (p / width * width, p % width);
        for near in x.saturating_sub(patch)..(x + patch + 1).min(width) {
            let near = sums[row + near];
            *a = [a[0] + near.d2, a[1] + near.under];
        }
    }
    for (p, own) in sums.iter().enumerate() {
        let (y, x) = (p / width, p % width);
        let (mut s, mut n) = (0.0, 0.0);
        for near in y.saturating_sub(patch)..(y + patch + 1).min(height) {
            s += across[near * width + x][0];
            n += across[near * width + x][1];
        }
        let far = n <= 0.0 && s > 0.0;
        let n = if n > 0.0 { n } else { 1.0 };
        out.push(Pair { d2: if far { FAR } else { s / n }, slopes: own.slopes.map(|slope| slope / n) });
    }
    out
}

/// Values, standard errors with the signs of the values, and lower bounds of the variances. Channels are
/// padded to whole vectors.
struct Noise {
    channels: usize,
    mean: Vec<f32>,
    error: Vec<f32>,
    floor: Vec<f32>,
}

impl Noise {
    /// Builds the arrays for a range of channels.
    fn new(guide: &Guide, render: usize, own: Range<usize>) -> Self {
        let values = &guide.renders[render];
        let n = values.channels;
        let channels = own.len().next_multiple_of(LANES);
        let mut all = [(); 3].map(|()| vec![0.0_f32; guide.known.len() * channels]);
        for p in 0..guide.known.len() {
            for c in own.clone() {
                let at = p * channels + c - own.start;
                all[0][at] = values.mean[p * n + c];
                all[1][at] = values.error[p * n + c].copysign(values.mean[p * n + c]);
                let judge = guide.judge.get(c).map_or(0.0, |j| values.error[p * n + j]);
                all[2][at] = QUIET * judge * judge;
            }
        }
        let [mean, error, floor] = all;
        Self { channels, mean, error, floor }
    }

    /// Returns the sums for a profile.
    fn profile(&self, p: usize, q: usize) -> Sums {
        let mut sums = Sums::default();
        for (i, j) in (p * self.channels..(p + 1) * self.channels).zip(q * self.channels..) {
            let d = self.mean[i] - self.mean[j];
            let (ep, eq) = (self.error[i], self.error[j]);
            let least = ep.abs().min(eq.abs());
            sums.d2 += d * d - 2.0 * least * least;
            sums.under += ep * ep + eq * eq;
            sums.slopes[0] += 2.0 * d * ep;
            sums.slopes[1] -= 2.0 * d * eq;
        }
        sums
    }

    /// Returns the sums for a matrix or an intensity.
    fn elements(&self, p: usize, q: usize) -> Sums {
        let at = |p: usize| p * self.channels..(p + 1) * self.channels;
        let (ps, qs) = (at(p), at(q));
        let [up, uq] = [&self.mean[ps.clone()], &self.mean[qs.clone()]];
        let [ep, eq] = [&self.error[ps.clone()], &self.error[qs.clone()]];
        let [fp, fq] = [&self.floor[ps], &self.floor[qs]];
        let [mut sum, mut count, mut first, mut second] = [[0.0_f32; LANES]; 4];
        for lane in (0..self.channels).step_by(LANES) {
            for l in 0..LANES {
                let c = lane + l;
                let d = up[c] - uq[c];
                let (vp, vq) = (ep[c] * ep[c], eq[c] * eq[c]);
                let least = if vp < vq { vp } else { vq };
                let (v, floor) = (vp + vq, fp[c] + fq[c]);
                let under = if v > floor { v } else { floor };
                let under = if under > f32::MIN_POSITIVE { under } else { f32::MIN_POSITIVE };
                let ratio = (d * d - 2.0 * least) / under;
                let far = ratio >= FAR;
                let slope = if far { 0.0 } else { 2.0 * d / under };
                sum[l] += if far { FAR } else { ratio };
                count[l] += if v > 0.0 || d != 0.0 { 1.0 } else { 0.0 };
                first[l] += slope * ep[c];
                second[l] -= slope * eq[c];
            }
        }
        let [d2, under, first, second] = [sum, count, first, second].map(|s| s.iter().sum());
        Sums { d2, under, slopes: [first, second] }
    }
}

//! Computes the weights of the mean at each pixel, from several denoising strengths with different estimated
//! errors.
//!
//! Weights of strength k are exp(-max(0, d²)/k²), normalized. For the mean F with these weights, the rendered
//! value M and its variance V, the mean of
//!
//! > R = (F - M)² - V + 2 V ∂F/∂M
//!
//! is the expected squared error of F for any truth (Stein 1981). ∂F/∂M includes the pixel's own weight and
//! the change of its weights due to its noise. The noise is assumed to be fully correlated between elements,
//! which is correct if rare paths cause the noise.
//!
//! R of a single pixel is uncertain. R is therefore averaged over the elements (each divided by the variance
//! of M00) and over a box of pixels. The strength with the smallest R is chosen. The fractions of the
//! strengths are then averaged over neighbouring pixels to avoid visible boundaries. The result is again a
//! set of non-negative weights with sum 1.

use super::around::around;
use super::guide::Guide;
use super::likeness::{Likeness, MIDDLE, WINDOW, neighbour};
use super::variance::{squares, variances};
use super::{CALM, PATCH, STRENGTHS, Size, Values};
use rayon::prelude::*;

/// Threshold below which weights are set to zero.
const LEAST: f32 = 0.003;

const KINDS: usize = STRENGTHS.len();

/// The weights of the pixels around each pixel.
pub struct Weights {
    pub size: Size,
    /// For each render and pixel, the weights of the pixels in the window.
    pub of: Vec<Vec<f32>>,
    /// The increase of each weight if the pixel's value increases by one standard error. This value is taken
    /// from the render that determines the weights.
    pub slopes: Vec<Vec<f32>>,
    /// Weight of each render in the mean.
    pub shares: Vec<f32>,
    /// Pixels with finite values.
    pub known: Vec<bool>,
    /// For each render, whether each pixel is replaced by the mean of the pixel's neighbours.
    pub outliers: Vec<Vec<bool>>,
    /// Pixels that are averaged: known pixels with a nonzero standard error, and dark pixels among lit
    /// pixels. Other pixels do not change.
    pub moved: Vec<bool>,
}

impl Weights {
    /// Computes the weights for the pixels of a guide.
    pub fn new(guide: &Guide) -> Self {
        let likeness: Vec<Likeness> = (0..guide.renders.len())
            .map(|render| Likeness::new(guide, other(render, guide.renders.len()), PATCH))
            .collect();
        let moved: Vec<bool> = guide.known.iter().zip(&guide.still).map(|(k, s)| *k && !s).collect();
        let kinds = kinds(guide, &likeness, &moved);
        let (mut of, mut slopes) = (vec![], vec![]);
        for likeness in &likeness {
            let [mut weights, mut changes] = [(); 2].map(|()| vec![0.0; moved.len() * WINDOW]);
            let windows = weights.par_chunks_mut(WINDOW).zip(changes.par_chunks_mut(WINDOW));
            windows.enumerate().for_each(|(p, (weights, changes))| {
                if !moved[p] {
                    weights[MIDDLE] = 1.0;
                    return;
                }
                for (kind, share) in candidates(guide, likeness, p).iter().zip(&kinds[p * KINDS..]) {
                    add(weights, *share, &kind.weights);
                    add(changes, *share, &kind.slopes);
                }
            });
            of.push(weights);
            slopes.push(changes);
        }
        Self {
            size: guide.size,
            of,
            slopes,
            shares: guide.shares.clone(),
            known: guide.known.clone(),
            outliers: guide.outliers.clone(),
            moved,
        }
    }
}

/// Returns the index of the render that determines the weights of render `render`. If there are two renders,
/// this is the other render.
pub(super) fn other(render: usize, renders: usize) -> usize {
    renders - 1 - render
}

/// The weights of a pixel's window, and their derivatives with respect to the pixel's noise.
struct Candidate {
    weights: [f32; WINDOW],
    slopes: [f32; WINDOW],
}

/// Returns the normalized weights of each strength.
fn candidates(guide: &Guide, likeness: &Likeness, p: usize) -> [Candidate; KINDS] {
    let mut all = STRENGTHS.map(|_| Candidate { weights: [0.0; WINDOW], slopes: [0.0; WINDOW] });
    for o in 0..WINDOW {
        let Some(q) = neighbour(p, o, guide.size).filter(|q| guide.known[*q]) else {
            continue;
        };
        let [d2, slope] = likeness.of(p, o, q);
        for (kind, k) in all.iter_mut().zip(STRENGTHS) {
            let w = libm::expf(-d2.max(0.0) / (k * k));
            kind.weights[o] = if w < LEAST { 0.0 } else { w };
            kind.slopes[o] = if d2 > 0.0 { -slope / (k * k) } else { 0.0 };
        }
    }
    for Candidate { weights, slopes } in &mut all {
        let sum: f32 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        let mean: f32 = weights.iter().zip(slopes.iter()).map(|(w, s)| w * s).sum();
        slopes.iter_mut().zip(weights.iter()).for_each(|(s, w)| *s = w * (*s - mean));
    }
    all
}

/// Weighted sums over the window of one pixel, and the covariances of the sums with the pixel's values.
pub(super) struct Sums {
    /// Weighted sums Σ w y over all renders, per channel.
    pub mean: Vec<f32>,
    /// Covariance of the mean with the rendered value.
    pub common: Vec<f32>,
    part: Vec<f32>,
}

impl Sums {
    pub fn new(channels: usize) -> Self {
        let [mean, common, part] = [(); 3].map(|()| vec![0.0; channels]);
        Self { mean, common, part }
    }

    pub fn clear(&mut self) {
        self.mean.fill(0.0);
        self.common.fill(0.0);
    }

    /// Adds the contribution of a render at pixel `p`. `values`, `share` and `own` are the render's values,
    /// its weight in the mean, and its variances at the pixel. `from`, `of` and `noise` are the same data for
    /// the render from which the weights are computed.
    pub fn add(
        &mut self,
        [weights, slopes]: [&[f32]; 2],
        p: usize,
        (values, share, own): (&Values, f32, &[f32]),
        (from, of, noise): (&Values, f32, &[f32]),
    ) {
        let n = values.channels;
        self.part.fill(0.0);
        for (o, w) in weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
            let Some(q) = neighbour(p, o, values.size) else {
                continue;
            };
            let y = &values.mean[q * n..][..n];
            add(&mut self.mean, share * w, y);
            add(&mut self.part, slopes[o], y);
        }
        let m = &from.mean[p * n..][..n];
        for c in 0..n {
            let sigma = noise[c].sqrt().copysign(m[c]);
            self.common[c] += share * (share * weights[MIDDLE] * own[c] + of * sigma * self.part[c]);
        }
    }
}

/// Returns the fraction of each denoising strength in the weights of each pixel.
fn kinds(guide: &Guide, likeness: &[Likeness], moved: &[bool]) -> Vec<f32> {
    let channels = guide.renders[0].channels;
    let n = moved.len() * channels;
    let (mut mean, mut noise, mut stated) = (vec![0.0_f32; n], vec![0.0_f32; n], vec![0.0_f32; n]);
    let mut own = Vec::new();
    for (values, share) in guide.renders.iter().zip(&guide.shares) {
        let v = variances(values, &guide.known);
        for i in 0..n {
            mean[i] += share * values.mean[i];
            noise[i] += share * share * v[i];
        }
        for (sum, v) in stated.iter_mut().zip(squares(values, &guide.known)) {
            *sum += share * share * v;
        }
        own.push(v);
    }
    let scale = around(&stated, guide.size, channels, CALM, &guide.known);
    // A profile has the same weight in R as one element at all wavelengths.
    let elements = guide.judge.len();
    let lanes = 1 + guide.judge.iter().max().copied().unwrap_or(0);
    let whole = |of: &[f32]| of[elements..].iter().sum::<f32>() / lanes as f32;
    let profile: Vec<f32> = scale.chunks(channels.max(1)).map(whole).collect();
    let mut risks = vec![0.0_f32; moved.len() * KINDS];
    let width = guide.size[1].max(1);
    risks.par_chunks_mut(width * KINDS).enumerate().for_each(|(y, risks)| {
        let mut sums = Sums::new(channels);
        for (x, risks) in risks.chunks_mut(KINDS).enumerate() {
            let p = y * width + x;
            if !moved[p] {
                continue;
            }
            let at = p * channels..(p + 1) * channels;
            let over = |c: usize| match guide.judge.get(c) {
                Some(judge) => scale[p * channels + judge],
                None => profile[p],
            };
            let all: Vec<_> = likeness.iter().map(|l| candidates(guide, l, p)).collect();
            for (kind, risk) in risks.iter_mut().enumerate() {
                sums.clear();
                for (render, candidates) in all.iter().enumerate() {
                    let Candidate { weights, slopes } = &candidates[kind];
                    let part = |r: usize| (&guide.renders[r], guide.shares[r], &own[r][at.clone()]);
                    sums.add([weights, slopes], p, part(render), part(other(render, all.len())));
                }
                for c in 0..channels {
                    let of = over(c);
                    if of > 0.0 {
                        let i = p * channels + c;
                        *risk += ((sums.mean[c] - mean[i]).powi(2) - noise[i] + 2.0 * sums.common[c]) / of;
                    }
                }
            }
        }
    });
    let risks = around(&risks, guide.size, KINDS, CALM, moved);
    let mut best = vec![0.0; risks.len()];
    for ((risks, best), moved) in risks.chunks(KINDS).zip(best.chunks_mut(KINDS)).zip(moved) {
        if *moved {
            let least = (1..KINDS).fold(0, |least, k| if risks[k] < risks[least] { k } else { least });
            best[least] = 1.0;
        }
    }
    around(&best, guide.size, KINDS, 1, moved)
}

/// Adds a multiple of values to sums.
pub(super) fn add(sums: &mut [f32], weight: f32, values: &[f32]) {
    for (sum, v) in sums.iter_mut().zip(values) {
        *sum += weight * v;
    }
}

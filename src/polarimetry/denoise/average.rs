//! Weighted means of the channels of an image, with the standard errors of the means.
//!
//! The error of the weighted mean F = Σ w y combines the propagated variance P = Σ w² V and the squared bias
//! of F. With the rendered value M and its variance V, the squared bias is estimated by
//!
//! > b² = (F - M)² - V + 2 V ∂F/∂M - P
//!
//! (see [`super::weights`]). The estimate for a single pixel is far too noisy. The estimate is therefore
//! averaged over a box of pixels, and negative values are treated as zero. The replacement of outliers
//! ([`super::outliers`]) removes light. The removed light is a further bias, and its square is added.

use super::around::around;
use super::guide::unit;
use super::likeness::{WINDOW, neighbour};
use super::outliers::replace;
use super::variance::variances;
use super::weights::{Sums, Weights, add, other};
use super::{CALM, Values};
use rayon::prelude::*;

/// Averages the values of the renders with the weights of each pixel. Pixels that are not averaged keep the
/// value of the render, or the mean of the two renders.
///
/// # Panics
/// Panics if the number of renders or pixels differs from the number in the weights.
pub fn average(weights: &Weights, renders: &[Values]) -> Values {
    assert_eq!(renders.len(), weights.of.len(), "expected one set of weights per render");
    let mut out = kept(weights, renders);
    let channels = out.channels;
    if out.mean.is_empty() {
        return out;
    }
    let (mut scaled, scale) = scaled(renders, &weights.known);
    let taken: Vec<Vec<f32>> = scaled
        .iter_mut()
        .zip(&weights.outliers)
        .map(|(r, outliers)| replace(r, outliers, &weights.known))
        .collect();
    let noise: Vec<Vec<f32>> = scaled.iter().map(|r| variances(r, &weights.known)).collect();
    let row = weights.size[1] * channels;
    // Propagated variances and bias estimates.
    let mut spread = vec![0.0_f32; out.mean.len()];
    let mut bias = vec![0.0_f32; out.mean.len()];
    let rows = out.mean.par_chunks_mut(row).zip(spread.par_chunks_mut(row));
    rows.zip(bias.par_chunks_mut(row)).enumerate().for_each(|(y, ((mean, spread), bias))| {
        let mut sums = Sums::new(channels);
        let pixels = mean.chunks_mut(channels).zip(spread.chunks_mut(channels));
        for (x, ((mean, spread), bias)) in pixels.zip(bias.chunks_mut(channels)).enumerate() {
            let p = y * weights.size[1] + x;
            if !weights.moved[p] {
                continue;
            }
            let at = p * channels..(p + 1) * channels;
            let part = |r: usize| (&scaled[r], weights.shares[r], &noise[r][at.clone()]);
            let window = p * WINDOW..(p + 1) * WINDOW;
            sums.clear();
            // The rendered values M and their variances V.
            let (mut rendered, mut own) = (vec![0.0_f32; channels], vec![0.0_f32; channels]);
            // The increase of the mean if outliers were included.
            let mut left = vec![0.0_f32; channels];
            for (render, share) in weights.shares.iter().enumerate() {
                let of = &weights.of[render][window.clone()];
                let slopes = &weights.slopes[render][window.clone()];
                sums.add([of, slopes], p, part(render), part(other(render, scaled.len())));
                for (o, w) in of.iter().enumerate().filter(|(_, w)| **w > 0.0) {
                    let Some(q) = neighbour(p, o, weights.size) else {
                        continue;
                    };
                    add(spread, (share * w).powi(2), &noise[render][q * channels..][..channels]);
                    if weights.outliers[render][q] {
                        add(&mut left, share * w, &taken[render][q * channels..][..channels]);
                    }
                }
                add(&mut rendered, *share, &scaled[render].mean[at.clone()]);
                add(&mut own, share * share, &noise[render][at.clone()]);
            }
            for c in 0..channels {
                bias[c] = (sums.mean[c] - rendered[c]).powi(2) - own[c] + 2.0 * sums.common[c] - spread[c];
                mean[c] = sums.mean[c] / scale;
                spread[c] += left[c] * left[c];
            }
        }
    });
    let bias = around(&bias, weights.size, channels, CALM, &weights.moved);
    let errors = out.error.chunks_mut(channels);
    let squares = spread.chunks(channels).zip(bias.chunks(channels));
    for ((errors, (spread, bias)), _) in errors.zip(squares).zip(&weights.moved).filter(|(_, moved)| **moved)
    {
        for ((e, s), b) in errors.iter_mut().zip(spread).zip(bias) {
            *e = (s + b.max(0.0)).sqrt() / scale;
        }
    }
    out
}

/// Returns the values of known pixels, and a scale factor. The values are multiplied by this factor so that
/// their squares do not overflow. Unknown pixels are zero.
fn scaled(renders: &[Values], known: &[bool]) -> (Vec<Values>, f32) {
    let all = renders.iter().flat_map(|r| r.mean.iter().chain(&r.error));
    let largest = all.map(|x| x.abs()).filter(|x| x.is_finite()).fold(0.0, f32::max);
    let scale = unit(f64::from(largest)).clamp(2.0_f64.powi(-126), 2.0_f64.powi(126)) as f32;
    let of = |v: &[f32], channels: usize| -> Vec<f32> {
        let number = |(i, x): (usize, &f32)| if known[i / channels] { x * scale } else { 0.0 };
        v.iter().enumerate().map(number).collect()
    };
    let all = renders.iter().map(|r| Values {
        mean: of(&r.mean, r.channels),
        error: of(&r.error, r.channels),
        ..*r
    });
    (all.collect(), scale)
}

/// Returns the values of pixels that are not averaged. Each value is the value of the render, or the mean of
/// the values of two renders, with its standard error.
fn kept(weights: &Weights, renders: &[Values]) -> Values {
    if let [only] = renders {
        return only.clone();
    }
    let of = |f: &dyn Fn(&Values, usize, f32) -> f64| -> Vec<f64> {
        let n = renders[0].mean.len();
        let all = (0..n).map(|i| renders.iter().zip(&weights.shares).map(|(r, s)| f(r, i, *s)).sum());
        all.collect()
    };
    let mean = of(&|r, i, s| f64::from(s) * f64::from(r.mean[i]));
    let variance = of(&|r, i, s| (f64::from(s) * f64::from(r.error[i])).powi(2));
    Values {
        size: renders[0].size,
        channels: renders[0].channels,
        mean: mean.into_iter().map(|m| m as f32).collect(),
        error: variance.into_iter().map(|v| v.sqrt() as f32).collect(),
    }
}

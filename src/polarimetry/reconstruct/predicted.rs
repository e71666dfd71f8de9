//! Predicts the noise of counts from a first estimate. The predicted noise determines the weights of a second
//! estimate.

use super::along_rays::{Places, reconstruct};
use super::pixels::Options;
use crate::capture::design_matrix::{DesignMatrix, RankError};
use crate::capture::element::Ray;
use crate::capture::scheme::Scheme;
use crate::capture::simulate::Layout;
use rayon::prelude::*;

/// Number of neighbouring bins on each side that are averaged.
const NEAR: usize = 4;

/// Returns the variances of counts, predicted from a first, unweighted estimate of the matrices. The counts
/// alone are not sufficient, because a bin without counts has no variance estimate.
///
/// `matrices` receives the first estimate, with 16 elements per pixel in the order of `layout`. `rays` holds
/// one ray per wavelength, or one ray per position and wavelength. `variance` returns the variance of a
/// reading from a radiance and a wavelength in nanometres. All other arguments are as for [`reconstruct`].
///
/// # Errors
/// Returns an error if the captures do not determine a Mueller matrix and there is no prior.
///
/// # Panics
/// Panics if the lengths of the arguments do not match.
pub fn of_counts(
    scheme: &Scheme,
    rays: &[Ray],
    layout: Layout,
    options: &Options,
    counts: &[f32],
    matrices: &mut [f32],
    variance: &(dyn Fn(f64, f64) -> f64 + Sync),
) -> Result<Vec<f32>, RankError> {
    let places = Places { rays, times: layout.times, lanes: layout.lanes };
    reconstruct(scheme, places, options, counts, None, matrices, None)?;
    Ok(predicted(scheme, rays, layout, matrices, variance))
}

/// Returns the variances that follow from matrices, sorted by measurement and then by pixel. The predicted
/// intensity is averaged over a pixel's neighbours in time, because the estimate of a single bin is as noisy
/// as the reading.
///
/// `matrices` holds 16 elements per pixel in the order of `layout`. `rays` holds one ray per wavelength, or
/// one ray per position and wavelength. `variance` returns the variance of a reading from a radiance and a
/// wavelength in nanometres.
///
/// # Panics
/// Panics if there are too few rays or matrices.
fn predicted(
    scheme: &Scheme,
    rays: &[Ray],
    layout: Layout,
    matrices: &[f32],
    variance: &(dyn Fn(f64, f64) -> f64 + Sync),
) -> Vec<f32> {
    let Layout { times, lanes, .. } = layout;
    let pixels = layout.pixels();
    let count = scheme.measurements();
    let shared: Vec<DesignMatrix> = if rays.len() == lanes {
        rays.iter().map(|ray| DesignMatrix::new(scheme, ray)).collect()
    } else {
        vec![]
    };
    let place = |p: usize| -> Vec<f32> {
        let mut out = Vec::with_capacity(count * times * lanes);
        for lane in 0..lanes {
            let ray = rays[if shared.is_empty() { p * lanes + lane } else { lane }];
            let own = shared.is_empty().then(|| DesignMatrix::new(scheme, &ray));
            let Some(design) = own.as_ref().or(shared.get(lane)) else {
                continue;
            };
            for m in 0..count {
                let clean = |t: usize| -> f64 {
                    let matrix = &matrices[((p * times + t) * lanes + lane) * 16..][..16];
                    let terms = matrix.iter().enumerate();
                    terms.map(|(e, v)| design.a[(m, e)] * f64::from(*v)).sum()
                };
                let clean: Vec<f64> = (0..times).map(clean).collect();
                for t in 0..times {
                    let near = &clean[t.saturating_sub(NEAR)..(t + NEAR + 1).min(times)];
                    let known = near.iter().filter(|v| v.is_finite());
                    let (n, sum) = known.fold((0.0, 0.0), |(n, s), v| (n + 1.0, s + v));
                    out.push(variance(if n > 0.0 { sum / n } else { 0.0 }, ray.nm) as f32);
                }
            }
        }
        out
    };
    let places: Vec<Vec<f32>> = (0..layout.height * layout.width).into_par_iter().map(place).collect();
    let mut out = vec![0.0; count * pixels];
    for (p, all) in places.iter().enumerate() {
        for (i, times_of) in all.chunks_exact(times.max(1)).enumerate() {
            let (lane, m) = (i / count.max(1), i % count.max(1));
            for (t, v) in times_of.iter().enumerate() {
                out[m * pixels + (p * times + t) * lanes + lane] = *v;
            }
        }
    }
    out
}

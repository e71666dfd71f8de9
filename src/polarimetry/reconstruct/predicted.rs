//! What a first estimate says of the noise of counts, so that a second can weigh them.

use super::along_rays::{Places, reconstruct};
use super::pixels::Options;
use crate::capture::design_matrix::{DesignMatrix, RankError};
use crate::capture::element::Ray;
use crate::capture::scheme::Scheme;
use crate::capture::simulate::Layout;
use rayon::prelude::*;

/// Bins on each side of one that count with it.
const NEAR: usize = 4;

/// Variances of counts: those that a first estimate without weights predicts, because a bin without counts says nothing of its own.
///
/// The estimate, 16 elements a pixel in the order of `layout`, is left in `matrices`; `rays` are one for each wavelength, or for each
/// place and wavelength; `variance` is that of a reading of some radiance at a wavelength in nanometres; the rest as of [`reconstruct`].
///
/// # Errors
/// If the captures do not determine a Mueller matrix and there is no prior.
///
/// # Panics
/// If lengths do not agree.
pub fn of_counts(
    scheme: &Scheme,
    rays: &[Ray],
    layout: Layout,
    options: &Options,
    counts: &[f32],
    matrices: &mut [f32],
    variance: &(dyn Fn(f64, f64) -> f64 + Sync),
) -> Result<Vec<f32>, RankError> {
    let places = Places {
        rays,
        times: layout.times,
        lanes: layout.lanes,
    };
    reconstruct(scheme, places, options, counts, None, matrices, None)?;
    Ok(predicted(scheme, rays, layout, matrices, variance))
}

/// Variances that matrices predict, measurement by measurement, each for all pixels: of the mean of each measurement over a
/// pixel's neighbours in time, since a bin's own estimate is as noisy as what it is to weigh.
///
/// `matrices` are 16 elements a pixel in the order of `layout`; `rays` one for each wavelength, or for each place and wavelength;
/// `variance` is that of a reading of some radiance at a wavelength in nanometres.
///
/// # Panics
/// If there are fewer rays or matrices.
#[must_use]
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
    let places: Vec<Vec<f32>> = (0..layout.height * layout.width)
        .into_par_iter()
        .map(place)
        .collect();
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

//! Reconstructs images in which every pixel has its own ray. Each ray has its own design matrix because of
//! oblique plates or galvo mirrors.
//!
//! The function processes a few thousand pixels at a time, because the estimator of each pixel takes
//! kilobytes.

use super::pixels::{Options, PixelNumber, Reconstruction, Tally};
use crate::capture::design_matrix::RankError;
use crate::capture::element::Ray;
use crate::capture::scheme::Scheme;

/// Maximum number of rays whose estimators are in memory simultaneously.
const AT_ONCE: usize = 2048;

/// The mapping from pixels to rays. Positions are first, followed by separate captures and wavelengths.
#[derive(Clone, Copy, Debug)]
pub struct Places<'a> {
    /// Rays of each wavelength, or rays of each position and wavelength.
    pub rays: &'a [Ray],
    /// Number of separate captures at a position. These captures share the rays of the position.
    pub times: usize,
    /// Number of wavelengths.
    pub lanes: usize,
}

/// Reconstructs images along the rays of their pixels. All other arguments are as for
/// [`Reconstruction::apply`].
///
/// # Errors
/// Returns an error if the captures do not determine a Mueller matrix and there is no prior.
///
/// # Panics
/// Panics if the lengths of the arguments do not match.
pub fn reconstruct<T: PixelNumber>(
    scheme: &Scheme,
    Places { rays, times, lanes }: Places<'_>,
    options: &Options,
    intensities: &[T],
    variances: Option<&[T]>,
    out: &mut [T],
    mut errors: Option<&mut [T]>,
) -> Result<Tally, RankError> {
    if rays.len() == lanes {
        let all = Reconstruction::<T>::new(scheme, rays, options.clone())?;
        return Ok(all.apply(intensities, variances, out, errors));
    }
    let pixels = out.len() / 16;
    let (count, zero) = (scheme.measurements(), T::default());
    assert_eq!(pixels, rays.len() * times, "expected one ray per position and wavelength");
    let mut tally = Tally::default();
    let step = (AT_ONCE / lanes.max(1)).max(1) * lanes;
    for (i, rays) in rays.chunks(step).enumerate() {
        // Rays vary fastest, because each ray is a lane of the estimator. Separate captures vary slowest.
        let (n, first) = (rays.len(), i * step);
        let place = |j: usize| {
            let (t, ray) = (j / n, first + j % n);
            (ray / lanes * times + t) * lanes + ray % lanes
        };
        let gather = |from: &[T]| -> Vec<T> {
            let of = |m: usize| (0..n * times).map(move |j| from[m * pixels + place(j)]);
            (0..count).flat_map(of).collect()
        };
        let estimates = Reconstruction::<T>::new(scheme, rays, options.clone())?;
        let weights = variances.map(gather);
        let mut found = vec![zero; n * times * 16];
        let mut stated = vec![zero; if errors.is_some() { n * times * 16 } else { 0 }];
        let part = estimates.apply(
            &gather(intensities),
            weights.as_deref(),
            &mut found,
            errors.is_some().then_some(&mut stated[..]),
        );
        tally = tally.with(part);
        for j in 0..n * times {
            let to = 16 * place(j)..16 * place(j) + 16;
            out[to.clone()].copy_from_slice(&found[16 * j..][..16]);
            if let Some(errors) = errors.as_deref_mut() {
                errors[to].copy_from_slice(&stated[16 * j..][..16]);
            }
        }
    }
    Ok(tally)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::directions::Directions;
    use crate::capture::simulate::{Layout, Noise, simulate};

    /// Verifies that reconstruction along each pixel's ray recovers the matrices. Reconstruction along the
    /// axis does not recover the matrices.
    #[test]
    fn oblique_plates_are_corrected_along_rays() {
        let mut scheme = Scheme::drr(36, false).expect("a scheme");
        let layout = Layout { height: 3, width: 4, times: 2, lanes: 2 };
        scheme.name = "oblique".into();
        let matrices: Vec<f64> = (0..layout.pixels() * 16)
            .map(|i| if i % 16 == 0 { 1.0 } else { ((i * 7919) % 100) as f64 / 400.0 })
            .collect();
        let view = Directions::pinhole(1.0, layout.width, layout.height);
        let nm = [450.0, 650.0];
        let rays = view.rays(layout, &nm);
        let seen = simulate(&matrices, layout, &scheme, &rays, &Noise::None, 1).expect("captures");
        let error = |rays: &[Ray]| {
            let mut out = vec![0.0_f32; matrices.len()];
            let places = Places { rays, times: layout.times, lanes: layout.lanes };
            let options = Options::default();
            reconstruct(&scheme, places, &options, &seen.intensities, None, &mut out, None).expect("rank 16");
            let pairs = out.iter().zip(&matrices);
            pairs.map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
        };
        assert!(error(&rays) < 2e-5, "{}", error(&rays));
        let axial = error(&Directions::Axial.rays(layout, &nm));
        assert!(axial > 3e-3, "{axial}");
    }
}

//! Optimizes scan and polarization jointly, as in Baek & Heide (2021, section 8.1). With all light, this is
//! the method of Baek et al. (2018).
//!
//! The unknowns are the depths, and the choice between the two candidate normals from polarization in each
//! pixel. The normals of the current surface select the candidates. Then the least-squares surface is fitted
//! to the depths and the selected normals ([`super::fusion`]). These two steps are repeated at most ten
//! times, until no selection changes.
//!
//! Normals of the surface are fitted to windows and do not resolve curvature within a window. Polarization
//! yields a normal for each pixel. The final normals are therefore the means of surface normals and
//! polarization normals, weighted by inverse variances.
//!
//! Polarization alone does not determine the refractive index. The index can therefore be fitted. The fitted
//! index minimizes the median absolute difference between the zenith angles from polarization and the zenith
//! angles of the coarse surface.

use super::fusion::{Believed, fuse};
use super::polarization::{Cues, Reflection, cues, frame, nearest};
use super::surface_normals::{Window, normals};
use crate::map::Map;
use crate::pinhole::Pinhole;
use nalgebra::Vector3;

/// Maximum number of iterations.
const ROUNDS: usize = 10;

/// Minimum, maximum and step of the search for the refractive index.
const INDICES: [f64; 3] = [1.15, 2.5, 0.05];

#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Depth along the camera's axis, in metres, in one channel.
    pub depth: Map,
    /// Unit normals in the camera's frame, in three channels.
    pub normals: Map,
}

/// The result of the joint optimization.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Least-squares depths, and normals. Each normal is the mean of the surface normal and the selected
    /// candidate normal.
    pub surface: Surface,
    /// The selected candidate normal in each pixel, in the camera's frame, in three channels.
    pub chosen: Map,
    /// Refractive index, given or fitted.
    pub index: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Refractive index of the object, or `None` to fit the index.
    pub index: Option<f64>,
    /// Window for the normals of the scan.
    pub coarse: Window,
    /// Window for the normals of the fused surface.
    pub fine: Window,
    /// Standard deviation of the normals from polarization, in radians.
    pub sigma_normals: f64,
    /// Standard deviation of the fused surface's normals, in radians. Curvature within the window causes
    /// these errors.
    pub sigma_surface: f64,
}

/// Returns the refractive index for which the zenith angles from polarization are closest to the zenith
/// angles of a coarse surface.
pub fn fit_index(camera: &Pinhole, stokes: &Map, coarse: &Map) -> f64 {
    let [first, last, step] = INDICES;
    let count = ((last - first) / step).round() as usize;
    let cost = |n: f64| {
        let angles = cues(stokes, n, Reflection::Diffuse).angles;
        let mut off = Vec::new();
        for (x, y) in (0..coarse.height).flat_map(|y| (0..coarse.width).map(move |x| (x, y))) {
            let cos = Vector3::from_column_slice(coarse.at(x, y)).dot(&frame(camera, x, y)[2]);
            let difference = (angles.at(x, y)[1] - cos.clamp(-1.0, 1.0).acos()).abs();
            if difference.is_finite() {
                off.push(difference);
            }
        }
        off.sort_by(f64::total_cmp);
        off.get(off.len() / 2).copied().unwrap_or(f64::INFINITY)
    };
    let all = (0..=count).map(|i| first + step * i as f64);
    all.min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(1.5)
}

/// Returns the means of the normals in `a` and `b`, weighted by inverse variances, as unit vectors. If one of
/// the two normals is unknown, the known normal is returned.
fn mean(a: &Map, sigma_a: f64, b: &Map, sigma_b: f64) -> Map {
    Map::from_fn(a.width, a.height, 3, |x, y, out| {
        let weighted = |map: &Map, sigma: f64| {
            let n = Vector3::from_column_slice(map.at(x, y));
            Some(n / (sigma * sigma)).filter(|n| n.x.is_finite())
        };
        let sum = match (weighted(a, sigma_a), weighted(b, sigma_b)) {
            (Some(a), Some(b)) => a + b,
            (Some(n), None) | (None, Some(n)) => n,
            (None, None) => Vector3::repeat(f64::NAN),
        };
        out.copy_from_slice(sum.normalize().as_slice());
    })
}

/// Reconstructs the surface from a scan and from Stokes vectors of diffuse light. The scan consists of
/// `depth` and its standard deviation `sigma_depth`, which are in metres.
pub fn reconstruct(
    camera: &Pinhole,
    depth: &Map,
    sigma_depth: &Map,
    stokes: &Map,
    options: &Options,
) -> Joint {
    let coarse = normals(camera, depth, options.coarse);
    let index = options.index.unwrap_or_else(|| fit_index(camera, stokes, &coarse));
    let cues: Cues = cues(stokes, index, Reflection::Diffuse);
    let believed = Believed { depth: sigma_depth.clone(), normals: options.sigma_normals, robust: true };
    let mut chosen = nearest(camera, &cues, &coarse);
    let mut fused = fuse(camera, depth, &chosen, &believed);
    for _ in 1..ROUNDS {
        let better = nearest(camera, &cues, &normals(camera, &fused, options.fine));
        // NaN differs from itself, so pairs of NaN are compared separately.
        let same = |(a, b): (&f64, &f64)| a == b || a.is_nan() && b.is_nan();
        if better.data.iter().zip(&chosen.data).all(same) {
            break;
        }
        chosen = better;
        fused = fuse(camera, depth, &chosen, &believed);
    }
    let of_surface = normals(camera, &fused, options.fine);
    Joint {
        surface: Surface {
            normals: mean(&of_surface, options.sigma_surface, &chosen, options.sigma_normals),
            depth: fused,
        },
        chosen,
        index,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::errors::{angular, depth_errors};
    use crate::shape::polarization::{stokes, tests::mueller};
    use crate::shape::synthetic::{Shape, noisy, rig};

    fn options(index: Option<f64>) -> Options {
        Options {
            index,
            coarse: Window { radius: 2, robust: true },
            fine: Window { radius: 1, robust: false },
            sigma_normals: 2.0_f64.to_radians(),
            sigma_surface: 2.0_f64.to_radians(),
        }
    }

    /// For a sphere with depth noise of 1 mm, the normals of the scan have errors of tens of degrees. With
    /// exact Stokes vectors, depths and normals of the joint method are accurate. The refractive index is
    /// given in one part of the test and fitted in another part.
    #[test]
    #[ignore = "slow: tools/check --all"]
    fn a_noisy_scan_and_exact_polarization_reconstruct_a_sphere() {
        let camera = rig(96, 256).camera;
        let shape = Shape::sphere(&camera, 0.04);
        let stokes = stokes(&mueller(&camera, &shape, 1.5, Reflection::Diffuse), false);
        let scan = noisy(&shape.depth, 1e-3, 4);
        let sigma = Map::from_fn(96, 96, 1, |_, _, o| o[0] = 1e-3);
        let raw = normals(&camera, &scan, options(None).fine);
        let before = angular(&raw, &shape.normals, None);
        assert!(before.median > 12.0, "{before:?}");
        for index in [Some(1.5), None] {
            let got = reconstruct(&camera, &scan, &sigma, &stokes, &options(index)).surface;
            let after = angular(&got.normals, &shape.normals, None);
            let depth = depth_errors(&got.depth, &shape.depth, None);
            assert!(after.median < 2.0 && after.mean < 4.0, "{index:?}: {after:?}");
            assert!(depth.median < 1e-4, "{depth:?}");
        }
    }

    #[test]
    #[ignore = "slow: tools/check --all"]
    fn the_index_is_fitted_to_an_exact_scan() {
        let camera = rig(96, 256).camera;
        let shape = Shape::sphere(&camera, 0.04);
        for n in [1.3, 1.5, 1.8] {
            let stokes = stokes(&mueller(&camera, &shape, n, Reflection::Diffuse), false);
            assert!((fit_index(&camera, &stokes, &shape.normals) - n).abs() < 1e-9);
        }
    }
}

//! Importance sampling of start points on the projector's image. The distribution is for redirected light
//! only. Most light subpaths start in cells whose rays first hit a mirror, a smooth interface or a crystal.
//!
//! The rays may miss small objects, so all cells have a non-zero density.

use crate::device::pinhole::Pinhole;
use crate::geometry::ray::Ray;
use crate::integrator_choice::redirects;
use crate::scene::Scene;
use glam::DVec2;
use rayon::prelude::*;

/// Number of cells along each side of the image.
const CELLS: usize = 64;

const RAYS: usize = 4;

/// Weight of a cell if no ray through the cell or an adjacent cell hits a redirecting surface first. All
/// other cells have weight 1.
const ELSEWHERE: f32 = 1.0 / 64.0;

/// A density over the image. The density is constant in each cell and has mean 1.
pub(super) struct ProjectorDistribution {
    densities: Vec<f32>,
    /// Cumulative probability before each cell, row-major, followed by the total.
    before: Vec<f32>,
}

impl ProjectorDistribution {
    /// Creates the density for the light of a projector. Returns `None` if all cells have equal weight.
    pub fn new(scene: &Scene, device: &Pinhole) -> Option<Self> {
        let [w, h] = device.resolution.map(f64::from);
        let step = 1.0 / (CELLS * RAYS) as f64;
        let met: Vec<bool> = (0..CELLS * CELLS)
            .into_par_iter()
            .map(|cell| {
                let (cx, cy) = (cell % CELLS, cell / CELLS);
                (0..RAYS * RAYS).any(|k| {
                    let [x, y] =
                        [cx * RAYS + k % RAYS, cy * RAYS + k / RAYS].map(|i| (i as f64 + 0.5) * step);
                    let dir = device.direction(DVec2::new(w * x, h * y));
                    let origin = device.origin;
                    redirects(scene, Ray { origin, dir }).is_some()
                })
            })
            .collect();
        let near = |cell: usize| {
            let around = |i: usize| i.saturating_sub(1)..(i + 2).min(CELLS);
            let (x, y) = (cell % CELLS, cell / CELLS);
            around(y).any(|y| around(x).any(|x| met[y * CELLS + x]))
        };
        let weights: Vec<f32> = (0..met.len()).map(|cell| if near(cell) { 1.0 } else { ELSEWHERE }).collect();
        let uneven = weights.iter().any(|w| *w != weights[0]);
        uneven.then(|| Self::of(&weights))
    }

    /// Creates a density from the weights of the cells.
    fn of(weights: &[f32]) -> Self {
        let all: f64 = weights.iter().map(|w| f64::from(*w)).sum();
        let mut sum = 0.0;
        let mut before = vec![0.0];
        before.extend(weights.iter().map(|w| {
            sum += f64::from(*w);
            (sum / all) as f32
        }));
        before[weights.len()] = 1.0;
        let densities = before.windows(2).map(|b| (b[1] - b[0]) * weights.len() as f32);
        Self { densities: densities.collect(), before }
    }

    /// Maps two uniform random numbers in [0, 1) to a point of the unit square that has this density.
    #[inline]
    pub fn point(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        // `u` selects a cell in row-major order. The remainder of `u` determines the position in the cell.
        let cell = self.before.partition_point(|b| *b <= u).clamp(1, self.densities.len()) - 1;
        let [from, to] = [self.before[cell], self.before[cell + 1]];
        let within = ((u - from) / (to - from)).clamp(0.0, 1.0);
        let size = 1.0 / CELLS as f32;
        let last = 1.0 - f32::EPSILON / 2.0;
        [(cell % CELLS) as f32 + within, (cell / CELLS) as f32 + v].map(|x| (x * size).min(last))
    }

    /// Returns the density at a point of the unit square.
    #[inline]
    pub fn density(&self, at: [f32; 2]) -> f32 {
        let [x, y] = at.map(|x| ((x * CELLS as f32) as usize).min(CELLS - 1));
        self.densities[y * CELLS + x]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use optics::sampling::stream::Stream;

    /// Verifies that the number of points in each cell agrees with the density. The tolerance is 5 standard
    /// deviations of chi squared over all cells.
    #[test]
    fn points_follow_their_density() {
        const N: usize = 400_000;
        let mut stream = Stream::new(9, 0, 0);
        let weights: Vec<f32> = (0..CELLS * CELLS)
            .map(|cell| if cell % 7 < 2 { 1.0 } else { ELSEWHERE * (1 + cell % 3) as f32 })
            .collect();
        let distribution = ProjectorDistribution::of(&weights);
        let mean = distribution.densities.iter().map(|d| f64::from(*d)).sum::<f64>() / (CELLS * CELLS) as f64;
        assert!((mean - 1.0).abs() < 1e-5, "{mean}");
        let mut counts = vec![0.0_f64; CELLS * CELLS];
        // Count the points in each half of a cell, along both sides.
        let mut halves = [0.0_f64; 2];
        for _ in 0..N {
            let at = distribution.point(stream.uniform2());
            assert!(at.iter().all(|x| (0.0..1.0).contains(x)));
            let [x, y] = at.map(|x| x * CELLS as f32);
            counts[y as usize * CELLS + x as usize] += 1.0;
            assert!(distribution.density(at) > 0.0);
            for (half, x) in halves.iter_mut().zip([x, y]) {
                *half += f64::from(u8::from(x.fract() < 0.5));
            }
        }
        let expected =
            |cell: usize| f64::from(distribution.densities[cell]) * N as f64 / (CELLS * CELLS) as f64;
        let chi2: f64 = (0..counts.len()).map(|c| (counts[c] - expected(c)).powi(2) / expected(c)).sum();
        let freedom = (CELLS * CELLS - 1) as f64;
        assert!(chi2 < freedom + 5.0 * (2.0 * freedom).sqrt(), "{chi2}");
        for half in halves {
            assert!((half - N as f64 / 2.0).abs() < 5.0 * (N as f64).sqrt() / 2.0, "{half}");
        }
    }
}

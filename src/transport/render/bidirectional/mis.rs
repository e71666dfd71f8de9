//! Multiple importance sampling weights of the strategies that can sample a path (Veach 1997, sect. 10.2).
//!
//! A path with k inner vertices can be sampled by connecting a light subpath with s vertices to a camera
//! subpath with t vertices. The ends of the path count as vertices, so s + t = k + 2. The power heuristic
//! assigns the weight (n p)² / Σ (n' p')² to a strategy with density p and n samples. Ratios of densities are
//! products along the path. If vertex i is sampled by the camera subpath instead of by the light subpath, p
//! changes by a factor. The factor is the density with which the camera subpath samples this vertex, divided
//! by the density with which the light subpath samples this vertex.
//!
//! The heuristic assumes independent strategies, but connections inside a medium are correlated. If two
//! subpaths with hundreds of medium vertices come close to each other, many connections of these subpaths
//! contribute. If the subpaths do not come close, no connection contributes. On a path with m medium
//! vertices, each connection of two subpaths therefore counts as 1/m of a sample. All connections together
//! then count as one sample. The factor 1/m is the simplest form of the weights of Grittmann, Georgiev &
//! Slusallek 2021, "Correlation-aware multiple importance sampling for bidirectional rendering algorithms".

use crate::strategy::{Strategies, Strategy};

#[derive(Clone, Copy, Debug)]
pub(super) struct Densities {
    /// Density with which the subpath from the same side samples the vertex.
    pub own: f32,
    /// Density with which the subpath from the opposite side samples the vertex.
    pub other: f32,
    /// False if no connection can end at the vertex because the vertex scatters light into a single
    /// direction.
    pub connects: bool,
    /// True if the vertex is a scattering event in a medium.
    pub particle: bool,
}

/// Number of samples of each strategy.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tries {
    /// Number of light subpaths per connection, which is the probability that a light subpath starts at the
    /// emitter of the path.
    pub light: f32,
    /// Number of light subpaths per camera pixel and sample. All of these subpaths are connected to the
    /// camera's pinhole.
    pub splats: f32,
    /// Fraction of samples in which vertices of the camera subpath are connected to vertices of the light
    /// subpath.
    pub connections: f32,
    pub strategies: Strategies,
}

impl Tries {
    /// Returns the number of samples of the strategy with `s` light vertices and `t` camera vertices, for a
    /// path with `particles` medium vertices. Next-event estimation takes one sample.
    #[inline]
    fn of(self, s: usize, t: usize, particles: usize) -> f64 {
        let strategy = match (s, t) {
            (1, _) => Strategy::NextEvent,
            (_, 1) => Strategy::LightTracing,
            _ => Strategy::VertexConnection,
        };
        if !self.strategies.has(strategy) {
            return 0.0;
        }
        let light = if s > 1 { f64::from(self.light) } else { 1.0 };
        let times = match strategy {
            Strategy::LightTracing => f64::from(self.splats),
            Strategy::VertexConnection => f64::from(self.connections) / particles.max(1) as f64,
            _ => 1.0,
        };
        light * times
    }
}

/// Returns the MIS weight of the strategy that connects the subpaths `light` and `camera`. The subpaths
/// include their ends.
#[inline]
pub(super) fn power_heuristic(light: &[Densities], camera: &[Densities], tries: Tries) -> f32 {
    let (s, t) = (light.len(), camera.len());
    let particles = light.iter().chain(camera).filter(|p| p.particle).count();
    let own = tries.of(s, t, particles);
    let mut sum = own * own;
    for (walk, is_light) in [(camera, false), (light, true)] {
        let mut ratio = 1.0;
        for i in (1..walk.len()).rev() {
            // The opposite subpath samples vertex i and all later vertices.
            ratio *= f64::from(walk[i].other) / f64::from(walk[i].own);
            if walk[i].connects && walk[i - 1].connects {
                let (s, t) = if is_light { (i, s + t - i) } else { (s + t - i, i) };
                let np = tries.of(s, t, particles) * ratio;
                sum += np * np;
            }
        }
    }
    (own * own / sum) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use optics::sampling::stream::Stream;

    /// Verifies that the weights of all strategies that can sample a path sum to one.
    #[test]
    fn weights_sum_to_one() {
        let mut stream = Stream::new(3, 0, 0);
        for _ in 0..2000 {
            let inner = 1 + (stream.uniform() * 7.0) as usize;
            let draw = |stream: &mut Stream| (6.0 * (stream.uniform() - 0.5)).exp();
            // Choose random densities from the light and from the camera. The ends of the path allow
            // connections and are not in a medium.
            let points: Vec<(f32, f32, bool, bool)> = (0..inner + 2)
                .map(|i| {
                    let ends = i == 0 || i == inner + 1;
                    (
                        draw(&mut stream),
                        draw(&mut stream),
                        ends || stream.uniform() < 0.6,
                        !ends && stream.uniform() < 0.5,
                    )
                })
                .collect();
            let tries = Tries { light: 0.3, splats: 50.0, connections: 0.2, strategies: Strategies::ALL };
            let (mut sum, mut count) = (0.0, 0);
            for s in 1..=inner + 1 {
                let (light, camera) = points.split_at(s);
                if !points[s - 1].2 || !points[s].2 {
                    continue;
                }
                let of =
                    |own: f32, other: f32, connects, particle| Densities { own, other, connects, particle };
                let light: Vec<_> = light.iter().map(|p| of(p.0, p.1, p.2, p.3)).collect();
                let camera: Vec<_> = camera.iter().rev().map(|p| of(p.1, p.0, p.2, p.3)).collect();
                sum += power_heuristic(&light, &camera, tries);
                count += 1;
            }
            if count > 0 {
                assert!((sum - 1.0).abs() < 1e-5, "{sum} over {count} strategies");
            }
        }
    }
}

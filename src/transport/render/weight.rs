//! Weights of multiple importance sampling among the strategies that can make a path (Veach 1997, sect. 10.2).
//!
//! A path of k points besides its two ends can be made by a walk of s points from the light and one of t from the camera,
//! s + t = k + 2 (both ends counted), whose last points are connected. With p the density of a strategy and n the number
//! of times that it is tried, the power heuristic weighs it by (n p)² / Σ (n' p')². Ratios of densities are products along
//! the path: where the camera takes point i over from the light, p changes by its density from the camera over that from
//! the light.
//!
//! That heuristic takes strategies for independent of each other. Connections inside a medium are not: two walks of hundreds of particles
//! come near each other or they do not, and if they do all of their many connections bring something at once. On a path with m
//! particles each connection of two walks thus counts as a try in m (Grittmann, Georgiev & Slusallek 2021, "Correlation-aware
//! multiple importance sampling for bidirectional rendering algorithms", in its simplest form): all together they weigh as much as one.

use crate::strategy::{Strategies, Strategy};

/// A point of a path, from one of its ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Densities {
    /// With which the walk from this end makes it, and with which the other walk would.
    pub own: f32,
    pub other: f32,
    /// False if it scatters light into a single direction, so that lines cannot end there.
    pub connects: bool,
    /// In a medium.
    pub particle: bool,
}

/// How often strategies are tried.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tries {
    /// Walks from the light per connection: the chance that one starts at the emitter in question.
    pub light: f32,
    /// Walks from the light per camera pixel and sample, all of which are connected to the camera's pinhole.
    pub splats: f32,
    /// The share of samples in which walks from both ends are connected.
    pub connections: f32,
    pub strategies: Strategies,
}

impl Tries {
    /// Of the strategy with `s` points from the light and `t` from the camera, on a path with so many particles. An emitter alone is
    /// connected to always.
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

/// Weight of the strategy that makes `light` from the light and `camera` from the camera, both from their ends on, which
/// are included.
#[inline]
pub(super) fn power_heuristic(light: &[Densities], camera: &[Densities], tries: Tries) -> f32 {
    let (s, t) = (light.len(), camera.len());
    let particles = light.iter().chain(camera).filter(|p| p.particle).count();
    let own = tries.of(s, t, particles);
    let mut sum = own * own;
    for (walk, is_light) in [(camera, false), (light, true)] {
        let mut ratio = 1.0;
        for i in (1..walk.len()).rev() {
            // Point i and all beyond go over to the other walk.
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

    /// Over all strategies that can make a path, weights sum to one.
    #[test]
    fn weights_sum_to_one() {
        let mut stream = Stream::new(3, 0, 0);
        for _ in 0..2000 {
            let inner = 1 + (stream.uniform() * 7.0) as usize;
            let draw = |stream: &mut Stream| (6.0 * (stream.uniform() - 0.5)).exp();
            // Densities from the light and from the camera; both ends connect, and none of them is a particle.
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
            let tries = Tries {
                light: 0.3,
                splats: 50.0,
                connections: 0.2,
                strategies: Strategies::ALL,
            };
            let (mut sum, mut count) = (0.0, 0);
            for s in 1..=inner + 1 {
                let (light, camera) = points.split_at(s);
                if !points[s - 1].2 || !points[s].2 {
                    continue;
                }
                let of = |own: f32, other: f32, connects, particle| Densities {
                    own,
                    other,
                    connects,
                    particle,
                };
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

//! Light from emitters that paths hit. The emitters are emissive surfaces and the environment beyond all
//! surfaces.

use super::state::Beam;
use crate::accumulate::{Contributions, NO_PIXEL};
use crate::geometry::ray::Surface;
use crate::light::receiver::Receiver;
use crate::light::{Found, share};
use crate::scene::Scene;
use base::units::picoseconds;
use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::polarization::frame::turn;
use optics::spectrum::Spectral;

/// Record of how the direction of a path's ray was sampled.
#[derive(Clone, Copy, Debug)]
pub(super) struct DirectionSampling {
    /// Sampling density of the direction per steradian, or 0 if no connection can sample the same path.
    pub density: f32,
    /// The point at which the direction was sampled, before any sheets on the ray.
    pub from: Receiver,
}

impl DirectionSampling {
    /// Returns the record for a ray from a mirror, smooth glass or the camera. No connection can sample a ray
    /// from a mirror, smooth glass or the camera.
    #[inline]
    pub fn alone(from: Vec3A) -> Self {
        Self { density: 0.0, from: Receiver::anywhere(from) }
    }

    /// Returns the MIS weight of the hit. The competing strategy is a connection that samples the same
    /// direction with density `other`.
    #[inline]
    fn share(self, other: f32) -> f32 {
        if self.density > 0.0 { share(self.density, other) } else { 1.0 }
    }
}

/// A hit of a path on an emissive surface.
pub(super) struct EmitterHit {
    pub chain: Chain,
    /// Direction and Stokes frame of the light on which the path's Mueller product acts.
    pub beam: Beam,
    pub surface: Surface,
    /// Index in the mesh of the triangle that was hit, or `None` if unknown.
    pub facet: Option<u32>,
    /// Optical length of the path, metres.
    pub optical_m: f64,
    /// Number of earlier interactions.
    pub interactions: u32,
    pub label: u8,
    pub chosen: DirectionSampling,
}

/// Appends the contribution of a path that hits an emissive surface.
pub(super) fn add_emissive_surface(scene: &Scene, glow: &EmitterHit, out: &mut Contributions) {
    let EmitterHit { mut chain, beam, ref surface, .. } = *glow;
    let (number, light) = scene.lights.of(surface.material).expect("the surface emits light");
    let radiance = light.toward(&scene.materials.textures, surface.ng, surface.uv, beam.travel);
    if radiance == Spectral::ZERO {
        return;
    }
    // If no connection can sample the path, the density of connections is not computed.
    let share = if glow.chosen.density > 0.0 {
        let found = Found { number, surface, facet: glow.facet };
        glow.chosen.share(scene.lights.density(&glow.chosen.from, -beam.travel, &found))
    } else {
        1.0
    };
    chain.scale(radiance * Spectral::splat(share));
    light.polarized.end(&mut chain, beam.travel, beam.frame);
    let extent = chain.finish(out.elements);
    let time_ps = picoseconds(glow.optical_m);
    out.push(extent, time_ps, NO_PIXEL, glow.interactions, glow.label);
}

/// Appends the contribution of the environment for a path that left the scene after `bounces` interactions
/// with path label `label`. The path's Mueller product acts on the light `beam`.
#[inline]
pub(super) fn add_environment(
    scene: &Scene,
    chain: &Chain,
    beam: Beam,
    (bounces, label): (u32, u8),
    chosen: DirectionSampling,
    out: &mut Contributions,
) {
    if let Some(sky) = &scene.lights.sky {
        let dir = -beam.travel;
        let share = chosen.share(scene.lights.sky_density(dir));
        let mut chain = *chain;
        chain.scale(sky.radiance(dir) * Spectral::splat(share));
        sky.polarized.end(&mut chain, beam.travel, beam.frame);
        let extent = chain.finish(out.elements);
        out.push(extent, f64::INFINITY, NO_PIXEL, bounces, label);
    }
    let Some(environment) = &scene.environment else {
        return;
    };
    let (c2, s2) = turn(beam.travel, environment.frame(beam.travel), beam.frame);
    let mut chain = *chain;
    chain.rotate_in(c2, s2);
    chain.scale(environment.radiance);
    let extent = chain.finish(out.elements);
    out.push(extent, f64::INFINITY, NO_PIXEL, bounces, label);
}

//! Light that paths meet by chance: shining surfaces, and the environment behind all surfaces.

use super::state::Beam;
use crate::accumulate::{Contributions, NO_PIXEL};
use crate::geometry::ray::Surface;
use crate::light::area::AreaLight;
use crate::light::receiver::Receiver;
use crate::light::{Found, share};
use crate::scene::Scene;
use base::units::picoseconds;
use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::polarization::frame::turn;
use optics::spectrum::Spectral;

/// How a ray of a path was chosen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chosen {
    /// Density of its direction per steradian; 0 where no connection could make the same.
    pub density: f32,
    /// From where, behind sheets in between.
    pub from: Receiver,
}

impl Chosen {
    /// By a mirror, by smooth glass, by the camera.
    #[inline]
    pub fn alone(from: Vec3A) -> Self {
        Self {
            density: 0.0,
            from: Receiver::anywhere(from),
        }
    }

    /// Share of the path that chance gets beside a connection that draws the direction with density `other`.
    #[inline]
    fn share(self, other: f32) -> f32 {
        if self.density > 0.0 {
            share(self.density, other)
        } else {
            1.0
        }
    }
}

/// A shining surface that a path came upon.
pub(super) struct Met<'a> {
    pub light: &'a AreaLight,
    /// Its number.
    pub number: u32,
    pub surface: &'a Surface,
    /// Number of the triangle in its mesh, where that is known.
    pub facet: Option<u32>,
    /// Optical length of the path, metres.
    pub optical_m: f64,
    /// Interactions before, and what they did.
    pub interactions: u32,
    pub label: u8,
    pub chosen: Chosen,
}

/// Appends what a shining surface sends into a path: `beam` is the light that the path's product `chain` takes in.
pub(super) fn met(scene: &Scene, mut chain: Chain, beam: Beam, met: &Met, out: &mut Contributions) {
    let Met { light, surface, .. } = *met;
    let radiance = light.toward(&scene.materials.textures, surface.ng, surface.uv, beam.travel);
    if radiance == Spectral::ZERO {
        return;
    }
    // Where no connection could make the path, its density is not asked for.
    let share = if met.chosen.density > 0.0 {
        let found = Found {
            number: met.number,
            surface,
            facet: met.facet,
        };
        met.chosen
            .share(scene.lights.density(&met.chosen.from, -beam.travel, &found))
    } else {
        1.0
    };
    chain.scale(radiance * Spectral::splat(share));
    light.polarized.end(&mut chain, beam.travel, beam.frame);
    let extent = chain.finish(out.elements);
    let time_ps = picoseconds(met.optical_m);
    out.push(extent, time_ps, NO_PIXEL, met.interactions, met.label);
}

/// Appends what the environment sends into a path that left the scene after `bounces` interactions, which did what `label` says:
/// `beam` is the light that the path's product takes in.
#[inline]
pub(super) fn seen(
    scene: &Scene,
    chain: &Chain,
    beam: Beam,
    (bounces, label): (u32, u8),
    chosen: Chosen,
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

//! Flights of subpaths. A flight is a straight segment between two vertices, through media and through
//! boundaries without an effect on light.

use super::azimuth;
use super::{End, Site, Vertex};
use crate::geometry::ray::{Hit, Ray, Surface};
use crate::geometry::rounding::met;
use crate::material::Lanes;
use crate::medium::nesting::Nest;
use crate::render::state::{From, State};
use crate::render::transmission::{has_no_effect, pass};
use crate::scene::Scene;
use glam::Vec3A;
use optics::polarization::frame::perpendicular;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// Margin, relative to the free path, by which the search for surfaces exceeds the free path.
const REACH: f32 = 1e-3;

/// The state of a subpath between two vertices.
#[derive(Clone)]
pub(crate) struct Flight {
    pub state: State,
    pub end: From,
    /// Optical depth since the last vertex, per lane.
    pub depth: Spectral,
    pub nest: Nest,
    pub hero: Hero,
    /// False if the flight always continues to the next surface, so that media only attenuate the light.
    pub draws: bool,
}

/// The hero wavelength, and the relative densities of the live wavelengths. The hero wavelength determines
/// the sampling of all distances and directions of a subpath in media. The relative densities are those with
/// which each live wavelength would have sampled the same distances and directions.
///
/// Weights use the mean density of all live wavelengths over the *whole* subpath (Wilkie et al. 2014, "Hero
/// wavelength spectral sampling"). With separate means for each event, the weights would grow with the number
/// of events.
#[derive(Clone)]
pub(crate) struct Hero {
    pub lane: usize,
    likely: Spectral,
}

impl Hero {
    /// Samples one of the live lanes uniformly.
    #[inline]
    pub fn draw(lanes: Lanes, stream: &mut Stream) -> Self {
        Self { lane: lanes.draw(stream), likely: lanes.ones() }
    }

    /// Returns the hero wavelength for the single lane that remains after a dispersive interface.
    #[inline]
    pub fn only(lanes: Lanes) -> Self {
        Self { lane: lanes.nth(0), likely: lanes.ones() }
    }

    /// Records a sampling event that has the given density in each lane. Returns the density by which weights
    /// are divided, or `None` on underflow.
    #[inline]
    pub fn event(&mut self, densities: Spectral) -> Option<f32> {
        let sum = |s: Spectral| s.to_array().iter().sum::<f32>();
        let all = sum(self.likely);
        self.likely *= densities;
        let now = sum(self.likely);
        if !(now > 0.0 && now.is_finite()) {
            return None;
        }
        // Normalize the values to stay near 1. Only the ratios of the values matter.
        self.likely *= Spectral::splat(1.0 / now);
        Some(now / all)
    }
}

pub(crate) enum Landing {
    /// The vertex that was reached, as site and surface, and the hit if the vertex is on a surface.
    At(Site, Surface, Option<Hit>),
    Escaped,
    Absorbed,
}

/// Returns the mean transmittance over all wavelengths of the scene.
#[inline]
pub(crate) fn mean_transmittance(scene: &Scene, depth: Spectral) -> f32 {
    if depth == Spectral::ZERO {
        return 1.0;
    }
    let passed = (-depth).exp() * scene.wavelengths.ones();
    passed.to_array().iter().sum::<f32>() / scene.wavelengths.count() as f32
}

impl Flight {
    #[inline]
    pub fn start(scene: &Scene, from: From, end: &End, stream: &mut Stream) -> Self {
        let all = scene.lanes();
        Self {
            state: State {
                ray: end.ray,
                from: end.ray.origin.as_dvec3(),
                chain: end.chain,
                frame: end.frame,
                optical_m: 0.0,
                filling: end.filling,
                lanes: all,
                label: 0,
            },
            end: from,
            depth: Spectral::ZERO,
            draws: true,
            nest: end.nest,
            hero: if scene.filled { Hero::draw(all, stream) } else { Hero::only(all) },
        }
    }

    /// Applies a scattering matrix to the light along the ray. `scatter` is for the direction in which the
    /// light travels.
    #[inline]
    pub fn push(&mut self, scatter: &Scatter) {
        let State { ray, chain, frame, .. } = &mut self.state;
        let next = match self.end {
            From::Camera => chain.push(scatter, -ray.dir, *frame),
            From::Light => chain.push(&scatter.transposed(), ray.dir, *frame),
        };
        *frame = next.unwrap_or(Vec3A::ZERO);
    }

    /// Returns [`azimuth::factor`] of a scattering matrix on the ray. The result is the same for `scatter`
    /// and for its transpose.
    #[inline]
    pub fn polarized(&self, scatter: &Scatter) -> Option<Spectral> {
        let State { ray, chain, frame, .. } = &self.state;
        let d_out = match self.end {
            From::Camera => -ray.dir,
            From::Light => ray.dir,
        };
        azimuth::factor(chain, scatter, d_out, *frame)
    }

    /// Sets a frame for the ray if the last scattering event did not define a frame.
    #[inline]
    pub fn settle(&mut self) {
        if self.state.frame == Vec3A::ZERO {
            self.state.frame = perpendicular(self.state.ray.dir);
        }
    }

    /// Returns the vertex at the end of the flight, without densities.
    #[inline]
    pub fn landed(&self, site: Site, surface: Surface, interactions: u32) -> Vertex {
        let state = &self.state;
        Vertex {
            site,
            surface,
            at: state.from,
            back: -state.ray.dir,
            chain: state.chain,
            frame: state.frame,
            optical_m: state.optical_m,
            filling: state.filling,
            nest: self.nest,
            lanes: state.lanes,
            interactions,
            label: state.label,
            delta: false,
            forward: 0.0,
            reverse: 0.0,
            spread: 0.0,
        }
    }

    pub fn fly(&mut self, scene: &Scene, stream: &mut Stream, rays: &mut u32) -> Landing {
        loop {
            *rays += 1;
            let inside = self.nest.medium(&scene.boundaries);
            // Most flights in dense media end before a surface, so the search excludes surfaces beyond the
            // free path.
            let free = inside.filter(|_| self.draws).and_then(|id| self.free_path(scene, id, stream));
            let reach = free.map_or(f32::INFINITY, |length| length * (1.0 + REACH) + scene.geometry.skin());
            let hit = scene.geometry.intersect(&self.state.ray, reach);
            let surface = hit.map(|hit| scene.geometry.surface(&self.state.ray, &hit));
            let State { from, ray, .. } = &self.state;
            let ahead = surface.map(|s| met(*from, ray.dir, &s));
            let length = ahead.map_or(f64::INFINITY, |(_, length)| length);
            if let Some(id) = inside
                && let Some(landing) = self.through(scene, id, length as f32, free)
            {
                return landing;
            }
            let (Some(surface), Some((at, _))) = (surface, ahead) else {
                return Landing::Escaped;
            };
            self.state.optical_m += f64::from(self.state.filling.index) * length;
            if let Some(act) = self.state.crossed(scene, &surface) {
                self.push(&act);
            }
            self.state.from = at;
            self.settle();
            let id = surface.material;
            if !has_no_effect(scene, &self.nest, id) {
                return Landing::At(Site::Surface, surface, hit);
            }
            let state = &mut self.state;
            let (dir, lane) = (state.ray.dir, state.lanes.nth(0));
            pass(scene, &mut self.nest, &mut state.filling, &surface, dir, lane);
            state.ray.origin = scene.geometry.leave(&surface, dir);
        }
    }

    /// Samples the free path of the hero wavelength, metres. Returns `None` if the medium does not scatter.
    #[inline]
    fn free_path(&self, scene: &Scene, id: u32, stream: &mut Stream) -> Option<f32> {
        let medium = &scene.media.list[id as usize];
        if medium.scattering == Spectral::ZERO {
            return None;
        }
        // `u` must not be 0.
        let u = 1.0 - stream.uniform();
        Some(scene.media.reach(id, &self.sent(), self.hero.lane, -u.ln()))
    }

    /// Returns the ray that starts at the exact end of the last segment, without an offset.
    #[inline]
    fn sent(&self) -> Ray {
        Ray { origin: self.state.from.as_vec3a(), dir: self.state.ray.dir }
    }

    /// Advances the flight by `way` metres through a medium, or by the free path `free` (metres) if `free` is
    /// shorter.
    #[inline]
    fn through(&mut self, scene: &Scene, id: u32, way: f32, free: Option<f32>) -> Option<Landing> {
        let ray = self.sent();
        let passed = |length: f32| {
            let depth = scene.media.depth(id, &ray, length);
            // The depth is NaN for infinite distances in lanes without extinction.
            depth.simd_eq(depth).select(depth, Spectral::ZERO)
        };
        let Some(length) = free else {
            self.depth += passed(way);
            self.state.chain.scale((-passed(way)).exp());
            return None;
        };
        if length < way {
            let depth = passed(length);
            let transmittance = (-depth).exp();
            let p = (self.state.from + self.state.ray.dir.as_dvec3() * f64::from(length)).as_vec3a();
            let extinction = scene.media.extinction(id, p);
            let Some(density) = self.hero.event(extinction * transmittance) else {
                return Some(Landing::Absorbed);
            };
            self.state
                .chain
                .scale(scene.media.scattering(id, p) * transmittance * Spectral::splat(1.0 / density));
            self.depth += depth;
            self.state.optical_m += f64::from(self.state.filling.index) * f64::from(length);
            self.state.from += self.state.ray.dir.as_dvec3() * f64::from(length);
            return Some(Landing::At(Site::Volume(id), Surface { p, ..Surface::default() }, None));
        }
        let depth = passed(way);
        let transmittance = (-depth).exp();
        let Some(chance) = self.hero.event(transmittance) else {
            return Some(Landing::Absorbed);
        };
        self.state.chain.scale(transmittance * Spectral::splat(1.0 / chance));
        self.depth += depth;
        None
    }
}

//! A walk between two of its points: straight through media, sheets' gaps and boundaries that light does not notice.

use super::bridge::{pass, unnoticed};
use super::point::{End, Point, Site};
use super::polarized;
use super::state::{From, State};
use crate::geometry::ray::{Hit, Ray, Surface};
use crate::geometry::rounding::met;
use crate::material::Lanes;
use crate::medium::nesting::Nest;
use crate::scene::Scene;
use glam::Vec3A;
use optics::polarization::frame::perpendicular;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// Surfaces are looked for this much farther than a free path, against rounding.
const REACH: f32 = 1e-3;

/// The state of a walk between two points.
#[derive(Clone)]
pub(super) struct Flight {
    pub state: State,
    /// Which end it began at.
    pub end: From,
    /// Optical depth since the last point.
    pub depth: Spectral,
    pub nest: Nest,
    pub hero: Hero,
    /// False if it goes straight on to the next surface, dimmed by media.
    pub draws: bool,
}

/// The wavelength that draws all distances and directions of a walk in media, and how likely each living one would have
/// drawn the same, relative to each other.
///
/// Weights are over the mean density of all living wavelengths of the *whole* walk (Wilkie et al. 2014, "Hero wavelength
/// spectral sampling"). Means event by event would let them grow with the number of events.
#[derive(Clone)]
pub(super) struct Hero {
    pub lane: usize,
    likely: Spectral,
}

impl Hero {
    /// Any of the living lanes.
    #[inline]
    pub fn draw(lanes: Lanes, stream: &mut Stream) -> Self {
        Self {
            lane: lanes.draw(stream),
            likely: lanes.ones(),
        }
    }

    /// A dispersive interface leaves one lane.
    #[inline]
    pub fn only(lanes: Lanes) -> Self {
        Self {
            lane: lanes.nth(0),
            likely: lanes.ones(),
        }
    }

    /// Takes on that an event has happened whose density is `densities` by lane; returns what to divide by, `None` where the
    /// event is too unlikely for numbers.
    #[inline]
    pub fn event(&mut self, densities: Spectral) -> Option<f32> {
        let sum = |s: Spectral| s.to_array().iter().sum::<f32>();
        let all = sum(self.likely);
        self.likely *= densities;
        let now = sum(self.likely);
        if !(now > 0.0 && now.is_finite()) {
            return None;
        }
        // Kept near 1: only ratios count.
        self.likely *= Spectral::splat(1.0 / now);
        Some(now / all)
    }
}

/// What ends a flight.
pub(super) enum Landing {
    /// Where, and what was hit of a surface.
    At(Site, Surface, Option<Hit>),
    Escaped,
    Absorbed,
}

/// The mean transmittance over all of the scene's wavelengths.
#[inline]
pub(super) fn mean_transmittance(scene: &Scene, depth: Spectral) -> f32 {
    if depth == Spectral::ZERO {
        return 1.0;
    }
    let passed = (-depth).exp() * scene.wavelengths.ones();
    passed.to_array().iter().sum::<f32>() / scene.wavelengths.count() as f32
}

impl Flight {
    /// Begins at a walk's end.
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
            hero: if scene.filled {
                Hero::draw(all, stream)
            } else {
                Hero::only(all)
            },
        }
    }

    /// Takes on what happens to the light that runs along the ray: an interaction in its true direction.
    #[inline]
    pub fn push(&mut self, scatter: &Scatter) {
        let State {
            ray, chain, frame, ..
        } = &mut self.state;
        let next = match self.end {
            From::Camera => chain.push(scatter, -ray.dir, *frame),
            From::Light => chain.push(&scatter.transposed(), ray.dir, *frame),
        };
        *frame = next.unwrap_or(Vec3A::ZERO);
    }

    /// [`polarized::factor`] of what happens to the light that runs along the ray; the same for `scatter` and its transpose.
    #[inline]
    pub fn polarized(&self, scatter: &Scatter) -> Option<Spectral> {
        let State {
            ray, chain, frame, ..
        } = &self.state;
        let d_out = match self.end {
            From::Camera => -ray.dir,
            From::Light => ray.dir,
        };
        polarized::factor(chain, scatter, d_out, *frame)
    }

    /// A frame for the ray, where what it met left it open.
    #[inline]
    pub fn settle(&mut self) {
        if self.state.frame == Vec3A::ZERO {
            self.state.frame = perpendicular(self.state.ray.dir);
        }
    }

    /// The point where it came to, without densities.
    #[inline]
    pub fn landed(&self, site: Site, surface: Surface, interactions: u32) -> Point {
        let state = &self.state;
        Point {
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

    /// Flies on to the next thing that happens.
    pub fn fly(&mut self, scene: &Scene, stream: &mut Stream, rays: &mut u32) -> Landing {
        loop {
            *rays += 1;
            let inside = self.nest.medium(&scene.boundaries);
            // Most ways through dense media end before any surface, which then need not be looked for.
            let free = inside
                .filter(|_| self.draws)
                .and_then(|id| self.free_path(scene, id, stream));
            let reach = free.map_or(f32::INFINITY, |length| {
                length * (1.0 + REACH) + scene.geometry.skin()
            });
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
            if !unnoticed(scene, &self.nest, id) {
                return Landing::At(Site::Surface, surface, hit);
            }
            let state = &mut self.state;
            let (dir, lane) = (state.ray.dir, state.lanes.nth(0));
            pass(scene, &mut self.nest, &mut state.filling, &surface, dir, lane);
            state.ray.origin = scene.geometry.leave(&surface, dir);
        }
    }

    /// Draws how far the hero wavelength goes in a medium before it is scattered or absorbed; `None` where nothing scatters.
    #[inline]
    fn free_path(&self, scene: &Scene, id: u32, stream: &mut Stream) -> Option<f32> {
        let medium = &scene.media.list[id as usize];
        if medium.scattering == Spectral::ZERO {
            return None;
        }
        // Never 0.
        let u = 1.0 - stream.uniform();
        Some(scene.media.reach(id, &self.sent(), self.hero.lane, -u.ln()))
    }

    /// The ray from where the last piece of the walk ended, to the last digit.
    #[inline]
    fn sent(&self) -> Ray {
        Ray {
            origin: self.state.from.as_vec3a(),
            dir: self.state.ray.dir,
        }
    }

    /// Goes `way` metres through a medium, or less if the light's free path is shorter.
    #[inline]
    fn through(&mut self, scene: &Scene, id: u32, way: f32, free: Option<f32>) -> Option<Landing> {
        let ray = self.sent();
        let passed = |length: f32| {
            let depth = scene.media.depth(id, &ray, length);
            // Infinite ways through lanes that are clear.
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
            return Some(Landing::At(
                Site::Volume(id),
                Surface {
                    p,
                    ..Surface::default()
                },
                None,
            ));
        }
        let depth = passed(way);
        let transmittance = (-depth).exp();
        let Some(chance) = self.hero.event(transmittance) else {
            return Some(Landing::Absorbed);
        };
        self.state
            .chain
            .scale(transmittance * Spectral::splat(1.0 / chance));
        self.depth += depth;
        None
    }
}

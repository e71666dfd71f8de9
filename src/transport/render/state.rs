//! What a path carries along its current ray, whichever way it is traced.

use crate::geometry::ray::{Ray, Surface};
use crate::material::{Filling, Lanes, NO_CRYSTAL};
use crate::scene::Scene;
use glam::{DVec3, Vec3A};
use optics::polarization::chain::Chain;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;

/// Which end a walk starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum From {
    Camera,
    Light,
}

impl From {
    /// The other end.
    #[inline]
    pub fn other(self) -> Self {
        match self {
            Self::Camera => Self::Light,
            Self::Light => Self::Camera,
        }
    }
}

/// The state of a path at its current ray.
#[derive(Clone)]
pub(super) struct State {
    pub ray: Ray,
    /// Where the ray really starts (its origin is moved off the surface, and rounded); behind a hit, where it was met.
    pub from: DVec3,
    /// Product from the light along the ray to the path's end: to the camera frame, or from an emitter, transposed.
    pub chain: Chain,
    /// Frame of that light.
    pub frame: Vec3A,
    /// Optical path length so far, metres.
    pub optical_m: f64,
    /// What the ray runs through.
    pub filling: Filling,
    pub lanes: Lanes,
    /// What the path did before the ray, as [`tensor::label`] says; kept up by plain paths only where it is asked for.
    pub label: u8,
}

/// A direction in which light travels, and the frame of its Stokes vectors.
#[derive(Clone, Copy)]
pub(super) struct Beam {
    pub travel: Vec3A,
    pub frame: Vec3A,
}

impl Default for State {
    /// Of no path yet.
    fn default() -> Self {
        Self {
            ray: Ray {
                origin: Vec3A::ZERO,
                dir: Vec3A::Z,
            },
            from: DVec3::ZERO,
            chain: Chain::start(Spectral::ZERO),
            frame: Vec3A::X,
            optical_m: 0.0,
            filling: Filling::VACUUM,
            lanes: Lanes::first(0),
            label: 0,
        }
    }
}

impl State {
    /// What the filling does to light all along the current ray, to the surface that it hit; `None` where it does nothing.
    #[inline(always)]
    pub fn crossed(&self, scene: &Scene, surface: &Surface) -> Option<Scatter> {
        if self.filling.crystal == NO_CRYSTAL {
            return None;
        }
        // Distance to the plane of the surface from where the ray really started: a phase would notice the nudge off the
        // surface, which shifts the hit point sideways.
        let (dir, ng) = (self.ray.dir, surface.ng.as_dvec3());
        let length = (surface.p.as_dvec3() - self.from).dot(ng) / dir.as_dvec3().dot(ng);
        scene.materials.propagate(self.filling, dir, length)
    }
}

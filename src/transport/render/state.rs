//! The state of a path on its current ray, for all path-sampling strategies.

use crate::geometry::ray::{Ray, Surface};
use crate::material::{Filling, Lanes, NO_CRYSTAL};
use crate::scene::Scene;
use glam::{DVec3, Vec3A};
use optics::polarization::chain::Chain;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;

/// The end at which a subpath starts, which is the camera or an emitter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum From {
    Camera,
    Light,
}

impl From {
    #[inline]
    pub fn other(self) -> Self {
        match self {
            Self::Camera => Self::Light,
            Self::Light => Self::Camera,
        }
    }
}

/// The state of a path on its current ray.
#[derive(Clone)]
pub(super) struct State {
    pub ray: Ray,
    /// Exact origin of the ray, before the origin is offset from the surface and rounded. After a hit, the
    /// value is the hit point.
    pub from: DVec3,
    /// Mueller product from the light on the ray to the start of the subpath. The product maps to the camera
    /// frame, or is transposed if the subpath starts at an emitter.
    pub chain: Chain,
    /// Stokes frame of the light along the ray.
    pub frame: Vec3A,
    /// Optical path length up to the start of the ray, metres.
    pub optical_m: f64,
    /// The medium that contains the ray.
    pub filling: Filling,
    pub lanes: Lanes,
    /// Path label before the ray ([`tensor::label`]). Unidirectional paths update the label only if slices
    /// need path labels.
    pub label: u8,
}

/// The direction in which light travels, and the frame of the Stokes vectors of this light.
#[derive(Clone, Copy)]
pub(super) struct Beam {
    pub travel: Vec3A,
    pub frame: Vec3A,
}

impl Default for State {
    /// Returns a placeholder for paths that have not started.
    fn default() -> Self {
        Self {
            ray: Ray { origin: Vec3A::ZERO, dir: Vec3A::Z },
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
    /// Returns the medium's matrix for light on the ray to `surface`, or `None` if the medium has no effect.
    #[inline(always)]
    pub fn crossed(&self, scene: &Scene, surface: &Surface) -> Option<Scatter> {
        if self.filling.crystal == NO_CRYSTAL {
            return None;
        }
        // Use the distance from the exact start of the ray to the plane of the surface. The offset from the
        // surface shifts the hit point sideways, which would change the phase.
        let (dir, ng) = (self.ray.dir, surface.ng.as_dvec3());
        let length = (surface.p.as_dvec3() - self.from).dot(ng) / dir.as_dvec3().dot(ng);
        scene.materials.propagate(self.filling, dir, length)
    }
}

//! The receiving point for which a light is chosen.

use crate::geometry::ray::Surface;
use crate::material::{Material, Materials, facing};
use glam::Vec3A;

/// A point that receives light.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// Position of the receiver in world space, metres.
    pub p: Vec3A,
    /// Unit normal of the side from which light can arrive, or zero if light can arrive from all directions.
    pub normal: Vec3A,
}

impl Receiver {
    /// Returns a receiver for a point in a medium, or for an unknown surface.
    #[inline]
    pub fn anywhere(p: Vec3A) -> Self {
        Self { p, normal: Vec3A::ZERO }
    }

    /// Returns a receiver for a surface point that sends light along the unit direction `wo`.
    #[inline]
    pub fn on(materials: &Materials, surface: &Surface, wo: Vec3A) -> Self {
        let normal = match &materials.list[surface.material as usize] {
            Material::Diffuse(_)
            | Material::RoughConductor(_)
            | Material::Plastic(_)
            | Material::Measured(_) => facing(surface, wo).unwrap_or(Vec3A::ZERO),
            // Materials that transmit light or perturb normals receive light from all directions.
            _ => Vec3A::ZERO,
        };
        Self { p: surface.p, normal }
    }
}

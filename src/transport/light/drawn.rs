//! Light sampled toward a point.

use super::filter::Polarized;
use glam::Vec3A;
use optics::spectrum::Spectral;

/// Light that arrives at a point if unoccluded.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    /// Unit direction to it.
    pub wi: Vec3A,
    /// Its point of origin; for distant light, a point outside the scene.
    pub position: Vec3A,
    /// Metres to `position`.
    pub distance: f32,
    /// Irradiance at normal incidence divided by the sampling density, W/(m² nm).
    pub irradiance: Spectral,
    /// Density per steradian with which the direction was sampled; 0 if material sampling cannot find it.
    pub density: f32,
    /// Optical path length before `position`, metres; infinite if travel time is undefined.
    pub start_m: f64,
    pub polarized: Polarized,
}

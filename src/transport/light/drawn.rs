//! Light that was drawn toward a point.

use super::filter::Polarized;
use glam::Vec3A;
use optics::spectrum::Spectral;

/// Light that is known to come to a point if nothing is in between.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    /// Unit direction to it.
    pub wi: Vec3A,
    /// Where it comes from; for light from afar a point outside of the scene.
    pub position: Vec3A,
    /// Metres to `position`.
    pub distance: f32,
    /// Irradiance at normal incidence over the density with which it was drawn, W/(m² nm).
    pub irradiance: Spectral,
    /// Density per steradian with which the direction was drawn; 0 where no chance would find it.
    pub density: f32,
    /// Optical length before `position`, metres; infinite where travel time is not defined.
    pub start_m: f64,
    /// Its frame and filter.
    pub polarized: Polarized,
}

//! Lights with a single direction: distant lights and beams.

use super::Drawn;
use super::filter::Polarized;
use glam::Vec3A;
use optics::spectrum::Spectral;
use std::f32::consts::PI;

/// Irradiance profile across the axis of the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Across {
    /// Uniform irradiance, W/(m² nm).
    Even(Spectral),
    /// A uniform profile with power `power` (W/nm) over a disk of this radius (metres) about the axis through
    /// the origin.
    Disk { power: Spectral, radius: f32 },
    /// A Gaussian whose irradiance at this radius (metres) is e⁻² times the irradiance on the axis.
    Gaussian { power: Spectral, radius: f32 },
}

/// A light with a single direction.
#[derive(Clone, Copy, Debug)]
pub struct Distant {
    /// Unit direction of propagation.
    pub dir: Vec3A,
    /// A point in the plane where travel time starts, in world space, metres. The point is `None` for light
    /// from infinity, which has no travel time.
    pub origin: Option<Vec3A>,
    /// Divergence of a beam: the ratio of the radius at 1 m to the radius at the origin, minus 1. The
    /// divergence of a collimated beam is 0.
    pub spread: f32,
    /// Irradiance profile (at the origin for a diverging beam).
    pub across: Across,
    pub polarized: Polarized,
}

impl Distant {
    /// Returns the irradiance at normal incidence, W/(m² nm), at the squared distance `aside2` (m²) from the
    /// axis.
    #[inline]
    fn irradiance(&self, aside2: f32) -> Spectral {
        match self.across {
            Across::Even(e) => e,
            Across::Disk { power, radius } => {
                let r2 = radius * radius;
                power * Spectral::splat(if aside2 <= r2 { 1.0 / (PI * r2) } else { 0.0 })
            }
            Across::Gaussian { power, radius } => {
                let r2 = radius * radius;
                power * Spectral::splat(2.0 / (PI * r2) * (-2.0 * aside2 / r2).exp())
            }
        }
    }

    /// Returns the unoccluded light at point `p`. `far` is a distance in metres that exceeds the size of the
    /// scene.
    #[inline]
    pub fn toward(&self, p: Vec3A, far: f32) -> Option<Drawn> {
        let Some(origin) = self.origin else {
            let irradiance = self.irradiance(0.0);
            return (irradiance != Spectral::ZERO).then(|| Drawn {
                wi: -self.dir,
                position: p - self.dir * far,
                distance: far,
                irradiance,
                density: 0.0,
                start_m: f64::INFINITY,
                polarized: self.polarized,
            });
        };
        let to = p - origin;
        let along = to.dot(self.dir);
        if along <= 0.0 {
            return None;
        }
        // The rays of a diverging beam come from a point 1/spread behind the origin. The code starts rays at
        // the plane through the origin. Path lengths are relative to a spherical wavefront that touches the
        // plane through the origin.
        let growth = 1.0 + along * self.spread;
        let aside = (to - self.dir * along) / growth;
        let aside2 = aside.length_squared();
        let position = origin + aside;
        let way = p - position;
        let distance = way.length();
        let dir = way / distance;
        let start_m = if self.spread > 0.0 {
            let back = f64::from(1.0 / self.spread);
            let aside2 = f64::from(aside2);
            aside2 / (back + (back * back + aside2).sqrt())
        } else {
            0.0
        };
        let over = 1.0 / (growth * growth * dir.dot(self.dir));
        let irradiance = self.irradiance(aside2) * Spectral::splat(over);
        (irradiance != Spectral::ZERO).then(|| Drawn {
            wi: -dir,
            position,
            distance,
            irradiance,
            density: 0.0,
            start_m,
            polarized: self.polarized,
        })
    }
}

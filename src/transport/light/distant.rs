//! Light with one direction: from afar, or a collimated beam.

use super::drawn::Drawn;
use super::filter::Polarized;
use glam::Vec3A;
use optics::spectrum::Spectral;
use std::f32::consts::PI;

/// The irradiance across.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Across {
    /// The same everywhere, W/(m² nm).
    Even(Spectral),
    /// Power `power` (W/nm) evenly over a disk of this radius (metres) about the axis through the origin.
    Disk {
        /// W/nm.
        power: Spectral,
        /// Metres.
        radius: f32,
    },
    /// A Gaussian of this radius (metres), where its irradiance is e⁻² of that on the axis.
    Gaussian {
        /// W/nm.
        power: Spectral,
        /// Metres.
        radius: f32,
    },
}

/// Light with one direction.
#[derive(Clone, Copy, Debug)]
pub struct Distant {
    /// Unit direction in which it travels.
    pub dir: Vec3A,
    /// A point of the plane that it leaves; travel time counts from there. `None`: from infinitely far, without a time.
    pub origin: Option<Vec3A>,
    /// How fast a beam widens: its radius at 1 m over that at its origin, less 1; 0 if it is collimated.
    pub spread: f32,
    /// Its irradiance; of a beam that widens, at its origin.
    pub across: Across,
    /// Its frame and filter.
    pub polarized: Polarized,
}

impl Distant {
    /// Irradiance at normal incidence, W/(m² nm), so far from the axis at the origin (metres, squared).
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

    /// What comes to the point `p` if nothing is in between; `far` metres away is outside of the scene.
    #[inline]
    #[must_use]
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
        // Rays of a beam that widens come from a point 1/spread behind the origin; they leave the plane through the origin
        // where they cross it, on a spherical front that touches it there.
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

//! The pinhole projector: which pixel s' lights a point, and how strongly.
//!
//! Drive 1 on every pixel gives the scene's irradiance E on the virtual plane at distance 1 m, whatever the lens
//! distortion (a lens with constant pupil keeps radiance; distortion moves pixel borders and so changes how much solid
//! angle, and flux, a pixel has). A direction at angle θ to the axis has intensity E / cos³θ. Mitsuba's `projector`
//! emits π times as much for the same number.

use super::pinhole::Pinhole;
use crate::spectrum::Spectral;
use glam::Vec3A;

/// A projector.
#[derive(Clone, Copy, Debug)]
pub struct Projector {
    pub pinhole: Pinhole,
    /// Irradiance at 1 m on the axis per wavelength, W/(m² nm).
    pub irradiance: Spectral,
    /// True if it shines through the camera's own pinhole (same pose and pixels).
    pub coaxial: bool,
}

/// Light that arrives at a point from the projector if nothing is in between.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Row-major index of the one projector pixel s' that lights the point.
    pub pixel: u32,
    /// Unit direction from the point to the projector.
    pub wi: Vec3A,
    /// Distance, metres.
    pub distance: f32,
    /// Irradiance at normal incidence per unit irradiance E: 1 / (z² cosθ).
    pub factor: f32,
    /// The point in the projector's coordinates: right, down, forward.
    pub local: Vec3A,
}

impl Projector {
    /// What arrives at `p`; `None` if no projector pixel sees it.
    #[inline(always)]
    #[must_use]
    pub fn arrival(&self, p: Vec3A) -> Option<Arrival> {
        let (pixel, local) = self.pinhole.project(p)?;
        let [w, h] = self.pinhole.resolution;
        // Rounding at the far border must not leave the image.
        let (u, v) = ((pixel.x as u32).min(w - 1), (pixel.y as u32).min(h - 1));
        Some(self.lit_from(p, v * w + u, local))
    }

    /// What arrives at `p`, which the coaxial camera sees in its pixel `pixel`: s' = s, whereas projecting `p` would
    /// let rounding put a point near a pixel's border into the next pixel, or outside the image.
    #[inline(always)]
    #[must_use]
    pub fn arrival_in_line(&self, p: Vec3A, pixel: u32) -> Arrival {
        self.lit_from(p, pixel, self.pinhole.local(p))
    }

    #[inline(always)]
    fn lit_from(&self, p: Vec3A, pixel: u32, local: Vec3A) -> Arrival {
        let z = local.z;
        let to = self.pinhole.origin - p;
        let distance = to.length();
        let cos = z / distance;
        Arrival {
            pixel,
            wi: to * distance.recip(),
            distance,
            factor: 1.0 / (z * z * cos),
            local,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::pinhole::Distortion;
    use glam::{DVec2, Mat3A};

    /// The irradiance integrated over one pixel's area on the plane at 1 m is the flux into that pixel's solid angle.
    #[test]
    fn the_plane_at_one_metre_gets_the_stated_irradiance() {
        let pinhole = Pinhole::new(
            [64, 48],
            DVec2::splat(50.0),
            DVec2::new(32.0, 24.0),
            Distortion::default(),
            Vec3A::ZERO,
            Mat3A::IDENTITY,
        )
        .unwrap();
        let projector = Projector {
            pinhole,
            irradiance: Spectral::ONE,
            coaxial: false,
        };
        for (x, y) in [(0.0, 0.0), (0.5, 0.3), (-0.6, 0.45)] {
            let a = projector.arrival(Vec3A::new(x, y, 1.0)).unwrap();
            let on_plane = a.factor * (-a.wi.z);
            assert!((on_plane - 1.0).abs() < 1e-6);
            assert_eq!(a.pixel % 64, (32.0 + 50.0 * x) as u32);
            assert_eq!(a.pixel / 64, (24.0 + 50.0 * y) as u32);
        }
        assert!(projector.arrival(Vec3A::new(0.7, 0.0, 1.0)).is_none());
    }
}

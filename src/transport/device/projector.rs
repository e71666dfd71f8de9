//! The projector: the pixel s' that illuminates a point, and the irradiance at the point.
//!
//! If all pixels have drive 1, the irradiance on the virtual plane at distance 1 m is the scene's irradiance
//! E, for any lens distortion. A lens with a constant pupil preserves radiance. Distortion moves pixel
//! borders and thus changes the solid angle and the flux of a pixel. In a direction at angle θ to the axis,
//! the radiant intensity is E / cos³θ. Mitsuba's `projector` emits π times as much light for the same value
//! of E.

use super::pinhole::Pinhole;
use crate::geometry::many;
use crate::geometry::many::Many;
use optics::spectrum::Spectral;

#[derive(Clone, Copy, Debug)]
pub struct Projector {
    pub pinhole: Pinhole,
    /// Irradiance per wavelength on the axis at a distance of 1 m, W/(m² nm).
    pub irradiance: Spectral,
    /// True if the projector and the camera have the same pose and pixels.
    pub coaxial: bool,
}

/// Unoccluded light of the projector at N points.
#[derive(Clone, Copy, Debug)]
pub struct Arrivals<const N: usize> {
    /// Row-major index of the projector pixel s' that illuminates each point, or
    /// [`OUTSIDE`](super::pinhole::OUTSIDE) for points outside the image.
    pub pixel: [u32; N],
    /// Unit directions from each point to the projector.
    pub wi: Many<N>,
    /// Distance of each point from the projector, metres.
    pub distance: [f32; N],
    /// Irradiance of a surface that faces the projector, divided by E: 1 / (z² cosθ), with z in metres.
    pub factor: [f32; N],
    /// Positions of the points in device coordinates of the projector (right, down, forward), metres.
    pub local: Many<N>,
}

impl Projector {
    /// Returns the light of the projector at each of the points `p`, without occlusion.
    ///
    /// A coaxial camera sees each point in the pixel s' = s. For a coaxial camera, the caller must set
    /// `pixel` to s. With the computed `pixel`, rounding may move a point near a pixel border into the next
    /// pixel or out of the image.
    #[inline(always)]
    pub fn arrivals<const N: usize>(&self, p: &Many<N>) -> Arrivals<N> {
        let (pixel, local) = self.pinhole.pixels(p);
        let mut wi = many::less(p, self.pinhole.origin);
        let distance = many::lengths(&wi);
        let mut factor = [0.0; N];
        for i in 0..N {
            let z = local[2][i];
            let nearness = 1.0 / distance[i];
            for row in &mut wi {
                row[i] = -row[i] * nearness;
            }
            factor[i] = 1.0 / (z * z * (z / distance[i]));
        }
        Arrivals { pixel, wi, distance, factor, local }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::distortion::Distortion;
    use crate::device::pinhole::OUTSIDE;
    use glam::{DVec2, Mat3A, Vec3A};

    /// Verifies that the irradiance on the plane at distance 1 m, integrated over a pixel, equals the flux
    /// into the pixel's solid angle.
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
        let projector = Projector { pinhole, irradiance: Spectral::ONE, coaxial: false };
        let points = [(0.0, 0.0), (0.5, 0.3), (-0.6, 0.45), (0.7, 0.0)];
        let a = projector.arrivals(&[points.map(|p| p.0), points.map(|p| p.1), [1.0; 4]]);
        for (i, (x, y)) in points.into_iter().enumerate().take(3) {
            let on_plane = a.factor[i] * (-a.wi[2][i]);
            assert!((on_plane - 1.0).abs() < 1e-6);
            assert_eq!(a.pixel[i] % 64, (32.0 + 50.0 * x) as u32);
            assert_eq!(a.pixel[i] / 64, (24.0 + 50.0 * y) as u32);
        }
        assert_eq!(a.pixel[3], OUTSIDE);
    }
}

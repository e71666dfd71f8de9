//! Retarder sheet: a wave plate or a stretched film.
//!
//! In the frame of the sheet's fast axis, the matrix has M22 = M33 = cos δ and M23 = -M32 = sin δ. Light
//! along the slow axis lags by δ (Collett 2005, ch. 5). The effect of tilt on δ and on the axes is
//! selectable:
//!
//! - [`Tilt::Plate`]: a true zero-order plate of a positive uniaxial crystal. The optic axis c is in the
//!   sheet and is the slow axis. Let θ_t be the refracted angle and ψ the angle between the refracted ray and
//!   c. To first order in the birefringence, δ = δ₀ sin²ψ / cosθ_t (Born & Wolf 1999, 15.3.3 and 15.4.1). The
//!   path is longer by the factor 1/cosθ_t, and n_e(ψ) - n_o = (n_e - n_o) sin²ψ. The slow axis is c
//!   projected perpendicular to the refracted ray. Refraction rotates the slow axis about s together with the
//!   ray.
//! - [`Tilt::Constant`]: δ = δ₀ at any incidence. The fast axis is projected perpendicular to the ray.
//! - [`Tilt::Cosine`]: δ = δ₀ |cosθ| with the same axis as [`Tilt::Constant`], as in Mitsuba 3's `retarder`.
//!   The cosine model is not physical.
//!
//! Reflection by the faces is neglected, but the transmittance may include the reflection loss.

use super::lobe::Specular;
use super::sheet;
use super::side::s_vector;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::frame::project;
use optics::polarization::fresnel::FresnelBlock;
use optics::spectrum::Spectral;
use sheet::SheetAxis;

/// The dependence of retardance on the angle of incidence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tilt {
    /// Retardance of a zero-order uniaxial plate with this mean refractive index.
    Plate(f32),
    /// Retardance independent of the angle of incidence.
    Constant,
    /// Retardance proportional to the cosine of incidence.
    Cosine,
}

#[derive(Clone, Copy, Debug)]
pub struct Retarder {
    pub axis: SheetAxis,
    /// Retardance δ₀ at normal incidence per wavelength, radians.
    pub retardance: Spectral,
    /// Power transmittance in [0, 1].
    pub transmittance: Spectral,
    pub tilt: Tilt,
}

impl Retarder {
    /// Returns the lobe of light that is transmitted to `wo` without deflection.
    #[inline]
    pub fn specular(&self, at: &Surface, wo: Vec3A) -> Specular {
        let axis = self.axis.at(at);
        let (fast, factor) = match self.tilt {
            Tilt::Constant => (project(axis, wo), 1.0),
            Tilt::Cosine => (project(axis, wo), at.ns.dot(wo).abs()),
            Tilt::Plate(ior) => plate(at.ns, axis, wo, ior),
        };
        let (sin, cos) = (self.retardance * Spectral::splat(factor)).sin_cos();
        let block = FresnelBlock {
            a: self.transmittance,
            b: Spectral::ZERO,
            c: self.transmittance * cos,
            d: self.transmittance * sin,
        };
        sheet::straight(wo, block, fast)
    }
}

/// Returns the fast axis for light to `wo`, a unit vector perpendicular to `wo`, and sin²ψ / cosθ_t.
#[inline]
fn plate(normal: Vec3A, fast: Vec3A, wo: Vec3A, ior: f32) -> (Vec3A, f32) {
    let n = if normal.dot(wo) < 0.0 { -normal } else { normal };
    let tangential = wo - n * n.dot(wo);
    let sin2 = tangential.length_squared() / (ior * ior);
    let cos_t = (1.0 - sin2).max(1e-6).sqrt();
    let inside = tangential / ior + n * cos_t;
    let optic = normal.cross(fast);
    let along = inside.dot(optic);
    // The ordinary ray's electric vector is perpendicular to the ray and to the optic axis. The ray and the
    // optic axis are never parallel, because the ray is inclined by at most asin(1/ior) to the sheet's
    // normal.
    let ordinary = inside.cross(optic).normalize_or(fast);
    let s = s_vector(n, wo);
    // Outside the plate, the component along s is the same. The perpendicular component is rotated with the
    // ray.
    let outer = s * ordinary.dot(s) + wo.cross(s) * ordinary.dot(inside.cross(s));
    (project(outer, wo), (1.0 - along * along) / cos_t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use optics::polarization::frame::perpendicular;

    /// Compares the matrix with that of Mitsuba 3.9.1's `retarder` at `theta = 30`, `delta = 100`, from
    /// either side.
    #[test]
    fn upright_retarders_match_mitsuba() {
        let at = Surface { ng: Vec3A::Z, ns: Vec3A::Z, tangent: Vec3A::X, ..Surface::default() };
        for tilt in [Tilt::Plate(1.5), Tilt::Constant, Tilt::Cosine] {
            let sheet = Retarder {
                axis: SheetAxis::Angle(30_f32.to_radians()),
                retardance: Spectral::splat(100_f32.to_radians()),
                transmittance: Spectral::ONE,
                tilt,
            };
            for (wo, side) in [(Vec3A::Z, 1.0), (-Vec3A::Z, -1.0)] {
                let x = perpendicular(wo);
                let m = sheet.specular(&at, wo).scatter.between(wo, x, -wo, x).lane(0);
                for (got, want) in [
                    (m[0][0], 1.0),
                    (m[1][1], 0.119_764),
                    (m[1][2], side * 0.508_205),
                    (m[1][3], side * -0.852_869),
                    (m[2][3], 0.492_404),
                    (m[3][1], side * 0.852_869),
                    (m[3][3], -0.173_648),
                ] {
                    assert!((got - want).abs() < 2e-6, "{tilt:?} from {wo}: {m:?}");
                }
            }
        }
    }
}

//! The reflection of circularly polarized light by a face of known normal: −(3,3) of one reflection from
//! microfacets.
//!
//! The half vector h bisects the directions to the camera and to the projector. The angle between h and
//! either direction is θ. The angle between the normal and the direction to the camera is θ_o. The Fresnel
//! amplitude coefficients at θ are r_s and r_p. With these symbols,
//!
//! > −M33 = −r_s r_p · D(h) G2 / (4 cosθ_o) · 1/(cos³θ_p d²),
//!
//! with the GGX distribution D of Walter et al. (2007) and Heitz's correlated masking-shadowing function G2
//! (2014, eq. 99). The point is at distance d from the projector, in a direction at angle θ_p to the
//! projector's axis. The projector's irradiance on the plane at 1 m is 1. Rotations of frames do not change
//! (3,3). At normal incidence, −r_s r_p is the reflectance. Beyond Brewster's angle, −r_s r_p is negative.

use crate::pinhole::Rig;
use nalgebra::Vector3;

/// Rough glass with a GGX distribution of microfacets.
#[derive(Clone, Copy, Debug)]
pub struct Glass {
    pub index: f64,
    /// Roughness α of the facets.
    pub alpha: f64,
}

impl Glass {
    /// Returns −r_s r_p (Fresnel amplitude coefficients) for an angle of incidence with cosine `cos`.
    pub fn turned(self, cos: f64) -> f64 {
        let n2 = self.index * self.index;
        let root = (n2 - 1.0 + cos * cos).sqrt();
        let (s, p) = ((cos - root) / (cos + root), (n2 * cos - root) / (n2 * cos + root));
        -s * p
    }

    /// Returns D(h) G2 / (4 cosθ_o), in 1/sr. For perfectly reflecting facets, this value is the radiance
    /// divided by the irradiance perpendicular to the beam. The result is 0 unless the two unit directions
    /// are on the side of the normal `n`.
    pub fn facets(self, n: Vector3<f64>, wo: Vector3<f64>, wi: Vector3<f64>) -> f64 {
        let (co, ci) = (n.dot(&wo), n.dot(&wi));
        if !(co > 0.0 && ci > 0.0) {
            return 0.0;
        }
        let (a2, ch) = (self.alpha * self.alpha, n.dot(&(wo + wi).normalize()));
        let d = a2 / (std::f64::consts::PI * (ch * ch * (a2 - 1.0) + 1.0).powi(2));
        let lambda = |c: f64| ((1.0 + a2 * (1.0 / (c * c) - 1.0)).sqrt() - 1.0) / 2.0;
        d / (1.0 + lambda(co) + lambda(ci)) / (4.0 * co)
    }

    /// Returns −(3,3) of a point at `p` with normal `n`, for an irradiance of 1 on the plane 1 m in front of
    /// the projector.
    pub fn reflected(self, rig: &Rig, p: Vector3<f64>, n: Vector3<f64>) -> f64 {
        let (to_camera, to_projector) = (rig.camera.origin - p, rig.projector.origin - p);
        let (wo, wi) = (to_camera.normalize(), to_projector.normalize());
        let forward = rig.projector.axes.column(2);
        let off = -forward.dot(&wi);
        if off <= 0.0 {
            return 0.0;
        }
        let light = 1.0 / (off.powi(3) * to_projector.norm_squared());
        self.turned(wo.dot(&(wo + wi).normalize())) * self.facets(n, wo, wi) * light
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks the values in `CONVENTIONS.md` for glass of index 1.5 at normal incidence and at 45°.
    #[test]
    fn reversal_of_circular_light_matches_the_conventions() {
        let glass = Glass { index: 1.5, alpha: 0.3 };
        assert!((glass.turned(1.0) - 0.04).abs() < 1e-12);
        assert!((glass.turned(0.5_f64.sqrt()) - 0.0279111).abs() < 1e-6);
        // At Brewster's angle, the value is zero.
        let cos = 1.0 / (1.0 + 1.5_f64.powi(2)).sqrt();
        assert!(glass.turned(cos).abs() < 1e-12 && glass.turned(0.9 * cos) < 0.0);
    }

    /// D cosθ_h integrates to 1 over the half vectors (Walter et al. 2007, eq. 4). The test uses normal
    /// incidence and divides by G2.
    #[test]
    fn facets_are_normalized() {
        let glass = Glass { index: 1.5, alpha: 0.4 };
        let n = Vector3::z();
        let steps = 4000;
        let sum: f64 = (0..steps)
            .map(|k| {
                let half = (f64::from(k) + 0.5) / f64::from(steps) * std::f64::consts::FRAC_PI_4;
                let (sin, cos) = (2.0 * half).sin_cos();
                let wi = Vector3::new(sin, 0.0, cos);
                let lambda = ((1.0 + 0.16 * (1.0 / (cos * cos) - 1.0)).sqrt() - 1.0) / 2.0;
                let d = glass.facets(n, n, wi) * 4.0 * (1.0 + lambda);
                let ring =
                    std::f64::consts::TAU * half.sin() * std::f64::consts::FRAC_PI_4 / f64::from(steps);
                d * half.cos() * ring
            })
            .sum();
        // The fraction of half vectors up to the angle θ = 45° is tan² θ / (α² + tan² θ).
        assert!((sum - 1.0 / (1.0 + 0.16)).abs() < 1e-4, "{sum}");
    }
}

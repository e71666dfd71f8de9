//! Half-vector and difference coordinates (Rusinkiewicz 1998, "A new change of variables for efficient BRDF
//! representation"), with the signs of Mitsuba's `measured_polarized`.
//!
//! Light arrives from `wi`, the viewer is in direction `wo`, and the normal is n. The half vector of this
//! pair is h = (wi + wo)/|wi + wo|, and the polar angles are θ_h = ∠(n, h) and θ_d = ∠(h, wi). The azimuth
//! φ_d of wi about h is 0 along t = b × h and increases toward b = n × h/|n × h|. The material is isotropic,
//! so the azimuth of h is ignored.
//!
//! The stored matrices use the same frame vector for both rays: the unit vector s = wi × wo/|wi × wo|,
//! perpendicular to the plane of reflection. If p is the component of wi perpendicular to h, then s = p × h
//! and p = h × s. The azimuth φ_d is computed from s, so that φ_d and s remain consistent if wi and wo nearly
//! coincide.

use glam::Vec3A;
use optics::polarization::frame::perpendicular;

/// A pair of directions, without their common rotation about the normal. Angles are in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinates {
    /// Azimuth of the difference vector, radians in [-π, π].
    pub phi_d: f32,
    /// Polar angle of the difference vector, radians in [0, π/2].
    pub theta_d: f32,
    /// Polar angle of the half vector, radians in [0, π/2].
    pub theta_h: f32,
}

/// Returns the coordinates of unit directions on the side of the unit normal `n`, and the frame vector s.
///
/// If n = h, t is an arbitrary tangent, because an isotropic table does not depend on φ_d for n = h. If wi =
/// wo, φ_d is 0 and s = -b.
#[inline]
pub fn coordinates(n: Vec3A, wo: Vec3A, wi: Vec3A) -> (Coordinates, Vec3A) {
    let (sum, difference) = (wi + wo, wi - wo);
    let length2 = sum.length_squared();
    // Opposite directions on the horizon have no unique half vector. The normal is a valid choice.
    let h = if length2 > 1e-12 { sum * length2.sqrt().recip() } else { n };
    // Compute n × h without cancellation if n and h are close.
    let across = n.cross(h - n);
    let sin_h = across.length();
    let b = if sin_h > 1e-6 { across * sin_h.recip() } else { perpendicular(h) };
    // Compute 2 wi × wo without cancellation.
    let cross = difference.cross(sum);
    let size = cross.length();
    let s = if size > 1e-6 { cross * size.recip() } else { -b };
    let (t, p) = (b.cross(h), h.cross(s));
    let at = Coordinates {
        phi_d: b.dot(p).atan2(t.dot(p)),
        // Use the ratio of chord to sum, because this ratio is accurate near 0 and an arc cosine is not.
        theta_d: difference.length().atan2(length2.sqrt()),
        theta_h: sin_h.atan2(n.dot(h)),
    };
    (at, s)
}

/// Returns the directions `wi` and `wo` with the given coordinates, and the common frame vector s. The normal
/// is +z, and h is in the xz half plane. φ_d determines s even if wi = wo. One of the directions may be below
/// the surface.
pub fn directions(at: Coordinates) -> (Vec3A, Vec3A, Vec3A) {
    let (sin_h, cos_h) = at.theta_h.sin_cos();
    let (sin_d, cos_d) = at.theta_d.sin_cos();
    let (sin_phi, cos_phi) = at.phi_d.sin_cos();
    let h = Vec3A::new(sin_h, 0.0, cos_h);
    let p = Vec3A::new(cos_h * cos_phi, sin_phi, -sin_h * cos_phi);
    let (wi, wo) = (h * cos_d + p * sin_d, h * cos_d - p * sin_d);
    (wi.normalize(), wo.normalize(), p.cross(h).normalize())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, Mat3A};
    use proptest::prelude::*;
    use std::f32::consts::{FRAC_PI_2, PI, TAU};

    /// Computes φ_d, θ_d, θ_h and both frames with Mitsuba's formulas in f64. Light arrives from `i`, the
    /// viewer is in direction `o`, and the normal is +z.
    fn reference(i: DVec3, o: DVec3) -> ([f64; 3], [DVec3; 2]) {
        let h = (i + o).normalize();
        let b = DVec3::Z.cross(h).normalize();
        let t = b.cross(h).normalize();
        let p = (i - h * i.dot(h)).normalize();
        let angles = [b.dot(p).atan2(t.dot(p)), h.dot(i).acos(), h.z.acos()];
        let frame = |difference: DVec3, z: DVec3| {
            let t = difference.cross(z).normalize();
            t.cross(z).normalize().cross(z)
        };
        (angles, [frame(i - o, -i), frame(o - i, o)])
    }

    fn frame(turn: f32) -> Mat3A {
        Mat3A::from_rotation_y(0.7) * Mat3A::from_rotation_x(-1.1) * Mat3A::from_rotation_z(turn)
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..Default::default() })]

        /// Verifies that the conversion from coordinates to directions and back is the identity, for any
        /// rotation about the normal.
        #[test]
        fn coordinates_round_trip(phi_d in -3.1..3.1_f32, theta_d in 0.01..1.56_f32, theta_h in 0.01..1.56_f32, turn in 0.0..TAU) {
            let at = Coordinates { phi_d, theta_d, theta_h };
            let (wi, wo, own) = directions(at);
            let f = frame(turn);
            let (back, s) = coordinates(f.z_axis, f * wo, f * wi);
            prop_assert!((back.theta_d - theta_d).abs() < 2e-6, "{back:?}");
            prop_assert!((back.theta_h - theta_h).abs() < 2e-6 / theta_d.cos(), "{back:?}");
            let slack = 2e-6 / (theta_h.sin() * theta_d.sin() * theta_d.cos());
            prop_assert!((back.phi_d - phi_d).abs() < slack, "{back:?} is not {at:?}");
            prop_assert!((s - f * own).length() < 2e-6 / (theta_d.sin() * theta_d.cos()), "{s}");
            prop_assert!(s.dot(f * wi).abs() < 1e-5 / theta_d.sin() && (s.length() - 1.0).abs() < 1e-5);
        }

        /// Verifies that the conversion from directions to coordinates and back preserves all cosines. The
        /// rotation about the normal is not preserved.
        #[test]
        fn directions_round_trip_up_to_rotation(z in prop::array::uniform2(0.02..1.0_f32), phi in 0.0..TAU) {
            let of = |z: f32, phi: f32| {
                let r = (1.0 - z * z).sqrt();
                Vec3A::new(r * phi.cos(), r * phi.sin(), z)
            };
            let (wi, wo) = (of(z[0], 0.4), of(z[1], phi));
            let (at, _) = coordinates(Vec3A::Z, wo, wi);
            let (i, o, _) = directions(at);
            prop_assert!((i.z - wi.z).abs() < 2e-5 && (o.z - wo.z).abs() < 2e-5, "{at:?}: {i} {o}");
            prop_assert!((i.dot(o) - wi.dot(wo)).abs() < 2e-5);
            // The sign and magnitude of n · (i × o) are preserved. The handedness is therefore preserved too.
            prop_assert!((i.cross(o).z - wi.cross(wo).z).abs() < 2e-5);
        }

        /// Verifies that angles and frames agree with Mitsuba's formulas.
        #[test]
        fn angles_and_frames_match_mitsuba(z in prop::array::uniform2(0.05..0.98_f32), phi in 0.3..5.9_f32) {
            let of = |z: f32, phi: f32| {
                let r = (1.0 - z * z).sqrt();
                Vec3A::new(r * phi.cos(), r * phi.sin(), z)
            };
            let (wi, wo) = (of(z[0], 0.4), of(z[1], 0.4 + phi));
            let (angles, frames) = reference(wi.as_dvec3().normalize(), wo.as_dvec3().normalize());
            let (at, s) = coordinates(Vec3A::Z, wo, wi);
            let sin_h = f64::from(at.theta_h).sin().max(1e-3);
            for (got, want) in [at.phi_d, at.theta_d, at.theta_h].iter().zip(angles) {
                let off = (f64::from(*got) - want).abs();
                prop_assert!(off.min(std::f64::consts::TAU - off) < 1e-5 / sin_h, "{at:?} is not {angles:?}");
            }
            for f in frames {
                prop_assert!((s.as_dvec3() - f).length() < 1e-5);
            }
        }
    }

    /// Verifies that angles are finite and that the frame vector is a unit vector perpendicular to both rays.
    /// The test covers h = n, wi = wo, h = n = wi = wo, and directions on the horizon.
    #[test]
    fn degenerate_configurations_have_coordinates() {
        let f = frame(0.3);
        let n = f.z_axis;
        let of = |theta: f32, phi: f32| {
            let ((s, c), (sp, cp)) = (theta.sin_cos(), phi.sin_cos());
            (f * Vec3A::new(s * cp, s * sp, c)).normalize()
        };
        let tilt = [0.0, 1e-7, 1e-4, 0.5, 1.5, FRAC_PI_2 - 1e-6, FRAC_PI_2];
        for (a, b) in tilt.iter().flat_map(|a| tilt.map(|b| (*a, b))) {
            for phi in [0.0, 1e-7, 1e-3, 1.0, PI - 1e-6, PI] {
                let (wo, wi) = (of(a, 0.2), of(b, 0.2 + phi));
                let (at, s) = coordinates(n, wo, wi);
                let fine = at.phi_d.abs() <= PI + 1e-6
                    && (0.0..=FRAC_PI_2 + 1e-6).contains(&at.theta_d)
                    && (0.0..=FRAC_PI_2 + 1e-3).contains(&at.theta_h);
                assert!(fine, "{a} {b} {phi}: {at:?}");
                assert!((s.length() - 1.0).abs() < 1e-5, "{a} {b} {phi}: s = {s}");
                let off = s.dot(wo).abs().max(s.dot(wi).abs());
                assert!(off < 1e-5 || at.theta_d > 1.57, "{a} {b} {phi}: s = {s}, off by {off}");
            }
        }
        let (at, s) = coordinates(Vec3A::Z, Vec3A::Z, Vec3A::Z);
        assert_eq!((at.theta_d, at.theta_h), (0.0, 0.0));
        assert!(s.z.abs() < 1e-6);
    }
}

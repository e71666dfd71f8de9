//! The geometry of one scattering event, and the matrix of the event in the scattering plane.
//!
//! As for surfaces, light leaves along `wo` and arrives from `wi`. Both directions point away from the
//! scattering point. Light travels along -wi before the event and along wo after the event, so cosθ = -wi·wo.
//! The first axis of both Stokes frames is perpendicular to the scattering plane (s ∥ wi × wo), as for
//! reflection ([`Scatter::Fresnel`]). In these frames, randomly oriented, mirror-symmetric particles have the
//! following matrix (van de Hulst 1957, sect. 5.22):
//!
//!     S11 S12  0   0
//!     S12 S22  0   0
//!      0   0  S33 S34
//!      0   0 -S34 S44

use glam::Vec3A;
use optics::polarization::frame::perpendicular;
use optics::polarization::mueller::Mueller;
use optics::polarization::scatter::Scatter;
use optics::sampling::warp::sin_cos_turns;
use optics::spectrum::Spectral;

/// A scattering angle θ, stored as 1 - cosθ and 1 + cosθ. Each value is accurate near 0. The two values are
/// stored because forward peaks are narrower than the resolution of cosθ in f32.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angle {
    /// 1 - cosθ, in [0, 2].
    pub forward: f32,
    /// 1 + cosθ, in [0, 2].
    pub backward: f32,
}

impl Angle {
    /// Returns the scattering angle between light that leaves along `wo` and light that arrives from `wi`
    /// (unit vectors).
    #[inline]
    pub fn between(wo: Vec3A, wi: Vec3A) -> Self {
        Self {
            forward: (0.5 * (wo + wi).length_squared()).min(2.0),
            backward: (0.5 * (wo - wi).length_squared()).min(2.0),
        }
    }

    /// Returns the scattering angle for a cosine in [-1, 1].
    #[inline]
    pub(crate) fn of_cos(mu: f32) -> Self {
        Self { forward: 1.0 - mu, backward: 1.0 + mu }
    }

    /// Returns the scattering angle for a value of 1 - cosθ in [0, 2].
    #[inline]
    pub(crate) fn of_forward(forward: f32) -> Self {
        Self { forward, backward: 2.0 - forward }
    }

    /// Returns the supplementary angle 180° - θ.
    #[inline]
    pub fn supplement(self) -> Self {
        Self { forward: self.backward, backward: self.forward }
    }

    #[inline]
    pub fn cos(self) -> f32 {
        0.5 * (self.backward - self.forward)
    }

    #[inline]
    pub fn sin2(self) -> f32 {
        self.forward * self.backward
    }

    /// Returns the direction `wi` at this scattering angle to `wo`, and the unit normal of the scattering
    /// plane. The azimuth of `wi` is 2π `turns` (0 ≤ `turns` ≤ 1).
    #[inline]
    pub fn direction(self, wo: Vec3A, turns: f32) -> (Vec3A, Vec3A) {
        let x = perpendicular(wo);
        let y = wo.cross(x);
        let (sin, cos) = sin_cos_turns(turns);
        let across = x * cos + y * sin;
        let wi = across * self.sin2().max(0.0).sqrt() - wo * self.cos();
        (wi.normalize(), y * cos - x * sin)
    }
}

/// Returns the unit normal of the scattering plane. In the forward and backward directions, the scattering
/// matrix does not depend on the normal, and the result is an arbitrary perpendicular unit vector.
#[inline]
pub(crate) fn plane_normal(wo: Vec3A, wi: Vec3A) -> Vec3A {
    // For nearly parallel vectors, use the short sum or difference to avoid cancellation.
    let short = if wo.dot(wi) < 0.0 { wo + wi } else { wo - wi };
    let n = wo.cross(short);
    let n2 = n.length_squared();
    if n2 > 1e-12 { n * n2.sqrt().recip() } else { perpendicular(wo) }
}

/// The six elements of the scattering matrix in the module documentation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elements<T> {
    /// Element S11 per steradian, the scattered intensity of unpolarized light, with integral 1.
    pub s11: T,
    pub s12: T,
    pub s22: T,
    pub s33: T,
    pub s34: T,
    pub s44: T,
}

impl Elements<f32> {
    /// Returns elements with the same values in all wavelength lanes.
    #[inline]
    pub fn splat(self) -> Elements<Spectral> {
        Elements {
            s11: Spectral::splat(self.s11),
            s12: Spectral::splat(self.s12),
            s22: Spectral::splat(self.s22),
            s33: Spectral::splat(self.s33),
            s34: Spectral::splat(self.s34),
            s44: Spectral::splat(self.s44),
        }
    }
}

impl Elements<Spectral> {
    /// Returns the scattering matrix with these elements for a scattering plane with unit normal `s`.
    #[inline]
    pub fn scatter(self, s: Vec3A) -> Scatter {
        let z = Spectral::ZERO;
        Scatter::Full {
            mueller: Mueller {
                m: [
                    [self.s11, self.s12, z, z],
                    [self.s12, self.s22, z, z],
                    [z, z, self.s33, self.s34],
                    [z, z, -self.s34, self.s44],
                ],
            },
            frame_out: s,
            frame_in: s,
        }
    }
}

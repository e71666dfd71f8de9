//! The geometry of one scattering event, and its matrix in the scattering plane.
//!
//! As for surfaces, `wo` points to where light goes and `wi` to where it comes from, both away from the point, so that
//! light travels along -wi before and along wo after: cosθ = -wi·wo. Both Stokes frames have the perpendicular of the
//! scattering plane, s ∥ wi × wo, as their first axis, as for reflection ([`Scatter::Fresnel`]). In them the matrix of
//! any cloud of randomly oriented, mirror-symmetric particles is (van de Hulst 1957, sect. 5.22)
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

/// A scattering angle θ as 1 - cosθ and 1 + cosθ, each exact where it is small: forward peaks are narrower than single
/// precision of a cosine resolves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angle {
    /// 1 - cosθ, 0..2.
    pub forward: f32,
    /// 1 + cosθ, 0..2.
    pub backward: f32,
}

impl Angle {
    /// Between light that leaves along `wo` and light that comes from `wi`, unit vectors.
    #[inline]
    #[must_use]
    pub fn between(wo: Vec3A, wi: Vec3A) -> Self {
        Self {
            forward: (0.5 * (wo + wi).length_squared()).min(2.0),
            backward: (0.5 * (wo - wi).length_squared()).min(2.0),
        }
    }

    /// Of a cosine in -1..1.
    #[inline]
    #[must_use]
    pub fn of_cos(mu: f32) -> Self {
        Self {
            forward: 1.0 - mu,
            backward: 1.0 + mu,
        }
    }

    /// Of 1 - cosθ in 0..2.
    #[inline]
    #[must_use]
    pub fn of_forward(forward: f32) -> Self {
        Self {
            forward,
            backward: 2.0 - forward,
        }
    }

    /// The supplement of an angle: 180° - θ.
    #[inline]
    #[must_use]
    pub fn supplement(self) -> Self {
        Self {
            forward: self.backward,
            backward: self.forward,
        }
    }

    /// cosθ.
    #[inline]
    #[must_use]
    pub fn cos(self) -> f32 {
        0.5 * (self.backward - self.forward)
    }

    /// sin²θ.
    #[inline]
    #[must_use]
    pub fn sin2(self) -> f32 {
        self.forward * self.backward
    }

    /// The direction `wi` that makes this angle with `wo`, at an azimuth of `turns` full turns (0..1), and the unit
    /// perpendicular of the scattering plane.
    #[inline]
    #[must_use]
    pub fn direction(self, wo: Vec3A, turns: f32) -> (Vec3A, Vec3A) {
        let x = perpendicular(wo);
        let y = wo.cross(x);
        let (sin, cos) = sin_cos_turns(turns);
        let across = x * cos + y * sin;
        let wi = across * self.sin2().max(0.0).sqrt() - wo * self.cos();
        (wi.normalize(), y * cos - x * sin)
    }
}

/// The unit perpendicular of the scattering plane; any perpendicular where light goes straight on or straight back,
/// which is as good since the matrix is the same in all of them there.
#[inline]
#[must_use]
pub fn plane_normal(wo: Vec3A, wi: Vec3A) -> Vec3A {
    // Of nearly parallel vectors the short sum or difference keeps the digits that decide.
    let short = if wo.dot(wi) < 0.0 { wo + wi } else { wo - wi };
    let n = wo.cross(short);
    let n2 = n.length_squared();
    if n2 > 1e-12 {
        n * n2.sqrt().recip()
    } else {
        perpendicular(wo)
    }
}

/// The six elements of the matrix at the head of this file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elements<T> {
    /// S11, the intensity of unpolarized light: its integral over the sphere is 1.
    pub s11: T,
    /// S12 = S21.
    pub s12: T,
    /// S22.
    pub s22: T,
    /// S33.
    pub s33: T,
    /// S34 = -S43.
    pub s34: T,
    /// S44.
    pub s44: T,
}

impl Elements<f32> {
    /// The same in all wavelength lanes.
    #[inline]
    #[must_use]
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
    /// The interaction in a scattering plane of unit perpendicular `s`.
    #[inline]
    #[must_use]
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

//! Polarizer sheets, linear or circular.
//!
//! A linear polarizer is dichroic, that is, the polarizer blocks the component of the electric vector along
//! the absorbing axis a. Let a' be the projection of a perpendicular to the ray d. The component along t = d
//! × a' passes (Korger et al. 2013, "The polarization properties of a tilted polarizer", eq. 5; Mitsuba 3's
//! `polarizer`). At normal incidence, t is the transmission axis. In the frame of t, the matrix is a
//! diattenuator with power transmittances T (along t) and ε·T (along a'):
//!
//! > M00 = M11 = T(1 + ε)/2,  M01 = M10 = T(1 - ε)/2,  M22 = M33 = T√ε.
//!
//! Reflection by the faces is neglected, but T may include the reflection loss.
//!
//! A circular polarizer passes one handedness of circular polarization and blocks the other, for light from
//! either side. In any frame, the elements of the matrix are
//!
//! > M00 = M33 = T(1 + ε)/2,  M03 = M30 = ±T(1 - ε)/2 (+ right),  M11 = M22 = T√ε.

use super::lobe::Specular;
use super::sheet;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::frame::{perpendicular, project};
use optics::polarization::fresnel::FresnelBlock;
use optics::polarization::mueller::Mueller;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sheet::SheetAxis;

/// The polarization state that a polarizer sheet passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Passes {
    /// Linear polarization along the transmission axis.
    #[default]
    Linear,
    /// Right circular polarization, s3 > 0.
    Right,
    /// Left circular polarization, s3 < 0.
    Left,
}

#[derive(Clone, Copy, Debug)]
pub struct Polarizer {
    /// Transmission axis.
    pub axis: SheetAxis,
    /// The polarization state that passes. Only linear polarizers use `axis`.
    pub passes: Passes,
    /// Power transmittance T of light polarized along the transmission axis, in [0, 1].
    pub transmittance: Spectral,
    /// Power transmittance ε of the blocked component as a fraction of T, in [0, 1].
    pub extinction: Spectral,
}

impl Polarizer {
    /// Returns the lobe of light that is transmitted to `wo` without deflection.
    #[inline]
    pub fn specular(&self, at: &Surface, wo: Vec3A) -> Specular {
        if self.passes != Passes::Linear {
            return self.circular(wo);
        }
        let absorbing = project(at.ns.cross(self.axis.at(at)), wo);
        let half = self.transmittance * Spectral::HALF;
        let block = FresnelBlock {
            a: half * (Spectral::ONE + self.extinction),
            b: half * (Spectral::ONE - self.extinction),
            c: self.transmittance * self.extinction.sqrt(),
            d: Spectral::ZERO,
        };
        sheet::straight(wo, block, wo.cross(absorbing))
    }

    fn circular(&self, wo: Vec3A) -> Specular {
        let half = self.transmittance * Spectral::HALF;
        let hand = if self.passes == Passes::Right { 1.0 } else { -1.0 };
        let sum = half * (Spectral::ONE + self.extinction);
        let difference = half * (Spectral::ONE - self.extinction) * Spectral::splat(hand);
        let linear = self.transmittance * self.extinction.sqrt();
        let o = Spectral::ZERO;
        let frame = perpendicular(wo);
        Specular {
            wi: -wo,
            scatter: Scatter::Full {
                mueller: Mueller {
                    m: [
                        [sum, o, o, difference],
                        [o, linear, o, o],
                        [o, o, linear, o],
                        [difference, o, o, sum],
                    ],
                },
                frame_out: frame,
                frame_in: frame,
            },
            filling: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares the matrix with that of Mitsuba 3.9.1's `polarizer` at `theta = -30` (Mitsuba's angle has the
    /// opposite sign).
    #[test]
    fn tilted_polarizers_match_mitsuba() {
        let at = Surface { ng: Vec3A::Z, ns: Vec3A::Z, tangent: Vec3A::X, ..Surface::default() };
        let sheet = Polarizer {
            axis: SheetAxis::Angle(30_f32.to_radians()),
            passes: Passes::Linear,
            transmittance: Spectral::ONE,
            extinction: Spectral::ZERO,
        };
        for (wo, [m01, m02, m11, m12]) in [
            ([0.6, 0.0, 0.8], [0.324_176, 0.380_67, 0.210_18, 0.246_808]),
            ([-0.48, 0.6, -0.64], [0.317_718, -0.386_077, 0.201_889, -0.245_327]),
            ([0.28, 0.576, -0.768], [0.144_119, -0.478_779, 0.041_541, -0.138_003]),
        ] {
            let wo = Vec3A::from_array(wo);
            let x = perpendicular(wo);
            let m = sheet.specular(&at, wo).scatter.between(wo, x, -wo, x).lane(0);
            for (got, want) in [
                (m[0][0], 0.5),
                (m[0][1], m01),
                (m[2][0], m02),
                (m[1][1], m11),
                (m[1][2], m12),
                (m[3][3], 0.0),
            ] {
                assert!((got - want).abs() < 2e-6, "{wo}: {m:?}");
            }
        }
    }
}

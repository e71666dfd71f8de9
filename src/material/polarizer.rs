//! Linear polarizer sheet.
//!
//! Dichroic: the component of the electric vector along the absorbing axis a, as the ray sees it, is blocked. With
//! a' = a projected perpendicular to the ray d, light along t = d × a' passes (Korger et al. 2013, "The polarization
//! properties of a tilted polarizer", eq. 5; Mitsuba 3's `polarizer`). At normal incidence t is the transmitting axis
//! itself. In the frame t the matrix is a diattenuator of the power transmittances T (of t) and ε·T (of a'):
//!
//! > M00 = M11 = T(1 + ε)/2,  M01 = M10 = T(1 - ε)/2,  M22 = M33 = T√ε.
//!
//! Reflection by the faces is neglected; T may include it.

use super::{Specular, sheet};
use crate::geometry::ray::Surface;
use crate::polarization::frame::project;
use crate::polarization::fresnel::FresnelBlock;
use crate::spectrum::Spectral;
use glam::Vec3A;
use sheet::SheetAxis;

/// A polarizer sheet.
#[derive(Clone, Copy, Debug)]
pub struct Polarizer {
    /// Transmitting axis.
    pub axis: SheetAxis,
    /// T: power transmittance of light along the transmitting axis, 0..1.
    pub transmittance: Spectral,
    /// ε: how much of the blocked component passes, as a share of T, 0..1.
    pub extinction: Spectral,
}

impl Polarizer {
    /// What passes straight through to `wo`.
    #[inline]
    #[must_use]
    pub fn specular(&self, at: &Surface, wo: Vec3A) -> Specular {
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
}

//! Rayleigh scattering by molecules and by particles much smaller than the wavelength.
//!
//! The matrix is that of Hansen & Travis (1974), "Light scattering in planetary atmospheres", Space Sci. Rev.
//! 16, eq. 2.15. In this module, the matrix is per steradian, and the first axis is the normal of the
//! scattering plane. The depolarization factor ρ is the ratio of parallel to perpendicular intensity at 90°
//! for unpolarized incident light. Let Δ = (1 - ρ)/(1 + ρ/2), Δ' = (1 - 2ρ)/(1 - ρ), and μ = cosθ:
//!
//! - S11 = (3Δ/16π)(1 + μ²) + (1 - Δ)/4π, S22 = (3Δ/16π)(1 + μ²), S12 = S21 = (3Δ/16π)(1 - μ²),
//! - S33 = (3Δ/8π) μ, S44 = Δ' S33, S34 = 0.
//!
//! King's factor is (6 + 3ρ)/(6 - 7ρ). Air has ρ = 0.028 (Young 1980). Without absorption, ρ ≤ 1/2.

use super::scattered::{Angle, Elements};
use std::f32::consts::PI;

/// Maximum depolarization factor, which is that of needle-shaped particles.
pub const LARGEST_DEPOLARIZATION: f32 = 0.5;

/// Rayleigh phase function with a depolarization factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rayleigh {
    /// Fraction Δ of dipole scattering (see the module documentation).
    dipole: f32,
    /// Product Δ Δ' (see the module documentation).
    circular: f32,
}

impl Rayleigh {
    /// Creates a phase function from a depolarization factor, clamped to 0..[`LARGEST_DEPOLARIZATION`].
    pub fn new(depolarization: f32) -> Self {
        let rho = depolarization.clamp(0.0, LARGEST_DEPOLARIZATION);
        let dipole = (1.0 - rho) / (1.0 + 0.5 * rho);
        Self { dipole, circular: dipole * (1.0 - 2.0 * rho) / (1.0 - rho) }
    }

    /// Returns true for pure dipole scattering, for which S22 = S11 and S44 = S33.
    #[inline]
    pub(crate) fn is_pure(self) -> bool {
        self.dipole == 1.0
    }

    /// Returns the element S11 at a scattering angle, per steradian. S11 equals the sampling density of
    /// [`Self::sample`].
    #[inline]
    pub fn intensity(self, at: Angle) -> f32 {
        let mu = at.cos();
        (3.0 * self.dipole * (1.0 + mu * mu) + 4.0 * (1.0 - self.dipole)) / (16.0 * PI)
    }

    /// Returns the scattering matrix at a scattering angle, per steradian.
    #[inline]
    pub fn elements(self, at: Angle) -> Elements<f32> {
        let mu = at.cos();
        let unit = 3.0 / (16.0 * PI);
        Elements {
            s11: self.intensity(at),
            s12: unit * self.dipole * at.sin2(),
            s22: unit * self.dipole * (1.0 + mu * mu),
            s33: 2.0 * unit * self.dipole * mu,
            s34: 0.0,
            s44: 2.0 * unit * self.circular * mu,
        }
    }

    /// Samples a scattering angle with density [`Self::intensity`], from a uniform random number in [0, 1).
    /// Cardano's formula solves the cubic equation μ³ + p μ = q of the cumulative distribution.
    #[inline]
    pub fn sample(self, u: f32) -> Angle {
        // Compute p/3 for p = 3 + 4 (1 - Δ)/Δ, and q/2 for q = 8 (u - 1/2)/Δ.
        let p = 1.0 + 4.0 / 3.0 * (1.0 - self.dipole) / self.dipole;
        let q = (4.0 * u - 2.0) / self.dipole;
        let root = (q.abs() + (q * q + p * p * p).sqrt()).cbrt();
        Angle::of_cos((root - p / root).copysign(q).clamp(-1.0, 1.0))
    }
}

//! The Henyey–Greenstein phase function, with selectable polarization.
//!
//! S11 = (1 - g²)/(4π (1 + g² - 2 g μ)^{3/2}) (Henyey & Greenstein 1941), where g is the mean cosine. The
//! formula does not define polarization. By default, scattering depolarizes completely. If polarization is
//! selected, the matrix is that of a dipole with reduced polarization. Scattering preserves only a fraction l
//! of linear polarization and a fraction c of circular polarization. Voss & Fry (1984, Appl. Opt. 23, 4427)
//! measured the dipole (Rayleigh) matrix in ocean water. With f = 2μ/(1 + μ²) and b = (1 - μ²)/(1 + μ²),
//!
//! S12/S11 = S21/S11 = l b, S22/S11 = l, S33/S11 = l f, S44/S11 = c f.
//!
//! The scattering matrix is realizable (Cloude) if and only if two conditions hold for all angles (Hovenier &
//! van der Mee 1996): |l - c| |f| ≤ 1 - l, and (l + c)² f² ≤ (1 + l)² - 4 l² b². For l and c in [0, 1], the
//! two conditions reduce to l ≤ (1 + c)/2.

use super::scattered::{Angle, Elements};
use optics::spectrum::Spectral;
use std::f32::consts::PI;

/// Maximum |g|. Beyond this value, f32 does not resolve the forward or backward peak of the phase function.
pub const LARGEST_G: f64 = 0.999;

#[derive(Clone, Copy, Debug)]
pub struct HenyeyGreenstein {
    /// Mean cosine of the scattering angle per wavelength.
    g: Spectral,
    /// Preserved fraction l of linear polarization.
    linear: f32,
    /// Preserved fraction c of circular polarization.
    circular: f32,
}

impl HenyeyGreenstein {
    /// Creates a phase function from mean cosines and the preserved fractions of linear and circular
    /// polarization. Mean cosines are clamped to ±[`LARGEST_G`], and fractions are clamped to [0, 1].
    /// `linear` is limited to at most (1 + circular)/2.
    pub fn new(g: Spectral, linear: f32, circular: f32) -> Self {
        let circular = circular.clamp(0.0, 1.0);
        let largest = Spectral::splat(LARGEST_G as f32);
        Self { g: g.max(-largest).min(largest), linear: linear.clamp(0.0, 0.5 * (1.0 + circular)), circular }
    }

    /// Returns true if scattering preserves no polarization.
    #[inline]
    pub fn depolarizes(self) -> bool {
        self.linear == 0.0 && self.circular == 0.0
    }

    /// Returns the element S11 at a scattering angle, per steradian.
    #[inline]
    pub fn intensity(self, at: Angle) -> Spectral {
        let (one, two) = (Spectral::ONE, Spectral::splat(2.0));
        let size = self.g.abs();
        // Compute 1 + g² - 2gμ from either 1 - μ or 1 + μ. Select the term that is small at the peak.
        let toward_back = self.g.simd_lt(Spectral::ZERO);
        let off_peak = toward_back.bitselect(Spectral::splat(at.backward), Spectral::splat(at.forward));
        let base = (one - size) * (one - size) + two * size * off_peak;
        (one - size) * (one + size) / (Spectral::splat(4.0 * PI) * base * base.sqrt())
    }

    /// Returns the scattering matrix at a scattering angle, per steradian.
    #[inline]
    pub fn elements(self, at: Angle) -> Elements<Spectral> {
        let mu = at.cos();
        let scale = 1.0 / (1.0 + mu * mu);
        let s11 = self.intensity(at);
        let times = |f: f32| s11 * Spectral::splat(f);
        Elements {
            s11,
            s12: times(self.linear * at.sin2() * scale),
            s22: times(self.linear),
            s33: times(self.linear * 2.0 * mu * scale),
            s34: Spectral::ZERO,
            s44: times(self.circular * 2.0 * mu * scale),
        }
    }

    /// Samples a scattering angle with density proportional to [`Self::intensity`] of one lane, from a
    /// uniform random number in [0, 1). The cumulative distribution is inverted for 1 - μ. Inversion for 1 -
    /// μ avoids division by g and cancellation at the peak.
    #[inline]
    pub fn sample(self, lane: usize, u: f32) -> Angle {
        let g = self.g.to_array()[lane];
        let size = g.abs();
        let bottom = 1.0 - size + 2.0 * size * u;
        let root = (1.0 - size) * (1.0 + size) / bottom;
        let off_peak = ((1.0 - size) * (1.0 - u) / bottom * (root + 1.0 - size)).clamp(0.0, 2.0);
        let at = Angle::of_forward(off_peak);
        if g < 0.0 { at.supplement() } else { at }
    }
}

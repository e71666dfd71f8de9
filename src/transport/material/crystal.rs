//! A closed surface filled with a uniaxial crystal, in the joined-ray model. [`super::rough_crystal`]
//! implements the same model with rough faces.
//!
//! The faces refract and reflect like glass with index (n_o + n_e)/2. Along each straight path segment of
//! length L inside the crystal, the ordinary and the extraordinary wave accumulate the phase difference
//!
//! > δ = 2π L (n_e(ψ) - n_o)/λ,   1/n_e(ψ)² = cos²ψ/n_o² + sin²ψ/n_e²
//!
//! where ψ is the angle between the ray and the optic axis c (Born & Wolf 1999, 15.3.3). For a wave along k,
//! the ordinary electric vector is along k × c, and the extraordinary electric vector is in the plane of k
//! and c. The segment is therefore a retarder. k × c is the fast axis if δ > 0 (quartz) and the slow axis if
//! δ < 0 (calcite). One matrix with signed δ covers quartz and calcite.
//!
//! A Gaussian spectral line of full width Δλ at half maximum averages e^{iδ(λ)} over the line. If δ(λ) is
//! linear across the line with dδ/dλ = -δ/λ, the mean is e^{iδ}·e^{-(δ σ/λ)²/2} with σ = Δλ/√(8 ln 2). The
//! cos δ and sin δ terms are therefore multiplied by
//!
//! > γ = exp(-(δ Δλ/λ)²/(16 ln 2)).
//!
//! A plate much thicker than the coherence length λ²/(Δλ |n_e - n_o|) therefore depolarizes all light that is
//! not polarized along an axis of the plate.
//!
//! The model neglects:
//!
//! - the separation of the two rays (walk-off, double images), whereas `double_refraction` makes the opposite
//!   approximation,
//! - the difference between the Fresnel factors of the two waves (both use the mean index),
//! - the wavelength dependence of n_e - n_o within the line,
//! - coherence between successive segments (each segment is averaged over the line separately),
//! - optical activity (quartz along its axis) and absorption.
//!
//! The time of flight is computed with the mean index.
//!
//! The phase is computed in f64, but points are f32. At 1 m from the origin, points are rounded to 60 nm. The
//! rounding error corresponds to a retardance of 0.4° in quartz and 7° in calcite. If the retardance of a
//! thick plate must be accurate, place the crystal within a few centimetres of the origin.

use super::dielectric::Dielectric;
use super::filling::{Filling, NO_CRYSTAL};
use super::lanes::Lanes;
use super::lobe::{Lobe, Sampled, Specular};
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::fresnel::FresnelBlock;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::spectrum::{MAX_WAVELENGTHS, Spectral};
use std::f64::consts::{LN_2, TAU};

/// A uniaxial crystal and its faces.
#[derive(Clone, Copy, Debug)]
pub struct Crystal {
    /// Faces of the crystal: a dielectric with the mean index inside, and the index outside.
    pub faces: Dielectric,
    /// Optic axis, a unit vector in world space.
    pub axis: Vec3A,
    /// Ordinary index per wavelength (1 in unused lanes).
    pub n_o: [f64; MAX_WAVELENGTHS],
    /// Extraordinary index per wavelength (1 in unused lanes).
    pub n_e: [f64; MAX_WAVELENGTHS],
    /// Number of waves per metre in vacuum, 1/λ (0 in unused lanes).
    pub waves_per_m: [f64; MAX_WAVELENGTHS],
    /// Relative full width of the spectral line at half maximum, Δλ/λ.
    pub bandwidth: [f64; MAX_WAVELENGTHS],
    /// True if ordinary and extraordinary rays are separate and incoherent. False if both waves share one
    /// ray, with a retardance between the waves.
    pub split: bool,
}

/// Returns γ cos δ and γ sin δ, for cos²ψ = `cos2` and L/λ = `waves`.
#[inline]
fn retardance(n_o: f64, n_e: f64, cos2: f64, waves: f64, bandwidth: f64) -> (f64, f64) {
    let n_psi = (cos2 / (n_o * n_o) + (1.0 - cos2) / (n_e * n_e)).sqrt().recip();
    let turns = waves * (n_psi - n_o);
    let x = TAU * turns * bandwidth;
    let coherence = (-x * x / (16.0 * LN_2)).exp();
    let (sin, cos) = (TAU * (turns - turns.round())).sin_cos();
    (cos * coherence, sin * coherence)
}

impl Crystal {
    /// Returns the retarder matrix of a straight path segment with a length of `length` metres, for light
    /// that travels along ±`dir`.
    #[inline]
    pub fn propagate(&self, dir: Vec3A, length: f64) -> Scatter {
        let (k, c) = (dir.as_dvec3().normalize(), self.axis.as_dvec3().normalize());
        let ordinary = k.cross(c).normalize_or(k.any_orthonormal_vector());
        let cos2 = k.dot(c).powi(2).min(1.0);
        let (mut cos, mut sin) = ([0.0; MAX_WAVELENGTHS], [0.0; MAX_WAVELENGTHS]);
        for lane in 0..MAX_WAVELENGTHS {
            let (c, s) = retardance(
                self.n_o[lane],
                self.n_e[lane],
                cos2,
                length * self.waves_per_m[lane],
                self.bandwidth[lane],
            );
            (cos[lane], sin[lane]) = (c as f32, s as f32);
        }
        Scatter::Fresnel {
            block: FresnelBlock {
                a: Spectral::ONE,
                b: Spectral::ZERO,
                c: Spectral::new(cos),
                d: Spectral::new(sin),
            },
            s: ordinary.as_vec3a(),
        }
    }

    /// Returns `filling`, the medium beyond the face, with [`Filling::crystal`] set. If `wo` is outside a
    /// crystal that does not split light, the medium is this crystal (index `id`).
    #[inline]
    pub(super) fn filling(&self, id: u32, at: &Surface, wo: Vec3A, filling: Filling) -> Filling {
        let inward = at.ng.dot(wo) > 0.0;
        Filling { crystal: if inward && !self.split { id } else { NO_CRYSTAL }, ..filling }
    }

    /// Samples a direction (see [`super::Materials::sample`]). `id` is the index of this material.
    #[inline]
    pub fn sample(
        &self,
        id: u32,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        if self.split {
            return self.sample_split(at, wo, lanes, stream);
        }
        let mut s = self.faces.sample(at, wo, lanes, stream)?;
        s.filling = s.filling.map(|m| self.filling(id, at, wo, m));
        Some(s)
    }

    /// Returns a delta lobe (see [`super::Materials::specular`]). `id` is the index of this material.
    ///
    /// In a crystal that splits light, transmission and internal reflection have several lobes. For such a
    /// crystal, this function therefore returns only the reflection on the outside.
    #[inline]
    pub fn specular(&self, id: u32, at: &Surface, wo: Vec3A, lobe: Lobe, lane: usize) -> Option<Specular> {
        if self.split && (lobe == Lobe::Transmitted || at.ng.dot(wo) < 0.0) {
            return None;
        }
        let mut s = self.faces.interface(at, wo)?.specular(at, lobe, lane)?;
        s.filling = s.filling.map(|m| self.filling(id, at, wo, m));
        Some(s)
    }

    /// Returns the medium beyond the face (see [`super::Materials::beyond`]). `id` is this material's index.
    #[inline]
    pub fn beyond(&self, id: u32, at: &Surface, wo: Vec3A, lanes: Lanes) -> Filling {
        self.filling(id, at, wo, self.faces.beyond(at, wo, lanes))
    }
}

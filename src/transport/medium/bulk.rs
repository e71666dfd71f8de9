//! Bulk optical properties of a cloud of particles, computed from the scattering by single particles.
//!
//! Let N be the number of particles per m³ and let C be the mean cross section of the particles. The
//! coefficients are μ_s = Σ N C_sca and μ_a = μ_host + Σ N C_abs, summed over the kinds of particle. The
//! scattering matrix of a mixture is Σ N dσ/dΩ / μ_s, where dσ/dΩ = S/k² for each kind. Scattering is assumed
//! to be independent, so that only the incident wave illuminates each particle. Independent scattering is
//! valid up to volume fractions of a few per cent. For a volume fraction f, the number density is N = f/⟨V⟩.
//! A mass concentration c gives f = c/ρ.

use super::henyey_greenstein::HenyeyGreenstein;
use super::mie::{self, C, MieError, Sphere};
use super::products::Products;
use super::rayleigh::Rayleigh;
use super::size_distribution::{SizeDistribution, SizeError};
use std::f64::consts::PI;

/// Reasons why the optics of a medium cannot be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BulkError {
    #[error(transparent)]
    Mie(#[from] MieError),
    #[error(transparent)]
    Size(#[from] SizeError),
    /// The amount is negative or NaN, or the particles fill more than the whole volume.
    #[error("the volume fraction of the particles must be in 0..1, got {0}")]
    Amount(f64),
    #[error("the density must be in 0.001..1e6 kg/m³, got {0} kg/m³")]
    Density(f64),
    #[error(transparent)]
    Constants(#[from] crate::material::constants::ConstantsError),
}

/// An error in the parameters of one kind of particle.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{error}")]
pub struct KindError {
    /// Index of the kind of particle in the list of kinds.
    pub kind: usize,
    pub error: BulkError,
}

impl From<KindError> for BulkError {
    fn from(of: KindError) -> Self {
        of.error
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Amount {
    /// Fraction of the volume that the particles fill, in [0, 1].
    VolumeFraction(f64),
    /// Number of particles per m³.
    NumberDensity(f64),
    /// Mass concentration, with the density of the particle material.
    Mass {
        /// Mass of particles per volume of the medium, kg/m³.
        concentration: f64,
        /// Density of the particle material, kg/m³.
        density: f64,
    },
}

impl Amount {
    /// Returns the number of particles per m³.
    ///
    /// # Errors
    /// Returns [`BulkError::Density`], or [`BulkError::Amount`] if the amount is negative, NaN or too large.
    pub fn number_density(self, sizes: &SizeDistribution) -> Result<f64, BulkError> {
        let volume = sizes.mean_volume();
        let n = match self {
            Self::VolumeFraction(f) => f / volume,
            Self::NumberDensity(n) => n,
            Self::Mass { concentration, density } if (1e-3..=1e6).contains(&density) => {
                concentration / density / volume
            }
            Self::Mass { density, .. } => return Err(BulkError::Density(density)),
        };
        let filled = n * volume;
        if n.is_finite() && (0.0..=1.0).contains(&filled) { Ok(n) } else { Err(BulkError::Amount(filled)) }
    }
}

/// One kind of particle.
#[derive(Clone, Debug, PartialEq)]
pub struct Kind {
    pub sizes: SizeDistribution,
    /// Refractive index n + i·k relative to vacuum, per wavelength.
    pub index: Vec<[f64; 2]>,
    pub amount: Amount,
}

/// Optical properties of a medium at one wavelength.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bulk {
    /// Real refractive index of the host.
    pub index: f64,
    /// Scattering coefficient μ_s, 1/m.
    pub scattering: f64,
    /// Absorption coefficient μ_a, 1/m.
    pub absorption: f64,
    /// Mean cosine of the scattering angle.
    pub asymmetry: f64,
    /// Mean scattering cross section of a particle, m², or 0 without particles.
    pub c_sca: f64,
    /// Mean absorption cross section of a particle, m², or 0 without particles.
    pub c_abs: f64,
}

/// Particles at one wavelength. Each sphere is stored with its number per m³, divided by k².
#[derive(Clone, Debug)]
pub struct Ensemble {
    spheres: Vec<(f64, Sphere)>,
    /// Real refractive index of the host medium.
    host: f64,
    /// Wave number k in the host medium, 1/m.
    wave_number: f64,
    /// Number of particles per m³.
    number: f64,
    /// Sums over all kinds of particle: Σ N C_sca (1/m), Σ N C_abs (1/m), and Σ N C_sca g (1/m).
    scattering: f64,
    absorption: f64,
    cosine: f64,
    /// Number of terms of the longest Mie series.
    terms: usize,
    /// Precomputed products of the series, which replace a long list of spheres.
    products: Option<Products>,
}

impl Ensemble {
    /// Creates an empty ensemble in a host with real refractive index `host`, at the vacuum wavelength `nm`
    /// (nanometres).
    pub fn new(host: f64, nm: f64) -> Self {
        Self {
            spheres: vec![],
            host,
            wave_number: 2.0 * PI * host / (nm * 1e-9),
            number: 0.0,
            scattering: 0.0,
            absorption: 0.0,
            cosine: 0.0,
            terms: 0,
            products: None,
        }
    }

    /// Adds particles with index `n + i·k` relative to vacuum.
    ///
    /// # Errors
    /// Returns a [`BulkError`] if a parameter is out of range.
    pub fn add(
        &mut self,
        sizes: &SizeDistribution,
        [n, k]: [f64; 2],
        amount: Amount,
    ) -> Result<(), BulkError> {
        sizes.check()?;
        let number = amount.number_density(sizes)?;
        let relative = C::new(n, k) / self.host;
        self.number += number;
        for [radius, share] in sizes.quadrature(self.wave_number) {
            let sphere = Sphere::new(self.wave_number * radius, relative)?;
            let area = PI * radius * radius * share * number;
            self.scattering += area * sphere.q_sca;
            self.absorption += area * sphere.q_abs;
            self.cosine += area * sphere.q_sca * sphere.g;
            self.terms = self.terms.max(sphere.terms());
            self.spheres.push((share * number / self.wave_number.powi(2), sphere));
        }
        Ok(())
    }

    /// Prepares the fast evaluation of [`Self::matrix`] for many spheres. Call this method after the last
    /// [`Self::add`].
    pub fn finish(&mut self) {
        // Compute the cost of the quadratic forms, in units of the cost of a sphere.
        let long = 2 * self.terms * self.terms;
        let many = self.spheres.iter().map(|(_, s)| s.terms()).sum::<usize>() > long;
        self.products = many.then(|| Products::new(&self.spheres));
    }

    /// Returns the bulk properties for a host with absorption coefficient `host_absorption`, 1/m.
    pub fn bulk(&self, host_absorption: f64) -> Bulk {
        let over = |sum: f64, by: f64| if by > 0.0 { sum / by } else { 0.0 };
        Bulk {
            index: self.host,
            scattering: self.scattering,
            absorption: self.absorption + host_absorption,
            asymmetry: over(self.cosine, self.scattering),
            c_sca: over(self.scattering, self.number),
            c_abs: over(self.absorption, self.number),
        }
    }

    /// Returns true if the ensemble does not scatter light.
    pub(crate) fn is_clear(&self) -> bool {
        self.scattering <= 0.0
    }

    /// Returns S11, S12, S33, S34 per steradian for a cosine of the scattering angle, normalized to ∫ S11 dω
    /// = 1. `scratch` is a buffer for the angular functions.
    pub fn matrix(&self, cos: f64, scratch: &mut Vec<[f64; 2]>) -> [f64; 4] {
        mie::angular(cos, self.terms, scratch);
        if let Some(products) = &self.products {
            return products.matrix(scratch).map(|s| s / self.scattering);
        }
        let mut sum = [0.0; 4];
        for (weight, sphere) in &self.spheres {
            let matrix = mie::matrix(sphere.amplitudes_with(scratch));
            for (s, e) in sum.iter_mut().zip(matrix) {
                *s += weight * e;
            }
        }
        sum.map(|s| s / self.scattering)
    }
}

/// Phase function of a medium, before tabulation.
#[derive(Clone, Debug)]
pub enum PhaseOptics {
    /// Isotropic scattering that depolarizes completely.
    Isotropic,
    Rayleigh(Rayleigh),
    HenyeyGreenstein(HenyeyGreenstein),
    /// Scattering by particles, with one ensemble per wavelength.
    Particles(Vec<Ensemble>),
}

/// Optical properties of a medium in double precision.
#[derive(Clone, Debug)]
pub struct Optics {
    /// Bulk properties, one entry per wavelength.
    pub bulk: Vec<Bulk>,
    pub phase: PhaseOptics,
}

impl Optics {
    /// Computes the optics of particles in a host with real refractive index `host` and absorption
    /// coefficient `host_absorption` (1/m). All lists have one entry per vacuum wavelength in `nm`.
    ///
    /// # Errors
    /// Returns a [`KindError`] for the first kind of particle with a parameter that is out of range.
    pub fn particles(
        nm: &[f64],
        host: &[f64],
        host_absorption: &[f64],
        kinds: &[Kind],
    ) -> Result<Self, KindError> {
        let hosts = nm.iter().zip(host);
        let mut ensembles: Vec<Ensemble> = hosts.map(|(nm, host)| Ensemble::new(*host, *nm)).collect();
        for (number, kind) in kinds.iter().enumerate() {
            for (ensemble, index) in ensembles.iter_mut().zip(&kind.index) {
                ensemble
                    .add(&kind.sizes, *index, kind.amount)
                    .map_err(|error| KindError { kind: number, error })?;
            }
        }
        ensembles.iter_mut().for_each(Ensemble::finish);
        let with_host = ensembles.iter().zip(host_absorption);
        Ok(Self {
            bulk: with_host.map(|(e, absorption)| e.bulk(*absorption)).collect(),
            phase: PhaseOptics::Particles(ensembles),
        })
    }
}

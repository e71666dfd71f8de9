//! The syntax of participating media, in scene files and in media files.

use super::defaults::{self, is_default};
use super::transform::TransformFile;
use super::values::{IndexFile, SpectrumFile};
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A media file, which `sunstone phase eval` reads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Sunstone media")]
pub struct MediumSetFile {
    /// One to four vacuum wavelengths in nanometres, increasing. Default: 450, 550, 660.
    #[serde(default = "defaults::wavelengths", skip_serializing_if = "defaults::is_wavelengths")]
    pub wavelengths_nm: Located<Vec<f64>>,
    /// Media by name.
    pub media: BTreeMap<String, Located<MediumFile>>,
}

/// A participating medium.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum MediumFile {
    /// Constant coefficients and a phase function.
    Homogeneous(Box<HomogeneousFile>),
    /// Coefficients scaled by a density grid, and a phase function.
    Heterogeneous(Box<HeterogeneousFile>),
    /// Spheres in a host medium, computed by Lorenz–Mie theory.
    Particles(ParticlesFile),
    /// Milk, or milk diluted with water.
    Milk(MilkFile),
    /// Polystyrene spheres in water.
    Polystyrene(PolystyreneFile),
    /// Marble as measured by Jensen et al. (2001).
    Marble(MarbleFile),
    /// Skin as measured by Jensen et al. (2001).
    Skin(SkinFile),
}

/// A medium with constant coefficients.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HomogeneousFile {
    /// Absorption coefficient in 1/m. Default: 0.
    #[serde(default = "defaults::zero_spectrum", skip_serializing_if = "defaults::is_zero_spectrum")]
    pub absorption: Located<SpectrumFile>,
    /// Scattering coefficient in 1/m. Default: 0.
    #[serde(default = "defaults::zero_spectrum", skip_serializing_if = "defaults::is_zero_spectrum")]
    pub scattering: Located<SpectrumFile>,
    /// Refractive index: a number, one number per wavelength, or a name of the optical constants. Default: 1.
    #[serde(default = "defaults::unit_index", skip_serializing_if = "defaults::is_unit_index")]
    pub index: Located<IndexFile>,
    /// Phase function. Default: `isotropic`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub phase: PhaseFile,
}

/// A medium whose coefficients are scaled by a density grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeterogeneousFile {
    /// Absorption coefficient in 1/m for a density of 1. Default: 0.
    #[serde(default = "defaults::zero_spectrum", skip_serializing_if = "defaults::is_zero_spectrum")]
    pub absorption: Located<SpectrumFile>,
    /// Scattering coefficient in 1/m for a density of 1. Default: 0.
    #[serde(default = "defaults::zero_spectrum", skip_serializing_if = "defaults::is_zero_spectrum")]
    pub scattering: Located<SpectrumFile>,
    /// Refractive index: a number, one number per wavelength, or a name of the optical constants. Default: 1.
    #[serde(default = "defaults::unit_index", skip_serializing_if = "defaults::is_unit_index")]
    pub index: Located<IndexFile>,
    /// Phase function. Default: `isotropic`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub phase: PhaseFile,
    /// Density, which multiplies both coefficients. There is no medium outside the grid's box.
    pub density: Located<GridFile>,
    /// Fraction of `scattering`, 0..1, that is scattered; the remaining fraction is absorbed. Outside the
    /// grid's box, the values at the box's faces apply. Default: 1.
    pub albedo: Option<Located<GridFile>>,
}

/// Numbers on a grid: one per point, or three per point for wavelengths above 590 nm, from 500 to 590 nm, and
/// below 500 nm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GridFile {
    /// Grid file in Mitsuba's format (`.vol`), relative to the scene file.
    pub file: Located<String>,
    /// Lowest and highest corner of the grid's box in metres. The outermost grid points are half a grid
    /// step inside the box. Default: the box in the file.
    #[serde(rename = "box")]
    pub corners: Option<[[f64; 3]; 2]>,
    /// Scale, rotation and translation of the grid's box.
    pub transform: Option<Located<TransformFile>>,
    /// Interpolation between grid points. Default: `trilinear`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub filter: GridFilter,
}

/// Interpolation between grid points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GridFilter {
    /// Trilinear interpolation of the eight nearest points.
    #[default]
    Trilinear,
    /// Value of the nearest point.
    Nearest,
}

/// A phase function.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PhaseFile {
    /// Equal scattering in all directions, with complete depolarization.
    #[default]
    Isotropic,
    /// Rayleigh scattering by particles much smaller than the wavelength.
    Rayleigh(RayleighFile),
    /// The Henyey–Greenstein phase function, which depolarizes completely by default.
    HenyeyGreenstein(HenyeyGreensteinFile),
    /// Lorenz–Mie scattering by spheres in a host with the medium's refractive index. Only the
    /// ratios of the amounts of spheres matter.
    Mie(MieFile),
}

/// Rayleigh scattering by particles much smaller than the wavelength.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RayleighFile {
    /// Depolarization factor, 0..0.5: ratio of parallel to perpendicular intensity at a scattering
    /// angle of 90° for unpolarized light. Air has 0.028. Default: 0.
    #[serde(default, skip_serializing_if = "is_default")]
    #[schemars(range(min = 0.0, max = 0.5))]
    pub depolarization: Located<f64>,
}

/// The Henyey–Greenstein phase function.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HenyeyGreensteinFile {
    /// Mean cosine of the scattering angle, -0.999..0.999.
    pub g: Located<SpectrumFile>,
    /// Degree of linear polarization relative to that of a dipole, 0..(1 + circular)/2. Default: 0.
    #[serde(default, skip_serializing_if = "is_default")]
    pub linear: Located<f64>,
    /// Degree of circular polarization relative to that of a dipole, 0..1. Default: 0.
    #[serde(default, skip_serializing_if = "is_default")]
    #[schemars(range(min = 0, max = 1))]
    pub circular: Located<f64>,
}

/// Lorenz–Mie scattering by spheres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MieFile {
    /// Kinds of spheres that scatter.
    pub kinds: Located<Vec<Located<KindFile>>>,
}

/// Spheres in a host medium, computed by Lorenz–Mie theory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParticlesFile {
    /// Refractive index of the host: a number, one number per wavelength, or a name of the optical constants.
    /// Default: 1.
    #[serde(default = "defaults::unit_index", skip_serializing_if = "defaults::is_unit_index")]
    pub host: Located<IndexFile>,
    /// Absorption coefficient of the host, 1/m. Default: that of water for `host = "water"`, otherwise 0.
    pub host_absorption: Option<Located<SpectrumFile>>,
    /// Kinds of particles in the host.
    pub kinds: Located<Vec<Located<KindFile>>>,
}

/// Spheres of one substance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct KindFile {
    /// Refractive index: a number, one number per wavelength, or a name of the optical constants. A name also
    /// sets the extinction coefficient k.
    pub index: Located<IndexFile>,
    /// Extinction coefficient k ≥ 0. Default: 0.
    pub k: Option<Located<SpectrumFile>>,
    /// Distribution of radii.
    pub sizes: Located<SizesFile>,
    /// Amount of particles of this kind.
    pub amount: Located<AmountFile>,
}

/// Number distribution of particle radii.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SizesFile {
    /// The same radius for all particles.
    Single(SingleFile),
    /// Log-normal distribution.
    LogNormal(LogNormalFile),
    /// Gamma distribution (Hansen 1971).
    Gamma(GammaFile),
    /// A list of radii with weights.
    List(SizeListFile),
}

/// Particles of one radius.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SingleFile {
    /// Radius in nanometres.
    pub radius_nm: f64,
}

/// Log-normal distribution of radii.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LogNormalFile {
    /// Median radius in nanometres.
    pub median_nm: f64,
    /// Standard deviation of the natural logarithm of the radius, 0.001..2.
    pub sigma: f64,
}

/// Gamma distribution of radii (Hansen 1971).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GammaFile {
    /// Area-weighted mean radius in nanometres.
    pub effective_radius_nm: f64,
    /// Area-weighted relative variance of the radius, 0.001..0.45.
    pub effective_variance: f64,
}

/// A list of radii with weights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SizeListFile {
    /// Radii in nanometres.
    pub radius_nm: Vec<f64>,
    /// Relative number of particles of each radius.
    pub weight: Vec<f64>,
}

/// Amount of particles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum AmountFile {
    /// Fraction of the volume that the particles occupy, 0..1.
    VolumeFraction(f64),
    /// Number of particles per cubic metre.
    PerM3(f64),
    /// Mass of particles per volume.
    Mass(MassFile),
}

/// Amount of particles by mass.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MassFile {
    /// Grams of particles per litre of medium.
    pub grams_per_litre: f64,
    /// Density of the particles in kg/m³.
    pub density: f64,
}

/// Milk, or milk diluted with water. Whole milk has 3.5 % fat by weight, reduced-fat milk 1.5 %, skimmed milk
/// 0.1 %.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MilkFile {
    /// Fat in percent by weight, 0..20. Default: 3.5.
    #[serde(skip_serializing_if = "defaults::is_fat_percent")]
    #[schemars(range(min = 0, max = 20))]
    pub fat_percent: Located<f64>,
    /// Protein in percent by weight, 0..20. Default: 3.4.
    #[serde(skip_serializing_if = "defaults::is_protein_percent")]
    #[schemars(range(min = 0, max = 20))]
    pub protein_percent: Located<f64>,
    /// Homogenization pressure in MPa, 0..100; 0 for milk that is not homogenized. Default: 20.
    #[serde(skip_serializing_if = "defaults::is_homogenization_mpa")]
    #[schemars(range(min = 0, max = 100))]
    pub homogenization_mpa: Located<f64>,
    /// Volume fraction of milk in a mixture of milk and water, 0..1. Default: 1.
    #[serde(skip_serializing_if = "defaults::is_unit")]
    #[schemars(range(min = 0, max = 1))]
    pub concentration: Located<f64>,
}

impl Default for MilkFile {
    fn default() -> Self {
        Self {
            fat_percent: defaults::fat_percent(),
            protein_percent: defaults::protein_percent(),
            homogenization_mpa: defaults::homogenization_mpa(),
            concentration: defaults::unit(),
        }
    }
}

/// Polystyrene spheres in water.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PolystyreneFile {
    /// Mean diameter in nanometres.
    #[schemars(range(min = 1, max = 100_000))]
    pub diameter_nm: Located<f64>,
    /// Standard deviation of the diameter divided by the mean diameter, 0..1. Default: 0.
    #[serde(default, skip_serializing_if = "is_default")]
    #[schemars(range(min = 0, max = 1))]
    pub spread: Located<f64>,
    /// Amount of particles.
    pub amount: Located<AmountFile>,
}

/// Marble as measured by Jensen et al. (2001).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MarbleFile {
    /// Mean cosine of the scattering angle, -0.999..0.999. The measured reduced scattering coefficient does
    /// not determine this value. Default: 0.
    #[serde(skip_serializing_if = "is_default")]
    pub g: Located<f64>,
}

/// Skin as measured by Jensen et al. (2001).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SkinFile {
    /// Mean cosine of the scattering angle, -0.999..0.999. Default: 0.8 (van Gemert et al. 1989).
    #[serde(skip_serializing_if = "defaults::is_skin_g")]
    pub g: Located<f64>,
}

impl Default for SkinFile {
    fn default() -> Self {
        Self { g: defaults::skin_g() }
    }
}

impl MediumFile {
    /// Creates an index-matched medium with absorption and scattering coefficients in 1/m.
    pub fn homogeneous(
        absorption: impl Into<SpectrumFile>,
        scattering: impl Into<SpectrumFile>,
        phase: PhaseFile,
    ) -> Self {
        Self::Homogeneous(Box::new(HomogeneousFile {
            absorption: absorption.into().into(),
            scattering: scattering.into().into(),
            index: defaults::unit_index(),
            phase,
        }))
    }
}

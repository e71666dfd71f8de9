//! The syntax of participating media, in scene files and in files of their own.

use super::defaults::{self, is_default};
use super::transform::TransformFile;
use super::values::{IndexFile, SpectrumFile};
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A file of media alone: what `sunstone phase eval` reads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Sunstone media")]
pub struct MediumSetFile {
    /// Vacuum wavelengths in nanometres, 1 to 4, rising.
    #[serde(
        default = "defaults::wavelengths",
        skip_serializing_if = "defaults::is_wavelengths"
    )]
    pub wavelengths_nm: Located<Vec<f64>>,
    /// Media by name.
    pub media: BTreeMap<String, Located<MediumFile>>,
}

/// A participating medium.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum MediumFile {
    /// Coefficients and a phase function as given.
    Homogeneous(Box<HomogeneousFile>),
    /// The same, with a density that a grid gives from place to place.
    Heterogeneous(Box<HeterogeneousFile>),
    /// Spheres in a host: everything by Lorenz–Mie theory.
    Particles(ParticlesFile),
    /// Milk, or milk in water.
    Milk(MilkFile),
    /// Polystyrene spheres in water.
    Polystyrene(PolystyreneFile),
    /// Marble as measured by Jensen et al. (2001).
    Marble(MarbleFile),
    /// Skin as measured by Jensen et al. (2001).
    Skin(SkinFile),
}

/// See [`MediumFile::Homogeneous`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HomogeneousFile {
    /// Absorption coefficient, 1/m.
    #[serde(
        default = "defaults::zero_spectrum",
        skip_serializing_if = "defaults::is_zero_spectrum"
    )]
    pub absorption: Located<SpectrumFile>,
    /// Scattering coefficient, 1/m.
    #[serde(
        default = "defaults::zero_spectrum",
        skip_serializing_if = "defaults::is_zero_spectrum"
    )]
    pub scattering: Located<SpectrumFile>,
    /// Refractive index: a number, one per wavelength, or a name of the optical constants.
    #[serde(
        default = "defaults::unit_index",
        skip_serializing_if = "defaults::is_unit_index"
    )]
    pub index: Located<IndexFile>,
    /// How it scatters.
    #[serde(default, skip_serializing_if = "is_default")]
    pub phase: PhaseFile,
}

/// See [`MediumFile::Heterogeneous`]. Absorption, scattering, index and phase are as of [`HomogeneousFile`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeterogeneousFile {
    /// 1/m where the density is 1.
    #[serde(
        default = "defaults::zero_spectrum",
        skip_serializing_if = "defaults::is_zero_spectrum"
    )]
    pub absorption: Located<SpectrumFile>,
    /// 1/m where the density is 1.
    #[serde(
        default = "defaults::zero_spectrum",
        skip_serializing_if = "defaults::is_zero_spectrum"
    )]
    pub scattering: Located<SpectrumFile>,
    /// Refractive index.
    #[serde(
        default = "defaults::unit_index",
        skip_serializing_if = "defaults::is_unit_index"
    )]
    pub index: Located<IndexFile>,
    /// How it scatters.
    #[serde(default, skip_serializing_if = "is_default")]
    pub phase: PhaseFile,
    /// Multiplies both coefficients; outside of its box there is no medium.
    pub density: Located<GridFile>,
    /// The share of `scattering`, 0..1, that scatters: the rest absorbs. Outside of its box it is as at its faces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub albedo: Option<Located<GridFile>>,
}

/// Numbers on a grid: one at each point, or three for wavelengths above 590 nm, from 500 to 590 nm, and below.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GridFile {
    /// A grid of Mitsuba (`.vol`), relative to the scene file.
    pub file: Located<String>,
    /// Least and greatest corner of the box that it fills, metres; absent: as the file says. Points lie half a step inside.
    #[serde(rename = "box", default, skip_serializing_if = "Option::is_none")]
    pub corners: Option<[[f64; 3]; 2]>,
    /// Moves, turns and scales the box.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transform: Option<Located<TransformFile>>,
    /// What lies between points.
    #[serde(default, skip_serializing_if = "is_default")]
    pub filter: GridFilter,
}

/// See [`GridFile::filter`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GridFilter {
    /// Mixed from the eight nearest.
    #[default]
    Trilinear,
    /// The nearest point alone.
    Nearest,
}

/// A phase function.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PhaseFile {
    /// Equally in all directions, depolarizing.
    #[default]
    Isotropic,
    /// As particles much smaller than the wavelength.
    Rayleigh(RayleighFile),
    /// Henyey & Greenstein's, depolarizing unless it says otherwise.
    HenyeyGreenstein(HenyeyGreensteinFile),
    /// As spheres (Lorenz–Mie) in a host of the medium's index; their amounts count relative to each other.
    Mie(MieFile),
}

/// See [`PhaseFile::Rayleigh`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RayleighFile {
    /// Depolarization factor, 0..0.5: parallel over perpendicular light at 90° from unpolarized light; air: 0.028.
    #[serde(default, skip_serializing_if = "is_default")]
    #[schemars(range(min = 0.0, max = 0.5))]
    pub depolarization: Located<f64>,
}

/// See [`PhaseFile::HenyeyGreenstein`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HenyeyGreensteinFile {
    /// Mean cosine of the scattering angle, -0.999..0.999.
    pub g: Located<SpectrumFile>,
    /// Share of a dipole's linear polarization, 0..(1 + circular)/2.
    #[serde(default, skip_serializing_if = "is_default")]
    pub linear: Located<f64>,
    /// Share of a dipole's circular polarization, 0..1.
    #[serde(default, skip_serializing_if = "is_default")]
    #[schemars(range(min = 0, max = 1))]
    pub circular: Located<f64>,
}

/// See [`PhaseFile::Mie`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MieFile {
    /// Kinds of particle.
    pub kinds: Located<Vec<Located<KindFile>>>,
}

/// See [`MediumFile::Particles`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParticlesFile {
    /// Refractive index of the host: a number, one per wavelength, or a name of the optical constants.
    #[serde(
        default = "defaults::unit_index",
        skip_serializing_if = "defaults::is_unit_index"
    )]
    pub host: Located<IndexFile>,
    /// Absorption coefficient of the host, 1/m; absent: water's for `host = "water"`, else 0.
    pub host_absorption: Option<Located<SpectrumFile>>,
    /// Kinds of particle.
    pub kinds: Located<Vec<Located<KindFile>>>,
}

/// Spheres of one substance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct KindFile {
    /// Refractive index: a number, one per wavelength, or a name of the optical constants (which has its own k).
    pub index: Located<IndexFile>,
    /// Extinction coefficient k ≥ 0; 0 if absent.
    pub k: Option<Located<SpectrumFile>>,
    /// Their radii.
    pub sizes: Located<SizesFile>,
    /// How many there are.
    pub amount: Located<AmountFile>,
}

/// Radii of particles, by number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SizesFile {
    /// All alike.
    Single(SingleFile),
    /// Log-normal.
    LogNormal(LogNormalFile),
    /// Hansen's (1971) gamma distribution.
    Gamma(GammaFile),
    /// Radii with weights.
    List(SizeListFile),
}

/// See [`SizesFile::Single`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SingleFile {
    /// Nanometres.
    pub radius_nm: f64,
}

/// See [`SizesFile::LogNormal`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LogNormalFile {
    /// Median radius in nanometres.
    pub median_nm: f64,
    /// Standard deviation of the radius' natural logarithm, 0.001..2.
    pub sigma: f64,
}

/// See [`SizesFile::Gamma`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GammaFile {
    /// Area-weighted mean radius in nanometres.
    pub effective_radius_nm: f64,
    /// Area-weighted relative variance, 0.001..0.45.
    pub effective_variance: f64,
}

/// See [`SizesFile::List`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SizeListFile {
    /// Nanometres.
    pub radius_nm: Vec<f64>,
    /// Relative number of particles of each.
    pub weight: Vec<f64>,
}

/// How many particles there are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum AmountFile {
    /// Share of the volume that they fill, 0..1.
    VolumeFraction(f64),
    /// Particles per cubic metre.
    PerM3(f64),
    /// By mass.
    Mass(MassFile),
}

/// See [`AmountFile::Mass`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MassFile {
    /// Grams of particles in a litre of medium.
    pub grams_per_litre: f64,
    /// Density of the particles, kg/m³.
    pub density: f64,
}

/// See [`MediumFile::Milk`]; whole milk 3.5 % fat, reduced-fat 1.5 %, skimmed 0.1 %.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MilkFile {
    /// Percentage by weight of fat, 0..20.
    #[serde(skip_serializing_if = "defaults::is_fat_percent")]
    #[schemars(range(min = 0, max = 20))]
    pub fat_percent: Located<f64>,
    /// Percentage by weight of protein, 0..20.
    #[serde(skip_serializing_if = "defaults::is_protein_percent")]
    #[schemars(range(min = 0, max = 20))]
    pub protein_percent: Located<f64>,
    /// Pressure at which it was homogenized, MPa, 0..100; 0: not at all.
    #[serde(skip_serializing_if = "defaults::is_homogenization_mpa")]
    #[schemars(range(min = 0, max = 100))]
    pub homogenization_mpa: Located<f64>,
    /// Share of milk in a mixture with water, by volume, 0..1.
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

/// See [`MediumFile::Polystyrene`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PolystyreneFile {
    /// Mean diameter in nanometres.
    #[schemars(range(min = 1, max = 100_000))]
    pub diameter_nm: Located<f64>,
    /// Standard deviation of the diameter over its mean, 0..1.
    #[serde(default, skip_serializing_if = "is_default")]
    #[schemars(range(min = 0, max = 1))]
    pub spread: Located<f64>,
    /// How much of it.
    pub amount: Located<AmountFile>,
}

/// See [`MediumFile::Marble`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MarbleFile {
    /// Mean cosine of the scattering angle, -0.999..0.999, which the reduced scattering leaves open.
    #[serde(skip_serializing_if = "is_default")]
    pub g: Located<f64>,
}

/// See [`MediumFile::Skin`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SkinFile {
    /// Mean cosine of the scattering angle, -0.999..0.999; van Gemert et al. (1989) found about 0.8.
    #[serde(skip_serializing_if = "defaults::is_skin_g")]
    pub g: Located<f64>,
}

impl Default for SkinFile {
    fn default() -> Self {
        Self {
            g: defaults::skin_g(),
        }
    }
}

impl MediumFile {
    /// An index-matched medium of absorption and scattering coefficients in 1/m, which scatters as `phase` says.
    #[must_use]
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

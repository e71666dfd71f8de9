//! The syntax of materials, in scene files and in files of their own.

use super::defaults::{self, is_default};
pub use super::plastic::{InterreflectionFile, PassageFile, PlasticFile, SingleScatterFile};
use super::texture::{AlbedoFile, ImageAlbedo, ScalarFile, UvRows};
use super::values::{IndexFile, SpectrumFile};
use base::locate::Located;
use optics::sampling::microfacet::{Distribution, Masking};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use transport::material::polarizer::Passes;
use transport::material::texture::{Filter, Wrap};

/// A file of materials alone: what `sunstone pbrdf eval` reads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Sunstone materials")]
pub struct MaterialSetFile {
    /// Vacuum wavelengths in nanometres, 1 to 4, rising.
    #[serde(
        default = "defaults::wavelengths",
        skip_serializing_if = "defaults::is_wavelengths"
    )]
    pub wavelengths_nm: Located<Vec<f64>>,
    /// Materials by name.
    pub materials: BTreeMap<String, Located<MaterialFile>>,
}

/// A material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum MaterialFile {
    /// Depolarizing Lambert surface.
    Diffuse(DiffuseFile),
    /// Smooth metal.
    Conductor(ConductorFile),
    /// Metal with microfacets.
    RoughConductor(RoughConductorFile),
    /// Smooth glass, water, …: a closed surface's inside against its outside.
    Dielectric(DielectricFile),
    /// Glass with microfacets.
    RoughDielectric(RoughDielectricFile),
    /// Rough dielectric coat over a depolarizing base.
    Plastic(Box<PlasticFile>),
    /// One material in front, another (or none) behind.
    TwoSided(TwoSidedFile),
    /// Two materials mixed by area.
    Blend(BlendFile),
    /// A material under normals from an image.
    NormalMap(NormalMapFile),
    /// A material under heights from an image.
    BumpMap(BumpMapFile),
    /// A material that loses part of its polarization.
    PartialDepolarizer(PartialDepolarizerFile),
    /// Mirror under thin films.
    CoatedConductor(CoatedConductorFile),
    /// Thin sheet that passes one linear polarization.
    Polarizer(PolarizerFile),
    /// Thin sheet that delays one linear polarization: a wave plate.
    Retarder(RetarderFile),
    /// Thin plate of glass that light goes straight through.
    ThinDielectric(DielectricFile),
    /// Closed surface filled with a uniaxial crystal.
    Crystal(CrystalFile),
    /// A table of measured Mueller matrices.
    Measured(MeasuredFile),
    /// Index-matched boundary of a medium: light does not notice it, and it counts as no interaction.
    Null(NullFile),
}

/// See [`MaterialFile::Null`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NullFile {}

/// See [`MaterialFile::Diffuse`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DiffuseFile {
    /// 0..1: a number, one per wavelength, or an image.
    pub albedo: Located<AlbedoFile>,
}

/// See [`MaterialFile::Conductor`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ConductorFile {
    /// Name of a metal in the optical constants, or `mirror` (reflects all light), instead of n and k.
    pub metal: Option<Located<String>>,
    /// Real part n of the refractive index.
    pub n: Option<Located<SpectrumFile>>,
    /// Extinction coefficient k ≥ 0.
    pub k: Option<Located<SpectrumFile>>,
    /// Factor of all reflected light, 0..1: a number, one per wavelength, or an image.
    #[serde(
        default = "defaults::unit_albedo",
        skip_serializing_if = "defaults::is_unit_albedo"
    )]
    pub reflectance: Located<AlbedoFile>,
}

/// See [`MaterialFile::RoughConductor`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RoughConductorFile {
    /// Name of a metal in the optical constants, or `mirror` (reflects all light), instead of n and k.
    pub metal: Option<Located<String>>,
    /// Real part n of the refractive index.
    pub n: Option<Located<SpectrumFile>>,
    /// Extinction coefficient k ≥ 0.
    pub k: Option<Located<SpectrumFile>>,
    /// Factor of all reflected light, 0..1: a number, one per wavelength, or an image.
    #[serde(
        default = "defaults::unit_albedo",
        skip_serializing_if = "defaults::is_unit_albedo"
    )]
    pub reflectance: Located<AlbedoFile>,
    /// Roughness, 0.001..1: a number or an image.
    pub alpha: Located<ScalarFile>,
    /// Distribution of facet normals.
    #[serde(default, skip_serializing_if = "is_default")]
    pub distribution: Distribution,
    /// Masking and shadowing: `correlated` (Heitz 2014) or `separable` (Walter et al. 2007, as in Mitsuba).
    #[serde(default, skip_serializing_if = "is_default")]
    pub masking: Masking,
}

/// See [`MaterialFile::Dielectric`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DielectricFile {
    /// Refractive index inside: a number, one per wavelength (then it disperses), or a name of the optical constants.
    pub ior: Located<IndexFile>,
    /// Refractive index outside.
    #[serde(
        default = "defaults::unit_index",
        skip_serializing_if = "defaults::is_unit_index"
    )]
    pub exterior_ior: Located<IndexFile>,
}

/// See [`MaterialFile::RoughDielectric`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RoughDielectricFile {
    /// Refractive index inside: a number, one per wavelength (then it disperses), or a name of the optical constants.
    pub ior: Located<IndexFile>,
    /// Refractive index outside.
    #[serde(
        default = "defaults::unit_index",
        skip_serializing_if = "defaults::is_unit_index"
    )]
    pub exterior_ior: Located<IndexFile>,
    /// Roughness, 0.001..1: a number or an image.
    pub alpha: Located<ScalarFile>,
    /// Distribution of facet normals.
    #[serde(default, skip_serializing_if = "is_default")]
    pub distribution: Distribution,
    /// Masking and shadowing: `correlated` (Heitz 2014) or `separable` (Walter et al. 2007, as in Mitsuba).
    #[serde(default, skip_serializing_if = "is_default")]
    pub masking: Masking,
}

/// See [`MaterialFile::TwoSided`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TwoSidedFile {
    /// Name of the material on the side that the surface faces.
    pub front: Located<String>,
    /// Name of the material on the other side; absent: black.
    pub back: Option<Located<String>>,
}

/// See [`MaterialFile::Blend`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BlendFile {
    /// Name of the first material.
    pub a: Located<String>,
    /// Name of the second material.
    pub b: Located<String>,
    /// Share of the second, 0..1: a number or an image.
    pub weight: Located<ScalarFile>,
}

/// See [`MaterialFile::NormalMap`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NormalMapFile {
    /// Name of the material.
    pub material: Located<String>,
    /// PNG or JPEG file of unit vectors (x right, y up, z out of the surface), each coordinate stored as (c + 1)/2.
    pub image: Located<String>,
    /// Multiplies x and y.
    #[serde(default = "defaults::unit", skip_serializing_if = "defaults::is_unit")]
    #[schemars(range(min = 0, max = 10))]
    pub strength: Located<f64>,
    /// Where on the surface the image lies, as of other images; the vectors stay in the surface's own frame.
    pub uv: Option<UvRows>,
    /// Beyond the image's edges.
    #[serde(default, skip_serializing_if = "is_default")]
    pub wrap: Wrap,
    /// Between the image's texels.
    #[serde(default, skip_serializing_if = "is_default")]
    pub filter: Filter,
    /// Layer of an OpenEXR file, as of other images.
    pub layer: Option<String>,
}

/// See [`MaterialFile::BumpMap`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BumpMapFile {
    /// Name of the material.
    pub material: Located<String>,
    /// The image of numbers, bilinear.
    pub image: Located<ImageAlbedo>,
    /// How high the surface is where the image is 1, above where it is 0, metres. The shape stays; its normals turn.
    #[serde(default = "defaults::unit", skip_serializing_if = "defaults::is_unit")]
    pub height: Located<f64>,
}

/// See [`MaterialFile::PartialDepolarizer`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PartialDepolarizerFile {
    /// Name of the material.
    pub material: Located<String>,
    /// Share of its light that loses its polarization, 0..1: a number or an image.
    pub fraction: Located<ScalarFile>,
}

/// See [`MaterialFile::CoatedConductor`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoatedConductorFile {
    /// Name of the substrate in the optical constants, instead of n and k.
    pub metal: Option<Located<String>>,
    /// Real part n of the substrate's refractive index.
    pub n: Option<Located<SpectrumFile>>,
    /// Extinction coefficient k ≥ 0 of the substrate.
    pub k: Option<Located<SpectrumFile>>,
    /// Films from the outside in, at most 4.
    pub films: Located<Vec<Located<FilmFile>>>,
}

/// One film of a [`CoatedConductorFile`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FilmFile {
    /// Refractive index: a number, one per wavelength, or a name of the optical constants.
    pub ior: Located<IndexFile>,
    /// Extinction coefficient k ≥ 0; 0 if absent. The optical constants have their own.
    pub k: Option<Located<SpectrumFile>>,
    /// Thickness in nanometres.
    #[schemars(range(min = 0, max = 100_000))]
    pub thickness_nm: Located<f64>,
}

/// See [`MaterialFile::Polarizer`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PolarizerFile {
    /// Transmitting axis: degrees from the surface's u direction, counter-clockwise seen from the side that the normal
    /// points to; 0 if neither this nor `axis` is given.
    pub angle_deg: Option<Located<f64>>,
    /// Transmitting axis as a direction in the world, instead of angle_deg.
    pub axis: Option<Located<[f64; 3]>>,
    /// A circular polarizer: `right` or `left`; `linear` if absent.
    #[serde(default, skip_serializing_if = "is_default")]
    pub passes: Passes,
    /// Share of the power of what passes that passes, 0..1.
    #[serde(
        default = "defaults::unit_spectrum",
        skip_serializing_if = "defaults::is_unit_spectrum"
    )]
    pub transmittance: Located<SpectrumFile>,
    /// Power that passes along the blocked axis, over that along the transmitting axis, 0..1.
    #[serde(
        default = "defaults::zero_spectrum",
        skip_serializing_if = "defaults::is_zero_spectrum"
    )]
    pub extinction: Located<SpectrumFile>,
}

/// See [`MaterialFile::Retarder`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RetarderFile {
    /// Retardance at normal incidence in degrees: a number or one per wavelength.
    pub retardance_deg: Option<Located<SpectrumFile>>,
    /// Difference of optical paths at normal incidence in nanometres, instead of retardance_deg.
    pub retardance_nm: Option<Located<SpectrumFile>>,
    /// Fast axis: degrees from the surface's u direction, counter-clockwise seen from the side that the normal points
    /// to; 0 if neither this nor `axis` is given.
    pub angle_deg: Option<Located<f64>>,
    /// Fast axis as a direction in the world, instead of angle_deg.
    pub axis: Option<Located<[f64; 3]>>,
    /// Share of the power that passes, 0..1.
    #[serde(
        default = "defaults::unit_spectrum",
        skip_serializing_if = "defaults::is_unit_spectrum"
    )]
    pub transmittance: Located<SpectrumFile>,
    /// How the retardance depends on incidence.
    #[serde(default, skip_serializing_if = "is_default")]
    pub tilt: TiltFile,
    /// Mean refractive index of the plate, for tilt = "plate"; 1.55 if absent.
    pub ior: Option<Located<f64>>,
}

/// How a retarder's retardance depends on incidence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TiltFile {
    /// As a zero-order plate of a positive uniaxial crystal.
    #[default]
    Plate,
    /// Not at all.
    Constant,
    /// In proportion to the cosine of incidence, as Mitsuba 3.
    Cosine,
}

/// See [`MaterialFile::Crystal`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CrystalFile {
    /// `calcite`, `quartz` or `sapphire`, instead of n_o and n_e.
    pub name: Option<Located<String>>,
    /// Ordinary refractive index.
    pub n_o: Option<Located<SpectrumFile>>,
    /// Extraordinary refractive index.
    pub n_e: Option<Located<SpectrumFile>>,
    /// Optic axis: a direction in the world.
    pub axis: Located<[f64; 3]>,
    /// Refractive index outside.
    #[serde(
        default = "defaults::unit_index",
        skip_serializing_if = "defaults::is_unit_index"
    )]
    pub exterior_ior: Located<IndexFile>,
    /// Full width at half maximum of the light's spectral line in nanometres, which a thick crystal depolarizes.
    #[serde(default, skip_serializing_if = "is_default")]
    #[schemars(range(min = 0, max = 1000))]
    pub bandwidth_nm: Located<f64>,
    /// True: the ordinary and the extraordinary ray part ways, incoherently, and make double images. False: they stay
    /// together, and the crystal retards.
    #[serde(default, skip_serializing_if = "is_default")]
    pub split: Located<bool>,
    /// Roughness α of the faces (GGX, as `alpha` of rough glass), 0.001..1: a number or an image. Smooth without. Not with `split`.
    pub roughness: Option<Located<ScalarFile>>,
}

/// See [`MaterialFile::Measured`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeasuredFile {
    /// `.pbsdf` file in the layout of the KAIST pBRDF set.
    pub file: Located<String>,
    /// Takes evenly spaced angles where the file's axes are empty, as in downsampled files.
    #[serde(default, skip_serializing_if = "is_default")]
    pub even_axes: bool,
}

impl MaterialFile {
    /// A depolarizing Lambert surface of an albedo: a number, one per wavelength, or an image.
    #[must_use]
    pub fn diffuse(albedo: impl Into<AlbedoFile>) -> Self {
        Self::Diffuse(DiffuseFile {
            albedo: albedo.into().into(),
        })
    }

    /// A smooth metal of the optical constants, such as `Au`.
    #[must_use]
    pub fn metal(name: impl Into<String>) -> Self {
        Self::Conductor(ConductorFile {
            metal: Some(name.into().into()),
            n: None,
            k: None,
            reflectance: defaults::unit_albedo(),
        })
    }

    /// A metal of the optical constants with GGX microfacets of a roughness in 0.001..1: a number or an image.
    #[must_use]
    pub fn rough_metal(name: impl Into<String>, alpha: impl Into<ScalarFile>) -> Self {
        Self::RoughConductor(RoughConductorFile {
            metal: Some(name.into().into()),
            n: None,
            k: None,
            reflectance: defaults::unit_albedo(),
            alpha: alpha.into().into(),
            distribution: Distribution::default(),
            masking: Masking::default(),
        })
    }

    /// Smooth glass in vacuum of a refractive index: a number, one per wavelength, or a name such as `N-BK7`.
    #[must_use]
    pub fn dielectric(ior: impl Into<IndexFile>) -> Self {
        Self::Dielectric(DielectricFile {
            ior: ior.into().into(),
            exterior_ior: defaults::unit_index(),
        })
    }

    /// A rough dielectric coat over a depolarizing base: albedo, refractive index, roughness.
    #[must_use]
    pub fn plastic(
        albedo: impl Into<AlbedoFile>,
        ior: impl Into<IndexFile>,
        alpha: impl Into<ScalarFile>,
    ) -> Self {
        Self::Plastic(Box::new(PlasticFile {
            albedo: albedo.into().into(),
            ior: ior.into().into(),
            exterior_ior: defaults::unit_index(),
            specular: defaults::unit_spectrum(),
            single_scatter: None,
            interreflection: InterreflectionFile::default(),
            passage: PassageFile::default(),
            alpha: alpha.into().into(),
            distribution: Distribution::default(),
            masking: Masking::default(),
        }))
    }

    /// An ideal polarizer sheet whose transmitting axis stands at an angle in degrees from the surface's u direction.
    #[must_use]
    pub fn polarizer(angle_deg: f64) -> Self {
        Self::Polarizer(PolarizerFile {
            angle_deg: Some(angle_deg.into()),
            axis: None,
            passes: Passes::Linear,
            transmittance: defaults::unit_spectrum(),
            extinction: defaults::zero_spectrum(),
        })
    }

    /// One material in front, another (or none: black) behind, by name.
    #[must_use]
    pub fn two_sided(front: impl Into<String>, back: Option<&str>) -> Self {
        Self::TwoSided(TwoSidedFile {
            front: front.into().into(),
            back: back.map(|b| b.to_owned().into()),
        })
    }

    /// A table of measured Mueller matrices: a `.pbsdf` file.
    #[must_use]
    pub fn measured(file: impl Into<String>) -> Self {
        Self::Measured(MeasuredFile {
            file: file.into().into(),
            even_axes: false,
        })
    }
}

//! The syntax of materials, in scene files and in material files.

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

/// A material file, which `sunstone pbrdf eval` reads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Sunstone materials")]
pub struct MaterialSetFile {
    /// One to four vacuum wavelengths in nanometres, increasing. Default: 450, 550, 660.
    #[serde(default = "defaults::wavelengths", skip_serializing_if = "defaults::is_wavelengths")]
    pub wavelengths_nm: Located<Vec<f64>>,
    /// Materials by name.
    pub materials: BTreeMap<String, Located<MaterialFile>>,
}

/// A surface material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum MaterialFile {
    /// A Lambertian surface that depolarizes completely.
    Diffuse(DiffuseFile),
    /// A smooth metal.
    Conductor(ConductorFile),
    /// A rough metal with microfacets.
    RoughConductor(RoughConductorFile),
    /// A smooth dielectric such as glass or water: the interface between the inside and the outside of a
    /// closed surface.
    Dielectric(DielectricFile),
    /// A rough dielectric with microfacets.
    RoughDielectric(RoughDielectricFile),
    /// A rough dielectric coat over a depolarizing base.
    Plastic(Box<PlasticFile>),
    /// One material on the front side, and another material or black on the back side.
    TwoSided(TwoSidedFile),
    /// Two materials mixed by area.
    Blend(BlendFile),
    /// A material with normals from an image.
    NormalMap(NormalMapFile),
    /// A material with heights from an image.
    BumpMap(BumpMapFile),
    /// A material that depolarizes a fraction of the scattered light.
    PartialDepolarizer(PartialDepolarizerFile),
    /// A metal mirror coated with thin films.
    CoatedConductor(CoatedConductorFile),
    /// A polarizer: a thin sheet that transmits one polarization.
    Polarizer(PolarizerFile),
    /// A wave plate: a thin sheet that retards one linear polarization.
    Retarder(RetarderFile),
    /// A thin glass plate that transmits light without refraction.
    ThinDielectric(DielectricFile),
    /// A uniaxial crystal that fills a closed surface.
    Crystal(CrystalFile),
    /// A table of measured Mueller matrices.
    Measured(MeasuredFile),
    /// An index-matched boundary of a medium. The boundary does not affect light and does not count as an
    /// interaction.
    Null(NullFile),
}

/// An index-matched boundary, without keys.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NullFile {}

/// A Lambertian surface that depolarizes completely.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DiffuseFile {
    /// Albedo, 0..1: a number, one number per wavelength, or an image.
    pub albedo: Located<AlbedoFile>,
}

/// A smooth metal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ConductorFile {
    /// Name of a metal in the optical constants, or `mirror` for a metal that reflects all light. Use it
    /// instead of n and k.
    pub metal: Option<Located<String>>,
    /// Real part n of the refractive index.
    pub n: Option<Located<SpectrumFile>>,
    /// Extinction coefficient k ≥ 0, dimensionless.
    pub k: Option<Located<SpectrumFile>>,
    /// Factor that multiplies the reflected light, 0..1: a number, one number per wavelength, or an image.
    /// Default: 1.
    #[serde(default = "defaults::unit_albedo", skip_serializing_if = "defaults::is_unit_albedo")]
    pub reflectance: Located<AlbedoFile>,
}

/// A rough metal with microfacets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RoughConductorFile {
    /// Name of a metal in the optical constants, or `mirror` for a metal that reflects all light. Use it
    /// instead of n and k.
    pub metal: Option<Located<String>>,
    /// Real part n of the refractive index.
    pub n: Option<Located<SpectrumFile>>,
    /// Extinction coefficient k ≥ 0, dimensionless.
    pub k: Option<Located<SpectrumFile>>,
    /// Factor that multiplies the reflected light, 0..1: a number, one number per wavelength, or an image.
    /// Default: 1.
    #[serde(default = "defaults::unit_albedo", skip_serializing_if = "defaults::is_unit_albedo")]
    pub reflectance: Located<AlbedoFile>,
    /// Roughness α, 0.001..1: a number or an image.
    pub alpha: Located<ScalarFile>,
    /// Distribution of facet normals. Default: `ggx`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub distribution: Distribution,
    /// Masking and shadowing: `correlated` (Heitz 2014, the default) or `separable` (Walter et al. 2007, as
    /// in Mitsuba).
    #[serde(default, skip_serializing_if = "is_default")]
    pub masking: Masking,
}

/// A smooth dielectric such as glass or water.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DielectricFile {
    /// Refractive index inside: a number, one number per wavelength (dispersion), or a name of the optical
    /// constants.
    pub ior: Located<IndexFile>,
    /// Refractive index outside of the surface. Default: 1.
    #[serde(default = "defaults::unit_index", skip_serializing_if = "defaults::is_unit_index")]
    pub exterior_ior: Located<IndexFile>,
}

/// A rough dielectric with microfacets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RoughDielectricFile {
    /// Refractive index inside: a number, one number per wavelength (dispersion), or a name of the optical
    /// constants.
    pub ior: Located<IndexFile>,
    /// Refractive index outside of the surface. Default: 1.
    #[serde(default = "defaults::unit_index", skip_serializing_if = "defaults::is_unit_index")]
    pub exterior_ior: Located<IndexFile>,
    /// Roughness α, 0.001..1: a number or an image.
    pub alpha: Located<ScalarFile>,
    /// Distribution of facet normals. Default: `ggx`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub distribution: Distribution,
    /// Masking and shadowing: `correlated` (Heitz 2014, the default) or `separable` (Walter et al. 2007, as
    /// in Mitsuba).
    #[serde(default, skip_serializing_if = "is_default")]
    pub masking: Masking,
}

/// One material on the front side, and another material or black on the back side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TwoSidedFile {
    /// Name of the material on the front side, to which the normal points.
    pub front: Located<String>,
    /// Name of the material on the back side. Default: black.
    pub back: Option<Located<String>>,
}

/// Two materials mixed by area.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BlendFile {
    /// Name of the first material.
    pub a: Located<String>,
    /// Name of the second material.
    pub b: Located<String>,
    /// Share of the surface area with the second material, 0..1: a number or an image.
    pub weight: Located<ScalarFile>,
}

/// A material with normals from an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NormalMapFile {
    /// Name of the material to perturb.
    pub material: Located<String>,
    /// Image file of unit vectors (x right, y up, z out of the surface), relative to the scene file. Each
    /// coordinate c is stored as (c + 1)/2.
    pub image: Located<String>,
    /// Factor that multiplies the x and y coordinates of the vectors, 0..10. Default: 1.
    #[serde(default = "defaults::unit", skip_serializing_if = "defaults::is_unit")]
    #[schemars(range(min = 0, max = 10))]
    pub strength: Located<f64>,
    /// Map of texture coordinates, as for other images. The map does not rotate the vectors, which are in the
    /// surface's tangent frame.
    pub uv: Option<UvRows>,
    /// Continuation beyond the image's edges. Default: `repeat`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub wrap: Wrap,
    /// Interpolation between texels. Default: `bilinear`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub filter: Filter,
    /// Layer of an OpenEXR file, as for other images.
    pub layer: Option<String>,
}

/// A material with heights from an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BumpMapFile {
    /// Name of the material to perturb.
    pub material: Located<String>,
    /// Image of heights. Its `filter` must be `bilinear`.
    pub image: Located<ImageAlbedo>,
    /// Difference in surface height, in metres, between image values 1 and 0. Only the normals
    /// change, not the shape. Default: 1.
    #[serde(default = "defaults::unit", skip_serializing_if = "defaults::is_unit")]
    pub height: Located<f64>,
}

/// A material that depolarizes a fraction of the scattered light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PartialDepolarizerFile {
    /// Name of the material whose light is depolarized.
    pub material: Located<String>,
    /// Fraction of the scattered light that is depolarized, 0..1: a number or an image.
    pub fraction: Located<ScalarFile>,
}

/// A metal mirror coated with thin films.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoatedConductorFile {
    /// Name of the substrate in the optical constants. Use it instead of `n` and `k`.
    pub metal: Option<Located<String>>,
    /// Real part n of the substrate's refractive index.
    pub n: Option<Located<SpectrumFile>>,
    /// Extinction coefficient k ≥ 0 of the substrate.
    pub k: Option<Located<SpectrumFile>>,
    /// Films from the outermost to the innermost, at most 4.
    pub films: Located<Vec<Located<FilmFile>>>,
}

/// One film of a coated conductor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FilmFile {
    /// Refractive index: a number, one number per wavelength, or a name of the optical constants.
    pub ior: Located<IndexFile>,
    /// Extinction coefficient k ≥ 0. Default: 0, or the value of the named optical constants.
    pub k: Option<Located<SpectrumFile>>,
    /// Thickness in nanometres.
    #[schemars(range(min = 0, max = 100_000))]
    pub thickness_nm: Located<f64>,
}

/// A polarizer: a thin sheet that transmits one polarization.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PolarizerFile {
    /// Transmission axis in degrees from the surface's u direction, counter-clockwise as seen from the side
    /// to which the normal points. Default: 0 if `axis` is absent too.
    pub angle_deg: Option<Located<f64>>,
    /// Transmission axis as a world direction. Use it instead of `angle_deg`.
    pub axis: Option<Located<[f64; 3]>>,
    /// Transmitted polarization: `linear`, or `right` or `left` for a circular polarizer. Default: `linear`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub passes: Passes,
    /// Transmittance of power for the transmitted polarization, 0..1. Default: 1.
    #[serde(default = "defaults::unit_spectrum", skip_serializing_if = "defaults::is_unit_spectrum")]
    pub transmittance: Located<SpectrumFile>,
    /// Transmittance of the blocked polarization divided by that of the transmitted polarization, 0..1.
    /// Default: 0.
    #[serde(default = "defaults::zero_spectrum", skip_serializing_if = "defaults::is_zero_spectrum")]
    pub extinction: Located<SpectrumFile>,
}

/// A wave plate: a thin sheet that retards one linear polarization.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RetarderFile {
    /// Retardance at normal incidence in degrees: a number, or one number per wavelength.
    pub retardance_deg: Option<Located<SpectrumFile>>,
    /// Optical path difference at normal incidence in nanometres. Use it instead of `retardance_deg`.
    pub retardance_nm: Option<Located<SpectrumFile>>,
    /// Fast axis in degrees from the surface's u direction, counter-clockwise as seen from the side to which
    /// the normal points. Default: 0 if `axis` is absent too.
    pub angle_deg: Option<Located<f64>>,
    /// Fast axis as a world direction. Use it instead of `angle_deg`.
    pub axis: Option<Located<[f64; 3]>>,
    /// Transmittance of power, 0..1. Default: 1.
    #[serde(default = "defaults::unit_spectrum", skip_serializing_if = "defaults::is_unit_spectrum")]
    pub transmittance: Located<SpectrumFile>,
    /// Dependence of the retardance on the angle of incidence. Default: `plate`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub tilt: TiltFile,
    /// Mean refractive index of the plate. Used only if `tilt` is `plate`. Default: 1.55.
    pub ior: Option<Located<f64>>,
}

/// Dependence of a wave plate's retardance on the angle of incidence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TiltFile {
    /// The dependence that a zero-order plate of a positive uniaxial crystal has.
    #[default]
    Plate,
    /// No dependence on the angle of incidence.
    Constant,
    /// Proportional to the cosine of the angle of incidence, as in Mitsuba 3.
    Cosine,
}

/// A uniaxial crystal that fills a closed surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CrystalFile {
    /// Name of the crystal: `calcite`, `quartz` or `sapphire`. Use it instead of `n_o` and `n_e`.
    pub name: Option<Located<String>>,
    /// Ordinary refractive index of the crystal.
    pub n_o: Option<Located<SpectrumFile>>,
    /// Extraordinary refractive index of the crystal.
    pub n_e: Option<Located<SpectrumFile>>,
    /// Optic axis as a world direction.
    pub axis: Located<[f64; 3]>,
    /// Refractive index outside of the crystal. Default: 1.
    #[serde(default = "defaults::unit_index", skip_serializing_if = "defaults::is_unit_index")]
    pub exterior_ior: Located<IndexFile>,
    /// Full width at half maximum, in nanometres, of the light's spectral line. A thick crystal
    /// depolarizes such light. Default: 0.
    #[serde(default, skip_serializing_if = "is_default")]
    #[schemars(range(min = 0, max = 1000))]
    pub bandwidth_nm: Located<f64>,
    /// True if the crystal splits light into incoherent ordinary and extraordinary rays (double images). If
    /// false, the rays do not separate and the crystal acts as a retarder. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub split: Located<bool>,
    /// GGX roughness α of the faces, 0.001..1: a number or an image. Cannot be combined with `split`.
    /// Default: smooth.
    pub roughness: Option<Located<ScalarFile>>,
}

/// A table of measured Mueller matrices.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeasuredFile {
    /// `.pbsdf` file in the layout of the KAIST pBRDF data set.
    pub file: Located<String>,
    /// True to use evenly spaced angles for angle axes that are empty in the file. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub even_axes: bool,
}

impl MaterialFile {
    /// Creates a Lambertian surface from its albedo: a number, one number per wavelength, or an image.
    pub fn diffuse(albedo: impl Into<AlbedoFile>) -> Self {
        Self::Diffuse(DiffuseFile { albedo: albedo.into().into() })
    }

    /// Creates a smooth metal from its name in the optical constants, such as `Au`.
    pub fn metal(name: impl Into<String>) -> Self {
        Self::Conductor(ConductorFile {
            metal: Some(name.into().into()),
            n: None,
            k: None,
            reflectance: defaults::unit_albedo(),
        })
    }

    /// Creates a metal of the optical constants with GGX microfacets of roughness 0.001..1: a number or an
    /// image.
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

    /// Creates smooth glass in vacuum from its refractive index: a number, one number per wavelength, or a
    /// name such as `N-BK7`.
    pub fn dielectric(ior: impl Into<IndexFile>) -> Self {
        Self::Dielectric(DielectricFile { ior: ior.into().into(), exterior_ior: defaults::unit_index() })
    }

    /// Creates a rough dielectric coat over a depolarizing base.
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

    /// Creates an ideal polarizer whose transmission axis is `angle_deg` from the surface's u direction.
    pub fn polarizer(angle_deg: f64) -> Self {
        Self::Polarizer(PolarizerFile {
            angle_deg: Some(angle_deg.into()),
            axis: None,
            passes: Passes::Linear,
            transmittance: defaults::unit_spectrum(),
            extinction: defaults::zero_spectrum(),
        })
    }

    /// Creates a two-sided material from the names of the materials on the front and on the back side.
    /// Without `back`, the back side is black.
    pub fn two_sided(front: impl Into<String>, back: Option<&str>) -> Self {
        Self::TwoSided(TwoSidedFile { front: front.into().into(), back: back.map(|b| b.to_owned().into()) })
    }

    /// Creates a material from a table of measured Mueller matrices: a `.pbsdf` file.
    pub fn measured(file: impl Into<String>) -> Self {
        Self::Measured(MeasuredFile { file: file.into().into(), even_axes: false })
    }
}

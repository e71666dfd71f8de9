//! The syntax of plastic: a dielectric coat over a depolarizing base.

use super::defaults::{self, is_default};
use super::texture::{AlbedoFile, ScalarFile};
use super::values::{IndexFile, SpectrumFile, any_of, schema};
use base::locate::Located;
use optics::sampling::microfacet::{Distribution, Masking};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::borrow::Cow;
use std::fmt;

/// Rough dielectric coat over a depolarizing base.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlasticFile {
    /// Albedo of the base, 0..1: a number, one number per wavelength, or an image.
    pub albedo: Located<AlbedoFile>,
    /// Refractive index of the coat: a number, one number per wavelength, or a name of the optical constants.
    pub ior: Located<IndexFile>,
    /// Refractive index outside of the coat. Default: 1.
    #[serde(default = "defaults::unit_index", skip_serializing_if = "defaults::is_unit_index")]
    pub exterior_ior: Located<IndexFile>,
    /// Factor of the surface reflection, 0..1: a number, or one number per wavelength. Default: 1.
    #[serde(default = "defaults::unit_spectrum", skip_serializing_if = "defaults::is_unit_spectrum")]
    pub specular: Located<SpectrumFile>,
    /// A coloured lobe of light scattered once below the surface (Hwang et al. 2022). Default: none.
    pub single_scatter: Option<SingleScatterFile>,
    /// Treatment of light that the coat reflects back into the base: `false` (the default), `true` or
    /// `"linear"`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub interreflection: InterreflectionFile,
    /// Surface that light crosses on its way into and out of the base. Default: `smooth`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub passage: PassageFile,
    /// Roughness α of the coat, 0.001..1: a number or an image.
    pub alpha: Located<ScalarFile>,
    /// Distribution of facet normals. Default: `ggx`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub distribution: Distribution,
    /// Masking and shadowing: `correlated` (Heitz 2014, the default) or `separable` (Walter et al. 2007, as
    /// in Mitsuba).
    #[serde(default, skip_serializing_if = "is_default")]
    pub masking: Masking,
}

/// Surface that light crosses on its way into and out of the base.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PassageFile {
    /// Light crosses the smooth mean surface (Baek et al. 2018; Mitsuba's `pplastic` and `plastic`).
    #[default]
    Smooth,
    /// Light crosses the facets: all light that the facets do not reflect enters the base.
    Facets,
    /// Light crosses one facet, as in Mitsuba's `roughplastic`: light that reaches a second facet is lost.
    SingleFacet,
}

/// Treatment of light that the coat reflects back into the base: `false`, `true` or `"linear"`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InterreflectionFile {
    /// `false`: the light is lost (Baek et al. 2018; Mitsuba's `pplastic`).
    #[default]
    Lost,
    /// `true`: the base scatters the light again, which saturates colours (Mitsuba's `plastic` with
    /// `nonlinear`).
    Coloured,
    /// `"linear"`: the light is scattered again as by a white base, so the light from the base is
    /// proportional to `albedo` (Mitsuba's `plastic`).
    Linear,
}

impl Serialize for InterreflectionFile {
    fn serialize<S: serde::Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Lost => s.serialize_bool(false),
            Self::Coloured => s.serialize_bool(true),
            Self::Linear => s.serialize_str("linear"),
        }
    }
}

any_of!(InterreflectionFile, "true, false or \"linear\"", {
    fn visit_bool<E>(self, v: bool) -> Result<InterreflectionFile, E> {
        Ok(if v { InterreflectionFile::Coloured } else { InterreflectionFile::Lost })
    }
    fn visit_str<E: de::Error>(self, v: &str) -> Result<InterreflectionFile, E> {
        match v {
            "linear" => Ok(InterreflectionFile::Linear),
            _ => Err(E::invalid_value(de::Unexpected::Str(v), &self)),
        }
    }
});

schema!(InterreflectionFile, "InterreflectionFile", |_| json_schema!({ "enum": [true, false, "linear"] }));

/// A coloured lobe of light scattered once below the surface (Hwang et al. 2022).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SingleScatterFile {
    /// Albedo of the lobe, 0..1: a number, one number per wavelength, or an image.
    pub albedo: Located<AlbedoFile>,
    /// Roughness α of the lobe, 0.001..1: a number or an image.
    pub alpha: Located<ScalarFile>,
}

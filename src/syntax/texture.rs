//! Values of a scene file that can vary over a surface: images, checkerboards and mesh attributes.

use super::values::{
    SpectrumFile, SpectrumTable, SpectrumVisitor, any_of, from, is_default, is_one, one, schema,
};
use base::locate::Located;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{self, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::borrow::Cow;
use std::fmt;
use transport::material::texture::{Filter, Wrap};

/// An albedo: a spectrum, an image, a checkerboard or a mesh attribute.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum AlbedoFile {
    /// A spectrum that is constant over the surface.
    Spectrum(SpectrumFile),
    /// Albedos from an image.
    Image(ImageAlbedo),
    /// Albedos from a checkerboard.
    Checkerboard(CheckerboardFile),
    /// Albedos from an attribute of the mesh.
    Attribute(AttributeFile),
}

/// A number, an image of numbers (its first channel, linear), a checkerboard or a mesh attribute.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ScalarFile {
    /// A number that is constant over the surface.
    Number(f64),
    /// Numbers from an image.
    Image(ImageAlbedo),
    /// Numbers from a checkerboard.
    Checkerboard(CheckerboardFile),
    /// Numbers from an attribute of the mesh.
    Attribute(AttributeFile),
}

/// An image: `{ image = "wood.png" }`. Wavelengths above 590 nm use the red channel, 500 to 590 nm green, and
/// below 500 nm blue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageAlbedo {
    /// Image file, relative to the scene file. Colours of PNG, JPEG, BMP, TGA, PNM and GIF files
    /// are sRGB-encoded. Colours of OpenEXR, Radiance HDR and PFM files are linear. Numbers
    /// (roughness, weights) are always linear.
    pub image: Located<String>,
    /// Factor that multiplies the image, at most 2; resulting albedos are clamped to 1. Default: 1.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub scale: f64,
    /// Map of texture coordinates. Default: identity.
    pub uv: Option<UvRows>,
    /// Continuation beyond the image's edges. Default: `repeat`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub wrap: Wrap,
    /// Interpolation between texels. Default: `bilinear`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub filter: Filter,
    /// True if the colours are linear, not sRGB-encoded. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub raw: bool,
    /// True if numbers are the luminance of the decoded colours, not the first channel. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub luminance: bool,
    /// Layer of an OpenEXR file, such as `ViewLayer.Combined`. Default: the unnamed layer, or the only colour
    /// layer.
    pub layer: Option<String>,
}

/// Rows `[[a, b, c], [d, e, f]]` of a map of texture coordinates. The texture coordinates (u, v) map to
/// (a u + b v + c, d u + e v + f) in the image. The lower left corner of the image is (0, 0).
pub type UvRows = [[f64; 3]; 2];

/// A checkerboard: `{ checkerboard = [0.4, 0.2] }`. It has two by two squares over texture coordinates 0..1
/// and repeats beyond them. The first value is in the lower left and upper right squares.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CheckerboardFile {
    /// Two values: of the lower left and upper right squares, and of the other two squares.
    pub checkerboard: [SpectrumFile; 2],
    /// Map of texture coordinates, as for an image.
    pub uv: Option<UvRows>,
}

/// An attribute of a PLY mesh, `{ attribute = "vertex_color" }`, per vertex (interpolated over each triangle)
/// or per face (`face_color`). The attribute is one number, or linear red, green and blue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AttributeFile {
    /// Name of the attribute. Vertex properties `color_0` to `color_2` or `red`, `green`, `blue` form
    /// `vertex_color`.
    pub attribute: Located<String>,
    /// Factor that multiplies the attribute, at most 2. Default: 1.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub scale: f64,
}

impl<T: Into<SpectrumFile>> From<T> for AlbedoFile {
    fn from(spectrum: T) -> Self {
        Self::Spectrum(spectrum.into())
    }
}

from! {
    CheckerboardFile => AlbedoFile::Checkerboard,
    ImageAlbedo => AlbedoFile::Image,
    f64 => ScalarFile::Number,
    ImageAlbedo => ScalarFile::Image,
}

impl ImageAlbedo {
    /// Creates an unscaled image from a file.
    pub fn new(file: impl Into<String>) -> Self {
        Self {
            image: file.into().into(),
            scale: 1.0,
            uv: None,
            wrap: Wrap::default(),
            filter: Filter::default(),
            raw: false,
            luminance: false,
            layer: None,
        }
    }
}

/// All keys of images, checkerboards, attributes and spectrum tables. The keys that are present determine the
/// kind of value.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AlbedoMap {
    image: Option<Located<String>>,
    scale: Option<f64>,
    uv: Option<UvRows>,
    wrap: Option<Wrap>,
    filter: Option<Filter>,
    raw: Option<bool>,
    luminance: Option<bool>,
    layer: Option<String>,
    checkerboard: Option<[SpectrumFile; 2]>,
    attribute: Option<Located<String>>,
    nm: Option<Vec<f64>>,
    values: Option<Vec<f64>>,
}

impl AlbedoMap {
    fn resolve<E: de::Error>(self) -> Result<AlbedoFile, E> {
        let of_image = self.wrap.is_some()
            || self.filter.is_some()
            || self.raw.is_some()
            || self.luminance.is_some()
            || self.layer.is_some();
        let plain = !of_image && self.uv.is_none();
        match (self.image, self.checkerboard, self.attribute, self.nm, self.values) {
            (Some(image), None, None, None, None) => Ok(AlbedoFile::Image(ImageAlbedo {
                image,
                scale: self.scale.unwrap_or_else(one),
                uv: self.uv,
                wrap: self.wrap.unwrap_or_default(),
                filter: self.filter.unwrap_or_default(),
                raw: self.raw.unwrap_or_default(),
                luminance: self.luminance.unwrap_or_default(),
                layer: self.layer,
            })),
            (None, Some(checkerboard), None, None, None) if !of_image && self.scale.is_none() => {
                Ok(AlbedoFile::Checkerboard(CheckerboardFile { checkerboard, uv: self.uv }))
            }
            (None, None, Some(attribute), None, None) if plain => {
                Ok(AlbedoFile::Attribute(AttributeFile { attribute, scale: self.scale.unwrap_or_else(one) }))
            }
            (None, None, None, Some(nm), Some(values)) if plain && self.scale.is_none() => {
                Ok(AlbedoFile::Spectrum(SpectrumFile::Table(SpectrumTable { nm, values })))
            }
            _ => Err(E::custom(
                "expected a texture: { image = \"file.png\", scale, uv, wrap, filter, raw, luminance, layer }, { checkerboard = [0.4, 0.2], uv }, { attribute = \"vertex_color\", scale } or { nm = [..], values = [..] }",
            )),
        }
    }
}

any_of!(
    AlbedoFile,
    "a number, a list with one number per wavelength, { nm = [..], values = [..] }, or { image = \"file.png\" }",
    {
        fn visit_f64<E: de::Error>(self, v: f64) -> Result<AlbedoFile, E> {
            SpectrumVisitor.visit_f64(v).map(AlbedoFile::Spectrum)
        }
        fn visit_i64<E: de::Error>(self, v: i64) -> Result<AlbedoFile, E> {
            SpectrumVisitor.visit_i64(v).map(AlbedoFile::Spectrum)
        }
        fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<AlbedoFile, A::Error> {
            SpectrumVisitor.visit_seq(seq).map(AlbedoFile::Spectrum)
        }
        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<AlbedoFile, A::Error> {
            AlbedoMap::deserialize(MapAccessDeserializer::new(map))?.resolve()
        }
    }
);

schema!(AlbedoFile, "Albedo", |g| {
    let (spectrum, image, board, attribute) = (
        g.subschema_for::<SpectrumFile>(),
        g.subschema_for::<ImageAlbedo>(),
        g.subschema_for::<CheckerboardFile>(),
        g.subschema_for::<AttributeFile>(),
    );
    json_schema!({"anyOf": [spectrum, image, board, attribute]})
});

any_of!(ScalarFile, "a number, or { image = \"file.png\" }", {
    fn visit_f64<E: de::Error>(self, v: f64) -> Result<ScalarFile, E> {
        Ok(ScalarFile::Number(v))
    }
    fn visit_i64<E: de::Error>(self, v: i64) -> Result<ScalarFile, E> {
        Ok(ScalarFile::Number(v as f64))
    }
    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<ScalarFile, A::Error> {
        match AlbedoMap::deserialize(MapAccessDeserializer::new(map))?.resolve()? {
            AlbedoFile::Image(image) => Ok(ScalarFile::Image(image)),
            AlbedoFile::Checkerboard(board) => Ok(ScalarFile::Checkerboard(board)),
            AlbedoFile::Attribute(attribute) => Ok(ScalarFile::Attribute(attribute)),
            AlbedoFile::Spectrum(_) => {
                Err(de::Error::custom("expected a number or a texture, got a spectrum"))
            }
        }
    }
});

schema!(ScalarFile, "Scalar", |g| {
    let (image, board, attribute) = (
        g.subschema_for::<ImageAlbedo>(),
        g.subschema_for::<CheckerboardFile>(),
        g.subschema_for::<AttributeFile>(),
    );
    json_schema!({"anyOf": [{"type": "number"}, image, board, attribute]})
});

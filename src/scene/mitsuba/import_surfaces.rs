//! What Mitsuba's BSDFs have in common: metals, refractive indices, facets, and values that may be images.

use super::importer::Importer;
use super::tree::{Node, Value};
use base::locate::{InputError, Located};
use optics::sampling::microfacet::{Distribution, Masking};
use syntax::texture::{AlbedoFile, ImageAlbedo, ScalarFile};
use syntax::values::{IndexFile, SpectrumFile};
use transport::material::constants;

/// Which way up the images of a material are, on coordinates that count v from the image's lower edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Upright {
    #[default]
    NoImages,
    /// `to_uv` turns Mitsuba's v, counted from the top, round: upright on every shape.
    Yes,
    /// Upright on shapes whose own v is turned round (OBJ).
    No,
    /// Some are, some are not.
    Mixed,
}

impl Upright {
    pub fn and(self, other: Self) -> Self {
        match (self, other) {
            (Self::NoImages, x) | (x, Self::NoImages) => x,
            (a, b) if a == b => a,
            _ => Self::Mixed,
        }
    }
}

/// Refractive indices that Mitsuba knows by name (its documentation of `dielectric`).
const INDICES: [(&str, f64); 20] = [
    ("vacuum", 1.0),
    ("helium", 1.000_036),
    ("hydrogen", 1.000_132),
    ("air", 1.000_277),
    ("carbon dioxide", 1.000_45),
    ("water", 1.333),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("carbon tetrachloride", 1.461),
    ("glycerol", 1.4729),
    ("benzene", 1.501),
    ("silicone oil", 1.520_45),
    ("bromine", 1.661),
    ("water ice", 1.31),
    ("fused quartz", 1.458),
    ("pyrex", 1.47),
    ("acrylic glass", 1.49),
    ("polypropylene", 1.49),
    ("bk7", 1.5046),
    ("diamond", 2.419),
];

/// The name of a metal, or its n and k.
type Metal = (
    Option<Located<String>>,
    Option<Located<SpectrumFile>>,
    Option<Located<SpectrumFile>>,
);

/// What a conductor is made of.
pub(super) fn metal(importer: &mut Importer, node: &Node) -> Result<Metal, InputError> {
    one(importer, node, "specular_reflectance")?;
    let (n, k) = (importer.spectrum(node, "eta")?, importer.spectrum(node, "k")?);
    match (node.text(importer.source, "material")?, n, k) {
        (None, Some(n), Some(k)) => Ok((None, Some(n), Some(k))),
        (Some(name), None, None) => match constants::find(name) {
            Ok(found) => {
                importer.note(format!(
                    "`{name}` is taken from sunstone's own optical constants ({})",
                    found.source
                ));
                let name = Located::at(node.span.clone(), found.name.clone());
                Ok((Some(name), None, None))
            }
            Err(e) => importer.error(&node.span, e.to_string(), "give eta and k as spectra"),
        },
        _ => importer.error(
            &node.span,
            "the metal's eta and k are missing, or given twice",
            "give both eta and k, or material=\"Au\" alone",
        ),
    }
}

/// A factor that must be 1, since sunstone's materials have none.
pub(super) fn one(importer: &Importer, node: &Node, name: &str) -> Result<(), InputError> {
    match importer.spectrum(node, name)?.as_deref() {
        None => Ok(()),
        Some(SpectrumFile::Scalar(v)) if *v == 1.0 => Ok(()),
        Some(_) => importer.error(
            &node.span,
            format!("sunstone has no {name} of {}", node.kind),
            "take it away; a blend with black dims a material",
        ),
    }
}

/// A refractive index, by number or by Mitsuba's names.
fn index(importer: &Importer, node: &Node, name: &str, missing: f64) -> Result<f64, InputError> {
    let Some(p) = node.get(name) else {
        return Ok(missing);
    };
    let known = || {
        let names: Vec<&str> = INDICES.iter().map(|(n, _)| *n).collect();
        names.join(", ")
    };
    match &p.value {
        Value::Float(v) => Ok(*v),
        Value::Integer(v) => Ok(*v as f64),
        Value::Text(text) => {
            let plain = text.to_lowercase();
            let found = INDICES.iter().find(|(n, _)| *n == plain);
            found.map(|(_, v)| *v).map_or_else(
                || {
                    importer.error(
                        &p.span,
                        format!("there is no refractive index of `{text}`"),
                        &format!("give a number, or one of {}", known()),
                    )
                },
                Ok,
            )
        }
        _ => importer.error(
            &p.span,
            format!("`{name}` is not a refractive index"),
            "give a number",
        ),
    }
}

/// Refractive indices inside, if nothing is said the given one, and outside, if nothing is said that of air.
pub(super) fn indices(
    importer: &Importer,
    node: &Node,
    inside: f64,
) -> Result<[Located<IndexFile>; 2], InputError> {
    let at = |v: f64| Located::at(node.span.clone(), v.into());
    Ok([
        at(index(importer, node, "int_ior", inside)?),
        at(index(importer, node, "ext_ior", 1.000_277)?),
    ])
}

/// The angle of a sheet in degrees, Mitsuba's way round.
pub(super) fn angle(importer: &Importer, node: &Node) -> Result<f64, InputError> {
    let Some(p) = node.get("theta") else {
        return Ok(0.0);
    };
    match &p.value {
        Value::Float(v) => Ok(*v),
        Value::Integer(v) => Ok(*v as f64),
        _ => importer.error(&p.span, "theta is not one angle", "give a number of degrees"),
    }
}

/// Roughness, distribution and masking.
pub(super) struct Facets {
    pub alpha: Located<ScalarFile>,
    pub distribution: Distribution,
    pub masking: Masking,
}

/// The facets of something rough; Mitsuba masks them separably.
pub(super) fn facets<'a>(
    importer: &Importer<'a>,
    node: &'a Node,
    images: &mut Upright,
) -> Result<Facets, InputError> {
    let source = importer.source;
    let kind = node
        .text(source, "distribution")?
        .unwrap_or("beckmann")
        .to_lowercase();
    let distribution = match kind.as_str() {
        "beckmann" => Distribution::Beckmann,
        "ggx" => Distribution::Ggx,
        _ => {
            return importer.error(
                &node.span,
                format!("there is no distribution `{kind}`"),
                "use beckmann or ggx",
            );
        }
    };
    let alpha = match (node.float(source, "alpha_u")?, node.float(source, "alpha_v")?) {
        (None, None) => scalar(importer, node, "alpha", Some(0.1), images)?,
        (Some(u), Some(v)) if u == v => Located::at(node.span.clone(), u.into()),
        _ => {
            return importer.error(
                &node.span,
                "sunstone's rough surfaces are isotropic",
                "give one alpha",
            );
        }
    };
    Ok(Facets {
        alpha,
        distribution,
        masking: Masking::Separable,
    })
}

/// The image that a property is, if it is one.
fn image<'a>(
    importer: &Importer<'a>,
    node: &'a Node,
    name: &str,
    raw: bool,
    images: &mut Upright,
) -> Result<Option<ImageAlbedo>, InputError> {
    let Some(child) = node.named(name) else {
        return Ok(None);
    };
    let inner = importer.resolve(child)?;
    if inner.tag != "texture" {
        return Ok(None);
    }
    let image = bitmap(importer, inner, raw, images)?;
    Ok(Some(ImageAlbedo {
        image,
        ..ImageAlbedo::new("")
    }))
}

/// A number or an image.
pub(super) fn scalar<'a>(
    importer: &Importer<'a>,
    node: &'a Node,
    name: &str,
    missing: Option<f64>,
    images: &mut Upright,
) -> Result<Located<ScalarFile>, InputError> {
    let at = |v: ScalarFile| Ok(Located::at(node.span.clone(), v));
    if let Some(image) = image(importer, node, name, true, images)? {
        return at(image.into());
    }
    match node.float(importer.source, name)?.or(missing) {
        Some(v) => at(v.into()),
        None => importer.error(
            &node.span,
            format!("{} lacks `{name}`", node.kind),
            "give it as <float> or a bitmap",
        ),
    }
}

/// A spectrum, or an image of colours.
pub(super) fn albedo<'a>(
    importer: &Importer<'a>,
    node: &'a Node,
    name: &str,
    missing: f64,
    images: &mut Upright,
) -> Result<Located<AlbedoFile>, InputError> {
    if let Some(image) = image(importer, node, name, false, images)? {
        return Ok(Located::at(node.span.clone(), image.into()));
    }
    let spectrum = importer.spectrum_or(node, name, missing)?;
    Ok(Located::at(spectrum.span(), (*spectrum).clone().into()))
}

/// The file of a bitmap.
pub(super) fn bitmap(
    importer: &Importer,
    node: &Node,
    raw: bool,
    images: &mut Upright,
) -> Result<Located<String>, InputError> {
    let source = importer.source;
    if node.kind != "bitmap" {
        return importer.error(
            &node.span,
            format!("sunstone has no texture `{}`", node.kind),
            "use a bitmap",
        );
    }
    let Some(name) = node.text(source, "filename")? else {
        return importer.error(
            &node.span,
            "the bitmap has no filename",
            "add <string name=\"filename\">",
        );
    };
    if node.boolean(source, "raw")?.unwrap_or(false) != raw {
        let (message, mend) = if raw {
            (
                "sunstone reads numbers in images as they are",
                "add <boolean name=\"raw\" value=\"true\"/>",
            )
        } else {
            (
                "sunstone takes the colours of images as sRGB",
                "encode the image, and take raw away",
            )
        };
        return importer.error(&node.span, message, mend);
    }
    for (key, only) in [("filter_type", "bilinear"), ("wrap_mode", "repeat")] {
        if let Some(other) = node.text(source, key)?.filter(|v| *v != only) {
            return importer.error(
                &node.span,
                format!("sunstone has no {key} `{other}` of images"),
                &format!("use {only}"),
            );
        }
    }
    let map = node.transform(source, "to_uv")?.unwrap_or_default();
    let down = glam::DAffine3::from_scale(glam::DVec3::new(1.0, -1.0, 1.0));
    let way = match map {
        m if m == glam::DAffine3::IDENTITY => Upright::No,
        m if m == down => Upright::Yes,
        _ => {
            return importer.error(
                &node.span,
                "sunstone does not transform texture coordinates",
                "take to_uv away, or make it <scale y=\"-1\"/> alone",
            );
        }
    };
    *images = images.and(way);
    node.finish(source, &["format", "accel"])?;
    Ok(Located::at(node.span.clone(), importer.file(name)))
}

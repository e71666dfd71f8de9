//! Mitsuba's BSDFs → materials of a scene file.
//!
//! Opaque BSDFs are black from behind unless `twosided` stands round them; what is bare becomes `two_sided` with a front
//! alone.

use super::import::Importer;
use super::toml_text::quoted;
use super::tree::{Node, Value};
use super::xml::number as digits;
use base::locate::InputError;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
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
    fn and(self, other: Self) -> Self {
        match (self, other) {
            (Self::NoImages, x) | (x, Self::NoImages) => x,
            (a, b) if a == b => a,
            _ => Self::Mixed,
        }
    }
}

/// Reads BSDFs, each once.
#[derive(Default)]
pub(super) struct MaterialReader {
    /// Lines of the table `[materials]`, and where each comes from.
    pub lines: Vec<(Range<usize>, String)>,
    /// Name of the material of the BSDF that begins at a byte, alone and inside of `twosided`.
    done: BTreeMap<(usize, bool), String>,
    taken: BTreeSet<String>,
    upright: BTreeMap<String, Upright>,
    /// Bytes at which the BSDFs begin that are being read, outermost first.
    open: Vec<usize>,
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

impl MaterialReader {
    /// The material of a BSDF; its name.
    pub fn named<'a>(&mut self, importer: &mut Importer<'a>, node: &'a Node) -> Result<String, InputError> {
        self.material(importer, node, false, None)
    }

    /// What Mitsuba gives to shapes without a BSDF.
    pub fn of_bare_shapes(&mut self) -> String {
        let name = "mitsuba_default".to_owned();
        if self.taken.insert(name.clone()) {
            let inner = self.free("mitsuba_default_front");
            self.lines.push((0..0, format!("{inner}.diffuse.albedo = 0.5")));
            self.lines
                .push((0..0, format!("{name}.two_sided.front = {}", quoted(&inner))));
        }
        name
    }

    /// Which way up the images of a material are.
    pub fn images(&self, name: &str) -> Upright {
        self.upright.get(name).copied().unwrap_or_default()
    }

    /// A name that is free, like the wanted one.
    fn free(&mut self, wanted: &str) -> String {
        let base = super::plain(wanted);
        let mut name = base.clone();
        let mut n = 2;
        while !self.taken.insert(name.clone()) {
            name = format!("{base}_{n}");
            n += 1;
        }
        name
    }

    /// The material of a BSDF; `both` inside of `twosided`, where what is opaque shows from both sides. It gets the name of
    /// the `outer` element, if it stands for that.
    fn material<'a>(
        &mut self,
        importer: &mut Importer<'a>,
        node: &'a Node,
        both: bool,
        outer: Option<&'a Node>,
    ) -> Result<String, InputError> {
        if node.tag != "bsdf" {
            return importer.error(
                &node.span,
                format!("a {} stands where a bsdf must", node.tag),
                "refer to a bsdf",
            );
        }
        let key = (node.span.start, both);
        if let Some(name) = self.done.get(&key) {
            return Ok(name.clone());
        }
        if self.open.contains(&node.span.start) || self.open.len() > 14 {
            return importer.error(
                &node.span,
                "the bsdf is made of itself, or of too many others",
                "bsdfs may hold others, some ten deep, but not in a circle",
            );
        }
        self.open.push(node.span.start);
        if let Some(inner) = single_inside(importer, node)? {
            let name = self.material(importer, inner, true, outer.or(Some(node)))?;
            self.open.pop();
            self.done.insert(key, name.clone());
            return Ok(name);
        }
        let named = outer.filter(|o| o.id.is_some()).unwrap_or(node);
        let wanted = named.id.clone().unwrap_or_else(|| node.kind.clone());
        let (body, images) = self.body(importer, node, both)?;
        let opaque = [
            "diffuse",
            "conductor",
            "roughconductor",
            "pplastic",
            "measured_polarized",
        ];
        let name = if opaque.contains(&node.kind.as_str()) && !both {
            let name = self.free(&wanted);
            let front = self.free(&format!("{name}_front"));
            self.lines.push((node.span.clone(), format!("{front}.{body}")));
            self.lines.push((
                node.span.clone(),
                format!("{name}.two_sided.front = {}", quoted(&front)),
            ));
            name
        } else {
            let name = self.free(&wanted);
            self.lines.push((node.span.clone(), format!("{name}.{body}")));
            name
        };
        self.upright.insert(name.clone(), images);
        self.open.pop();
        self.done.insert(key, name.clone());
        Ok(name)
    }

    /// What stands behind the name.
    fn body<'a>(
        &mut self,
        importer: &mut Importer<'a>,
        node: &'a Node,
        both: bool,
    ) -> Result<(String, Upright), InputError> {
        let source = importer.source;
        let mut images = Upright::NoImages;
        let body = match node.kind.as_str() {
            "diffuse" => {
                let albedo = albedo(importer, node, "reflectance", "0.5", &mut images)?;
                format!("diffuse = {{ albedo = {albedo} }}")
            }
            "conductor" => format!("conductor = {{ {} }}", metal(importer, node)?),
            "roughconductor" => {
                let metal = metal(importer, node)?;
                let facets = facets(importer, node, &mut images)?;
                format!("rough_conductor = {{ {metal}, {facets} }}")
            }
            "dielectric" | "thindielectric" | "roughdielectric" => {
                let (inside, outside) = (
                    index(importer, node, "int_ior", 1.5046)?,
                    index(importer, node, "ext_ior", 1.000_277)?,
                );
                let ior = format!("ior = {}, exterior_ior = {}", digits(inside), digits(outside));
                for name in ["specular_reflectance", "specular_transmittance"] {
                    one(importer, node, name)?;
                }
                if node.kind == "dielectric" {
                    format!("dielectric = {{ {ior} }}")
                } else if node.kind == "thindielectric" {
                    importer.note("thin glass is polarized in sunstone; Mitsuba's thindielectric is not");
                    format!("thin_dielectric = {{ {ior} }}")
                } else {
                    let facets = facets(importer, node, &mut images)?;
                    importer.note("rough glass is polarized in sunstone; Mitsuba's roughdielectric is not");
                    format!("rough_dielectric = {{ {ior}, {facets} }}")
                }
            }
            "pplastic" => {
                let albedo = albedo(importer, node, "diffuse_reflectance", "0.5", &mut images)?;
                let specular = importer
                    .spectrum(node, "specular_reflectance")?
                    .unwrap_or("1".into());
                let eta = importer.spectrum(node, "eta")?;
                let ior = match eta {
                    Some(eta) => format!("ior = {eta}"),
                    None => {
                        let (inside, outside) = (
                            index(importer, node, "int_ior", 1.49)?,
                            index(importer, node, "ext_ior", 1.000_277)?,
                        );
                        format!("ior = {}, exterior_ior = {}", digits(inside), digits(outside))
                    }
                };
                let facets = facets(importer, node, &mut images)?;
                format!("plastic = {{ albedo = {albedo}, specular = {specular}, {ior}, {facets} }}")
            }
            "measured_polarized" => {
                let Some(name) = node.text(source, "filename")? else {
                    return importer.error(
                        &node.span,
                        "the table has no filename",
                        "add <string name=\"filename\">",
                    );
                };
                if let Some(nm) = node.float(source, "wavelength")?
                    && nm >= 0.0
                    && importer.wavelengths != [nm]
                {
                    return importer.error(
                        &node.span,
                        format!("the table is used at {nm} nm for all wavelengths"),
                        "take `wavelength` away, or choose it: -D wavelengths_nm=…",
                    );
                }
                format!("measured.file = {}", importer.file(name))
            }
            "polarizer" => {
                if node.boolean(source, "polarizing")? == Some(false) {
                    return importer.error(
                        &node.span,
                        "the polarizer does not polarize",
                        "take `polarizing` away, or the polarizer",
                    );
                }
                // Mitsuba turns the axis clockwise.
                let angle = -angle(importer, node)?;
                let passes = importer.spectrum(node, "transmittance")?.unwrap_or("1".into());
                format!(
                    "polarizer = {{ angle_deg = {}, transmittance = {passes} }}",
                    digits(angle)
                )
            }
            "retarder" => {
                let angle = angle(importer, node)?;
                let delta = importer.spectrum(node, "delta")?.unwrap_or("90".into());
                let passes = importer.spectrum(node, "transmittance")?.unwrap_or("1".into());
                importer.note("off the normal, the axis of Mitsuba's retarder is no line in space; ours is");
                format!(
                    "retarder = {{ retardance_deg = {delta}, angle_deg = {}, transmittance = {passes}, tilt = \"cosine\" }}",
                    digits(angle)
                )
            }
            "twosided" => {
                one_way(importer, node)?;
                let inner = self.nested(importer, node, true, 2, &mut images)?;
                format!(
                    "two_sided = {{ front = {}, back = {} }}",
                    quoted(&inner[0]),
                    quoted(&inner[1])
                )
            }
            "blendbsdf" => {
                let weight = scalar(importer, node, "weight", None, &mut images)?;
                let inner = self.nested(importer, node, both, 2, &mut images)?;
                format!(
                    "blend = {{ a = {}, b = {}, weight = {weight} }}",
                    quoted(&inner[0]),
                    quoted(&inner[1])
                )
            }
            "normalmap" => {
                let Some(child) = node.named("normalmap") else {
                    return importer.error(
                        &node.span,
                        "the normal map has no image",
                        "add a texture named normalmap",
                    );
                };
                let texture = importer.resolve(child)?;
                let file = bitmap(importer, texture, true, &mut images)?;
                for name in ["flip_invalid_normals", "use_shadowing_function"] {
                    if node.boolean(source, name)?.unwrap_or(true) {
                        importer.note(format!("normal maps have no {name} in sunstone"));
                    }
                }
                let inner = self.nested(importer, node, both, 1, &mut images)?;
                format!(
                    "normal_map = {{ material = {}, image = {file} }}",
                    quoted(&inner[0])
                )
            }
            other => {
                return importer.error(
                    &node.span,
                    format!("sunstone has no material `{other}`"),
                    "use diffuse, conductor, roughconductor, dielectric, thindielectric, roughdielectric, pplastic, measured_polarized, polarizer, retarder, blendbsdf, twosided or normalmap",
                );
            }
        };
        node.finish(source, &["sample_visible", "alpha_sample"])?;
        Ok((body, images))
    }

    /// The materials of the BSDFs inside, which must be so many.
    fn nested<'a>(
        &mut self,
        importer: &mut Importer<'a>,
        node: &'a Node,
        both: bool,
        count: usize,
        images: &mut Upright,
    ) -> Result<Vec<String>, InputError> {
        let mut names = vec![];
        for child in node.children() {
            if !["bsdf", "ref"].contains(&child.tag()) {
                continue;
            }
            let inner = importer.resolve(child)?;
            if inner.tag == "texture" {
                continue;
            }
            let name = self.material(importer, inner, both, None)?;
            *images = images.and(self.images(&name));
            names.push(name);
        }
        if names.len() == count {
            return Ok(names);
        }
        importer.error(
            &node.span,
            format!("{} bsdfs are inside of {}", names.len(), node.kind),
            &format!("give {count}"),
        )
    }
}

/// What is alone inside of a `twosided`, and so shows on both sides.
fn single_inside<'a>(importer: &Importer<'a>, node: &'a Node) -> Result<Option<&'a Node>, InputError> {
    if node.kind != "twosided" || node.children().len() != 1 {
        return Ok(None);
    }
    one_way(importer, node)?;
    let inner = importer.resolve(&node.children()[0])?;
    node.finish(importer.source, &[])?;
    Ok(Some(inner))
}

/// That a `twosided` holds nothing that light passes through.
fn one_way(importer: &Importer, node: &Node) -> Result<(), InputError> {
    if node.boolean(importer.source, "allow_transmission")? == Some(true) {
        return importer.error(
            &node.span,
            "sunstone has no two-sided glass",
            "take allow_transmission away",
        );
    }
    Ok(())
}

/// n and k.
fn metal(importer: &mut Importer, node: &Node) -> Result<String, InputError> {
    let source = importer.source;
    one(importer, node, "specular_reflectance")?;
    let (n, k) = (importer.spectrum(node, "eta")?, importer.spectrum(node, "k")?);
    match (node.text(source, "material")?, n, k) {
        (None, Some(n), Some(k)) => Ok(format!("n = {n}, k = {k}")),
        (Some(name), None, None) => match constants::find(name) {
            Ok(found) => {
                importer.note(format!(
                    "`{name}` is taken from sunstone's own optical constants ({})",
                    found.source
                ));
                Ok(format!("metal = {}", quoted(&found.name)))
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
fn one(importer: &mut Importer, node: &Node, name: &str) -> Result<(), InputError> {
    match importer.spectrum(node, name)?.as_deref() {
        None | Some("1") => Ok(()),
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

/// The angle of a sheet in degrees, Mitsuba's way round.
fn angle(importer: &Importer, node: &Node) -> Result<f64, InputError> {
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
fn facets<'a>(
    importer: &mut Importer<'a>,
    node: &'a Node,
    images: &mut Upright,
) -> Result<String, InputError> {
    let source = importer.source;
    let kind = node
        .text(source, "distribution")?
        .unwrap_or("beckmann")
        .to_lowercase();
    if !["beckmann", "ggx"].contains(&kind.as_str()) {
        return importer.error(
            &node.span,
            format!("there is no distribution `{kind}`"),
            "use beckmann or ggx",
        );
    }
    let alpha = match (node.float(source, "alpha_u")?, node.float(source, "alpha_v")?) {
        (None, None) => scalar(importer, node, "alpha", Some(0.1), images)?,
        (Some(u), Some(v)) if u == v => digits(u),
        _ => {
            return importer.error(
                &node.span,
                "sunstone's rough surfaces are isotropic",
                "give one alpha",
            );
        }
    };
    Ok(format!(
        "alpha = {alpha}, distribution = \"{kind}\", masking = \"separable\""
    ))
}

/// A number or an image.
fn scalar<'a>(
    importer: &mut Importer<'a>,
    node: &'a Node,
    name: &str,
    missing: Option<f64>,
    images: &mut Upright,
) -> Result<String, InputError> {
    if let Some(child) = node.named(name) {
        let inner = importer.resolve(child)?;
        if inner.tag == "texture" {
            let file = bitmap(importer, inner, true, images)?;
            return Ok(format!("{{ image = {file} }}"));
        }
    }
    match node.float(importer.source, name)?.or(missing) {
        Some(v) => Ok(digits(v)),
        None => importer.error(
            &node.span,
            format!("{} lacks `{name}`", node.kind),
            "give it as <float> or a bitmap",
        ),
    }
}

/// A spectrum, or an image of colours.
fn albedo<'a>(
    importer: &mut Importer<'a>,
    node: &'a Node,
    name: &str,
    missing: &str,
    images: &mut Upright,
) -> Result<String, InputError> {
    if let Some(child) = node.named(name) {
        let inner = importer.resolve(child)?;
        if inner.tag == "texture" {
            let file = bitmap(importer, inner, false, images)?;
            return Ok(format!("{{ image = {file} }}"));
        }
    }
    Ok(importer
        .spectrum(node, name)?
        .unwrap_or_else(|| missing.to_owned()))
}

/// The file of a bitmap, as a TOML string.
fn bitmap(importer: &Importer, node: &Node, raw: bool, images: &mut Upright) -> Result<String, InputError> {
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
    Ok(importer.file(name))
}

//! Converts Mitsuba's BSDFs to materials of a scene file.
//!
//! Mitsuba's opaque BSDFs are black from behind unless they are in `twosided`. Opaque BSDFs outside of
//! `twosided` become `two_sided` materials without a back material.

use super::import_layered;
use super::import_surfaces::{
    Coordinates, Facets, albedo, angle, bitmap, facets, indices, metal, one, scalar,
};
use super::import_table::Table;
use super::importer::Importer;
use super::tree::Node;
use base::locate::{InputError, Located};
use image::{DynamicImage, ImageBuffer, ImageFormat};
use import::picture;
use std::collections::BTreeMap;
use syntax::material::{
    BlendFile, BumpMapFile, ConductorFile, DielectricFile, DiffuseFile, InterreflectionFile, MaterialFile,
    MeasuredFile, NormalMapFile, NullFile, PassageFile, PlasticFile, PolarizerFile, RetarderFile,
    RoughConductorFile, RoughDielectricFile, TiltFile, TwoSidedFile,
};
use syntax::texture::{AlbedoFile, ImageAlbedo};
use syntax::values::IndexFile;
use transport::material::polarizer::Passes;

/// Names of the supported BSDFs. Error messages list these names.
const KNOWN: &str = "diffuse, conductor, roughconductor, dielectric, thindielectric, roughdielectric, plastic, roughplastic, \
    pplastic, principled, measured_polarized, polarizer, circular, retarder, blendbsdf, twosided, mask, normalmap, \
    bumpmap, null";

/// Names of the BSDFs that are black from behind.
const OPAQUE: [&str; 7] =
    ["diffuse", "conductor", "roughconductor", "plastic", "roughplastic", "pplastic", "measured_polarized"];

/// Maximum nesting depth of BSDFs.
const MOST_NESTED: usize = 14;

/// Converts BSDFs to materials. Each BSDF is converted only once.
#[derive(Default)]
pub(super) struct MaterialReader {
    pub table: Table,
    /// Name of the material made from each BSDF.
    done: BTreeMap<Key, String>,
    /// Byte offsets at which the BSDFs that are being read begin, outermost first.
    open: Vec<usize>,
}

/// Identifies a material made from a BSDF.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    /// Byte offset at which the BSDF begins.
    start: usize,
    /// Whether the BSDF is inside of `twosided`, where opaque BSDFs are visible from both sides.
    both: bool,
    /// Whether the material is for shapes whose v coordinate Mitsuba flips.
    turned: bool,
}

pub(super) struct Made {
    pub name: String,
    pub images: bool,
}

impl MaterialReader {
    /// Returns the name of a BSDF's material. `turned` is true for shapes whose v coordinate Mitsuba flips.
    /// Errors are recorded, not returned.
    pub fn named<'a>(&mut self, importer: &mut Importer<'a>, node: &'a Node, turned: bool) -> Made {
        let open = self.open.len();
        if node.broken {
            return self.missing();
        }
        let made = self.material(importer, node, false, turned, None);
        importer.source.accept(made).unwrap_or_else(|| {
            self.open.truncate(open);
            self.missing()
        })
    }

    /// Returns a substitute for an invalid BSDF, so that the rest of the scene can be read.
    fn missing(&mut self) -> Made {
        Made { name: self.table.of_bare_shapes(), images: false }
    }

    /// Returns the material of a BSDF. Inside of `twosided`, `both` is true and opaque BSDFs are visible from
    /// both sides. If `outer` is given and has an id, this id is the material's name.
    fn material<'a>(
        &mut self,
        importer: &mut Importer<'a>,
        node: &'a Node,
        both: bool,
        turned: bool,
        outer: Option<&'a Node>,
    ) -> Result<Made, InputError> {
        if node.tag != "bsdf" {
            return importer.error(
                &node.span,
                format!("expected a bsdf, got a {}", node.tag),
                "refer to a bsdf element",
            );
        }
        let start = node.span.start;
        let key = Key { start, both, turned };
        if let Some(name) = self.done.get(&key) {
            let other = Key { turned: !turned, ..key };
            let images = self.done.get(&other) != Some(name);
            let name = name.clone();
            return Ok(Made { name, images });
        }
        if self.open.contains(&start) {
            return importer.error(&node.span, "the bsdf refers to itself", "remove the reference");
        }
        if self.open.len() > MOST_NESTED {
            return importer.error(
                &node.span,
                format!("the bsdf is nested more than {MOST_NESTED} levels deep"),
                &format!("nest bsdfs at most {MOST_NESTED} levels deep"),
            );
        }
        self.open.push(start);
        let made = match single_inside(importer, node)? {
            Some(inner) => self.material(importer, inner, true, turned, outer.or(Some(node)))?,
            None => self.own(importer, node, both, turned, outer)?,
        };
        self.open.pop();
        self.done.insert(key, made.name.clone());
        if !made.images {
            let other = Key { turned: !turned, ..key };
            self.done.insert(other, made.name.clone());
        }
        Ok(made)
    }

    fn own<'a>(
        &mut self,
        importer: &mut Importer<'a>,
        node: &'a Node,
        both: bool,
        turned: bool,
        outer: Option<&'a Node>,
    ) -> Result<Made, InputError> {
        let named = outer.filter(|o| o.id.is_some()).unwrap_or(node);
        let wanted = named.id.clone().unwrap_or_else(|| node.kind.clone());
        let mut uv = Coordinates { turned, images: false };
        let (body, opaque) = self.body(importer, node, both, &wanted, &mut uv)?;
        let name = if opaque && !both {
            self.table.add_front(node, &wanted, body)
        } else {
            self.table.add(node, &wanted, body)
        };
        let images = uv.images;
        Ok(Made { name: (*name).clone(), images })
    }

    /// Converts a BSDF and returns whether the material is black from behind.
    fn body<'a>(
        &mut self,
        importer: &mut Importer<'a>,
        node: &'a Node,
        both: bool,
        wanted: &str,
        uv: &mut Coordinates,
    ) -> Result<(MaterialFile, bool), InputError> {
        let source = importer.source;
        let body = match node.kind.as_str() {
            "diffuse" => {
                MaterialFile::Diffuse(DiffuseFile { albedo: albedo(importer, node, "reflectance", 0.5, uv)? })
            }
            "conductor" => MaterialFile::Conductor(metal(importer, node, uv)?),
            "roughconductor" => {
                let ConductorFile { metal, n, k, reflectance } = metal(importer, node, uv)?;
                let Facets { alpha, distribution, masking } = facets(importer, node, uv)?;
                let metal = RoughConductorFile { metal, n, k, reflectance, alpha, distribution, masking };
                MaterialFile::RoughConductor(metal)
            }
            "dielectric" | "thindielectric" | "roughdielectric" => {
                let [ior, exterior_ior] = indices(importer, node, 1.5046)?;
                for name in ["specular_reflectance", "specular_transmittance"] {
                    one(importer, node, name)?;
                }
                if node.kind == "dielectric" {
                    MaterialFile::Dielectric(DielectricFile { ior, exterior_ior })
                } else if node.kind == "thindielectric" {
                    importer.note("thin glass is polarized in Sunstone, but not in Mitsuba (thindielectric)");
                    MaterialFile::ThinDielectric(DielectricFile { ior, exterior_ior })
                } else {
                    let Facets { alpha, distribution, masking } = facets(importer, node, uv)?;
                    importer
                        .note("rough glass is polarized in Sunstone, but not in Mitsuba (roughdielectric)");
                    let glass = RoughDielectricFile { ior, exterior_ior, alpha, distribution, masking };
                    MaterialFile::RoughDielectric(glass)
                }
            }
            "pplastic" => MaterialFile::Plastic(Box::new(plastic(importer, node, uv)?)),
            "measured_polarized" => MaterialFile::Measured(measured(importer, node)?),
            kind @ ("polarizer" | "circular") => {
                let linear = kind == "polarizer";
                if linear && node.boolean(source, "polarizing")? == Some(false) {
                    return importer.error(
                        &node.span,
                        "polarizing = false is not supported",
                        "remove `polarizing`, or remove the polarizer",
                    );
                }
                // Mitsuba measures the angle clockwise. Rotation has no effect on a circular polarizer.
                let angle = -angle(importer, node)? + 0.0;
                let left = !linear && node.boolean(source, "left_handed")?.unwrap_or(false);
                let circular = if left { Passes::Left } else { Passes::Right };
                MaterialFile::Polarizer(PolarizerFile {
                    angle_deg: linear.then(|| node.at(angle)),
                    axis: None,
                    passes: if linear { Passes::Linear } else { circular },
                    transmittance: importer.spectrum_or(node, "transmittance", 1.0)?,
                    extinction: node.at(0.0.into()),
                })
            }
            "retarder" => {
                importer.note("at oblique incidence the axis of Mitsuba's retarder is not fixed in space, unlike Sunstone's");
                MaterialFile::Retarder(RetarderFile {
                    angle_deg: Some(node.at(angle(importer, node)?)),
                    axis: None,
                    retardance_deg: Some(importer.spectrum_or(node, "delta", 90.0)?),
                    retardance_nm: None,
                    transmittance: importer.spectrum_or(node, "transmittance", 1.0)?,
                    tilt: TiltFile::Cosine,
                    ior: None,
                })
            }
            "twosided" => {
                one_way(importer, node)?;
                let [front, back] = self.nested(importer, node, true, uv)?;
                MaterialFile::TwoSided(TwoSidedFile { front, back: Some(back) })
            }
            "blendbsdf" => {
                let weight = scalar(importer, node, "weight", None, uv)?;
                let [a, b] = self.nested(importer, node, both, uv)?;
                MaterialFile::Blend(BlendFile { a, b, weight })
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
                let image = if texture.kind == "rawconstant" {
                    constant(importer, texture)?
                } else {
                    bitmap(importer, texture, false, uv)?
                };
                if !image.raw {
                    return importer.error(
                        &texture.span,
                        "a normal map must be raw: Sunstone does not convert its values",
                        "add <boolean name=\"raw\" value=\"true\"/>",
                    );
                }
                let material = self.turned(importer, node, both, uv)?;
                MaterialFile::NormalMap(NormalMapFile {
                    material,
                    image: image.image,
                    strength: node.at(1.0),
                    uv: image.uv,
                    wrap: image.wrap,
                    filter: image.filter,
                    layer: None,
                })
            }
            "bumpmap" => {
                let Some(texture) = heights(importer, node)? else {
                    return importer.error(&node.span, "the bump map has no texture", "add a bitmap");
                };
                let image = bitmap(importer, texture, true, uv)?;
                let height = node.float(source, "scale")?.unwrap_or(1.0);
                let material = self.turned(importer, node, both, uv)?;
                MaterialFile::BumpMap(BumpMapFile {
                    material,
                    image: node.at(image),
                    height: node.at(height),
                })
            }
            "null" => MaterialFile::Null(NullFile {}),
            "mask" => {
                let opacity = scalar(importer, node, "opacity", Some(0.5), uv)?;
                let [inner] = self.nested(importer, node, both, uv)?;
                let hole = self.table.add(node, &format!("{wanted}_hole"), MaterialFile::Null(NullFile {}));
                MaterialFile::Blend(BlendFile { a: hole, b: inner, weight: opacity })
            }
            "plastic" | "roughplastic" => {
                MaterialFile::Plastic(Box::new(import_layered::plastic(importer, node, uv)?))
            }
            "principled" => return import_layered::principled(importer, &mut self.table, node, wanted, uv),
            other => {
                return importer.error(
                    &node.span,
                    format!("unsupported bsdf `{other}`"),
                    &format!("use one of: {KNOWN}"),
                );
            }
        };
        node.finish(source, &["sample_visible", "alpha_sample"]);
        Ok((body, OPAQUE.contains(&node.kind.as_str())))
    }

    /// Returns the material to which a normal or bump map applies.
    fn turned<'a>(
        &mut self,
        importer: &mut Importer<'a>,
        node: &'a Node,
        both: bool,
        uv: &mut Coordinates,
    ) -> Result<Located<String>, InputError> {
        // Brightness differences, measured with Mitsuba's scene of a tiled sphere, `test_bumpmap_path.xml`.
        for (name, difference) in
            [("flip_invalid_normals", "1.3 % brighter"), ("use_shadowing_function", "0.8 % darker")]
        {
            if node.boolean(importer.source, name)?.unwrap_or(true) {
                importer.note(format!(
                    "{name} of normal maps is not used; in Mitsuba this parameter makes a test scene {difference}"
                ));
            }
        }
        let [material] = self.nested(importer, node, both, uv)?;
        Ok(material)
    }

    /// Returns the materials of the `N` nested BSDFs.
    fn nested<'a, const N: usize>(
        &mut self,
        importer: &mut Importer<'a>,
        node: &'a Node,
        both: bool,
        uv: &mut Coordinates,
    ) -> Result<[Located<String>; N], InputError> {
        let mut names = vec![];
        for child in node.children() {
            if !["bsdf", "ref"].contains(&child.tag()) {
                continue;
            }
            let inner = importer.resolve(child)?;
            if inner.tag == "texture" {
                continue;
            }
            let made = self.material(importer, inner, both, uv.turned, None)?;
            uv.images |= made.images;
            names.push(inner.at(made.name));
        }
        names.try_into().or_else(|names: Vec<_>| {
            importer.error(
                &node.span,
                format!("expected {N} nested bsdfs, got {} in {}", names.len(), node.kind),
                &format!("give exactly {N} nested bsdfs"),
            )
        })
    }
}

/// Returns the texture of a bump map. The texture can have any property name.
fn heights<'a>(importer: &Importer<'a>, node: &'a Node) -> Result<Option<&'a Node>, InputError> {
    for child in node.children() {
        let inner = importer.resolve(child)?;
        if inner.tag == "texture" {
            return Ok(Some(inner));
        }
    }
    Ok(None)
}

/// Writes an image of one texel to a file next to the scene file.
fn constant(importer: &mut Importer, node: &Node) -> Result<ImageAlbedo, InputError> {
    let Some(value) = node.vector(importer.source, "value")? else {
        return importer.error(&node.span, "the rawconstant has no vector", "add <vector name=\"value\">");
    };
    node.finish(importer.source, &[]);
    let pixel = image::Rgb(value.as_vec3().to_array());
    let image = DynamicImage::ImageRgb32F(ImageBuffer::from_pixel(1, 1, pixel));
    let bytes = picture::encoded(&image, ImageFormat::OpenExr).map_err(|e| {
        let what = format!("cannot encode an image: {e}");
        importer.source.error(&node.span, what, "use a bitmap")
    })?;
    let mut file = ImageAlbedo::new(importer.make("constant", "exr", bytes));
    file.raw = true;
    Ok(file)
}

/// If a plugin is a `twosided` with exactly one BSDF, returns this BSDF, which is visible from both sides.
fn single_inside<'a>(importer: &Importer<'a>, node: &'a Node) -> Result<Option<&'a Node>, InputError> {
    if node.kind != "twosided" || node.children().len() != 1 {
        return Ok(None);
    }
    one_way(importer, node)?;
    let inner = importer.resolve(&node.children()[0])?;
    node.finish(importer.source, &[]);
    Ok(Some(inner))
}

/// Refuses a `twosided` with `allow_transmission`.
fn one_way(importer: &Importer, node: &Node) -> Result<(), InputError> {
    if node.boolean(importer.source, "allow_transmission")? == Some(true) {
        return importer.error(
            &node.span,
            "allow_transmission of twosided is not supported",
            "remove allow_transmission",
        );
    }
    Ok(())
}

fn plastic<'a>(
    importer: &mut Importer<'a>,
    node: &'a Node,
    uv: &mut Coordinates,
) -> Result<PlasticFile, InputError> {
    let albedo: Located<AlbedoFile> = albedo(importer, node, "diffuse_reflectance", 0.5, uv)?;
    let specular = importer.spectrum_or(node, "specular_reflectance", 1.0)?;
    let [ior, exterior_ior] = match importer.spectrum(node, "eta")? {
        Some(eta) => [Located::at(eta.span(), IndexFile::Values((*eta).clone())), node.at(1.0.into())],
        None => indices(importer, node, 1.49)?,
    };
    let Facets { alpha, distribution, masking } = facets(importer, node, uv)?;
    Ok(PlasticFile {
        albedo,
        ior,
        exterior_ior,
        specular,
        single_scatter: None,
        interreflection: InterreflectionFile::Lost,
        passage: PassageFile::Smooth,
        alpha,
        distribution,
        masking,
    })
}

fn measured(importer: &Importer, node: &Node) -> Result<MeasuredFile, InputError> {
    let name = importer.filename(node, "table")?;
    if let Some(nm) = node.float(importer.source, "wavelength")?
        && nm >= 0.0
        && importer.wavelengths != [nm]
    {
        return importer.error(
            &node.span,
            format!(
                "the bsdf evaluates the table only at {nm} nm, but the scene has the wavelengths {:?} nm",
                importer.wavelengths
            ),
            "remove `wavelength`, or set the scene's wavelength: -D wavelengths_nm=…",
        );
    }
    Ok(MeasuredFile { file: node.at(importer.file(name)), even_axes: false })
}

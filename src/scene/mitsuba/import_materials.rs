//! Mitsuba's BSDFs → materials of a scene file.
//!
//! Opaque BSDFs are black from behind unless `twosided` stands round them; what is bare becomes `two_sided` with a front
//! alone.

use super::import_surfaces::{Upright, albedo, angle, bitmap, facets, indices, metal, one, scalar};
use super::importer::Importer;
use super::names::plain;
use super::tree::Node;
use base::locate::{InputError, Located};
use std::collections::{BTreeMap, BTreeSet};
use syntax::material::{
    BlendFile, ConductorFile, DielectricFile, DiffuseFile, MaterialFile, MeasuredFile, NormalMapFile,
    PlasticFile, PolarizerFile, RetarderFile, RoughConductorFile, RoughDielectricFile, TiltFile,
    TwoSidedFile,
};
use syntax::texture::AlbedoFile;
use syntax::values::IndexFile;
use transport::material::texture::{Filter, Wrap};

/// Reads BSDFs, each once.
#[derive(Default)]
pub(super) struct MaterialReader {
    /// The materials so far, by name.
    pub materials: BTreeMap<String, Located<MaterialFile>>,
    /// Name of the material of the BSDF that begins at a byte, alone and inside of `twosided`.
    done: BTreeMap<(usize, bool), String>,
    taken: BTreeSet<String>,
    upright: BTreeMap<String, Upright>,
    /// Bytes at which the BSDFs begin that are being read, outermost first.
    open: Vec<usize>,
}

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
            let two_sided = MaterialFile::two_sided(inner.clone(), None);
            self.materials.insert(inner, MaterialFile::diffuse(0.5).into());
            self.materials.insert(name.clone(), two_sided.into());
        }
        name
    }

    /// Which way up the images of a material are.
    pub fn images(&self, name: &str) -> Upright {
        self.upright.get(name).copied().unwrap_or_default()
    }

    /// A name that is free, like the wanted one.
    fn free(&mut self, wanted: &str) -> String {
        let base = plain(wanted);
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
            let two_sided = MaterialFile::TwoSided(TwoSidedFile {
                front: at(node, front.clone()),
                back: None,
            });
            self.materials.insert(front, at(node, body));
            self.materials.insert(name.clone(), at(node, two_sided));
            name
        } else {
            let name = self.free(&wanted);
            self.materials.insert(name.clone(), at(node, body));
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
    ) -> Result<(MaterialFile, Upright), InputError> {
        let source = importer.source;
        let mut images = Upright::NoImages;
        let body = match node.kind.as_str() {
            "diffuse" => MaterialFile::Diffuse(DiffuseFile {
                albedo: albedo(importer, node, "reflectance", 0.5, &mut images)?,
            }),
            "conductor" => {
                let (metal, n, k) = metal(importer, node)?;
                MaterialFile::Conductor(ConductorFile { metal, n, k })
            }
            "roughconductor" => {
                let (metal, n, k) = metal(importer, node)?;
                let facets = facets(importer, node, &mut images)?;
                MaterialFile::RoughConductor(RoughConductorFile {
                    metal,
                    n,
                    k,
                    alpha: facets.alpha,
                    distribution: facets.distribution,
                    masking: facets.masking,
                })
            }
            "dielectric" | "thindielectric" | "roughdielectric" => {
                let [ior, exterior_ior] = indices(importer, node, 1.5046)?;
                for name in ["specular_reflectance", "specular_transmittance"] {
                    one(importer, node, name)?;
                }
                if node.kind == "dielectric" {
                    MaterialFile::Dielectric(DielectricFile { ior, exterior_ior })
                } else if node.kind == "thindielectric" {
                    importer.note("thin glass is polarized in sunstone; Mitsuba's thindielectric is not");
                    MaterialFile::ThinDielectric(DielectricFile { ior, exterior_ior })
                } else {
                    let facets = facets(importer, node, &mut images)?;
                    importer.note("rough glass is polarized in sunstone; Mitsuba's roughdielectric is not");
                    MaterialFile::RoughDielectric(RoughDielectricFile {
                        ior,
                        exterior_ior,
                        alpha: facets.alpha,
                        distribution: facets.distribution,
                        masking: facets.masking,
                    })
                }
            }
            "pplastic" => MaterialFile::Plastic(Box::new(plastic(importer, node, &mut images)?)),
            "measured_polarized" => MaterialFile::Measured(measured(importer, node)?),
            "polarizer" => {
                if node.boolean(source, "polarizing")? == Some(false) {
                    return importer.error(
                        &node.span,
                        "the polarizer does not polarize",
                        "take `polarizing` away, or the polarizer",
                    );
                }
                // Mitsuba turns the axis clockwise.
                let angle = -angle(importer, node)? + 0.0;
                MaterialFile::Polarizer(PolarizerFile {
                    angle_deg: Some(at(node, angle)),
                    axis: None,
                    transmittance: importer.spectrum_or(node, "transmittance", 1.0)?,
                    extinction: at(node, 0.0.into()),
                })
            }
            "retarder" => {
                importer.note("off the normal, the axis of Mitsuba's retarder is no line in space; ours is");
                MaterialFile::Retarder(RetarderFile {
                    angle_deg: Some(at(node, angle(importer, node)?)),
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
                let [front, back] = self.nested(importer, node, true, &mut images)?;
                MaterialFile::TwoSided(TwoSidedFile {
                    front,
                    back: Some(back),
                })
            }
            "blendbsdf" => {
                let weight = scalar(importer, node, "weight", None, &mut images)?;
                let [a, b] = self.nested(importer, node, both, &mut images)?;
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
                let image = bitmap(importer, texture, true, &mut images)?;
                for name in ["flip_invalid_normals", "use_shadowing_function"] {
                    if node.boolean(source, name)?.unwrap_or(true) {
                        importer.note(format!("normal maps have no {name} in sunstone"));
                    }
                }
                let [material] = self.nested(importer, node, both, &mut images)?;
                MaterialFile::NormalMap(NormalMapFile {
                    material,
                    image,
                    strength: at(node, 1.0),
                    uv: None,
                    wrap: Wrap::default(),
                    filter: Filter::default(),
                })
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
    fn nested<'a, const N: usize>(
        &mut self,
        importer: &mut Importer<'a>,
        node: &'a Node,
        both: bool,
        images: &mut Upright,
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
            let name = self.material(importer, inner, both, None)?;
            *images = images.and(self.images(&name));
            names.push(at(inner, name));
        }
        names.try_into().or_else(|names: Vec<_>| {
            importer.error(
                &node.span,
                format!("{} bsdfs are inside of {}", names.len(), node.kind),
                &format!("give {N}"),
            )
        })
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

/// What a plugin says.
fn at<T>(node: &Node, value: T) -> Located<T> {
    Located::at(node.span.clone(), value)
}

fn plastic<'a>(
    importer: &Importer<'a>,
    node: &'a Node,
    images: &mut Upright,
) -> Result<PlasticFile, InputError> {
    let albedo: Located<AlbedoFile> = albedo(importer, node, "diffuse_reflectance", 0.5, images)?;
    let specular = importer.spectrum_or(node, "specular_reflectance", 1.0)?;
    let [ior, exterior_ior] = match importer.spectrum(node, "eta")? {
        Some(eta) => [
            Located::at(eta.span(), IndexFile::Values((*eta).clone())),
            at(node, 1.0.into()),
        ],
        None => indices(importer, node, 1.49)?,
    };
    let facets = facets(importer, node, images)?;
    Ok(PlasticFile {
        albedo,
        ior,
        exterior_ior,
        specular,
        single_scatter: None,
        interreflection: false,
        alpha: facets.alpha,
        distribution: facets.distribution,
        masking: facets.masking,
    })
}

fn measured(importer: &Importer, node: &Node) -> Result<MeasuredFile, InputError> {
    let Some(name) = node.text(importer.source, "filename")? else {
        return importer.error(
            &node.span,
            "the table has no filename",
            "add <string name=\"filename\">",
        );
    };
    if let Some(nm) = node.float(importer.source, "wavelength")?
        && nm >= 0.0
        && importer.wavelengths != [nm]
    {
        return importer.error(
            &node.span,
            format!("the table is used at {nm} nm for all wavelengths"),
            "take `wavelength` away, or choose it: -D wavelengths_nm=…",
        );
    }
    Ok(MeasuredFile {
        file: at(node, importer.file(name)),
        even_axes: false,
    })
}

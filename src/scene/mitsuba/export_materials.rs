//! Converts materials to Mitsuba's BSDFs.
//!
//! Opaque materials are two-sided in Sunstone and one-sided in Mitsuba. Each opaque BSDF is therefore wrapped
//! in `twosided`. Blends and normal maps stay outside of `twosided`, so that they also work from both sides.

use super::export_images::{Images, encode, texels};
use super::export_output::{Needs, Output, is_even, plain_id, spectrum};
use super::files::Contents;
use super::xml::{Element, single};
use crate::build::context::Context;
use base::locate::{InputError, Located};
use optics::sampling::microfacet::{Distribution, Masking};
use optics::spectrum::Spectral;
use std::collections::BTreeMap;
use syntax::material::MaterialFile;
use transport::material::dielectric::Dielectric;
use transport::material::facets::Roughness;
use transport::material::plastic::{Interreflection, Plastic};
use transport::material::polarizer::Passes;
use transport::material::retarder::Tilt;
use transport::material::sheet::SheetAxis;
use transport::material::texture::{Scalar, Spectrum};
use transport::material::{Material, Materials};

/// Converts the materials that shapes use to BSDFs.
pub(super) struct MaterialWriter<'a> {
    ctx: &'a Context,
    files: &'a BTreeMap<String, Located<MaterialFile>>,
    table: &'a Materials,
    /// Name of each material by its index.
    names: BTreeMap<u32, &'a str>,
    out: &'a mut Output,
    /// Id of each written BSDF, by material index.
    pub ids: BTreeMap<u32, String>,
    /// Surface properties that each BSDF requires, by material index.
    pub needs: BTreeMap<u32, Needs>,
}

impl<'a> MaterialWriter<'a> {
    pub fn new(
        ctx: &'a Context,
        files: &'a BTreeMap<String, Located<MaterialFile>>,
        table: &'a Materials,
        numbers: &BTreeMap<&'a str, u32>,
        out: &'a mut Output,
    ) -> Self {
        Self {
            ctx,
            files,
            table,
            names: numbers.iter().map(|(name, id)| (*id, *name)).collect(),
            out,
            ids: BTreeMap::new(),
            needs: BTreeMap::new(),
        }
    }

    /// Returns the BSDFs of the materials `used`. Each BSDF comes after the BSDFs to which it refers.
    pub fn all(&mut self, used: &[u32]) -> Result<Vec<Element>, InputError> {
        let mut done = vec![];
        for &id in used {
            self.named(id, &mut done)?;
        }
        Ok(done)
    }

    fn named(&mut self, id: u32, done: &mut Vec<Element>) -> Result<(), InputError> {
        if self.ids.contains_key(&id) {
            return Ok(());
        }
        for inner in self.made_of(id) {
            self.named(inner, done)?;
        }
        let name = plain_id(self.names[&id], &self.ids);
        let needs = self.needs_of(id);
        let bsdf = self.bsdf(id, &name)?;
        self.ids.insert(id, name);
        self.needs.insert(id, needs);
        done.push(bsdf);
        Ok(())
    }

    /// Returns the indices of the materials to which a material refers in the XML. The materials of a
    /// `two_sided` material are nested in its element and are not returned.
    fn made_of(&self, id: u32) -> Vec<u32> {
        match self.table.list[id as usize] {
            Material::Blend(b) => vec![b.a, b.b],
            Material::NormalMap(n) => vec![n.material],
            _ => vec![],
        }
    }

    fn needs_of(&self, id: u32) -> Needs {
        let uv = |used: bool| Needs { uv: used, tangent: false };
        let rough = |r: &Roughness| r.alpha.texture.is_some();
        let both = |a: Needs, b: Needs| Needs { uv: a.uv || b.uv, tangent: a.tangent || b.tangent };
        let directed = Needs { uv: true, tangent: true };
        match &self.table.list[id as usize] {
            Material::Diffuse(d) => uv(d.albedo.texture.is_some()),
            Material::Conductor(c) => uv(c.reflectance.texture.is_some()),
            Material::RoughConductor(c) => uv(rough(&c.roughness) || c.reflectance.texture.is_some()),
            Material::RoughDielectric(d) => uv(rough(&d.roughness)),
            Material::Plastic(p) => uv(rough(&p.roughness) || p.albedo.texture.is_some()),
            Material::Polarizer(_) | Material::Retarder(_) | Material::NormalMap(_) => directed,
            Material::Blend(b) => {
                both(uv(b.weight.texture.is_some()), both(self.needs_of(b.a), self.needs_of(b.b)))
            }
            Material::TwoSided(t) => t.sides().map(|m| self.needs_of(m)).fold(uv(false), both),
            _ => uv(false),
        }
    }

    /// Returns the error for a property that Mitsuba cannot express.
    fn cannot<T>(&self, id: u32, what: &str, fix: &str) -> Result<T, InputError> {
        let name = self.names[&id];
        let message = format!("Mitsuba cannot express {what} (material `{name}`)");
        Err(self.ctx.error(self.files[name].span(), message, fix))
    }

    /// Returns the BSDF element of a material, with the id `name`. The BSDF is visible from both sides.
    fn bsdf(&mut self, id: u32, name: &str) -> Result<Element, InputError> {
        let open = |kind: &str| Element::plugin("bsdf", kind).with("id", name);
        Ok(match self.table.list[id as usize] {
            Material::Dielectric(d) => self.interface(id, open("dielectric"), &d)?,
            Material::RoughDielectric(d) => {
                self.out.note(format!(
                    "material `{}`: Mitsuba's roughdielectric is not polarized; only M00 of the Mueller matrix agrees",
                    self.names[&id]
                ));
                let element = self.interface(id, open("roughdielectric"), &d.interface)?;
                self.roughness(id, element, &d.roughness)?
            }
            Material::Null => open("null"),
            Material::ThinDielectric(d) => {
                self.out.note(format!(
                    "material `{}`: Mitsuba's thindielectric is not polarized and averages both polarizations before summing reflections; the results differ at oblique incidence",
                    self.names[&id]
                ));
                self.interface(id, open("thindielectric"), &d.interface)?
            }
            Material::Polarizer(p) => {
                if p.extinction.to_array() != [0.0; 4] {
                    return self.cannot(id, "a polarizer with extinction", "remove extinction");
                }
                if p.passes != Passes::Linear {
                    let left = p.passes == Passes::Left;
                    let out = open("circular").boolean("left_handed", left);
                    return Ok(out.child(self.spectrum("transmittance", p.transmittance)));
                }
                open("polarizer")
                    .float("theta", degrees(-self.angle(id, p.axis)?))
                    .child(self.spectrum("transmittance", p.transmittance))
            }
            Material::Retarder(r) => {
                if r.tilt != Tilt::Cosine {
                    return self.cannot(
                        id,
                        "the dependence of the retardance on the angle of incidence for tilt = \"plate\" or \"constant\"",
                        "use tilt = \"cosine\" without ior (equivalent at normal incidence)",
                    );
                }
                let angle = self.angle(id, r.axis)?;
                self.out.note(format!(
                    "material `{}`: at oblique incidence the axis of Mitsuba's retarder is not fixed in space, unlike Sunstone's",
                    self.names[&id]
                ));
                let delta = r.retardance.to_array().map(|d| degrees(d) as f32);
                open("retarder")
                    .float("theta", degrees(angle))
                    .child(self.spectrum("delta", Spectral::new(delta)))
                    .child(self.spectrum("transmittance", r.transmittance))
            }
            Material::TwoSided(t) => {
                let front = self.one_sided(t.front, None)?;
                let back = match t.back {
                    Some(back) => self.one_sided(back, None)?,
                    None => Element::plugin("bsdf", "diffuse")
                        .child(Element::new("spectrum").with("name", "reflectance").with("value", "0")),
                };
                open("twosided").child(front).child(back)
            }
            Material::Blend(b) => {
                let (a, b_id) = (self.ids[&b.a].clone(), self.ids[&b.b].clone());
                open("blendbsdf")
                    .child(self.scalar(id, "weight", b.weight)?)
                    .child(Element::new("ref").with("id", a))
                    .child(Element::new("ref").with("id", b_id))
            }
            Material::NormalMap(n) => {
                if !matches!(self.table.list[n.material as usize], Material::Diffuse(_)) {
                    self.out.note(format!(
                        "material `{}`: Mitsuba does not rotate Stokes frames with mapped normals; only s0 agrees",
                        self.names[&id]
                    ));
                }
                self.one_sided(id, Some(name))?
            }
            Material::PartialDepolarizer(_) => {
                let fix = "use the nested material, or a measured one";
                return self.cannot(id, "a partial depolarizer", fix);
            }
            Material::CoatedConductor(_) => {
                let fix = "use a conductor, or a measured material";
                return self.cannot(id, "thin films on a conductor", fix);
            }
            Material::Crystal(_) => {
                return self.cannot(id, "a crystal", "use a dielectric of its mean index");
            }
            Material::RoughCrystal(_) => {
                return self.cannot(id, "a crystal", "use a rough_dielectric of its mean index");
            }
            Material::Diffuse(_)
            | Material::Conductor(_)
            | Material::RoughConductor(_)
            | Material::Plastic(_)
            | Material::Measured(_) => {
                if !matches!(self.table.list[id as usize], Material::Diffuse(_)) {
                    self.out.note(
                        "Mitsuba's twosided flips the signs of the coupling between (s0, s1) and (s2, s3) on back faces; \
                         orient the front faces of polarizing surfaces toward the light",
                    );
                }
                open("twosided").child(self.one_sided(id, None)?)
            }
        })
    }

    /// Returns the BSDF of a material's front side. The BSDF is black or undefined from behind.
    fn one_sided(&mut self, id: u32, name: Option<&str>) -> Result<Element, InputError> {
        let open = |kind: &str| {
            let element = Element::plugin("bsdf", kind);
            match name {
                Some(name) => element.with("id", name),
                None => element,
            }
        };
        Ok(match self.table.list[id as usize] {
            Material::Diffuse(d) => open("diffuse").child(self.albedo(id, "reflectance", d.albedo)?),
            Material::Conductor(c) => self.metal(id, open("conductor"), [c.n, c.k], c.reflectance)?,
            Material::RoughConductor(c) => {
                let element = self.metal(id, open("roughconductor"), [c.n, c.k], c.reflectance)?;
                self.roughness(id, element, &c.roughness)?
            }
            Material::Plastic(p) => self.plastic(id, open("pplastic"), &p)?,
            Material::Measured(_) => self.measured(id, open("measured_polarized"))?,
            Material::NormalMap(n) => {
                let map = if n.heights {
                    let image = self.images(id).heights(n.texture)?;
                    open("bumpmap").child(image).float("scale", f64::from(n.strength))
                } else if n.strength == 1.0 {
                    open("normalmap").child(self.images(id).normals(n.texture)?)
                } else {
                    return self.cannot(
                        id,
                        "the strength of a normal map",
                        "apply the strength to the image, and remove `strength`",
                    );
                };
                let inner = match self.ids.get(&n.material) {
                    Some(inner) => Element::new("ref").with("id", inner.as_str()),
                    None => self.one_sided(n.material, None)?,
                };
                map.boolean("flip_invalid_normals", false)
                    .boolean("use_shadowing_function", false)
                    .child(inner)
            }
            Material::Blend(b) => {
                let (first, second) = (self.one_sided(b.a, None)?, self.one_sided(b.b, None)?);
                open("blendbsdf").child(self.scalar(id, "weight", b.weight)?).child(first).child(second)
            }
            _ => {
                return self.cannot(
                    id,
                    "one side of this material",
                    "use opaque materials in two_sided: diffuse, metals, plastic, measured, or blends of them",
                );
            }
        })
    }

    fn spectrum(&self, name: &str, value: Spectral) -> Element {
        spectrum(&self.ctx.wavelengths, name, value)
    }

    fn angle(&self, id: u32, axis: SheetAxis) -> Result<f32, InputError> {
        match axis {
            SheetAxis::Angle(angle) => Ok(angle),
            SheetAxis::World(_) => self.cannot(id, "an axis in world space", "give angle_deg instead"),
        }
    }

    fn dispersive<T>(&self, id: u32) -> Result<T, InputError> {
        let fix = "export one wavelength (--wavelength), or give a constant index";
        self.cannot(id, "a wavelength-dependent refractive index", fix)
    }

    fn interface(&self, id: u32, element: Element, d: &Dielectric) -> Result<Element, InputError> {
        if d.dispersive {
            return self.dispersive(id);
        }
        let first = |s: Spectral| shortest(s.to_array()[0]);
        Ok(element.float("int_ior", first(d.interior)).float("ext_ior", first(d.exterior)))
    }

    fn metal(
        &mut self,
        id: u32,
        element: Element,
        [n, k]: [Spectral; 2],
        reflectance: Spectrum,
    ) -> Result<Element, InputError> {
        let element = element.child(self.spectrum("eta", n)).child(self.spectrum("k", k));
        let whole = reflectance.texture.is_none() && is_even(&self.ctx.wavelengths, reflectance.value);
        if whole && reflectance.value.to_array()[0] == 1.0 {
            return Ok(element);
        }
        Ok(element.child(self.albedo(id, "specular_reflectance", reflectance)?))
    }

    fn plastic(&mut self, id: u32, element: Element, p: &Plastic) -> Result<Element, InputError> {
        if p.interreflection != Interreflection::Lost || p.passage.is_some() {
            return self.unpolarized_plastic(id, element, p);
        }
        if p.single_scatter.is_some() {
            return self.cannot(id, "single scattering inside a polarized plastic", "remove single_scatter");
        }
        let element = element.child(self.albedo(id, "diffuse_reflectance", p.albedo)?);
        let element = if is_even(&self.ctx.wavelengths, p.eta) {
            element.float("int_ior", shortest(p.eta.to_array()[0])).float("ext_ior", 1.0)
        } else {
            element.child(self.spectrum("eta", p.eta))
        };
        let element = element.child(self.spectrum("specular_reflectance", p.specular));
        self.roughness(id, element, &p.roughness)
    }

    /// Returns Mitsuba's `plastic` for a smooth coat, or `roughplastic` if light enters and leaves through
    /// one facet. Both BSDFs model interreflection but no polarization.
    fn unpolarized_plastic(&mut self, id: u32, element: Element, p: &Plastic) -> Result<Element, InputError> {
        let smooth = p.roughness.alpha.texture.is_none() && p.roughness.alpha.value <= SMOOTH_COAT;
        let kind = match p.passage {
            Some(table) if table.single && p.roughness.alpha.texture.is_none() => "roughplastic",
            None if smooth => "plastic",
            _ => {
                return self.cannot(
                    id,
                    "this combination of interreflection, passage and roughness",
                    "remove interreflection and passage, or give passage = \"single_facet\" and one alpha",
                );
            }
        };
        if p.interreflection == Interreflection::Lost || p.single_scatter.is_some() {
            return self.cannot(
                id,
                "this plastic, which has single scattering or no interreflection",
                "add interreflection = \"linear\" and remove single_scatter",
            );
        }
        if !is_even(&self.ctx.wavelengths, p.eta) {
            return self.dispersive(id);
        }
        self.out.note(format!(
            "material `{}`: Mitsuba's {kind} is not polarized; only M00 of the Mueller matrix agrees",
            self.names[&id]
        ));
        let element = element
            .with("type", kind)
            .child(self.albedo(id, "diffuse_reflectance", p.albedo)?)
            .child(self.spectrum("specular_reflectance", p.specular))
            .float("int_ior", shortest(p.eta.to_array()[0]))
            .float("ext_ior", 1.0)
            .boolean("nonlinear", matches!(p.interreflection, Interreflection::Coloured(_)));
        match kind {
            "plastic" => Ok(element),
            _ => self.roughness(id, element, &p.roughness),
        }
    }

    fn measured(&mut self, id: u32, element: Element) -> Result<Element, InputError> {
        let MaterialFile::Measured(m) = &*self.files[self.names[&id]] else {
            return self.cannot(id, "a measured table without a file", "give the file of the table");
        };
        if m.even_axes {
            return self.cannot(
                id,
                "a table with empty axes",
                "write the table again with axes: sunstone pbrdf synth",
            );
        }
        let file = format!("{}.pbsdf", plain_id(self.names[&id], &BTreeMap::new()));
        let file = self.out.file(&file, Contents::CopyOf(self.ctx.path(&m.file)));
        let element = element.string("filename", &file);
        Ok(match *self.ctx.wavelengths.nm() {
            [nm] => element.float("wavelength", nm),
            _ => element,
        })
    }

    fn roughness(&mut self, id: u32, element: Element, r: &Roughness) -> Result<Element, InputError> {
        if r.masking == Masking::Correlated {
            self.out.note(format!(
                "material `{}`: Mitsuba uses separable masking G1(wi) G1(wo); Sunstone's height-correlated masking is brighter \
                 at grazing angles. For equal results, set masking = \"separable\"",
                self.names[&id]
            ));
        }
        let kind = match r.distribution {
            Distribution::Ggx => "ggx",
            Distribution::Beckmann => "beckmann",
        };
        Ok(element.string("distribution", kind).child(self.scalar(id, "alpha", r.alpha)?))
    }

    /// Writes a constant number, or a grayscale image of linear values.
    fn scalar(&mut self, id: u32, name: &str, s: Scalar) -> Result<Element, InputError> {
        let Some(texture) = s.texture else {
            return Ok(Element::new("float").with("name", name).with("value", single(s.value)));
        };
        self.images(id).grey(name, texture, true, |texel| texel[0] * s.value)
    }

    /// Writes a constant spectrum, or a grayscale image in sRGB encoding, which both Sunstone and Mitsuba
    /// decode.
    fn albedo(&mut self, id: u32, name: &str, s: Spectrum) -> Result<Element, InputError> {
        let Some(texture) = s.texture else {
            return Ok(self.spectrum(name, s.value));
        };
        let count = self.ctx.wavelengths.count();
        let uneven = |t: &[f32; 4]| t[1..count].iter().any(|v| *v != t[0]);
        if texels(&self.table.textures, texture).1.iter().any(uneven) {
            return self.cannot(
                id,
                "an image of colours at several wavelengths (Mitsuba converts colours to smooth spectra)",
                "export one wavelength (--wavelength), or use a grey image",
            );
        }
        let scale = s.value.to_array()[0];
        self.images(id).grey(name, texture, false, |texel| encode(texel[0] * scale))
    }

    fn images(&mut self, id: u32) -> Images<'_> {
        Images {
            ctx: self.ctx,
            textures: &self.table.textures,
            span: self.files[self.names[&id]].span(),
            stem: plain_id(self.names[&id], &BTreeMap::new()),
            out: &mut *self.out,
        }
    }
}

/// Maximum roughness α of a coat that is exported as smooth.
const SMOOTH_COAT: f32 = 0.001;

/// Converts an angle from radians to degrees, rounded to single precision.
fn degrees(radians: f32) -> f64 {
    shortest((f64::from(radians).to_degrees()) as f32)
}

/// Returns the f64 that has the shortest decimal representation of an f32.
fn shortest(v: f32) -> f64 {
    single(v).parse().unwrap_or(f64::from(v))
}

//! Converts materials of a file to the flat table of [`Materials`].

use super::attributes::{self, Attributes};
use super::context::{Context, read};
use super::indices::{complex_index, index};
use super::polarizing;
use super::textures::{self, Images};
use base::locate::{InputError, Located};
use optics::sampling::microfacet::{Distribution, Masking};
use optics::spectrum::{Spectral, Wavelengths};
use sha2::Digest;
use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};
use std::ops::RangeInclusive;
use std::path::Path;
use syntax::Syntax;
use syntax::material::{InterreflectionFile, MaterialFile, MaterialSetFile, MeasuredFile, PassageFile};
use syntax::texture::{AlbedoFile, ScalarFile};
use syntax::values::IndexFile;
use transport::material::coat::{self, Passage};
use transport::material::dielectric::Dielectric;
use transport::material::facets::Roughness;
use transport::material::measured::error::PbsdfError;
use transport::material::measured::table::{Options, Table};
use transport::material::plastic::Interreflection;
use transport::material::texture::{Scalar, Spectrum, Textures};
use transport::material::{
    Lanes, Material, Materials, blend, conductor, diffuse, measured, normal_map, partial_depolarizer,
    plastic, rough_conductor, rough_crystal, rough_dielectric, thin_dielectric, two_sided, varies,
};

pub struct MaterialSet {
    /// Wavelengths for which the materials were built.
    pub wavelengths: Wavelengths,
    pub materials: Materials,
    /// Index of each material by name.
    pub names: BTreeMap<String, u32>,
}

impl MaterialSet {
    /// Reads a material file (`wavelengths_nm` and `[materials]` as in a scene file) and builds its
    /// materials.
    ///
    /// # Errors
    /// Returns [`InputError`] with file, line, column and fix, if the file cannot be read or is invalid.
    pub fn load(path: &Path) -> Result<Self, InputError> {
        Self::from_text(path, &read(path, "material file")?)
    }

    /// Builds the materials of a material file's text. `path` is the file's path in messages, and its folder
    /// is the base of relative paths.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::load`].
    pub fn from_text(path: &Path, text: &str) -> Result<Self, InputError> {
        let file = MaterialSetFile::read(path, text)?;
        Self::build(Context::new(path, text, &file.wavelengths_nm)?, &file)
    }

    /// Builds materials as [`Self::from_text`] does, for wavelengths other than the file's own. Lists are
    /// interpolated between the file's wavelengths.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::load`].
    pub fn at(path: &Path, text: &str, wavelengths: Wavelengths) -> Result<Self, InputError> {
        let file = MaterialSetFile::read(path, text)?;
        let ctx = Context { wavelengths, ..Context::new(path, text, &file.wavelengths_nm)? };
        Self::build(ctx, &file)
    }

    fn build(mut ctx: Context, file: &MaterialSetFile) -> Result<Self, InputError> {
        let Built { mut table, names } = build(&mut ctx, &file.materials)?;
        table.textures = ctx.textures;
        Ok(Self {
            wavelengths: ctx.wavelengths,
            materials: table,
            names: names.into_iter().map(|(n, id)| (n.to_owned(), id)).collect(),
        })
    }
}

/// Reads the byte ranges of a table's file that identify the table in the scene's hash.
fn pieces(path: &Path, table: &Table) -> std::io::Result<Vec<u8>> {
    let mut file = base::input::open(path)?;
    let mut out = Vec::new();
    for range in table.pieces() {
        let end = out.len();
        out.resize(end + range.len(), 0);
        file.seek(SeekFrom::Start(range.start as u64))?;
        file.read_exact(&mut out[end..])?;
    }
    Ok(out)
}

type Named = BTreeMap<String, Located<MaterialFile>>;

/// Maximum nesting depth of materials.
const MOST_NESTED: usize = 16;

/// The state while materials are built. A material is built before the materials that refer to it.
struct Builder<'c, 'a> {
    ctx: &'c mut Context,
    files: &'a Named,
    table: Materials,
    done: BTreeMap<&'a str, u32>,
    /// Names of the materials being built, outermost first.
    open: Vec<&'a str>,
}

pub(crate) struct Built<'a> {
    pub table: Materials,
    pub names: BTreeMap<&'a str, u32>,
}

pub(crate) fn build<'a>(ctx: &mut Context, files: &'a Named) -> Result<Built<'a>, InputError> {
    let mut builder =
        Builder { ctx, files, table: Materials::default(), done: BTreeMap::new(), open: vec![] };
    builder.ctx.attributes = Attributes::default();
    (builder.ctx.images, builder.ctx.textures) = (Images::default(), Textures::default());
    for name in files.keys() {
        attributes::begin(builder.ctx);
        builder.named(name)?;
    }
    Ok(Built { table: builder.table, names: builder.done })
}

impl<'a> Builder<'_, 'a> {
    fn named(&mut self, name: &'a str) -> Result<u32, InputError> {
        if let Some(id) = self.done.get(name) {
            let id = *id;
            attributes::again(self.ctx, id)?;
            return Ok(id);
        }
        let file = &self.files[name];
        self.open.push(name);
        let outer = attributes::begin(self.ctx);
        let material = self.material(file)?;
        self.open.pop();
        let id = self.table.list.len() as u32;
        self.table.list.push(material);
        attributes::end(self.ctx, id, outer)?;
        self.done.insert(name, id);
        Ok(id)
    }

    /// Builds the material to which another material refers, and returns its index.
    fn inner(&mut self, name: &Located<String>) -> Result<u32, InputError> {
        let files = self.files;
        let Some((key, _)) = files.get_key_value(name.as_str()) else {
            let known = files.keys().map(String::as_str);
            return Err(self.ctx.unknown("material", "materials", name, known));
        };
        let fault = if self.open.contains(&key.as_str()) {
            Some(format!("material `{key}` refers to itself"))
        } else {
            (self.open.len() >= MOST_NESTED)
                .then(|| format!("material `{key}` is nested more than {MOST_NESTED} levels deep"))
        };
        if let Some(fault) = fault {
            let help = format!("nest materials at most {MOST_NESTED} deep and without cycles");
            return Err(self.ctx.error(name.span(), fault, help));
        }
        self.named(key)
    }

    fn material(&mut self, m: &'a Located<MaterialFile>) -> Result<Material, InputError> {
        Ok(match &**m {
            MaterialFile::Diffuse(d) => {
                Material::Diffuse(diffuse::Diffuse { albedo: self.albedo(&d.albedo)? })
            }
            MaterialFile::Conductor(c) => {
                let (n, k) = complex_index(self.ctx, m, &c.metal, &c.n, &c.k)?;
                let reflectance = self.factor(&c.reflectance)?;
                Material::Conductor(conductor::Conductor { n, k, reflectance })
            }
            MaterialFile::RoughConductor(c) => {
                let (n, k) = complex_index(self.ctx, m, &c.metal, &c.n, &c.k)?;
                Material::RoughConductor(rough_conductor::RoughConductor {
                    n,
                    k,
                    reflectance: self.factor(&c.reflectance)?,
                    roughness: self.roughness(&c.alpha, c.distribution, c.masking)?,
                })
            }
            MaterialFile::Null(_) => Material::Null,
            MaterialFile::Dielectric(d) => Material::Dielectric(self.interface(&d.ior, &d.exterior_ior)?),
            MaterialFile::RoughDielectric(d) => {
                Material::RoughDielectric(rough_dielectric::RoughDielectric {
                    interface: self.interface(&d.ior, &d.exterior_ior)?,
                    roughness: self.roughness(&d.alpha, d.distribution, d.masking)?,
                    lanes: Lanes::first(self.ctx.wavelengths.count()),
                })
            }
            MaterialFile::Plastic(p) => {
                let interface = self.interface(&p.ior, &p.exterior_ior)?;
                let eta = interface.interior / interface.exterior;
                let roughness = self.roughness(&p.alpha, p.distribution, p.masking)?;
                let passage = match p.passage {
                    PassageFile::Smooth => Passage::Smooth,
                    PassageFile::Facets => Passage::Facets,
                    PassageFile::SingleFacet => Passage::Single,
                };
                let inside = || coat::internal_reflectance(&roughness, eta, passage);
                Material::Plastic(plastic::Plastic {
                    albedo: self.albedo(&p.albedo)?,
                    eta,
                    roughness,
                    specular: self.ctx.located(&p.specular, "specular", 0.0..=1.0)?,
                    interreflection: match p.interreflection {
                        InterreflectionFile::Lost => Interreflection::Lost,
                        InterreflectionFile::Coloured => Interreflection::Coloured(inside()),
                        InterreflectionFile::Linear => Interreflection::Linear(inside()),
                    },
                    passage: (passage != Passage::Smooth).then(|| {
                        let textures = &mut self.ctx.textures;
                        coat::Table::new(textures, &roughness, eta, passage == Passage::Single)
                    }),
                    single_scatter: p
                        .single_scatter
                        .as_ref()
                        .map(|s| {
                            Ok(plastic::SingleScatter {
                                albedo: self.albedo(&s.albedo)?,
                                alpha: self.alpha(&s.alpha)?,
                            })
                        })
                        .transpose()?,
                })
            }
            MaterialFile::TwoSided(t) => Material::TwoSided(two_sided::TwoSided {
                front: self.inner(&t.front)?,
                back: t.back.as_ref().map(|b| self.inner(b)).transpose()?,
            }),
            MaterialFile::Blend(b) => Material::Blend(blend::Blend {
                a: self.inner(&b.a)?,
                b: self.inner(&b.b)?,
                weight: self.scalar(&b.weight, "weight", 0.0..=1.0)?,
            }),
            MaterialFile::NormalMap(n) => {
                let strength = self.ctx.number(&n.strength, "strength", 0.0..=10.0)?;
                Material::NormalMap(normal_map::NormalMap {
                    material: self.inner(&n.material)?,
                    texture: textures::normals(self.ctx, n)?,
                    strength: strength as f32,
                    heights: false,
                })
            }
            MaterialFile::BumpMap(b) => {
                let height = self.ctx.number(&b.height, "height", -1e6..=1e6)?;
                self.ctx.attributes.has_heights();
                Material::NormalMap(normal_map::NormalMap {
                    material: self.inner(&b.material)?,
                    texture: textures::heights(self.ctx, &b.image)?,
                    strength: height as f32,
                    heights: true,
                })
            }
            MaterialFile::PartialDepolarizer(p) => {
                Material::PartialDepolarizer(partial_depolarizer::PartialDepolarizer {
                    material: self.inner(&p.material)?,
                    fraction: self.scalar(&p.fraction, "fraction", 0.0..=1.0)?,
                })
            }
            MaterialFile::CoatedConductor(c) => {
                Material::CoatedConductor(polarizing::coated(self.ctx, m, c)?)
            }
            MaterialFile::Polarizer(p) => Material::Polarizer(polarizing::polarizer(self.ctx, p)?),
            MaterialFile::ThinDielectric(d) => Material::ThinDielectric(thin_dielectric::ThinDielectric {
                interface: self.interface(&d.ior, &d.exterior_ior)?,
            }),
            MaterialFile::Retarder(r) => Material::Retarder(polarizing::retarder(self.ctx, m, r)?),
            MaterialFile::Crystal(c) => {
                let crystal = polarizing::crystal(self.ctx, m, c)?;
                match &c.roughness {
                    None => Material::Crystal(crystal),
                    Some(alpha) => Material::RoughCrystal(rough_crystal::RoughCrystal {
                        crystal,
                        roughness: self.facets(alpha)?,
                        lanes: Lanes::first(self.ctx.wavelengths.count()),
                    }),
                }
            }
            MaterialFile::Measured(m) => Material::Measured(measured::Measured { table: self.measured(m)? }),
        })
    }

    /// Memory-maps the table of a measured material. Only the byte ranges listed by [`Table::pieces`] enter
    /// the scene's hash, because reading a whole table takes seconds.
    fn measured(&mut self, m: &MeasuredFile) -> Result<u32, InputError> {
        let path = self.ctx.path(&m.file);
        let options = Options { even_axes: m.even_axes, wavelengths: Some(self.ctx.wavelengths.clone()) };
        let refused = |e: PbsdfError| {
            let text = e.to_string();
            let (fault, fix) = text.split_once("; ").unwrap_or((&text, "choose another file"));
            let message = format!("{}: {fault}", path.display());
            self.ctx.error(m.file.span(), message, fix)
        };
        let table = Table::open(&path, &options).map_err(refused)?;
        let pieces = pieces(&path, &table).map_err(|e| refused(PbsdfError::Read(e)))?;
        self.ctx.uses(m.file.as_str());
        self.ctx.hash.update((table.file_len() as u64).to_le_bytes());
        self.ctx.hash.update(&pieces);
        self.table.tables.push(table);
        Ok(self.table.tables.len() as u32 - 1)
    }

    fn albedo(&mut self, albedo: &Located<AlbedoFile>) -> Result<Spectrum, InputError> {
        textures::spectrum(self.ctx, albedo)
    }

    /// Returns the factor by which reflected light is multiplied, per wavelength. Unused lanes are 1.
    fn factor(&mut self, factor: &Located<AlbedoFile>) -> Result<Spectrum, InputError> {
        let spectrum = self.albedo(factor)?;
        Ok(Spectrum { value: spectrum.value + (Spectral::ONE - self.ctx.wavelengths.ones()), ..spectrum })
    }

    /// Returns a number within `range`, or an image whose values are scaled to `range`.
    fn scalar(
        &mut self,
        s: &Located<ScalarFile>,
        what: &str,
        range: RangeInclusive<f64>,
    ) -> Result<Scalar, InputError> {
        textures::scalar(self.ctx, s, what, range)
    }

    fn roughness(
        &mut self,
        alpha: &Located<ScalarFile>,
        distribution: Distribution,
        masking: Masking,
    ) -> Result<Roughness, InputError> {
        Ok(Roughness { distribution, masking, alpha: self.alpha(alpha)? })
    }

    /// Returns the GGX roughness of a crystal's faces.
    fn facets(&mut self, roughness: &Located<ScalarFile>) -> Result<Roughness, InputError> {
        let alpha = self.scalar(roughness, "roughness", 0.001..=1.0).map_err(|mut e| {
            if e.message.starts_with("roughness") {
                e.help = Some("give a value in 0.001..1, or remove roughness for smooth faces".into());
            }
            e
        })?;
        Ok(Roughness { distribution: Distribution::Ggx, masking: Masking::Correlated, alpha })
    }

    fn alpha(&mut self, alpha: &Located<ScalarFile>) -> Result<Scalar, InputError> {
        self.scalar(alpha, "alpha", 0.001..=1.0).map_err(|mut e| {
            if e.message.starts_with("alpha") {
                e.help = Some(
                    "give a value in 0.001..1; for smooth surfaces, use `conductor` or `dielectric`".into(),
                );
            }
            e
        })
    }

    /// Returns the refractive indices inside and outside of a dielectric per wavelength. Unused lanes are 1
    /// to avoid divisions by zero.
    fn interface(
        &mut self,
        interior: &Located<IndexFile>,
        exterior: &Located<IndexFile>,
    ) -> Result<Dielectric, InputError> {
        let unused = Spectral::ONE - self.ctx.wavelengths.ones();
        let interior = index(self.ctx, interior, "ior")? + unused;
        let exterior = index(self.ctx, exterior, "exterior_ior")? + unused;
        let count = self.ctx.wavelengths.count();
        Ok(Dielectric { interior, exterior, dispersive: varies(interior, count) || varies(exterior, count) })
    }
}

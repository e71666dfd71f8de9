//! Materials of mesh files → `[materials]` of the scene, as the nearest models of ours; what is left aside is said.
//!
//! A base without a coat is diffuse; with one it is plastic (a depolarizing base below a Fresnel coat). Metal reflects its
//! colour R at normal incidence: n = (1 + √R)/(1 - √R), k = 0 (Gulbrandsen 2014, eq. 2 at its upper bound). What lets light
//! through is rough glass, or smooth at α ≤ 0.001.

use super::context::Context;
use base::locate::{InputError, Located};
use import::appearance::{Appearance, Picture, Source};
use import::mtl;
use std::path::Path;
use syntax::material::{
    BlendFile, DielectricFile, DiffuseFile, MaterialFile, NormalMapFile, PlasticFile, RoughConductorFile,
    RoughDielectricFile,
};
use syntax::scene::SceneFile;
use syntax::shape::{MeshFile, ShapeFile};
use syntax::texture::{AlbedoFile, ImageAlbedo};
use syntax::values::SpectrumFile;

/// As much of a file as is read to learn whether it has materials, and of a library.
const HEAD: u64 = 1 << 20;

/// Facets as smooth as they can be.
const SMOOTH: f64 = 0.001;

/// The same scene in which the materials of mesh files that are asked for are materials of its own.
///
/// # Errors
/// [`InputError`] at the mesh if a file cannot be read.
pub(crate) fn expand(ctx: &mut Context, file: &SceneFile) -> Result<SceneFile, InputError> {
    let mut out = file.clone();
    for place in &mut out.objects {
        let mut object = (**place).clone();
        let (ShapeFile::Obj(mesh) | ShapeFile::Gltf(mesh) | ShapeFile::Ply(mesh)) = &*object.shape else {
            continue;
        };
        let shape = (*object.shape).clone();
        let mesh = mesh.clone();
        let Some(found) = found(ctx, &shape, &mesh)? else {
            continue;
        };
        if !mesh.materials {
            // Names alone say nothing of looks, and a scene that names parts knows of them.
            let silent = object.part_materials.is_empty() && found.says_something;
            if silent {
                ctx.notes.push(format!(
                    "{}: {} not used; `materials = true` beside `file` takes materials",
                    *mesh.file, found.what
                ));
            }
            continue;
        }
        if found.coloured {
            ctx.notes.push(format!(
                "{}: the colours of its vertices are not used",
                *mesh.file
            ));
        }
        for appearance in found.list {
            if object.part_materials.contains_key(&appearance.name) || !found.used.contains(&appearance.name)
            {
                continue;
            }
            let name = format!("{}:{}", *mesh.file, appearance.name);
            if !appearance.unused.is_empty() {
                ctx.notes
                    .push(format!("{name}: not used are {}", appearance.unused.join(", ")));
            }
            let mut table = Table {
                ctx,
                file: &mesh.file,
                made: vec![],
            };
            let body = table.material(&name, &appearance);
            table.made.push((name.clone(), body));
            for (name, material) in table.made {
                out.materials
                    .insert(name, Located::at(mesh.file.span(), material));
            }
            object
                .part_materials
                .insert(appearance.name, Located::at(mesh.file.span(), name));
        }
        *place = Located::at(place.span(), object);
    }
    Ok(out)
}

/// What a mesh file holds besides triangles.
struct Found {
    list: Vec<Appearance>,
    /// Names of materials that parts have.
    used: Vec<String>,
    coloured: bool,
    says_something: bool,
    /// For people.
    what: String,
}

fn found(ctx: &mut Context, shape: &ShapeFile, mesh: &MeshFile) -> Result<Option<Found>, InputError> {
    // What is wrong with a mesh is said when its triangles are read.
    let most = if mesh.materials || matches!(shape, ShapeFile::Gltf(_)) {
        u64::MAX
    } else {
        HEAD
    };
    let Ok(bytes) = ctx.peek(&mesh.file, most) else {
        return Ok(None);
    };
    let path = ctx.path(&mesh.file);
    let folder = Path::new(mesh.file.as_str()).parent().unwrap_or(Path::new(""));
    let beside = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let (mut list, coloured) = match shape {
        ShapeFile::Gltf(_) => match import::gltf_appearances(&bytes) {
            Ok(found) => found,
            Err(_) => return Ok(None),
        },
        ShapeFile::Obj(_) => {
            let mut list = vec![];
            for library in mtl::libraries(&bytes) {
                let name = beside(&library);
                match ctx.peek(&name, HEAD) {
                    Ok(text) => list.extend(mtl::parse(&text)),
                    Err(e) if mesh.materials => {
                        return Err(ctx.error(
                            mesh.file.span(),
                            format!("cannot read {name}, the library of {}: {e}", *mesh.file),
                            "put it there, or take materials = true away",
                        ));
                    }
                    Err(_) => {}
                }
            }
            (list, mtl::has_colours(&bytes))
        }
        _ => (vec![], import::ply_has_colours(&bytes)),
    };
    for a in &mut list {
        let pictures = [a.image.as_mut(), a.normals.as_mut().map(|(p, _)| p)];
        for picture in pictures.into_iter().flatten() {
            if let Source::File(name) = &mut picture.source {
                *name = beside(name);
            }
        }
    }
    let used = if mesh.materials {
        let parts = match shape {
            ShapeFile::Gltf(_) => import::parse_gltf(&bytes, path.parent()),
            ShapeFile::Ply(_) => import::parse_ply(&bytes),
            _ => import::parse_obj(&bytes),
        };
        let names = parts.into_iter().flatten().filter_map(|p| p.material);
        names.collect()
    } else {
        vec![]
    };
    let mut what = vec![];
    let telling: Vec<&str> = list
        .iter()
        .filter(|a| !a.is_plain())
        .map(|a| a.name.as_str())
        .collect();
    if !telling.is_empty() {
        let more = if telling.len() > 4 { ", ..." } else { "" };
        let names = &telling[..telling.len().min(4)];
        what.push(format!("its materials ({}{more})", names.join(", ")));
    }
    if coloured {
        what.push("the colours of its vertices".to_owned());
    }
    Ok(Some(Found {
        says_something: !what.is_empty(),
        what: format!("{} are", what.join(" and ")),
        list,
        used,
        coloured,
    }))
}

/// Materials being made for one of a file.
struct Table<'a> {
    ctx: &'a mut Context,
    file: &'a Located<String>,
    made: Vec<(String, MaterialFile)>,
}

impl Table<'_> {
    fn at<T>(&self, value: T) -> Located<T> {
        Located::at(self.file.span(), value)
    }

    fn add(&mut self, name: &str, material: MaterialFile) -> Located<String> {
        self.made.push((name.to_owned(), material));
        self.at(name.to_owned())
    }

    fn material(&mut self, name: &str, a: &Appearance) -> MaterialFile {
        let alpha = a.alpha.unwrap_or(SMOOTH);
        let mut body = match a.alpha {
            None => MaterialFile::Diffuse(DiffuseFile {
                albedo: self.albedo(a),
            }),
            Some(alpha) => MaterialFile::Plastic(Box::new(PlasticFile {
                albedo: self.albedo(a),
                ior: self.at(a.ior.into()),
                exterior_ior: self.at(1.0.into()),
                specular: self.at(1.0.into()),
                single_scatter: None,
                interreflection: true,
                alpha: self.at(alpha.into()),
                distribution: optics::sampling::microfacet::Distribution::default(),
                masking: optics::sampling::microfacet::Masking::default(),
            })),
        };
        if a.metallic > 0.0 {
            if a.image.is_some() {
                self.ctx.notes.push(format!(
                    "{name}: the image of its colour is not used where it is metal"
                ));
            }
            let index = |r: f64| {
                let root = r.clamp(0.0, 0.98).sqrt();
                (1.0 + root) / (1.0 - root)
            };
            let n = self.colour(a.base.map(index));
            let metal = MaterialFile::RoughConductor(RoughConductorFile {
                metal: None,
                n: Some(self.at(n)),
                k: Some(self.at(SpectrumFile::Scalar(0.0))),
                alpha: self.at(alpha.into()),
                distribution: optics::sampling::microfacet::Distribution::default(),
                masking: optics::sampling::microfacet::Masking::default(),
            });
            body = self.mixed(name, ["base", "metal"], body, metal, a.metallic);
        }
        if a.transmission > 0.0 {
            let (ior, exterior_ior) = (self.at(a.ior.into()), self.at(1.0.into()));
            let glass = if alpha <= SMOOTH {
                MaterialFile::Dielectric(DielectricFile { ior, exterior_ior })
            } else {
                MaterialFile::RoughDielectric(RoughDielectricFile {
                    ior,
                    exterior_ior,
                    alpha: self.at(alpha.into()),
                    distribution: optics::sampling::microfacet::Distribution::default(),
                    masking: optics::sampling::microfacet::Masking::default(),
                })
            };
            body = self.mixed(name, ["opaque", "glass"], body, glass, a.transmission);
        }
        if let Some((picture, strength)) = &a.normals {
            let image = self.name(picture);
            let material = self.add(&format!("{name}/smooth"), body);
            body = MaterialFile::NormalMap(NormalMapFile {
                material,
                image: self.at(image),
                strength: self.at(*strength),
                uv: picture.uv,
                wrap: picture.wrap,
                filter: picture.filter,
                layer: None,
            });
        }
        body
    }

    /// A share `weight` of `b` in `a`.
    fn mixed(
        &mut self,
        name: &str,
        [first, second]: [&str; 2],
        a: MaterialFile,
        b: MaterialFile,
        weight: f64,
    ) -> MaterialFile {
        if weight >= 1.0 {
            return b;
        }
        MaterialFile::Blend(BlendFile {
            a: self.add(&format!("{name}/{first}"), a),
            b: self.add(&format!("{name}/{second}"), b),
            weight: self.at(weight.into()),
        })
    }

    fn albedo(&mut self, a: &Appearance) -> Located<AlbedoFile> {
        let Some(picture) = &a.image else {
            let colour = self.colour(a.base);
            return self.at(colour.into());
        };
        let scale = a.base.iter().sum::<f64>() / 3.0;
        if a.base.iter().any(|v| (v - scale).abs() > 1e-6) {
            self.ctx.notes.push(format!(
                "{}:{}: the colour that multiplies its image is taken as its mean, {scale:.3}",
                **self.file, a.name
            ));
        }
        let image = self.name(picture);
        self.at(AlbedoFile::Image(ImageAlbedo {
            image: self.at(image),
            scale,
            uv: picture.uv,
            wrap: picture.wrap,
            filter: picture.filter,
            raw: false,
            layer: None,
        }))
    }

    /// Name under which an image is found.
    fn name(&mut self, picture: &Picture) -> String {
        match &picture.source {
            Source::File(name) => name.clone(),
            Source::Embedded(number, bytes) => {
                let name = format!("{}#{number}", **self.file);
                self.ctx.memory.insert(name.clone(), bytes.clone());
                name
            }
        }
    }

    /// Red above 590 nm, green from 500 nm, blue below.
    fn colour(&self, rgb: [f64; 3]) -> SpectrumFile {
        let channel = |nm: &f64| match *nm {
            nm if nm < 500.0 => rgb[2],
            nm if nm < 590.0 => rgb[1],
            _ => rgb[0],
        };
        SpectrumFile::PerWavelength(self.ctx.listed.nm().iter().map(channel).collect())
    }
}

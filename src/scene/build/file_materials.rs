//! Adds the materials of mesh files to `[materials]` of the scene and adds notes about unused materials. The
//! conversion of the materials is in [`super::appearances`].

use super::appearances::Table;
use super::context::Context;
use base::locate::{InputError, Located};
use import::appearance::{Appearance, Source};
use import::mtl;
use std::path::Path;
use syntax::scene::SceneFile;
use syntax::shape::{MeshFile, ShapeFile};

/// Number of bytes of a mesh file or material library that are read to find out whether the file has
/// materials.
const HEAD: u64 = 1 << 20;

/// Returns the scene after adding the materials that it uses from mesh files.
///
/// # Errors
/// Returns [`InputError`] at the mesh if a file cannot be read.
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
            // Add no note if the file's materials are only names, or if the scene sets materials of parts.
            let silent = object.part_materials.is_empty() && found.says_something;
            if silent {
                ctx.note(format!(
                    "{}: {} not used; to use the materials, set `materials = true` next to `file`",
                    *mesh.file, found.what
                ));
            }
            continue;
        }
        for appearance in found.list {
            if object.part_materials.contains_key(&appearance.name) || !found.used.contains(&appearance.name)
            {
                continue;
            }
            let name = format!("{}:{}", *mesh.file, appearance.name);
            if !appearance.unused.is_empty() {
                ctx.notes.push(format!(
                    "{name}: these keys of the material are not used: {}",
                    appearance.unused.join(", ")
                ));
            }
            for note in &appearance.notes {
                ctx.note(format!("{name}: {note}"));
            }
            for (name, material) in Table::new(ctx, &mesh.file, &name, &appearance).made {
                out.materials.insert(name, Located::at(mesh.file.span(), material));
            }
            object.part_materials.insert(appearance.name, Located::at(mesh.file.span(), name));
        }
        *place = Located::at(place.span(), object);
    }
    Ok(out)
}

struct Found {
    list: Vec<Appearance>,
    /// Names of the materials that parts of the mesh use.
    used: Vec<String>,
    says_something: bool,
    /// Description of the mesh file for messages.
    what: String,
}

fn found(ctx: &mut Context, shape: &ShapeFile, mesh: &MeshFile) -> Result<Option<Found>, InputError> {
    // Errors in a mesh are reported when its triangles are read.
    let most = if mesh.materials || matches!(shape, ShapeFile::Gltf(_)) { u64::MAX } else { HEAD };
    let Ok(bytes) = ctx.peek(&mesh.file, most) else {
        return Ok(None);
    };
    let path = ctx.path(&mesh.file);
    let library = if mesh.materials { u64::MAX } else { HEAD };
    let folder = Path::new(mesh.file.as_str()).parent().unwrap_or(Path::new(""));
    let beside = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let mut list = match shape {
        ShapeFile::Gltf(_) => match import::gltf_appearances(&bytes) {
            Ok(found) => found,
            Err(_) => return Ok(None),
        },
        ShapeFile::Obj(_) => {
            let mut list = vec![];
            for ways in mtl::libraries(&bytes) {
                // Use the first interpretation of the `mtllib` line for which all files exist.
                let read = |ctx: &Context, names: &[String]| -> std::io::Result<Vec<Vec<u8>>> {
                    names.iter().map(|n| ctx.peek(&beside(n), library)).collect()
                };
                match ways.iter().map(|names| read(ctx, names)).find(Result::is_ok) {
                    Some(Ok(texts)) => list.extend(texts.iter().flat_map(|text| mtl::parse(text))),
                    _ if mesh.materials => {
                        let name = beside(&ways[0].join(" "));
                        let why = read(ctx, &ways[0]).err();
                        return Err(ctx.error(
                            mesh.file.span(),
                            format!(
                                "cannot read {name}, the material library of {}: {}",
                                *mesh.file,
                                why.map_or_else(String::new, |e| e.to_string())
                            ),
                            "put the material library at this path, or remove materials = true",
                        ));
                    }
                    _ => {}
                }
            }
            list
        }
        _ => vec![],
    };
    for a in &mut list {
        for picture in a.pictures() {
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
    let telling: Vec<&str> = list.iter().filter(|a| !a.is_plain()).map(|a| a.name.as_str()).collect();
    let more = if telling.len() > 4 { ", ..." } else { "" };
    let names = telling[..telling.len().min(4)].join(", ");
    Ok(Some(Found {
        says_something: !telling.is_empty(),
        what: format!("the file's materials ({names}{more}) are"),
        list,
        used,
    }))
}

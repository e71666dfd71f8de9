//! Mitsuba's shapes → objects of a scene file.

use super::import_materials::MaterialReader;
use super::import_surfaces::Upright;
use super::importer::{Importer, rows};
use super::tree::Node;
use base::locate::{InputError, Located};
use glam::{DAffine3, DVec3};
use syntax::shape::{
    CubeFile, CylinderFile, DiskFile, MeshFile, ObjectFile, RectangleFile, ShapeFile, SphereFile,
    TransformFile,
};

/// One object.
pub(super) fn object<'a>(
    importer: &mut Importer<'a>,
    materials: &mut MaterialReader,
    node: &'a Node,
) -> Result<ObjectFile, InputError> {
    let source = importer.source;
    let mut place = node.transform(source, "to_world")?.unwrap_or(DAffine3::IDENTITY);
    let flip = node.boolean(source, "flip_normals")?.unwrap_or(false);
    let point = |name, otherwise| Ok::<_, InputError>(node.vector(source, name)?.unwrap_or(otherwise));
    let mesh_file = || -> Result<Located<String>, InputError> {
        match node.text(source, "filename")? {
            Some(name) => Ok(Located::at(node.span.clone(), importer.file(name))),
            None => importer.error(
                &node.span,
                "the mesh has no filename",
                "add <string name=\"filename\">",
            ),
        }
    };
    // Whether texture coordinates count v from the lower edge of an image, as ours do, once Mitsuba has read them.
    let mut upward = false;
    let shape = match node.kind.as_str() {
        "sphere" => ShapeFile::Sphere(SphereFile {
            center: point("center", DVec3::ZERO)?.to_array(),
            radius: node.float(source, "radius")?.unwrap_or(1.0),
        }),
        "cylinder" => ShapeFile::Cylinder(CylinderFile {
            p0: point("p0", DVec3::ZERO)?.to_array(),
            p1: point("p1", DVec3::Z)?.to_array(),
            radius: node.float(source, "radius")?.unwrap_or(1.0),
            caps: false,
        }),
        "disk" => ShapeFile::Disk(DiskFile::default()),
        "rectangle" => ShapeFile::Rectangle(RectangleFile::default()),
        "cube" => ShapeFile::Cube(CubeFile::default()),
        kind @ ("obj" | "ply") => {
            let file = mesh_file()?;
            let flat = node.boolean(source, "face_normals")?.unwrap_or(false);
            upward = node.boolean(source, "flip_tex_coords")?.unwrap_or(kind == "obj");
            let mesh = MeshFile { file, flat };
            if kind == "obj" {
                ShapeFile::Obj(mesh)
            } else {
                ShapeFile::Ply(mesh)
            }
        }
        other => {
            return importer.error(
                &node.span,
                format!("sunstone has no shape `{other}`"),
                "use obj, ply, sphere, rectangle, disk, cube or cylinder; convert other meshes to PLY",
            );
        }
    };
    if flip {
        if !["rectangle", "disk"].contains(&node.kind.as_str()) {
            return importer.error(
                &node.span,
                format!("sunstone cannot turn a {} inside out", node.kind),
                "take flip_normals away",
            );
        }
        place *= DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0));
    }
    let mut bsdf = None;
    for child in node.children() {
        match importer.resolve(child)? {
            inner if inner.tag == "bsdf" && bsdf.is_none() => bsdf = Some(inner),
            inner if inner.tag == "emitter" => {
                return importer.error(
                    &inner.span,
                    "sunstone has no shapes that shine",
                    "use a projector, a point or an environment",
                );
            }
            inner => {
                return importer.error(
                    child.span(),
                    format!("sunstone cannot give this {} to a shape", inner.tag),
                    "keep one bsdf",
                );
            }
        }
    }
    node.finish(source, &["silhouette_sampling_weight"])?;
    let material = match bsdf {
        Some(bsdf) => materials.named(importer, bsdf)?,
        None => materials.of_bare_shapes(),
    };
    let images = materials.images(&material);
    let fits = match (node.kind.as_str(), images) {
        (_, Upright::NoImages) => true,
        ("cube", _) => false,
        (_, Upright::Yes) => !upward,
        (_, Upright::No) => upward,
        (_, Upright::Mixed) => false,
    };
    if !fits {
        return importer.error(
            &node.span,
            "Mitsuba counts the texture coordinate v of this shape from the other edge of the image than sunstone does",
            "turn the image upside down and give its texture <transform name=\"to_uv\"><scale y=\"-1\"/></transform> (or take that away); use six rectangles for a cube",
        );
    }
    let at = || node.span.clone();
    let mut object = ObjectFile::new(Located::at(at(), shape));
    object.name.clone_from(&node.id);
    object.material = Located::at(at(), material);
    if place != DAffine3::IDENTITY {
        let matrix = TransformFile {
            matrix: Some(rows(&place)),
            ..TransformFile::default()
        };
        object.transform = Some(Located::at(at(), matrix));
    }
    Ok(object)
}

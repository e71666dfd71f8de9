//! Mitsuba's shapes → objects of a scene file.

use super::import_emitters;
use super::import_materials::MaterialReader;
use super::import_media::MediumReader;
use super::importer::{Importer, rows};
use super::tree::Node;
use base::locate::{InputError, Located};
use glam::{DAffine3, DVec3};
use syntax::shape::{
    CubeFile, CylinderFile, DiskFile, MeshFile, ObjectFile, RectangleFile, ShapeFile, SphereFile,
};
use syntax::transform::TransformFile;

/// What shapes refer to.
#[derive(Default)]
pub(super) struct Readers {
    pub materials: MaterialReader,
    pub media: MediumReader,
}

/// The objects that one shape becomes.
pub(super) fn objects<'a>(
    importer: &mut Importer<'a>,
    reader: &mut Readers,
    node: &'a Node,
) -> Result<Vec<ObjectFile>, InputError> {
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
    // Whether Mitsuba's v runs against ours.
    let mut turned = node.kind == "cube";
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
            turned = node.boolean(source, "flip_tex_coords")?.unwrap_or(kind == "obj");
            let mesh = MeshFile {
                file,
                flat,
                materials: false,
            };
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
    let (mut bsdf, mut interior, mut light) = (None, None, None);
    for child in node.children() {
        match importer.resolve(child)? {
            inner if inner.tag == "bsdf" && bsdf.is_none() => bsdf = Some(inner),
            inner if inner.tag == "emitter" && light.is_none() => light = Some(inner),
            inner if inner.tag == "medium" && child.name() == Some("interior") => interior = Some(inner),
            inner if inner.tag == "medium" && child.name() == Some("exterior") => {
                importer.note("media outside of shapes are not used: in sunstone a medium fills an object");
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
    node.finish(source, &["silhouette_sampling_weight"]);
    let interior = match interior {
        Some(medium) => Some(reader.media.named(importer, medium)?),
        None => None,
    };
    let mut images = false;
    let material = match bsdf {
        Some(bsdf) => {
            let made = reader.materials.named(importer, bsdf, turned);
            images = made.images;
            made.name
        }
        // A shape that bounds a medium and has no BSDF is not seen.
        None if interior.is_some() => reader.materials.table.unseen(),
        None => reader.materials.table.of_bare_shapes(),
    };
    let emission = light
        .map(|l| import_emitters::area(importer, l, turned))
        .transpose()?;
    images |= emission.as_ref().is_some_and(|(_, images)| *images);
    let at = || node.span.clone();
    let mut object = ObjectFile::new(Located::at(at(), shape));
    object.name.clone_from(&node.id);
    object.material = Located::at(at(), material);
    object.interior = interior;
    object.emission = emission.map(|(e, _)| e);
    if place != DAffine3::IDENTITY {
        let matrix = TransformFile {
            matrix: Some(rows(&place)),
            ..TransformFile::default()
        };
        object.transform = Some(Located::at(at(), matrix));
    }
    if node.kind == "cube" && images && object.interior.is_none() {
        let face = |(corner, u, v)| ObjectFile {
            shape: Located::at(at(), ShapeFile::Rectangle(RectangleFile { corner, u, v })),
            ..object.clone()
        };
        return Ok(FACES.map(face).into());
    }
    Ok(vec![object])
}

/// Faces of Mitsuba's cube, with its texture coordinates: corner, u and v, where v is 1 minus Mitsuba's.
type Face = ([f64; 3], [f64; 3], [f64; 3]);
const FACES: [Face; 6] = [
    ([1.0, -1.0, -1.0], [0.0, 0.0, 2.0], [-2.0, 0.0, 0.0]),
    ([1.0, 1.0, -1.0], [-2.0, 0.0, 0.0], [0.0, 0.0, 2.0]),
    ([1.0, -1.0, -1.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]),
    ([1.0, -1.0, 1.0], [0.0, 2.0, 0.0], [-2.0, 0.0, 0.0]),
    ([-1.0, -1.0, 1.0], [0.0, 2.0, 0.0], [0.0, 0.0, -2.0]),
    ([1.0, 1.0, -1.0], [0.0, -2.0, 0.0], [-2.0, 0.0, 0.0]),
];

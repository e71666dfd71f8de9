//! Converts Mitsuba's shapes to objects of a scene file.

use super::import_emitters;
use super::import_generated;
use super::import_materials::MaterialReader;
use super::import_media::MediumReader;
use super::importer::Importer;
use super::tree::Node;
use crate::build::pose::matrix;
use base::locate::{InputError, Located};
use glam::{DAffine3, DMat3, DVec3};
use import::{ImportError, ImportProblem, Model};
use syntax::shape::{
    CubeFile, CylinderFile, DiskFile, MeshFile, ObjectFile, RectangleFile, ShapeFile, SphereFile,
};

/// Converters of the materials, media and groups to which shapes refer.
#[derive(Default)]
pub(super) struct Readers {
    pub materials: MaterialReader,
    pub media: MediumReader,
}

/// Returns the objects of a shape, or the objects of all shapes in a `merge` shape.
pub(super) fn all<'a>(
    importer: &mut Importer<'a>,
    reader: &mut Readers,
    node: &'a Node,
) -> Result<Vec<ObjectFile>, InputError> {
    if node.kind != "merge" {
        return objects(importer, reader, node);
    }
    let mut all = vec![];
    for child in node.children() {
        let inner = importer.resolve(child)?;
        if inner.tag != "shape" || ["merge", "shapegroup", "instance"].contains(&inner.kind.as_str()) {
            return importer.error(
                child.span(),
                format!("a merge shape cannot contain {} `{}`", inner.tag, inner.kind),
                "move the element to the top level of the scene",
            );
        }
        all.extend(objects(importer, reader, inner)?);
    }
    node.finish(importer.source, &[]);
    Ok(all)
}

/// Returns the objects of a shape, or no objects for a mesh without area.
fn objects<'a>(
    importer: &mut Importer<'a>,
    reader: &mut Readers,
    node: &'a Node,
) -> Result<Vec<ObjectFile>, InputError> {
    let source = importer.source;
    let mut place = node.transform(source, "to_world")?.unwrap_or(DAffine3::IDENTITY);
    let flip = node.boolean(source, "flip_normals")?.unwrap_or(false);
    let point = |name, otherwise| Ok::<_, InputError>(node.vector(source, name)?.unwrap_or(otherwise));
    let generated = import_generated::KINDS.contains(&node.kind.as_str());
    let mirrors = place.matrix3.determinant() < 0.0 && !generated;
    // Whether Mitsuba's surface orientation (`inward`) and shading normal (`swapped`) are opposite to
    // Sunstone's.
    let (mut inward, mut swapped) = (flip, flip);
    // Whether Mitsuba's v is opposite to Sunstone's.
    let mut turned = node.kind == "cube";
    let shape = match node.kind.as_str() {
        "sphere" => {
            let (center, radius) = (point("center", DVec3::ZERO)?, node.float(source, "radius")?);
            if !is_similarity(&place) {
                importer.note(
                    "a sphere's to_world has a non-uniform scale: as in Mitsuba, the scale along x is used for all axes",
                );
                place = round(&place, center);
            }
            (inward, swapped) = (flip != mirrors, flip != mirrors);
            ShapeFile::Sphere(SphereFile { center: center.to_array(), radius: radius.unwrap_or(1.0) })
        }
        "cylinder" => ShapeFile::Cylinder(CylinderFile {
            p0: point("p0", DVec3::ZERO)?.to_array(),
            p1: point("p1", DVec3::Z)?.to_array(),
            radius: node.float(source, "radius")?.unwrap_or(1.0),
            caps: false,
        }),
        "disk" => ShapeFile::Disk(DiskFile::default()),
        "rectangle" => ShapeFile::Rectangle(RectangleFile::default()),
        "cube" => ShapeFile::Cube(CubeFile::default()),
        kind @ ("obj" | "ply" | "serialized") => {
            let file = node.at(importer.file(importer.filename(node, "mesh")?));
            let flat = node.boolean(source, "face_normals")?.unwrap_or(false);
            if kind != "serialized" {
                turned = node.boolean(source, "flip_tex_coords")?.unwrap_or(kind == "obj");
            }
            let index = shape_index(importer, node)?;
            // Mitsuba computes missing normals from the faces. A reflection reverses computed normals.
            let given = !flat && mirrors && has_normals(importer, node)?;
            (inward, swapped) = (flip != mirrors, if given { flip } else { flip != mirrors });
            let mesh = MeshFile { file, index, flat, smooth: !flat, materials: false };
            match kind {
                "obj" => ShapeFile::Obj(mesh),
                "ply" => ShapeFile::Ply(mesh),
                _ => ShapeFile::Serialized(mesh),
            }
        }
        "bsplinecurve" | "linearcurve" => {
            let mesh = import_generated::curve(importer, node, &place)?;
            place = DAffine3::IDENTITY;
            ShapeFile::Ply(mesh)
        }
        "sdfgrid" => ShapeFile::Ply(import_generated::sdf_grid(importer, node)?),
        other => {
            return importer.error(
                &node.span,
                format!("unsupported shape `{other}`"),
                "use obj, ply, serialized, bsplinecurve, linearcurve, sdfgrid, sphere, rectangle, disk, cube or cylinder; convert other meshes to PLY",
            );
        }
    };
    match node.kind.as_str() {
        "rectangle" | "disk" if flip => {
            place *= DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0));
            swapped = false;
        }
        "cube" => inward = flip != mirrors,
        "cylinder" if mirrors => {
            importer.note(
                "a cylinder's to_world contains a reflection: the orientation follows Mitsuba's ray intersections; Mitsuba samples \
                 the emission on the other side",
            );
        }
        _ => {}
    }
    let (mut bsdf, mut interior, mut light) = (None, None, None);
    for child in node.children() {
        match importer.resolve(child)? {
            inner if inner.tag == "bsdf" && bsdf.is_none() => bsdf = Some(inner),
            inner if inner.tag == "emitter" && light.is_none() => light = Some(inner),
            inner if inner.tag == "medium" && child.name() == Some("interior") && interior.is_none() => {
                interior = Some(inner);
            }
            inner if inner.tag == "medium" && child.name() == Some("exterior") => {
                importer.note("exterior media of shapes are not used: in Sunstone a medium fills an object");
            }
            inner => {
                let repeated =
                    ["bsdf", "emitter"].contains(&inner.tag.as_str()) || child.name() == Some("interior");
                return importer.error(
                    child.span(),
                    format!("{} {} in a shape", if repeated { "a second" } else { "unsupported" }, inner.tag),
                    "keep one bsdf, one emitter and one interior medium",
                );
            }
        }
    }
    node.finish(source, &["silhouette_sampling_weight"]);
    if let Some(Err(ImportError { problem: ImportProblem::NoArea { .. }, .. })) = model(importer, node)? {
        let name = node.text(source, "filename")?.unwrap_or_default();
        importer.note(format!("{name} has no area and is skipped"));
        return Ok(vec![]);
    }
    let interior = match interior {
        Some(_) if inward => {
            return importer.error(
                &node.span,
                "the shape is inside out (flip_normals, or a reflection in to_world), so the interior medium of the shape would fill \
                 the space around the shape",
                "remove flip_normals or the reflection, and use a shape whose normals point outward",
            );
        }
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
        // A shape that bounds a medium and has no BSDF is invisible.
        None if interior.is_some() => reader.materials.table.unseen(),
        None if light.is_some() => reader.materials.table.of_bare_lights(),
        None => reader.materials.table.of_bare_shapes(),
    };
    let emission = light.map(|l| import_emitters::area(importer, l, turned)).transpose()?;
    images |= emission.as_ref().is_some_and(|(_, images)| *images);
    let at = || node.span.clone();
    let mut object = ObjectFile::new(Located::at(at(), shape));
    object.name.clone_from(&node.id);
    object.material = Located::at(at(), material);
    object.interior = interior;
    // An interior medium determines which side is outside.
    object.flip_normals = swapped && object.interior.is_none();
    object.emission = emission.map(|(e, _)| e);
    if place != DAffine3::IDENTITY {
        object.transform = Some(Located::at(at(), matrix(&place)));
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

/// Returns whether a map preserves all angles, that is, scales all directions equally.
fn is_similarity(map: &DAffine3) -> bool {
    let m = map.matrix3;
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    let scale = x.length();
    let even = |v: DVec3| (v.length() - scale).abs() <= 1e-4 * scale;
    let square = |a: DVec3, b: DVec3| a.dot(b).abs() <= 1e-4 * scale * scale;
    even(y) && even(z) && square(x, y) && square(y, z) && square(z, x)
}

/// Returns the map that Mitsuba applies to a sphere with non-uniform scale. The map preserves the centre and
/// the handedness, and applies the scale along x to all axes.
fn round(map: &DAffine3, center: DVec3) -> DAffine3 {
    let scale = map.matrix3.x_axis.length();
    let sign = map.matrix3.determinant().signum();
    let even = DMat3::from_diagonal(DVec3::splat(scale)) * sign;
    DAffine3::from_mat3_translation(even, map.transform_point3(center) - even * center)
}

fn has_normals(importer: &Importer, node: &Node) -> Result<bool, InputError> {
    let model = model(importer, node)?.and_then(Result::ok);
    Ok(model.is_some_and(|model| model.parts.iter().any(|p| !p.mesh.normals.is_empty())))
}

/// Returns the contents of a shape's mesh file. Returns `None` for shapes without a file and for unreadable
/// files. Building the scene reports unreadable files.
fn model(importer: &Importer, node: &Node) -> Result<Option<Result<Model, ImportError>>, InputError> {
    if !["obj", "ply", "serialized"].contains(&node.kind.as_str()) {
        return Ok(None);
    }
    let name = node.text(importer.source, "filename")?.unwrap_or_default();
    let named = importer.file(name);
    let read = || match importer.files.get(&named) {
        Some(bytes) => Ok(bytes.clone()),
        None => std::fs::read(importer.path(name)),
    };
    let Ok(bytes) = read() else {
        return Ok(None);
    };
    Ok(Some(match node.kind.as_str() {
        "ply" => import::parse_ply(&bytes),
        "serialized" => import::parse_serialized(&bytes, shape_index(importer, node)?),
        _ => import::parse_obj(&bytes),
    }))
}

/// Returns the index of a mesh in a `serialized` file.
fn shape_index(importer: &Importer, node: &Node) -> Result<u32, InputError> {
    if node.kind != "serialized" {
        return Ok(0);
    }
    let index = node.integer(importer.source, "shape_index")?.unwrap_or(0);
    let wrong = || {
        importer.source.error(
            &node.span,
            format!("shape_index is {index}, but the indices start at 0"),
            "give the index of a mesh in the file, starting at 0",
        )
    };
    u32::try_from(index).map_err(|_| wrong())
}

/// Face of Mitsuba's cube: the corner at texture coordinates (0, 0), and the edges along u and v. Sunstone's
/// v is 1 minus Mitsuba's v.
type Face = ([f64; 3], [f64; 3], [f64; 3]);
const FACES: [Face; 6] = [
    ([1.0, -1.0, -1.0], [0.0, 0.0, 2.0], [-2.0, 0.0, 0.0]),
    ([1.0, 1.0, -1.0], [-2.0, 0.0, 0.0], [0.0, 0.0, 2.0]),
    ([1.0, -1.0, -1.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]),
    ([1.0, -1.0, 1.0], [0.0, 2.0, 0.0], [-2.0, 0.0, 0.0]),
    ([-1.0, -1.0, 1.0], [0.0, 2.0, 0.0], [0.0, 0.0, -2.0]),
    ([1.0, 1.0, -1.0], [0.0, -2.0, 0.0], [-2.0, 0.0, 0.0]),
];

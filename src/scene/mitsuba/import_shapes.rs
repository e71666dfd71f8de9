//! Mitsuba's shapes → objects of a scene file.

use super::import::Importer;
use super::import_materials::{MaterialReader, Upright};
use super::toml_text::{list, matrix, quoted};
use super::tree::Node;
use super::xml::number as digits;
use base::locate::InputError;
use glam::{DAffine3, DVec3};

/// The text of one object.
pub(super) fn object<'a>(
    importer: &mut Importer<'a>,
    materials: &mut MaterialReader,
    node: &'a Node,
) -> Result<String, InputError> {
    let source = importer.source;
    let mut place = node.transform(source, "to_world")?.unwrap_or(DAffine3::IDENTITY);
    let flip = node.boolean(source, "flip_normals")?.unwrap_or(false);
    let point = |name, otherwise| Ok::<_, InputError>(node.vector(source, name)?.unwrap_or(otherwise));
    let mesh_file = || -> Result<String, InputError> {
        match node.text(source, "filename")? {
            Some(name) => Ok(importer.file(name)),
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
        "sphere" => {
            let radius = node.float(source, "radius")?.unwrap_or(1.0);
            let center = point("center", DVec3::ZERO)?;
            format!(
                "sphere = {{ center = {}, radius = {} }}",
                list(&center.to_array()),
                digits(radius)
            )
        }
        "cylinder" => {
            let radius = node.float(source, "radius")?.unwrap_or(1.0);
            let (p0, p1) = (point("p0", DVec3::ZERO)?, point("p1", DVec3::Z)?);
            let [p0, p1] = [p0, p1].map(|p| list(&p.to_array()));
            format!(
                "cylinder = {{ p0 = {p0}, p1 = {p1}, radius = {} }}",
                digits(radius)
            )
        }
        "disk" => "disk = {}".to_owned(),
        "rectangle" => "rectangle = {}".to_owned(),
        "cube" => "cube = {}".to_owned(),
        kind @ ("obj" | "ply") => {
            let file = mesh_file()?;
            let flat = node.boolean(source, "face_normals")?.unwrap_or(false);
            upward = node.boolean(source, "flip_tex_coords")?.unwrap_or(kind == "obj");
            format!(
                "{kind} = {{ file = {file}{} }}",
                if flat { ", flat = true" } else { "" }
            )
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
    let mut text = String::from("[[objects]]\n");
    if let Some(id) = &node.id {
        text += &format!("name = {}\n", quoted(id));
    }
    text += &format!("shape.{shape}\nmaterial = {}", quoted(&material));
    if place != DAffine3::IDENTITY {
        text += &format!("\ntransform = {{ matrix = {} }}", matrix(&place));
    }
    Ok(text)
}

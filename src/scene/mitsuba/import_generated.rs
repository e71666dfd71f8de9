//! Converts Mitsuba's shapes without a Sunstone equivalent to meshes. The meshes are PLY files next to the
//! scene file.

use super::importer::Importer;
use super::tree::Node;
use base::locate::InputError;
use glam::DAffine3;
use import::curve::{Kind, parse_curves};
use import::sdf::{Normals, surface};
use import::vol::parse_vol;
use import::write_ply;
use syntax::shape::MeshFile;
use transport::geometry::mesh::Mesh;

pub(super) const KINDS: [&str; 3] = ["bsplinecurve", "linearcurve", "sdfgrid"];

/// Returns the name and the bytes of the file to which a shape refers. Returns an error if the shape has an
/// emitter, a medium or `flip_normals`.
fn file<'a>(importer: &Importer, node: &'a Node) -> Result<(&'a str, Vec<u8>), InputError> {
    let source = importer.source;
    if node.boolean(source, "flip_normals")?.unwrap_or(false) {
        let message = format!("flip_normals of a {} has no effect in Mitsuba", node.kind);
        return importer.error(&node.span, message, "remove flip_normals");
    }
    for child in node.children() {
        let inner = importer.peek(child)?;
        if inner.tag == "emitter" || inner.tag == "medium" {
            let message = format!("unsupported {} of a {}", inner.tag, node.kind);
            return importer.error(
                child.span(),
                message,
                "move the element to another shape, or convert this shape to PLY",
            );
        }
    }
    let name = importer.filename(node, &node.kind)?;
    Ok((name, importer.read(node, name)?))
}

/// Adds a mesh as a file next to the scene file, and returns the object's shape.
fn made(importer: &mut Importer, node: &Node, mesh: &Mesh) -> MeshFile {
    let wanted = node.id.as_deref().unwrap_or(&node.kind);
    let name = importer.make(wanted, "ply", write_ply::write(mesh));
    MeshFile { file: node.at(name), index: 0, flat: false, smooth: false, materials: false }
}

/// Converts `bsplinecurve` and `linearcurve` to the surfaces of tubes. `place` transforms the points to the
/// parent's coordinates, but does not scale the radii.
pub(super) fn curve(importer: &mut Importer, node: &Node, place: &DAffine3) -> Result<MeshFile, InputError> {
    let (name, bytes) = file(importer, node)?;
    let kind = if node.kind == "linearcurve" { Kind::Linear } else { Kind::BSpline };
    let tubes = parse_curves(&bytes, kind, place).map_err(|mut e| {
        e.file = Some(importer.path(name));
        let help = "correct the curve file";
        importer.source.error(&node.span, e.to_string(), help)
    })?;
    importer.note(format!(
        "{}: {name} is converted to a mesh of {} triangles ({} sides per tube), with a deviation of at most {:.2e} m \
         from Mitsuba's surface",
        node.kind,
        tubes.mesh.indices.len(),
        tubes.sides,
        tubes.deviation
    ));
    importer.note(
        "curves: light inside a tube hits the inner surface in Sunstone; in Mitsuba the light passes through, because curves are visible only from outside",
    );
    Ok(made(importer, node, &tubes.mesh))
}

/// Converts `sdfgrid` to the surface at which the signed distance is zero.
pub(super) fn sdf_grid(importer: &mut Importer, node: &Node) -> Result<MeshFile, InputError> {
    let (name, bytes) = file(importer, node)?;
    let normals = match node.text(importer.source, "normals")? {
        None | Some("smooth") => Normals::Smooth,
        Some("analytic") => Normals::Analytic,
        Some(other) => {
            let message = format!("unsupported normals `{other}` of the sdfgrid");
            return importer.error(&node.span, message, "use smooth or analytic");
        }
    };
    let found = parse_vol(&bytes).and_then(|vol| surface(&vol, normals));
    let found = found.map_err(|mut e| {
        e.file = Some(importer.path(name));
        importer.source.error(&node.span, e.to_string(), "correct the grid file")
    })?;
    importer.note(format!(
        "sdfgrid: {name} is converted to a mesh of {} triangles, with a deviation of at most {:.3} cell sizes from Mitsuba's surface",
        found.mesh.indices.len(),
        found.deviation
    ));
    Ok(made(importer, node, &found.mesh))
}

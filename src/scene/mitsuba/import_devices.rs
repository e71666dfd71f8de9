//! Mitsuba's sensor, integrator and emitters → camera, settings, projector and emitters of a scene file.

use super::importer::{Importer, rows};
use super::tree::{Node, number};
use base::locate::{InputError, Located};
use glam::DAffine3;
use syntax::device::{ApertureFile, PinholeFile, PoseFile};

/// Mitsuba's clipping planes if nothing is said, metres. Lenses focus on the far one.
const NEAR: f64 = 1e-2;
const FAR: f64 = 1e4;

/// The camera, and the samples per pixel.
pub(super) fn sensor<'a>(
    importer: &mut Importer<'a>,
    node: &'a Node,
) -> Result<(PinholeFile, Located<u32>), InputError> {
    let source = importer.source;
    if !["perspective", "thinlens"].contains(&node.kind.as_str()) {
        return importer.error(
            &node.span,
            format!("sunstone has no sensor `{}`", node.kind),
            "use <sensor type=\"perspective\"> or thinlens",
        );
    }
    let (mut spp, mut size) = (importer.whole(&node.span, 4, "sample_count")?, [768, 576]);
    for child in node.children() {
        let inner = importer.resolve(child)?;
        match inner.tag.as_str() {
            "sampler" => {
                if let Some(count) = inner.integer(source, "sample_count")? {
                    spp = importer.whole(&inner.span, count, "sample_count")?;
                }
            }
            "film" => size = film(importer, inner)?,
            _ => {
                return importer.error(
                    child.span(),
                    format!("sunstone does not know what `{}` of a sensor means", inner.tag),
                    "keep film and sampler alone",
                );
            }
        }
    }
    let [w, h] = size.map(f64::from);
    let fov = field_of_view(importer, node, w / h)?;
    let mut offset = [0.0; 2];
    for (slot, name) in offset
        .iter_mut()
        .zip(["principal_point_offset_x", "principal_point_offset_y"])
    {
        *slot = node.float(source, name)?.unwrap_or(0.0);
    }
    let mut camera = device(node, pose(importer, node)?, size, fov);
    if node.kind == "thinlens" {
        let (radius, focus) = (
            node.float(source, "aperture_radius")?,
            node.float(source, "focus_distance")?,
        );
        let Some(radius) = radius else {
            return importer.error(&node.span, "the lens has no aperture_radius", "add it, in metres");
        };
        let aperture = ApertureFile {
            radius,
            focus: focus.unwrap_or(FAR),
        };
        camera.aperture = Some(Located::at(node.span.clone(), aperture));
    }
    let near = node.float(source, "near_clip")?.filter(|near| *near > NEAR);
    let far = node.float(source, "far_clip")?.filter(|far| *far < FAR);
    for (name, plane) in [("near_clip", near), ("far_clip", far)] {
        if let Some(distance) = plane {
            importer.note(format!(
                "{name} = {distance} of the sensor is not used: Mitsuba does not show surfaces that it cuts off, Sunstone does"
            ));
        }
    }
    node.finish(source, &["focus_distance", "shutter_open", "shutter_close"]);
    if offset != [0.0; 2] {
        camera = camera.principal((0.5 - offset[0]) * w, (0.5 - offset[1]) * h);
    }
    Ok((camera, spp))
}

/// A device, all of which stands where its plugin does.
pub(super) fn device(node: &Node, pose: PoseFile, [w, h]: [u32; 2], fov_x_deg: f64) -> PinholeFile {
    let mut device = PinholeFile::new(pose).resolution(w, h);
    device.fov_x_deg = Some(Located::at(node.span.clone(), fov_x_deg));
    device.pose = Located::at(node.span.clone(), (*device.pose).clone());
    device
}

fn film(importer: &Importer, node: &Node) -> Result<[u32; 2], InputError> {
    let source = importer.source;
    if !["hdrfilm", "specfilm"].contains(&node.kind.as_str()) {
        return importer.error(
            &node.span,
            format!("sunstone has no film `{}`", node.kind),
            "use hdrfilm",
        );
    }
    let width = node.integer(source, "width")?.unwrap_or(768);
    let height = node.integer(source, "height")?.unwrap_or(576);
    if ![width, height].iter().all(|s| (1..=32768).contains(s)) {
        return importer.error(
            &node.span,
            format!("the film is {width} × {height}"),
            "width and height must lie in 1..32768",
        );
    }
    for child in node.children() {
        if child.tag() == "rfilter" {
            child.take();
        }
    }
    node.finish(
        source,
        &[
            "file_format",
            "pixel_format",
            "component_format",
            "sample_border",
            "compensate",
        ],
    );
    Ok([width as u32, height as u32])
}

/// How deep paths go.
pub(super) struct Depth {
    pub max_depth: Located<u32>,
    pub rr_depth: u32,
}

pub(super) fn integrator<'a>(
    importer: &mut Importer<'a>,
    node: Option<&'a Node>,
) -> Result<Depth, InputError> {
    let source = importer.source;
    let (mut max_depth, mut rr_depth) = (6, 5);
    let mut at = importer.document.scene.span.clone();
    let mut next = node;
    while let Some(node) = next.take() {
        at = node.span.clone();
        match node.kind.as_str() {
            "stokes" | "aov" | "moment" => {
                for child in node.children() {
                    next = Some(importer.resolve(child)?);
                }
                node.get("aovs");
            }
            "path" | "volpath" | "volpathmis" | "prb" | "prbvolpath" | "ptracer" => {
                max_depth = node.integer(source, "max_depth")?.unwrap_or(-1);
                rr_depth = node.integer(source, "rr_depth")?.unwrap_or(5);
            }
            "direct" => max_depth = 2,
            other => {
                return importer.error(
                    &node.span,
                    format!("sunstone has no integrator `{other}`"),
                    "use path, volpath, volpathmis, direct, prb, prbvolpath or ptracer, in stokes, aov or moment if need be",
                );
            }
        }
        let ignored = ["samples_per_pass", "block_size", "timeout", "hide_emitters"];
        let more = ["shading_samples", "emitter_samples", "bsdf_samples"];
        node.finish(source, &[&ignored[..], &more[..]].concat());
        // An integrator inside of itself cannot be written but by reference.
        if next.is_some_and(|n| n.kind == "stokes") {
            return importer.error(&node.span, "stokes is nested in stokes", "nest path in it");
        }
    }
    if max_depth < 0 {
        max_depth = 64;
        importer.note("paths without end become paths of max_depth = 64");
    }
    Ok(Depth {
        max_depth: importer.whole(&at, max_depth, "max_depth")?,
        // Mitsuba counts the camera's segment in `rr_depth`.
        rr_depth: u32::try_from(rr_depth.max(1) - 1).unwrap_or(u32::MAX),
    })
}

/// Horizontal field of view in degrees from `fov` and `fov_axis`, or from a focal length on 35 mm film.
pub(super) fn field_of_view(importer: &Importer, node: &Node, aspect: f64) -> Result<f64, InputError> {
    let source = importer.source;
    let axis = node.text(source, "fov_axis")?.unwrap_or("x").to_lowercase();
    let focal = node.text(source, "focal_length")?;
    let (fov, axis) = match (node.float(source, "fov")?, focal) {
        (Some(fov), None) => (fov, axis),
        (None, focal) => {
            let text = focal.unwrap_or("50mm");
            let Some(mm) = number(text.trim_end_matches("mm")).filter(|mm| *mm > 0.0) else {
                return importer.error(
                    &node.span,
                    format!("the focal length is `{text}`"),
                    "give it as 50mm",
                );
            };
            let diagonal = f64::hypot(36.0, 24.0);
            (
                2.0 * (diagonal / (2.0 * mm)).atan().to_degrees(),
                "diagonal".into(),
            )
        }
        (Some(_), Some(_)) => {
            return importer.error(
                &node.span,
                "both fov and focal_length are given",
                "keep one of the two",
            );
        }
    };
    let half = (fov.to_radians() / 2.0).tan();
    let degrees = |half: f64| 2.0 * half.atan().to_degrees();
    Ok(match axis.as_str() {
        "x" => fov,
        "smaller" if aspect <= 1.0 => fov,
        "larger" if aspect > 1.0 => fov,
        "y" | "smaller" | "larger" => degrees(half * aspect),
        "diagonal" => degrees(half / (1.0 + (aspect * aspect).recip()).sqrt()),
        _ => {
            return importer.error(
                &node.span,
                format!("fov_axis is `{axis}`"),
                "use x, y, diagonal, smaller or larger",
            );
        }
    })
}

/// The pose: Mitsuba's devices have +x left and +y up.
pub(super) fn pose(importer: &Importer, node: &Node) -> Result<PoseFile, InputError> {
    let place = node
        .transform(importer.source, "to_world")?
        .unwrap_or(DAffine3::IDENTITY);
    let m = place.matrix3;
    let lengths = [m.x_axis, m.y_axis, m.z_axis].map(|c| (c.length() - 1.0).abs());
    if lengths.iter().any(|l| *l > 1e-4) || m.determinant() < 0.0 {
        return importer.error(
            &node.span,
            format!("to_world of {} `{}` scales or mirrors", node.tag, node.kind),
            "use lookat, rotate and translate alone",
        );
    }
    let device = DAffine3::from_mat3_translation(
        glam::DMat3::from_cols(-m.x_axis, -m.y_axis, m.z_axis),
        place.translation,
    );
    Ok(PoseFile::Matrix(rows(&device)))
}

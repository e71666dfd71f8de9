//! Converts Mitsuba's sensor and integrator to the camera and the render settings of a scene file.

use super::importer::Importer;
use super::tree::{Node, number};
use crate::build::pose::rows;
use base::locate::{InputError, Located};
use glam::{DAffine3, DMat3, DVec3};
use syntax::device::{ApertureFile, PinholeFile, PoseFile};
use syntax::values::TimeBins;

/// Mitsuba's default near clipping plane in metres.
const NEAR: f64 = 1e-2;
/// Mitsuba's default far clipping plane in metres. Lenses focus on this plane by default.
const FAR: f64 = 1e4;

/// Distance in metres that light travels in one picosecond in vacuum.
const METRES_PER_PS: f64 = 299_792_458e-12;

/// Note for the user about different pixel filters in Mitsuba and Sunstone.
const FILTERED: &str = "pixels are averages over their area (box filter); Mitsuba's reconstruction filter of this scene includes \
    neighbouring pixels";

pub(super) struct Sensor {
    pub camera: PinholeFile,
    pub spp: Located<u32>,
    /// Bins of travel time, from a film of Mitsuba's extension mitransient.
    pub time: Option<TimeBins>,
    /// Distances from the device to the near and far clipping planes along the axis, in metres.
    pub clip: [f64; 2],
}

/// A film, with its size in pixels, the rendered window (x, y, width, height) in pixels, and its bins of path
/// length.
struct Film {
    size: [u32; 2],
    window: [u32; 4],
    time: Option<(f64, f64, u32)>,
}

impl Film {
    fn whole(size: [u32; 2]) -> Self {
        Self { size, window: [0, 0, size[0], size[1]], time: None }
    }
}

/// Returns the camera, the samples per pixel and the bins of travel time.
pub(super) fn sensor<'a>(importer: &mut Importer<'a>, node: &'a Node) -> Result<Sensor, InputError> {
    let source = importer.source;
    let orthographic = node.kind == "orthographic";
    if !orthographic && !["perspective", "thinlens"].contains(&node.kind.as_str()) {
        return importer.error(
            &node.span,
            format!("unsupported sensor `{}`", node.kind),
            "use <sensor type=\"perspective\">, thinlens or orthographic",
        );
    }
    let (mut spp, mut given) = (importer.whole(&node.span, 4, "sample_count")?, None);
    for child in node.children() {
        let inner = importer.resolve(child)?;
        match inner.tag.as_str() {
            "sampler" => {
                if let Some(count) = inner.integer(source, "sample_count")? {
                    spp = importer.whole(&inner.span, count, "sample_count")?;
                }
                // Parameters of Mitsuba's sampler affect only noise, and Sunstone has its own sampler.
                inner.finish(source, &["seed", "jitter", "pass_index", "dimension"]);
            }
            "film" if given.is_some() => {
                return importer.error(child.span(), "the sensor has a second film", "keep one film");
            }
            "film" => given = Some(film(importer, inner)?),
            _ => {
                return importer.error(
                    child.span(),
                    format!("unsupported element `{}` in a sensor", inner.tag),
                    "keep only film and sampler",
                );
            }
        }
    }
    if given.is_none() {
        importer.note(FILTERED);
    }
    let Film { size, window, time } = given.unwrap_or(Film::whole([768, 576]));
    let [w, h] = size.map(f64::from);
    let fov = if orthographic { 0.0 } else { field_of_view(importer, node, w / h)? };
    let mut offset = [0.0; 2];
    let names = ["principal_point_offset_x", "principal_point_offset_y"];
    for (slot, name) in offset.iter_mut().zip(names).filter(|_| !orthographic) {
        *slot = node.float(source, name)?.unwrap_or(0.0);
    }
    let near = node.float(source, "near_clip")?.unwrap_or(NEAR);
    let time = time.map(|(start, width, bins)| {
        let start = if orthographic { start } else { start + near };
        if !orthographic {
            importer.note(format!(
            "mitransient measures path lengths from the near clipping plane: the time bins are shifted by {near} m, which is \
             exact on the optical axis"
            ));
        }
        let at = |v| node.at(v);
        TimeBins {
            start_ps: start / METRES_PER_PS,
            bin_ps: at(width / METRES_PER_PS),
            bins: node.at(bins),
        }
    });
    let (pose, width) =
        if orthographic { parallel(importer, node, near)? } else { (camera_pose(importer, node)?, 0.0) };
    let mut camera = device(node, pose, [window[2], window[3]], fov);
    if orthographic {
        camera.fov_x_deg = None;
        camera.orthographic_width = Some(node.at(width * f64::from(window[2]) / w));
    }
    if node.kind == "thinlens" {
        let (radius, focus) = (node.float(source, "aperture_radius")?, node.float(source, "focus_distance")?);
        let Some(radius) = radius else {
            return importer.error(
                &node.span,
                "the thinlens sensor has no aperture_radius",
                "add aperture_radius, in metres",
            );
        };
        let aperture = ApertureFile { radius, focus: focus.unwrap_or(FAR) };
        camera.aperture = Some(node.at(aperture));
    }
    let far = node.float(source, "far_clip")?.unwrap_or(FAR);
    // The rays of an orthographic camera start at the near plane in both programs.
    let clip = if orthographic { [0.0, far - near] } else { [near, far] };
    node.finish(source, &["focus_distance", "shutter_open", "shutter_close"]);
    let cropped = window != [0, 0, size[0], size[1]];
    if cropped && !orthographic {
        // `fov` is the field of view of the whole film, not of the crop window.
        camera.fov_x_deg = None;
        let fx = w / (2.0 * (fov.to_radians() / 2.0).tan());
        camera.fx = Some(node.at(fx));
    }
    if cropped || offset != [0.0; 2] {
        let [x, y] = [window[0], window[1]].map(f64::from);
        camera = camera.principal((0.5 - offset[0]) * w - x, (0.5 - offset[1]) * h - y);
    }
    Ok(Sensor { camera, spp, time, clip })
}

/// Returns the pose and the image width (metres) of an orthographic camera. Rays start at the near
/// plane. Mitsuba's image spans -1 to 1 horizontally.
fn parallel(importer: &mut Importer, node: &Node, near: f64) -> Result<(PoseFile, f64), InputError> {
    let place = node.transform(importer.source, "to_world")?.unwrap_or_default();
    let m = place.matrix3;
    let lengths = [m.x_axis, m.y_axis, m.z_axis].map(DVec3::length);
    if (lengths[0] / lengths[1] - 1.0).abs() > 1e-4 || (lengths[2] - 1.0).abs() > 1e-4 {
        return importer.error(
            &node.span,
            format!(
                "to_world of an orthographic camera has different scales of x and y, or a scale of z: {lengths:.4?}"
            ),
            "scale x and y by half of the image width, and do not scale z",
        );
    }
    let unscaled = DMat3::from_cols(m.x_axis / lengths[0], m.y_axis / lengths[1], m.z_axis / lengths[2]);
    let at = place.translation + unscaled.z_axis * near;
    let pose = unmirrored(importer, node, DAffine3::from_mat3_translation(unscaled, at))?;
    Ok((pose, 2.0 * lengths[0]))
}

/// Returns the pose of a camera. If Mitsuba's image is mirrored, exchanges left and right and adds a note.
fn camera_pose(importer: &mut Importer, node: &Node) -> Result<PoseFile, InputError> {
    let place = node.transform(importer.source, "to_world")?.unwrap_or_default();
    unmirrored(importer, node, place)
}

fn unmirrored(importer: &mut Importer, node: &Node, place: DAffine3) -> Result<PoseFile, InputError> {
    if place.matrix3.determinant() < 0.0 {
        importer.note(
            "the camera's to_world contains a reflection: left and right of the image are exchanged relative to Mitsuba",
        );
        return posed(importer, node, place * DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0)));
    }
    posed(importer, node, place)
}

/// Creates a device from its pose, resolution and horizontal field of view in degrees. Errors in the device's
/// values are located at the Mitsuba plugin.
pub(super) fn device(node: &Node, pose: PoseFile, [w, h]: [u32; 2], fov_x_deg: f64) -> PinholeFile {
    let mut device = PinholeFile::new(pose).resolution(w, h);
    device.fov_x_deg = Some(node.at(fov_x_deg));
    device.pose = node.at((*device.pose).clone());
    device
}

fn film(importer: &mut Importer, node: &Node) -> Result<Film, InputError> {
    let source = importer.source;
    let transient = node.kind == "transient_hdr_film";
    match node.kind.as_str() {
        "hdrfilm" | "transient_hdr_film" => {}
        "specfilm" => {
            importer.note(
                "specfilm: Sunstone stores radiance at the scene's wavelengths, not the channels of the film",
            );
        }
        "ldrfilm" => importer.note("ldrfilm: Sunstone stores radiance; gamma and exposure are not applied"),
        other => {
            return importer.error(
                &node.span,
                format!("unsupported film `{other}`"),
                "use hdrfilm, or transient_hdr_film of mitransient",
            );
        }
    }
    let number = |name: &str, missing: i64, least: i64| -> Result<u32, InputError> {
        let value = node.integer(source, name)?.unwrap_or(missing);
        if (least..=32768).contains(&value) {
            return Ok(value as u32);
        }
        importer.error(
            &node.span,
            format!("the film's {name} is {value}, outside the supported range"),
            &format!("give {name} in {least}..32768"),
        )
    };
    let size = [number("width", 768, 1)?, number("height", 576, 1)?];
    let window = [
        number("crop_offset_x", 0, 0)?,
        number("crop_offset_y", 0, 0)?,
        number("crop_width", size[0].into(), 1)?,
        number("crop_height", size[1].into(), 1)?,
    ];
    if window[0] + window[2] > size[0] || window[1] + window[3] > size[1] {
        return importer.error(
            &node.span,
            format!(
                "the crop window of {} × {} pixels at ({}, {}) extends beyond the film of {} × {} pixels",
                window[2], window[3], window[0], window[1], size[0], size[1]
            ),
            "keep crop offset plus crop size within width and height",
        );
    }
    let mut time = None;
    if transient {
        let bins = node.integer(source, "temporal_bins")?.unwrap_or(2048);
        let width = node.float(source, "bin_width_opl")?.unwrap_or(0.003);
        let start = node.float(source, "start_opl")?.unwrap_or(0.0);
        if node.boolean(source, "exhaustive_scan")?.unwrap_or(false) {
            return importer.error(&node.span, "exhaustive_scan is not supported", "remove exhaustive_scan");
        }
        let bins = *importer.whole(&node.span, bins, "temporal_bins")?;
        time = Some((start, width, bins));
    }
    let mut filter = None;
    for child in node.children() {
        let inner = importer.resolve(child)?;
        if inner.tag != "rfilter" {
            return importer.error(
                child.span(),
                format!("unsupported element `{}` in a film", inner.tag),
                "keep only the rfilter",
            );
        }
        if filter.replace(inner.kind.as_str()).is_some() {
            return importer.error(child.span(), "the film has a second rfilter", "keep one rfilter");
        }
        // Parameters of reconstruction filters have no effect in Sunstone.
        inner.finish(source, &["radius", "stddev", "lobes", "B", "C"]);
    }
    if filter != Some("box") {
        importer.note(FILTERED);
    }
    let own: &[&str] = match node.kind.as_str() {
        // Parameters that control the encoding of the image file.
        "ldrfilm" => &["gamma", "exposure", "tonemap_method", "key", "burn", "label", "fixed_radiance"],
        "transient_hdr_film" => &["laser_scan_width", "laser_scan_height"],
        _ => &[],
    };
    node.finish(
        source,
        &[
            &["file_format", "pixel_format", "component_format", "sample_border", "compensate"],
            // Parameters that exist only in Mitsuba 0.x.
            &["banner", "attach_log", "high_quality_edges"][..],
            own,
        ]
        .concat(),
    );
    Ok(Film { size, window, time })
}

pub(super) struct Depth {
    pub max_depth: Located<u32>,
    pub rr_depth: u32,
}

pub(super) fn integrator<'a>(
    importer: &mut Importer<'a>,
    node: Option<&'a Node>,
) -> Result<Depth, InputError> {
    let source = importer.source;
    let (mut max_depth, mut rr_depth) = (-1, 5);
    let mut at = importer.document.scene.span.clone();
    if node.is_none() {
        importer.note("the scene has no integrator: paths are traced as with `path`");
    }
    let mut seen: Vec<&Node> = vec![];
    let mut next = node;
    while let Some(node) = next.take() {
        at = node.span.clone();
        if seen.iter().any(|n| std::ptr::eq(*n, node)) {
            return importer.error(&node.span, "the integrator refers to itself", "nest a path integrator");
        }
        seen.push(node);
        // The integrators of Mitsuba's Python package have a different default depth.
        let differentiable = node.kind.starts_with("prb") || node.kind.starts_with("transient_");
        match node.kind.as_str() {
            "stokes" | "aov" | "moment" => {
                for child in node.children() {
                    if next.replace(importer.resolve(child)?).is_some() {
                        return importer.error(
                            child.span(),
                            format!("the integrator {} contains a second integrator", node.kind),
                            "keep one integrator",
                        );
                    }
                }
                if next.is_none() {
                    return importer.error(
                        &node.span,
                        format!(
                            "the integrator {} contains no nested integrator, so it renders no light",
                            node.kind
                        ),
                        "nest <integrator type=\"path\">; to write depths, normals and positions, use `sunstone layers`",
                    );
                }
                if node.get("aovs").is_some() {
                    importer.note(
                        "aovs are not rendered; to write depths, normals and positions, use `sunstone layers`",
                    );
                }
            }
            "path"
            | "volpath"
            | "volpathmis"
            | "prb"
            | "prb_basic"
            | "prbvolpath"
            | "prb_projective"
            | "ptracer"
            | "transient_path"
            | "transient_prbvolpath" => {
                max_depth = node.integer(source, "max_depth")?.unwrap_or(if differentiable { 6 } else { -1 });
                rr_depth = node.integer(source, "rr_depth")?.unwrap_or(5);
            }
            "direct" => {
                max_depth = 2;
                let shading = node.integer(source, "shading_samples")?.unwrap_or(1);
                let samples = node.integer(source, "emitter_samples")?.unwrap_or(shading);
                node.get("bsdf_samples");
                if samples != 1 {
                    importer.note(format!(
                        "direct: Mitsuba 3.9 adds the light of point, spot and directional emitters {samples} times \
                         (emitter_samples), but Sunstone adds the light once"
                    ));
                }
            }
            "direct_projective" => max_depth = 2,
            // Integrators of Mitsuba 0.x that converge to the same image as `volpath`.
            "volpath_simple" | "bdpt" | "mlt" | "pssmlt" | "erpt" | "adjoint" => {
                max_depth = node.integer(source, "max_depth")?.unwrap_or(-1);
                rr_depth = node.integer(source, "rr_depth")?.unwrap_or(5);
                importer.note(format!(
                    "{}: replaced by Sunstone's path tracer, which converges to the same image",
                    node.kind
                ));
            }
            other => {
                return importer.error(
                    &node.span,
                    format!("unsupported integrator `{other}`"),
                    "use path, volpath, volpathmis, direct, prb, prbvolpath, ptracer, transient_path or \
                     transient_prbvolpath, optionally nested in stokes, aov or moment",
                );
            }
        }
        if node.kind.starts_with("transient_") {
            transient(importer, node)?;
        }
        if node.boolean(source, "hide_emitters")?.unwrap_or(false) {
            importer.note("hide_emitters is not used: emitters and the environment are visible in Sunstone");
        }
        if node.boolean(source, "strict_normals")?.unwrap_or(false) {
            importer.note("strict_normals is not used");
        }
        // Parameters that affect only scheduling and sampling.
        let work = ["samples_per_pass", "block_size", "timeout", "use_spectral_mis"];
        let derivatives =
            ["sppc", "sppp", "sppi", "guiding", "guiding_proj", "guiding_rounds", "project_seed"];
        node.finish(source, &[&work[..], &derivatives].concat());
    }
    if max_depth < 0 {
        max_depth = 64;
        importer.note("paths of unlimited depth are limited to max_depth = 64");
    }
    Ok(Depth {
        max_depth: importer.whole(&at, max_depth, "max_depth")?,
        // Mitsuba's `rr_depth` includes the path segment that starts at the camera.
        rr_depth: u32::try_from(rr_depth.max(1) - 1).unwrap_or(u32::MAX),
    })
}

fn transient(importer: &mut Importer, node: &Node) -> Result<(), InputError> {
    let source = importer.source;
    if node.boolean(source, "camera_unwarp")?.unwrap_or(false) {
        importer.note(
            "camera_unwarp is not used: Sunstone measures time from the camera, not from the first surface",
        );
    }
    if node.boolean(source, "discard_direct_light")?.unwrap_or(false) {
        return importer.error(
            &node.span,
            "discard_direct_light is not supported",
            "remove discard_direct_light, and resolve bounces in a slice (bounces = true)",
        );
    }
    let filter = node.text(source, "temporal_filter")?.unwrap_or("box");
    if !["", "box"].contains(&filter) {
        importer.note(format!("temporal_filter `{filter}` is not used: time bins have a box filter"));
    }
    node.get("gaussian_stddev");
    Ok(())
}

/// Returns the horizontal field of view in degrees from `fov` and `fov_axis`, or from a focal length for 35
/// mm film.
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
                    format!("invalid focal length `{text}`"),
                    "give a focal length such as 50mm",
                );
            };
            let diagonal = f64::hypot(36.0, 24.0);
            (2.0 * (diagonal / (2.0 * mm)).atan().to_degrees(), "diagonal".into())
        }
        (Some(_), Some(_)) => {
            return importer.error(
                &node.span,
                "both fov and focal_length are given",
                "remove either fov or focal_length",
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
                format!("fov_axis is `{axis}`, which is not a known axis"),
                "use x, y, diagonal, smaller or larger",
            );
        }
    })
}

/// Returns the pose of a device. In Mitsuba, a device's +x axis points left and its +y axis points up.
pub(super) fn pose(importer: &Importer, node: &Node) -> Result<PoseFile, InputError> {
    let place = node.transform(importer.source, "to_world")?.unwrap_or_default();
    posed(importer, node, place)
}

fn posed(importer: &Importer, node: &Node, place: DAffine3) -> Result<PoseFile, InputError> {
    let m = place.matrix3;
    let lengths = [m.x_axis, m.y_axis, m.z_axis].map(|c| (c.length() - 1.0).abs());
    let is_scaled = lengths.iter().any(|l| *l > 1e-4);
    if is_scaled || m.determinant() < 0.0 {
        let what = if is_scaled { "scale" } else { "reflection" };
        return importer.error(
            &node.span,
            format!("to_world of {} `{}` contains a {what}", node.tag, node.kind),
            "use only lookat, rotate and translate",
        );
    }
    let device =
        DAffine3::from_mat3_translation(DMat3::from_cols(-m.x_axis, -m.y_axis, m.z_axis), place.translation);
    Ok(PoseFile::Matrix(rows(&device)))
}

//! Mitsuba's sensor, integrator and emitters → camera, settings, projector and emitters of a scene file.

use super::PROJECTOR_RESOLUTION;
use super::import::Importer;
use super::toml_text::{list, matrix, scaled};
use super::tree::{Node, number, numbers};
use super::xml::number as digits;
use base::locate::InputError;
use glam::DAffine3;
use std::f64::consts::PI;
use std::ops::Range;

impl<'a> Importer<'a> {
    /// Writes the camera; gives the samples per pixel.
    pub(super) fn sensor(&mut self, node: &'a Node) -> Result<i64, InputError> {
        let source = self.source;
        if node.kind != "perspective" {
            return self.error(
                &node.span,
                format!("sunstone has no sensor `{}`", node.kind),
                "use <sensor type=\"perspective\">",
            );
        }
        let (mut spp, mut size) = (4, [768, 576]);
        for child in node.children() {
            let inner = self.resolve(child)?;
            match inner.tag.as_str() {
                "sampler" => spp = inner.integer(source, "sample_count")?.unwrap_or(spp),
                "film" => size = self.film(inner)?,
                _ => {
                    return self.error(
                        child.span(),
                        format!("sunstone does not know what `{}` of a sensor means", inner.tag),
                        "keep film and sampler alone",
                    );
                }
            }
        }
        let [w, h] = size.map(|s| s as f64);
        let fov = field_of_view(self, node, w / h)?;
        let mut offset = [0.0; 2];
        for (slot, name) in offset
            .iter_mut()
            .zip(["principal_point_offset_x", "principal_point_offset_y"])
        {
            *slot = node.float(source, name)?.unwrap_or(0.0);
        }
        let pose = pose(self, node)?;
        node.finish(
            source,
            &[
                "near_clip",
                "far_clip",
                "focus_distance",
                "shutter_open",
                "shutter_close",
            ],
        )?;
        let mut text = format!(
            "\n[camera]\nresolution = [{}, {}]\nfov_x_deg = {}\n",
            size[0],
            size[1],
            digits(fov)
        );
        if offset != [0.0; 2] {
            text += &format!(
                "cx = {}\ncy = {}\n",
                digits((0.5 - offset[0]) * w),
                digits((0.5 - offset[1]) * h)
            );
        }
        self.block(&node.span, &(text + &pose));
        Ok(spp)
    }

    fn film(&self, node: &Node) -> Result<[i64; 2], InputError> {
        let source = self.source;
        if !["hdrfilm", "specfilm"].contains(&node.kind.as_str()) {
            return self.error(
                &node.span,
                format!("sunstone has no film `{}`", node.kind),
                "use hdrfilm",
            );
        }
        let width = node.integer(source, "width")?.unwrap_or(768);
        let height = node.integer(source, "height")?.unwrap_or(576);
        if ![width, height].iter().all(|s| (1..=32768).contains(s)) {
            return self.error(
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
        )?;
        Ok([width, height])
    }

    pub(super) fn integrator(&mut self, node: Option<&'a Node>, spp: i64) -> Result<(), InputError> {
        let source = self.source;
        let mut depth = (6, 5);
        let mut at = self.document.scene.span.clone();
        let mut next = node;
        while let Some(node) = next.take() {
            at = node.span.clone();
            match node.kind.as_str() {
                "stokes" => {
                    for child in node.children() {
                        next = Some(self.resolve(child)?);
                    }
                }
                "path" => {
                    depth.0 = node.integer(source, "max_depth")?.unwrap_or(-1);
                    depth.1 = node.integer(source, "rr_depth")?.unwrap_or(5);
                }
                "direct" => depth.0 = 2,
                other => {
                    return self.error(
                        &node.span,
                        format!("sunstone has no integrator `{other}`"),
                        "use stokes, path or direct",
                    );
                }
            }
            let ignored = ["samples_per_pass", "block_size", "timeout", "hide_emitters"];
            let more = ["shading_samples", "emitter_samples", "bsdf_samples"];
            node.finish(source, &[&ignored[..], &more[..]].concat())?;
            // An integrator inside of itself cannot be written but by reference.
            if next.is_some_and(|n| n.kind == "stokes") {
                return self.error(&node.span, "stokes is nested in stokes", "nest path in it");
            }
        }
        if depth.0 < 0 {
            depth.0 = 64;
            self.note("paths without end become paths of max_depth = 64");
        }
        let text = format!(
            "[render]\nspp = {spp}\nmax_depth = {}\nrr_depth = {}\n",
            depth.0,
            depth.1.clamp(1, i64::from(u32::MAX)) - 1
        );
        self.block(&at, &text);
        Ok(())
    }

    pub(super) fn emitter(
        &mut self,
        node: &'a Node,
        environment: &mut Option<Range<usize>>,
    ) -> Result<(), InputError> {
        let source = self.source;
        match node.kind.as_str() {
            "point" => {
                let place = node.transform(source, "to_world")?.map(|t| t.translation);
                let position = node.vector(source, "position")?.or(place).unwrap_or_default();
                let intensity = self.spectrum(node, "intensity")?.unwrap_or("1".into());
                node.finish(source, &[])?;
                let text = format!(
                    "[[emitters]]\npoint = {{ position = {}, intensity = {intensity} }}\n",
                    list(&position.to_array())
                );
                self.block(&node.span, &text);
            }
            "constant" => {
                if environment.replace(node.span.clone()).is_some() {
                    return self.error(&node.span, "a second environment", "keep one");
                }
                let radiance = self.spectrum(node, "radiance")?.unwrap_or("1".into());
                node.finish(source, &["to_world"])?;
                let text = format!("[[emitters]]\nenvironment = {{ radiance = {radiance} }}\n");
                self.block(&node.span, &text);
            }
            "projector" => self.projector(node)?,
            other => {
                return self.error(
                    &node.span,
                    format!("sunstone has no emitter `{other}`"),
                    "use projector, point or constant",
                );
            }
        }
        Ok(())
    }

    /// Mitsuba's projector gives π times its `scale` × `irradiance` on the plane at 1 m.
    fn projector(&mut self, node: &'a Node) -> Result<(), InputError> {
        let source = self.source;
        if std::mem::replace(&mut self.has_projector, true) {
            return self.error(&node.span, "a second projector", "keep one");
        }
        let factor = PI * node.float(source, "scale")?.unwrap_or(1.0);
        let given = self.document.parameters.get(PROJECTOR_RESOLUTION);
        let given = given.and_then(|t| match numbers(t).as_deref() {
            Some(&[w, h]) => Some([w, h]),
            _ => None,
        });
        let texture = node.named("irradiance");
        let texture = texture
            .map(|t| self.resolve(t))
            .transpose()?
            .filter(|t| t.tag == "texture");
        let (size, irradiance) = match texture {
            Some(texture) => (self.white(texture)?, "1".to_owned()),
            None => {
                let square = given.unwrap_or([256.0; 2]);
                if square[0] != square[1] {
                    return self.error(
                        &node.span,
                        "a projector without an image is square",
                        "give projector_resolution two equal numbers",
                    );
                }
                (square, self.spectrum(node, "irradiance")?.unwrap_or("1".into()))
            }
        };
        let fov = field_of_view(self, node, size[0] / size[1])?;
        let pose = pose(self, node)?;
        node.finish(source, &[])?;
        let text = format!(
            "[projector]\nresolution = {}\nfov_x_deg = {}\nirradiance = {}\n{pose}",
            list(&size),
            digits(fov),
            scaled(&irradiance, factor)
        );
        self.block(&node.span, &text);
        Ok(())
    }

    /// Size of a projector's image, which must be white: patterns are chosen in probing.
    fn white(&self, node: &'a Node) -> Result<[f64; 2], InputError> {
        let source = self.source;
        let name = node.text(source, "filename")?.unwrap_or_default();
        let refused = |what: String| {
            source.error(
                &node.span,
                what,
                "give a white PNG of the projector's size; patterns belong to `sunstone probe`",
            )
        };
        if node.kind != "bitmap" {
            return Err(refused(format!(
                "a projector's image cannot be a texture `{}`",
                node.kind
            )));
        }
        let image = image::open(self.path(name)).map_err(|e| refused(format!("cannot read {name}: {e}")))?;
        let rgb = image.to_rgb16();
        if rgb.pixels().any(|p| p.0 != [u16::MAX; 3]) {
            return Err(refused(format!("{name} is not white")));
        }
        node.finish(
            source,
            &["raw", "format", "to_uv", "filter_type", "wrap_mode", "accel"],
        )?;
        Ok([f64::from(rgb.width()), f64::from(rgb.height())])
    }
}

/// Horizontal field of view in degrees from `fov` and `fov_axis`, or from a focal length on 35 mm film.
fn field_of_view(importer: &Importer, node: &Node, aspect: f64) -> Result<f64, InputError> {
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

/// The pose as TOML: Mitsuba's devices have +x left and +y up.
fn pose(importer: &Importer, node: &Node) -> Result<String, InputError> {
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
    Ok(format!("pose.matrix = {}\n", matrix(&device)))
}

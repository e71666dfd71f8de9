//! Converts Mitsuba's emitters to the projector and the emitters of a scene file.

use super::import_devices::{device, field_of_view, pose};
use super::import_surfaces::{Coordinates, image_of};
use super::importer::Importer;
use super::names::PROJECTOR_RESOLUTION;
use super::tree::{Node, numbers};
use crate::build::pose::matrix;
use base::locate::{InputError, Located};
use glam::{DAffine3, DMat3};
use import::picture;
use std::f64::consts::PI;
use syntax::device::{EmitterFile, ProjectorFile, SlideFile};
use syntax::emitter::{DirectionalFile, EmissionFile, EnvironmentFile, Rows, SpotFile};
use syntax::texture::ImageAlbedo;
use syntax::values::SpectrumFile;

#[derive(Default)]
pub(super) struct Emitters {
    pub emitters: Vec<Located<EmitterFile>>,
    pub projector: Option<Located<ProjectorFile>>,
}

impl Emitters {
    fn has_environment(&self) -> bool {
        let is_environment = |e: &Located<EmitterFile>| matches!(**e, EmitterFile::Environment(_));
        self.emitters.iter().any(is_environment)
    }
}

pub(super) fn add<'a>(
    importer: &mut Importer<'a>,
    node: &'a Node,
    file: &mut Emitters,
) -> Result<(), InputError> {
    let source = importer.source;
    let emitter = match node.kind.as_str() {
        "point" => {
            one_of(importer, node, "position", "to_world")?;
            let place = node.transform(source, "to_world")?.map(|t| t.translation);
            let position = node.vector(source, "position")?.or(place).unwrap_or_default();
            let intensity = importer.spectrum_or(node, "intensity", 1.0)?;
            let mut point = EmitterFile::point(position.to_array(), 1.0);
            if let EmitterFile::Point(point) = &mut point {
                point.intensity = intensity;
            }
            sampling_weight(importer, node)?;
            node.finish(source, &[]);
            point
        }
        "spot" => spot(importer, node)?,
        "directional" => directional(importer, node)?,
        "constant" | "envmap" if file.has_environment() => {
            return importer.error(
                &node.span,
                "the scene has a second environment emitter",
                "keep one environment",
            );
        }
        "envmap" => envmap(importer, node)?,
        "constant" => {
            let radiance = importer.spectrum_or(node, "radiance", 1.0)?;
            let mut environment = EmitterFile::environment(1.0);
            if let EmitterFile::Environment(environment) = &mut environment {
                environment.radiance = radiance;
            }
            sampling_weight(importer, node)?;
            // A rotation does not change a constant environment.
            node.finish(source, &["to_world"]);
            environment
        }
        "projector" => match projector(importer, node)? {
            Projected::Slide(slide) => EmitterFile::Slide(slide),
            Projected::Patterns(_) if file.projector.is_some() => {
                return importer.error(
                    &node.span,
                    "the scene has a second projector without an image",
                    "keep one projector",
                );
            }
            Projected::Patterns(projector) => {
                file.projector = Some(node.at(*projector));
                return Ok(());
            }
        },
        other => {
            return importer.error(
                &node.span,
                format!("unsupported emitter `{other}`"),
                "use projector, point, spot, directional, constant, envmap, or area on a shape",
            );
        }
    };
    file.emitters.push(node.at(emitter));
    Ok(())
}

/// Converts Mitsuba's `spot` emitter, which points along its +z axis.
fn spot<'a>(importer: &mut Importer<'a>, node: &'a Node) -> Result<EmitterFile, InputError> {
    let source = importer.source;
    let image = projected(importer, node, "texture")?;
    let place = node.transform(source, "to_world")?.unwrap_or_default();
    if image.is_some() && place.matrix3.determinant() < 0.0 {
        return importer.error(
            &node.span,
            "the to_world of a spot with a texture contains a reflection",
            "use only lookat, rotate and translate",
        );
    }
    // In Mitsuba, the image's up direction is the spot's +y axis and the image's right direction is the
    // spot's +x axis, so the image is mirrored.
    let up = image.as_ref().map(|_| (-place.matrix3.y_axis).to_array());
    let cutoff = node.float(source, "cutoff_angle")?.unwrap_or(20.0);
    let beam = node.float(source, "beam_width")?.unwrap_or(0.75 * cutoff);
    let spot = SpotFile {
        position: place.translation.to_array(),
        direction: place.matrix3.z_axis.to_array(),
        intensity: importer.spectrum_or(node, "intensity", 1.0)?,
        cutoff_deg: node.at(cutoff),
        beam_deg: Some(node.at(beam)),
        image,
        up,
        horizontal: [1.0, 0.0, 0.0],
    };
    sampling_weight(importer, node)?;
    node.finish(source, &[]);
    Ok(EmitterFile::Spot(spot))
}

/// Converts Mitsuba's `directional` emitter. Light travels along `direction` or along the +z axis of
/// `to_world`.
fn directional<'a>(importer: &mut Importer<'a>, node: &'a Node) -> Result<EmitterFile, InputError> {
    let source = importer.source;
    one_of(importer, node, "direction", "to_world")?;
    let place = node.transform(source, "to_world")?.unwrap_or_default();
    let direction = node.vector(source, "direction")?.unwrap_or(place.matrix3.z_axis);
    let irradiance = importer.spectrum_or(node, "irradiance", 1.0)?;
    sampling_weight(importer, node)?;
    node.finish(source, &[]);
    Ok(EmitterFile::Directional(DirectionalFile {
        direction: direction.to_array(),
        irradiance,
        origin: None,
        stokes: None,
        polarizer_deg: None,
        horizontal: [1.0, 0.0, 0.0],
    }))
}

fn envmap<'a>(importer: &mut Importer<'a>, node: &'a Node) -> Result<EmitterFile, InputError> {
    let source = importer.source;
    let name = importer.filename(node, "envmap")?;
    let scale = node.float(source, "scale")?.unwrap_or(1.0);
    let place = node.transform(source, "to_world")?;
    sampling_weight(importer, node)?;
    // `mis_compensation` affects noise only.
    node.finish(source, &["mis_compensation"]);
    let mut environment = EnvironmentFile::new(scale);
    environment.rows = Rows::Poles;
    environment.image = Some(node.at(importer.file(name)));
    environment.transform = match place {
        None => None,
        Some(map) => {
            let turn = directions(map.matrix3).ok_or_else(|| {
                source.error(
                    &node.span,
                    "the to_world of the envmap contains scale or shear: Mitsuba then distorts the image",
                    "use only rotations and reflections",
                )
            })?;
            Some(node.at(matrix(&DAffine3::from_mat3(turn))))
        }
    };
    Ok(EmitterFile::Environment(Box::new(environment)))
}

/// Orthonormalizes a linear map that is a rotation or a reflection within rounding errors. Returns `None` for
/// other maps.
fn directions(map: DMat3) -> Option<DMat3> {
    let off = map.transpose() * map - DMat3::IDENTITY;
    let rigid = off.to_cols_array().iter().all(|v| v.abs() < 1e-3);
    rigid.then(|| {
        // Orthonormalize by Gram–Schmidt, and keep the orientation of the third column.
        let x = map.x_axis.normalize();
        let y = map.y_axis.reject_from_normalized(x).normalize();
        DMat3::from_cols(x, y, x.cross(y) * map.determinant().signum())
    })
}

/// Converts the `area` emitter of a shape.
pub(super) fn area<'a>(
    importer: &mut Importer<'a>,
    node: &'a Node,
    turned: bool,
) -> Result<(Located<EmissionFile>, bool), InputError> {
    if node.kind != "area" {
        return importer.error(
            &node.span,
            format!("unsupported emitter `{}` of a shape", node.kind),
            "use an area emitter",
        );
    }
    let mut emission = EmissionFile::new(1.0);
    let mut uv = Coordinates { turned, images: false };
    match image_of(importer, node, "radiance", &mut uv)? {
        Some(image) => emission.image = Some(node.at(image)),
        None => emission.radiance = importer.spectrum_or(node, "radiance", 1.0)?,
    }
    sampling_weight(importer, node)?;
    node.finish(importer.source, &[]);
    Ok((node.at(emission), uv.images))
}

/// Adds a note if Mitsuba never samples the emitter because its sampling weight is 0. Other weights affect
/// only the noise.
fn sampling_weight(importer: &mut Importer, node: &Node) -> Result<(), InputError> {
    if node.float(importer.source, "sampling_weight")? == Some(0.0) {
        importer.note(format!(
            "sampling_weight = 0 of the emitter `{}` is not used: Sunstone samples all emitters",
            node.kind
        ));
    }
    Ok(())
}

/// Refuses a plugin that has both property `a` and property `b`, because the two properties have the same
/// meaning.
fn one_of(importer: &Importer, node: &Node, a: &str, b: &str) -> Result<(), InputError> {
    if node.get(a).is_some() && node.get(b).is_some() {
        return importer.error(
            &node.span,
            format!("the emitter `{}` has both {a} and {b}", node.kind),
            "remove one of the two parameters",
        );
    }
    Ok(())
}

/// Returns the image that an emitter projects, if any. In Mitsuba, the v axis of a projected image points
/// down.
fn projected<'a>(
    importer: &Importer<'a>,
    node: &'a Node,
    name: &str,
) -> Result<Option<Located<ImageAlbedo>>, InputError> {
    let mut uv = Coordinates { turned: true, images: false };
    let image = image_of(importer, node, name, &mut uv)?;
    Ok(image.map(|image| node.at(image)))
}

/// Result of converting a Mitsuba projector.
enum Projected {
    /// The projector of the scene file. Its pixels are the axis s' of the transport tensor T.
    Patterns(Box<ProjectorFile>),
    /// An emitter that projects an image.
    Slide(Box<SlideFile>),
}

/// Converts Mitsuba's `projector`. In Mitsuba, the irradiance on the plane at 1 m is π × `scale` ×
/// `irradiance`.
fn projector<'a>(importer: &mut Importer<'a>, node: &'a Node) -> Result<Projected, InputError> {
    let factor = PI * node.float(importer.source, "scale")?.unwrap_or(1.0);
    let given = importer.document.parameters.get(PROJECTOR_RESOLUTION);
    let given = given.and_then(|t| match numbers(t).as_deref() {
        Some(&[w, h]) => Some([w, h]),
        _ => None,
    });
    let at = |v: f64| node.at(v);
    let one = || node.at(SpectrumFile::Scalar(1.0));
    let image = projected(importer, node, "irradiance")?;
    let (size, irradiance) = if let Some(image) = &image {
        let (size, white) = decoded(importer, node, "irradiance")?;
        if !white {
            importer.note(
                "a projector with an image that is not white is imported as an emitter (`slide`); the tensor T does not resolve the \
                 pixels of this emitter; to project patterns, use `sunstone probe`",
            );
            let fov = field_of_view(importer, node, f64::from(size[0]) / f64::from(size[1]))?;
            let pose = node.at(pose(importer, node)?);
            node.finish(importer.source, &[]);
            return Ok(Projected::Slide(Box::new(SlideFile {
                image: image.clone(),
                irradiance: node.at(scaled(&SpectrumFile::Scalar(1.0), factor)),
                fov_x_deg: at(fov),
                pose,
            })));
        }
        (size, one())
    } else {
        let [w, h] = given.unwrap_or([256.0; 2]);
        // The limit is the limit of a projector's resolution.
        if w != h || w.fract() != 0.0 || !(1.0..=32768.0).contains(&w) {
            return importer.error(
                &node.span,
                format!("a projector without an image cannot have {w} × {h} pixels"),
                "set projector_resolution to two equal integers in 1..32768",
            );
        }
        ([w as u32; 2], importer.spectrum_or(node, "irradiance", 1.0)?)
    };
    let fov = field_of_view(importer, node, f64::from(size[0]) / f64::from(size[1]))?;
    let pose = pose(importer, node)?;
    node.finish(importer.source, &[]);
    let mut projector = ProjectorFile::new(device(node, pose, size, fov));
    projector.irradiance = Located::at(irradiance.span(), scaled(&irradiance, factor));
    Ok(Projected::Patterns(Box::new(projector)))
}

fn scaled(spectrum: &SpectrumFile, factor: f64) -> SpectrumFile {
    // Irradiances are f32 in the scene. Rounding to f32 removes the rounding error of the factor.
    let times = |v: &f64| f64::from((v * factor) as f32);
    let mut out = spectrum.clone();
    match &mut out {
        SpectrumFile::Scalar(v) => *v = times(v),
        SpectrumFile::PerWavelength(values) => values.iter_mut().for_each(|v| *v = times(v)),
        SpectrumFile::Table(table) => table.values.iter_mut().for_each(|v| *v = times(v)),
    }
    out
}

/// Returns the size in pixels of a projector's image, and whether the image is uniformly white.
fn decoded<'a>(importer: &Importer<'a>, node: &'a Node, name: &str) -> Result<([u32; 2], bool), InputError> {
    let file = node.named(name).map(|child| importer.resolve(child)).transpose()?;
    let file = file.map(|texture| texture.text(importer.source, "filename")).transpose()?;
    let name = file.flatten().unwrap_or_default();
    let refused = |what: String| {
        let fix = "give a readable image file";
        importer.source.error(&node.span, what, fix)
    };
    let path = importer.path(name);
    let bytes = base::input::read(&path).map_err(|e| refused(format!("cannot read {name}: {e}")))?;
    let decoded = picture::decode(name, &bytes, None)
        .map_err(|e| refused(format!("cannot decode {name}: {}", e.message)))?;
    let white = decoded.values.iter().all(|p| *p == [1.0; 3]);
    Ok(([decoded.width as u32, decoded.height as u32], white))
}

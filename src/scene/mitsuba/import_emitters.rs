//! Mitsuba's emitters → the projector and the emitters of a scene file.

use super::import_devices::{device, field_of_view, pose};
use super::importer::Importer;
use super::names::PROJECTOR_RESOLUTION;
use super::tree::{Node, numbers};
use base::locate::{InputError, Located};
use std::f64::consts::PI;
use syntax::device::{EmitterFile, ProjectorFile};
use syntax::values::SpectrumFile;

/// The emitters of a scene.
#[derive(Default)]
pub(super) struct Emitters {
    pub emitters: Vec<Located<EmitterFile>>,
    pub projector: Option<Located<ProjectorFile>>,
}

/// Adds an emitter or the projector.
pub(super) fn add<'a>(
    importer: &Importer<'a>,
    node: &'a Node,
    file: &mut Emitters,
) -> Result<(), InputError> {
    let source = importer.source;
    let emitter = match node.kind.as_str() {
        "point" => {
            let place = node.transform(source, "to_world")?.map(|t| t.translation);
            let position = node.vector(source, "position")?.or(place).unwrap_or_default();
            let intensity = importer.spectrum_or(node, "intensity", 1.0)?;
            let mut point = EmitterFile::point(position.to_array(), 1.0);
            if let EmitterFile::Point(point) = &mut point {
                point.intensity = intensity;
            }
            node.finish(source, &[]);
            point
        }
        "constant" => {
            let is_environment = |e: &Located<EmitterFile>| matches!(**e, EmitterFile::Environment(_));
            if file.emitters.iter().any(is_environment) {
                return importer.error(&node.span, "a second environment", "keep one");
            }
            let radiance = importer.spectrum_or(node, "radiance", 1.0)?;
            let mut environment = EmitterFile::environment(1.0);
            if let EmitterFile::Environment(environment) = &mut environment {
                environment.radiance = radiance;
            }
            node.finish(source, &["to_world"]);
            environment
        }
        "projector" if file.projector.is_some() => {
            return importer.error(&node.span, "a second projector", "keep one");
        }
        "projector" => {
            file.projector = Some(Located::at(node.span.clone(), projector(importer, node)?));
            return Ok(());
        }
        other => {
            return importer.error(
                &node.span,
                format!("sunstone has no emitter `{other}`"),
                "use projector, point or constant",
            );
        }
    };
    file.emitters.push(Located::at(node.span.clone(), emitter));
    Ok(())
}

/// Mitsuba's projector gives π times its `scale` × `irradiance` on the plane at 1 m.
fn projector<'a>(importer: &Importer<'a>, node: &'a Node) -> Result<ProjectorFile, InputError> {
    let factor = PI * node.float(importer.source, "scale")?.unwrap_or(1.0);
    let given = importer.document.parameters.get(PROJECTOR_RESOLUTION);
    let given = given.and_then(|t| match numbers(t).as_deref() {
        Some(&[w, h]) => Some([w, h]),
        _ => None,
    });
    let texture = node.named("irradiance");
    let texture = texture
        .map(|t| importer.resolve(t))
        .transpose()?
        .filter(|t| t.tag == "texture");
    let one = || Located::at(node.span.clone(), SpectrumFile::Scalar(1.0));
    let (size, irradiance) = if let Some(texture) = texture {
        (white(importer, texture)?, one())
    } else {
        let [w, h] = given.unwrap_or([256.0; 2]);
        // The film's largest size is the projector's too.
        if w != h || w.fract() != 0.0 || !(1.0..=32768.0).contains(&w) {
            return importer.error(
                &node.span,
                "a projector without an image is square",
                "give projector_resolution two equal whole numbers in 1..32768",
            );
        }
        ([w as u32; 2], importer.spectrum_or(node, "irradiance", 1.0)?)
    };
    let fov = field_of_view(importer, node, f64::from(size[0]) / f64::from(size[1]))?;
    let pose = pose(importer, node)?;
    node.finish(importer.source, &[]);
    let mut projector = ProjectorFile::new(device(node, pose, size, fov));
    projector.irradiance = Located::at(irradiance.span(), scaled(&irradiance, factor));
    Ok(projector)
}

/// A spectrum, each value multiplied.
fn scaled(spectrum: &SpectrumFile, factor: f64) -> SpectrumFile {
    // Irradiances are f32 in the end: rounding there takes the factor's own rounding away.
    let times = |v: &f64| f64::from((v * factor) as f32);
    let mut out = spectrum.clone();
    match &mut out {
        SpectrumFile::Scalar(v) => *v = times(v),
        SpectrumFile::PerWavelength(values) => values.iter_mut().for_each(|v| *v = times(v)),
        SpectrumFile::Table(table) => table.values.iter_mut().for_each(|v| *v = times(v)),
    }
    out
}

/// Size of a projector's image, which must be white: patterns are chosen in probing.
fn white(importer: &Importer, node: &Node) -> Result<[u32; 2], InputError> {
    let source = importer.source;
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
    let path = importer.path(name);
    let image = base::input::open(&path)
        .map_err(image::ImageError::from)
        .and_then(|_| image::open(&path))
        .map_err(|e| refused(format!("cannot read {name}: {e}")))?;
    let rgb = image.to_rgb16();
    if rgb.pixels().any(|p| p.0 != [u16::MAX; 3]) {
        return Err(refused(format!("{name} is not white")));
    }
    node.finish(
        source,
        &["raw", "format", "to_uv", "filter_type", "wrap_mode", "accel"],
    );
    Ok([rgb.width(), rgb.height()])
}

//! Mitsuba 3's XML → a scene file in TOML.
//!
//! The subset is that of [`super::export`]. Colours given as RGB are taken as the values at the scene's wavelengths: red
//! above 590 nm, green from 500 to 590 nm, blue below (660, 550 and 450 nm unless the file or `-D wavelengths_nm=…` says
//! otherwise). One-sided BSDFs become `two_sided` with a black back.

use super::document::Document;
use super::files::{Contents, WriteError, write_one};
use super::folders::read_text;
use super::import_devices;
use super::import_emitters::{self, Emitters};
use super::import_instances::Groups;
use super::import_shapes::{self, Readers};
use super::importer::Importer;
use super::source::Source;
use super::tree::{Inside, Node};
use crate::build::assemble;
use crate::build::context::Context;
use base::locate::{InputError, Located};
use std::collections::BTreeMap;
use std::path::Path;
use syntax::device::EmitterFile;
use syntax::scene::{RenderFile, SceneFile};
use syntax::slice::SliceFile;

/// A scene in our language.
#[derive(Clone, Debug)]
pub struct Import {
    /// The scene, which has been built once, so it is right; what the XML says stands at its place there.
    pub scene: SceneFile,
    /// The text of its file.
    pub toml: String,
    /// What changes its meaning on the way.
    pub notes: Vec<String>,
}

/// Everything that keeps a scene from being imported.
#[derive(Debug, thiserror::Error)]
#[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
pub struct ImportError(
    /// At least one, file by file, from top to bottom.
    pub Vec<InputError>,
);

impl From<InputError> for ImportError {
    fn from(e: InputError) -> Self {
        Self(vec![e])
    }
}

impl Import {
    /// Reads and translates Mitsuba's file `xml` to a scene file that is to lie at `toml`; `parameters` are the values of
    /// `$name` (as Mitsuba's `-D`).
    ///
    /// # Errors
    /// [`ImportError`]: everything that is not understood, with file, line, column and mend.
    pub fn load(xml: &Path, toml: &Path, parameters: &BTreeMap<String, String>) -> Result<Self, ImportError> {
        let text = read_text(xml).map_err(|e| InputError {
            file: xml.to_owned(),
            text: "".into(),
            span: None,
            message: format!("cannot read the scene: {e}"),
            help: Some("give the path of an XML file of Mitsuba 3, or of a dictionary as JSON".into()),
        })?;
        Self::from_text(xml, &text, toml, parameters)
    }

    /// As [`Self::load`], of a text; `xml` names it in messages and anchors the files it refers to.
    ///
    /// # Errors
    /// As there.
    pub fn from_text(
        xml: &Path,
        text: &str,
        toml: &Path,
        parameters: &BTreeMap<String, String>,
    ) -> Result<Self, ImportError> {
        Self::with_files(xml, text, toml, parameters, &BTreeMap::new())
    }

    /// As [`Self::from_text`], where some files are only in memory, by the names that the text and the scene file have of them.
    ///
    /// # Errors
    /// As there.
    pub fn with_files(
        xml: &Path,
        text: &str,
        toml: &Path,
        parameters: &BTreeMap<String, String>,
        files: &BTreeMap<String, Vec<u8>>,
    ) -> Result<Self, ImportError> {
        let document = Document::parse(xml, text, parameters)?;
        let done = Importer::new(&document, toml).and_then(|importer| run(importer, toml, files));
        let mut problems = document.source.problems();
        match done {
            Ok(Some(import)) => Ok(import),
            Ok(None) => Err(ImportError(problems)),
            Err(e) => {
                problems.push(e);
                Err(ImportError(problems))
            }
        }
    }

    /// Writes the scene file, at once or not at all.
    ///
    /// # Errors
    /// [`WriteError`] if the file is there already and `force` is not given, or the file system refuses.
    pub fn write(&self, toml: &Path, force: bool) -> Result<(), WriteError> {
        write_one(toml, &Contents::Bytes(self.toml.clone().into_bytes()), force)
    }
}

/// The scene, `None` if problems were reported.
fn run(
    mut importer: Importer,
    toml: &Path,
    files: &BTreeMap<String, Vec<u8>>,
) -> Result<Option<Import>, InputError> {
    let document = importer.document;
    let (source, scene) = (&document.source, &document.scene);
    let mut parts = Parts::default();
    for child in scene.children() {
        let Inside::Node(node) = child.take() else {
            source.report(source.error(
                child.span(),
                "a reference does nothing here",
                "put it into a shape, or take it away",
            ));
            continue;
        };
        if let Err(e) = parts.sort(source, node) {
            source.report(e);
        }
    }
    scene.finish(source, &[]);
    let sensor = parts.sensor.ok_or_else(|| {
        source.error(
            &scene.span,
            "the scene has no sensor",
            "add <sensor type=\"perspective\">",
        )
    });
    let camera = sensor.and_then(|sensor| Ok((sensor, import_devices::sensor(&mut importer, sensor)?)));
    let depth = import_devices::integrator(&mut importer, parts.integrator);
    let mut reader = Readers::default();
    let (mut objects, mut emitters) = (vec![], Emitters::default());
    for node in parts.bsdfs.iter().filter(|n| !n.broken) {
        reader.materials.named(&mut importer, node, false);
    }
    let mut groups = Groups::default();
    for node in parts.shapes.iter().filter(|n| !n.broken) {
        let added = match node.kind.as_str() {
            "shapegroup" => {
                groups.group(&mut importer, &mut reader, node);
                Ok(())
            }
            "instance" => groups.instance(&mut importer, &mut reader, node),
            _ => import_shapes::objects(&mut importer, &mut reader, node)
                .map(|new| objects.extend(new.into_iter().map(|o| Located::at(node.span.clone(), o)))),
        };
        if let Err(e) = added {
            source.report(e);
        }
    }
    for node in parts.emitters.iter().filter(|n| !n.broken) {
        if let Err(e) = import_emitters::add(&mut importer, node, &mut emitters) {
            source.report(e);
        }
    }
    let (sensor, camera, spp, depth) = match (camera, depth) {
        (Ok((sensor, (camera, spp))), Ok(depth)) => (sensor, camera, spp, depth),
        (camera, depth) => {
            for e in [camera.err(), depth.err()].into_iter().flatten() {
                source.report(e);
            }
            return Ok(None);
        }
    };
    let mut file = SceneFile {
        wavelengths_nm: Located::at(scene.span.clone(), importer.wavelengths.clone()),
        render: RenderFile {
            spp,
            max_depth: depth.max_depth,
            rr_depth: depth.rr_depth,
            ..RenderFile::default()
        },
        slices: vec![SliceFile::new("mueller").mueller().into()],
        ..SceneFile::new(camera)
    };
    file.camera = Located::at(sensor.span.clone(), (*file.camera).clone());
    file.materials = reader.materials.table.materials;
    file.media = reader.media.media;
    file.objects = objects;
    file.groups = groups.groups;
    file.instances = groups.instances;
    file.emitters = emitters.emitters;
    file.projector = emitters.projector;
    let is_environment = |e: &Located<EmitterFile>| matches!(**e, EmitterFile::Environment(_));
    if parts.hides_emitters && file.emitters.iter().any(is_environment) {
        return Err(source.error(
            &parts.integrator.map_or(0..0, |i| i.span.clone()),
            "hide_emitters hides the environment, which sunstone shows",
            "take hide_emitters away",
        ));
    }
    if source.any_problem() {
        // What was left out would make others.
        return Ok(None);
    }
    check(&importer, &file, toml, files)?;
    let text = file.to_toml().map_err(|e| {
        source.error(
            &scene.span,
            format!("the scene cannot be written: {e}"),
            "use smaller whole numbers",
        )
    })?;
    Ok(Some(Import {
        toml: heading(&source.main().0) + &text,
        scene: file,
        notes: importer.notes,
    }))
}

/// What the scene file says of itself.
fn heading(xml: &Path) -> String {
    let name = xml.file_name().unwrap_or_default().to_string_lossy();
    format!(
        "# Written by sunstone import from {}.\n\
         # Colours given as RGB stand for 660, 550 and 450 nm: red above 590 nm, green from 500 nm, blue below.\n\n",
        name.replace(char::is_control, "_")
    )
}

/// Builds the scene, whose places are those of the XML file, and whose files are named from where it is to lie.
fn check(
    importer: &Importer,
    file: &SceneFile,
    toml: &Path,
    files: &BTreeMap<String, Vec<u8>>,
) -> Result<(), InputError> {
    let source = importer.source;
    let folder = toml.parent().unwrap_or(Path::new(""));
    let (name, text) = source.main();
    let mut ctx = Context::new(&name, &text, &file.wavelengths_nm)?
        .in_folder(folder)
        .with_files(files.clone());
    let built = assemble::build(&mut ctx, file);
    built.map(drop).map_err(|e| {
        source.placed(InputError {
            span: e.span.or(Some(importer.document.scene.span.clone())),
            help: e.help.or(Some("correct the value".into())),
            ..e
        })
    })
}

/// What a scene holds, by kind.
#[derive(Default)]
struct Parts<'a> {
    sensor: Option<&'a Node>,
    integrator: Option<&'a Node>,
    hides_emitters: bool,
    bsdfs: Vec<&'a Node>,
    shapes: Vec<&'a Node>,
    emitters: Vec<&'a Node>,
}

impl<'a> Parts<'a> {
    fn sort(&mut self, source: &Source, node: &'a Node) -> Result<(), InputError> {
        match node.tag.as_str() {
            "sensor" if self.sensor.is_none() => self.sensor = Some(node),
            "integrator" if self.integrator.is_none() => {
                let mut hides = false;
                node.walk(&mut |n| hides |= matches!(n.boolean(source, "hide_emitters"), Ok(Some(true))));
                self.hides_emitters = hides;
                self.integrator = Some(node);
            }
            "sensor" | "integrator" => {
                let message = format!("a second {}", node.tag);
                return Err(source.error(&node.span, message, "keep one"));
            }
            "bsdf" => self.bsdfs.push(node),
            "shape" => self.shapes.push(node),
            "emitter" => self.emitters.push(node),
            // Textures and spectra are read where something refers to them.
            "texture" | "spectrum" | "medium" => {}
            other => {
                let message = format!("sunstone cannot express a {other}");
                return Err(source.error(&node.span, message, "take it away"));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{DynamicImage, ImageFormat, Rgb32FImage, RgbImage};
    use std::io::Cursor;

    fn encoded(image: DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(vec![]);
        image.write_to(&mut bytes, format).expect("fits");
        bytes.into_inner()
    }

    /// Files in memory are read by their names; colours of formats that hold light are linear, others are decoded.
    #[test]
    fn images_in_memory_are_read_as_their_formats_say() {
        let files: BTreeMap<String, Vec<u8>> = [
            (
                "light.exr".to_owned(),
                encoded(Rgb32FImage::new(2, 2).into(), ImageFormat::OpenExr),
            ),
            (
                "colours.png".to_owned(),
                encoded(RgbImage::new(2, 2).into(), ImageFormat::Png),
            ),
        ]
        .into();
        let text = |name: &str| {
            format!(
                r#"{{"type": "scene", "camera": {{"type": "perspective"}}, "sky": {{"type": "constant"}}, "wall": {{"type": "rectangle",
                "bsdf": {{"type": "diffuse", "reflectance": {{"type": "bitmap", "filename": "{name}"}}}}}}}}"#
            )
        };
        let made = |name: &str, files: &BTreeMap<String, Vec<u8>>| {
            let (xml, toml) = (Path::new("/nowhere/scene.json"), Path::new("/nowhere/scene.toml"));
            Import::with_files(xml, &text(name), toml, &BTreeMap::new(), files)
        };
        assert!(
            made("light.exr", &files)
                .expect("a scene")
                .toml
                .contains("raw = true")
        );
        assert!(!made("colours.png", &files).expect("a scene").toml.contains("raw"));
        let missing = made("light.exr", &BTreeMap::new())
            .expect_err("no file")
            .to_string();
        assert!(missing.contains("light.exr"), "{missing}");
    }
}

//! Mitsuba 3's XML → a scene file in TOML.
//!
//! The subset is that of [`super::export`]. Colours given as RGB are taken as the values at the scene's wavelengths: red
//! above 590 nm, green from 500 to 590 nm, blue below (660, 550 and 450 nm unless the file or `-D wavelengths_nm=…` says
//! otherwise). One-sided BSDFs become `two_sided` with a black back.

use super::files::{Contents, WriteError, write_one};
use super::import_materials::MaterialReader;
use super::importer::Importer;
use super::reader::Document;
use super::tree::{Inside, Node, Source};
use super::{import_devices, import_shapes};
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

impl Import {
    /// Reads and translates Mitsuba's file `xml` to a scene file that is to lie at `toml`; `parameters` are the values of
    /// `$name` (as Mitsuba's `-D`).
    ///
    /// # Errors
    /// [`InputError`] naming file, line, column, what is not understood, and the mend.
    pub fn load(xml: &Path, toml: &Path, parameters: &BTreeMap<String, String>) -> Result<Self, InputError> {
        let text = std::fs::read_to_string(xml).map_err(|e| InputError {
            file: xml.to_owned(),
            text: "".into(),
            span: None,
            message: format!("cannot read the scene: {e}"),
            help: Some("give the path of an XML file of Mitsuba 3".into()),
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
    ) -> Result<Self, InputError> {
        let document = Document::parse(xml, text, parameters)?;
        run(Importer::new(&document, toml)?, toml)
    }

    /// Writes the scene file, at once or not at all.
    ///
    /// # Errors
    /// [`WriteError`] if the file is there already and `force` is not given, or the file system refuses.
    pub fn write(&self, toml: &Path, force: bool) -> Result<(), WriteError> {
        write_one(toml, &Contents::Bytes(self.toml.clone().into_bytes()), force)
    }
}

fn run(mut importer: Importer, toml: &Path) -> Result<Import, InputError> {
    let document = importer.document;
    let (source, scene) = (&document.source, &document.scene);
    let mut parts = Parts::default();
    for child in scene.children() {
        let Inside::Node(node) = child.take() else {
            return Err(source.error(
                child.span(),
                "a reference does nothing here",
                "put it into a shape, or take it away",
            ));
        };
        parts.sort(source, node)?;
    }
    scene.finish(source, &[])?;
    let Some(sensor) = parts.sensor else {
        return Err(source.error(
            &scene.span,
            "the scene has no sensor",
            "add <sensor type=\"perspective\">",
        ));
    };
    let (camera, spp) = import_devices::sensor(&importer, sensor)?;
    let depth = import_devices::integrator(&mut importer, parts.integrator)?;
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
    let mut materials = MaterialReader::default();
    for node in &parts.bsdfs {
        materials.named(&mut importer, node)?;
    }
    for node in &parts.shapes {
        let object = import_shapes::object(&mut importer, &mut materials, node)?;
        file.objects.push(Located::at(node.span.clone(), object));
    }
    file.materials = materials.materials;
    for node in &parts.emitters {
        import_devices::emitter(&importer, node, &mut file)?;
    }
    let is_environment = |e: &Located<EmitterFile>| matches!(**e, EmitterFile::Environment(_));
    if parts.hides_emitters && file.emitters.iter().any(is_environment) {
        return Err(source.error(
            &parts.integrator.map_or(0..0, |i| i.span.clone()),
            "hide_emitters hides the environment, which sunstone shows",
            "take hide_emitters away",
        ));
    }
    check(&importer, &file, toml)?;
    let text = file.to_toml().map_err(|e| {
        source.error(
            &scene.span,
            format!("the scene cannot be written: {e}"),
            "use smaller whole numbers",
        )
    })?;
    Ok(Import {
        toml: heading(&source.file) + &text,
        scene: file,
        notes: importer.notes,
    })
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
fn check(importer: &Importer, file: &SceneFile, toml: &Path) -> Result<(), InputError> {
    let source = importer.source;
    let folder = toml.parent().unwrap_or(Path::new(""));
    let mut ctx = Context::new(&source.file, &source.text, &file.wavelengths_nm)?.in_folder(folder);
    let built = assemble::build(&mut ctx, file);
    built.map(drop).map_err(|e| InputError {
        span: e.span.or(Some(importer.document.scene.span.clone())),
        help: e.help.or(Some("correct the value".into())),
        ..e
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
            "texture" | "spectrum" => {}
            other => {
                let message = format!("sunstone cannot express a {other}");
                return Err(source.error(&node.span, message, "take it away"));
            }
        }
        Ok(())
    }
}

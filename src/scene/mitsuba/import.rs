//! Converts Mitsuba 3's XML to a scene file in TOML.
//!
//! The import supports the same subset of Mitsuba's format as [`super::export`]. RGB colours become values at
//! the scene's wavelengths: red above 590 nm, green from 500 to 590 nm, and blue below 500 nm. The
//! wavelengths are 660, 550 and 450 nm unless the file or `-D wavelengths_nm=…` sets other wavelengths.
//! One-sided BSDFs become `two_sided` with a black back.

use super::document::Document;
use super::files::{Contents, WriteError, write_one};
use super::folders::read_text;
use super::import_devices::{self, Sensor};
use super::import_emitters::{self, Emitters};
use super::import_instances::Groups;
use super::import_shapes::{self, Readers};
use super::importer::Importer;
use super::tree::{Inside, Node};
use crate::build::assemble;
use crate::build::context::Context;
use base::locate::{InputError, Located};
use glam::DVec2;
use std::collections::BTreeMap;
use std::path::Path;
use syntax::scene::{GapsFile, RenderFile, SceneFile};
use syntax::slice::SliceFile;
use syntax::values::{TimeBins, TimeFile};
use transport::geometry::ray::Ray;
use transport::scene::Scene;

#[derive(Clone, Debug)]
pub struct Import {
    /// The scene file, which has been checked by building the scene. The values of the scene file have
    /// locations in the XML.
    pub scene: SceneFile,
    pub toml: String,
    /// Files to write next to the scene file, by name. The files contain meshes, images and grids that
    /// replace elements without an equivalent in scene files.
    pub files: BTreeMap<String, Vec<u8>>,
    /// Notes about differences from the Mitsuba scene.
    pub notes: Vec<String>,
}

/// All errors that prevent an import.
#[derive(Debug, thiserror::Error)]
#[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
pub struct ImportError(
    /// One or more errors, sorted by file and location.
    pub Vec<InputError>,
);

impl From<InputError> for ImportError {
    fn from(e: InputError) -> Self {
        Self(vec![e])
    }
}

impl Import {
    /// Reads Mitsuba's file `xml` and converts the scene to a scene file for the path `toml`. `parameters`
    /// contains the values of `$name` by name (Mitsuba's `-D`).
    ///
    /// # Errors
    /// Returns [`ImportError`] if the scene has unsupported elements. The error lists each element with file,
    /// line, column and fix.
    pub fn load(xml: &Path, toml: &Path, parameters: &BTreeMap<String, String>) -> Result<Self, ImportError> {
        let text = read_text(xml).map_err(|e| InputError {
            file: xml.to_owned(),
            text: "".into(),
            span: None,
            message: format!("cannot read the scene: {e}"),
            help: Some(
                "give the path of a Mitsuba 3 XML file, or of a scene dictionary in JSON format".into(),
            ),
        })?;
        Self::from_text(xml, &text, toml, parameters)
    }

    /// Converts a scene as [`Self::load`] does, from a text. `xml` is the file's path in messages, and its
    /// folder is the base of relative paths.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::load`].
    pub fn from_text(
        xml: &Path,
        text: &str,
        toml: &Path,
        parameters: &BTreeMap<String, String>,
    ) -> Result<Self, ImportError> {
        Self::with_files(xml, text, toml, parameters, &BTreeMap::new())
    }

    /// Converts a scene as [`Self::from_text`] does, with some files in memory. The files in memory have the
    /// names that the text and the scene file use.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::load`].
    pub fn with_files(
        xml: &Path,
        text: &str,
        toml: &Path,
        parameters: &BTreeMap<String, String>,
        files: &BTreeMap<String, Vec<u8>>,
    ) -> Result<Self, ImportError> {
        let document = Document::parse(xml, text, parameters)?;
        let done = Importer::new(&document, toml, files).and_then(|importer| run(importer, toml, files));
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

    /// Writes the files that the scene needs and then the scene file, each atomically.
    ///
    /// # Errors
    /// Returns [`WriteError`] if a file exists and `force` is not set, or if the file system reports an
    /// error.
    pub fn write(&self, toml: &Path, force: bool) -> Result<(), WriteError> {
        let paths = self.files.keys().map(|name| toml.with_file_name(name));
        if let Some(there) = paths.chain([toml.to_owned()]).find(|path| !force && path.exists()) {
            return Err(WriteError::Exists(there));
        }
        for (name, bytes) in &self.files {
            write_one(&toml.with_file_name(name), &Contents::Bytes(bytes.clone()), force)?;
        }
        write_one(toml, &Contents::Bytes(self.toml.clone().into_bytes()), force)
    }
}

/// Converts the parsed scene. Returns `None` if errors were reported.
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
                "a reference at the top level has no effect",
                "move the reference into a shape, or remove the reference",
            ));
            continue;
        };
        source.accept(parts.sort(&mut importer, node));
    }
    // Acceleration structures do not affect the image.
    let search = |name: &str| name.starts_with("kd_") || name.starts_with("embree_");
    let names = scene.properties.iter().map(|p| p.name.as_str());
    let mut ignored: Vec<&str> = names.filter(|name| search(name)).collect();
    ignored.extend(["allow_thread_reordering", "compact_acceleration_structures"]);
    scene.finish(source, &ignored);
    unused(&mut importer);
    let sensor = parts.sensor.ok_or_else(|| {
        source.error(&scene.span, "the scene has no sensor", "add <sensor type=\"perspective\">")
    });
    let camera = sensor.and_then(|sensor| import_devices::sensor(&mut importer, sensor).map(|s| (sensor, s)));
    let depth = import_devices::integrator(&mut importer, parts.integrator);
    let mut reader = Readers::default();
    let (mut objects, mut emitters) = (vec![], Emitters::default());
    for node in parts.bsdfs.iter().filter(|n| !n.broken) {
        reader.materials.named(&mut importer, node, false);
    }
    let mut groups = Groups::default();
    for node in parts.shapes.iter().filter(|n| !n.broken) {
        source.accept(match node.kind.as_str() {
            "shapegroup" => {
                groups.group(&mut importer, &mut reader, node);
                Ok(())
            }
            "instance" => groups.instance(&mut importer, &mut reader, node),
            _ => import_shapes::all(&mut importer, &mut reader, node)
                .map(|new| objects.extend(new.into_iter().map(|o| node.at(o)))),
        });
    }
    for node in parts.emitters.iter().filter(|n| !n.broken) {
        source.accept(import_emitters::add(&mut importer, node, &mut emitters));
    }
    let (Some((sensor, device)), Some(depth)) = (source.accept(camera), source.accept(depth)) else {
        return Ok(None);
    };
    let Sensor { camera, spp, time, clip } = device;
    let mut file = SceneFile {
        wavelengths_nm: Located::at(scene.span.clone(), importer.wavelengths.clone()),
        render: RenderFile {
            spp,
            max_depth: depth.max_depth,
            rr_depth: depth.rr_depth,
            ..RenderFile::default()
        },
        slices: slices(time),
        ..SceneFile::new(camera)
    };
    file.camera = sensor.at((*file.camera).clone());
    file.materials = reader.materials.table.materials;
    file.media = reader.media.media;
    file.objects = objects;
    file.groups = groups.groups;
    file.instances = groups.instances;
    file.emitters = emitters.emitters;
    file.projector = emitters.projector;
    if source.any_problem() {
        // Elements omitted because of errors would cause further errors.
        return Ok(None);
    }
    let (mut volumetric, mut thin) = (false, false);
    scene.walk(&mut |node| {
        volumetric |= node.tag == "integrator" && node.kind.contains("vol");
        thin |= node.kind == "thindielectric";
    });
    if volumetric && thin && *file.render.max_depth < 64 {
        importer.note(
            "thindielectric: straight transmission counts towards max_depth in Sunstone, but not in Mitsuba's volumetric \
             integrators; increase max_depth",
        );
    }
    if importer.spectral.get() {
        importer.note(
            "spectra are evaluated at the scene's wavelengths, as in Mitsuba's spectral variants; Mitsuba's RGB variants convert spectra to colours",
        );
    }
    let mut files = files.clone();
    files.extend(importer.made.clone());
    let (notes, gap) = check(&importer, &file, toml, files, (sensor, clip))?;
    for note in notes {
        importer.note(note);
    }
    if let Some(gap) = gap {
        file.render.gaps = GapsFile::Warn;
        importer.note(gap);
    }
    let text = file.to_toml().map_err(|e| {
        source.error(&scene.span, format!("cannot serialize the scene: {e}"), "use smaller integers")
    })?;
    Ok(Some(Import {
        toml: heading(&source.main().0) + &text,
        scene: file,
        files: importer.made,
        notes: importer.notes,
    }))
}

/// Returns the slices of the scene file: an image of Mueller matrices, and a transient slice if the film has
/// time bins.
fn slices(time: Option<TimeBins>) -> Vec<Located<SliceFile>> {
    let image = SliceFile::new("mueller").mueller();
    let mut slices = vec![image.clone().into()];
    if let Some(bins) = time {
        let transient =
            SliceFile { name: "transient".to_owned().into(), time: TimeFile::Bins(bins), ..image };
        slices.push(transient.into());
    }
    slices
}

/// Adds a note about each top-level element to which no other element refers.
fn unused(importer: &mut Importer) {
    let document = importer.document;
    let mut named: Vec<&str> = document.aliases.iter().map(|a| a.id.as_str()).collect();
    document.scene.walk(&mut |node| {
        named.extend(node.children().iter().filter_map(|child| match &child.what {
            Inside::Reference { id, .. } => Some(id.as_str()),
            Inside::Node(_) => None,
        }));
    });
    for child in document.scene.children() {
        let Inside::Node(node) = &child.what else {
            continue;
        };
        let alone = match node.tag.as_str() {
            "emitter" => SURFACE_EMITTERS.contains(&node.kind.as_str()),
            "sensor" | "integrator" | "shape" | "bsdf" => false,
            _ => true,
        };
        if alone && !node.id.as_deref().is_some_and(|id| named.contains(&id)) {
            let id = node.id.as_deref().map_or(String::new(), |id| format!(" (id `{id}`)"));
            importer.note(format!(
                "the {} `{}`{id} is not used, because no element refers to it",
                node.tag, node.kind
            ));
        }
    }
}

/// Returns the comment at the start of the scene file.
fn heading(xml: &Path) -> String {
    let name = xml.file_name().unwrap_or_default().to_string_lossy();
    format!(
        "# Written by sunstone import from {}.\n\
         # RGB colours are mapped to wavelengths: red above 590 nm, green from 500 to 590 nm, blue below 500 nm.\n\n",
        name.replace(char::is_control, "_")
    )
}

/// Checks a scene file by building its scene. Errors have locations in the XML file, and file names are
/// relative to the scene file. Returns the notes and, if light is lost in a gap, the message about the gap.
fn check(
    importer: &Importer,
    file: &SceneFile,
    toml: &Path,
    files: BTreeMap<String, Vec<u8>>,
    (sensor, clip): (&Node, [f64; 2]),
) -> Result<(Vec<String>, Option<String>), InputError> {
    let source = importer.source;
    let folder = toml.parent().unwrap_or(Path::new(""));
    let (name, text) = source.main();
    let mut ctx = Context::new(&name, &text, &file.wavelengths_nm)?.in_folder(folder).with_files(files);
    let built = assemble::with_gaps(&mut ctx, file);
    if let Ok((scene, _)) = &built
        && let Some(cut) = cut_off(scene, clip)
    {
        return Err(source.error(
            &sensor.span,
            cut,
            "move the clipping planes (near_clip, far_clip), or remove the clipped surfaces: Sunstone does not clip",
        ));
    }
    let notes_and_gap =
        |(scene, gap): (Scene, Option<InputError>)| (scene.notes.clone(), gap.map(|g| g.message));
    built.map(notes_and_gap).map_err(|e| {
        source.placed(InputError {
            span: e.span.or(Some(importer.document.scene.span.clone())),
            help: e.help.or(Some("correct the value".into())),
            ..e
        })
    })
}

/// Returns a message if the camera sees a surface that Mitsuba's near or far clipping plane removes.
fn cut_off(scene: &Scene, [near, far]: [f64; 2]) -> Option<String> {
    /// Number of test rays per image axis, including the edges of the image.
    const RAYS: u32 = 65;
    let [width, height] = scene.camera.resolution.map(f64::from);
    for k in 0..RAYS * RAYS {
        let part = |i: u32| f64::from(i) / f64::from(RAYS - 1);
        let at = DVec2::new(width * part(k % RAYS), height * part(k / RAYS));
        let camera = scene.camera.at(at);
        let dir = camera.direction(at);
        let Some(hit) = scene.geometry.intersect(&Ray { origin: camera.origin, dir }, f32::INFINITY) else {
            continue;
        };
        let depth = f64::from(hit.t * dir.dot(camera.axes.z_axis));
        for (name, plane, is_cut) in [("near_clip", near, depth < near), ("far_clip", far, depth > far)] {
            if is_cut {
                return Some(format!(
                    "{name} = {plane} clips a surface at depth {depth:.4} m, at pixel ({:.0}, {:.0})",
                    at.x, at.y
                ));
            }
        }
    }
    None
}

/// Mitsuba's emitter plugins that are attached to a shape.
const SURFACE_EMITTERS: [&str; 3] = ["area", "directionalarea", "projectorarea"];

/// The elements of a scene by category.
#[derive(Default)]
struct Parts<'a> {
    sensor: Option<&'a Node>,
    integrator: Option<&'a Node>,
    bsdfs: Vec<&'a Node>,
    shapes: Vec<&'a Node>,
    emitters: Vec<&'a Node>,
}

impl<'a> Parts<'a> {
    fn sort(&mut self, importer: &mut Importer<'a>, node: &'a Node) -> Result<(), InputError> {
        let source = importer.source;
        match node.tag.as_str() {
            "sensor" if self.sensor.is_none() => self.sensor = Some(node),
            "sensor" => {
                importer
                    .note("the scene has several sensors: the first one, which Mitsuba renders, is imported");
            }
            "integrator" if self.integrator.is_none() => self.integrator = Some(node),
            "integrator" => {
                bail!(source, &node.span, "the scene has a second integrator", "keep one integrator");
            }
            "bsdf" => self.bsdfs.push(node),
            "shape" => self.shapes.push(node),
            // Surface emitters are read with the shape that refers to them.
            "emitter" if SURFACE_EMITTERS.contains(&node.kind.as_str()) => {}
            "emitter" => self.emitters.push(node),
            // Textures, media and similar elements are read where another element refers to them.
            "texture" | "spectrum" | "medium" | "phase" | "volume" | "film" | "sampler" | "rfilter" => {}
            other => {
                let message = format!("unsupported element <{other}>");
                return Err(source.error(&node.span, message, "remove the element"));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ImageFormat, Rgb32FImage, RgbImage};
    use import::picture::encoded;

    /// Tests that files in memory are found by name, and that the image reader decides whether colours are
    /// sRGB-encoded.
    #[test]
    fn images_in_memory_are_found() {
        let files: BTreeMap<String, Vec<u8>> = [
            ("light.exr", encoded(&Rgb32FImage::new(2, 2).into(), ImageFormat::OpenExr)),
            ("colours.png", encoded(&RgbImage::new(2, 2).into(), ImageFormat::Png)),
        ]
        .map(|(name, bytes)| (name.to_owned(), bytes.expect("fits")))
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
        for name in ["light.exr", "colours.png"] {
            let toml = made(name, &files).expect("a scene").toml;
            assert!(toml.contains(name) && !toml.contains("raw"), "{toml}");
        }
        let missing = made("light.exr", &BTreeMap::new()).expect_err("no file").to_string();
        assert!(missing.contains("light.exr"), "{missing}");
    }
}

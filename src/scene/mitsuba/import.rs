//! Mitsuba 3's XML → a scene file in TOML.
//!
//! The subset is that of [`super::export`]. Colours given as RGB are taken as the values at the scene's wavelengths: red
//! above 590 nm, green from 500 to 590 nm, blue below (660, 550 and 450 nm unless the file or `-D wavelengths_nm=…` says
//! otherwise). One-sided BSDFs become `two_sided` with a black back.

use super::files::{Contents, WriteError, write_one};
use super::import_materials::MaterialReader;
use super::reader::Document;
use super::toml_text::{list, quoted, relative};
use super::tree::{Inside, Node, Source, Value, numbers};
use super::xml::number as digits;
use super::{WAVELENGTHS, import_shapes};
use base::locate::InputError;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A scene in our language.
#[derive(Clone, Debug)]
pub struct Import {
    /// The text of the scene file; it has been built once, so it is right.
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
        Importer::new(&document, toml)?.run(toml)
    }

    /// Writes the scene file, at once or not at all.
    ///
    /// # Errors
    /// [`WriteError`] if the file is there already and `force` is not given, or the file system refuses.
    pub fn write(&self, toml: &Path, force: bool) -> Result<(), WriteError> {
        write_one(toml, &Contents::Bytes(self.toml.clone().into_bytes()), force)
    }
}

/// What all parts of the translation share.
pub(super) struct Importer<'a> {
    pub source: &'a Source,
    pub document: &'a Document,
    pub ids: BTreeMap<&'a str, &'a Node>,
    pub wavelengths: Vec<f64>,
    pub notes: Vec<String>,
    pub has_projector: bool,
    /// Folder of the XML file, and that of the scene file where it is another.
    from: PathBuf,
    to: PathBuf,
    /// The text so far, and which place of the XML file each part of it comes from.
    text: String,
    origins: Vec<(usize, Range<usize>)>,
}

impl<'a> Importer<'a> {
    fn new(document: &'a Document, toml: &Path) -> Result<Self, InputError> {
        let source = &document.source;
        let mut ids = BTreeMap::new();
        let mut twice = None;
        document.scene.walk(&mut |node| {
            if let Some(id) = &node.id
                && ids.insert(id.as_str(), node).is_some()
            {
                twice.get_or_insert(node);
            }
        });
        if let Some(node) = twice {
            let message = format!(
                "the id `{}` is given twice",
                node.id.as_deref().unwrap_or_default()
            );
            return Err(source.error(&node.span, message, "give each element an id of its own"));
        }
        let folder = |path: &Path| {
            let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
            path.parent().unwrap_or(Path::new("")).to_owned()
        };
        let wavelengths = match document.parameters.get(WAVELENGTHS) {
            None => optics::spectrum::Wavelengths::default().nm().to_vec(),
            Some(text) => {
                let listed = numbers(text).unwrap_or_default();
                let listed = optics::spectrum::Wavelengths::new(listed).map_err(|e| {
                    source.error(
                        &document.scene.span,
                        format!("{WAVELENGTHS} is `{text}`: {e}"),
                        "list 1 to 4 rising vacuum wavelengths in nanometres",
                    )
                })?;
                listed.nm().to_vec()
            }
        };
        Ok(Self {
            source,
            document,
            ids,
            wavelengths,
            notes: vec![],
            has_projector: false,
            from: folder(&source.file),
            to: folder(toml),
            text: String::new(),
            origins: vec![],
        })
    }

    fn run(mut self, toml: &Path) -> Result<Import, InputError> {
        let scene = &self.document.scene;
        let mut parts = Parts::default();
        for child in scene.children() {
            let Inside::Node(node) = child.take() else {
                return Err(self.source.error(
                    child.span(),
                    "a reference does nothing here",
                    "put it into a shape, or take it away",
                ));
            };
            parts.sort(self.source, node)?;
        }
        scene.finish(self.source, &[])?;
        let Some(sensor) = parts.sensor else {
            return Err(self.source.error(
                &scene.span,
                "the scene has no sensor",
                "add <sensor type=\"perspective\">",
            ));
        };
        let name = self
            .source
            .file
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        self.line(&format!(
            "# Written by sunstone import from {}.",
            name.replace(char::is_control, "_")
        ));
        self.line("# Colours given as RGB stand for 660, 550 and 450 nm: red above 590 nm, green from 500 nm, blue below.");
        self.line("");
        let list = list(&self.wavelengths);
        self.block(&scene.span, &format!("wavelengths_nm = {list}\n"));
        let spp = self.sensor(sensor)?;
        self.integrator(parts.integrator, spp)?;
        let mut materials = MaterialReader::default();
        for node in &parts.bsdfs {
            materials.named(&mut self, node)?;
        }
        let mut objects = vec![];
        for node in &parts.shapes {
            objects.push((
                node.span.clone(),
                import_shapes::object(&mut self, &mut materials, node)?,
            ));
        }
        let mut environment = None;
        for node in &parts.emitters {
            self.emitter(node, &mut environment)?;
        }
        if parts.hides_emitters && environment.is_some() {
            return Err(self.source.error(
                &parts.integrator.map_or(0..0, |i| i.span.clone()),
                "hide_emitters hides the environment, which sunstone shows",
                "take hide_emitters away",
            ));
        }
        self.line("[materials]");
        for (span, line) in materials.lines {
            self.block(&span, &line);
        }
        for (span, text) in objects {
            self.line("");
            self.block(&span, &text);
        }
        self.line("\n[[slices]]\nname = \"mueller\"\npolarization = \"mueller\"");
        self.check(toml)?;
        Ok(Import {
            toml: self.text,
            notes: self.notes,
        })
    }

    /// Builds what was written; a fault is told at its place in the XML file.
    fn check(&self, toml: &Path) -> Result<(), InputError> {
        let Err(e) = crate::from_text(toml, &self.text) else {
            return Ok(());
        };
        let at = e.span.map_or(0, |s| s.start);
        let origin = self.origins.iter().rev().find(|(start, _)| *start <= at);
        let span = origin.map_or(0..0, |(_, span)| span.clone());
        Err(self.source.error(
            &span,
            e.message,
            &e.help.unwrap_or_else(|| "correct the value".into()),
        ))
    }

    fn line(&mut self, text: &str) {
        self.text += text;
        self.text.push('\n');
    }

    /// Text that comes from a place.
    pub fn block(&mut self, from: &Range<usize>, text: &str) {
        self.origins.push((self.text.len(), from.clone()));
        self.line(text);
    }

    /// Says something once.
    pub fn note(&mut self, text: impl Into<String>) {
        let text = text.into();
        if !self.notes.contains(&text) {
            self.notes.push(text);
        }
    }

    pub fn error<T>(
        &self,
        span: &Range<usize>,
        message: impl Into<String>,
        help: &str,
    ) -> Result<T, InputError> {
        Err(self.source.error(span, message, help))
    }

    /// Path of a file that the XML names.
    pub fn path(&self, name: &str) -> PathBuf {
        self.from.join(name)
    }

    /// The same as the scene file names it, as a TOML string.
    pub fn file(&self, name: &str) -> String {
        let relative = relative(&self.to, &self.path(name));
        quoted(&relative.to_string_lossy())
    }

    /// A spectrum as TOML, or `None` if it is not given: a number, one per wavelength, or a table.
    pub fn spectrum(&mut self, node: &Node, name: &str) -> Result<Option<String>, InputError> {
        if let Some(child) = node.named(name) {
            return match self.resolve(child)? {
                inner if inner.tag == "spectrum" => self.spectrum_plugin(inner).map(Some),
                inner => self.error(
                    &inner.span,
                    format!(
                        "`{name}` of {} `{}` cannot be a texture here",
                        node.tag, node.kind
                    ),
                    "give a number, <rgb> or <spectrum>",
                ),
            };
        }
        let Some(p) = node.get(name) else {
            return Ok(None);
        };
        Ok(Some(match &p.value {
            Value::Float(v) => digits(*v),
            Value::Integer(v) => v.to_string(),
            Value::Rgb([r, g, b]) if r == g && g == b => digits(*r),
            Value::Rgb([r, g, b]) => {
                let values = self.wavelengths.iter().map(|nm| match nm {
                    nm if *nm < 500.0 => *b,
                    nm if *nm < 590.0 => *g,
                    _ => *r,
                });
                list(&values.collect::<Vec<_>>())
            }
            Value::Pairs(pairs) => self.table(pairs, &p.span)?,
            _ => {
                return self.error(
                    &p.span,
                    format!("`{name}` of {} `{}` is not a spectrum", node.tag, node.kind),
                    "give a number, <rgb> or <spectrum>",
                );
            }
        }))
    }

    /// Mitsuba's spectra are zero beyond their last pair, ours go on as they are.
    fn table(&self, pairs: &[[f64; 2]], span: &Range<usize>) -> Result<String, InputError> {
        let covers =
            |nm: f64| pairs.first().is_some_and(|p| p[0] <= nm) && pairs.last().is_some_and(|p| p[0] >= nm);
        if let Some(nm) = self.wavelengths.iter().find(|nm| !covers(**nm)) {
            return self.error(
                span,
                format!("the spectrum says nothing of {nm} nm, where Mitsuba takes it for zero"),
                "add pairs that reach so far, or choose the wavelengths: -D wavelengths_nm=550",
            );
        }
        if let Some(values) = self.as_listed(pairs) {
            return Ok(list(&values));
        }
        let column = |i: usize| list(&pairs.iter().map(|p| p[i]).collect::<Vec<_>>());
        Ok(format!("{{ nm = {}, values = {} }}", column(0), column(1)))
    }

    /// The values alone, if the pairs say nothing but those at the scene's wavelengths, and go on level beyond.
    fn as_listed(&self, pairs: &[[f64; 2]]) -> Option<Vec<f64>> {
        let (&first, &last) = (self.wavelengths.first()?, self.wavelengths.last()?);
        let inner: Vec<[f64; 2]> = pairs
            .iter()
            .copied()
            .filter(|p| (first..=last).contains(&p[0]))
            .collect();
        let level = pairs.iter().all(|p| {
            let end = if p[0] < first { inner.first() } else { inner.last() };
            (first..=last).contains(&p[0]) || end.is_some_and(|e| e[1] == p[1])
        });
        let same = inner.iter().map(|p| p[0]).eq(self.wavelengths.iter().copied());
        (level && same).then(|| inner.iter().map(|p| p[1]).collect())
    }

    fn spectrum_plugin(&mut self, node: &Node) -> Result<String, InputError> {
        let numbers_of = |name: &str| -> Result<Vec<f64>, InputError> {
            let text = node.text(self.source, name)?.unwrap_or_default();
            numbers(text).ok_or_else(|| {
                self.source.error(
                    &node.span,
                    format!("`{name}` is not a list of numbers"),
                    "correct it",
                )
            })
        };
        let text = match node.kind.as_str() {
            "uniform" => digits(node.float(self.source, "value")?.unwrap_or(1.0)),
            "irregular" => {
                let (nm, values) = (numbers_of("wavelengths")?, numbers_of("values")?);
                if nm.len() != values.len() || !nm.is_sorted_by(|a, b| a < b) {
                    return self.error(
                        &node.span,
                        "the spectrum is uneven",
                        "give rising wavelengths, and as many values",
                    );
                }
                let pairs: Vec<[f64; 2]> = nm.into_iter().zip(values).map(|(a, b)| [a, b]).collect();
                self.table(&pairs, &node.span)?
            }
            other => {
                return self.error(
                    &node.span,
                    format!("sunstone cannot express a spectrum of type `{other}`"),
                    "use uniform or irregular, or <spectrum name=\"…\" value=\"450:0.1, 550:0.2\"/>",
                );
            }
        };
        node.finish(self.source, &[])?;
        Ok(text)
    }

    /// The plugin that a child is, or refers to.
    pub fn resolve(&self, child: &'a super::tree::Child) -> Result<&'a Node, InputError> {
        match child.take() {
            Inside::Node(node) => Ok(node),
            Inside::Reference { id, span, .. } => self.ids.get(id.as_str()).copied().ok_or_else(|| {
                self.source.error(
                    span,
                    format!("nothing has the id `{id}`"),
                    "correct the id, or define it",
                )
            }),
        }
    }
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

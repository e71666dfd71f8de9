//! Mitsuba 3's XML → a scene file in TOML.
//!
//! The subset is that of [`super::export`]. Colours given as RGB are taken as the values at the scene's wavelengths: red
//! above 590 nm, green from 500 to 590 nm, blue below (660, 550 and 450 nm unless the file or `-D wavelengths_nm=…` says
//! otherwise). One-sided BSDFs become `two_sided` with a black back.

use super::super::Scene;
use super::super::locate::SceneError;
use super::files::{Contents, WriteError, write_one};
use super::import_materials::MaterialReader;
use super::import_shapes;
use super::reader::{Document, Inside, Node, Source, Value, number, numbers};
use super::xml::number as digits;
use super::{PROJECTOR_RESOLUTION, WAVELENGTHS};
use glam::DAffine3;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};

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
    /// [`SceneError`] naming file, line, column, what is not understood, and the mend.
    pub fn load(xml: &Path, toml: &Path, parameters: &BTreeMap<String, String>) -> Result<Self, SceneError> {
        let text = std::fs::read_to_string(xml).map_err(|e| SceneError {
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
    ) -> Result<Self, SceneError> {
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
    document: &'a Document,
    pub ids: BTreeMap<&'a str, &'a Node>,
    pub wavelengths: Vec<f64>,
    pub notes: Vec<String>,
    /// Folder of the XML file, and that of the scene file where it is another.
    from: PathBuf,
    to: PathBuf,
    /// The text so far, and which place of the XML file each part of it comes from.
    text: String,
    origins: Vec<(usize, Range<usize>)>,
}

impl<'a> Importer<'a> {
    fn new(document: &'a Document, toml: &Path) -> Result<Self, SceneError> {
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
            None => crate::spectrum::Wavelengths::default().nm().to_vec(),
            Some(text) => {
                let listed = numbers(text).unwrap_or_default();
                let listed = crate::spectrum::Wavelengths::new(listed).map_err(|e| {
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
            from: folder(&source.file),
            to: folder(toml),
            text: String::new(),
            origins: vec![],
        })
    }

    fn run(mut self, toml: &Path) -> Result<Import, SceneError> {
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
    fn check(&self, toml: &Path) -> Result<(), SceneError> {
        let Err(e) = Scene::from_text(toml, &self.text) else {
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
    fn block(&mut self, from: &Range<usize>, text: &str) {
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
    ) -> Result<T, SceneError> {
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
    pub fn spectrum(&mut self, node: &Node, name: &str) -> Result<Option<String>, SceneError> {
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
    fn table(&self, pairs: &[[f64; 2]], span: &Range<usize>) -> Result<String, SceneError> {
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

    fn spectrum_plugin(&mut self, node: &Node) -> Result<String, SceneError> {
        let numbers_of = |name: &str| -> Result<Vec<f64>, SceneError> {
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
    pub fn resolve(&self, child: &'a super::reader::Child) -> Result<&'a Node, SceneError> {
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

    /// Writes the camera; gives the samples per pixel.
    fn sensor(&mut self, node: &'a Node) -> Result<i64, SceneError> {
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

    fn film(&self, node: &Node) -> Result<[i64; 2], SceneError> {
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

    fn integrator(&mut self, node: Option<&'a Node>, spp: i64) -> Result<(), SceneError> {
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

    fn emitter(&mut self, node: &'a Node, environment: &mut Option<Range<usize>>) -> Result<(), SceneError> {
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
    fn projector(&mut self, node: &'a Node) -> Result<(), SceneError> {
        let source = self.source;
        if self.text.contains("\n[projector]\n") {
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
    fn white(&self, node: &'a Node) -> Result<[f64; 2], SceneError> {
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
    fn sort(&mut self, source: &Source, node: &'a Node) -> Result<(), SceneError> {
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

/// Horizontal field of view in degrees from `fov` and `fov_axis`, or from a focal length on 35 mm film.
fn field_of_view(importer: &Importer, node: &Node, aspect: f64) -> Result<f64, SceneError> {
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
fn pose(importer: &Importer, node: &Node) -> Result<String, SceneError> {
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

/// A map as rows of a 4×4 matrix.
pub(super) fn matrix(map: &DAffine3) -> String {
    let m = map.matrix3;
    let row = |i: usize| list(&[m.x_axis[i], m.y_axis[i], m.z_axis[i], map.translation[i]]);
    format!("[{}, {}, {}, [0, 0, 0, 1]]", row(0), row(1), row(2))
}

pub(super) fn list(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(|v| digits(*v)).collect();
    format!("[{}]", values.join(", "))
}

/// A TOML string.
pub(super) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// A spectrum in TOML, each value multiplied.
fn scaled(spectrum: &str, factor: f64) -> String {
    // Irradiances are f32 in the end: rounding there takes the factor's own rounding away.
    let times = |v: f64| digits(f64::from((v * factor) as f32));
    if let Some(v) = number(spectrum) {
        return times(v);
    }
    let (head, values) = match spectrum.split_once("values = ") {
        Some((head, values)) => (format!("{head}values = "), values.trim_end_matches([' ', '}'])),
        None => (String::new(), spectrum),
    };
    let values = numbers(values.trim_matches(['[', ']'])).unwrap_or_default();
    let values: Vec<String> = values.into_iter().map(times).collect();
    let tail = if head.is_empty() { "" } else { " }" };
    format!("{head}[{}]{tail}", values.join(", "))
}

/// How to reach `path` from `folder`, both absolute.
fn relative(folder: &Path, path: &Path) -> PathBuf {
    let path = normal(path);
    let folder = normal(folder);
    let (a, b): (Vec<Component>, Vec<Component>) =
        (folder.components().collect(), path.components().collect());
    let shared = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    if shared == 0 {
        return path;
    }
    let up = a[shared..].iter().map(|_| Component::ParentDir);
    up.chain(b[shared..].iter().copied()).collect()
}

/// A path without `.` and, where that cannot go wrong, without `..`.
fn normal(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if out.file_name().is_some() => {
                out.pop();
            }
            other => out.push(other),
        }
    }
    out
}

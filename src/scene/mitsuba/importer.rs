//! State and helpers shared by all parts of the Mitsuba import: source, files and spectra.

use super::document::Document;
use super::folders::relative;
use super::names::{WAVELENGTHS, free, plain};
use super::source::Source;
use super::tree::{Child, Inside, Node, Value, numbers};
use base::locate::{InputError, Located};
use std::cell::Cell;
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use syntax::values::{SpectrumFile, SpectrumTable};

pub(super) struct Importer<'a> {
    pub source: &'a Source,
    pub document: &'a Document,
    pub ids: BTreeMap<&'a str, &'a Node>,
    pub wavelengths: Vec<f64>,
    pub notes: Vec<String>,
    /// Whether the import has read a spectrum that Mitsuba's RGB variants would convert to a colour.
    pub spectral: Cell<bool>,
    /// Files that exist in memory only.
    pub files: &'a BTreeMap<String, Vec<u8>>,
    /// Files that the import creates, by their names in the scene file.
    pub made: BTreeMap<String, Vec<u8>>,
    to: PathBuf,
    /// Name of the scene file without its extension.
    stem: String,
}

impl<'a> Importer<'a> {
    pub fn new(
        document: &'a Document,
        toml: &Path,
        files: &'a BTreeMap<String, Vec<u8>>,
    ) -> Result<Self, InputError> {
        let source = &document.source;
        let mut ids = BTreeMap::new();
        document.scene.walk(&mut |node| {
            if let Some(id) = &node.id
                && ids.insert(id.as_str(), node).is_some()
            {
                let message = format!("the id `{id}` is used more than once");
                source.report(source.error(&node.span, message, "give each element a unique id"));
            }
        });
        for alias in &document.aliases {
            match ids.get(alias.id.as_str()).copied() {
                None => source.report(source.error(
                    &alias.span,
                    format!("unknown id `{}`", alias.id),
                    "correct the id, or add an element with this id",
                )),
                Some(node) if ids.insert(&alias.other, node).is_some() => source.report(source.error(
                    &alias.span,
                    format!("the id `{}` is used more than once", alias.other),
                    "give each element a unique id",
                )),
                Some(_) => {}
            }
        }
        let toml = std::path::absolute(toml).unwrap_or_else(|_| toml.to_owned());
        let wavelengths = match document.parameters.get(WAVELENGTHS) {
            None => optics::spectrum::Wavelengths::default().nm().to_vec(),
            Some(text) => {
                let listed = numbers(text).unwrap_or_default();
                let listed = optics::spectrum::Wavelengths::new(listed).map_err(|e| {
                    source.error(
                        &document.scene.span,
                        format!("{WAVELENGTHS} is `{text}`: {e}"),
                        "give 1 to 4 vacuum wavelengths in nanometres, in increasing order",
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
            notes: document.notes.clone(),
            files,
            spectral: Cell::new(false),
            made: BTreeMap::new(),
            stem: plain(&toml.file_stem().unwrap_or_default().to_string_lossy()),
            to: toml.parent().unwrap_or(Path::new("")).to_owned(),
        })
    }

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

    /// Returns the path of a file from its name in the XML.
    pub fn path(&self, name: &str) -> PathBuf {
        self.document.folders.find(name)
    }

    /// Returns the path, relative to the scene file, of a file that the XML names.
    pub fn file(&self, name: &str) -> String {
        relative(&self.to, &self.path(name)).to_string_lossy().into_owned()
    }

    /// Returns the value of a plugin's `filename`. `what` describes the plugin in messages.
    pub fn filename<'n>(&self, node: &'n Node, what: &str) -> Result<&'n str, InputError> {
        let fix = "add <string name=\"filename\">";
        let missing = || self.source.error(&node.span, format!("the {what} has no filename"), fix);
        node.text(self.source, "filename")?.ok_or_else(missing)
    }

    pub fn read(&self, node: &Node, name: &str) -> Result<Vec<u8>, InputError> {
        let from_disk = || base::input::read(&self.path(name));
        let bytes = self.files.get(&self.file(name)).cloned().map_or_else(from_disk, Ok);
        bytes.map_err(|e| {
            let message = format!("cannot read {name}: {e}");
            self.source.error(&node.span, message, "check that the file exists and is readable")
        })
    }

    /// Adds a file to write next to the scene file, unless a file with equal content was added before.
    /// Returns the file's name.
    pub fn make(&mut self, wanted: &str, extension: &str, bytes: Vec<u8>) -> String {
        if let Some((name, _)) = self.made.iter().find(|(_, b)| **b == bytes) {
            return name.clone();
        }
        let base = format!("{}_{}", self.stem, plain(wanted));
        let file = |base: &str| format!("{base}.{extension}");
        let name = file(&free(&base, |base| self.made.contains_key(&file(base))));
        self.made.insert(name.clone(), bytes);
        name
    }

    /// Checks that an integer is in the range that scene files allow.
    pub fn whole(&self, span: &Range<usize>, value: i64, what: &str) -> Result<Located<u32>, InputError> {
        match u32::try_from(value) {
            Ok(value) => Ok(Located::at(span.clone(), value)),
            Err(_) => self.error(
                span,
                format!("{what} is {value}, outside the supported range"),
                "give an integer from 0 to 4294967295",
            ),
        }
    }

    /// Returns the spectrum of a property (one number, one number per wavelength, or a table), or `None` if
    /// the property is absent.
    pub fn spectrum(&self, node: &Node, name: &str) -> Result<Option<Located<SpectrumFile>>, InputError> {
        if let Some(child) = node.named(name) {
            return match self.resolve(child)? {
                inner if is_spectrum(inner) => {
                    let spectrum = self.spectrum_plugin(inner)?;
                    Ok(Some(inner.at(spectrum)))
                }
                inner => self.error(
                    &inner.span,
                    format!("`{name}` of {} `{}` cannot be a texture", node.tag, node.kind),
                    "give a number, <rgb> or <spectrum>",
                ),
            };
        }
        let Some(p) = node.get(name) else {
            return Ok(None);
        };
        let spectrum = match &p.value {
            Value::Float(v) => SpectrumFile::Scalar(*v),
            Value::Integer(v) => SpectrumFile::Scalar(*v as f64),
            Value::Rgb([r, g, b]) if r == g && g == b => SpectrumFile::Scalar(*r),
            Value::Rgb(rgb) => self.colour(*rgb),
            Value::Pairs(pairs) => self.table(pairs, &p.span)?,
            _ => {
                return self.error(
                    &p.span,
                    format!("`{name}` of {} `{}` is not a spectrum", node.tag, node.kind),
                    "give a number, <rgb> or <spectrum>",
                );
            }
        };
        Ok(Some(Located::at(p.span.clone(), spectrum)))
    }

    /// Returns a spectrum as [`Self::spectrum`] does, or a default if the property is absent.
    pub fn spectrum_or(
        &self,
        node: &Node,
        name: &str,
        missing: f64,
    ) -> Result<Located<SpectrumFile>, InputError> {
        let otherwise = || node.at(SpectrumFile::Scalar(missing));
        Ok(self.spectrum(node, name)?.unwrap_or_else(otherwise))
    }

    /// Returns the number of a property that is a uniform plugin, or `None` if no plugin has the name of the
    /// property. A plugin that is not uniform causes an error.
    pub fn uniform(&self, node: &Node, name: &str) -> Result<Option<f64>, InputError> {
        let Some(child) = node.named(name) else {
            return Ok(None);
        };
        let inner = self.resolve(child)?;
        if is_spectrum(inner)
            && let SpectrumFile::Scalar(v) = self.spectrum_plugin(inner)?
        {
            return Ok(Some(v));
        }
        let message = format!("`{name}` must be a single number, got {} `{}`", inner.tag, inner.kind);
        self.error(&inner.span, message, "give a <float>")
    }

    /// Converts wavelength–value pairs to a table. Outside the range of the pairs, Mitsuba's spectra are zero
    /// and Sunstone's spectra are constant.
    fn table(&self, pairs: &[[f64; 2]], span: &Range<usize>) -> Result<SpectrumFile, InputError> {
        self.spectral.set(true);
        let covers =
            |nm: f64| pairs.first().is_some_and(|p| p[0] <= nm) && pairs.last().is_some_and(|p| p[0] >= nm);
        if let Some(nm) = self.wavelengths.iter().find(|nm| !covers(**nm)) {
            return self.error(
                span,
                format!("the spectrum does not cover {nm} nm; Mitsuba assumes zero at this wavelength"),
                "extend the spectrum, or set the wavelengths, such as -D wavelengths_nm=550",
            );
        }
        Ok(match self.as_listed(pairs) {
            Some(values) => SpectrumFile::PerWavelength(values),
            None => SpectrumFile::Table(SpectrumTable {
                nm: pairs.iter().map(|p| p[0]).collect(),
                values: pairs.iter().map(|p| p[1]).collect(),
            }),
        })
    }

    /// Returns the values of the pairs if their wavelengths are those of the scene and the values are
    /// constant beyond these wavelengths. Otherwise, returns `None`.
    fn as_listed(&self, pairs: &[[f64; 2]]) -> Option<Vec<f64>> {
        let (&first, &last) = (self.wavelengths.first()?, self.wavelengths.last()?);
        let inner: Vec<[f64; 2]> = pairs.iter().copied().filter(|p| (first..=last).contains(&p[0])).collect();
        let level = pairs.iter().all(|p| {
            let end = if p[0] < first { inner.first() } else { inner.last() };
            (first..=last).contains(&p[0]) || end.is_some_and(|e| e[1] == p[1])
        });
        let same = inner.iter().map(|p| p[0]).eq(self.wavelengths.iter().copied());
        (level && same).then(|| inner.iter().map(|p| p[1]).collect())
    }

    /// Converts a linear RGB colour to values at the scene's wavelengths.
    fn colour(&self, [r, g, b]: [f64; 3]) -> SpectrumFile {
        let values = self.wavelengths.iter().map(|nm| match nm {
            nm if *nm < 500.0 => b,
            nm if *nm < 590.0 => g,
            _ => r,
        });
        SpectrumFile::PerWavelength(values.collect())
    }

    fn spectrum_plugin(&self, node: &Node) -> Result<SpectrumFile, InputError> {
        let numbers_of = |name: &str| -> Result<Vec<f64>, InputError> {
            let text = node.text(self.source, name)?.unwrap_or_default();
            numbers(text).ok_or_else(|| {
                self.source.error(
                    &node.span,
                    format!("`{name}` is `{text}`, which is not a list of numbers"),
                    "give numbers separated by commas or spaces",
                )
            })
        };
        let spectrum = match node.kind.as_str() {
            "uniform" => SpectrumFile::Scalar(node.float(self.source, "value")?.unwrap_or(1.0)),
            "irregular" => {
                let (nm, values) = (numbers_of("wavelengths")?, numbers_of("values")?);
                if nm.len() != values.len() {
                    let message =
                        format!("the spectrum has {} wavelengths and {} values", nm.len(), values.len());
                    return self.error(&node.span, message, "give one value per wavelength");
                }
                let mut steps = nm.iter().zip(nm.iter().skip(1));
                if let Some((a, b)) = steps.find(|(a, b)| a.partial_cmp(b).is_none_or(Ordering::is_ge)) {
                    let message = format!("the wavelengths of the spectrum do not increase: {a} nm, {b} nm");
                    return self.error(&node.span, message, "give increasing wavelengths");
                }
                let pairs: Vec<[f64; 2]> = nm.into_iter().zip(values).map(|(a, b)| [a, b]).collect();
                self.table(&pairs, &node.span)?
            }
            "regular" => {
                let values = numbers_of("values")?;
                let end = |name: &str, missing| Ok(node.float(self.source, name)?.unwrap_or(missing));
                let (first, last) = (end("wavelength_min", 360.0)?, end("wavelength_max", 830.0)?);
                let steps = values.len().saturating_sub(1).max(1) as f64;
                if values.len() < 2 {
                    let message = format!("the spectrum has only {} values", values.len());
                    return self.error(&node.span, message, "give at least two values");
                }
                if first >= last {
                    let message = format!("wavelength_min ({first}) is not below wavelength_max ({last})");
                    return self.error(&node.span, message, "give wavelength_min below wavelength_max");
                }
                let nm = |i: usize| first + (last - first) * i as f64 / steps;
                let pairs: Vec<[f64; 2]> = values.iter().enumerate().map(|(i, v)| [nm(i), *v]).collect();
                self.table(&pairs, &node.span)?
            }
            "srgb" => match node.get("color").map(|p| &p.value) {
                Some(Value::Rgb(rgb)) => self.colour(*rgb),
                Some(Value::Vector(rgb)) => self.colour(rgb.to_array()),
                _ => return self.error(&node.span, "the colour has no value", "add <rgb name=\"color\">"),
            },
            "d65" => {
                let scale = node.float(self.source, "scale")?.unwrap_or(1.0);
                match node.get("color").map(|p| &p.value) {
                    Some(Value::Rgb(rgb)) => self.colour(rgb.map(|v| v * scale)),
                    _ => SpectrumFile::Scalar(scale),
                }
            }
            "blackbody" => {
                let kelvin = node.float(self.source, "temperature")?.unwrap_or(5000.0);
                let scale = node.float(self.source, "scale")?.unwrap_or(1.0);
                if kelvin <= 0.0 {
                    return self.error(
                        &node.span,
                        format!("the temperature is {kelvin} K, but must be above 0 K"),
                        "give a temperature in kelvins",
                    );
                }
                self.spectral.set(true);
                let values = self.wavelengths.iter().map(|nm| scale * planck(*nm, kelvin));
                SpectrumFile::PerWavelength(values.collect())
            }
            other => {
                return self.error(
                    &node.span,
                    format!("unsupported spectrum `{other}`"),
                    "use uniform, regular, irregular, srgb, d65 or blackbody, or <spectrum name=\"…\" value=\"450:0.1, 550:0.2\"/>",
                );
            }
        };
        self.in_range(node)?;
        node.finish(self.source, &[]);
        Ok(spectrum)
    }

    /// Refuses a spectrum that does not cover all wavelengths of the scene, because Mitsuba's spectra are
    /// zero outside their range.
    fn in_range(&self, node: &Node) -> Result<(), InputError> {
        let first = node.float(self.source, "wavelength_min")?.unwrap_or(f64::NEG_INFINITY);
        let last = node.float(self.source, "wavelength_max")?.unwrap_or(f64::INFINITY);
        match self.wavelengths.iter().find(|nm| !(first..=last).contains(*nm)) {
            None => Ok(()),
            Some(nm) => self.error(
                &node.span,
                format!("the spectrum does not cover {nm} nm"),
                "extend the range of the spectrum, or set the wavelengths, such as -D wavelengths_nm=550",
            ),
        }
    }

    /// Returns the plugin that a child contains or to which the child refers.
    pub fn resolve(&self, child: &'a Child) -> Result<&'a Node, InputError> {
        child.take();
        self.peek(child)
    }

    /// Returns the same plugin as [`Self::resolve`], without marking the child as used.
    pub fn peek(&self, child: &'a Child) -> Result<&'a Node, InputError> {
        match &child.what {
            Inside::Node(node) => Ok(node),
            Inside::Reference { id, span, .. } => self.ids.get(id.as_str()).copied().ok_or_else(|| {
                self.source.error(
                    span,
                    format!("unknown id `{id}`"),
                    "correct the id, or add an element with this id",
                )
            }),
        }
    }
}

/// Returns whether a plugin is a spectrum, which has the same value everywhere.
pub(super) fn is_spectrum(node: &Node) -> bool {
    node.tag == "spectrum"
        || node.tag == "texture" && ["uniform", "srgb", "d65"].contains(&node.kind.as_str())
}

/// Returns the spectral radiance of a black body by Planck's law, in W/(m² sr nm).
fn planck(nm: f64, kelvin: f64) -> f64 {
    // Planck constant, speed of light and Boltzmann constant in SI units.
    let (h, c, k) = (6.626_070_15e-34, 299_792_458.0, 1.380_649e-23);
    let metres = nm * 1e-9;
    2.0 * h * c * c / metres.powi(5) / (h * c / (metres * k * kelvin)).exp_m1() * 1e-9
}

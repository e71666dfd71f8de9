//! State shared by all build steps: error locations, files that were read, and notes.

use super::attributes::Attributes;
use super::textures::Images;
use base::document;
use base::locate::{InputError, Located};
use base::spectral_table::SpectralTable;
use optics::spectrum::{Spectral, Wavelengths};
use sha2::{Digest, Sha256};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::io::Read;
use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use syntax::values::{SpectrumFile, SpectrumTable};
use transport::material::texture::Textures;

pub(crate) struct Context {
    pub file: PathBuf,
    pub text: Arc<str>,
    /// Folder to which relative paths refer.
    pub folder: PathBuf,
    /// Files that exist in memory only, by the names that the scene uses.
    pub memory: BTreeMap<String, Vec<u8>>,
    /// Names of in-memory files that the build derived from other files. The scene does not list the derived
    /// files.
    pub made: BTreeSet<String>,
    pub wavelengths: Wavelengths,
    /// Wavelengths of the values in lists of the file. The listed wavelengths differ from `wavelengths` only
    /// if a material file is built for wavelengths other than its own.
    pub listed: Wavelengths,
    pub hash: Sha256,
    /// Notes for the user about corrections and about unused contents of files.
    pub notes: Vec<String>,
    pub attributes: Attributes,
    /// Images that have been read. Their texels are in `textures`.
    pub images: Images,
    pub textures: Textures,
    /// Names of files that were read.
    pub files: RefCell<BTreeSet<String>>,
}

impl Context {
    /// Creates the context of a file from its text and its wavelengths.
    pub fn new(path: &Path, text: &str, wavelengths_nm: &Located<Vec<f64>>) -> Result<Self, InputError> {
        let mut ctx = Self {
            file: path.to_owned(),
            text: text.into(),
            folder: path.parent().unwrap_or(Path::new("")).to_owned(),
            memory: BTreeMap::new(),
            made: BTreeSet::new(),
            wavelengths: Wavelengths::default(),
            listed: Wavelengths::default(),
            hash: Sha256::new(),
            notes: vec![],
            attributes: Attributes::default(),
            images: Images::default(),
            textures: Textures::default(),
            files: RefCell::default(),
        };
        ctx.listed = Wavelengths::new(wavelengths_nm.to_vec()).map_err(|e| {
            ctx.error(
                wavelengths_nm.span(),
                format!("wavelengths_nm: {e}"),
                "give 1 to 4 vacuum wavelengths in nanometres, in increasing order",
            )
        })?;
        ctx.wavelengths = ctx.listed.clone();
        Ok(ctx)
    }

    /// Sets the folder to which relative paths refer.
    pub fn in_folder(self, folder: &Path) -> Self {
        Self { folder: folder.to_owned(), ..self }
    }

    /// Sets the files that exist in memory only.
    pub fn with_files(self, memory: BTreeMap<String, Vec<u8>>) -> Self {
        Self { memory, ..self }
    }

    pub fn error(
        &self,
        span: Range<usize>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> InputError {
        InputError {
            file: self.file.clone(),
            text: self.text.clone(),
            span: (span != (0..0)).then_some(span),
            message: message.into(),
            help: Some(help.into()),
        }
    }

    /// Returns the error for a name that is not in the scene's table of the given kind (materials, media, …).
    pub fn unknown<'k>(
        &self,
        what: &str,
        table: &str,
        name: &Located<String>,
        known: impl Iterator<Item = &'k str>,
    ) -> InputError {
        let known = known.collect::<Vec<_>>().join(", ");
        let mut help = format!("add [{table}.{}]", **name);
        if !known.is_empty() {
            help += &format!(", or use one of: {known}");
        }
        self.error(name.span(), format!("unknown {what} `{}`", **name), help)
    }

    /// Adds a note unless the same note exists already, because several objects can use one file.
    pub fn note(&mut self, note: String) {
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    /// Returns the line number of a span for messages, such as ` of line 12`, or an empty string for scenes
    /// built in code.
    pub fn line(&self, span: Range<usize>) -> String {
        match self.text.get(..span.start) {
            Some(before) if span != (0..0) => format!(" of line {}", before.matches('\n').count() + 1),
            _ => String::new(),
        }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Records that the scene uses a file.
    pub fn uses(&self, name: impl Into<String>) {
        let name = name.into();
        if !self.made.contains(&name) {
            self.files.borrow_mut().insert(name);
        }
    }

    /// Stores a derived file in memory.
    pub fn keep(&mut self, name: &str, bytes: Vec<u8>) {
        self.made.insert(name.to_owned());
        self.memory.insert(name.to_owned(), bytes);
    }

    /// Returns the names of files that the scene uses, sorted.
    pub fn used(&self) -> Vec<String> {
        self.files.borrow().iter().cloned().collect()
    }

    /// Reads at most `most` bytes of a file that the scene names. The bytes do not enter the scene's hash.
    pub fn peek(&self, name: &str, most: u64) -> std::io::Result<Vec<u8>> {
        let mut bytes = vec![];
        match self.memory.get(name) {
            Some(all) => bytes.clone_from(all),
            None if most == u64::MAX => bytes = base::input::read(&self.path(name))?,
            None => {
                base::input::open(&self.path(name))?.take(most).read_to_end(&mut bytes)?;
            }
        }
        self.uses(name);
        Ok(bytes)
    }

    /// Reads a file that the scene names and adds the file's bytes to the scene's hash.
    pub fn read(&mut self, name: &str, span: Range<usize>) -> Result<Vec<u8>, InputError> {
        let bytes = self.bytes(name, span)?;
        self.count(&bytes);
        Ok(bytes)
    }

    /// Adds a file's contents to the scene's hash.
    pub fn count(&mut self, bytes: &[u8]) {
        self.hash.update((bytes.len() as u64).to_le_bytes());
        self.hash.update(bytes);
    }

    /// Reads a file that the scene names. The caller adds the bytes to the scene's hash with [`Self::count`].
    pub fn bytes(&self, name: &str, span: Range<usize>) -> Result<Vec<u8>, InputError> {
        let path = self.path(name);
        let bytes = match self.memory.get(name) {
            Some(bytes) => bytes.clone(),
            None => base::input::read(&path).map_err(|e| {
                self.error(
                    span,
                    format!("cannot read {}: {e}", path.display()),
                    "correct the path, or put the file at this path; paths are relative to the scene file",
                )
            })?,
        };
        self.uses(name);
        Ok(bytes)
    }

    /// Returns one value per wavelength of the scene, after checking that all values are within `range`.
    pub fn values(
        &self,
        s: &SpectrumFile,
        span: Range<usize>,
        what: &str,
        range: RangeInclusive<f64>,
    ) -> Result<Vec<f64>, InputError> {
        let n = self.listed.count();
        let at = |table: SpectralTable| {
            let wanted = self.wavelengths.nm().iter();
            wanted.map(|nm| table.at(*nm)).collect()
        };
        let nm = self.listed.nm();
        let list = match s {
            SpectrumFile::Scalar(v) => vec![*v; self.wavelengths.count()],
            SpectrumFile::PerWavelength(list) if list.len() == n => at(SpectralTable { nm, values: list }),
            SpectrumFile::Table(table) if table.table().is_sound() => {
                // Also check the entries that no wavelength of the scene uses.
                for value in &table.values {
                    self.within(*value, span.clone(), what, &range)?;
                }
                at(table.table())
            }
            SpectrumFile::Table(SpectrumTable { nm, values }) => {
                let fault = if nm.len() != values.len() {
                    format!("has {} entries in nm and {} in values", nm.len(), values.len())
                } else if nm.is_empty() {
                    "is empty".to_owned()
                } else if let Some(bad) = nm.iter().chain(values).find(|v| !v.is_finite()) {
                    format!("contains {bad}, but all numbers must be finite")
                } else if let Some(bad) = nm.iter().find(|nm| **nm <= 0.0) {
                    format!("has the wavelength {bad} nm, but nm must be positive")
                } else {
                    format!("has the wavelengths {nm:?} nm, but nm must be increasing")
                };
                return Err(self.error(
                    span,
                    format!("the table of {what} {fault}"),
                    "give nm (positive and increasing) and values as lists of equal length",
                ));
            }
            SpectrumFile::PerWavelength(list) => {
                return Err(self.error(
                    span,
                    format!("{what} has {} values for {n} wavelengths", list.len()),
                    format!("give one number, or {n} (one per entry of wavelengths_nm)"),
                ));
            }
        };
        for value in &list {
            self.within(*value, span.clone(), what, &range)?;
        }
        Ok(list)
    }

    /// Checks that a number of the scene file is within a range, and returns the number.
    pub fn number<T: Copy + PartialOrd + Display>(
        &self,
        value: &Located<T>,
        what: &str,
        range: RangeInclusive<T>,
    ) -> Result<T, InputError> {
        self.within(**value, value.span(), what, &range)
    }

    /// Checks a value as [`Self::number`] does, with the location as a separate argument.
    pub fn within<T: Copy + PartialOrd + Display>(
        &self,
        value: T,
        span: Range<usize>,
        what: &str,
        range: &RangeInclusive<T>,
    ) -> Result<T, InputError> {
        if range.contains(&value) {
            return Ok(value);
        }
        Err(self.error(
            span,
            format!("{what} is {value}, outside the supported range"),
            format!("give a value in {}..{}", range.start(), range.end()),
        ))
    }

    /// Returns the result of [`Self::values`] as SIMD lanes, one per wavelength.
    pub fn spectrum(
        &self,
        s: &SpectrumFile,
        span: Range<usize>,
        what: &str,
        range: RangeInclusive<f64>,
    ) -> Result<Spectral, InputError> {
        let mut lanes = [0.0_f32; 4];
        for (lane, v) in lanes.iter_mut().zip(self.values(s, span, what, range)?) {
            *lane = v as f32;
        }
        Ok(Spectral::new(lanes))
    }

    /// Does the same as [`Self::spectrum`] for a located value.
    pub fn located(
        &self,
        s: &Located<SpectrumFile>,
        what: &str,
        range: RangeInclusive<f64>,
    ) -> Result<Spectral, InputError> {
        self.spectrum(s, s.span(), what, range)
    }
}

/// Largest accepted magnitude of a value in a scene file. The limit keeps f32 arithmetic finite.
pub(crate) const HUGE: f64 = 1e12;

/// Reads the text of a scene or material file.
pub(crate) fn read(path: &Path, what: &str) -> Result<String, InputError> {
    document::read(path, what, "give the path of a TOML file")
}

//! Analytic materials for tables. The materials are those of a file, or the 25 built-in substitutes for the
//! KAIST data set.

use crate::data_set::Analytic;
use base::locate::InputError;
use optics::spectrum::{MAX_WAVELENGTHS, WavelengthError, Wavelengths};
use scene::materials::MaterialSet;
use std::path::{Path, PathBuf};
use transport::material::Materials;

/// Text of the material file with the built-in substitutes.
const STAND_INS: &str = include_str!("../../pbrdf/stand_ins.toml");
/// Prefix of the names of the substitutes in the built-in file.
const PREFIX: &str = "like_";

/// Error of loading materials at several bands.
#[derive(Debug, thiserror::Error)]
pub enum BandedError {
    /// The file cannot be read.
    #[error(transparent)]
    Read(std::io::Error),
    /// A band is not a valid wavelength.
    #[error(transparent)]
    Wavelengths(WavelengthError),
    /// The file is invalid.
    #[error(transparent)]
    File(#[from] InputError),
    /// The list of bands is empty.
    #[error("expected at least one band, got none; pass bands in nanometres")]
    NoBands,
}

/// Materials at any number of bands. A material set has up to four wavelengths. More than four bands
/// therefore need several sets of the same materials.
pub struct BandedMaterials(Vec<MaterialSet>);

impl BandedMaterials {
    /// Builds the materials of a file, or the built-in substitutes, at the given bands in nanometres.
    ///
    /// # Errors
    /// Returns [`BandedError`] if the file cannot be read or is invalid, if a band is invalid, or if there
    /// are no bands.
    pub fn load(file: Option<&Path>, bands: &[u16]) -> Result<Self, BandedError> {
        let (path, text) = match file {
            Some(path) => (path.to_owned(), base::input::read_text(path).map_err(BandedError::Read)?),
            None => (PathBuf::from("stand_ins.toml"), STAND_INS.to_owned()),
        };
        let mut sets = vec![];
        for bands in bands.chunks(MAX_WAVELENGTHS) {
            let nm = bands.iter().copied().map(f64::from).collect();
            let wavelengths = Wavelengths::new(nm).map_err(BandedError::Wavelengths)?;
            sets.push(MaterialSet::at(&path, &text, wavelengths)?);
        }
        if sets.is_empty() {
            return Err(BandedError::NoBands);
        }
        Ok(Self(sets))
    }

    /// Iterates over the names of all materials, in order.
    pub fn names(&self) -> impl Iterator<Item = &String> {
        self.0.iter().take(1).flat_map(|set| set.names.keys())
    }

    /// Returns whether the material has a non-specular lobe, or `None` if the name is unknown.
    pub fn has_extended_lobe(&self, name: &str) -> Option<bool> {
        let set = self.0.first()?;
        set.names.get(name).map(|id| set.materials.has_extended_lobe(*id))
    }

    /// Returns the names of the materials that a table can represent. The list omits materials that have only
    /// specular lobes.
    pub fn tabulable(&self) -> Vec<String> {
        self.names().filter(|name| self.has_extended_lobe(name) == Some(true)).cloned().collect()
    }

    /// Returns the names of the built-in substitutes.
    pub fn stand_ins(&self) -> Vec<String> {
        let mut names = self.tabulable();
        names.retain(|name| name.starts_with(PREFIX));
        names
    }

    /// Returns a material as the argument of `tabulate`, with one source per four bands. The list is empty if
    /// the name is unknown.
    pub fn sources(&self, name: &str) -> Vec<(&Materials, u32)> {
        let of = |set| -> Option<(&Materials, u32)> {
            let set: &MaterialSet = set;
            Some((&set.materials, *set.names.get(name)?))
        };
        self.0.iter().filter_map(of).collect()
    }

    /// Returns the substitutes as the argument of [`crate::data_set::evaluate`].
    pub fn analytic(&self) -> Vec<Analytic<'_>> {
        let material = |name: String| {
            let sources = self.sources(&name);
            (name, sources)
        };
        self.stand_ins().into_iter().map(material).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stand_ins_match_the_set() {
        let banded = BandedMaterials::load(None, &[450, 500, 550, 600, 650]).expect("are sound");
        let names = banded.stand_ins();
        assert_eq!(names.len(), 25);
        assert!(names.is_sorted() && names.iter().all(|n| banded.has_extended_lobe(n) == Some(true)));
        assert_eq!(banded.sources("like_gold").len(), 2);
        assert!(banded.sources("no_such").is_empty() && banded.has_extended_lobe("no_such").is_none());
        assert_eq!(banded.analytic().len(), 25);
    }

    #[test]
    fn invalid_sets_are_refused() {
        assert!(matches!(BandedMaterials::load(None, &[]), Err(BandedError::NoBands)));
        assert!(matches!(
            BandedMaterials::load(Some(Path::new("no/such.toml")), &[550]),
            Err(BandedError::Read(_))
        ));
    }
}

//! Analytic materials to tabulate: the 25 stand-ins for the KAIST set that come with the program, or those of a file.

use crate::data_set::Analytic;
use base::locate::InputError;
use optics::spectrum::{MAX_WAVELENGTHS, WavelengthError, Wavelengths};
use scene::materials::MaterialSet;
use std::path::{Path, PathBuf};
use transport::material::Materials;

/// The stand-ins that come with the program.
const STAND_INS: &str = include_str!("../../pbrdf/stand_ins.toml");
/// What the names of materials to tabulate begin with, in that file.
const PREFIX: &str = "like_";

/// Why there are no materials.
#[derive(Debug, thiserror::Error)]
pub enum BandedError {
    /// The file cannot be read.
    #[error(transparent)]
    Read(std::io::Error),
    /// A band is no wavelength.
    #[error(transparent)]
    Wavelengths(WavelengthError),
    /// The file is wrong.
    #[error(transparent)]
    File(#[from] InputError),
    /// No band was asked for.
    #[error("give at least one band")]
    NoBands,
}

/// Materials at any number of bands: a material set carries up to four wavelengths, more take more sets of the same
/// materials.
pub struct BandedMaterials(Vec<MaterialSet>);

impl BandedMaterials {
    /// Builds the materials of a file, or the stand-ins, at the given bands (nanometres).
    ///
    /// # Errors
    /// [`BandedError`].
    pub fn load(file: Option<&Path>, bands: &[u16]) -> Result<Self, BandedError> {
        let (path, text) = match file {
            Some(path) => (
                path.to_owned(),
                base::input::read_text(path).map_err(BandedError::Read)?,
            ),
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

    /// All names, in order.
    pub fn names(&self) -> impl Iterator<Item = &String> {
        self.0.iter().take(1).flat_map(|set| set.names.keys())
    }

    /// True if light from a point can show the material, false if not, `None` if there is none of that name.
    #[must_use]
    pub fn is_smooth(&self, name: &str) -> Option<bool> {
        let set = self.0.first()?;
        set.names.get(name).map(|id| set.materials.has_extended_lobe(*id))
    }

    /// Names of the materials that light from a point can show, which alone a table can hold.
    #[must_use]
    pub fn tabulable(&self) -> Vec<String> {
        let smooth = |name: &&String| self.is_smooth(name) == Some(true);
        self.names().filter(smooth).cloned().collect()
    }

    /// The stand-ins' names.
    #[must_use]
    pub fn stand_ins(&self) -> Vec<String> {
        let mut names = self.tabulable();
        names.retain(|name| name.starts_with(PREFIX));
        names
    }

    /// A material as `tabulate` takes it, a table for each four bands; empty if there is none of that name.
    #[must_use]
    pub fn sources(&self, name: &str) -> Vec<(&Materials, u32)> {
        let of = |set| -> Option<(&Materials, u32)> {
            let set: &MaterialSet = set;
            Some((&set.materials, *set.names.get(name)?))
        };
        self.0.iter().filter_map(of).collect()
    }

    /// The stand-ins as [`crate::data_set::evaluate`] takes them.
    #[must_use]
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
    fn stand_ins_are_those_of_the_set() {
        let banded = BandedMaterials::load(None, &[450, 500, 550, 600, 650]).expect("are sound");
        let names = banded.stand_ins();
        assert_eq!(names.len(), 25);
        assert!(names.is_sorted() && names.iter().all(|n| banded.is_smooth(n) == Some(true)));
        assert_eq!(banded.sources("like_gold").len(), 2);
        assert!(banded.sources("no_such").is_empty() && banded.is_smooth("no_such").is_none());
        assert_eq!(banded.analytic().len(), 25);
    }

    #[test]
    fn what_is_no_set_is_refused() {
        assert!(matches!(
            BandedMaterials::load(None, &[]),
            Err(BandedError::NoBands)
        ));
        assert!(matches!(
            BandedMaterials::load(Some(Path::new("no/such.toml")), &[550]),
            Err(BandedError::Read(_))
        ));
    }
}

//! Analytic materials to tabulate: the program's own 25 stand-ins for the KAIST set, or those of a file.

use crate::cli::failure::Failure;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use sunstone::optics::spectrum::{MAX_WAVELENGTHS, Wavelengths};
use sunstone::scene::materials::MaterialSet;
use sunstone::transport::material::Materials;

/// The stand-ins that come with the program.
const STAND_INS: &str = include_str!("../../../pbrdf/stand_ins.toml");
/// What the names of materials to tabulate begin with, in that file.
const PREFIX: &str = "like_";

/// Entries of a table along phi_d, theta_d and theta_h.
#[derive(Clone, Copy, Debug)]
pub struct Resolution(pub [usize; 3]);

impl FromStr for Resolution {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Option<Vec<usize>> = text.split('x').map(|n| n.trim().parse().ok()).collect();
        match parts.as_deref() {
            Some(&[a, b, c]) if [a, b, c].iter().all(|n| (2..=4096).contains(n)) => Ok(Self([a, b, c])),
            _ => Err("give three numbers from 2 to 4096, such as 361x91x91".into()),
        }
    }
}

/// Materials at any number of bands: a material set carries up to four wavelengths, more take more sets of the same
/// materials.
pub struct Sets(Vec<MaterialSet>);

impl Sets {
    /// Builds the materials of a file, or the stand-ins, at the given bands (nanometres).
    pub fn load(file: Option<&Path>, bands: &[u16]) -> Result<Self, Failure> {
        let (path, text) = match file {
            Some(path) => (
                path.to_owned(),
                std::fs::read_to_string(path).map_err(Failure::input)?,
            ),
            None => (PathBuf::from("stand_ins.toml"), STAND_INS.to_owned()),
        };
        let mut sets = vec![];
        for bands in bands.chunks(MAX_WAVELENGTHS) {
            let nm = bands.iter().copied().map(f64::from).collect();
            let wavelengths = Wavelengths::new(nm).map_err(Failure::input)?;
            sets.push(MaterialSet::at(&path, &text, wavelengths)?);
        }
        if sets.is_empty() {
            return Err(Failure::input("give at least one band"));
        }
        Ok(Self(sets))
    }

    /// All names, in order.
    pub fn known(&self) -> impl Iterator<Item = &String> {
        self.0.iter().take(1).flat_map(|set| set.names.keys())
    }

    /// True if light from a point can show the material, false if not, `None` if there is none of that name.
    pub fn has_extended_lobe(&self, name: &str) -> Option<bool> {
        let set = self.0.first()?;
        set.names.get(name).map(|id| set.materials.has_extended_lobe(*id))
    }

    /// The stand-ins' names.
    pub fn stand_ins(&self) -> Vec<String> {
        let wanted = |name: &&String| name.starts_with(PREFIX) && self.has_extended_lobe(name) == Some(true);
        self.known().filter(wanted).cloned().collect()
    }

    /// A material as `tabulate` takes it; empty if there is none of that name.
    pub fn sources(&self, name: &str) -> Vec<(&Materials, u32)> {
        let of = |set| -> Option<(&Materials, u32)> {
            let set: &MaterialSet = set;
            Some((&set.materials, *set.names.get(name)?))
        };
        self.0.iter().filter_map(of).collect()
    }
}

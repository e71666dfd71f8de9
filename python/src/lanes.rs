//! Maps requested wavelengths, in any number and order, to sets of a few wavelengths in ascending order.

use crate::error::{bail, input};
use pyo3::prelude::*;
use sunstone::optics::spectrum::{MAX_WAVELENGTHS, Wavelengths};

/// Wavelength sets, and the position of each requested wavelength in the sets.
pub struct Lanes {
    /// Wavelength sets for which a material or medium is built.
    pub sets: Vec<Wavelengths>,
    /// For each requested wavelength, the number of its set and its index in the set.
    pub places: Vec<(usize, usize)>,
}

impl Lanes {
    /// Creates the sets for wavelengths in nanometres.
    pub fn new(asked_nm: &[f64]) -> PyResult<Self> {
        if asked_nm.is_empty() {
            bail!("wavelengths_nm: expected at least one wavelength, got none");
        }
        let mut rising = asked_nm.to_vec();
        rising.sort_by(f64::total_cmp);
        rising.dedup();
        let sets: Result<Vec<Wavelengths>, _> =
            rising.chunks(MAX_WAVELENGTHS).map(|few| Wavelengths::new(few.to_vec())).collect();
        let sets = sets.map_err(|e| input(format!("wavelengths_nm: {e}")))?;
        let place = |nm: &f64| {
            let i = rising.partition_point(|other| other < nm);
            (i / MAX_WAVELENGTHS, i % MAX_WAVELENGTHS)
        };
        Ok(Self { places: asked_nm.iter().map(place).collect(), sets })
    }
}

/// Selects an item by name, or the only item if no name is given. `what` is the noun for an item, such as
/// `material`, and `several` is the plural.
pub fn choose(what: &str, several: &str, names: &[String], name: Option<&str>) -> PyResult<String> {
    let known = names.join(", ");
    match (name, names) {
        (Some(name), _) if names.iter().any(|n| n == name) => Ok(name.to_owned()),
        (Some(name), _) => bail!("name: unknown {what} `{name}`; available: {known}"),
        (None, [one]) => Ok(one.clone()),
        (None, []) => bail!("there is no {what}; add at least one {what}"),
        (None, _) => bail!("name: there are several {several}; pass one of these names: {known}"),
    }
}

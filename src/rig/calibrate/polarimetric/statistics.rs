//! `[polarimetric]` of a calibration's file: what was found of the elements, with its covariance.

use super::samples::Calibrated;
use serde::{Deserialize, Serialize};

/// How sure the elements of a calibration are. Lists have one entry a parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statistics {
    /// Σ of squared residuals over their variances.
    pub chi_squared: f64,
    /// Measurements less parameters.
    pub freedom: usize,
    /// Parameters by their elements' names.
    pub names: Vec<String>,
    /// At which wavelength, nanometres, where captures of several tell a parameter at each; else `nan`.
    pub wavelengths_nm: Vec<f64>,
    /// `°`, or nothing.
    pub units: Vec<String>,
    /// What was found, in these units.
    pub values: Vec<f64>,
    /// Standard deviations; `nan` where the samples do not tell a parameter alone.
    pub sigma: Vec<f64>,
    /// Their covariance, row by row; of what is not told it is zero.
    pub covariance: Vec<Vec<f64>>,
    /// What the samples cannot tell, in words.
    pub untold: Vec<String>,
}

/// The table by its name.
#[derive(Serialize)]
struct Named<'a> {
    polarimetric: &'a Statistics,
}

impl Statistics {
    /// As TOML with its header.
    ///
    /// # Errors
    /// If a number cannot be written.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(&Named { polarimetric: self })
    }
}

impl Calibrated {
    /// What a file keeps of it beside the scheme.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        let n = self.found.len();
        let of = |i: usize, k: usize| self.fit.covariance[(i, k)];
        Statistics {
            chi_squared: self.fit.chi_squared,
            freedom: self.fit.freedom,
            names: self.found.iter().map(|f| f.name.clone()).collect(),
            wavelengths_nm: self.found.iter().map(|f| f.nm.unwrap_or(f64::NAN)).collect(),
            units: self.found.iter().map(|f| f.parameter.unit().to_owned()).collect(),
            values: self.found.iter().map(|f| f.value).collect(),
            sigma: self.found.iter().map(|f| f.sigma.unwrap_or(f64::NAN)).collect(),
            covariance: (0..n).map(|i| (0..n).map(|k| of(i, k)).collect()).collect(),
            untold: self.untold.clone(),
        }
    }
}

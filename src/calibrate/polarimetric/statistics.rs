//! The `[polarimetric]` table of a calibration file, which contains fitted imperfections with their
//! covariance.

use super::samples::Calibrated;
use serde::{Deserialize, Serialize};

/// Statistics of a polarimetric calibration. Lists have one entry per parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statistics {
    /// Chi-squared, which is the sum of the squared residuals, each divided by its variance.
    pub chi_squared: f64,
    /// Number of measurements minus number of parameters.
    pub freedom: usize,
    /// Names of the parameters, which include the names of the elements.
    pub names: Vec<String>,
    /// Wavelength in nanometres of a parameter that is fitted per wavelength, or `nan` for any other
    /// parameter.
    pub wavelengths_nm: Vec<f64>,
    /// Units of the parameters, either `°` or empty.
    pub units: Vec<String>,
    /// Fitted values in the units of `units`.
    pub values: Vec<f64>,
    /// Standard deviations. The value is `nan` if the samples determine a parameter only in combination with
    /// others.
    pub sigma: Vec<f64>,
    /// Covariance matrix, row by row. The covariance is zero along undetermined directions.
    pub covariance: Vec<Vec<f64>>,
    /// Descriptions of the undetermined parameters.
    #[serde(alias = "untold")]
    pub undetermined: Vec<String>,
}

impl Calibrated {
    /// Returns the statistics that the calibration file contains in addition to the scheme.
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
            undetermined: self.undetermined.clone(),
        }
    }
}

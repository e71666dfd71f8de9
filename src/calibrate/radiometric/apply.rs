//! Radiometric calibration of a camera, and correction of its frames.

use super::dark::Dark;
use super::error::RadiometricError;
use super::flat::Flat;
use super::levels::{levels, saturation};
use super::linearity::Linearity;
use super::stack::{Stack, check};
use super::transfer::Transfer;
use serde::{Deserialize, Serialize};

/// Readings above this fraction of the saturation signal count as saturated.
const SATURATED: f64 = 0.95;
const MOST_DEGREE: usize = 8;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Number of coefficients of the nonlinearity polynomial.
    pub degree: usize,
    /// Relative standard error of the light (irradiance times exposure) of each level.
    pub light_sigma: f64,
    /// Threshold for outlier pixels, in standard deviations.
    pub limit: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { degree: 2, light_sigma: 0.0, limit: 8.0 }
    }
}

/// The radiometric calibration of a camera.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Radiometry {
    /// Smallest reading that counts as saturated, in DN.
    pub saturated_from_dn: u32,
    /// Signal above the dark frame at which the camera saturates, in DN, or `None` if no frame reached
    /// saturation.
    pub saturation_dn: Option<f64>,
    /// Descriptions of quantities that the frames do not determine.
    #[serde(alias = "untold")]
    pub undetermined: Vec<String>,
    pub dark: Dark,
    pub linearity: Option<Linearity>,
    pub transfer: Option<Transfer>,
    pub flat: Option<Flat>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Corrected {
    /// Signal in electrons, or in linear DN if the gain is unknown, corrected for dark signal and response.
    /// NaN if the signal is unknown.
    pub signal: Vec<f64>,
    /// Variance due to noise, excluding errors of the calibration. The variance is infinite if it is unknown.
    pub variance: Vec<f64>,
}

/// Calibrates a camera from dark frames at one or more exposures and uniformly lit frames at several levels.
///
/// Without lit frames, only the dark frame is calibrated. Undetermined quantities are reported and keep the
/// values of an ideal camera.
///
/// # Errors
/// Returns [`RadiometricError`] if frames are missing or do not match, or if an option is invalid.
pub fn calibrate(dark: &[Stack], light: &[Stack], options: &Options) -> Result<Radiometry, RadiometricError> {
    if dark.is_empty() {
        return Err(RadiometricError::NoDark);
    }
    check(&dark.iter().chain(light).collect::<Vec<_>>())?;
    for (what, value, need) in [
        ("the light's relative standard error", options.light_sigma, "0 or more"),
        ("the threshold for outlier pixels", options.limit, "0 or more standard deviations"),
    ] {
        if !(value.is_finite() && value >= 0.0) {
            return Err(RadiometricError::Setting { what, value, need });
        }
    }
    if options.degree > MOST_DEGREE {
        return Err(RadiometricError::Setting {
            what: "the number of linearity coefficients",
            value: options.degree as f64,
            need: "0 to 8",
        });
    }
    let (top_dn, frames) = (dark[0].top_dn(), dark);
    let dark = Dark::of(frames, options.limit)?;
    let mut undetermined = vec![];
    if dark.rate.is_none() {
        undetermined.push("dark current: all dark frames have the same exposure time, so the offset includes the dark current".to_owned());
    }
    let levels = self::levels(&dark, light);
    let saturation = saturation(&levels);
    if saturation.is_none() {
        undetermined.push("saturation: no light level saturates the pixels".to_owned());
    }
    let linearity = Linearity::of(&levels, saturation, options.degree, options.light_sigma)
        .map_err(|e| undetermined.push(e))
        .ok();
    let straight = Linearity::none(saturation.unwrap_or(1.0));
    let line = linearity.as_ref().unwrap_or(&straight);
    let transfer = Transfer::of(&self::levels(&dark, frames), &levels, saturation, line)
        .map_err(|e| undetermined.push(e))
        .ok();
    let flat = match &transfer {
        Some(t) => {
            Flat::of(&dark, light, &levels, saturation, line, t).map_err(|e| undetermined.push(e)).ok()
        }
        None => None,
    };
    if flat.is_some() {
        undetermined.push(
            "flat field: includes the non-uniformity of the light, because the frames cannot separate light and pixels"
                .to_owned(),
        );
    }
    let usable = dark.usable();
    let offsets: Vec<f64> = (0..usable.len()).filter(|p| usable[*p]).map(|p| dark.offset.at(p)).collect();
    let offset = offsets.iter().sum::<f64>() / offsets.len() as f64;
    let from = saturation.map_or(f64::INFINITY, |s| offset + SATURATED * s);
    Ok(Radiometry {
        saturated_from_dn: (from.min(f64::from(top_dn))).max(1.0) as u32,
        saturation_dn: saturation,
        undetermined,
        dark,
        linearity,
        transfer,
        flat,
    })
}

impl Radiometry {
    /// Returns the corrected signal of a frame.
    ///
    /// # Errors
    /// Returns [`RadiometricError::Size`] if the number of pixels differs from that of the calibration.
    /// Returns [`RadiometricError::Setting`] if the exposure is not a positive time.
    pub fn correct(&self, frame: &[u32], exposure_s: f64) -> Result<Corrected, RadiometricError> {
        let pixels = self.dark.offset.len();
        if frame.len() != pixels {
            return Err(RadiometricError::Size { found: frame.len(), want: pixels });
        }
        if !(exposure_s.is_finite() && exposure_s > 0.0) {
            return Err(RadiometricError::Setting {
                what: "an exposure",
                value: exposure_s,
                need: "a positive time in seconds",
            });
        }
        let straight = Linearity::none(1.0);
        let line = self.linearity.as_ref().unwrap_or(&straight);
        let (usable, rate) = (self.dark.usable(), self.dark.mean_rate());
        let mut out = Corrected { signal: Vec::with_capacity(pixels), variance: Vec::with_capacity(pixels) };
        for (p, dn) in frame.iter().enumerate() {
            let response = self.flat.as_ref().map_or(1.0, |f| f.response.at(p));
            let known = usable[p] && *dn < self.saturated_from_dn && response > 0.0;
            if !known {
                out.signal.push(f64::NAN);
                out.variance.push(f64::INFINITY);
                continue;
            }
            let signal = f64::from(*dn) - self.dark.at(p, exposure_s);
            let (linear, slope) = (line.linear(signal), line.slope(signal));
            // A reading below the dark level has no shot noise.
            let (gain, variance) = match &self.transfer {
                Some(t) => (t.gain_e_per_dn, t.variance(linear.max(0.0) + rate * exposure_s)),
                None => (1.0, self.dark.variance.at(p) * slope * slope),
            };
            let scale = gain / response;
            out.signal.push(linear * scale);
            out.variance.push(variance * scale * scale);
        }
        Ok(out)
    }
}

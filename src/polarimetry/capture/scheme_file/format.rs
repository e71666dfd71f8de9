//! Defines the contents of scheme files, and checks these contents.

use crate::capture::coaxial::Coaxial;
use crate::capture::element::{Element, ElementKind, Setting};
use crate::capture::scheme::Sensor;
use crate::capture::spectral_value::SpectralValue;
use base::locate::{InputError, Located};
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// A setting in degrees. A setting has one number, or one number per capture.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(untagged)]
pub(super) enum SettingFile {
    Fixed(f64),
    Each(Vec<f64>),
}

impl SettingFile {
    pub(super) fn radians(&self) -> Setting {
        match self {
            Self::Fixed(v) => Setting::Fixed(v.to_radians()),
            Self::Each(v) => Setting::Each(v.iter().map(|v| v.to_radians()).collect()),
        }
    }

    pub(super) fn degrees(setting: &Setting) -> Self {
        match setting {
            Setting::Fixed(v) => Self::Fixed(tidy(v.to_degrees())),
            Setting::Each(v) => Self::Each(v.iter().map(|v| tidy(v.to_degrees())).collect()),
        }
    }
}

/// Rounds degrees to 1e-9, so that 90° is not written as 90.00000000000001.
pub(super) fn tidy(degrees: f64) -> f64 {
    (degrees * 1e9).round() / 1e9
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum KindFile {
    Polarizer,
    Retarder,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ElementFile {
    pub(super) name: Option<String>,
    pub(super) kind: Located<KindFile>,
    pub(super) angle_deg: Located<SettingFile>,
    pub(super) axis_offset_deg: Option<Located<f64>>,
    pub(super) transmittance: Option<Located<SpectralValue>>,
    pub(super) extinction: Option<Located<SpectralValue>>,
    pub(super) retardance_deg: Option<Located<SettingFile>>,
    pub(super) retardance_error_deg: Option<Located<SpectralValue>>,
    pub(super) order: Option<Located<u32>>,
    pub(super) index: Option<Located<f64>>,
}

#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum SensorKind {
    Intensity,
    PolarizerArray,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SensorFile {
    pub(super) kind: Located<SensorKind>,
    pub(super) extinction: Option<Located<SpectralValue>>,
    pub(super) axis_offsets_deg: Option<Located<[f64; 4]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)] // fields of other readers are accepted and ignored
pub(super) struct SchemeFile {
    pub(super) name: Option<String>,
    pub(super) sensor: SensorFile,
    pub(super) source: Option<Located<[f64; 4]>>,
    pub(super) coaxial: Option<Coaxial>,
    #[serde(default)]
    pub(super) generator: Vec<Located<ElementFile>>,
    #[serde(default)]
    pub(super) analyzer: Vec<Located<ElementFile>>,
    // Tables of a calibration file that other modules read.
    polarimetric: Option<IgnoredAny>,
    camera: Option<IgnoredAny>,
    projector: Option<IgnoredAny>,
    quality: Option<IgnoredAny>,
    covariance: Option<IgnoredAny>,
    radiometric: Option<IgnoredAny>,
    temporal: Option<IgnoredAny>,
    detector: Option<IgnoredAny>,
}

/// The largest permissible magnitude of an angle (in degrees) and of all other numbers.
const LARGEST: f64 = 1e6;

/// The text of a file. Errors use the text to state locations.
pub(super) struct Text<'a> {
    pub(super) path: &'a Path,
    pub(super) text: Arc<str>,
}

impl Text<'_> {
    pub(super) fn error(
        &self,
        span: Option<std::ops::Range<usize>>,
        message: String,
        help: &str,
    ) -> InputError {
        InputError::new(self.path, self.text.clone(), span, message, help)
    }

    pub(super) fn spectral(
        &self,
        value: Option<&Located<SpectralValue>>,
        name: &str,
        default: f64,
        [low, high]: [f64; 2],
    ) -> Result<SpectralValue, InputError> {
        let Some(value) = value else {
            return Ok(SpectralValue::Same(default));
        };
        value.check(low, high).map_err(|must| {
            self.error(
                Some(value.span()),
                format!("`{name}` {must}"),
                "expected a number, or rows of [nm, value]",
            )
        })?;
        Ok((**value).clone())
    }

    pub(super) fn finite(
        &self,
        value: Option<&Located<f64>>,
        name: &str,
        default: f64,
    ) -> Result<f64, InputError> {
        match value {
            // Larger angles lose precision, and all other valid numbers are smaller.
            Some(v) if !(-LARGEST..=LARGEST).contains(&**v) => Err(self.error(
                Some(v.span()),
                format!("`{name}` is {}", **v),
                "set a number from -1e6 to 1e6",
            )),
            Some(v) => Ok(**v),
            None => Ok(default),
        }
    }

    /// Checks that the magnitude of every setting is at most [`LARGEST`]. `Scheme` rejects non-finite values.
    fn settings(&self, value: &Located<SettingFile>, name: &str) -> Result<(), InputError> {
        let all = match &**value {
            SettingFile::Fixed(v) => std::slice::from_ref(v),
            SettingFile::Each(list) => list,
        };
        match all.iter().find(|v| v.abs() > LARGEST) {
            Some(v) => Err(self.error(
                Some(value.span()),
                format!("`{name}` contains {v}"),
                "use angles from -1e6 to 1e6 degrees",
            )),
            None => Ok(()),
        }
    }

    pub(super) fn element(
        &self,
        e: &Located<ElementFile>,
        side: &str,
        number: usize,
    ) -> Result<Element, InputError> {
        let is_retarder = *e.kind == KindFile::Retarder;
        let stray = |span: std::ops::Range<usize>, name: &str, of: &str| {
            self.error(
                Some(span),
                format!("`{name}` applies only to {of}"),
                "remove the key, or change `kind`",
            )
        };
        if is_retarder {
            if let Some(v) = &e.extinction {
                return Err(stray(v.span(), "extinction", "polarizers"));
            }
        } else {
            let fields = [
                e.retardance_deg.as_ref().map(|v| (v.span(), "retardance_deg")),
                e.retardance_error_deg.as_ref().map(|v| (v.span(), "retardance_error_deg")),
                e.order.as_ref().map(|v| (v.span(), "order")),
                e.index.as_ref().map(|v| (v.span(), "index")),
            ];
            if let Some((span, name)) = fields.into_iter().flatten().next() {
                return Err(stray(span, name, "retarders"));
            }
        }
        self.settings(&e.angle_deg, "angle_deg")?;
        if let Some(retardance) = &e.retardance_deg {
            self.settings(retardance, "retardance_deg")?;
        }
        let kind = if is_retarder {
            let index = self.finite(e.index.as_ref(), "index", 1.55)?;
            if let Some(at) = e.index.as_ref().filter(|_| !(1.0..=10.0).contains(&index)) {
                return Err(self.error(
                    Some(at.span()),
                    format!("`index` is {index}; expected a refractive index from 1 to 10"),
                    "set the plate's mean refractive index",
                ));
            }
            let error = e.retardance_error_deg.as_ref();
            ElementKind::Retarder {
                retardance: e
                    .retardance_deg
                    .as_ref()
                    .map_or(Setting::Fixed(std::f64::consts::FRAC_PI_2), |v| v.radians()),
                error: self
                    .spectral(error, "retardance_error_deg", 0.0, [-1e6, 1e6])?
                    .scaled(1.0_f64.to_radians()),
                order: e.order.as_ref().map_or(0, |v| **v),
                index,
            }
        } else {
            ElementKind::Polarizer {
                extinction: self.spectral(e.extinction.as_ref(), "extinction", 0.0, [0.0, 1.0])?,
            }
        };
        let default = || format!("{side}_{}", number + 1);
        Ok(Element {
            name: e.name.clone().unwrap_or_else(default),
            kind,
            angle: e.angle_deg.radians(),
            axis_offset: self.finite(e.axis_offset_deg.as_ref(), "axis_offset_deg", 0.0)?.to_radians(),
            transmittance: self.spectral(e.transmittance.as_ref(), "transmittance", 1.0, [0.0, 1.0])?,
        })
    }

    pub(super) fn sensor(&self, file: &SensorFile) -> Result<Sensor, InputError> {
        match *file.kind {
            SensorKind::Intensity => {
                let stray = [
                    file.extinction.as_ref().map(Located::span),
                    file.axis_offsets_deg.as_ref().map(Located::span),
                ];
                match stray.into_iter().flatten().next() {
                    Some(span) => Err(self.error(
                        Some(span),
                        "a sensor of kind \"intensity\" has no polarizers".to_owned(),
                        "remove the key, or set kind = \"polarizer_array\"",
                    )),
                    None => Ok(Sensor::Intensity),
                }
            }
            SensorKind::PolarizerArray => {
                let offsets = file.axis_offsets_deg.as_ref();
                if let Some(v) = offsets.filter(|v| !v.iter().all(|v| v.abs() <= LARGEST)) {
                    return Err(self.error(
                        Some(v.span()),
                        format!("`axis_offsets_deg` is {:?}; expected numbers from -1e6 to 1e6", **v),
                        "set four offsets in degrees, for the polarizers at 0°, 45°, 90° and 135°",
                    ));
                }
                Ok(Sensor::PolarizerArray {
                    extinction: self.spectral(file.extinction.as_ref(), "extinction", 0.0, [0.0, 1.0])?,
                    axis_offsets: offsets.map_or([0.0; 4], |v| v.map(f64::to_radians)),
                })
            }
        }
    }
}

/// Returns the default name of a scheme: the file name without extension.
pub(super) fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| "scheme".to_owned(), |s| s.to_string_lossy().into_owned())
}

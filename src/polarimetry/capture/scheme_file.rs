//! Scheme files: TOML that says everything, and CSV tables of angles as rigs and papers list them.
//!
//! ```toml
//! name = "L-QRPR 16"
//! sensor = { kind = "intensity" }             # or "polarizer_array", with extinction and axis_offsets_deg
//! [[generator]]                               # in the order in which light meets them
//! name = "polarizer_1"
//! kind = "polarizer"
//! angle_deg = [0.0, 12.5, …]                  # one number for all captures, or one for each
//! extinction = 1e-4                           # a number, or rows of [nm, value]
//! [[generator]]
//! name = "retarder_2"
//! kind = "retarder"
//! angle_deg = [0.0, 5.0, …]
//! retardance_deg = 90                         # a list where a liquid crystal changes it
//! retardance_error_deg = [[450, 6.1], [550, 0.0], [660, -5.2]]
//! [[analyzer]]
//! …
//! ```
//!
//! A CSV table has the columns `polarizer_1,retarder_2,retarder_3,polarizer_4` (degrees), and optionally `retardance_2,
//! retardance_3`; without `polarizer_4` it is for a polarizer array.

mod table;
mod write;

pub use table::from_csv;
pub use write::to_toml;

use super::coaxial::Coaxial;
use super::element::{Element, Kind, Setting};
use super::scheme::{Scheme, Sensor};
use super::spectral_value::SpectralValue;
use base::document;
use base::locate::{InputError, Located};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// One number, or one for each capture; degrees.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(untagged)]
enum SettingFile {
    Fixed(f64),
    Each(Vec<f64>),
}

impl SettingFile {
    fn radians(&self) -> Setting {
        match self {
            Self::Fixed(v) => Setting::Fixed(v.to_radians()),
            Self::Each(v) => Setting::Each(v.iter().map(|v| v.to_radians()).collect()),
        }
    }

    fn degrees(setting: &Setting) -> Self {
        match setting {
            Setting::Fixed(v) => Self::Fixed(tidy(v.to_degrees())),
            Setting::Each(v) => Self::Each(v.iter().map(|v| tidy(v.to_degrees())).collect()),
        }
    }
}

/// Degrees to 1e-9, so that 90° is not written as 90.00000000000001.
fn tidy(degrees: f64) -> f64 {
    (degrees * 1e9).round() / 1e9
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
enum KindFile {
    Polarizer,
    Retarder,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ElementFile {
    name: Option<String>,
    kind: Located<KindFile>,
    angle_deg: Located<SettingFile>,
    axis_offset_deg: Option<Located<f64>>,
    transmittance: Option<Located<SpectralValue>>,
    extinction: Option<Located<SpectralValue>>,
    retardance_deg: Option<Located<SettingFile>>,
    retardance_error_deg: Option<Located<SpectralValue>>,
    order: Option<Located<u32>>,
    index: Option<Located<f64>>,
}

#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
enum SensorKind {
    Intensity,
    PolarizerArray,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorFile {
    kind: Located<SensorKind>,
    extinction: Option<Located<SpectralValue>>,
    axis_offsets_deg: Option<Located<[f64; 4]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SchemeFile {
    name: Option<String>,
    sensor: SensorFile,
    source: Option<Located<[f64; 4]>>,
    coaxial: Option<Coaxial>,
    #[serde(default)]
    generator: Vec<Located<ElementFile>>,
    #[serde(default)]
    analyzer: Vec<Located<ElementFile>>,
}

/// A file's text, for errors that name places in it.
struct Text<'a> {
    path: &'a Path,
    text: Arc<str>,
}

impl Text<'_> {
    fn error(&self, span: Option<std::ops::Range<usize>>, message: String, help: &str) -> InputError {
        InputError {
            file: self.path.to_owned(),
            text: self.text.clone(),
            span,
            message,
            help: Some(help.to_owned()),
        }
    }

    fn spectral(
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
                "give a number, or rows of [nm, value]",
            )
        })?;
        Ok((**value).clone())
    }

    fn finite(&self, value: Option<&Located<f64>>, name: &str, default: f64) -> Result<f64, InputError> {
        match value {
            Some(v) if !v.is_finite() => Err(self.error(
                Some(v.span()),
                format!("`{name}` is not a finite number"),
                "give one",
            )),
            Some(v) => Ok(**v),
            None => Ok(default),
        }
    }

    fn element(&self, e: &Located<ElementFile>, side: &str, number: usize) -> Result<Element, InputError> {
        let is_retarder = *e.kind == KindFile::Retarder;
        let stray = |span: std::ops::Range<usize>, name: &str, of: &str| {
            self.error(
                Some(span),
                format!("`{name}` belongs to {of}"),
                "take it out, or change `kind`",
            )
        };
        if is_retarder {
            if let Some(v) = &e.extinction {
                return Err(stray(v.span(), "extinction", "polarizers"));
            }
        } else {
            let fields = [
                e.retardance_deg.as_ref().map(|v| (v.span(), "retardance_deg")),
                e.retardance_error_deg
                    .as_ref()
                    .map(|v| (v.span(), "retardance_error_deg")),
                e.order.as_ref().map(|v| (v.span(), "order")),
                e.index.as_ref().map(|v| (v.span(), "index")),
            ];
            if let Some((span, name)) = fields.into_iter().flatten().next() {
                return Err(stray(span, name, "retarders"));
            }
        }
        let kind = if is_retarder {
            let index = self.finite(e.index.as_ref(), "index", 1.55)?;
            if let Some(at) = e.index.as_ref().filter(|_| index < 1.0) {
                return Err(self.error(
                    Some(at.span()),
                    "`index` is below 1".to_owned(),
                    "give the plate's mean index",
                ));
            }
            let error = e.retardance_error_deg.as_ref();
            Kind::Retarder {
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
            Kind::Polarizer {
                extinction: self.spectral(e.extinction.as_ref(), "extinction", 0.0, [0.0, 1.0])?,
            }
        };
        let default = || format!("{side}_{}", number + 1);
        Ok(Element {
            name: e.name.clone().unwrap_or_else(default),
            kind,
            angle: e.angle_deg.radians(),
            axis_offset: self
                .finite(e.axis_offset_deg.as_ref(), "axis_offset_deg", 0.0)?
                .to_radians(),
            transmittance: self.spectral(e.transmittance.as_ref(), "transmittance", 1.0, [0.0, 1.0])?,
        })
    }

    fn sensor(&self, file: &SensorFile) -> Result<Sensor, InputError> {
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
                        "take it out, or write kind = \"polarizer_array\"",
                    )),
                    None => Ok(Sensor::Intensity),
                }
            }
            SensorKind::PolarizerArray => {
                let offsets = file.axis_offsets_deg.as_ref();
                if let Some(v) = offsets.filter(|v| v.iter().any(|v| !v.is_finite())) {
                    return Err(self.error(
                        Some(v.span()),
                        "an offset is not a finite number".to_owned(),
                        "give four, for 0°, 45°, 90° and 135°",
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

/// Reads a scheme: TOML, or CSV if the name ends so.
///
/// # Errors
/// [`InputError`] naming file, line, column and mend.
pub fn load(path: &Path) -> Result<Scheme, InputError> {
    let mend = "make one: sunstone scheme drr -k 36 -o scheme.toml";
    let text = document::read(path, "scheme", mend)?;
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) {
        from_csv(path, &text)
    } else {
        from_toml(path, &text)
    }
}

/// A scheme from TOML text; `path` is for messages.
///
/// # Errors
/// As [`load`].
pub fn from_toml(path: &Path, text: &str) -> Result<Scheme, InputError> {
    let place = Text {
        path,
        text: text.into(),
    };
    let file: SchemeFile = document::parse(path, text, |_| {
        "`sunstone scheme drr -k 36 -o scheme.toml` writes an example".to_owned()
    })?;
    let side = |elements: &[Located<ElementFile>], name: &str| -> Result<Vec<Element>, InputError> {
        let all = elements.iter().enumerate();
        all.map(|(i, e)| place.element(e, name, i)).collect()
    };
    let (generator, analyzer) = (
        side(&file.generator, "generator")?,
        side(&file.analyzer, "analyzer")?,
    );
    let name = file.name.clone().unwrap_or_else(|| stem(path));
    let mut scheme = Scheme::new(&name, generator, analyzer, place.sensor(&file.sensor)?)
        .map_err(|e| place.error(None, e.to_string(), "settings are lists of the same length"))?;
    if let Some(source) = &file.source {
        let [s0, s1, s2, s3] = **source;
        let polarized = (s1 * s1 + s2 * s2 + s3 * s3).sqrt();
        if !(s0 > 0.0 && polarized <= s0 * (1.0 + 1e-9) && s0.is_finite()) {
            return Err(place.error(
                Some(source.span()),
                "`source` is no Stokes vector".to_owned(),
                "give [s0, s1, s2, s3] with s0 > 0 and s1² + s2² + s3² ≤ s0²",
            ));
        }
        scheme.source = **source;
    }
    if let Some(coaxial) = &file.coaxial {
        for (arm, name) in [
            (&coaxial.transmission, "transmission"),
            (&coaxial.reflection, "reflection"),
        ] {
            let checks = [
                (arm.efficiency.check(0.0, 1.0), "efficiency"),
                (arm.diattenuation.check(-1.0, 1.0), "diattenuation"),
                (arm.retardance_deg.check(-1e6, 1e6), "retardance_deg"),
            ];
            for (result, field) in checks {
                result.map_err(|must| {
                    place.error(None, format!("`coaxial.{name}.{field}` {must}"), "mend it")
                })?;
            }
        }
        if let Some(galvo) = &coaxial.galvo {
            for (value, field) in [(&galvo.n, "n"), (&galvo.k, "k")] {
                value.check(0.0, 1e6).map_err(|must| {
                    place.error(None, format!("`coaxial.galvo.{field}` {must}"), "mend it")
                })?;
            }
        }
        scheme.coaxial = Some(coaxial.clone());
    }
    Ok(scheme)
}

fn stem(path: &Path) -> String {
    path.file_stem()
        .map_or_else(|| "scheme".to_owned(), |s| s.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests;

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

use super::coaxial::Coaxial;
use super::element::{Element, Kind, Setting};
use super::scheme::{Scheme, Sensor};
use super::spectral_value::SpectralValue;
use crate::scene::locate::{Located, SceneError};
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
    fn error(&self, span: Option<std::ops::Range<usize>>, message: String, help: &str) -> SceneError {
        SceneError {
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
    ) -> Result<SpectralValue, SceneError> {
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

    fn finite(&self, value: Option<&Located<f64>>, name: &str, default: f64) -> Result<f64, SceneError> {
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

    fn element(&self, e: &Located<ElementFile>, side: &str, number: usize) -> Result<Element, SceneError> {
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

    fn sensor(&self, file: &SensorFile) -> Result<Sensor, SceneError> {
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
/// [`SceneError`] naming file, line, column and mend.
pub fn load(path: &Path) -> Result<Scheme, SceneError> {
    let text = std::fs::read_to_string(path).map_err(|e| SceneError {
        file: path.to_owned(),
        text: "".into(),
        span: None,
        message: format!("cannot read the scheme: {e}"),
        help: Some("make one: sunstone scheme drr -k 36 -o scheme.toml".to_owned()),
    })?;
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
pub fn from_toml(path: &Path, text: &str) -> Result<Scheme, SceneError> {
    let place = Text {
        path,
        text: text.into(),
    };
    let file: SchemeFile = toml::from_str(text).map_err(|e| {
        place.error(
            e.span(),
            e.message().to_owned(),
            "`sunstone scheme drr -k 36 -o scheme.toml` writes an example",
        )
    })?;
    let side = |elements: &[Located<ElementFile>], name: &str| -> Result<Vec<Element>, SceneError> {
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

const COLUMNS: [&str; 6] = [
    "polarizer_1",
    "retarder_2",
    "retarder_3",
    "polarizer_4",
    "retardance_2",
    "retardance_3",
];

/// A scheme from a CSV table of angles.
///
/// # Errors
/// As [`load`].
pub fn from_csv(path: &Path, text: &str) -> Result<Scheme, SceneError> {
    let place = Text {
        path,
        text: text.into(),
    };
    let help = "columns: polarizer_1,retarder_2,retarder_3,polarizer_4 in degrees (retardance_2, retardance_3 where not 90)";
    let wrong = |e: csv::Error| {
        let at = e.position().map(|p| p.byte() as usize);
        place.error(at.map(|b| b..b), e.to_string(), help)
    };
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(text.as_bytes());
    let headers = reader.headers().map_err(wrong)?.clone();
    let mut columns: [Option<Vec<f64>>; 6] = [const { None }; 6];
    let mut order = vec![];
    for name in &headers {
        let Some(i) = COLUMNS.iter().position(|c| *c == name) else {
            return Err(place.error(Some(0..0), format!("there is no column `{name}`"), help));
        };
        if columns[i].replace(vec![]).is_some() {
            return Err(place.error(Some(0..0), format!("column `{name}` is there twice"), help));
        }
        order.push(i);
    }
    for record in reader.records() {
        let record = record.map_err(wrong)?;
        let at = record.position().map(|p| p.byte() as usize).map(|b| b..b);
        for (field, i) in record.iter().zip(&order) {
            let value: f64 = field.parse().map_err(|_| {
                place.error(
                    at.clone(),
                    format!("`{field}` in column `{}` is not a number", COLUMNS[*i]),
                    help,
                )
            })?;
            if let Some(column) = &mut columns[*i] {
                column.push(value.to_radians());
            }
        }
    }
    let [p1, r2, r3, p4, d2, d3] = columns;
    let (Some(p1), Some(r2), Some(r3)) = (p1, r2, r3) else {
        return Err(place.error(
            Some(0..0),
            "polarizer_1, retarder_2 or retarder_3 is missing".to_owned(),
            help,
        ));
    };
    let quarter = || Setting::Fixed(std::f64::consts::FRAC_PI_2);
    let generator = vec![
        Element::polarizer("polarizer_1", Setting::Each(p1)),
        Element::retarder(
            "retarder_2",
            Setting::Each(r2),
            d2.map_or_else(quarter, Setting::Each),
        ),
    ];
    let mut analyzer = vec![Element::retarder(
        "retarder_3",
        Setting::Each(r3),
        d3.map_or_else(quarter, Setting::Each),
    )];
    let sensor = match p4 {
        Some(p4) => {
            analyzer.push(Element::polarizer("polarizer_4", Setting::Each(p4)));
            Sensor::Intensity
        }
        None => Sensor::array(),
    };
    Scheme::new(&stem(path), generator, analyzer, sensor).map_err(|e| place.error(None, e.to_string(), help))
}

/// What is written: only what differs from an ideal element.
#[derive(Serialize)]
struct ElementOut {
    name: String,
    kind: KindFile,
    angle_deg: SettingFile,
    #[serde(skip_serializing_if = "Option::is_none")]
    retardance_deg: Option<SettingFile>,
    #[serde(skip_serializing_if = "Option::is_none")]
    axis_offset_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    transmittance: Option<SpectralValue>,
    #[serde(skip_serializing_if = "Option::is_none")]
    extinction: Option<SpectralValue>,
    #[serde(skip_serializing_if = "Option::is_none")]
    retardance_error_deg: Option<SpectralValue>,
    #[serde(skip_serializing_if = "Option::is_none")]
    order: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    index: Option<f64>,
}

#[derive(Serialize)]
struct SensorOut {
    kind: SensorKind,
    #[serde(skip_serializing_if = "Option::is_none")]
    extinction: Option<SpectralValue>,
    #[serde(skip_serializing_if = "Option::is_none")]
    axis_offsets_deg: Option<[f64; 4]>,
}

#[derive(Serialize)]
struct SchemeOut {
    name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    source: Option<[f64; 4]>,
    sensor: SensorOut,
    #[serde(skip_serializing_if = "Option::is_none")]
    coaxial: Option<Coaxial>,
    generator: Vec<ElementOut>,
    analyzer: Vec<ElementOut>,
}

fn unless(value: &SpectralValue, ideal: f64) -> Option<SpectralValue> {
    (*value != SpectralValue::Same(ideal)).then(|| value.clone())
}

fn element_out(e: &Element) -> ElementOut {
    let mut out = ElementOut {
        name: e.name.clone(),
        kind: KindFile::Polarizer,
        angle_deg: SettingFile::degrees(&e.angle),
        retardance_deg: None,
        axis_offset_deg: (e.axis_offset != 0.0).then(|| tidy(e.axis_offset.to_degrees())),
        transmittance: unless(&e.transmittance, 1.0),
        extinction: None,
        retardance_error_deg: None,
        order: None,
        index: None,
    };
    match &e.kind {
        Kind::Polarizer { extinction } => out.extinction = unless(extinction, 0.0),
        Kind::Retarder {
            retardance,
            error,
            order,
            index,
        } => {
            out.kind = KindFile::Retarder;
            out.retardance_deg = Some(SettingFile::degrees(retardance));
            out.retardance_error_deg = unless(error, 0.0).map(|v| v.scaled(1.0_f64.to_degrees()));
            out.order = (*order != 0).then_some(*order);
            out.index = (*index != 1.55).then_some(*index);
        }
    }
    out
}

/// A scheme as TOML.
///
/// # Errors
/// If a number cannot be written (none of a checked scheme).
pub fn to_toml(scheme: &Scheme) -> Result<String, toml::ser::Error> {
    let sensor = match &scheme.sensor {
        Sensor::Intensity => SensorOut {
            kind: SensorKind::Intensity,
            extinction: None,
            axis_offsets_deg: None,
        },
        Sensor::PolarizerArray {
            extinction,
            axis_offsets,
        } => SensorOut {
            kind: SensorKind::PolarizerArray,
            extinction: unless(extinction, 0.0),
            axis_offsets_deg: (*axis_offsets != [0.0; 4]).then(|| axis_offsets.map(|v| tidy(v.to_degrees()))),
        },
    };
    toml::to_string(&SchemeOut {
        name: scheme.name.clone(),
        source: (scheme.source != [1.0, 0.0, 0.0, 0.0]).then_some(scheme.source),
        sensor,
        coaxial: scheme.coaxial.clone(),
        generator: scheme.generator().iter().map(element_out).collect(),
        analyzer: scheme.analyzer().iter().map(element_out).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn toml(text: &str) -> Result<Scheme, SceneError> {
        from_toml(Path::new("s.toml"), text)
    }

    fn fault(text: &str) -> String {
        toml(text).expect_err("a fault").to_string()
    }

    const FULL: &str = r#"
name = "full"
source = [1.0, 1.0, 0.0, 0.0]
sensor = { kind = "polarizer_array", extinction = [[450, 0.01], [650, 0.002]], axis_offsets_deg = [0.1, 0, 0, -0.2] }
[coaxial]
transmission = { efficiency = 0.45, diattenuation = 0.02 }
reflection = { efficiency = 0.48, retardance_deg = 12 }
galvo = { n = 0.06, k = 3.6 }
[[generator]]
name = "p"
kind = "polarizer"
angle_deg = 10
extinction = 1e-4
transmittance = 0.9
[[generator]]
kind = "retarder"
angle_deg = [0, 30.5, 61]
retardance_deg = [90, 91, 92]
retardance_error_deg = [[450, 6], [550, 0]]
order = 3
axis_offset_deg = 0.25
[[analyzer]]
kind = "retarder"
angle_deg = [0, 150, 300]
index = 1.6
"#;

    #[test]
    fn what_is_written_is_read() {
        let full = toml(FULL).expect("a scheme");
        assert_eq!(
            (full.captures(), full.measurements(), full.motors().len()),
            (3, 12, 3)
        );
        assert_eq!(full.generator()[1].name, "generator_2");
        let schemes = [
            Ok(full),
            Scheme::drr(36, false),
            Scheme::qrpr(5, true),
            Scheme::liquid_crystal(16, false),
        ];
        for scheme in schemes {
            let scheme = scheme.expect("a scheme");
            let text = to_toml(&scheme).expect("TOML");
            let back = toml(&text).expect(&text);
            assert_eq!(to_toml(&back).expect("TOML"), text);
            assert_eq!(back.motors(), scheme.motors());
            let near = back
                .parameters()
                .iter()
                .zip(scheme.parameters())
                .all(|(a, b)| (a - b).abs() < 1e-10);
            assert!(near, "{text}");
        }
    }

    #[test]
    fn faults_have_places_and_mends() {
        let head = "sensor = { kind = \"intensity\" }\n[[generator]]\n";
        let with = |rest: &str| fault(&format!("{head}{rest}"));
        assert!(with("kind = \"polariser\"\nangle_deg = 0").contains("s.toml:3:8"));
        assert!(with("kind = \"polarizer\"\nangle_deg = 0\nretardance_deg = 90").contains("s.toml:5:18"));
        assert!(with("kind = \"polarizer\"\nangle_deg = 0\nextinction = 2").contains("from 0 to 1"));
        assert!(
            with("kind = \"retarder\"\nangle_deg = 0\nextinction = 0.1").contains("belongs to polarizers")
        );
        assert!(with("kind = \"retarder\"\nangle_deg = 0\nindex = 0.5").contains("below 1"));
        assert!(with("kind = \"polarizer\"\nangle_deg = [nan]").contains("capture 1"));
        assert!(with("kind = \"polarizer\"\nangle_deg = []").contains("at least one capture"));
        assert!(fault("sensor = { kind = \"intensity\", extinction = 0.1 }").contains("has no polarizers"));
        assert!(
            fault("source = [1, 1, 1, 0]\nsensor = { kind = \"intensity\" }").contains("no Stokes vector")
        );
        assert!(
            load(Path::new("/nowhere/s.toml"))
                .expect_err("no file")
                .to_string()
                .contains("sunstone scheme")
        );
    }

    #[test]
    fn tables_of_angles() {
        let csv = |text: &str| from_csv(Path::new("a.csv"), text);
        let four = csv(
            "polarizer_1, retarder_2, retarder_3, polarizer_4\n0, 5, 25, 0\n# a comment\n10, 20, 30, 40\n",
        );
        let four = four.expect("a scheme");
        assert_eq!((four.captures(), &four.sensor), (2, &Sensor::Intensity));
        let degrees: Vec<f64> = four.parameters().iter().map(|p| p.to_degrees()).collect();
        let want = [0.0, 10.0, 5.0, 20.0, 25.0, 30.0, 0.0, 40.0];
        assert!(degrees.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-12));
        let array = csv("polarizer_1,retarder_2,retarder_3,retardance_3\n0,5,25,100\n").expect("a scheme");
        assert_eq!((array.sensor.channels(), array.motors().len()), (4, 4));
        for (text, part) in [
            ("polarizer_1,retarder_2\n0,0\n", "is missing"),
            ("polarizer_1,retarder_2,retarder_3\n0,x,0\n", "a.csv:2:1: `x`"),
            ("polarizer_1,retarder_2,retarder_3\n0,1\n", "found record with 2"),
            ("polarizer_1,polarizer_1\n", "twice"),
            ("angle\n", "no column `angle`"),
            ("polarizer_1,retarder_2,retarder_3\n", "at least one"),
        ] {
            let message = csv(text).expect_err("a fault").to_string();
            assert!(message.contains(part), "{message}");
        }
    }

    proptest! {
        /// Damaged files are refused or read, never a panic.
        #[test]
        fn damage_is_survived(at in 0_usize..FULL.len(), with in "[ -~]{0,6}", csv in "[ -~\n,]{0,80}") {
            let mut text = FULL.to_owned();
            text.replace_range(at..(at + with.len()).min(text.len()), &with);
            let _ = toml(&text);
            let _ = from_csv(Path::new("x.csv"), &csv);
            let _ = from_csv(Path::new("x.csv"), &format!("polarizer_1,retarder_2,retarder_3\n{csv}"));
        }
    }
}

//! Writes schemes as TOML text.

use super::super::coaxial::Coaxial;
use super::super::element::{Element, ElementKind};
use super::super::scheme::{Scheme, Sensor};
use super::super::spectral_value::SpectralValue;
use super::format::{KindFile, SensorKind, SettingFile, tidy};
use serde::Serialize;

/// The fields in which an element differs from an ideal element. All other fields are `None`, which TOML
/// omits.
#[derive(Serialize)]
struct ElementOut {
    name: String,
    kind: KindFile,
    angle_deg: SettingFile,
    retardance_deg: Option<SettingFile>,
    axis_offset_deg: Option<f64>,
    transmittance: Option<SpectralValue>,
    extinction: Option<SpectralValue>,
    retardance_error_deg: Option<SpectralValue>,
    order: Option<u32>,
    index: Option<f64>,
}

#[derive(Serialize)]
struct SensorOut {
    kind: SensorKind,
    extinction: Option<SpectralValue>,
    axis_offsets_deg: Option<[f64; 4]>,
}

#[derive(Serialize)]
struct SchemeOut {
    name: String,
    source: Option<[f64; 4]>,
    sensor: SensorOut,
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
        ElementKind::Polarizer { extinction } => out.extinction = unless(extinction, 0.0),
        ElementKind::Retarder { retardance, error, order, index } => {
            out.kind = KindFile::Retarder;
            out.retardance_deg = Some(SettingFile::degrees(retardance));
            out.retardance_error_deg = unless(error, 0.0).map(|v| v.scaled(1.0_f64.to_degrees()));
            out.order = (*order != 0).then_some(*order);
            out.index = (*index != 1.55).then_some(*index);
        }
    }
    out
}

/// Returns a scheme as TOML.
///
/// # Errors
/// Returns an error if a number cannot be serialized. Checked schemes do not cause this error.
pub fn to_toml(scheme: &Scheme) -> Result<String, toml::ser::Error> {
    let sensor = match &scheme.sensor {
        Sensor::Intensity => {
            SensorOut { kind: SensorKind::Intensity, extinction: None, axis_offsets_deg: None }
        }
        Sensor::PolarizerArray { extinction, axis_offsets } => SensorOut {
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

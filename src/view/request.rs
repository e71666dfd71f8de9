//! Requests of the page. `page/src/sources/source.ts` defines the same structures.

use crate::error::ViewError;
use serde::Deserialize;
use store::probe::{Pattern, Probe, Selection, parse_axes, parse_stokes};

/// A query with the words of the command `sunstone probe`.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct ProbeRequest {
    pub store: usize,
    pub slice: String,
    #[serde(default)]
    select: Vec<String>,
    #[serde(default)]
    sum: Vec<String>,
    stokes: Option<String>,
    pattern: Option<Drive>,
    pulse: Option<String>,
}

/// A drive image of the projector, 0..1, row-major.
#[derive(Clone, Debug, Deserialize)]
struct Drive {
    width: u32,
    height: u32,
    values: Vec<f32>,
}

impl ProbeRequest {
    /// Returns the probe that the words describe.
    pub(crate) fn probe(&self) -> Result<Probe, ViewError> {
        let refused = |e: store::probe::ParseError| ViewError::Request(e.to_string());
        let mut probe = Probe::default();
        for word in &self.select {
            probe.select.push(word.parse::<Selection>().map_err(refused)?);
        }
        for word in &self.sum {
            probe.sum.extend(parse_axes(word).map_err(refused)?);
        }
        probe.stokes = self.stokes.as_deref().map(parse_stokes).transpose().map_err(refused)?;
        probe.pulse = self.pulse.as_deref().map(str::parse).transpose().map_err(refused)?;
        probe.pattern = self.pattern.as_ref().map(|drive| Pattern {
            width: drive.width,
            height: drive.height,
            values: drive.values.clone(),
        });
        Ok(probe)
    }
}

impl ImageRequest {
    /// Returns the request for the Mueller matrices of a slice, at one wavelength if the slice has several.
    pub(crate) fn of_matrices(store: usize, slice: &str, nm: Option<f64>, limit: usize) -> Self {
        let select = nm.map(|nm| format!("wavelength={nm}")).into_iter().collect();
        let slice = slice.to_owned();
        let probe =
            ProbeRequest { store, slice, select, sum: vec![], stokes: None, pattern: None, pulse: None };
        Self { probe, region: None, time: false, output: None, input: None, errors: false, limit }
    }
}

/// A probe that keeps camera pixels, and optionally time.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct ImageRequest {
    #[serde(flatten)]
    pub probe: ProbeRequest,
    /// First and last-plus-one entries of the axes y and x: `[y0, y1, x0, x1]`.
    pub region: Option<[usize; 4]>,
    #[serde(default)]
    pub time: bool,
    /// Weights that contract the axis `stokes_out`.
    pub output: Option<[f32; 4]>,
    /// Weights that contract the axis `stokes_in`.
    pub input: Option<[f32; 4]>,
    #[serde(default)]
    pub errors: bool,
    /// Maximum number of values.
    pub limit: usize,
}

/// A trial of a capture scheme on the matrices of a slice.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct TrialRequest {
    pub store: usize,
    pub slice: String,
    pub scheme: SchemeChoice,
    pub detector: DetectorChoice,
    /// Index along the axis of wavelengths.
    #[serde(default)]
    pub wavelength: usize,
    #[serde(default)]
    pub seed: u64,
    /// The capture whose image is returned.
    #[serde(default)]
    pub capture: usize,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum SchemeChoice {
    /// A scheme of the command `sunstone scheme`.
    Named { name: String, captures: usize, array: bool },
    /// The text of a scheme file.
    File { toml: String },
}

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum DetectorChoice {
    /// The text of a detector file.
    File { toml: String },
    /// Normal noise with this standard deviation, relative to the mean M00.
    Sigma { sigma: f64 },
}

/// Parses a request.
pub(crate) fn parse<T: serde::de::DeserializeOwned>(body: &[u8]) -> Result<T, ViewError> {
    serde_json::from_slice(body).map_err(|e| ViewError::Request(format!("the request is not valid: {e}")))
}

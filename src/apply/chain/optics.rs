//! True optical elements. The elements are drawn at random within tolerances, or are known from a scheme
//! file.

use polarimetry::capture::detector::random::stream;
use polarimetry::capture::element::{Element, ElementKind};
use polarimetry::capture::scheme::{Scheme, Sensor, Side};
use polarimetry::capture::spectral_value::SpectralValue;
use rand_distr::{Distribution, StandardNormal};
use serde::Deserialize;

/// Tolerances of the optical elements of a rig. Each seed gives a rig with different elements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tolerances {
    /// Standard deviation of the axis error of each element, in degrees.
    pub axis_error_deg: f64,
    /// Standard deviation of the retardance error of each retarder, in degrees.
    pub retardance_error_deg: f64,
    /// Ratio of the minimum to the maximum transmittance of all polarizers. The ratio is 1e-3 for an
    /// extinction ratio of 1000:1.
    pub extinction: f64,
}

/// The true elements of a rig.
#[derive(Clone, Debug, PartialEq)]
pub enum Optics {
    /// Elements drawn at random within tolerances.
    Drawn(Tolerances),
    /// Elements of a scheme. The settings of this scheme are ignored.
    Known(Box<Scheme>),
}

impl Optics {
    /// Returns a scheme with these elements and the settings of `nominal`. Equal rig numbers `rig` give the
    /// same elements for all settings.
    pub fn of(&self, nominal: &Scheme, rig: u64) -> Scheme {
        match self {
            Self::Known(optics) => with_elements(nominal, optics),
            Self::Drawn(t) => t.drawn(nominal, rig),
        }
    }
}

impl Tolerances {
    fn drawn(&self, nominal: &Scheme, rig: u64) -> Scheme {
        let mut out = nominal.clone();
        let mut random = stream(rig, 0, 0);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        for (side, n) in
            [(Side::Generator, nominal.generator().len()), (Side::Analyzer, nominal.analyzer().len())]
        {
            for i in 0..n {
                // Two random numbers are drawn for every element, so that the axes of a rig do not depend
                // on the number of retarders.
                let [axis, retardance] = [normal(), normal()];
                out.imperfect(side, i, |e| {
                    e.axis_offset += (self.axis_error_deg * axis).to_radians();
                    match &mut e.kind {
                        ElementKind::Polarizer { extinction } => {
                            *extinction = SpectralValue::Same(self.extinction);
                        }
                        ElementKind::Retarder { error, .. } => {
                            *error = shifted(error, (self.retardance_error_deg * retardance).to_radians());
                        }
                    }
                });
            }
        }
        if let Sensor::PolarizerArray { extinction, axis_offsets } = &mut out.sensor {
            *extinction = SpectralValue::Same(self.extinction);
            // The polarizer at 0° defines the frame.
            for offset in &mut axis_offsets[1..] {
                *offset += (self.axis_error_deg * normal()).to_radians();
            }
        }
        out
    }
}

fn shifted(value: &SpectralValue, by: f64) -> SpectralValue {
    match value {
        SpectralValue::Same(v) => SpectralValue::Same(v + by),
        SpectralValue::Table(rows) => {
            SpectralValue::Table(rows.iter().map(|[nm, v]| [*nm, v + by]).collect())
        }
    }
}

/// Returns a scheme with the settings of `settings` and the imperfections of `elements`. Elements with equal
/// names correspond.
pub fn with_elements(settings: &Scheme, elements: &Scheme) -> Scheme {
    let mut out = settings.clone();
    for (side, own, others) in [
        (Side::Generator, settings.generator(), elements.generator()),
        (Side::Analyzer, settings.analyzer(), elements.analyzer()),
    ] {
        for (i, e) in own.iter().enumerate() {
            if let Some(other) = others.iter().find(|o| o.name == e.name && same_kind(o, e)) {
                out.imperfect(side, i, |e| *e = other.clone());
            }
        }
    }
    if settings.sensor.channels() == elements.sensor.channels() {
        out.sensor = elements.sensor.clone();
    }
    out.coaxial.clone_from(&elements.coaxial);
    out
}

fn same_kind(a: &Element, b: &Element) -> bool {
    matches!(a.kind, ElementKind::Polarizer { .. }) == matches!(b.kind, ElementKind::Polarizer { .. })
}

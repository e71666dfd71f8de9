//! The imperfections of a scheme as a list of named numbers.

use polarimetry::capture::coaxial::{Arm, Coaxial};
use polarimetry::capture::element::ElementKind;
use polarimetry::capture::scheme::{Scheme, Sensor, Side};
use polarimetry::capture::spectral_value::SpectralValue;

/// A parameter of one imperfection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// Angle of an element's axis at the zero of its stage, in degrees.
    AxisOffset(Side, usize),
    /// Deviation of a retarder's retardance from the nominal value, in degrees.
    Retardance(Side, usize),
    /// Ratio of the minimum to the maximum transmittance of a polarizer.
    Extinction(Side, usize),
    /// Ratio of the minimum to the maximum transmittance of the polarizers on a sensor.
    SensorExtinction,
    /// Axis offset of one of the sensor's polarizers in degrees. The polarizer at 0° defines the
    /// frame and has no offset.
    SensorOffset(usize),
    /// Diattenuation of the beamsplitter's transmission arm (if true) or reflection arm (if false).
    Diattenuation(bool),
    /// Retardance, in degrees, of the beamsplitter's transmission arm (if true) or reflection arm (if false).
    ArmRetardance(bool),
    /// Refractive index of the galvo mirrors' metal.
    GalvoIndex,
    /// Extinction coefficient of the galvo mirrors' metal.
    GalvoAbsorption,
}

impl Parameter {
    /// Returns all parameters of a scheme that can be fitted.
    pub fn all(scheme: &Scheme) -> Vec<Self> {
        let mut all = vec![];
        for (side, elements) in [(Side::Generator, scheme.generator()), (Side::Analyzer, scheme.analyzer())] {
            for (i, e) in elements.iter().enumerate() {
                all.push(Self::AxisOffset(side, i));
                all.push(match e.kind {
                    ElementKind::Polarizer { .. } => Self::Extinction(side, i),
                    ElementKind::Retarder { .. } => Self::Retardance(side, i),
                });
            }
        }
        if let Sensor::PolarizerArray { .. } = scheme.sensor {
            all.push(Self::SensorExtinction);
            all.extend((1..4).map(Self::SensorOffset));
        }
        if let Some(coaxial) = &scheme.coaxial {
            for transmission in [true, false] {
                all.extend([Self::Diattenuation(transmission), Self::ArmRetardance(transmission)]);
            }
            if coaxial.galvo.is_some() {
                all.extend([Self::GalvoIndex, Self::GalvoAbsorption]);
            }
        }
        all
    }

    /// Returns the parameter's name, which includes the name of the element.
    pub fn name(&self, scheme: &Scheme) -> String {
        let of = |side: Side, i: usize| match side {
            Side::Generator => scheme.generator()[i].name.clone(),
            Side::Analyzer => scheme.analyzer()[i].name.clone(),
        };
        let arm = |transmission: bool| {
            if transmission { "transmission" } else { "reflection" }
        };
        match *self {
            Self::AxisOffset(side, i) => format!("{} axis offset", of(side, i)),
            Self::Retardance(side, i) => format!("{} retardance error", of(side, i)),
            Self::Extinction(side, i) => format!("{} extinction", of(side, i)),
            Self::SensorExtinction => "sensor extinction".into(),
            Self::SensorOffset(i) => format!("sensor axis offset at {}°", 45 * i),
            Self::Diattenuation(t) => format!("{} diattenuation", arm(t)),
            Self::ArmRetardance(t) => format!("{} retardance", arm(t)),
            Self::GalvoIndex => "galvo index".into(),
            Self::GalvoAbsorption => "galvo absorption".into(),
        }
    }

    pub fn unit(&self) -> &'static str {
        match self {
            Self::AxisOffset(..) | Self::Retardance(..) | Self::SensorOffset(_) | Self::ArmRetardance(_) => {
                "°"
            }
            _ => "",
        }
    }

    /// Returns the step for numerical derivatives with respect to the number that is fitted
    /// ([`Self::to_fit`]).
    pub fn step(&self) -> f64 {
        match self {
            Self::Extinction(..) | Self::SensorExtinction | Self::Diattenuation(_) => 1e-5,
            _ => 1e-3,
        }
    }

    /// Returns the parameter's value in a scheme at a wavelength.
    pub fn get(&self, scheme: &Scheme, nm: f64) -> f64 {
        let of = |side: Side, i: usize| match side {
            Side::Generator => &scheme.generator()[i],
            Side::Analyzer => &scheme.analyzer()[i],
        };
        let arm = |transmission: bool| scheme.coaxial.as_ref().map(|c| part(c, transmission));
        let galvo = || scheme.coaxial.as_ref().and_then(|c| c.galvo.as_ref());
        match *self {
            Self::AxisOffset(side, i) => of(side, i).axis_offset.to_degrees(),
            Self::Retardance(side, i) => match &of(side, i).kind {
                ElementKind::Retarder { error, .. } => error.at(nm).to_degrees(),
                ElementKind::Polarizer { .. } => 0.0,
            },
            Self::Extinction(side, i) => match &of(side, i).kind {
                ElementKind::Polarizer { extinction } => extinction.at(nm),
                ElementKind::Retarder { .. } => 0.0,
            },
            Self::SensorExtinction => match &scheme.sensor {
                Sensor::PolarizerArray { extinction, .. } => extinction.at(nm),
                Sensor::Intensity => 0.0,
            },
            Self::SensorOffset(i) => match &scheme.sensor {
                Sensor::PolarizerArray { axis_offsets, .. } => axis_offsets[i].to_degrees(),
                Sensor::Intensity => 0.0,
            },
            Self::Diattenuation(t) => arm(t).map_or(0.0, |a| a.diattenuation.at(nm)),
            Self::ArmRetardance(t) => arm(t).map_or(0.0, |a| a.retardance_deg.at(nm)),
            Self::GalvoIndex => galvo().map_or(0.0, |g| g.n.at(nm)),
            Self::GalvoAbsorption => galvo().map_or(0.0, |g| g.k.at(nm)),
        }
    }

    /// Returns whether the parameter may depend on the wavelength. Axis angles do not depend on the
    /// wavelength, but optical properties do.
    pub fn is_spectral(&self) -> bool {
        !matches!(self, Self::AxisOffset(..) | Self::SensorOffset(_))
    }

    /// Sets a scheme's values at several wavelengths, as rows of [nm, value] in ascending order. A single row
    /// applies to all wavelengths.
    pub fn set_table(&self, scheme: &mut Scheme, rows: &[[f64; 2]]) {
        match rows {
            [] => {}
            [[_, value]] => self.set(scheme, *value),
            _ => self.put(scheme, |factor| {
                SpectralValue::Table(rows.iter().map(|[nm, v]| [*nm, v * factor]).collect())
            }),
        }
    }

    /// Sets the parameter of a scheme to the same value at all wavelengths.
    pub fn set(&self, scheme: &mut Scheme, value: f64) {
        match *self {
            Self::AxisOffset(side, i) => scheme.imperfect(side, i, |e| e.axis_offset = value.to_radians()),
            Self::SensorOffset(i) => {
                if let Sensor::PolarizerArray { axis_offsets, .. } = &mut scheme.sensor {
                    axis_offsets[i] = value.to_radians();
                }
            }
            _ => self.put(scheme, |factor| SpectralValue::Same(value * factor)),
        }
    }

    /// Sets a spectral value of a scheme. `of` creates the value from the factor that converts the
    /// parameter's unit to the scheme's unit.
    fn put(&self, scheme: &mut Scheme, of: impl Fn(f64) -> SpectralValue) {
        let plain = || of(1.0);
        match *self {
            Self::AxisOffset(..) | Self::SensorOffset(_) => {}
            Self::Retardance(side, i) => scheme.imperfect(side, i, |e| {
                if let ElementKind::Retarder { error, .. } = &mut e.kind {
                    *error = of(1.0_f64.to_radians());
                }
            }),
            Self::Extinction(side, i) => scheme.imperfect(side, i, |e| {
                if let ElementKind::Polarizer { extinction } = &mut e.kind {
                    *extinction = plain();
                }
            }),
            Self::SensorExtinction => {
                if let Sensor::PolarizerArray { extinction, .. } = &mut scheme.sensor {
                    *extinction = plain();
                }
            }
            Self::Diattenuation(t) => {
                if let Some(c) = &mut scheme.coaxial {
                    part_mut(c, t).diattenuation = plain();
                }
            }
            Self::ArmRetardance(t) => {
                if let Some(c) = &mut scheme.coaxial {
                    part_mut(c, t).retardance_deg = plain();
                }
            }
            Self::GalvoIndex | Self::GalvoAbsorption => {
                if let Some(galvo) = scheme.coaxial.as_mut().and_then(|c| c.galvo.as_mut()) {
                    let part = if *self == Self::GalvoIndex { &mut galvo.n } else { &mut galvo.k };
                    *part = plain();
                }
            }
        }
    }

    /// Returns the number that is fitted in place of a value.
    ///
    /// For n and k of metals, the logarithm is fitted, so that the values stay positive. Metals with
    /// negative k would amplify light, and the fit would have additional minima.
    pub fn to_fit(&self, value: f64) -> f64 {
        match self {
            Self::GalvoIndex | Self::GalvoAbsorption => value.max(1e-6).ln(),
            _ => value,
        }
    }

    /// Returns the value for a fitted number, and the derivative of the value with respect to this number.
    pub fn from_fit(&self, number: f64) -> [f64; 2] {
        match self {
            Self::GalvoIndex | Self::GalvoAbsorption => [number.exp(); 2],
            _ => [number, 1.0],
        }
    }

    /// Returns the nearest physically possible value, for example a nonnegative extinction.
    pub fn possible(&self, value: f64) -> f64 {
        match self {
            Self::Extinction(..) | Self::SensorExtinction => value.clamp(0.0, 1.0),
            Self::Diattenuation(_) => value.clamp(-1.0, 1.0),
            Self::GalvoIndex | Self::GalvoAbsorption => value.max(0.0),
            _ => value,
        }
    }
}

fn part(c: &Coaxial, transmission: bool) -> &Arm {
    if transmission { &c.transmission } else { &c.reflection }
}

fn part_mut(c: &mut Coaxial, transmission: bool) -> &mut Arm {
    if transmission { &mut c.transmission } else { &mut c.reflection }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_round_trip() {
        for array in [false, true] {
            let mut scheme = Scheme::quad(4, array).expect("a scheme");
            let all = Parameter::all(&scheme);
            assert_eq!(all.len(), if array { 6 + 4 } else { 8 });
            for (i, p) in all.iter().enumerate() {
                p.set(&mut scheme, 0.01 * (i + 1) as f64);
            }
            for (i, p) in all.iter().enumerate() {
                let want = 0.01 * (i + 1) as f64;
                assert!((p.from_fit(p.to_fit(want))[0] - want).abs() < 1e-12);
                assert!((p.get(&scheme, 550.0) - want).abs() < 1e-12, "{}", p.name(&scheme));
            }
            let mut names: Vec<String> = all.iter().map(|p| p.name(&scheme)).collect();
            names.sort();
            names.dedup();
            assert_eq!(names.len(), all.len());
        }
    }
}

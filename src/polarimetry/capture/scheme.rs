//! Capture schemes. A scheme contains the polarizing elements of generator and analyzer, and their settings
//! in every capture.
//!
//! In Baek & Heide (2021, sec. 4), an intensity is I_k = [L(θ4) Q(θ3) T Q(θ2) L(θ1) p]_0. L is a linear
//! polarizer, Q a quarter-wave plate, T the scene, and p unpolarized light of unit intensity.
//!
//! - Dual rotating retarders (DRR; Azzam 1978) fix the polarizers and rotate the quarter-wave plates by 5°
//!   and 25° per capture.
//! - Quad rotating polarizers and retarders (QRPR) rotate all four elements.
//! - With a polarizer array (-P), four fixed polarizers on the sensor replace L(θ4).
//! - Liquid-crystal schemes keep all angles and change the retardances.

use super::coaxial::Coaxial;
use super::element::{Element, ElementKind, Quantity, Set, Setting};
use super::spectral_value::SpectralValue;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
use thiserror::Error;

/// Angles of the polarizers on a sensor in degrees. The order is the storage order of the sensor's four
/// images.
pub const ARRAY_DEG: [f64; 4] = [0.0, 45.0, 90.0, 135.0];

#[derive(Clone, Debug, PartialEq)]
pub enum Sensor {
    /// Pixels that are insensitive to polarization. Each capture yields one number per pixel.
    Intensity,
    /// Pixels behind linear polarizers at [`ARRAY_DEG`]. Each capture yields four numbers per pixel.
    PolarizerArray {
        /// Ratio of the least to the greatest transmittance of the polarizers.
        extinction: SpectralValue,
        /// Errors of the polarizers' angles in radians.
        axis_offsets: [f64; 4],
    },
}

impl Sensor {
    /// Returns an ideal polarizer array.
    pub fn array() -> Self {
        Self::PolarizerArray { extinction: SpectralValue::Same(0.0), axis_offsets: [0.0; 4] }
    }

    /// Returns the number of measurements per pixel and capture.
    pub fn channels(&self) -> usize {
        match self {
            Self::Intensity => 1,
            Self::PolarizerArray { .. } => 4,
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum SchemeError {
    /// Lists of settings differ in length.
    #[error("`{name}` has {found} settings, but `{other}` has {want}; list one setting per capture")]
    Lengths {
        name: String,
        /// Number of settings of the element.
        found: usize,
        /// Name of the element with which the settings are compared.
        other: String,
        /// Number of the other element's settings.
        want: usize,
    },
    #[error("the scheme has no captures; add at least one setting")]
    Empty,
    #[error(
        "the setting of `{name}` at capture {capture} (counted from 0) is not a finite number; correct the setting"
    )]
    NotFinite {
        name: String,
        /// The capture, counted from 0.
        capture: usize,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Elements before the scene.
    Generator,
    /// Elements behind the scene.
    Analyzer,
}

/// A setting that changes between captures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Motor {
    pub side: Side,
    /// Index of the element on its side of the scene. Elements are in the order in which light passes them.
    pub element: usize,
    pub quantity: Quantity,
}

/// A valid scheme. Every setting has a finite value for every capture.
#[derive(Clone, Debug, PartialEq)]
pub struct Scheme {
    /// Name of the scheme in tables.
    pub name: String,
    /// Stokes vector of the source. The vector [1, 0, 0, 0] describes unpolarized light.
    pub source: [f64; 4],
    generator: Vec<Element>,
    analyzer: Vec<Element>,
    pub sensor: Sensor,
    pub coaxial: Option<Coaxial>,
    captures: usize,
}

impl Scheme {
    /// Builds a scheme. Elements are in the order in which light passes them.
    ///
    /// # Errors
    /// Returns an error if a setting is missing or not finite.
    pub fn new(
        name: &str,
        generator: Vec<Element>,
        analyzer: Vec<Element>,
        sensor: Sensor,
    ) -> Result<Self, SchemeError> {
        let captures = captures(&generator, &analyzer)?;
        Ok(Self {
            name: name.to_owned(),
            source: [1.0, 0.0, 0.0, 0.0],
            generator,
            analyzer,
            sensor,
            coaxial: None,
            captures,
        })
    }

    /// Returns the elements before the scene.
    pub fn generator(&self) -> &[Element] {
        &self.generator
    }

    /// Returns the elements behind the scene, without the polarizers of the sensor.
    pub fn analyzer(&self) -> &[Element] {
        &self.analyzer
    }

    /// Returns the number of captures K.
    pub fn captures(&self) -> usize {
        self.captures
    }

    /// Returns the settings of generator and analyzer in capture `k`.
    ///
    /// # Panics
    /// Panics if `k` is out of range.
    pub fn sets(&self, k: usize) -> [Vec<Set>; 2] {
        let of = |side: &[Element]| side.iter().map(|e| e.set_at(k)).collect();
        [of(&self.generator), of(&self.analyzer)]
    }

    /// Returns the number of measurements per pixel. The number is K, or 4K with a polarizer array (sorted by
    /// capture).
    pub fn measurements(&self) -> usize {
        self.captures * self.sensor.channels()
    }

    fn elements(&self) -> impl Iterator<Item = (Side, usize, &Element)> {
        let generator = self.generator.iter().enumerate().map(|(i, e)| (Side::Generator, i, e));
        generator.chain(self.analyzer.iter().enumerate().map(|(i, e)| (Side::Analyzer, i, e)))
    }

    /// Returns whether a perfect quarter-wave plate is the only retarder of the analyzer.
    pub fn quarter_waves(&self) -> bool {
        let mut retarders = self.analyzer.iter().filter_map(|e| match &e.kind {
            ElementKind::Retarder { retardance, error, .. } => Some((retardance, error)),
            ElementKind::Polarizer { .. } => None,
        });
        let quarter = |d: f64| (d - FRAC_PI_2).abs() < 1e-9;
        let first = retarders.next();
        let perfect = matches!(first, Some((Setting::Fixed(d), SpectralValue::Same(0.0))) if quarter(*d));
        perfect && retarders.next().is_none()
    }

    /// Returns the smallest number of captures that determines a Mueller matrix with this sensor.
    ///
    /// A polarizer array gives three independent numbers per capture, because I(0°) + I(90°) = I(45°) +
    /// I(135°). At least six captures are therefore required. Behind a quarter-wave plate, two of the three
    /// numbers do not depend on the plate's angle, namely s0 and s3 of the incident light. Each further
    /// capture adds a single number, so at least eight captures are required.
    pub fn least_captures(&self) -> usize {
        match self.sensor {
            Sensor::Intensity => 16,
            Sensor::PolarizerArray { .. } if self.quarter_waves() => 8,
            Sensor::PolarizerArray { .. } => 6,
        }
    }

    /// Returns all settings that change between captures, in the order of the elements.
    pub fn motors(&self) -> Vec<Motor> {
        self.elements()
            .flat_map(|(side, element, e)| e.driven().map(move |quantity| Motor { side, element, quantity }))
            .collect()
    }

    pub fn element(&self, motor: Motor) -> &Element {
        match motor.side {
            Side::Generator => &self.generator[motor.element],
            Side::Analyzer => &self.analyzer[motor.element],
        }
    }

    /// Returns all variable settings in radians, sorted by motor and then by capture.
    pub fn parameters(&self) -> Vec<f64> {
        self.motors()
            .into_iter()
            .filter_map(|motor| self.element(motor).setting(motor.quantity))
            .flat_map(|setting| (0..self.captures).map(|k| setting.at(k)))
            .collect()
    }

    /// Returns the scheme with other settings. The settings are in the order of [`Scheme::parameters`].
    ///
    /// # Panics
    /// Panics if the number of parameters is wrong.
    pub fn with_parameters(&self, parameters: &[f64]) -> Self {
        let motors = self.motors();
        assert_eq!(parameters.len(), motors.len() * self.captures, "one number for every setting");
        let mut out = self.clone();
        for (motor, values) in motors.iter().zip(parameters.chunks_exact(self.captures)) {
            let side = match motor.side {
                Side::Generator => &mut out.generator,
                Side::Analyzer => &mut out.analyzer,
            };
            if let Some(setting) = side[motor.element].setting_mut(motor.quantity) {
                *setting = Setting::Each(values.to_vec());
            }
        }
        out
    }

    /// Changes the imperfections of an element and keeps its settings.
    pub fn imperfect(&mut self, side: Side, element: usize, change: impl FnOnce(&mut Element)) {
        let elements = match side {
            Side::Generator => &mut self.generator,
            Side::Analyzer => &mut self.analyzer,
        };
        if let Some(e) = elements.get_mut(element) {
            let mut new = e.clone();
            change(&mut new);
            new.angle.clone_from(&e.angle);
            if let (ElementKind::Retarder { retardance: new, .. }, ElementKind::Retarder { retardance, .. }) =
                (&mut new.kind, &e.kind)
            {
                new.clone_from(retardance);
            }
            *e = new;
        }
    }

    /// Returns the scheme with one element at other angles. There is one angle in radians per capture. If no
    /// element has the name `name`, the scheme does not change.
    ///
    /// # Errors
    /// Returns an error if the number of angles is wrong, or if an angle is not finite.
    pub fn turned(&self, name: &str, angles: &[f64]) -> Result<Self, SchemeError> {
        let same = angles.iter().all(|a| Some(a) == angles.first());
        let (mut generator, mut analyzer) = (self.generator.clone(), self.analyzer.clone());
        for e in generator.iter_mut().chain(&mut analyzer).filter(|e| e.name == name) {
            e.angle = match (&e.angle, angles) {
                (Setting::Fixed(_), [first, ..]) if same => Setting::Fixed(*first),
                _ => Setting::Each(angles.to_vec()),
            };
        }
        let mut out = Self::new(&self.name, generator, analyzer, self.sensor.clone())?;
        (out.source, out.coaxial) = (self.source, self.coaxial.clone());
        Ok(out)
    }

    /// Returns dual rotating retarders (Azzam 1978; Baek & Heide 2021, sec. 4). Retarder 2 is at 5°(k-1),
    /// retarder 3 is at 25°(k-1), and the polarizers are at 0°.
    ///
    /// # Errors
    /// Returns an error if `captures` is 0.
    pub fn drr(captures: usize, array: bool) -> Result<Self, SchemeError> {
        let turning =
            |step: f64| Setting::Each((0..captures).map(|k| (step * k as f64).to_radians()).collect());
        let angles = [Setting::Fixed(0.0), turning(5.0), turning(25.0), Setting::Fixed(0.0)];
        let name = if array { "DRR-P" } else { "DRR" };
        Self::four(&format!("{name} {captures}"), angles, array)
    }

    /// Returns quad rotating polarizers and retarders at angles that are not optimized. The retarders are set
    /// to the same angles as in [`Scheme::drr`]. The polarizers step by the golden angle and by twice the
    /// golden angle, so no two captures are equal. Use the scheme as a starting point for learning instead of
    /// for measurements.
    ///
    /// # Errors
    /// Returns an error if `captures` is 0.
    pub fn qrpr(captures: usize, array: bool) -> Result<Self, SchemeError> {
        const GOLDEN_DEG: f64 = 137.507_764_050_037_85;
        let turning = |step: f64| {
            let angle = |k| (step * k as f64).rem_euclid(180.0).to_radians();
            Setting::Each((0..captures).map(angle).collect())
        };
        let angles = [turning(GOLDEN_DEG), turning(5.0), turning(25.0), turning(2.0 * GOLDEN_DEG)];
        let name = if array { "QRPR-P" } else { "QRPR" };
        Self::four(&format!("{name} {captures}"), angles, array)
    }

    /// Returns the angles of [`Scheme::drr`] with all four elements variable. This scheme is the starting
    /// point of learning (Baek & Heide 2021, sec. 4).
    ///
    /// # Errors
    /// Returns an error if `captures` is 0.
    pub fn quad(captures: usize, array: bool) -> Result<Self, SchemeError> {
        let turning =
            |step: f64| Setting::Each((0..captures).map(|k| (step * k as f64).to_radians()).collect());
        let name = if array { "L-QRPR-P" } else { "L-QRPR" };
        Self::four(&format!("{name} {captures}"), [0.0, 5.0, 25.0, 0.0].map(turning), array)
    }

    /// Returns a scheme of polarizer 1, retarder 2, the scene, retarder 3 and, for an intensity sensor,
    /// polarizer 4. Retarders are quarter-wave plates.
    ///
    /// # Errors
    /// Returns an error if the lists of angles (in radians) differ in length, are empty or contain a
    /// non-finite angle.
    pub fn four(name: &str, angles: [Setting; 4], array: bool) -> Result<Self, SchemeError> {
        let [p1, r2, r3, p4] = angles;
        let quarter = || Setting::Fixed(FRAC_PI_2);
        let generator =
            vec![Element::polarizer("polarizer_1", p1), Element::retarder("retarder_2", r2, quarter())];
        let mut analyzer = vec![Element::retarder("retarder_3", r3, quarter())];
        if array {
            return Self::new(name, generator, analyzer, Sensor::array());
        }
        analyzer.push(Element::polarizer("polarizer_4", p4));
        Self::new(name, generator, analyzer, Sensor::Intensity)
    }

    /// Returns a scheme without moving parts. The generator has a polarizer and liquid-crystal retarders at
    /// 45° and 0°. The analyzer has the same elements in reverse order.
    ///
    /// Generator and analyzer each need two retarders. A single retarder moves the state along one circle of
    /// the Poincaré sphere, which limits the rank to 9. The retardances are fractional parts of multiples of
    /// four irrational numbers, scaled to 0 to 1.1 waves.
    ///
    /// # Errors
    /// Returns an error if `captures` is 0.
    pub fn liquid_crystal(captures: usize, array: bool) -> Result<Self, SchemeError> {
        let run = |x: f64| {
            let delta = |k| (k as f64 * x + 0.1).rem_euclid(1.0) * 1.1 * std::f64::consts::TAU;
            Setting::Each((0..captures).map(delta).collect())
        };
        let cell =
            |name, degrees: f64, x| Element::retarder(name, Setting::Fixed(degrees.to_radians()), run(x));
        let generator = vec![
            Element::polarizer("polarizer_1", Setting::Fixed(0.0)),
            cell("crystal_2", 45.0, 0.414_213_562),
            cell("crystal_3", 0.0, 0.732_050_808),
        ];
        let mut analyzer = vec![
            cell("crystal_4", 0.0, 0.236_067_977),
            Element::retarder("crystal_5", Setting::Fixed(FRAC_PI_4), run(0.645_751_311)),
        ];
        let name = if array { "LC-P" } else { "LC" };
        let name = format!("{name} {captures}");
        if array {
            return Self::new(&name, generator, analyzer, Sensor::array());
        }
        analyzer.push(Element::polarizer("polarizer_6", Setting::Fixed(0.0)));
        Self::new(&name, generator, analyzer, Sensor::Intensity)
    }
}

/// Returns the number of captures, or an error if lists of settings differ in length.
fn captures(generator: &[Element], analyzer: &[Element]) -> Result<usize, SchemeError> {
    let mut all: Option<(usize, &str)> = None;
    for e in generator.iter().chain(analyzer) {
        for quantity in [Quantity::Angle, Quantity::Retardance] {
            let values = match e.setting(quantity) {
                Some(Setting::Each(values)) => values.as_slice(),
                Some(Setting::Fixed(value)) => std::slice::from_ref(value),
                None => continue,
            };
            if let Some(k) = values.iter().position(|v| !v.is_finite()) {
                return Err(SchemeError::NotFinite { name: e.name.clone(), capture: k + 1 });
            }
            if !matches!(e.setting(quantity), Some(Setting::Each(_))) {
                continue;
            }
            match all {
                Some((want, other)) if want != values.len() => {
                    return Err(SchemeError::Lengths {
                        name: e.name.clone(),
                        found: values.len(),
                        other: other.to_owned(),
                        want,
                    });
                }
                _ => all = Some((values.len(), &e.name)),
            }
        }
    }
    match all {
        Some((0, _)) => Err(SchemeError::Empty),
        Some((n, _)) => Ok(n),
        None => Ok(1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_round_trip() {
        for scheme in [Scheme::drr(9, false), Scheme::qrpr(7, true), Scheme::liquid_crystal(5, false)] {
            let scheme = scheme.expect("a scheme");
            let parameters = scheme.parameters();
            assert_eq!(parameters.len(), scheme.motors().len() * scheme.captures());
            assert_eq!(scheme.with_parameters(&parameters), scheme);
            let other: Vec<f64> = parameters.iter().map(|p| p + 0.5).collect();
            assert_eq!(scheme.with_parameters(&other).parameters(), other);
        }
        assert_eq!(Scheme::drr(36, false).expect("a scheme").motors().len(), 2);
        assert_eq!(Scheme::qrpr(36, false).expect("a scheme").motors().len(), 4);
    }

    #[test]
    fn errors_name_the_element() {
        assert_eq!(Scheme::drr(0, false), Err(SchemeError::Empty));
        let four = |a: Setting, b: Setting| {
            Scheme::four("x", [a, b, Setting::Fixed(0.0), Setting::Fixed(0.0)], false)
                .expect_err("a fault")
                .to_string()
        };
        let uneven = four(Setting::Each(vec![0.0; 3]), Setting::Each(vec![0.0; 4]));
        assert!(
            uneven.contains("`retarder_2` has 4 settings") && uneven.contains("`polarizer_1` has 3"),
            "{uneven}"
        );
        let nan = four(Setting::Each(vec![0.0, f64::NAN]), Setting::Fixed(0.0));
        assert!(nan.contains("`polarizer_1` at capture 2"), "{nan}");
        assert!(four(Setting::Fixed(f64::INFINITY), Setting::Fixed(0.0)).contains("polarizer_1"));
    }
}

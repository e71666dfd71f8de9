//! Detectors: what instruments read where the renderer knows the radiance, and what such readings tell of it.
//!
//! > radiance → (shot noise, dark counts, clipping, dead time) → readings → radiance with its variance
//!
//! Both directions are here, so a measurement can be made of a render and then be treated as one of a laboratory:
//! [`cmos`] is a camera (EMVA 1288's linear model), [`polarizer_array`] the mosaic of polarizers on its sensor, and
//! [`spad`] a single-photon avalanche diode with time-correlated counting. Units of radiance are the scene's; one
//! scale, `photons_per_unit`, leads from them to photons.
//!
//! All random numbers come from counter-based streams ([`stream`]), so readings do not depend on threads or order.

pub mod cmos;
pub mod file;
pub mod pile_up;
pub mod polarizer_array;
mod response;
pub mod spad;
mod tcspc;

use super::spectral_value::SpectralValue;
use optics::sampling::stream::Stream;
use rand_distr::{Distribution, Poisson, StandardNormal};

/// Keeps detectors' random numbers apart from the renderer's, which has the same (seed, pixel, sample) keys: noise must
/// not be correlated with the render that it is added to. Any constant does.
const SALT: u64 = 0x6465_7465_6374_6f72;

/// Above this mean, Poisson numbers are drawn as normal ones: their skewness, 1e-5, is then far below any test, and
/// rejection loses accuracy in double precision (rust-random/rand issue 1515).
const NORMAL_ABOVE: f64 = 1e10;

/// Why a detector refused its settings or its data.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DetectorError {
    /// A field has a value that no instrument has.
    #[error("`{field}` is {value}; give {need}")]
    Field {
        /// Name of the field in the configuration.
        field: &'static str,
        /// What it holds.
        value: f64,
        /// What it should hold.
        need: &'static str,
    },
    /// A list of numbers has the wrong length.
    #[error("{found} values were given for {what}; give {expected}")]
    Count {
        /// What the list holds.
        what: &'static str,
        /// Length that is asked for.
        expected: usize,
        /// Length of the list.
        found: usize,
    },
    /// A value of the scene is not finite.
    #[error("radiance {index} is {value}; radiance must be finite")]
    Radiance {
        /// Place in the list, from 0.
        index: usize,
        /// What stands there.
        value: f64,
    },
    /// A simulation would follow more detections than anyone waits for.
    #[error("some {0:.0e} detections would be simulated; give fewer `pulses` or less `photons_per_unit`")]
    Detections(f64),
}

/// What a reading tells of the radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Radiance in the scene's unit, the dark signal subtracted, so it may be negative; NaN if saturated.
    pub radiance: f64,
    /// Variance of `radiance`; infinite where nothing is known.
    pub variance: f64,
    /// True if the reading only bounds the radiance from below.
    pub saturated: bool,
}

impl Estimate {
    /// Says nothing but that there was too much light.
    pub const SATURATED: Self = Self {
        radiance: f64::NAN,
        variance: f64::INFINITY,
        saturated: true,
    };

    /// Says nothing: an instrument that light does not reach.
    pub const UNKNOWN: Self = Self {
        radiance: f64::NAN,
        variance: f64::INFINITY,
        saturated: false,
    };
}

/// Checks an efficiency, the value of configuration field `field`.
fn efficiency(field: &'static str, value: &SpectralValue) -> Result<(), DetectorError> {
    let need = "0 to 1: a number, or rows [nm, value] in rising order of nm";
    demand(field, value.at(550.0), value.check(0.0, 1.0).is_ok(), need)
}

/// The random stream of pixel number `pixel` in capture `key`, apart from all streams of the renderer.
#[must_use]
pub fn stream(seed: u64, pixel: u32, key: u32) -> Stream {
    Stream::new(seed ^ SALT, pixel, key)
}

/// A Poisson number; 0 where the mean is not positive or not a number.
fn poisson(mean: f64, stream: &mut Stream) -> f64 {
    if mean > NORMAL_ABOVE {
        let mean = mean.min(f64::MAX);
        return (mean + mean.sqrt() * normal(stream)).round();
    }
    Poisson::new(mean).map_or(0.0, |p| p.sample(stream))
}

/// A standard normal number.
fn normal(stream: &mut Stream) -> f64 {
    StandardNormal.sample(stream)
}

pub(super) fn demand(
    field: &'static str,
    value: f64,
    holds: bool,
    need: &'static str,
) -> Result<(), DetectorError> {
    if holds {
        return Ok(());
    }
    Err(DetectorError::Field { field, value, need })
}

fn positive(value: f64) -> bool {
    value > 0.0 && value.is_finite()
}

fn non_negative(value: f64) -> bool {
    value >= 0.0 && value.is_finite()
}

fn share(value: f64) -> bool {
    (0.0..=1.0).contains(&value)
}

/// Checks the length of a list.
pub(super) fn count(what: &'static str, expected: usize, found: usize) -> Result<(), DetectorError> {
    if expected == found {
        return Ok(());
    }
    Err(DetectorError::Count {
        what,
        expected,
        found,
    })
}

/// Checks the length of an image; no list is as long as one whose size overflows.
fn area(what: &'static str, width: usize, height: usize, found: usize) -> Result<(), DetectorError> {
    count(what, width.saturating_mul(height), found)
}

/// Checks that all values of radiance are finite.
fn finite(radiance: &[f64]) -> Result<(), DetectorError> {
    match radiance.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(index) => Err(DetectorError::Radiance {
            index,
            value: radiance[index],
        }),
    }
}

#[cfg(test)]
pub(super) mod testing;

#[cfg(test)]
mod tests {
    use super::testing::{Moments, poisson_moments};
    use super::*;

    #[test]
    fn bad_efficiency_is_refused_by_name() {
        assert_eq!(
            efficiency("quantum_efficiency", &SpectralValue::Same(0.5)),
            Ok(())
        );
        let bad = [
            SpectralValue::Same(1.1),
            SpectralValue::Same(f64::NAN),
            SpectralValue::Table(vec![]),
            SpectralValue::Table(vec![[450.0, 0.5], [650.0, -0.1]]),
        ];
        for value in bad {
            let error = efficiency("quantum_efficiency", &value).expect_err("is bad");
            assert!(error.to_string().starts_with("`quantum_efficiency`"), "{error}");
        }
    }

    #[test]
    fn poisson_numbers_have_their_moments() {
        for (key, mean) in [0.3, 9.0, 40.0, 1e6, 3e10].into_iter().enumerate() {
            let mut stream = stream(1, 0, key as u32);
            let seen = Moments::of((0..200_000).map(|_| poisson(mean, &mut stream)));
            poisson_moments(&seen, mean);
        }
        let mut stream = stream(1, 0, 99);
        for mean in [0.0, -1.0, f64::NAN] {
            assert_eq!(poisson(mean, &mut stream), 0.0);
        }
    }
}

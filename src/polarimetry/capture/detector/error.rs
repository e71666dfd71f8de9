//! Errors of detectors for settings and data. This module also contains the checks that report these errors.

use crate::capture::spectral_value::SpectralValue;

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DetectorError {
    #[error("`{field}` is {value}; expected {need}")]
    Field {
        /// Name of the field in the configuration.
        field: &'static str,
        value: f64,
        /// Description of valid values.
        need: &'static str,
    },
    #[error("expected {expected} values for {what}, got {found} values")]
    Count {
        /// Description of the list's entries.
        what: &'static str,
        expected: usize,
        found: usize,
    },
    #[error("radiance {index} is {value}; expected a finite value")]
    Radiance {
        /// Index of the entry in the list, counted from 0.
        index: usize,
        value: f64,
    },
    /// The simulation would have to process too many detections one by one.
    #[error(
        "the simulation would need about {expected:.0e} single detections, but the limit is {most:.0e}; reduce `pulses`, \
         `photons_per_unit` or `dark_counts_per_s`, or increase `dead_time_ps`"
    )]
    Detections {
        /// Upper bound of the expected number of detections.
        expected: f64,
        /// Maximum number of detections that the simulation accepts.
        most: f64,
    },
}

/// Checks an efficiency, the value of configuration field `field`.
pub(super) fn efficiency(field: &'static str, value: &SpectralValue) -> Result<(), DetectorError> {
    let need = "a number from 0 to 1, or rows [nm, value] with increasing nm and values from 0 to 1";
    demand(field, value.at(550.0), value.check(0.0, 1.0).is_ok(), need)
}

/// Checks a value of configuration field `field`.
pub(in crate::capture) fn demand(
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

/// The largest permissible setting. With this limit, products of several settings stay finite.
const LARGEST: f64 = 1e20;

pub(super) fn positive(value: f64) -> bool {
    value > 0.0 && value <= LARGEST
}

pub(super) fn non_negative(value: f64) -> bool {
    (0.0..=LARGEST).contains(&value)
}

pub(super) fn share(value: f64) -> bool {
    (0.0..=1.0).contains(&value)
}

pub(in crate::capture) fn count(
    what: &'static str,
    expected: usize,
    found: usize,
) -> Result<(), DetectorError> {
    if expected == found {
        return Ok(());
    }
    Err(DetectorError::Count { what, expected, found })
}

/// Checks that an image has one value per pixel. On overflow, the expected size saturates at a value that no
/// list can have.
pub(super) fn area(
    what: &'static str,
    width: usize,
    height: usize,
    found: usize,
) -> Result<(), DetectorError> {
    count(what, width.saturating_mul(height), found)
}

pub(super) fn finite(radiance: &[f64]) -> Result<(), DetectorError> {
    match radiance.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(index) => Err(DetectorError::Radiance { index, value: radiance[index] }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_efficiency_is_refused_by_name() {
        assert_eq!(efficiency("quantum_efficiency", &SpectralValue::Same(0.5)), Ok(()));
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
}

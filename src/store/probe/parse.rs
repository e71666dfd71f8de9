//! Parses the arguments of a probe, such as `y=128`, `t=1000:2000`, `stokes_in=s1`, `gaussian:50` and
//! `t,bounces`.

use std::str::FromStr;

use super::request::{CoordRange, Pulse, Selection};
use tensor::axes::AxisKind;

/// An argument that cannot be parsed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{text}`: {reason}")]
pub struct ParseError {
    pub text: String,
    /// Text that describes the fault and the fix.
    pub reason: String,
}

fn fault<T>(text: &str, reason: impl Into<String>) -> Result<T, ParseError> {
    Err(ParseError { text: text.to_owned(), reason: reason.into() })
}

fn axis(text: &str, name: &str) -> Result<AxisKind, ParseError> {
    let known = || AxisKind::ALL.map(AxisKind::name).join(", ");
    AxisKind::from_name(name.trim()).map_or_else(
        || fault(text, format!("unknown axis `{}`; expected one of {}", name.trim(), known())),
        Ok,
    )
}

/// Parses a finite coordinate, or the name of a Stokes element, a component or a set of path labels.
fn coordinate(text: &str, axis: AxisKind, word: &str) -> Result<f64, ParseError> {
    let word = word.trim();
    let labels: &[&str] = match axis {
        AxisKind::StokesOut | AxisKind::StokesIn => &["s0", "s1", "s2", "s3"],
        AxisKind::Component => &["direct", "indirect"],
        _ => &[],
    };
    if let Some(i) = labels.iter().position(|l| *l == word) {
        return Ok(i as f64);
    }
    if axis == AxisKind::Label
        && let Some(set) = tensor::label::parse(word)
    {
        return Ok(f64::from(set));
    }
    match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ if axis.units() == "1" => fault(text, format!("`{word}`: expected a number")),
        _ => fault(text, format!("`{word}`: expected a number in {}", axis.units())),
    }
}

impl FromStr for Selection {
    type Err = ParseError;

    /// Parses `AXIS=VALUE` (nearest entry), `AXIS=FROM:TO`, `AXIS=FROM:` or `AXIS=:TO`, with coordinates in
    /// the unit of the axis.
    fn from_str(text: &str) -> Result<Self, ParseError> {
        let Some((name, value)) = text.split_once('=') else {
            return fault(text, "expected AXIS=VALUE or AXIS=FROM:TO, such as `t=1000:2000`");
        };
        let axis = axis(text, name)?;
        let range = if let Some((from, to)) = value.split_once(':') {
            let end = |word: &str, open: f64| {
                if word.trim().is_empty() { Ok(open) } else { coordinate(text, axis, word) }
            };
            let (from, to) = (end(from, f64::NEG_INFINITY)?, end(to, f64::INFINITY)?);
            if from > to {
                return fault(text, "the range is reversed: write the smaller value first");
            }
            CoordRange::Between(from, to)
        } else {
            CoordRange::Nearest(coordinate(text, axis, value)?)
        };
        Ok(Self { axis, range })
    }
}

impl FromStr for Pulse {
    type Err = ParseError;

    /// Parses `gaussian:FWHM` (in picoseconds) or `samples:A,B,C` (at the bin spacing).
    fn from_str(text: &str) -> Result<Self, ParseError> {
        let expected = "expected `gaussian:FWHM_PS` or `samples:A,B,C`";
        match text.split_once(':') {
            Some(("gaussian", width)) => match width.trim().parse::<f64>() {
                Ok(fwhm_ps) if fwhm_ps.is_finite() && fwhm_ps >= 0.0 => Ok(Self::Gaussian { fwhm_ps }),
                _ => fault(text, "the width must be a number of picoseconds, 0 or more"),
            },
            Some(("samples", list)) => {
                let samples: Result<Vec<f64>, _> = list.split(',').map(|w| w.trim().parse::<f64>()).collect();
                match samples {
                    Ok(samples) if samples.iter().all(|s| s.is_finite()) => Ok(Self::Samples(samples)),
                    _ => fault(text, "the samples must be numbers separated by commas"),
                }
            }
            _ => fault(text, expected),
        }
    }
}

/// Parses axes separated by commas, such as `t,bounces`.
///
/// # Errors
/// Returns an error if a word is not the name of an axis.
pub fn parse_axes(text: &str) -> Result<Vec<AxisKind>, ParseError> {
    text.split(',').map(|name| axis(text, name)).collect()
}

/// Parses a Stokes vector. The text is four numbers `s0,s1,s2,s3`, or the name of a state with s0 = 1:
/// `unpolarized`, `horizontal`, `vertical`, `plus45`, `minus45`, `right` or `left`.
///
/// # Errors
/// Returns an error if the text has neither form.
pub fn parse_stokes(text: &str) -> Result<[f32; 4], ParseError> {
    let named = match text.trim() {
        "unpolarized" => Some([1.0, 0.0, 0.0, 0.0]),
        "horizontal" => Some([1.0, 1.0, 0.0, 0.0]),
        "vertical" => Some([1.0, -1.0, 0.0, 0.0]),
        "plus45" => Some([1.0, 0.0, 1.0, 0.0]),
        "minus45" => Some([1.0, 0.0, -1.0, 0.0]),
        "right" => Some([1.0, 0.0, 0.0, 1.0]),
        "left" => Some([1.0, 0.0, 0.0, -1.0]),
        _ => None,
    };
    if let Some(stokes) = named {
        return Ok(stokes);
    }
    let numbers: Vec<f32> =
        text.split(',').filter_map(|w| w.trim().parse::<f32>().ok().filter(|n| n.is_finite())).collect();
    match <[f32; 4]>::try_from(numbers) {
        Ok(stokes) if text.split(',').count() == 4 => physical(text, stokes),
        _ => fault(text, "expected four numbers `s0,s1,s2,s3`, or a name such as `horizontal`"),
    }
}

/// Checks that a Stokes vector is physical: positive intensity, and a degree of polarization of at most 1.
fn physical(text: &str, stokes: [f32; 4]) -> Result<[f32; 4], ParseError> {
    let [s0, s1, s2, s3] = stokes.map(f64::from);
    let polarized = (s1 * s1 + s2 * s2 + s3 * s3).sqrt();
    // The tolerance allows for rounding of the numbers in the text.
    if s0 > 0.0 && polarized <= s0 * (1.0 + 1e-4) {
        return Ok(stokes);
    }
    fault(text, "not a physical Stokes vector: s0 must be above 0, and s1² + s2² + s3² at most s0²")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn selections_and_pulses_are_parsed() {
        let parse = |t: &str| t.parse::<Selection>();
        assert_eq!(parse("y=128").unwrap(), Selection::nearest(AxisKind::Y, 128.0));
        assert_eq!(parse("t=1000:2e3").unwrap().range, CoordRange::Between(1000.0, 2000.0));
        assert_eq!(parse("t=:5").unwrap().range, CoordRange::Between(f64::NEG_INFINITY, 5.0));
        assert_eq!(parse("stokes_in=s2").unwrap(), Selection::nearest(AxisKind::StokesIn, 2.0));
        assert_eq!(parse("component = indirect").unwrap(), Selection::nearest(AxisKind::Component, 1.0));
        for bad in ["", "y", "y=", "z=1", "t=2:1", "t=nan", "t=inf", "t=1:2:3", "=", "y=1,2"] {
            assert!(parse(bad).is_err(), "{bad}");
        }
        assert_eq!("gaussian:50".parse(), Ok(Pulse::Gaussian { fwhm_ps: 50.0 }));
        assert_eq!("samples:1, 2".parse(), Ok(Pulse::Samples(vec![1.0, 2.0])));
        assert!("gaussian:-1".parse::<Pulse>().is_err() && "samples:".parse::<Pulse>().is_err());
        assert_eq!(parse_axes("t, bounces").unwrap(), [AxisKind::T, AxisKind::Bounces]);
        assert_eq!(parse_stokes("right").unwrap(), [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(parse_stokes("1,.5,0,-0.25").unwrap(), [1.0, 0.5, 0.0, -0.25]);
        assert!(parse_stokes("0,0,0,0").is_err() && parse_stokes("1,1,1,0").is_err());
        assert!(parse_stokes("-1,0,0,0").is_err() && parse_stokes("1,.7071068,-.7071068,0").is_ok());
        assert!(parse_stokes("1,2,3").is_err() && parse_stokes("1,x,2,3,4").is_err());
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in ".{0,24}", words in "[a-z_]{0,10}[=:,][-0-9.:e,]{0,12}") {
            for t in [&text, &words] {
                let _ = t.parse::<Selection>();
                let _ = t.parse::<Pulse>();
                let _ = parse_axes(t);
                let _ = parse_stokes(t);
            }
        }
    }
}

//! Lengths on the command line: `25mm`, `2.5cm`, `0.025m`. A number without a unit is in metres.

use std::str::FromStr;

/// Names of units with their lengths in metres. A name that ends with another name (`mm` ends with `m`) comes
/// before the shorter name.
const UNITS: [(&str, f64); 7] =
    [("nm", 1e-9), ("um", 1e-6), ("µm", 1e-6), ("μm", 1e-6), ("mm", 1e-3), ("cm", 1e-2), ("m", 1.0)];

/// A positive length from the command line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Length {
    /// The length in metres.
    pub metres: f64,
    /// Whether the length was given with a unit.
    pub has_unit: bool,
}

impl FromStr for Length {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let unit = UNITS.iter().find_map(|(unit, scale)| Some((text.strip_suffix(unit)?, *scale)));
        let (number, scale) = unit.unwrap_or((text, 1.0));
        let metres = number.trim().parse::<f64>().ok().map(|x| x * scale);
        metres
            .filter(|x| x.is_finite() && *x > 0.0)
            .map(|metres| Self { metres, has_unit: unit.is_some() })
            .ok_or_else(|| "expected a positive length with its unit, such as 25mm, 2.5cm or 0.025m".into())
    }
}

impl Length {
    /// Returns the length in metres if it has a unit or is at most `limit` metres.
    ///
    /// # Errors
    /// Returns a message about the length `what` if the length has no unit and exceeds `limit`. Such a length
    /// may be in millimetres.
    pub fn within(self, limit: f64, what: &str) -> Result<f64, String> {
        if self.has_unit || self.metres <= limit {
            return Ok(self.metres);
        }
        let x = self.metres;
        Err(format!(
            "{what} {x}: a number without a unit is in metres, and {x} m is above the limit of {limit} m; write {x}mm or {x}m"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::Length;

    #[test]
    fn lengths_have_units() {
        let cases = [
            ("25mm", 0.025, true),
            ("0.5 m", 0.5, true),
            ("3cm", 0.03, true),
            ("3.45um", 3.45e-6, true),
            ("3.45µm", 3.45e-6, true),
            ("550nm", 550e-9, true),
            (" 2e-2 ", 0.02, false),
            ("25", 25.0, false),
        ];
        for (text, metres, has_unit) in cases {
            let found: Length = text.parse().unwrap();
            assert!((found.metres - metres).abs() < 1e-12 * metres, "{text}: {found:?}");
            assert_eq!(found.has_unit, has_unit, "{text}");
        }
        for text in ["-1mm", "mm", "nanm", "", "0", "inf", "25in", "25 MM", "1,5mm", "25mm2", "m25"] {
            assert!(text.parse::<Length>().is_err(), "{text}");
        }
    }

    #[test]
    fn long_lengths_need_a_unit() {
        let within = |text: &str| text.parse::<Length>().unwrap().within(0.5, "--square");
        assert_eq!(within("0.5"), Ok(0.5));
        assert_eq!(within("25m"), Ok(25.0));
        let message = within("25").unwrap_err();
        assert!(message.starts_with("--square 25:") && message.ends_with("write 25mm or 25m"), "{message}");
    }
}

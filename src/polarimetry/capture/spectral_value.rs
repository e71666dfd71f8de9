//! A number that may depend on the wavelength. The number is given as one value or as an interpolated table.

use serde::{Deserialize, Serialize};

/// One value for all wavelengths, or a table of rows [nanometres, value] in ascending order. Values are
/// interpolated linearly between rows, and are constant outside the table.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(untagged)]
pub enum SpectralValue {
    /// The same value at all wavelengths.
    Same(f64),
    /// Rows of [nanometres, value].
    Table(Vec<[f64; 2]>),
}

impl SpectralValue {
    /// Returns the value at a wavelength in nanometres, or 0 for an empty table.
    pub fn at(&self, nm: f64) -> f64 {
        match self {
            Self::Same(value) => *value,
            Self::Table(rows) => {
                let after = rows.partition_point(|row| row[0] < nm);
                match (after.checked_sub(1).and_then(|i| rows.get(i)), rows.get(after)) {
                    (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (nm - a[0]) / (b[0] - a[0]),
                    (Some(only), None) | (None, Some(only)) => only[1],
                    (None, None) => 0.0,
                }
            }
        }
    }

    /// Returns the same table with all values multiplied by a factor.
    pub fn scaled(&self, factor: f64) -> Self {
        match self {
            Self::Same(value) => Self::Same(value * factor),
            Self::Table(rows) => Self::Table(rows.iter().map(|[nm, v]| [*nm, v * factor]).collect()),
        }
    }

    /// Checks that values are within `low..=high`, that wavelengths ascend and that the table has rows.
    ///
    /// # Errors
    /// Returns the text of the fault if a check fails. In a message, the text follows the name of the field.
    pub fn check(&self, low: f64, high: f64) -> Result<(), String> {
        let inside = |v: f64| (low..=high).contains(&v);
        let outside = match self {
            Self::Same(value) => Some(*value).filter(|v| !inside(*v)),
            Self::Table(rows) => {
                let rising = rows.windows(2).all(|w| w[0][0] < w[1][0]);
                if rows.is_empty() || !rising || rows.iter().any(|row| !(row[0] > 0.0 && row[0] <= 1e6)) {
                    return Err("must have rows [nm, value] with positive, increasing nm".to_owned());
                }
                rows.iter().map(|row| row[1]).find(|v| !inside(*v))
            }
        };
        outside.map_or(Ok(()), |v| Err(format!("must be from {low} to {high}, got {v}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_linear_between_rows_and_constant_beyond() {
        let t = SpectralValue::Table(vec![[450.0, 1.0], [550.0, 2.0], [650.0, 0.0]]);
        for (nm, want) in [(400.0, 1.0), (450.0, 1.0), (500.0, 1.5), (550.0, 2.0), (600.0, 1.0), (700.0, 0.0)]
        {
            assert!((t.at(nm) - want).abs() < 1e-12);
        }
        assert!((t.scaled(2.0).at(500.0) - 3.0).abs() < 1e-12);
        assert!(t.check(0.0, 2.0).is_ok() && t.check(0.0, 1.0).is_err());
        for bad in [vec![], vec![[2.0, 0.0], [1.0, 0.0]], vec![[f64::NAN, 0.0]]] {
            assert!(SpectralValue::Table(bad).check(0.0, 1.0).is_err());
        }
        assert!(SpectralValue::Same(f64::NAN).check(0.0, 1.0).is_err());
    }
}

//! Simulates captures under patterns of projector columns, from T(s, u), the light from projector column u to
//! camera pixel s.
//!
//! Light is linear in the drive. If a pattern P is equal in all rows, the capture is therefore I(s) = Σ_u
//! T(s, u) P(u). T(s, u) is a sum over all projector rows. For epipolar structured light, the sum is
//! restricted to the rows near the epipolar line of s (O'Toole et al. 2012, 2014).

use crate::map::Map;
use thiserror::Error;

/// The light from every projector column to every camera pixel, as radiance per unit drive.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnLight {
    /// One channel for each projector column.
    pub light: Map,
}

/// Patterns that are constant along columns. Each capture has a list of drives in 0..1.
#[derive(Clone, Debug, PartialEq)]
pub struct Patterns {
    pub columns: usize,
    /// Drive of every column, for each capture.
    pub drives: Vec<Vec<f64>>,
}

impl Patterns {
    /// Returns patterns from a function of capture and column.
    pub fn from_fn(captures: usize, columns: usize, drive: impl Fn(usize, usize) -> f64) -> Self {
        let drives = (0..captures).map(|k| (0..columns).map(|u| drive(k, u)).collect());
        Self { columns, drives: drives.collect() }
    }
}

/// The reason why captures cannot be simulated or decoded.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum CodeError {
    /// The light and the patterns have different numbers of columns.
    #[error(
        "the light has {light} projector columns, but the patterns have {patterns} columns; use the same projector for both"
    )]
    Columns {
        /// Number of columns of the light.
        light: usize,
        /// Number of columns of the patterns.
        patterns: usize,
    },
    /// The number of captures does not match the code.
    #[error("got {got} captures, but the code has {want} patterns; capture every pattern once")]
    Captures {
        /// Number of captures given.
        got: usize,
        /// Number of captures that the code requires.
        want: usize,
    },
    /// The periods are invalid for the code.
    #[error("{0}")]
    Periods(String),
}

impl ColumnLight {
    /// Returns the light of a coarser projector. Each column of the coarser projector combines `n` columns,
    /// and the last column may combine fewer columns. In any scene, stripes that are narrower than a camera
    /// pixel's footprint lose contrast. Codes therefore need columns that are about as wide as camera pixels.
    pub fn binned(&self, n: usize) -> Self {
        let (light, n) = (&self.light, n.max(1));
        let columns = light.channels.div_ceil(n);
        Self {
            light: Map::from_fn(light.width, light.height, columns, |x, y, out| {
                for (out, columns) in out.iter_mut().zip(light.at(x, y).chunks(n)) {
                    *out = columns.iter().sum();
                }
            }),
        }
    }

    /// Returns the captures under the given patterns, one capture per channel.
    ///
    /// # Errors
    /// Returns an error if the patterns and the light have different numbers of columns.
    pub fn capture(&self, patterns: &Patterns) -> Result<Map, CodeError> {
        let (light, columns) = (&self.light, patterns.columns);
        if light.channels != columns || patterns.drives.iter().any(|d| d.len() != columns) {
            return Err(CodeError::Columns { light: light.channels, patterns: columns });
        }
        Ok(Map::from_fn(light.width, light.height, patterns.drives.len(), |x, y, out| {
            let t = light.at(x, y);
            for (out, drive) in out.iter_mut().zip(&patterns.drives) {
                *out = t.iter().zip(drive).map(|(t, p)| t * p).sum();
            }
        }))
    }
}

/// The decoded columns of all camera pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// Projector column coordinate in one channel. The centre of column i is at i + ½. The coordinate is NaN
    /// where the code is invalid.
    pub column: Map,
    /// Contrast of the code in one channel, from 0 (no contrast) to 1 (direct light only).
    pub confidence: Map,
}

impl Decoded {
    /// Decodes each pixel with a function that returns column and confidence from the captures.
    pub(super) fn by_pixel(
        captures: &Map,
        want: usize,
        decode: impl Fn(&[f64]) -> (f64, f64),
    ) -> Result<Self, CodeError> {
        if captures.channels != want {
            return Err(CodeError::Captures { got: captures.channels, want });
        }
        let mut confidence = Map::from_fn(captures.width, captures.height, 1, |_, _, _| {});
        let column = Map::from_fn(captures.width, captures.height, 1, |x, y, out| {
            let (column, clear) = decode(captures.at(x, y));
            out[0] = column;
            confidence.data[y * captures.width + x] = clear;
        });
        Ok(Self { column, confidence })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn captures_are_sums_and_size_mismatches_are_refused() {
        let light = ColumnLight {
            light: Map::from_fn(2, 1, 3, |x, _, out| out.copy_from_slice(&[1.0, 2.0, x as f64])),
        };
        let patterns = Patterns::from_fn(2, 3, |k, u| if k == 0 { 1.0 } else { u as f64 / 2.0 });
        let captures = light.capture(&patterns).expect("of three columns");
        assert_eq!(captures.at(0, 0), [3.0, 1.0]);
        assert_eq!(captures.at(1, 0), [4.0, 2.0]);
        assert_eq!(light.binned(2).light.data, [3.0, 0.0, 3.0, 1.0]);
        assert_eq!(light.binned(0), light);
        let other = Patterns::from_fn(1, 4, |_, _| 0.0);
        assert_eq!(light.capture(&other), Err(CodeError::Columns { light: 3, patterns: 4 }));
        let decoded = Decoded::by_pixel(&captures, 5, |_| (0.0, 0.0));
        assert_eq!(decoded, Err(CodeError::Captures { got: 2, want: 5 }));
    }
}

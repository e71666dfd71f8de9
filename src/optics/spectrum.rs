//! Spectral values: up to four wavelengths in the lanes of one SIMD register.
//!
//! Every spectral quantity (albedo, Mueller element, irradiance) is a [`Spectral`]. Lane `i` belongs to
//! wavelength `i` of the scene's [`Wavelengths`]. Unused lanes are zero.

use serde::{Deserialize, Serialize};

/// Values per wavelength lane. Lanes beyond the number of the scene's wavelengths are zero.
pub type Spectral = wide::f32x4;

/// Maximum number of wavelengths of a render.
pub const MAX_WAVELENGTHS: usize = 4;

/// The 1 to 4 vacuum wavelengths of a render, in nanometres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Wavelengths(Vec<f64>);

impl Default for Wavelengths {
    /// Returns the default wavelengths 450, 550 and 660 nm.
    fn default() -> Self {
        Self(vec![450.0, 550.0, 660.0])
    }
}

/// Reasons why a wavelength list is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WavelengthError {
    /// The list is empty or longer than [`MAX_WAVELENGTHS`].
    #[error("expected 1 to 4 wavelengths, got {0}")]
    Count(usize),
    #[error("wavelength {0} nm is outside the range 100 to 100000 nm")]
    Range(f64),
    #[error("wavelengths must be strictly increasing, but {0} nm is followed by {1} nm")]
    Order(f64, f64),
}

impl Wavelengths {
    /// Creates the wavelengths from a list of vacuum wavelengths in nanometres, after checking the list.
    ///
    /// # Errors
    /// Returns [`WavelengthError`] if the count is not 1 to 4, a value is out of range, or the order is not
    /// ascending.
    pub fn new(nm: Vec<f64>) -> Result<Self, WavelengthError> {
        if nm.is_empty() || nm.len() > MAX_WAVELENGTHS {
            return Err(WavelengthError::Count(nm.len()));
        }
        if let Some(&bad) = nm.iter().find(|w| !(100.0..=100_000.0).contains(*w)) {
            return Err(WavelengthError::Range(bad));
        }
        if let Some(w) = nm.windows(2).find(|w| w[0] >= w[1]) {
            return Err(WavelengthError::Order(w[0], w[1]));
        }
        Ok(Self(nm))
    }

    /// Returns the number of wavelengths (1 to 4).
    #[inline]
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// Returns the wavelengths in nanometres, ascending.
    #[inline]
    pub fn nm(&self) -> &[f64] {
        &self.0
    }

    /// Returns `f(nm)` in each used lane and zero in the others.
    pub fn map(&self, f: impl Fn(f64) -> f32) -> Spectral {
        let mut lanes = [0.0; MAX_WAVELENGTHS];
        for (lane, &nm) in lanes.iter_mut().zip(&self.0) {
            *lane = f(nm);
        }
        Spectral::new(lanes)
    }

    /// Returns 1 in every used lane and 0 in the others.
    #[inline]
    pub fn ones(&self) -> Spectral {
        self.map(|_| 1.0)
    }
}

#[inline]
pub fn max_lane(s: Spectral) -> f32 {
    let a = s.to_array();
    a[0].max(a[1]).max(a[2].max(a[3]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wavelength_lists_are_validated() {
        assert_eq!(Wavelengths::new(vec![]), Err(WavelengthError::Count(0)));
        assert_eq!(Wavelengths::new(vec![1.0]), Err(WavelengthError::Range(1.0)));
        assert!(Wavelengths::new(vec![550.0, 450.0]).is_err());
        assert!(Wavelengths::new(vec![f64::NAN]).is_err());
        let w = Wavelengths::new(vec![450.0, 550.0, 660.0]).unwrap();
        assert_eq!(w.ones().to_array(), [1.0, 1.0, 1.0, 0.0]);
    }
}

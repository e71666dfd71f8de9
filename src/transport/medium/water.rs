//! Optical constants of water, the host of milk and of most suspensions.
//!
//! The refractive index is that of Daimon & Masumura 2007 at 20 °C. The absorption is that of Pope & Fry
//! (1997, Appl. Opt. 36, 8710) from 380 to 700 nm, and that of Hale & Querry (1973, Appl. Opt. 12, 555) above
//! 700 nm. The refractive index and the absorption are interpolated linearly.

use crate::material::constants::{ConstantsError, lookup};
use std::f64::consts::PI;

/// Absorption coefficients of Pope & Fry, 1/m, every 5 nm from 380 to 700 nm.
#[rustfmt::skip]
const VISIBLE: [f64; 65] = [
    0.01137, 0.00941, 0.00851, 0.00813, 0.00663, 0.0053, 0.00473, 0.00444, 0.00454, 0.00478, 0.00495, 0.0053, 0.00635,
    0.00751, 0.00922, 0.00962, 0.00979, 0.01011, 0.0106, 0.0114, 0.0127, 0.0136, 0.015, 0.0173, 0.0204, 0.0256,
    0.0325, 0.0396, 0.0409, 0.0417, 0.0434, 0.0452, 0.0474, 0.0511, 0.0565, 0.0596, 0.0619, 0.0642, 0.0695,
    0.0772, 0.0896, 0.11, 0.1351, 0.1672, 0.2224, 0.2577, 0.2644, 0.2678, 0.2755, 0.2834, 0.2916, 0.3012,
    0.3108, 0.325, 0.34, 0.371, 0.41, 0.429, 0.439, 0.448, 0.465, 0.486, 0.516, 0.559, 0.624,
];

/// Extinction coefficients k of Hale & Querry, every 25 nm from 725 to 1000 nm.
const INFRARED: [f64; 12] = [
    9.15e-8, 1.56e-7, 1.48e-7, 1.25e-7, 1.82e-7, 2.93e-7, 3.91e-7, 4.86e-7, 1.06e-6, 2.93e-6, 3.48e-6,
    2.89e-6,
];

/// Interpolates linearly in a table for the arguments `first`, `first + step` and so on. Arguments outside
/// the table are clamped.
pub(super) fn even_table(values: &[f64], first: f64, step: f64, at: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else {
        return 0.0;
    };
    let place = ((at - first) / step).clamp(0.0, last as f64);
    let i = (place as usize).min(last.saturating_sub(1));
    let next = values[(i + 1).min(last)];
    values[i] + (next - values[i]) * (place - i as f64)
}

/// Returns the absorption coefficient 4πk/λ, 1/m, for extinction coefficient `k` at the vacuum wavelength
/// `nm` (nanometres).
pub fn of_extinction(k: f64, nm: f64) -> f64 {
    4.0 * PI * k / (nm * 1e-9)
}

/// Returns the absorption coefficient of pure water, 1/m, at the vacuum wavelength `nm` (nanometres). The
/// wavelength is clamped to 380 to 1000 nm.
pub fn absorption(nm: f64) -> f64 {
    let infrared = |nm: f64| of_extinction(even_table(&INFRARED, 725.0, 25.0, nm), nm);
    match nm {
        nm if nm <= 700.0 => even_table(&VISIBLE, 380.0, 5.0, nm),
        nm if nm < 725.0 => {
            let t = (nm - 700.0) / 25.0;
            VISIBLE[64] * (1.0 - t) + infrared(725.0) * t
        }
        nm => infrared(nm.min(1000.0)),
    }
}

/// Returns the refractive index of water at 20 °C and the vacuum wavelength `nm` (nanometres).
///
/// # Errors
/// Returns a [`ConstantsError`] if the wavelength is outside 380 to 1000 nm.
pub fn index(nm: f64) -> Result<f64, ConstantsError> {
    Ok(lookup("water", nm)?.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absorption_matches_published_values() {
        // Test table entries, a midpoint, the transition between the tables, and 4πk/λ above the transition.
        for (nm, want) in [
            (380.0, 0.01137),
            (450.0, 0.00922),
            (550.0, 0.0565),
            (660.0, 0.41),
            (700.0, 0.624),
            (552.5, 0.058_05),
            (725.0, 1.585_963),
            (712.5, 1.104_981),
            (900.0, 6.785_840),
            (1000.0, 36.316_81),
            (300.0, 0.01137),
        ] {
            let got = absorption(nm);
            assert!((got / want - 1.0).abs() < 1e-6, "at {nm} nm: found {got}, expected {want}");
        }
        assert!((index(550.0).expect("in range") - 1.33468).abs() < 1e-9);
        assert!(index(1e6).is_err());
    }
}

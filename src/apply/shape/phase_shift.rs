//! Phase shifting with temporal unwrapping (Srinivasan et al. 1984; Huntley & Saldner 1993). The patterns are
//! sinusoids of decreasing period, each with four phase shifts of 90°.
//!
//! Captures of period P are I_k = O + A cos(φ - kπ/2), φ = 2πu/P. Hence tan φ = (I_1 - I_3)/(I_0 - I_2),
//! independent of O. The longest period spans the image and needs no unwrapping. For each shorter period, the
//! number of whole periods is determined from the previous period.
//!
//! The phasor of indirect light g(u') is added to the phasor of the direct light, A e^{iφ} = d e^{2πiu/P} + Σ
//! g(u') e^{2πiu'/P}. The phase error is the angle between the sum and the phasor of the direct light. The
//! phase error is largest for long periods, because blur does not attenuate waves of long periods.

use super::column_light::{CodeError, Decoded, Patterns};
use crate::map::Map;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Number of captures per period.
const STEPS: usize = 4;

/// Returns the periods in projector columns. The first period is the width of the projector image. Each
/// further period is a quarter of the previous period, but at least 8 columns. The last period is at most 16
/// columns.
pub fn periods(columns: usize) -> Vec<f64> {
    let mut all = vec![columns as f64];
    while all.last().is_some_and(|p| *p > 16.0) {
        let next = all[all.len() - 1] / 4.0;
        all.push(next.max(8.0));
    }
    all
}

/// Checks that the periods are valid for the number of columns.
fn check(periods: &[f64], columns: usize) -> Result<(), CodeError> {
    let falls = periods.windows(2).all(|p| p[0] > p[1]) && periods.iter().all(|p| *p >= 2.0);
    let spans = periods.first().is_some_and(|p| *p >= columns as f64 && p.is_finite());
    if falls && spans {
        return Ok(());
    }
    Err(CodeError::Periods(format!(
        "periods {periods:?}: expected decreasing periods, the first at least {columns} columns and the last at least 2"
    )))
}

/// Returns the drive of column `u` by a sinusoid of period `period`, with the phase delay `phase`.
pub(super) fn sinusoid(u: usize, period: f64, phase: f64) -> f64 {
    0.5 + 0.5 * (TAU * (u as f64 + 0.5) / period - phase).cos()
}

/// Returns the coordinate closest to `near` at which a sinusoid of period `period` has the phase `phase`.
pub(super) fn unwrap(phase: f64, period: f64, near: f64) -> f64 {
    let turn = phase / TAU;
    period * (turn + (near / period - turn).round())
}

/// Returns the patterns in the order of the periods, with four patterns per period.
pub fn patterns(columns: usize, periods: &[f64]) -> Patterns {
    Patterns::from_fn(STEPS * periods.len(), columns, |k, u| {
        sinusoid(u, periods[k / STEPS], (k % STEPS) as f64 * FRAC_PI_2)
    })
}

/// Decodes captures of [`patterns`]. A pixel has no column if the contrast of its shortest period is below
/// `least_contrast`.
///
/// # Errors
/// Returns an error if the number of captures does not match the patterns. Also returns an error if the first
/// period is shorter than the image's width, if a period is shorter than 2 columns, or if the periods do not
/// decrease.
pub fn decode(
    captures: &Map,
    columns: usize,
    periods: &[f64],
    least_contrast: f64,
) -> Result<Decoded, CodeError> {
    check(periods, columns)?;
    Decoded::by_pixel(captures, STEPS * periods.len(), |pixel| {
        let (mut column, mut contrast) = (f64::NAN, 0.0);
        for (i, (k, period)) in pixel.chunks_exact(STEPS).zip(periods).enumerate() {
            let (sin, cos) = (k[1] - k[3], k[0] - k[2]);
            let phase = sin.atan2(cos);
            column =
                if i == 0 { phase.rem_euclid(TAU) / TAU * period } else { unwrap(phase, *period, column) };
            let total: f64 = k.iter().sum();
            contrast = if total > 0.0 { 2.0 * sin.hypot(cos) / total } else { 0.0 };
        }
        let inside = (0.0..=columns as f64).contains(&column);
        let sure = contrast > 0.0 && contrast >= least_contrast;
        (if inside && sure { column } else { f64::NAN }, contrast)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::synthetic::{Light, noisy, one_row};

    fn columns_of(light: &Light, n: usize, periods: &[f64]) -> Vec<f64> {
        let captures = one_row(n, light).capture(&patterns(n, periods)).expect("captures");
        decode(&captures, n, periods, 0.0).expect("a code").column.data
    }

    #[test]
    fn direct_light_is_decoded_exactly_and_has_contrast_one() {
        let n = 256;
        let p = periods(n);
        assert_eq!(p, [256.0, 64.0, 16.0]);
        let captures = one_row(n, &Light::direct(0.3)).capture(&patterns(n, &p)).expect("captures");
        let got = decode(&captures, n, &p, 0.0).expect("a code");
        for (i, column) in got.column.data.iter().enumerate() {
            assert!((column - i as f64 - 0.5).abs() < 1e-9, "{i}: {column}");
            assert!((got.confidence.data[i] - 1.0).abs() < 1e-9);
        }
    }

    /// A point receives the fractions 1 - a and a of its light from two neighbouring columns. The error of
    /// the decoded coordinate is then below (2π/P)² a(1 - a)(1 - 2a)/6 columns.
    #[test]
    fn between_columns_it_is_exact_to_third_order() {
        let (n, period) = (256, 16.0);
        for a in [0.1, 0.3, 0.5, 0.8] {
            let light = Light::direct(1.0 - a).plus_at(a, |c, n| (c + 1).min(n - 1));
            let got = columns_of(&light, n, &[256.0, 64.0, period]);
            for (i, column) in got.iter().enumerate().take(n - 1) {
                let theory = (TAU / period).powi(2) * (a * (1.0 - a) * (1.0 - 2.0 * a)).abs() / 6.0;
                let off = (column - i as f64 - 0.5 - a).abs();
                assert!(off < 1.05 * theory + 1e-9, "{a}: {off} against {theory}");
            }
        }
    }

    /// The bias due to smooth indirect light is the phase angle of the sum of phasors, which is nearly
    /// zero for a short period.
    #[test]
    fn smooth_indirect_light_biases_by_the_sum_of_phasors() {
        let (n, sigma, shift, g) = (1024, 20.0, 30.0, 0.8);
        let light = Light::direct(1.0).plus_blurred(g, sigma, shift);
        let bias = |period: f64| {
            let w = TAU / period;
            let fade = g * (-0.5 * (w * sigma).powi(2)).exp();
            (fade * (w * shift).sin()).atan2(1.0 + fade * (w * shift).cos()) / w
        };
        let long = columns_of(&light, n, &[1024.0]);
        for (i, column) in long.iter().enumerate().take(850).skip(150) {
            let off = column - i as f64 - 0.5;
            assert!((off - bias(1024.0)).abs() < 1e-3, "{i}: {off}");
        }
        assert!(bias(1024.0) > 10.0, "the case is one");
        let short = columns_of(&light, n, &[1024.0, 256.0, 64.0, 16.0]);
        for (i, column) in short.iter().enumerate().take(850).skip(150) {
            assert!((column - i as f64 - 0.5).abs() < 1e-6, "{i}: {column}");
        }
        assert!(bias(16.0).abs() < 1e-9);
    }

    /// The indirect light is as bright as the direct light and comes from 80 columns away. The column
    /// computed from the period of 256 columns is then biased by 36 columns. This bias exceeds half of the
    /// next period of 64 columns, so the number of whole periods of 64 columns is wrong. All columns are
    /// wrong by exactly 64.
    #[test]
    fn biased_long_periods_unwrap_incorrectly() {
        let n = 1024;
        let light = Light::direct(1.0).plus_blurred(1.0, 20.0, 80.0);
        let got = columns_of(&light, n, &[1024.0, 256.0, 64.0, 16.0]);
        for (i, column) in got.iter().enumerate().take(800).skip(150) {
            assert!((column - i as f64 - 64.5).abs() < 1e-6, "{i}: {column}");
        }
    }

    /// White noise with standard deviation σ causes an RMS column error of P/(2π)·σ√2/(A·2), where A is half
    /// the light. The test uses 500 × 256 pixels and a tolerance of five standard errors of the RMS.
    #[test]
    fn column_noise_matches_theory() {
        let (n, p, sigma) = (256, vec![256.0, 64.0, 16.0], 0.005);
        let clean = one_row(n, &Light::direct(1.0)).capture(&patterns(n, &p)).expect("captures");
        let (mut sum, mut count) = (0.0, 0.0);
        for seed in 0..500 {
            let got = decode(&noisy(&clean, sigma, seed), n, &p, 0.0).expect("a code");
            for (i, column) in got.column.data.iter().enumerate().take(n - 4).skip(4) {
                sum += (column - i as f64 - 0.5).powi(2);
                count += 1.0;
            }
        }
        let (variance, theory) = (sum / count, (16.0 / TAU * sigma * 2.0_f64.sqrt()).powi(2));
        let error = theory * (2.0_f64 / count).sqrt();
        assert!((variance - theory).abs() < 5.0 * error + 0.002 * theory, "{variance} {theory}");
    }

    #[test]
    fn periods_that_decode_nothing_are_refused() {
        let captures = Map::from_fn(1, 1, 4, |_, _, o| o.fill(1.0));
        for bad in [vec![], vec![8.0], vec![64.0, 64.0], vec![f64::NAN], vec![64.0, 1.0]] {
            assert!(decode(&captures, 64, &bad, 0.0).is_err(), "{bad:?}");
        }
    }
}

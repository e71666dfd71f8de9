//! Micro phase shifting (Gupta & Nayar 2012). The patterns are sinusoids of a few short, nearly equal
//! periods. Slowly varying indirect light and defocus therefore have the same effect in all captures.
//!
//! With F periods there are F + 2 captures. The first period has three captures, I_k = O + A cos(φ_1 -
//! 2πk/3). Each other period has one capture, I_f = O + A cos φ_f. Offset O and amplitude A are common to all
//! captures because the periods are close. The F + 1 numbers cos φ_1, sin φ_1, cos φ_2 … cos φ_F form the
//! code vector. A pixel is assigned the column with the closest code vector. The first phase determines the
//! subpixel position.

use super::column_light::{CodeError, Decoded, Patterns};
use super::phase_shift::{sinusoid, unwrap};
use crate::map::Map;
use optics::sampling::stream::Stream;
use std::f64::consts::TAU;

/// Number of captures of the first period.
const STEPS: usize = 3;

/// Number of sets of periods that [`periods`] compares.
const TRIES: usize = 96;

/// Returns the code vector (cos φ_1, sin φ_1, cos φ_2, …, cos φ_F) of a column coordinate.
fn name(coordinate: f64, periods: &[f64]) -> Vec<f64> {
    let phase = |p: f64| TAU * coordinate / p;
    let first = periods.first().map(|p| phase(*p));
    let others = periods.iter().skip(1).map(|p| phase(*p).cos());
    first.into_iter().flat_map(|f| [f.cos(), f.sin()]).chain(others).collect()
}

fn distance2(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

/// Returns the minimum distance between the code vectors of columns that are at least half a period apart.
/// The minimum distance limits the permissible noise.
pub fn margin(columns: usize, periods: &[f64]) -> f64 {
    let names: Vec<_> = (0..columns).map(|u| name(u as f64 + 0.5, periods)).collect();
    let apart = periods.first().map_or(1, |p| (p / 2.0) as usize).max(1);
    let mut least = f64::INFINITY;
    for (i, a) in names.iter().enumerate() {
        for b in names.iter().skip(i + apart) {
            least = least.min(distance2(a, b));
        }
    }
    least.sqrt()
}

/// Returns `count` periods with a large [`margin`] over the columns. The periods differ from `mean` by at
/// most a twelfth of `mean`. The result is the best of several pseudorandom sets, which are the same on every
/// call. Gupta & Nayar also choose the periods by search.
pub fn periods(columns: usize, mean: f64, count: usize) -> Vec<f64> {
    let mut stream = Stream::new(7, 1, 1);
    let mut best = (f64::NEG_INFINITY, Vec::new());
    for _ in 0..TRIES {
        let set: Vec<f64> =
            (0..count).map(|_| mean * (1.0 + (f64::from(stream.uniform()) - 0.5) / 6.0)).collect();
        let margin = margin(columns, &set);
        if margin > best.0 {
            best = (margin, set);
        }
    }
    best.1
}

/// Returns the patterns. The first period has three patterns, and each other period has one pattern.
pub fn patterns(columns: usize, periods: &[f64]) -> Patterns {
    let captures = if periods.is_empty() { 0 } else { periods.len() + STEPS - 1 };
    Patterns::from_fn(captures, columns, |k, u| match k.checked_sub(STEPS) {
        None => sinusoid(u, periods[0], k as f64 * TAU / STEPS as f64),
        Some(other) => sinusoid(u, periods[other + 1], 0.0),
    })
}

/// Decodes captures of [`patterns`]. A pixel has no column if its contrast is below `least_contrast`.
///
/// # Errors
/// Returns an error if the number of captures does not match the patterns, if there are no periods, or if
/// periods are too short.
pub fn decode(
    captures: &Map,
    columns: usize,
    periods: &[f64],
    least_contrast: f64,
) -> Result<Decoded, CodeError> {
    if periods.is_empty() || periods.iter().any(|p| !(*p > 2.0 && p.is_finite())) {
        return Err(CodeError::Periods(format!(
            "periods {periods:?}: expected at least one period, all above 2 columns"
        )));
    }
    let names: Vec<_> = (0..columns).map(|u| name(u as f64 + 0.5, periods)).collect();
    Decoded::by_pixel(captures, periods.len() + STEPS - 1, |pixel| {
        let offset = pixel[..STEPS].iter().sum::<f64>() / STEPS as f64;
        let part = |turn: fn(f64) -> f64| {
            let terms = pixel[..STEPS].iter().enumerate();
            terms.map(|(k, i)| i * turn(TAU * k as f64 / STEPS as f64)).sum::<f64>() * 2.0 / STEPS as f64
        };
        let (cos, sin) = (part(f64::cos), part(f64::sin));
        let amplitude = cos.hypot(sin);
        let contrast = if offset > 0.0 { amplitude / offset } else { 0.0 };
        if !(amplitude > 0.0 && contrast >= least_contrast) {
            return (f64::NAN, contrast);
        }
        let others = pixel[STEPS..].iter().map(|i| i - offset);
        let read: Vec<f64> = [cos, sin].into_iter().chain(others).map(|v| v / amplitude).collect();
        let distances = names.iter().map(|n| distance2(n, &read));
        let nearest = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        let column = nearest.map_or(f64::NAN, |(u, _)| unwrap(sin.atan2(cos), periods[0], u as f64 + 0.5));
        let inside = (0.0..=columns as f64).contains(&column);
        (if inside { column } else { f64::NAN }, contrast)
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
    #[ignore = "slow: tools/check --all"]
    fn direct_light_is_decoded_exactly() {
        for n in [256, 500] {
            let p = periods(n, 16.0, 5);
            assert!(margin(n, &p) > 0.2, "{}", margin(n, &p));
            for (i, column) in columns_of(&Light::direct(0.7), n, &p).iter().enumerate() {
                assert!((column - i as f64 - 0.5).abs() < 1e-9, "{i}: {column}");
            }
        }
        assert_eq!(periods(256, 16.0, 5), periods(256, 16.0, 5));
    }

    /// With a single period, columns that differ by whole periods cannot be distinguished.
    #[test]
    fn one_period_alone_is_ambiguous() {
        assert!(margin(256, &[16.0]) < 1e-9);
    }

    /// For a period of the image's width, the indirect light causes a bias of 13 columns (see `phase_shift`).
    /// For micro phase shifting, the same light causes a bias below 1e-6 columns. For periods of 16 columns,
    /// a Gaussian with σ = 20 columns is attenuated by exp(-2π²·400/256) = 4e-14.
    #[test]
    #[ignore = "slow: tools/check --all"]
    fn smooth_indirect_light_does_not_bias() {
        let n = 1024;
        let p = periods(n, 16.0, 5);
        let light = Light::direct(1.0).plus_blurred(0.8, 20.0, 30.0);
        let got = columns_of(&light, n, &p);
        for (i, column) in got.iter().enumerate().take(850).skip(150) {
            assert!((column - i as f64 - 0.5).abs() < 1e-6, "{i}: {column}");
        }
    }

    /// Indirect light from one other column (a mirror) contains all frequencies, so this light biases every
    /// code of sinusoids. The bias is the phase angle of the sum of two phasors of lengths 1 and 0.3. The
    /// phasors are four columns (about 90°) apart.
    #[test]
    fn mirrored_light_still_biases() {
        let n = 256;
        let p = periods(n, 16.0, 5);
        let light = Light::direct(1.0).plus_at(0.3, |c, n| (c + 4).min(n - 1));
        let got = columns_of(&light, n, &p);
        let turn = TAU * 4.0 / p[0];
        let bias = (0.3 * turn.sin()).atan2(1.0 + 0.3 * turn.cos()) / TAU * p[0];
        let near = got.iter().enumerate().take(n - 5);
        let right = near.filter(|(i, c)| (*c - *i as f64 - 0.5 - bias).abs() < 1e-9).count();
        assert!(right > 200, "{right}");
    }

    /// Noise with standard deviation σ in three captures of amplitude ½ causes an RMS phase error of
    /// σ√(2/3)/½. The test uses 300 × 256 pixels and a tolerance of five standard errors.
    #[test]
    #[ignore = "slow: tools/check --all"]
    fn column_noise_matches_theory() {
        let (n, sigma) = (256, 0.004);
        let p = periods(n, 16.0, 5);
        let clean = one_row(n, &Light::direct(1.0)).capture(&patterns(n, &p)).expect("captures");
        let (mut sum, mut count) = (0.0, 0.0);
        for seed in 0..300 {
            let got = decode(&noisy(&clean, sigma, seed), n, &p, 0.0).expect("a code");
            for (i, column) in got.column.data.iter().enumerate().take(n - 4).skip(4) {
                sum += (column - i as f64 - 0.5).powi(2);
                count += 1.0;
            }
        }
        let theory = (p[0] / TAU * 2.0 * sigma).powi(2) * 2.0 / 3.0;
        let error = theory * (2.0_f64 / count).sqrt();
        let variance = sum / count;
        assert!((variance - theory).abs() < 5.0 * error + 0.002 * theory, "{variance} {theory}");
    }

    #[test]
    fn no_periods_are_refused() {
        let captures = Map::from_fn(1, 1, 3, |_, _, o| o.fill(1.0));
        for bad in [vec![], vec![2.0], vec![f64::INFINITY]] {
            assert!(decode(&captures, 64, &bad, 0.0).is_err(), "{bad:?}");
        }
        assert_eq!(patterns(64, &[]).drives.len(), 0);
    }
}

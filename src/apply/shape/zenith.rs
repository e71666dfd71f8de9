//! Degree of polarization and zenith angle of a smooth dielectric (Atkinson & Hancock 2006, eqs. 9 and 13).
//!
//! Diffuse light from below the surface leaves through it: with s = sin²θ, c = cos θ and index n,
//!
//! > ρ_d = (n - 1/n)² s / (2 + 2n² - (n + 1/n)² s + 4c √(n² - s)),
//!
//! which increases from 0 to its maximum at grazing angle, polarized in the plane of emission.

use std::f64::consts::FRAC_PI_2;

/// Bisection steps for angles: to 1e-15 rad.
const HALVINGS: usize = 52;

/// Returns ρ_d for light that leaves at `zenith` radians from the normal, from index `n`.
#[must_use]
pub fn diffuse(zenith: f64, n: f64) -> f64 {
    let (sin, cos) = zenith.sin_cos();
    let s = sin * sin;
    let minus = (n - 1.0 / n).powi(2) * s;
    let plus = 2.0 + 2.0 * n * n - (n + 1.0 / n).powi(2) * s + 4.0 * cos * (n * n - s).max(0.0).sqrt();
    minus / plus
}

/// Returns the zenith angle of diffuse light with this degree of polarization; 90° if the degree exceeds the
/// maximum, NaN if it is invalid.
#[must_use]
pub fn of_diffuse(degree: f64, n: f64) -> f64 {
    if degree.is_nan() || degree < 0.0 || n.is_nan() || n <= 1.0 {
        return f64::NAN;
    }
    let (mut from, mut to) = (0.0, FRAC_PI_2);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (from + to);
        if diffuse(middle, n) < degree {
            from = middle;
        } else {
            to = middle;
        }
    }
    0.5 * (from + to)
}

#[cfg(test)]
mod tests {
    use super::*;
    use optics::polarization::fresnel::dielectric;
    use optics::spectrum::Spectral;

    /// The formulas agree with Fresnel's equations: degrees of the program's dielectric interface, in f32.
    #[test]
    fn degrees_are_fresnels() {
        for n in [1.3, 1.5, 1.8] {
            for zenith in [0.1, 0.4, 0.8, 1.1, 1.4_f64] {
                let fresnel = dielectric(zenith.cos() as f32, Spectral::splat(n as f32));
                let block = fresnel.reflection.to_mueller().lane(0).map(|row| row.map(f64::from));
                let (mean, difference) = (block[0][0], block[1][0]);
                // What is not reflected is transmitted, with equal shares in both directions.
                let through = difference / (1.0 - mean);
                assert!((through - diffuse(zenith, n)).abs() < 2e-6, "{n} {zenith}");
            }
        }
    }

    #[test]
    fn zeniths_come_back_to_a_millionth() {
        for n in [1.3, 1.5, 1.8] {
            for step in 0..150 {
                let zenith = f64::from(step) * 0.01;
                assert!((of_diffuse(diffuse(zenith, n), n) - zenith).abs() < 1e-6, "{n} {zenith}");
            }
        }
    }

    #[test]
    fn what_cannot_be_has_no_angle() {
        assert!((of_diffuse(0.9, 1.5) - FRAC_PI_2).abs() < 1e-9);
        assert!(of_diffuse(f64::NAN, 1.5).is_nan() && of_diffuse(-0.1, 1.5).is_nan());
        assert!(of_diffuse(0.1, 1.0).is_nan());
    }
}

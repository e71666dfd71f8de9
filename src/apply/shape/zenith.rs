//! Degree of polarization and zenith angle of a smooth dielectric (Atkinson & Hancock 2006, eqs. 9 and 13).
//!
//! Diffuse light from below the surface leaves through the surface. For s = sin²θ, c = cos θ and index n, the
//! degree of polarization is
//!
//! > ρ_d = (n - 1/n)² s / (2 + 2n² - (n + 1/n)² s + 4c √(n² - s)),
//!
//! which increases from 0 to its maximum at grazing angles. Diffuse light is polarized parallel to the plane
//! of emission. Specular reflection is polarized perpendicular to this plane, with the degree
//!
//! > ρ_s = 2 s c √(n² - s) / (n² - s - n² s + 2s²),
//!
//! which is 1 at Brewster's angle, tan θ = n. Each degree of polarization below 1 therefore occurs at two
//! angles.

use std::f64::consts::FRAC_PI_2;

/// Number of bisection steps for angles. With 52 steps, angles are accurate to 1e-15 rad.
const HALVINGS: usize = 52;

/// Returns ρ_d for light that leaves a medium of index `n` at `zenith` radians from the normal.
pub fn diffuse(zenith: f64, n: f64) -> f64 {
    let (sin, cos) = zenith.sin_cos();
    let s = sin * sin;
    let minus = (n - 1.0 / n).powi(2) * s;
    let plus = 2.0 + 2.0 * n * n - (n + 1.0 / n).powi(2) * s + 4.0 * cos * (n * n - s).max(0.0).sqrt();
    minus / plus
}

/// Returns ρ_s for unpolarized light that a medium of index `n` reflects at `zenith` radians from the normal.
pub fn specular(zenith: f64, n: f64) -> f64 {
    let (sin, cos) = zenith.sin_cos();
    let s = sin * sin;
    let over = n * n - s - n * n * s + 2.0 * s * s;
    2.0 * s * cos * (n * n - s).max(0.0).sqrt() / over
}

/// Returns the angle in the interval at which an increasing function reaches `value`. If there is no such
/// angle, returns the nearer end of the interval.
fn invert(mut from: f64, mut to: f64, value: f64, f: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (from + to);
        if f(middle) < value {
            from = middle;
        } else {
            to = middle;
        }
    }
    0.5 * (from + to)
}

/// Returns the zenith angle in radians of diffuse light with this degree of polarization. The result is π/2
/// if the degree exceeds the maximum, and NaN if the degree is invalid.
pub fn of_diffuse(degree: f64, n: f64) -> f64 {
    if degree.is_nan() || degree < 0.0 || n.is_nan() || n <= 1.0 {
        return f64::NAN;
    }
    if degree >= diffuse(FRAC_PI_2, n) {
        return FRAC_PI_2;
    }
    // The square of k s - 2ρ(1 + n²) = 4ρ c √(n² - s) is quadratic in s. The left side is positive for the larger root.
    let (rho, square) = (degree, n * n);
    let k = (n - 1.0 / n).powi(2) + rho * (n + 1.0 / n).powi(2);
    let first = k * k - 16.0 * rho * rho;
    let half = 2.0 * rho * (1.0 + square) * (k - 4.0 * rho);
    let last = (2.0 * rho * (square - 1.0)).powi(2);
    let s = (half + (half * half - first * last).max(0.0).sqrt()) / first;
    s.clamp(0.0, 1.0).sqrt().asin()
}

/// Returns the two zenith angles, in radians, of specular reflection with this degree of polarization. The
/// first angle is below Brewster's angle, and the second is above it.
pub fn of_specular(degree: f64, n: f64) -> [f64; 2] {
    if degree.is_nan() || degree < 0.0 || n.is_nan() || n <= 1.0 {
        return [f64::NAN; 2];
    }
    let brewster = n.atan();
    let above = invert(0.0, FRAC_PI_2 - brewster, degree, |below| specular(FRAC_PI_2 - below, n));
    [invert(0.0, brewster, degree, |zenith| specular(zenith, n)), FRAC_PI_2 - above]
}

#[cfg(test)]
mod tests {
    use super::*;
    use optics::polarization::fresnel::dielectric;
    use optics::spectrum::Spectral;

    /// The formulas agree with the degrees of polarization of the renderer's dielectric interface
    /// (Fresnel equations in f32).
    #[test]
    fn degrees_match_fresnel() {
        for n in [1.3, 1.5, 1.8] {
            for zenith in [0.1, 0.4, 0.8, 1.1, 1.4_f64] {
                let fresnel = dielectric(zenith.cos() as f32, Spectral::splat(n as f32));
                let block = fresnel.reflection.to_mueller().lane(0).map(|row| row.map(f64::from));
                let (mean, difference) = (block[0][0], block[1][0]);
                assert!((difference / mean - specular(zenith, n)).abs() < 2e-5, "{n} {zenith}");
                // The interface transmits the light that it does not reflect. The transmittance is the same
                // in the two directions.
                let through = difference / (1.0 - mean);
                assert!((through - diffuse(zenith, n)).abs() < 2e-6, "{n} {zenith}");
            }
        }
    }

    #[test]
    fn zenith_angles_round_trip_to_a_millionth() {
        for n in [1.3, 1.5, 1.8] {
            for step in 0..150 {
                let zenith = f64::from(step) * 0.01;
                assert!((of_diffuse(diffuse(zenith, n), n) - zenith).abs() < 1e-6, "{n} {zenith}");
                let both = of_specular(specular(zenith, n), n);
                let nearest = both.map(|z| (z - zenith).abs()).into_iter().fold(1.0, f64::min);
                // At Brewster's angle, the degree has zero slope, so half of the digits are lost.
                let flat = (zenith - n.atan()).abs() < 0.01;
                assert!(nearest < if flat { 1e-5 } else { 1e-6 }, "{n} {zenith}: {both:?}");
                assert!(both[0] <= n.atan() + 1e-6 && both[1] >= n.atan() - 1e-6);
            }
        }
        assert!((specular(1.5_f64.atan(), 1.5) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn out_of_range_degrees_give_a_limit_or_nan() {
        assert!((of_diffuse(0.9, 1.5) - FRAC_PI_2).abs() < 1e-9);
        assert!(of_diffuse(f64::NAN, 1.5).is_nan() && of_diffuse(-0.1, 1.5).is_nan());
        assert!(of_diffuse(0.1, 1.0).is_nan() && of_specular(f64::NAN, 1.5)[0].is_nan());
    }
}

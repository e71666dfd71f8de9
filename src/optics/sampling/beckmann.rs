//! Beckmann's distribution of facet normals, with Gaussian slopes (Beckmann & Spizzichino 1963; Walter et al.
//! 2007).
//!
//! D(h) = exp(-tan²θ/α²) / (π α² cos⁴θ). Smith's Λ is exact (Walter et al. 2007, eq. 25; Heitz 2014, eq. 66):
//! Λ(a) = (erf(a) - 1)/2 + exp(-a²)/(2a√π) with a = 1/(α tanθ).
//!
//! Visible normals are sampled by inverting the cumulative distribution of their slope (Heitz & d'Eon 2014).
//! The inversion uses Newton's method in the domain of erf (Jakob 2014, "An improved visible normal sampling
//! routine for the Beckmann distribution"). Mitsuba 3 uses the rational G1 of Walter et al. (2007). The
//! rational G1 deviates from the exact G1 by up to 0.35 %.

use glam::Vec3A;
use std::f32::consts::{FRAC_1_PI, FRAC_2_SQRT_PI};

const FRAC_1_SQRT_PI: f32 = FRAC_2_SQRT_PI / 2.0;

/// Returns erfc(x)·exp(x²) for x ≥ 0, with an absolute error of 1.5e-7 in erfc (Abramowitz & Stegun 1964,
/// 7.1.26).
#[inline]
fn erfcx(x: f32) -> f32 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    ((((1.061_405_4 * t - 1.453_152_1) * t + 1.421_413_8) * t - 0.284_496_74) * t + 0.254_829_6) * t
}

/// Returns the error function, with an absolute error of 2e-7.
#[inline]
pub fn erf(x: f32) -> f32 {
    (1.0 - erfcx(x.abs()) * (-x * x).exp()).copysign(x)
}

/// Returns the inverse of [`erf`] on -1 < x < 1, with a relative error of 1e-6 (Giles 2012, "Approximating
/// the erfinv function").
#[inline]
pub fn erf_inv(x: f32) -> f32 {
    const CENTRE: [f32; 9] = [
        2.810_226_4e-8,
        3.432_739_4e-7,
        -3.523_387_7e-6,
        -4.391_506_5e-6,
        2.185_808_7e-4,
        -1.253_725e-3,
        -4.177_681_6e-3,
        2.466_407_3e-1,
        1.501_409_4,
    ];
    const TAIL: [f32; 9] = [
        -2.002_142_6e-4,
        1.009_505_6e-4,
        1.349_343_2e-3,
        -3.673_428_4e-3,
        5.739_507_7e-3,
        -7.622_461_3e-3,
        9.438_870_5e-3,
        1.001_674,
        2.832_976_8,
    ];
    let w = -((1.0 - x) * (1.0 + x)).ln();
    let (t, polynomial) = if w < 5.0 { (w - 2.5, &CENTRE) } else { (w.sqrt() - 3.0, &TAIL) };
    polynomial.iter().fold(0.0, |p, c| p * t + c) * x
}

/// Returns the density D(h) per solid angle of h.
#[inline]
pub fn d(h: Vec3A, alpha: f32) -> f32 {
    if h.z <= 0.0 {
        return 0.0;
    }
    let cos2 = h.z * h.z;
    let a2 = alpha * alpha;
    (-(h.x * h.x + h.y * h.y) / (cos2 * a2)).exp() * FRAC_1_PI / (a2 * cos2 * cos2)
}

/// Returns Smith's Λ for a direction on either side of the surface.
#[inline]
pub fn lambda(w: Vec3A, alpha: f32) -> f32 {
    let tan = (w.x * w.x + w.y * w.y).sqrt() / w.z.abs().max(f32::MIN_POSITIVE);
    let a = 1.0 / (alpha * tan).max(f32::MIN_POSITIVE);
    // For larger values of a, Λ < 1e-8.
    if a > 4.0 {
        return 0.0;
    }
    ((-a * a).exp() * (FRAC_1_SQRT_PI / a - erfcx(a)) / 2.0).max(0.0)
}

/// Samples a slope component at α = 1, among the slopes visible from a direction. The component is the slope
/// toward this direction, and `cos` is the cosine of the angle between the direction and the z axis.
///
/// Solves 1 + x + T·exp(-s²) = u·(1 + X + T·exp(-cot²θ)) for x = erf(s), with X = erf(cotθ) and T = tanθ/√π.
/// The left side is increasing and concave in x, so that ascending Newton steps stay in the interval.
#[inline]
fn visible_slope(cos: f32, u: f32) -> f32 {
    let tan = (1.0 - cos * cos).max(0.0).sqrt() / cos;
    let cot = 1.0 / tan.max(f32::MIN_POSITIVE);
    let t = FRAC_1_SQRT_PI * tan;
    let top = erf(cot).min(1.0 - f32::EPSILON);
    let all = 1.0 + top + t * (-cot * cot).exp();
    let bottom = -1.0 + f32::EPSILON;
    // Start with the solution at grazing incidence, where the function is least linear.
    let mut x = top - (1.0 + top) * erf((-u.ln()).sqrt());
    let mut s = 0.0;
    for _ in 0..6 {
        x = x.clamp(bottom, top);
        s = erf_inv(x);
        let excess = 1.0 + x + t * (-s * s).exp() - u * all;
        // The limit of f32 accuracy is reached, usually after at most three steps.
        if excess.abs() < 1e-6 * all {
            break;
        }
        x -= excess / (1.0 - s * tan).max(1e-4);
    }
    s
}

/// Samples a normal visible from the unit direction `wo` (wo.z > 0) with density G1(wo) max(0, wo·h) D(h) /
/// wo.z.
#[inline]
pub fn visible_normal(wo: Vec3A, alpha: f32, u: [f32; 2]) -> Vec3A {
    // Uniform random numbers have 24 bits. At 0 and 1, slopes would be infinite.
    let [u, v] = u.map(|u| u.clamp(3e-8, 1.0 - f32::EPSILON));
    // Stretch `wo` to α = 1, and rotate the result into the xz plane.
    let w = Vec3A::new(alpha * wo.x, alpha * wo.y, wo.z.max(1e-6)).normalize();
    let sin = (w.x * w.x + w.y * w.y).sqrt();
    let (c, s) = if sin > 0.0 { (w.x / sin, w.y / sin) } else { (1.0, 0.0) };
    let x = visible_slope(w.z, u);
    let y = erf_inv((2.0 * v - 1.0).max(-1.0 + f32::EPSILON));
    Vec3A::new(-alpha * (c * x - s * y), -alpha * (s * x + c * y), 1.0).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares with Abramowitz & Stegun, table 7.1.
    #[test]
    fn erf_has_its_tabulated_values() {
        for (x, want) in [
            (0.0, 0.0),
            (0.1, 0.112_462_916),
            (0.5, 0.520_499_9),
            (1.0, 0.842_700_8),
            (1.5, 0.966_105_16),
            (2.0, 0.995_322_3),
            (3.0, 0.999_977_9),
        ] {
            assert!((erf(x) - want).abs() < 4e-7, "{x}: {}", erf(x));
            assert!((erf(-x) + want).abs() < 4e-7, "-{x}: {}", erf(-x));
        }
    }

    #[test]
    fn erf_inv_inverts_erf() {
        for i in -2999..3000 {
            let x = i as f32 / 3000.0;
            assert!((erf(erf_inv(x)) - x).abs() < 1e-6, "{x}");
        }
        assert!((erf_inv(0.842_700_8) - 1.0).abs() < 2e-6);
    }

    /// Verifies that, with Smith's Λ, the facets visible from a direction fill the projected area of the
    /// surface: ∫ max(0, w·h) D dω_h = cosθ / G1.
    #[test]
    fn visible_facets_fill_the_projected_area() {
        for alpha in [0.05_f32, 0.3, 1.0] {
            for cos in [1.0_f32, 0.7, 0.2, 0.02] {
                let w = Vec3A::new((1.0 - cos * cos).sqrt(), 0.0, cos);
                // The density of the slope perpendicular to the plane of w integrates to 1. D cosθ_h dω_h is
                // Gaussian in the slope along the plane.
                const N: u32 = 20_000;
                let mut sum = 0.0_f64;
                for k in 0..N {
                    let x = -6.0 + 12.0 * (f64::from(k) + 0.5) / f64::from(N);
                    let facing = f64::from(w.z) + f64::from(w.x) * f64::from(alpha) * x;
                    sum +=
                        facing.max(0.0) * (-x * x).exp() * 12.0 / f64::from(N) / std::f64::consts::PI.sqrt();
                }
                let g1 = f64::from(cos) / sum;
                let got = f64::from(1.0 / (1.0 + lambda(w, alpha)));
                assert!((got - g1).abs() < 2e-5 * g1, "alpha {alpha}, cos {cos}: {got} is not {g1}");
            }
        }
    }
}

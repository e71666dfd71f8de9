//! Euler's gamma function. ln Γ is computed by Stirling's series (Abramowitz & Stegun 1964, 6.1.40):
//!
//! ln Γ(x) = (x - 1/2) ln x - x + ln(2π)/2 + 1/(12x) - 1/(360x³) + 1/(1260x⁵) - 1/(1680x⁷) + 1/(1188x⁹) -
//! 691/(360360x¹¹) + ….
//!
//! The error is below the first omitted term, 1/(156x¹³), which is 1.2·10⁻¹⁴ at x = 8. For a smaller
//! argument, the identity Γ(x + 1) = x Γ(x) is applied until the argument is at least 8.

/// Returns ln Γ(x) for x > 0, with an error of 2·10⁻¹⁴ plus rounding.
pub fn ln_gamma(x: f64) -> f64 {
    const TERMS: [f64; 6] =
        [1.0 / 12.0, -1.0 / 360.0, 1.0 / 1260.0, -1.0 / 1680.0, 1.0 / 1188.0, -691.0 / 360_360.0];
    let (mut x, mut product) = (x, 1.0);
    while x < 8.0 {
        product *= x;
        x += 1.0;
    }
    let r = 1.0 / (x * x);
    let series = TERMS.iter().rev().fold(0.0, |sum, term| sum * r + term) / x;
    (x - 0.5) * x.ln() - x + 0.918_938_533_204_672_7 + series - product.ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn gamma_function_has_known_values() {
        for (z, want) in [(1.0, 1.0_f64), (5.0, 24.0), (0.5, PI.sqrt()), (10.5, 1_133_278.388_948_785)] {
            assert!((ln_gamma(z) - want.ln()).abs() < 1e-12, "{z}");
        }
    }
}

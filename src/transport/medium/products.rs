//! Computes the scattering matrix of a set of spheres from the mean products of their Mie coefficients.
//!
//! With P = S1 + S2 = Σ s_n (π_n + τ_n) and Q = S1 - S2 = Σ d_n (π_n - τ_n), where the coefficients are
//! (2n+1)/(n(n+1)) (a_n ± b_n),
//!
//! S11 = (|P|² + |Q|²)/4, S12 = Re P Q*/2, S33 = (|P|² - |Q|²)/4, S34 = Im P Q*/2.
//!
//! All four elements are quadratic forms of the angular functions. The matrices ⟨s_n s_m*⟩, ⟨d_n d_m*⟩ and
//! ⟨s_n d_m*⟩ are averaged over the spheres once. The cost per angle therefore does not depend on the number
//! of sizes. Thousands of sizes are needed, because the resonances of transparent spheres are narrow. With a
//! few hundred sizes, the relative error is 10⁻³.

use super::mie::Sphere;

/// Mean products of the Mie coefficients of weighted spheres.
#[derive(Clone, Debug)]
pub struct Products {
    /// Number of terms of the longest Mie series.
    terms: usize,
    /// Rows n of Re s_n s_m* for m ≤ n, with off-diagonal elements doubled, and rows n of Re d_n d_m*.
    squares: [Vec<Vec<f64>>; 2],
    /// Rows n of Re s_n d_m* and rows n of Im s_n d_m*, each for all m.
    mixed: [Vec<Vec<f64>>; 2],
}

/// Computes `sum[m] += f · row[m]`.
fn add(sum: &mut [f64], f: f64, row: &[f64]) {
    for (s, r) in sum.iter_mut().zip(row) {
        *s += f * r;
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Products {
    /// Computes the mean products over spheres. Each pair is a weight and a sphere.
    pub fn new(spheres: &[(f64, Sphere)]) -> Self {
        let terms = spheres.iter().map(|(_, s)| s.terms()).max().unwrap_or(0);
        let triangle = || (0..terms).map(|n| vec![0.0; n + 1]).collect::<Vec<_>>();
        let square = || vec![vec![0.0; terms]; terms];
        let (mut squares, mut mixed) = ([triangle(), triangle()], [square(), square()]);
        let (mut re, mut im) = ([vec![], vec![]], [vec![], vec![]]);
        for (weight, sphere) in spheres {
            // Separate the real and imaginary parts of s and d of this sphere, for the inner loops.
            for which in 0..2 {
                re[which].clear();
                im[which].clear();
                for c in sphere.coefficients() {
                    re[which].push(2.0 * c[which].re);
                    im[which].push(2.0 * c[which].im);
                }
            }
            for n in 0..sphere.terms() {
                for (which, rows) in squares.iter_mut().enumerate() {
                    let (x, y) = (weight * re[which][n], weight * im[which][n]);
                    add(&mut rows[n], 2.0 * x, &re[which][..n]);
                    add(&mut rows[n], 2.0 * y, &im[which][..n]);
                    rows[n][n] += x * re[which][n] + y * im[which][n];
                }
                let (x, y) = (weight * re[0][n], weight * im[0][n]);
                add(&mut mixed[0][n], x, &re[1]);
                add(&mut mixed[0][n], y, &im[1]);
                add(&mut mixed[1][n], y, &re[1]);
                add(&mut mixed[1][n], -x, &im[1]);
            }
        }
        Self { terms, squares, mixed }
    }

    /// Returns S11, S12, S33, S34, summed over the spheres, in a direction with the given
    /// [`super::mie::angular`] functions.
    pub fn matrix(&self, angular: &[[f64; 2]]) -> [f64; 4] {
        let functions = [0, 1].map(|which| -> Vec<f64> { angular.iter().map(|a| a[which]).collect() });
        let form = |rows: &[Vec<f64>], left: &[f64], right: &[f64]| {
            let mut sum = vec![0.0; self.terms];
            for (row, f) in rows.iter().zip(left) {
                add(&mut sum, *f, row);
            }
            dot(&sum, right)
        };
        let [plus, minus] = &functions;
        let p2 = form(&self.squares[0], plus, plus);
        let q2 = form(&self.squares[1], minus, minus);
        let [re, im] = [0, 1].map(|part| form(&self.mixed[part], plus, minus));
        [0.25 * (p2 + q2), 0.5 * re, 0.25 * (p2 - q2), 0.5 * im]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::mie::{C, angular, matrix};

    /// Verifies that the quadratic forms agree with the sum of the matrices of the spheres.
    #[test]
    fn products_are_sums_over_spheres() {
        let spheres: Vec<(f64, Sphere)> =
            [(0.5, 12.0, 1.5, 0.0), (2.0, 3.0, 1.33, 0.1), (7.0, 0.3, 0.4, 2.5)]
                .map(|(w, x, n, k)| (w, Sphere::new(x, C::new(n, k)).expect("the sphere is supported")))
                .to_vec();
        let products = Products::new(&spheres);
        let mut table = vec![];
        for mu in [-1.0, -0.7, 0.0, 0.4, 0.99, 1.0] {
            angular(mu, products.terms, &mut table);
            let mut want = [0.0; 4];
            for (w, s) in &spheres {
                let m = matrix(s.amplitudes(mu));
                want.iter_mut().zip(m).for_each(|(sum, e)| *sum += w * e);
            }
            for (got, want_e) in products.matrix(&table).into_iter().zip(want) {
                assert!((got - want_e).abs() < 1e-11 * want[0], "μ = {mu}: {got}, expected {want_e}");
            }
        }
    }
}

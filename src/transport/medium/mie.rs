//! Lorenz–Mie scattering of a plane wave by a homogeneous sphere with a complex refractive index.
//!
//! The formulas and conventions are those of Bohren & Huffman, "Absorption and Scattering of Light by Small
//! Particles" (1983), ch. 4. Fields have the form Re E·exp(-iωt). An index m = n + i·k with k > 0 therefore
//! describes absorption, as in the rest of this program. With x = 2π r n_host / λ and D_n = ψ_n'/ψ_n,
//!
//! - a_n = p/(p - i q), p = A ψ_n(x) - ψ_{n-1}(x), q = A χ_n(x) - χ_{n-1}(x), A = D_n(mx)/m + n/x (their
//!   4.88),
//! - b_n has the same form as a_n, with A = m D_n(mx) + n/x,
//! - S1 = Σ (2n+1)/(n(n+1)) (a_n π_n + b_n τ_n), S2 = Σ (2n+1)/(n(n+1)) (a_n τ_n + b_n π_n) (their 4.74).
//!
//! S1 acts on the field perpendicular to the scattering plane, and S2 acts on the field in this plane. The
//! perpendicular direction is the first axis of both frames, and (perpendicular, parallel, direction) is
//! right-handed, as in `polarization::fresnel`. S1 and S2 therefore replace r_s and r_p, and the scattering
//! matrix has the same block form as a Fresnel matrix: S11 = (|S1|² + |S2|²)/2, S12 = (|S1|² - |S2|²)/2, S33
//! = Re S1* S2, S34 = Im S1* S2. S12 has the opposite sign of S12 in Bohren & Huffman, because their first
//! axis is the parallel axis. S34 has the same sign.
//!
//! The recurrences are numerically stable at any size. For n ≤ x, where ψ_n oscillates, ψ_n is computed by an
//! upward recurrence. For n > x, where ψ_n decays, ψ_n is computed from the logarithmic derivative by a
//! downward recurrence. Absorption is summed directly and not as a difference. The Wronskian ψ_{n-1} χ_n -
//! ψ_n χ_{n-1} = 1 gives Re a_n - |a_n|² = -Im A/|p - i q|².

use num_complex::Complex;

pub type C = Complex<f64>;

/// Minimum and maximum size parameter x.
pub const SIZES: [f64; 2] = [1e-6, 3000.0];

/// Maximum |m| x, which limits the computing time of the recurrences.
pub const LARGEST_PHASE: f64 = 1e5;

/// Reasons why the scattering by a sphere cannot be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MieError {
    #[error("the size parameter 2π·radius·index/wavelength of a particle must be in 1e-6..3000, got {0:.4e}")]
    Size(f64),
    /// The index is not that of a passive material, or is outside the supported range.
    #[error(
        "the relative refractive index m = n + k i is {0} + {1} i; expected n > 0.001, k ≥ 0 and |m| x ≤ 1e5, where x is the size \
         parameter"
    )]
    Index(f64, f64),
}

/// Mie coefficients and efficiencies (cross sections divided by π r²) of a sphere.
#[derive(Clone, Debug)]
pub struct Sphere {
    /// Size parameter x = 2π r n_host / λ.
    pub x: f64,
    pub q_sca: f64,
    pub q_abs: f64,
    /// Backscattering efficiency, 4 |S(180°)|²/x².
    pub q_back: f64,
    /// Mean cosine g of the scattering angle.
    pub g: f64,
    /// Coefficients (2n+1)/(n(n+1)) (a_n + b_n)/2 and (a_n - b_n)/2 for n = 1, 2, …
    sums: Vec<[C; 2]>,
}

/// Returns the number of terms of the series. The result is a few terms more than recommended by Wiscombe
/// (1980, Appl. Opt. 19, 1505).
fn terms(x: f64) -> usize {
    (x + 4.05 * x.cbrt() + 8.0) as usize
}

/// Returns the logarithmic derivatives D_0 … D_count. The downward recurrence starts at an index that is
/// large enough to make the initial error negligible.
fn logarithmic_derivatives(z: C, count: usize) -> Vec<C> {
    let start = (count as f64).max(z.norm() + 8.0 * z.norm().cbrt()) as usize + 16;
    let mut out = vec![C::default(); count + 1];
    let mut d = C::default();
    for n in (1..=start).rev() {
        let ratio = n as f64 / z;
        // The constant avoids division by zero at an exact zero of ψ and is otherwise negligible.
        d = ratio - (d + ratio + 1e-150).inv();
        if n - 1 <= count {
            out[n - 1] = d;
        }
    }
    out
}

/// Returns the Riccati–Bessel functions ψ_0 … ψ_count and χ_0 … χ_count of a real argument. The signs are
/// those of Bohren & Huffman: ψ_0 = sin x, χ_0 = cos x.
fn riccati_bessel(x: f64, count: usize) -> [Vec<f64>; 2] {
    let (mut psi, mut chi) = (vec![0.0; count + 1], vec![0.0; count + 1]);
    let (sin, cos) = x.sin_cos();
    (psi[0], chi[0]) = (sin, cos);
    // Start with the functions of order -1.
    let (mut psi_before, mut chi_before) = (cos, -sin);
    let decay = logarithmic_derivatives(C::new(x, 0.0), count);
    for n in 1..=count {
        let factor = (2 * n - 1) as f64 / x;
        chi[n] = factor * chi[n - 1] - chi_before;
        psi[n] = if n as f64 <= x {
            factor * psi[n - 1] - psi_before
        } else {
            psi[n - 1] / (n as f64 / x + decay[n].re)
        };
        (psi_before, chi_before) = (psi[n - 1], chi[n - 1]);
    }
    [psi, chi]
}

impl Sphere {
    /// Computes a sphere with size parameter `x` and index `m` relative to the host, where m.im ≥ 0.
    ///
    /// # Errors
    /// Returns a [`MieError`] if `x` is outside [`SIZES`], or if `m` is not the index of a passive material.
    pub fn new(x: f64, m: C) -> Result<Self, MieError> {
        if !(SIZES[0]..=SIZES[1]).contains(&x) {
            return Err(MieError::Size(x));
        }
        let passive = m.re >= 1e-3 && m.im >= 0.0 && m.norm() * x <= LARGEST_PHASE;
        if !passive {
            return Err(MieError::Index(m.re, m.im));
        }
        let count = terms(x);
        let inside = logarithmic_derivatives(m * x, count);
        let [psi, chi] = riccati_bessel(x, count);
        let i = C::new(0.0, 1.0);
        let (mut sca, mut abs, mut cosine, mut back) = (0.0, 0.0, 0.0, C::default());
        let mut sums = Vec::with_capacity(count);
        let mut before = [C::default(); 2];
        for n in 1..=count {
            let order = n as f64;
            let weight = 2.0 * order + 1.0;
            let mut coefficients = [C::default(); 2];
            for (out, a) in coefficients.iter_mut().zip([inside[n] / m, inside[n] * m]) {
                let a = a + order / x;
                let p = a * psi[n] - psi[n - 1];
                let q = a * chi[n] - chi[n - 1];
                let bottom = p - i * q;
                *out = p / bottom;
                sca += weight * out.norm_sqr();
                abs -= weight * a.im / bottom.norm_sqr();
            }
            let [a, b] = coefficients;
            cosine += weight / (order * (order + 1.0)) * (a * b.conj()).re;
            let [a1, b1] = before;
            cosine += (order * order - 1.0) / order * (a1 * a.conj() + b1 * b.conj()).re;
            before = coefficients;
            back += weight * if n % 2 == 0 { a - b } else { b - a };
            let half = 0.5 * weight / (order * (order + 1.0));
            sums.push([(a + b) * half, (a - b) * half]);
        }
        let x2 = x * x;
        Ok(Self {
            x,
            q_sca: 2.0 * sca / x2,
            // Rounding errors in A may make the absorption of a transparent sphere slightly negative.
            q_abs: (2.0 * abs / x2).max(0.0),
            q_back: back.norm_sqr() / x2,
            g: 2.0 * cosine / sca,
            sums,
        })
    }

    pub fn q_ext(&self) -> f64 {
        self.q_sca + self.q_abs
    }

    pub fn terms(&self) -> usize {
        self.sums.len()
    }

    /// Returns (2n+1)/(n(n+1)) (a_n + b_n)/2 and (a_n - b_n)/2 for n = 1, 2, …. The results are the
    /// coefficients of π_n + τ_n and π_n - τ_n in S1.
    pub fn coefficients(&self) -> &[[C; 2]] {
        &self.sums
    }

    /// Returns the amplitudes S1 and S2. `angular` must contain at least [`Self::terms`] pairs of [`angular`]
    /// functions of the direction.
    pub(crate) fn amplitudes_with(&self, angular: &[[f64; 2]]) -> [C; 2] {
        let (mut even, mut odd) = (C::default(), C::default());
        for ([sum, difference], [plus, minus]) in self.sums.iter().zip(angular) {
            even += sum * *plus;
            odd += difference * *minus;
        }
        [even + odd, even - odd]
    }

    /// Returns the amplitudes S1 and S2 for a cosine of the scattering angle.
    pub fn amplitudes(&self, cos: f64) -> [C; 2] {
        let mut table = vec![];
        angular(cos, self.terms(), &mut table);
        self.amplitudes_with(&table)
    }
}

/// Writes π_n + τ_n and π_n - τ_n for n = 1 … count to `out` (Bohren & Huffman 4.47). `cos` is the cosine of
/// the scattering angle.
pub fn angular(cos: f64, count: usize, out: &mut Vec<[f64; 2]>) {
    out.clear();
    let (mut before, mut pi) = (0.0, 1.0);
    for n in 1..=count {
        let order = n as f64;
        let tau = order * cos * pi - (order + 1.0) * before;
        out.push([pi + tau, pi - tau]);
        let next = ((2.0 * order + 1.0) * cos * pi - (order + 1.0) * before) / order;
        (before, pi) = (pi, next);
    }
}

/// Returns S11, S12, S33, S34 from the amplitudes S1 and S2, in the convention of the module documentation.
pub fn matrix([s1, s2]: [C; 2]) -> [f64; 4] {
    let (i1, i2) = (s1.norm_sqr(), s2.norm_sqr());
    let cross = s1.conj() * s2;
    [0.5 * (i1 + i2), 0.5 * (i1 - i2), cross.re, cross.im]
}

#[cfg(test)]
mod tests {
    use super::*;
    use optics::polarization::fresnel;
    use optics::spectrum::Spectral;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn sphere(x: f64, n: f64, k: f64) -> Sphere {
        Sphere::new(x, C::new(n, k)).expect("the sphere is supported")
    }

    /// Compares a sphere with the printed result of the program in appendix A of Bohren & Huffman (radius
    /// 0.525 µm, 632.8 nm, m = 1.55). The compared quantities are:
    /// - S11 divided by S11 at 0°,
    /// - the degree of polarization -S12/S11 in the convention of Bohren & Huffman,
    /// - S33/S11 and S34/S11.
    ///
    /// Signs are converted to those of this file.
    #[test]
    // One of the reference values is close to π/4, but is not π/4.
    #[expect(clippy::approx_constant)]
    fn matches_bohren_and_huffman() {
        let s = sphere(2.0 * PI * 0.525 / 0.6328, 1.55, 0.0);
        for (got, want) in [(s.q_sca, 3.10543), (s.q_ext(), 3.10543), (s.q_back, 2.92534)] {
            assert!((got - want).abs() < 5e-6, "found {got}, expected {want}");
        }
        let forward = matrix(s.amplitudes(1.0))[0];
        for (deg, want) in [
            (9.0, [0.785390, -0.00459811, 0.999400, 0.0343261]),
            (18.0, [0.356897, -0.0458541, 0.986022, 0.160184]),
            (27.0, [0.0766119, -0.364744, 0.843603, 0.394077]),
            (36.0, [0.0355355, -0.534997, 0.686967, -0.491787]),
            (45.0, [0.0701845, 0.00959953, 0.959825, -0.280434]),
            (90.0, [0.0124601, 0.230462, 0.937497, 0.260742]),
            (99.0, [0.00679093, -0.713472, -0.00717397, 0.700647]),
            (117.0, [0.00863419, -0.281215, 0.536251, -0.795835]),
        ] {
            let [a, b, c, d] = matrix(s.amplitudes(f64::to_radians(deg).cos()));
            for (g, w) in [a / forward, b / a, c / a, d / a].into_iter().zip(want) {
                assert!((g - w).abs() < 1.5e-6, "at {deg}°: found {g}, expected {w}");
            }
        }
    }

    /// Compares Q_ext, Q_sca and g with those of Wiscombe's MIEV0 (NCAR/TN-140+STR, 1979), within the printed
    /// precision.
    #[test]
    fn matches_wiscombe() {
        for (n, k, x, ext, sca, g) in [
            (0.75, 0.0, 0.101, 0.000_008, 0.000_008, 0.001_507),
            (0.75, 0.0, 10.0, 2.232_265, 2.232_265, 0.896_473),
            (0.75, 0.0, 1000.0, 1.997_908, 1.997_908, 0.844_944),
            (1.5, 0.0, 10.0, 2.881_999, 2.881_999, 0.742_913),
            (1.5, 0.0, 100.0, 2.094_388, 2.094_388, 0.818_246),
            (1.5, 0.0, 1000.0, 2.013_945, 2.013_945, 0.827_882),
            (1.33, 1e-5, 1.0, 0.093_952, 0.093_923, 0.184_517),
            (1.33, 1e-5, 100.0, 2.101_321, 2.096_594, 0.868_959),
            (1.5, 1.0, 0.055, 0.101_491, 0.000_011, 0.000_491),
            (1.5, 1.0, 100.0, 2.097_502, 1.283_697, 0.850_252),
            (10.0, 10.0, 1.0, 2.532_993, 2.049_405, -0.110_664),
            (10.0, 10.0, 100.0, 2.071_124, 1.836_785, 0.556_215),
        ] {
            let s = sphere(x, n, k);
            for (got, want) in [(s.q_ext(), ext), (s.q_sca, sca), (s.g, g)] {
                assert!((got - want).abs() < 6e-7, "{n} + {k} i, x = {x}: found {got}, expected {want}");
            }
        }
    }

    /// Compares Q_sca with (8/3) x⁴ |K|² and Q_abs with 4 x Im K, where K = (m² - 1)/(m² + 2). These values
    /// are the Rayleigh limits (Bohren & Huffman 5.7). The relative deviation from the limits is of order x².
    #[test]
    fn small_spheres_match_rayleigh() {
        for (n, k) in [(1.5, 0.0), (1.33, 1e-8), (1.5, 0.1), (0.7, 3.0)] {
            let m2 = C::new(n, k) * C::new(n, k);
            let polarizability = (m2 - 1.0) / (m2 + 2.0);
            for x in [1e-6, 1e-4, 1e-3_f64] {
                let s = sphere(x, n, k);
                let sca = 8.0 / 3.0 * x.powi(4) * polarizability.norm_sqr();
                let abs = 4.0 * x * polarizability.im;
                let tolerance = 20.0 * x * x + 1e-11;
                assert!((s.q_sca / sca - 1.0).abs() < tolerance, "{n} + {k} i, {x}: {}", s.q_sca / sca);
                assert!((s.q_abs - abs).abs() <= tolerance * abs, "{n} + {k} i, {x}: {}", s.q_abs / abs);
                for deg in [0.0_f64, 30.0, 90.0, 150.0] {
                    let mu = deg.to_radians().cos();
                    let [a, b, c, d] =
                        matrix(s.amplitudes(mu)).map(|e| e * 2.0 / (x.powi(6) * polarizability.norm_sqr()));
                    for (got, want) in [(a, 1.0 + mu * mu), (b, 1.0 - mu * mu), (c, 2.0 * mu), (d, 0.0)] {
                        assert!((got - want).abs() < 10.0 * tolerance, "{deg}°: {got}, expected {want}");
                    }
                }
            }
        }
    }

    /// Verifies Q_ext = 4 Re S(0)/x², Q_back = 4 |S(180°)|²/x², and the integrals of S11 and of μ S11. The
    /// integrals are computed by Gauss–Legendre quadrature.
    #[test]
    fn series_and_amplitudes_agree() {
        for (x, n, k) in
            [(0.3, 1.5, 0.0), (3.0, 1.33, 0.0), (7.5, 1.59, 0.01), (40.0, 1.1, 0.0), (25.0, 0.2, 3.0)]
        {
            let s = sphere(x, n, k);
            let forward = s.amplitudes(1.0);
            assert!((forward[0] - forward[1]).norm() < 1e-12 * forward[0].norm());
            assert!((4.0 * forward[0].re / (x * x) / s.q_ext() - 1.0).abs() < 1e-12);
            let back = s.amplitudes(-1.0);
            assert!((back[0] + back[1]).norm() < 1e-9 * forward[0].norm());
            assert!((4.0 * back[0].norm_sqr() / (x * x) / s.q_back - 1.0).abs() < 1e-10);
            // S11 is a polynomial in μ of twice the degree of the series.
            let (mut sum, mut cosine) = (0.0, 0.0);
            for (mu, w) in gauss_legendre(s.terms() + 2) {
                let s11 = matrix(s.amplitudes(mu))[0];
                sum += w * s11;
                cosine += w * s11 * mu;
            }
            assert!((2.0 * sum / (x * x) / s.q_sca - 1.0).abs() < 1e-11, "{x}");
            assert!((cosine / sum - s.g).abs() < 1e-11, "{x}: {} {}", cosine / sum, s.g);
        }
    }

    /// Returns the nodes and weights of Gauss–Legendre quadrature on [-1, 1], computed by Newton's method.
    fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
        let node = |i: usize| {
            let mut x = (PI * (i as f64 + 0.75) / (count as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..100 {
                let (mut before, mut p) = (0.0, 1.0);
                for n in 0..count {
                    let n = n as f64;
                    (before, p) = (p, ((2.0 * n + 1.0) * x * p - n * before) / (n + 1.0));
                }
                slope = count as f64 * (x * p - before) / (x * x - 1.0);
                x -= p / slope;
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        };
        (0..count).map(node).collect()
    }

    /// Verifies that scattering by a large metal sphere outside the forward direction equals Fresnel
    /// reflection at the specular point. The angle of incidence at this point is (180° - θ)/2. The test thus
    /// verifies that the order and signs of S1 and S2 and the signs of time and k agree with
    /// `polarization::fresnel`.
    #[test]
    fn a_large_gold_sphere_matches_fresnel() {
        let s = sphere(3000.0, 0.4242, 2.4721);
        for deg in [50.0_f64, 75.0, 100.0, 120.0, 150.0, 170.0] {
            let [a, b, c, d] = matrix(s.amplitudes(deg.to_radians().cos()));
            let cos_i = (deg / 2.0).to_radians().sin() as f32;
            let f = fresnel::conductor(cos_i, Spectral::splat(0.4242), Spectral::splat(2.4721));
            let want = [f.a, f.b, f.c, f.d].map(|e| f64::from(e.to_array()[0]));
            for (got, want) in [b / a, c / a, d / a].into_iter().zip(&want[1..]) {
                assert!((got - want / f64::from(f.a.to_array()[0])).abs() < 2e-3, "{deg}°: {got} {want}");
            }
            // The geometric reflection by a sphere is isotropic. The reflected intensity per steradian is a
            // quarter of the reflectance, in units of r².
            let brightness = 4.0 * a / 3000.0_f64.powi(2);
            assert!((brightness / want[0] - 1.0).abs() < 5e-3, "{deg}°: {brightness} {want:?}");
        }
    }

    #[test]
    fn extinction_of_large_spheres_approaches_two() {
        let excess = |x: f64| sphere(x, 1.5, 0.1).q_ext() - 2.0;
        assert!(excess(3000.0) > 0.0 && excess(3000.0) < 0.012, "{}", excess(3000.0));
        // The contribution of the edges of the sphere decreases as x^(-2/3).
        let ratio = excess(375.0) / excess(3000.0);
        assert!((ratio - 4.0).abs() < 0.1, "{ratio}");
    }

    #[test]
    fn invalid_sizes_and_indices_are_refused() {
        for x in [0.0, -1.0, 1e-7, 3001.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(Sphere::new(x, C::new(1.5, 0.0)), Err(MieError::Size(_))), "{x}");
        }
        for (n, k) in [(0.0, 1.0), (1.5, -1e-9), (f64::NAN, 0.0), (1.5, f64::NAN), (1e5, 0.0)] {
            let refused = Sphere::new(10.0, C::new(n, k));
            assert!(matches!(refused, Err(MieError::Index(..))), "{n} + {k} i");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]
        /// Verifies that all accepted spheres give finite, physically possible numbers.
        #[test]
        fn spheres_conserve_energy(
            log_x in -6.0..3.47_f64, n in 0.01..5.0_f64, log_k in -12.0..1.0_f64, mu in -1.0..1.0_f64,
        ) {
            let (x, k) = (10.0_f64.powf(log_x), if log_k < -11.0 { 0.0 } else { 10.0_f64.powf(log_k) });
            let s = sphere(x, n, k);
            prop_assert!(s.q_sca > 0.0 && s.q_abs >= 0.0 && s.q_ext() < 20.0, "{} {}", s.q_sca, s.q_abs);
            prop_assert!(s.g.abs() <= 1.0 && s.q_back >= 0.0 && s.q_back.is_finite());
            let [a, b, c, d] = matrix(s.amplitudes(mu));
            prop_assert!(a >= 0.0 && (b * b + c * c + d * d - a * a).abs() <= 1e-12 * a * a);
            // Verify the optical theorem only where the result keeps enough digits after cancellation.
            let theorem = 4.0 * s.amplitudes(1.0)[0].re / (x * x);
            prop_assert!((theorem - s.q_ext()).abs() < 1e-9 * s.q_ext(), "{} {}", theorem, s.q_ext());
        }
    }
}

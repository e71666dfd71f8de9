//! Lorenz–Mie scattering: what a homogeneous sphere of complex index does to a plane wave.
//!
//! Bohren & Huffman, "Absorption and Scattering of Light by Small Particles" (1983), ch. 4, in their conventions: fields
//! Re E·exp(-iωt), in which an index m = n + i·k with k ≥ 0 absorbs, as in the rest of this program. With
//! x = 2π r n_host / λ and D_n = ψ_n'/ψ_n,
//!
//! - a_n = p/(p - i q), p = A ψ_n(x) - ψ_{n-1}(x), q = A χ_n(x) - χ_{n-1}(x), A = D_n(mx)/m + n/x (their 4.88),
//! - b_n the same with A = m D_n(mx) + n/x,
//! - S1 = Σ (2n+1)/(n(n+1)) (a_n π_n + b_n τ_n), S2 = Σ (2n+1)/(n(n+1)) (a_n τ_n + b_n π_n) (their 4.74).
//!
//! S1 acts on the field perpendicular to the scattering plane, S2 on the one in it. With the perpendicular as the first
//! axis on both sides and (perpendicular, parallel, direction) right-handed, as in `polarization::fresnel`, they stand
//! where r_s and r_p stand there, and the scattering matrix is the same block:
//! S11 = (|S1|² + |S2|²)/2, S12 = (|S1|² - |S2|²)/2, S33 = Re S1* S2, S34 = Im S1* S2. (S12 has the opposite sign to
//! Bohren & Huffman's, whose first axis is the parallel one; S34 is theirs.)
//!
//! Every n-th ψ is found without loss of digits at any size: upward where it oscillates (n ≤ x), by its logarithmic
//! derivative, itself from a downward recurrence, where it decays. Absorption is summed by itself and not as a
//! difference: the Wronskian ψ_{n-1} χ_n - ψ_n χ_{n-1} = 1 gives Re a_n - |a_n|² = -Im A/|p - i q|².

use nalgebra::Complex;

/// A complex number.
pub type C = Complex<f64>;

/// The smallest and largest admitted size parameter x.
pub const SIZES: [f64; 2] = [1e-6, 3000.0];

/// The largest admitted |m| x: longer recurrences take too long.
pub const LARGEST_PHASE: f64 = 1e5;

/// Why a sphere cannot be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MieError {
    /// The sphere is too small or too large.
    #[error("a particle of size parameter 2π·radius·index/wavelength = {0:.4e} is outside 1e-6..3000")]
    Size(f64),
    /// The index is not that of a passive substance, or extreme.
    #[error("the relative refractive index {0} + {1} i is not computable (n > 0.001, k ≥ 0, |m| x ≤ 1e5)")]
    Index(f64, f64),
}

/// A sphere's coefficients and efficiencies (cross sections over π r²).
#[derive(Clone, Debug)]
pub struct Sphere {
    /// Size parameter.
    pub x: f64,
    /// Scattering efficiency.
    pub q_sca: f64,
    /// Absorption efficiency.
    pub q_abs: f64,
    /// Backscattering efficiency, 4 |S(180°)|²/x².
    pub q_back: f64,
    /// Mean cosine of the scattering angle.
    pub g: f64,
    /// (2n+1)/(n(n+1)) (a_n + b_n)/2 and (a_n - b_n)/2 for n = 1, 2, …
    sums: Vec<[C; 2]>,
}

/// Number of terms: Wiscombe (1980, Appl. Opt. 19, 1505) with a few more, since they cost nothing.
fn terms(x: f64) -> usize {
    (x + 4.05 * x.cbrt() + 8.0) as usize
}

/// D_0 … D_count of a complex argument, downward from where an error at the start has died out.
fn logarithmic_derivatives(z: C, count: usize) -> Vec<C> {
    let start = (count as f64).max(z.norm() + 8.0 * z.norm().cbrt()) as usize + 16;
    let mut out = vec![C::default(); count + 1];
    let mut d = C::default();
    for n in (1..=start).rev() {
        let ratio = n as f64 / z;
        // Far below any other term: keeps a zero of ψ, should it be met exactly, from being divided by.
        d = ratio - (d + ratio + 1e-150).inv();
        if n - 1 <= count {
            out[n - 1] = d;
        }
    }
    out
}

/// ψ_0 … ψ_count and χ_0 … χ_count of a real argument, Riccati–Bessel functions with Bohren & Huffman's sign,
/// ψ_0 = sin x, χ_0 = cos x.
fn riccati_bessel(x: f64, count: usize) -> [Vec<f64>; 2] {
    let (mut psi, mut chi) = (vec![0.0; count + 1], vec![0.0; count + 1]);
    let (sin, cos) = x.sin_cos();
    (psi[0], chi[0]) = (sin, cos);
    // The functions of order -1.
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
    /// The sphere of size parameter `x` and index `m` relative to the host, m.im ≥ 0.
    ///
    /// # Errors
    /// [`MieError`] outside [`SIZES`], and for an index that is not a passive substance's.
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
            // Rounding of the last digit of A may leave a transparent sphere a hair below zero.
            q_abs: (2.0 * abs / x2).max(0.0),
            q_back: back.norm_sqr() / x2,
            g: 2.0 * cosine / sca,
            sums,
        })
    }

    /// Extinction efficiency.
    #[must_use]
    pub fn q_ext(&self) -> f64 {
        self.q_sca + self.q_abs
    }

    /// How many terms the series has.
    #[must_use]
    pub fn terms(&self) -> usize {
        self.sums.len()
    }

    /// S1 and S2 in a direction whose [`angular`] functions, at least [`Self::terms`] of them, are given.
    #[must_use]
    pub fn amplitudes_with(&self, angular: &[[f64; 2]]) -> [C; 2] {
        let (mut even, mut odd) = (C::default(), C::default());
        for ([sum, difference], [plus, minus]) in self.sums.iter().zip(angular) {
            even += sum * *plus;
            odd += difference * *minus;
        }
        [even + odd, even - odd]
    }

    /// S1 and S2 at a cosine of the scattering angle.
    #[must_use]
    pub fn amplitudes(&self, cos: f64) -> [C; 2] {
        let mut table = vec![];
        angular(cos, self.terms(), &mut table);
        self.amplitudes_with(&table)
    }
}

/// π_n + τ_n and π_n - τ_n for n = 1 … count at a cosine of the scattering angle (Bohren & Huffman 4.47), into `out`.
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

/// S11, S12, S33, S34 of two amplitudes, in the convention at the head of this file.
#[must_use]
pub fn matrix([s1, s2]: [C; 2]) -> [f64; 4] {
    let (i1, i2) = (s1.norm_sqr(), s2.norm_sqr());
    let cross = s1.conj() * s2;
    [0.5 * (i1 + i2), 0.5 * (i1 - i2), cross.re, cross.im]
}

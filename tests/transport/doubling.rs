//! Polarized light in a plane-parallel slab by doubling, in f64: what the tracer's slabs are held against.
//!
//! Hansen & Travis (1974, Space Sci. Rev. 16, 527), sect. 3.1, and de Haan, Bosma & Hovenier (1987, A&A 183, 371), with
//! the project's signs. z is the normal of the slab; a direction of travel has cosine ±μ against it and azimuth φ; its
//! Stokes frame has the horizontal (-sin φ, cos φ, 0) as its first axis, the perpendicular of the meridian plane, at the
//! pole too. With the phase matrix Z per steradian, ∫ Z00 dω = 1,
//!
//!     ±μ dI/dz = -I + ϖ ∫ Z(d, d') I(d') dω',   z in units of the mean free path.
//!
//! Azimuth by Fourier series, Z = Σ Z^m exp(imφ). Z is even in φ in the blocks that join (I, Q) to themselves and (U, V)
//! to themselves, and odd between them, so that diag(1, 1, i, i) Z^m diag(1, 1, -i, -i) is real: these are the matrices
//! below. μ by Gauss's rule on 0..1; directions of interest are nodes more, of weight 0. A layer is its kernels R and T
//! of diffuse light, e.g. for light that comes from above, I_up(i) = Σ_j R(i, j) w_j I(j), and the factor exp(-τ/μ) of
//! what goes straight through. Turned upside down, a homogeneous layer has X R X and X T X, X = diag(1, 1, -1, -1),
//! since mirroring in a horizontal plane leaves the first axis of a frame and turns the second.

use crate::optics::{M, assert_close, turn};
use glam::DVec3;
use std::f64::consts::{PI, TAU};
use sunstone::medium::scattered::Elements;

/// A square matrix by rows.
#[derive(Clone)]
struct Square {
    n: usize,
    v: Vec<f64>,
}

impl Square {
    fn from_fn(n: usize, f: impl Fn(usize, usize) -> f64) -> Self {
        Self {
            n,
            v: (0..n * n).map(|k| f(k / n, k % n)).collect(),
        }
    }

    fn at(&self, i: usize, j: usize) -> f64 {
        self.v[i * self.n + j]
    }

    /// Entry (i, j) of the result is that of `self` times f(i, j).
    fn times(&self, f: impl Fn(usize, usize) -> f64) -> Self {
        Self::from_fn(self.n, |i, j| self.at(i, j) * f(i, j))
    }

    fn plus(&self, other: &Self) -> Self {
        let v = self.v.iter().zip(&other.v).map(|(a, b)| a + b).collect();
        Self { n: self.n, v }
    }

    fn dot(&self, other: &Self) -> Self {
        let n = self.n;
        let mut v = vec![0.0; n * n];
        for (row, out) in self.v.chunks_exact(n).zip(v.chunks_exact_mut(n)) {
            for (a, other) in row.iter().zip(other.v.chunks_exact(n)) {
                for (o, b) in out.iter_mut().zip(other) {
                    *o += a * b;
                }
            }
        }
        Self { n, v }
    }

    /// X of (1 - self) X = right, by elimination with pivots.
    fn solve_one_minus(&self, mut right: Self) -> Self {
        let n = self.n;
        let mut a = Self::from_fn(n, |i, j| f64::from(u8::from(i == j)) - self.at(i, j));
        for k in 0..n {
            let pivot = (k..n).max_by(|i, j| a.at(*i, k).abs().total_cmp(&a.at(*j, k).abs()));
            let pivot = pivot.expect("a row");
            for m in [&mut a, &mut right] {
                for j in 0..n {
                    m.v.swap(k * n + j, pivot * n + j);
                }
            }
            for i in (0..n).filter(|i| *i != k) {
                let f = a.at(i, k) / a.at(k, k);
                if f != 0.0 {
                    for m in [&mut a, &mut right] {
                        let (low, high) = m.v.split_at_mut(k.max(i) * n);
                        let (from, to) = if i > k {
                            (&low[k * n..k * n + n], &mut high[..n])
                        } else {
                            (&high[..n], &mut low[i * n..i * n + n])
                        };
                        for (t, s) in to.iter_mut().zip(from) {
                            *t -= f * s;
                        }
                    }
                }
            }
        }
        right.times(|i, _| 1.0 / a.at(i, i))
    }
}

/// Nodes and weights of Gauss's rule on 0..1.
pub fn gauss(count: usize) -> Vec<(f64, f64)> {
    let node = |i: usize| {
        let n = count as f64;
        let mut x = (PI * (i as f64 + 0.75) / (n + 0.5)).cos();
        loop {
            let (mut before, mut p) = (1.0, x);
            for k in 2..=count {
                let k = k as f64;
                (before, p) = (p, ((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k);
            }
            let slope = n * (before - x * p) / (1.0 - x * x);
            x -= p / slope;
            if (p / slope).abs() < 1e-15 {
                return (0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * slope * slope));
            }
        }
    };
    (0..count).map(node).collect()
}

/// A scattering matrix per steradian as a function of the cosine of the scattering angle.
pub type Scattering<'a> = &'a dyn Fn(f64) -> Elements<f64>;

/// The direction of travel of signed cosine `mu` against z and azimuth `phi`.
pub fn direction(mu: f64, phi: f64) -> DVec3 {
    let s = (1.0 - mu * mu).max(0.0).sqrt();
    DVec3::new(s * phi.cos(), s * phi.sin(), mu)
}

/// The first axis of the Stokes frame of a direction of that azimuth.
pub fn horizontal(phi: f64) -> DVec3 {
    DVec3::new(-phi.sin(), phi.cos(), 0.0)
}

/// The scattering matrix between directions of travel, each with the first axis of its frame: `[d, x]` of what leaves, and
/// of what enters.
pub fn scattered(scattering: Scattering, [d, x]: [DVec3; 2], [d_in, x_in]: [DVec3; 2]) -> M {
    let e = scattering(d.dot(d_in).clamp(-1.0, 1.0));
    #[rustfmt::skip]
    let matrix = M::new(
        e.s11, e.s12, 0., 0.,
        e.s12, e.s22, 0., 0.,
        0., 0., e.s33, e.s34,
        0., 0., -e.s34, e.s44,
    );
    let s = d_in.cross(d);
    // Straight on and straight back every plane is the scattering plane.
    let s = if s.length() > 1e-9 { s.normalize() } else { x_in };
    turn(d, s, x) * matrix * turn(d_in, x_in, s)
}

/// The same between directions of signed cosine and azimuth, in the frames of their azimuths.
fn phase_matrix(scattering: Scattering, out: [f64; 2], into: [f64; 2]) -> M {
    let [out, into] = [out, into].map(|[mu, phi]| [direction(mu, phi), horizontal(phi)]);
    scattered(scattering, out, into)
}

/// Sign with which X = diag(1, 1, -1, -1) meets entry (i, j).
fn mirror(i: usize, j: usize) -> f64 {
    if (i % 4 < 2) == (j % 4 < 2) { 1.0 } else { -1.0 }
}

/// One term of the Fourier series: kernels of diffuse light, 4 rows and columns a node.
#[derive(Clone)]
struct Mode {
    order: usize,
    reflect: Square,
    transmit: Square,
}

/// A homogeneous slab with nothing behind it.
pub struct Slab {
    /// Cosines of the nodes, and their weights (0: a direction of interest).
    nodes: Vec<(f64, f64)>,
    pub tau: f64,
    modes: Vec<Mode>,
}

impl Slab {
    /// Of optical depth `tau` and single-scattering albedo `albedo`, with `count` nodes of Gauss's rule and the cosines
    /// `of_interest` (> 0), keeping the given `orders` of the Fourier series. `halvings`: the slab is doubled so often
    /// from its thinnest layer.
    pub fn new(
        scattering: Scattering,
        [tau, albedo]: [f64; 2],
        count: usize,
        of_interest: &[f64],
        orders: &[usize],
        halvings: i32,
    ) -> Self {
        let mut nodes = gauss(count);
        nodes.extend(of_interest.iter().map(|mu| (*mu, 0.0)));
        let thin = tau * 0.5_f64.powi(halvings);
        let phases = fourier(scattering, &nodes, orders);
        let modes = orders.iter().zip(phases).map(|(order, phase)| {
            let mut layer = thinnest(*order, &phase, &nodes, thin, albedo);
            for k in 0..halvings {
                layer = doubled(&layer, &nodes, thin * 2.0_f64.powi(k));
            }
            layer
        });
        let modes = modes.collect();
        Self { nodes, tau, modes }
    }

    fn node(&self, mu: f64) -> usize {
        let at = self.nodes.iter().position(|(node, _)| *node == mu);
        at.expect("a direction of interest")
    }

    /// Σ_m of the series at an azimuth of the light that leaves, over 2π: radiance per unit irradiance of a plane
    /// perpendicular to the light that enters.
    fn series(&self, kernel: impl Fn(&Mode) -> &Square, mu: f64, mu_in: f64, phi: f64) -> M {
        let (i, j) = (4 * self.node(mu), 4 * self.node(mu_in));
        let mut sum = M::zeros();
        for mode in &self.modes {
            let (m, k) = (mode.order as f64, kernel(mode));
            let twice = if mode.order == 0 { 1.0 } else { 2.0 };
            let (sin, cos) = (m * phi).sin_cos();
            sum += M::from_fn(|a, b| {
                // The sine's sign undoes diag(1, 1, i, i).
                let part = match (a < 2, b < 2) {
                    (true, false) => -sin,
                    (false, true) => sin,
                    _ => cos,
                };
                twice * part * k.at(i + a, j + b) / TAU
            });
        }
        sum
    }

    /// Radiance that leaves upward, where light comes down, per unit irradiance perpendicular to it; `phi` from the
    /// azimuth of travel of the one to that of the other.
    pub fn reflected(&self, mu: f64, mu_in: f64, phi: f64) -> M {
        self.series(|m| &m.reflect, mu, mu_in, phi)
    }

    /// Radiance of the diffuse light that leaves downward.
    pub fn transmitted(&self, mu: f64, mu_in: f64, phi: f64) -> M {
        self.series(|m| &m.transmit, mu, mu_in, phi)
    }

    /// Power that leaves up and down (diffuse light and what went straight through) over what enters.
    pub fn shares(&self, mu_in: f64) -> [f64; 2] {
        let zeroth = self.modes.iter().find(|m| m.order == 0).expect("order 0");
        let j = 4 * self.node(mu_in);
        let share = |k: &Square| {
            let flux = |(i, (mu, w)): (usize, &(f64, f64))| mu * w * k.at(4 * i, j);
            self.nodes.iter().enumerate().map(flux).sum::<f64>() / mu_in
        };
        [
            share(&zeroth.reflect),
            share(&zeroth.transmit) + (-self.tau / mu_in).exp(),
        ]
    }
}

/// For each order, 2π times its part of the phase matrix: light that goes down stays so, and is turned back.
fn fourier(scattering: Scattering, nodes: &[(f64, f64)], orders: &[usize]) -> Vec<[Square; 2]> {
    let last = orders.iter().copied().max().unwrap_or(0);
    let around = (16 * last).clamp(32, 256);
    let n = 4 * nodes.len();
    let zero = || Square::from_fn(n, |_, _| 0.0);
    let mut out: Vec<_> = orders.iter().map(|_| [zero(), zero()]).collect();
    for (k, (i, j)) in
        (0..2 * nodes.len() * nodes.len()).map(|k| (k, (k / 2 / nodes.len(), k / 2 % nodes.len())))
    {
        let up = if k % 2 == 0 { -1.0 } else { 1.0 };
        for step in 0..around {
            let phi = TAU * (step as f64 + 0.5) / around as f64;
            let z = phase_matrix(scattering, [up * nodes[i].0, phi], [-nodes[j].0, 0.0]);
            for (order, parts) in orders.iter().zip(&mut out) {
                let (sin, cos) = (*order as f64 * phi).sin_cos();
                for (a, b) in (0..16).map(|e| (e / 4, e % 4)) {
                    let part = match (a < 2, b < 2) {
                        (true, false) => -sin,
                        (false, true) => sin,
                        _ => cos,
                    };
                    parts[k % 2].v[(4 * i + a) * n + 4 * j + b] += part * z[(a, b)] * TAU / around as f64;
                }
            }
        }
    }
    out
}

/// A layer so thin that the light inside may be taken for the mean of what enters and leaves (Wiscombe 1976,
/// "diamond"): with G = δ/2μ and the phase matrices P of both hemispheres, leaving light is ((1 - G)/(1 + G) + B w) of the
/// entering, B = (1 + G - G P w)⁻¹ G P (1 + (1 - G)/(1 + G)).
fn thinnest(order: usize, [on, back]: &[Square; 2], nodes: &[(f64, f64)], thin: f64, albedo: f64) -> Mode {
    let half = 4 * nodes.len();
    let g = |i: usize| 0.5 * thin / nodes[i % half / 4].0;
    let w = |j: usize| nodes[j % half / 4].1;
    // Light that goes down, then light that goes up.
    let gp = Square::from_fn(2 * half, |i, j| {
        let (a, b) = (i % half, j % half);
        let upside_down = if j < half { 1.0 } else { mirror(i, j) };
        let part = if (i < half) == (j < half) { on } else { back };
        g(i) * albedo * upside_down * part.at(a, b)
    });
    // (1 + G)⁻¹ on either side of what is to be solved.
    let kernel = gp.times(|i, j| w(j) / (1.0 + g(i)));
    let right = gp.times(|i, j| 2.0 / ((1.0 + g(j)) * (1.0 + g(i))));
    let b = kernel.solve_one_minus(right);
    Mode {
        order,
        reflect: Square::from_fn(half, |i, j| b.at(half + i, j)),
        transmit: Square::from_fn(half, |i, j| b.at(i, j)),
    }
}

/// Two equal layers, each of optical depth `tau`, one upon the other (Hansen & Travis 1974, eq. 3.10): with light D that
/// goes down and U that goes up between them,
/// U = R E + R w D, D = T + X R X w U.
fn doubled(layer: &Mode, nodes: &[(f64, f64)], tau: f64) -> Mode {
    let (r, t) = (&layer.reflect, &layer.transmit);
    let e = |i: usize| (-tau / nodes[i / 4].0).exp();
    let w = |j: usize| nodes[j / 4].1;
    let from_below = r.times(|i, j| mirror(i, j) * w(j));
    let r_weighted = r.times(|_, j| w(j));
    let right = t.plus(&from_below.dot(&r.times(|_, j| e(j))));
    let down = from_below.dot(&r_weighted).solve_one_minus(right);
    let up = r.times(|_, j| e(j)).plus(&r_weighted.dot(&down));
    let t_from_below = t.times(|i, j| mirror(i, j) * w(j));
    Mode {
        order: layer.order,
        reflect: r.plus(&up.times(|i, _| e(i))).plus(&t_from_below.dot(&up)),
        transmit: down
            .times(|i, _| e(i))
            .plus(&t.times(|_, j| e(j)))
            .plus(&t.times(|_, j| w(j)).dot(&down)),
    }
}

/// Rayleigh's matrix per steradian.
pub fn rayleigh(mu: f64) -> Elements<f64> {
    let unit = 3.0 / (16.0 * PI);
    Elements {
        s11: unit * (1.0 + mu * mu),
        s12: unit * (1.0 - mu * mu),
        s22: unit * (1.0 + mu * mu),
        s33: unit * 2.0 * mu,
        s34: 0.0,
        s44: unit * 2.0 * mu,
    }
}

/// I, Q, U of light that leaves the top of a Rayleigh slab of τ = 0.5 over a black ground under a sun of flux π at
/// cos θ0 = 0.2, to all digits of the tables of Coulson, Dave & Sekera (1960) as computed anew by Natraj, Li & Yung
/// (2009, ApJ 691, 1909); the signs of Q and U are those of the frames here.
#[test]
fn doubling_gives_coulsons_table() {
    let mu0 = 0.2;
    let slab = Slab::new(&rayleigh, [0.5, 1.0], 24, &[mu0, 0.02, 0.4, 1.0], &[0, 1, 2], 18);
    for (phi, mu, want) in [
        (0.0, 0.02, [0.441_298_02, -0.017_531_41, 0.0]),
        (0.0, 0.4, [0.168_890_20, 0.011_195_11, 0.0]),
        (0.0, 1.0, [0.053_004_96, 0.037_558_59, 0.0]),
        (60.0, 0.02, [0.300_912_08, -0.159_656_01, -0.073_655_28]),
        (60.0, 0.4, [0.127_524_50, -0.060_660_38, -0.052_938_67]),
        (60.0, 1.0, [0.053_004_96, -0.018_779_30, -0.032_526_69]),
    ] {
        let m: M = slab.reflected(mu, mu0, f64::to_radians(phi)) * PI;
        for (i, want) in want.into_iter().enumerate() {
            let got = m[(i, 0)];
            assert!(
                (got - want).abs() < 2e-8,
                "{phi}°, μ = {mu}, s{i}: {got} is not {want}"
            );
        }
        assert!(m[(3, 0)].abs() < 1e-12, "dipoles make no circular light");
    }
}

/// Generalized spherical functions d^l_mn for l = 2 … 11, n = ±2 (Hovenier, van der Mee & Domke 2004, app. B).
fn wigner(m: f64, n: f64, first: f64, mu: f64) -> Vec<f64> {
    let (mut before, mut d) = (0.0, first);
    let mut out = vec![];
    for l in 2..=11 {
        out.push(d);
        let l = f64::from(l);
        let root = |l: f64| ((l * l - m * m) * (l * l - n * n)).sqrt();
        let next = ((2.0 * l + 1.0) * (l * (l + 1.0) * mu - m * n) * d - (l + 1.0) * root(l) * before)
            / (l * root(l + 1.0));
        (before, d) = (d, next);
    }
    out
}

/// Siewert's (2000, JQSRT 64, 227) problem IIA: randomly oriented oblate spheroids, by the expansion coefficients that
/// are printed there (α1, β1, α2, α3, α4, β2 for l = 0 … 11).
fn spheroids(mu: f64) -> Elements<f64> {
    const A1: [f64; 12] = [
        1.0, 2.104_031, 2.095_158, 1.414_939, 0.703_593, 0.235_001, 0.064_039, 0.012_837, 0.002_010,
        0.000_246, 0.000_024, 0.000_002,
    ];
    const A4: [f64; 12] = [
        0.915_207, 2.095_727, 2.008_624, 1.436_545, 0.706_244, 0.238_475, 0.056_448, 0.009_703, 0.001_267,
        0.000_130, 0.000_011, 0.000_001,
    ];
    const A2: [f64; 10] = [
        3.726_079, 2.202_868, 1.190_694, 0.391_203, 0.105_556, 0.020_484, 0.003_097, 0.000_366, 0.000_035,
        0.000_003,
    ];
    const A3: [f64; 10] = [
        3.615_946, 2.240_516, 1.139_473, 0.365_605, 0.082_779, 0.013_649, 0.001_721, 0.000_172, 0.000_014,
        0.000_001,
    ];
    const B1: [f64; 10] = [
        -0.116_688, -0.209_370, -0.227_137, -0.144_524, -0.052_640, -0.012_400, -0.002_093, -0.000_267,
        -0.000_027, -0.000_002,
    ];
    const B2: [f64; 10] = [
        0.065_456, 0.221_658, 0.097_752, 0.052_458, 0.009_239, 0.001_411, 0.000_133, 0.000_011, 0.000_001,
        0.0,
    ];
    let mut legendre = [1.0, mu, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    for l in 2..12 {
        let n = l as f64;
        legendre[l] = ((2.0 * n - 1.0) * mu * legendre[l - 1] - (n - 1.0) * legendre[l - 2]) / n;
    }
    let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / (4.0 * PI);
    let both = |sign: f64| A2.iter().zip(A3).map(|(a, b)| a + sign * b).collect::<Vec<_>>();
    let plus = sum(&both(1.0), &wigner(2.0, 2.0, 0.25 * (1.0 + mu).powi(2), mu));
    let minus = sum(&both(-1.0), &wigner(2.0, -2.0, 0.25 * (1.0 - mu).powi(2), mu));
    let d02 = wigner(0.0, 2.0, 6.0_f64.sqrt() / 4.0 * (1.0 - mu * mu), mu);
    Elements {
        s11: sum(&A1, &legendre),
        s12: sum(&B1, &d02),
        s22: 0.5 * (plus + minus),
        s33: 0.5 * (plus - minus),
        s34: sum(&B2, &d02),
        s44: sum(&A4, &legendre),
    }
}

/// Siewert's tables of that problem: I, Q, U that leave the top for τ = 1, ϖ = 0.973527, sun of flux π at cos θ0 = 0.6.
/// Six different elements of the matrix take part.
#[test]
fn doubling_gives_siewerts_tables() {
    let mu0 = 0.6;
    let orders: Vec<usize> = (0..=11).collect();
    let slab = Slab::new(
        &spheroids,
        [1.0, 0.973_527],
        14,
        &[mu0, 1.0, 0.5, 0.2],
        &orders,
        16,
    );
    for (phi, mu, want) in [
        (0.0, 1.0, [0.050_687_3, -0.002_623_88, 0.0]),
        (0.0, 0.5, [0.339_136, -0.028_224_2, 0.0]),
        (0.0, 0.2, [0.751_295, -0.063_856_1, 0.0]),
        (180.0, 0.5, [0.068_410_6, 0.001_962_15, 0.0]),
        (180.0, 0.2, [0.080_152_3, 0.002_437_40, 0.0]),
        (90.0, 1.0, [0.050_687_3, 0.002_623_88, 0.0]),
        (90.0, 0.5, [0.124_626, 0.005_121_23, 0.008_041_40]),
        (90.0, 0.2, [0.169_216, 0.006_962_60, 0.009_122_19]),
    ] {
        let m: M = slab.reflected(mu, mu0, f64::to_radians(phi)) * PI;
        for (i, want) in want.into_iter().enumerate() {
            let got = m[(i, 0)];
            // Half a unit of the last printed digit, and of the coefficients' too.
            let tolerance = 1e-6 * f64::abs(want) + if i == 0 { 6e-7 } else { 6e-8 };
            assert!(
                (got - want).abs() < tolerance,
                "{phi}°, μ = {mu}, s{i}: {got} is not {want}"
            );
        }
    }
}

/// Light that seeps through a thick Rayleigh slab leaves it as out of Chandrasekhar's atmosphere with a constant net flux
/// (Radiative Transfer, 1950, table XXIV: intensities in and across the meridian plane).
#[test]
fn thick_slabs_end_as_chandrasekhars_atmosphere() {
    let table = [
        (0.1, [0.242_47, 0.281_50]),
        (0.2, [0.290_57, 0.323_81]),
        (0.4, [0.380_10, 0.403_88]),
        (0.6, [0.466_24, 0.481_65]),
        (0.8, [0.550_87, 0.558_44]),
        (1.0, [0.634_69, 0.634_69]),
    ];
    let mus = table.map(|row| row.0);
    let interest = [&mus[..], &[0.5]].concat();
    let slab = Slab::new(&rayleigh, [64.0, 1.0], 16, &interest, &[0], 22);
    let of = |mu: f64| {
        let m = slab.transmitted(mu, 0.5, 0.0);
        [m[(0, 0)] - m[(1, 0)], m[(0, 0)] + m[(1, 0)]]
    };
    let unit = table[5].1[0] / of(1.0)[0];
    for (mu, want) in table {
        for (got, want) in of(mu).into_iter().zip(want) {
            assert!(
                (got * unit - want).abs() < 2e-5,
                "μ = {mu}: {} is not {want}",
                got * unit
            );
        }
    }
}

/// Where light is scattered once at most, the closed form; reciprocity and energy where it is scattered often.
#[test]
fn doubling_keeps_its_invariants() {
    let (mu, mu0, phi) = (0.7, 0.3, 1.1);
    let orders: Vec<usize> = (0..=11).collect();
    let tau = 1e-5;
    let thin = Slab::new(&spheroids, [tau, 0.8], 8, &[mu, mu0], &orders, 4);
    for (got, up) in [
        (thin.reflected(mu, mu0, phi), 1.0),
        (thin.transmitted(mu, mu0, phi), -1.0),
    ] {
        let want = phase_matrix(&spheroids, [up * mu, phi], [-mu0, 0.0]) * (0.8 * tau / mu);
        // What is scattered again is some 10 τ.
        assert_close(&got, &want, 2e-4, "single scattering");
    }
    let slab = Slab::new(&spheroids, [3.0, 1.0], 14, &[mu, mu0], &[0, 1, 2], 18);
    let d = M::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, 1.0));
    let back = d * slab.reflected(mu0, mu, -phi).transpose() * d * (mu0 / mu);
    assert_close(
        &slab.reflected(mu, mu0, phi),
        &back,
        1e-6,
        "reciprocity of reflection",
    );
    let back = d * slab.transmitted(mu0, mu, -phi).transpose() * d * (mu0 / mu);
    // Seen from below, upside down.
    let x = M::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, -1.0));
    assert_close(
        &slab.transmitted(mu, mu0, phi),
        &(x * back * x),
        1e-6,
        "reciprocity of transmission",
    );
    let [up, down] = slab.shares(mu0);
    assert!((up + down - 1.0).abs() < 2e-6, "{up} + {down}");
}

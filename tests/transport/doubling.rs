//! Computes polarized light in a plane-parallel slab by doubling, in f64. The result is the reference for the
//! tracer's slabs.
//!
//! The method follows Hansen & Travis (1974, Space Sci. Rev. 16, 527), sect. 3.1, and de Haan, Bosma &
//! Hovenier (1987, A&A 183, 371), with the project's signs. z is the normal of the slab. A direction of
//! travel has the cosine ±μ to the normal and the azimuth φ. The first axis of the Stokes frame of the
//! direction is the horizontal (-sin φ, cos φ, 0), also at the pole. The horizontal is perpendicular to the
//! meridian plane. With the phase matrix Z per steradian, ∫ Z00 dω = 1,
//!
//!     ±μ dI/dz = -I + ϖ ∫ Z(d, d') I(d') dω',   z in units of the mean free path.
//!
//! A Fourier series Z = Σ Z^m exp(imφ) represents the azimuth. Z is even in φ in the blocks that map (I, Q)
//! to themselves and (U, V) to themselves, and odd between the blocks. Therefore, the product diag(1, 1, i,
//! i) Z^m diag(1, 1, -i, -i) is real. The code stores the real products.
//!
//! Gauss's rule on 0..1 discretizes μ. Directions of interest are additional nodes of weight 0.
//!
//! A layer consists of its kernels R and T of diffuse light and the factor exp(-τ/μ) of unscattered light.
//! For example, for light from above, I_up(i) = Σ_j R(i, j) w_j I(j).
//!
//! An inverted homogeneous layer has the kernels X R X and X T X with X = diag(1, 1, -1, -1). The signs of X
//! follow because mirroring in a horizontal plane keeps the first axis of a frame and reverses the second
//! axis.

use crate::optics::{M, turn};
use glam::DVec3;
use std::f64::consts::{PI, TAU};
use sunstone::transport::medium::scattered::Elements;

/// A square matrix, stored row by row.
#[derive(Clone)]
struct Square {
    n: usize,
    v: Vec<f64>,
}

impl Square {
    fn from_fn(n: usize, f: impl Fn(usize, usize) -> f64) -> Self {
        Self { n, v: (0..n * n).map(|k| f(k / n, k % n)).collect() }
    }

    fn at(&self, i: usize, j: usize) -> f64 {
        self.v[i * self.n + j]
    }

    /// Returns a matrix whose entry (i, j) is entry (i, j) of `self` times f(i, j).
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

    /// Returns the solution X of (1 - self) X = right, by Gaussian elimination with pivoting.
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

/// Returns the nodes and weights of Gauss's rule on 0..1.
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

/// Returns the direction of travel with signed cosine `mu` to z and azimuth `phi`.
pub fn direction(mu: f64, phi: f64) -> DVec3 {
    let s = (1.0 - mu * mu).max(0.0).sqrt();
    DVec3::new(s * phi.cos(), s * phi.sin(), mu)
}

/// Returns the first axis of the Stokes frame of a direction with azimuth `phi`.
pub fn horizontal(phi: f64) -> DVec3 {
    DVec3::new(-phi.sin(), phi.cos(), 0.0)
}

/// Returns the scattering matrix between two directions of travel, each with the first axis of its frame.
/// `[d, x]` describes the outgoing light, and `[d_in, x_in]` describes the incoming light.
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
    // In the forward and backward directions, every plane is a scattering plane.
    let s = if s.length() > 1e-9 { s.normalize() } else { x_in };
    turn(d, s, x) * matrix * turn(d_in, x_in, s)
}

/// Returns the scattering matrix between directions that are given by signed cosine and azimuth. The matrix
/// refers to the frames of the azimuths of the two directions.
pub fn phase_matrix(scattering: Scattering, out: [f64; 2], into: [f64; 2]) -> M {
    let [out, into] = [out, into].map(|[mu, phi]| [direction(mu, phi), horizontal(phi)]);
    scattered(scattering, out, into)
}

/// Returns the sign of entry (i, j) under X = diag(1, 1, -1, -1).
fn mirror(i: usize, j: usize) -> f64 {
    if (i % 4 < 2) == (j % 4 < 2) { 1.0 } else { -1.0 }
}

/// One term of the Fourier series: kernels of diffuse light, with 4 rows and columns per node.
#[derive(Clone)]
struct Mode {
    order: usize,
    reflect: Square,
    transmit: Square,
}

/// A homogeneous slab with vacuum behind it.
pub struct Slab {
    /// Cosines and weights of the nodes. A direction of interest has weight 0.
    nodes: Vec<(f64, f64)>,
    pub tau: f64,
    modes: Vec<Mode>,
}

impl Slab {
    /// Returns a slab of optical depth `tau` and single-scattering albedo `albedo`. The nodes are `count`
    /// nodes of Gauss's rule and the cosines `of_interest` (> 0). `orders` lists the orders of the Fourier
    /// series. `halvings` is the number of doublings from the thinnest layer.
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

    /// Returns the sum of the Fourier series over the orders m at an azimuth of the outgoing light, divided
    /// by 2π. The result is the radiance per unit irradiance of a plane perpendicular to the incoming light.
    fn series(&self, kernel: impl Fn(&Mode) -> &Square, mu: f64, mu_in: f64, phi: f64) -> M {
        let (i, j) = (4 * self.node(mu), 4 * self.node(mu_in));
        let mut sum = M::zeros();
        for mode in &self.modes {
            let (m, k) = (mode.order as f64, kernel(mode));
            let twice = if mode.order == 0 { 1.0 } else { 2.0 };
            let (sin, cos) = (m * phi).sin_cos();
            sum += M::from_fn(|a, b| {
                // The sign of the sine cancels diag(1, 1, i, i).
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

    /// Returns the upward radiance under light from above, per unit irradiance perpendicular to that light.
    /// `phi` is the difference between the azimuths of travel.
    pub fn reflected(&self, mu: f64, mu_in: f64, phi: f64) -> M {
        self.series(|m| &m.reflect, mu, mu_in, phi)
    }

    /// Returns the downward radiance of the diffuse light, in the same unit as the upward radiance.
    pub fn transmitted(&self, mu: f64, mu_in: f64, phi: f64) -> M {
        self.series(|m| &m.transmit, mu, mu_in, phi)
    }

    /// Returns the slab under a pane. `pane` returns the reflection and transmission matrices of the pane at
    /// a cosine, from either side. The function does not compute downward light.
    ///
    /// Between slab and pane, U is the upward light, and D = P U is the light that the pane returns. The
    /// light satisfies U = R (1 + w D). This is the adding method for a layer that does not change
    /// directions.
    pub fn under(&self, pane: impl Fn(f64) -> [M; 2]) -> Self {
        let panes: Vec<[M; 2]> = self.nodes.iter().map(|(mu, _)| pane(*mu)).collect();
        let along = |which: usize, weighted: bool| {
            Square::from_fn(4 * self.nodes.len(), |i, j| {
                let weight = if weighted { self.nodes[i / 4].1 } else { 1.0 };
                if i / 4 == j / 4 { weight * panes[i / 4][which][(i % 4, j % 4)] } else { 0.0 }
            })
        };
        let (back, through) = (along(0, true), along(1, false));
        let modes = self.modes.iter().map(|mode| {
            let up = mode.reflect.dot(&back).solve_one_minus(mode.reflect.clone());
            Mode {
                order: mode.order,
                reflect: through.dot(&up).dot(&through),
                transmit: mode.transmit.clone(),
            }
        });
        Self { nodes: self.nodes.clone(), tau: self.tau, modes: modes.collect() }
    }

    /// Returns the power that leaves upward and downward (diffuse and unscattered), divided by the incident
    /// power.
    pub fn shares(&self, mu_in: f64) -> [f64; 2] {
        let zeroth = self.modes.iter().find(|m| m.order == 0).expect("order 0");
        let j = 4 * self.node(mu_in);
        let share = |k: &Square| {
            let flux = |(i, (mu, w)): (usize, &(f64, f64))| mu * w * k.at(4 * i, j);
            self.nodes.iter().enumerate().map(flux).sum::<f64>() / mu_in
        };
        [share(&zeroth.reflect), share(&zeroth.transmit) + (-self.tau / mu_in).exp()]
    }
}

/// Returns 2π times each order of the phase matrix. The first result is for downward light that stays
/// downward, and the second is for downward light that is reversed.
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

/// Returns a layer so thin that the light inside is the mean of entering and leaving light (Wiscombe 1976,
/// "diamond"). Let G = δ/2μ, and let P be the phase matrices of the two hemispheres. The leaving light is
/// `(1 - G)/(1 + G) + B w` times the entering light. The kernel is
/// `B = (1 + G - G P w)⁻¹ G P (1 + (1 - G)/(1 + G))`.
fn thinnest(order: usize, [on, back]: &[Square; 2], nodes: &[(f64, f64)], thin: f64, albedo: f64) -> Mode {
    let half = 4 * nodes.len();
    let g = |i: usize| 0.5 * thin / nodes[i % half / 4].0;
    let w = |j: usize| nodes[j % half / 4].1;
    // Computes downward light, then upward light.
    let gp = Square::from_fn(2 * half, |i, j| {
        let (a, b) = (i % half, j % half);
        let upside_down = if j < half { 1.0 } else { mirror(i, j) };
        let part = if (i < half) == (j < half) { on } else { back };
        g(i) * albedo * upside_down * part.at(a, b)
    });
    // (1 + G)⁻¹ is a factor on each side of the solved system.
    let kernel = gp.times(|i, j| w(j) / (1.0 + g(i)));
    let right = gp.times(|i, j| 2.0 / ((1.0 + g(j)) * (1.0 + g(i))));
    let b = kernel.solve_one_minus(right);
    Mode {
        order,
        reflect: Square::from_fn(half, |i, j| b.at(half + i, j)),
        transmit: Square::from_fn(half, |i, j| b.at(i, j)),
    }
}

/// Returns two stacked equal layers, each of optical depth `tau` (Hansen & Travis 1974, eq. 3.10). Between
/// the layers, the downward light D and the upward light U satisfy U = R E + R w D and D = T + X R X w U.
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
        transmit: down.times(|i, _| e(i)).plus(&t.times(|_, j| e(j))).plus(&t.times(|_, j| w(j)).dot(&down)),
    }
}

/// Returns Rayleigh's scattering matrix per steradian.
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

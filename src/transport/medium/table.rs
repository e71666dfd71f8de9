//! A scattering matrix tabulated by scattering angle for up to four wavelengths, with importance sampling.
//!
//! The grid is uniform in v = sin(θ/2) up to 90°. Above 90°, the grid is mirrored and uniform in cos(θ/2).
//! The grid is nearly uniform in θ (dθ/dv = 2 to 2.8), and computing v takes only one square root. The result
//! v is accurate at both ends, where peaks of large particles are narrower than the resolution of cosθ in
//! f32. S1 and S2 are polynomials in cosθ = 1 - 2v², so all elements are smooth and even functions of v.
//! Interpolation is cubic over four nodes. The node before the first node equals the second node. The grid is
//! doubled until the interpolated matrix halfway between nodes is accurate to [`TOLERANCE`].
//!
//! Directions are sampled with a density that agrees with S11 at the nodes and is linear in cosθ between
//! nodes. A cell is chosen with the alias method (Walker 1977; Vose 1991). The time of the alias method does
//! not depend on the grid size. The method also samples cells of low probability accurately. In the cell, the
//! cumulative distribution is quadratic. With several wavelengths, one wavelength is sampled, and the density
//! is the mean over all wavelengths. Weights are therefore at most about the number of wavelengths.

use super::bulk::Ensemble;
use super::scattered::Angle;
use optics::polarization::fresnel::FresnelBlock;
use optics::sampling::stream::Stream;
use optics::spectrum::{MAX_WAVELENGTHS, Spectral};
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Target interpolation error, relative to S11 at the same angle.
pub const TOLERANCE: f64 = 1e-5;

/// Minimum and maximum number of cells between 0 and 90°.
const CELLS: [usize; 2] = [256, 16_384];

/// A cell of the alias method for one wavelength. The method chooses this cell with probability `keep`, and
/// otherwise chooses the cell `other`.
#[derive(Clone, Copy, Debug, Default)]
struct Alias {
    keep: f32,
    other: u32,
}

/// A tabulated scattering matrix, with data for the forward half and the backward half of the sphere.
#[derive(Clone, Debug)]
pub struct Table {
    /// Number of cells in each half of the sphere.
    cells: usize,
    /// Matrices per steradian at the nodes -1 … cells + 1 of each half.
    nodes: Vec<FresnelBlock>,
    /// Density per steradian at the nodes 0 … cells of each half.
    density: Vec<Spectral>,
    /// Alias cells of the forward half, then of the backward half.
    alias: Vec<[Alias; MAX_WAVELENGTHS]>,
}

/// A position between two nodes of the table.
#[derive(Clone, Copy, Debug)]
struct Lookup {
    backward: bool,
    cell: usize,
    /// Position in the cell, linear in v, in [0, 1].
    fraction: f32,
}

/// Returns cosθ at node `i` of a half that has `cells` cells.
fn cos_at(i: f64, cells: usize, backward: bool) -> f64 {
    let v = i * FRAC_1_SQRT_2 / cells as f64;
    let cos = 1.0 - 2.0 * v * v;
    if backward { -cos } else { cos }
}

/// Returns the weights of cubic (Lagrange) interpolation between nodes -1, 0, 1, 2 at `t` in [0, 1].
#[inline]
fn cubic(t: f32) -> [f32; 4] {
    let (before, after, beyond) = (t + 1.0, 1.0 - t, 2.0 - t);
    [
        -t * after * beyond * (1.0 / 6.0),
        before * after * beyond * 0.5,
        before * t * beyond * 0.5,
        -before * t * after * (1.0 / 6.0),
    ]
}

/// Weights that [`cubic`] returns halfway between two nodes.
const HALF_WAY: [f64; 4] = [-1.0 / 16.0, 9.0 / 16.0, 9.0 / 16.0, -1.0 / 16.0];

/// Elements S11, S12, S33, S34 at nodes 0 … cells + 1 of one half, per wavelength.
type Half = Vec<Vec<[f64; 4]>>;

/// Returns the matrices at the nodes of both halves, and the number of cells.
fn refine(ensembles: &[Ensemble], most: usize) -> ([Half; 2], usize) {
    let mut scratch = vec![];
    let mut matrices = |i: f64, cells: usize, backward: bool| -> Vec<[f64; 4]> {
        let cos = cos_at(i, cells, backward);
        let of = |e: &Ensemble| {
            if e.is_clear() { [0.25 / PI, 0.0, 0.0, 0.0] } else { e.matrix(cos, &mut scratch) }
        };
        ensembles.iter().map(of).collect()
    };
    let mut cells = CELLS[0].min(most);
    let mut halves = [false, true]
        .map(|backward| -> Half { (0..=cells + 1).map(|i| matrices(i as f64, cells, backward)).collect() });
    loop {
        let mut worst = 0.0_f64;
        let between = [0, 1].map(|half| -> Half {
            let middles = (0..=cells).map(|i| matrices(i as f64 + 0.5, cells, half == 1));
            middles.collect()
        });
        for (nodes, middles) in halves.iter().zip(&between) {
            for (i, exact) in middles.iter().enumerate().take(cells) {
                let around = [if i == 0 { 1 } else { i - 1 }, i, i + 1, i + 2];
                for (lane, exact) in exact.iter().enumerate() {
                    for (e, want) in exact.iter().enumerate() {
                        let values = around.iter().map(|n| nodes[*n][lane][e]);
                        let got: f64 = values.zip(HALF_WAY).map(|(v, w)| v * w).sum();
                        worst = worst.max((got - want).abs() / exact[0]);
                    }
                }
            }
        }
        if worst <= TOLERANCE || 2 * cells > most {
            return (halves, cells);
        }
        for (nodes, middles) in halves.iter_mut().zip(between) {
            let mut finer = Vec::with_capacity(2 * cells + 2);
            for (node, middle) in nodes.drain(..).zip(middles) {
                finer.push(node);
                finer.push(middle);
            }
            *nodes = finer;
        }
        cells *= 2;
    }
}

/// Returns the alias table for probabilities that add up to about 1.
fn alias(probabilities: &[f64]) -> Vec<Alias> {
    let total: f64 = probabilities.iter().sum();
    let count = probabilities.len();
    let mut left: Vec<f64> = probabilities.iter().map(|p| p / total * count as f64).collect();
    let mut table: Vec<Alias> = (0..count as u32).map(|i| Alias { keep: 1.0, other: i }).collect();
    let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..count).partition(|i| left[*i] < 1.0);
    while let (Some(s), Some(l)) = (small.pop(), large.last().copied()) {
        table[s] = Alias { keep: left[s] as f32, other: l as u32 };
        left[l] -= 1.0 - left[s];
        if left[l] < 1.0 {
            large.pop();
            small.push(l);
        }
    }
    table
}

impl Table {
    /// Tabulates 1 to 4 ensembles of particles, one per wavelength. An ensemble that does not scatter is
    /// treated as isotropic.
    pub fn new(ensembles: &[Ensemble]) -> Self {
        let lanes = ensembles.len().min(MAX_WAVELENGTHS);
        let ensembles = &ensembles[..lanes];
        let (halves, cells) = refine(ensembles, CELLS[1]);
        let spectral = |node: &[[f64; 4]], e: usize| {
            let lane = |l: usize| node.get(l).map_or(0.0, |m| m[e] as f32);
            Spectral::new([lane(0), lane(1), lane(2), lane(3)])
        };
        let block = |node: &Vec<[f64; 4]>| FresnelBlock {
            a: spectral(node, 0),
            b: spectral(node, 1),
            c: spectral(node, 2),
            d: spectral(node, 3),
        };
        let mut nodes = Vec::with_capacity(2 * (cells + 3));
        for half in &halves {
            nodes.push(block(&half[1]));
            nodes.extend(half.iter().map(block));
        }
        // The solid angle is dω = 2π d(cosθ), and 1 - cosθ = (i/cells)² at node i.
        let solid_angle = |i: usize| 2.0 * PI * (2 * i + 1) as f64 / (cells * cells) as f64;
        let mut density = vec![[0.0_f32; MAX_WAVELENGTHS]; 2 * (cells + 1)];
        let mut table = vec![[Alias::default(); MAX_WAVELENGTHS]; 2 * cells];
        for lane in 0..lanes {
            let mass =
                |half: &Half, i: usize| 0.5 * (half[i][lane][0] + half[i + 1][lane][0]) * solid_angle(i);
            let masses: Vec<f64> = halves.iter().flat_map(|half| (0..cells).map(|i| mass(half, i))).collect();
            let total: f64 = masses.iter().sum();
            for (cell, a) in table.iter_mut().zip(alias(&masses)) {
                cell[lane] = a;
            }
            let at_nodes = halves.iter().flat_map(|half| &half[..=cells]);
            for (d, node) in density.iter_mut().zip(at_nodes) {
                d[lane] = (node[lane][0] / total) as f32;
            }
        }
        Self { cells, nodes, density: density.into_iter().map(Spectral::new).collect(), alias: table }
    }

    pub fn cells(&self) -> usize {
        self.cells
    }

    #[inline]
    fn place(&self, at: Angle) -> Lookup {
        let backward = at.forward > at.backward;
        // v/sin 45° is √(1 - cosθ).
        let i = at.forward.min(at.backward).sqrt() * self.cells as f32;
        let cell = (i as usize).min(self.cells - 1);
        Lookup { backward, cell, fraction: (i - cell as f32).min(1.0) }
    }

    /// Returns the scattering matrix per steradian. The elements a, b, c, d of the block are S11, S12, S33,
    /// S34.
    #[inline]
    pub fn block(&self, at: Angle) -> FresnelBlock {
        self.block_at(self.place(at))
    }

    #[inline]
    fn block_at(&self, p: Lookup) -> FresnelBlock {
        let first = p.cell + if p.backward { self.cells + 3 } else { 0 };
        let n: [&FresnelBlock; 4] = std::array::from_fn(|k| &self.nodes[first + k]);
        let [w0, w1, w2, w3] = cubic(p.fraction).map(Spectral::splat);
        let mix =
            |f: fn(&FresnelBlock) -> Spectral| f(n[0]) * w0 + f(n[1]) * w1 + f(n[2]) * w2 + f(n[3]) * w3;
        let a = mix(|n| n.a).max(Spectral::ZERO);
        let (b, c, d) = (mix(|n| n.b), mix(|n| n.c), mix(|n| n.d));
        // Interpolation may give a degree of polarization slightly above 1. A degree of polarization above 1
        // is scaled back to 1.
        let polarized = (b * b + c * c + d * d).sqrt().max(Spectral::splat(f32::MIN_POSITIVE));
        let f = (a / polarized).min(Spectral::ONE);
        FresnelBlock { a, b: b * f, c: c * f, d: d * f }
    }

    /// Returns the density of [`Self::sample`] per steradian for each lane.
    #[inline]
    pub fn densities(&self, at: Angle) -> Spectral {
        self.density_at(self.place(at))
    }

    #[inline]
    fn density_at(&self, p: Lookup) -> Spectral {
        let first = p.cell + if p.backward { self.cells + 1 } else { 0 };
        let (near, far) = (self.density[first], self.density[first + 1]);
        // The density is linear in cosθ, and 1 - cosθ is proportional to the square of the position.
        let i = p.cell as f32;
        let s = p.fraction * (2.0 * i + p.fraction) / (2.0 * i + 1.0);
        near + (far - near) * Spectral::splat(s)
    }

    /// Samples a scattering angle with the density of lane `lane`.
    #[inline]
    pub fn sample(&self, lane: usize, stream: &mut Stream) -> Angle {
        let count = self.alias.len();
        let mut cell = ((stream.uniform() * count as f32) as usize).min(count - 1);
        let Alias { keep, other } = self.alias[cell][lane];
        if stream.uniform() >= keep {
            cell = other as usize;
        }
        let backward = cell >= self.cells;
        let within = if backward { cell - self.cells } else { cell };
        let first = within + if backward { self.cells + 1 } else { 0 };
        let [near, far] = [first, first + 1].map(|n| self.density[n].to_array()[lane]);
        let u = stream.uniform();
        let root = (near * near + u * (far * far - near * near)).max(0.0).sqrt();
        let s = (u * (near + far) / (near + root).max(f32::MIN_POSITIVE)).min(1.0);
        // Solve (1 - cosθ)·cells² = i² + s (2i + 1).
        let (i, n) = (within as f32, self.cells as f32);
        let at = Angle::of_forward((i * i + s * (2.0 * i + 1.0)) / (n * n));
        if backward { at.supplement() } else { at }
    }
}

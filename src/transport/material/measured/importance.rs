//! Importance sampling of half vectors, in proportion to the reflection of a measured table.
//!
//! A piecewise constant density over the half vector h is tabulated for evenly spaced polar angles θ_o of
//! `wo`. The density is p(h) ∝ M̄(θ_d, θ_h) · cosθ_i · 4 (h·wo), where M̄ is the mean of M00 over φ_d and
//! wavelength. The factor 4 (h·wo) is the Jacobian dω_i/dω_h (Walter et al. 2007, eq. 14).
//!
//! Cells are evenly spaced in azimuth. The azimuth is measured from the plane of wo and n, and p is symmetric
//! about this plane. In the coordinate q = 1 - cosθ_h, cells are narrower at small θ_h. A point that is
//! uniform in (q, φ) in a cell is uniform in solid angle. One of the two adjacent values of θ_o is sampled,
//! with a probability equal to the linear weight of the value. The density is therefore linearly
//! interpolated. Dupuy & Jakob (2018) also sample measured BRDFs from tables.

use super::axes::Axis;
use glam::Vec3A;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// The mean M̄ of the table, by θ_d (rows) and θ_h (columns).
pub(super) struct Mean {
    pub theta_d: Axis,
    pub theta_h: Axis,
    pub values: Vec<f32>,
}

impl Mean {
    #[inline]
    fn at(&self, theta_d: f32, theta_h: f32) -> f32 {
        let (d0, d1, td) = self.theta_d.place(theta_d);
        let (h0, h1, th) = self.theta_h.place(theta_h);
        let columns = self.theta_h.nodes().len();
        let row = |d: usize| {
            let (a, b) = (self.values[d * columns + h0], self.values[d * columns + h1]);
            a + (b - a) * th
        };
        let (a, b) = (row(d0), row(d1));
        a + (b - a) * td
    }
}

/// Tabulated densities of half vectors. In the local frame, z is the normal, and wo is in the xz plane with
/// x ≥ 0.
#[derive(Clone, Debug, Default)]
pub(super) struct Importance {
    /// Number of values of θ_o, evenly spaced from 0 to π/2.
    angles: usize,
    rows: usize,
    columns: usize,
    /// Values of q at the borders of the rows of cells.
    edges: Vec<f32>,
    /// Cumulative sums over the cells of each θ_o, row-major. The last sum is 1.
    sums: Vec<f32>,
}

impl Importance {
    /// Tabulates the density. `entries` are the numbers of table entries along θ_d, θ_h and φ_d. The numbers
    /// of entries determine the number of cells.
    pub fn new(entries: [usize; 3], mean: &Mean) -> Self {
        let [d, h, phi] = entries;
        let (angles, rows, columns) = (d.clamp(8, 32), (2 * h).clamp(16, 64), (phi / 2).clamp(8, 32));
        let edges = (0..=rows).map(|i| {
            let theta = FRAC_PI_2 * (i as f32 / rows as f32).powi(2);
            2.0 * (0.5 * theta).sin().powi(2)
        });
        let mut out = Self {
            angles,
            rows,
            columns,
            edges: edges.collect(),
            sums: Vec::with_capacity(angles * rows * columns),
        };
        for angle in 0..angles {
            let (sin, cos) = (FRAC_PI_2 * angle as f32 / (angles - 1) as f32).sin_cos();
            out.tabulate(Vec3A::new(sin, 0.0, cos.max(0.0)), mean);
        }
        out
    }

    /// Appends the density for one `wo`, averaged over 2 × 2 points per cell.
    fn tabulate(&mut self, wo: Vec3A, mean: &Mean) {
        let point = |q: f32, phi: f32| {
            let h = direction(q, phi);
            let cos = h.dot(wo);
            let cos_i = 2.0 * cos * h.z - wo.z;
            if cos <= 0.0 || cos_i <= 0.0 {
                return 0.0;
            }
            mean.at(cos.min(1.0).acos(), h.z.min(1.0).acos()) * cos_i * cos
        };
        let mut masses = Vec::with_capacity(self.rows * self.columns);
        for row in self.edges.windows(2) {
            let width = row[1] - row[0];
            for column in 0..self.columns {
                let mut sum = 0.0;
                for (a, b) in [(0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75)] {
                    let phi = PI * (column as f32 + b) / self.columns as f32;
                    sum += point(row[0] + a * width, phi);
                }
                masses.push(f64::from(sum * width));
            }
        }
        let mut total: f64 = masses.iter().sum();
        if total <= 0.0 {
            // The table has no reflection for this `wo`, because of holes or near the horizon. Use a uniform
            // density.
            for (mass, cell) in masses.iter_mut().zip(0..) {
                let row = cell / self.columns;
                *mass = f64::from(self.edges[row + 1] - self.edges[row]);
            }
            total = masses.iter().sum();
        }
        let mut sum = 0.0;
        let sums = masses.iter().map(|mass| {
            sum += mass;
            ((sum / total) as f32).min(1.0)
        });
        self.sums.extend(sums);
        if let Some(last) = self.sums.last_mut() {
            *last = 1.0;
        }
    }

    /// Returns the index of the last tabulated θ_o below the polar angle with cosine `cos_o`, and the weight
    /// of the next θ_o.
    #[inline]
    fn angle(&self, cos_o: f32) -> (usize, f32) {
        let x = cos_o.clamp(0.0, 1.0).acos() / FRAC_PI_2 * (self.angles - 1) as f32;
        let i = (x as usize).min(self.angles - 2);
        (i, (x - i as f32).clamp(0.0, 1.0))
    }

    /// Returns the probability of a cell for the tabulated θ_o with index `angle`.
    #[inline]
    fn mass(&self, angle: usize, cell: usize) -> f32 {
        let sums = &self.sums[angle * self.rows * self.columns..];
        sums[cell] - if cell > 0 { sums[cell - 1] } else { 0.0 }
    }

    /// Returns the density of [`Self::sample`] per solid angle of the local half vector `h`.
    #[inline]
    pub fn pdf(&self, cos_o: f32, h: Vec3A) -> f32 {
        let q = (h.x * h.x + h.y * h.y) / (1.0 + h.z);
        let row = self.edges[1..self.rows].partition_point(|e| *e <= q);
        let share = h.y.abs().atan2(h.x) / PI;
        let column = ((share * self.columns as f32) as usize).min(self.columns - 1);
        let (angle, t) = self.angle(cos_o);
        let cell = row * self.columns + column;
        let mass = (1.0 - t) * self.mass(angle, cell) + t * self.mass(angle + 1, cell);
        let area = (self.edges[row + 1] - self.edges[row]) * (TAU / self.columns as f32);
        mass / area
    }

    /// Samples a local half vector. `u` are uniform random numbers in [0, 1), for θ_o, the cell, q and φ.
    #[inline]
    pub fn sample(&self, cos_o: f32, u: [f32; 4]) -> Vec3A {
        let (angle, t) = self.angle(cos_o);
        let angle = angle + usize::from(u[0] < t);
        let cells = self.rows * self.columns;
        let sums = &self.sums[angle * cells..(angle + 1) * cells];
        let cell = sums.partition_point(|s| *s <= u[1]).min(cells - 1);
        let (row, column) = (cell / self.columns, cell % self.columns);
        let q = self.edges[row] + u[2] * (self.edges[row + 1] - self.edges[row]);
        // Select one of the two symmetric halves of azimuth.
        let (side, within) = if u[3] < 0.5 { (1.0, 2.0 * u[3]) } else { (-1.0, 2.0 * u[3] - 1.0) };
        direction(q, side * PI * (column as f32 + within) / self.columns as f32)
    }
}

/// Returns the direction with q = 1 - cosθ and azimuth φ.
#[inline]
fn direction(q: f32, phi: f32) -> Vec3A {
    let r = (q * (2.0 - q)).max(0.0).sqrt();
    let (s, c) = phi.sin_cos();
    Vec3A::new(r * c, r * s, 1.0 - q)
}

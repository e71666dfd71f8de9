//! An image of the sky all around: radiance by direction, drawn in proportion to its brightness.
//!
//! Equirectangular: the column runs with atan2(x, -z)/2π and the row with acos(y)/π of a direction in the sky's own frame,
//! from the top (Mitsuba's `envmap`). Values between texels are mixed from four. Directions are drawn from a table that is
//! constant over each texel: its brightness, smoothed with its neighbours so that wherever there is light some is drawn,
//! times the solid angle (Pharr et al. 2023, sect. 12.5.2).

use super::drawn::Drawn;
use super::filter::Polarized;
use glam::{Mat3A, Vec3A};
use optics::spectrum::{Spectral, max_lane};
use std::f32::consts::{PI, TAU};

/// An image of the sky.
#[derive(Clone, Debug)]
pub struct Sky {
    width: usize,
    height: usize,
    /// Radiances, top row first, W/(m² sr nm).
    texels: Vec<[f32; 4]>,
    /// Share of all weight up to the end of each row, and within each row up to the end of each column.
    rows: Vec<f32>,
    columns: Vec<f32>,
    /// World to the sky's own frame.
    to_local: Mat3A,
    /// Its frame and filter.
    pub polarized: Polarized,
}

impl Sky {
    /// Of `width` × `height` texels, top row first; `to_world` turns its own frame. `None` if it is black.
    #[must_use]
    pub fn new(
        [width, height]: [usize; 2],
        texels: Vec<[f32; 4]>,
        to_world: Mat3A,
        polarized: Polarized,
    ) -> Option<Self> {
        let bright = |i: usize, j: usize| max_lane(Spectral::new(texels[j * width + i]));
        let weight = |i: usize, j: usize| {
            let mut sum = 0.0;
            for dj in [height - 1, 0, 1] {
                let row = if dj == height - 1 {
                    j.saturating_sub(1)
                } else {
                    (j + dj).min(height - 1)
                };
                for di in [width - 1, 0, 1] {
                    sum += bright((i + di) % width, row);
                }
            }
            let theta = PI * (j as f32 + 0.5) / height as f32;
            f64::from(sum * theta.sin())
        };
        let (mut rows, mut columns, mut all) = (vec![], vec![], 0.0);
        for j in 0..height {
            let mut row = 0.0;
            let start = columns.len();
            for i in 0..width {
                row += weight(i, j);
                columns.push(row);
            }
            for c in &mut columns[start..] {
                *c /= if row > 0.0 { row } else { 1.0 };
            }
            all += row;
            rows.push(all);
        }
        (all > 0.0 && all.is_finite()).then(|| Self {
            width,
            height,
            texels,
            rows: rows.iter().map(|r| (r / all) as f32).collect(),
            columns: columns.iter().map(|c| *c as f32).collect(),
            to_local: to_world.transpose(),
            polarized,
        })
    }

    /// Width and height in texels.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Radiances, top row first, W/(m² sr nm).
    #[must_use]
    pub fn texels(&self) -> &[[f32; 4]] {
        &self.texels
    }

    /// Turns the sky's own frame to the world.
    #[must_use]
    pub fn to_world(&self) -> Mat3A {
        self.to_local.transpose()
    }

    /// Column and row, continuous, of a unit direction.
    #[inline]
    fn place(&self, dir: Vec3A) -> [f32; 2] {
        let d = self.to_local * dir;
        let turn = d.x.atan2(-d.z) / TAU;
        [
            turn.rem_euclid(1.0) * self.width as f32,
            d.y.clamp(-1.0, 1.0).acos() / PI * self.height as f32,
        ]
    }

    /// Radiance from a unit direction.
    #[inline]
    #[must_use]
    pub fn radiance(&self, dir: Vec3A) -> Spectral {
        let [x, y] = self.place(dir).map(|v| v - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let at = |i: f32, j: f32| {
            let i = (i as i64).rem_euclid(self.width as i64) as usize;
            let j = (j as i64).clamp(0, self.height as i64 - 1) as usize;
            Spectral::new(self.texels[j * self.width + i])
        };
        let lerp = |a: Spectral, b: Spectral, t: f32| a + (b - a) * Spectral::splat(t);
        let top = lerp(at(x0, y0), at(x0 + 1.0, y0), fx);
        let bottom = lerp(at(x0, y0 + 1.0), at(x0 + 1.0, y0 + 1.0), fx);
        lerp(top, bottom, fy)
    }

    /// Density of [`Self::sample`] per steradian.
    #[inline]
    #[must_use]
    pub fn density(&self, dir: Vec3A) -> f32 {
        let [x, y] = self.place(dir);
        let (i, j) = (
            (x as usize).min(self.width - 1),
            (y as usize).min(self.height - 1),
        );
        let below = |list: &[f32], k: usize| list[k] - if k > 0 { list[k - 1] } else { 0.0 };
        let row = &self.columns[j * self.width..(j + 1) * self.width];
        let share = below(&self.rows, j) * below(row, i);
        let sin = (PI * y / self.height as f32).sin();
        // dω = sinθ dθ dφ.
        share * (self.width * self.height) as f32 / (PI * TAU * sin.max(1e-6))
    }

    /// Draws a direction.
    #[inline]
    #[must_use]
    pub fn sample(&self, [u, v]: [f32; 2]) -> Vec3A {
        let choose = |list: &[f32], u: f32| {
            let k = list.partition_point(|end| *end <= u).min(list.len() - 1);
            let start = if k > 0 { list[k - 1] } else { 0.0 };
            let within = (u - start) / (list[k] - start).max(f32::MIN_POSITIVE);
            k as f32 + within.clamp(0.0, 0.999_999)
        };
        let y = choose(&self.rows, v);
        let j = y as usize;
        let x = choose(&self.columns[j * self.width..(j + 1) * self.width], u);
        let (theta, phi) = (PI * y / self.height as f32, TAU * x / self.width as f32);
        let (sin, cos) = theta.sin_cos();
        // The columns of the frame's transpose are its rows.
        (self.to_local.transpose() * Vec3A::new(sin * phi.sin(), cos, -sin * phi.cos())).normalize()
    }

    /// Draws light toward `p`; it comes from `far` metres away. `chance`: with which the sky is drawn at all.
    #[inline]
    pub(super) fn draw(&self, p: Vec3A, u: [f32; 2], far: f32, chance: f32) -> Option<Drawn> {
        let wi = self.sample(u);
        let density = chance * self.density(wi);
        let radiance = self.radiance(wi);
        (density > 0.0 && radiance != Spectral::ZERO).then(|| Drawn {
            wi,
            position: p + wi * far,
            distance: far,
            irradiance: radiance * Spectral::splat(1.0 / density),
            density,
            start_m: f64::INFINITY,
            polarized: self.polarized,
        })
    }
}

//! An environment map: radiance by direction, with importance sampling by brightness.
//!
//! The map is equirectangular. In local axes, the column is proportional to atan2(x, -z)/2π. The row, counted
//! from the top, is proportional to acos(y)/π (as in Mitsuba's `envmap`). [`Rows`] defines the positions of
//! the rows. Interpolation between texels is bilinear and periodic along the rows.
//!
//! Directions are sampled from a table with a constant weight per cell. The weight is the maximum brightness
//! of all texels that contribute to the cell, times the solid angle of the cell (Pharr et al. 2023, sect.
//! 12.5.2). The density is therefore positive wherever the map has light.

use super::Drawn;
use super::filter::Polarized;
use crate::material::texture::bilinear;
use glam::{Mat3A, Vec3A};
use optics::spectrum::{Spectral, max_lane};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f32::consts::{PI, TAU};

/// Positions of the rows of an environment map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Rows {
    /// Row j of h rows is at polar angle π (j + ½)/h, as in OpenEXR's latitude-longitude maps. The values of
    /// the first and the last row extend to the poles.
    #[default]
    Centres,
    /// Row j of h rows is at polar angle π j/(h - 1). The first and the last row are at the poles, as in
    /// Mitsuba's `envmap`.
    Poles,
}

#[derive(Clone, Debug)]
pub struct Sky {
    width: usize,
    height: usize,
    placed: Rows,
    /// Number of cells of the sampling table along the polar angle.
    cells: usize,
    /// Radiance of each texel, top row first, W/(m² sr nm).
    pub texels: Vec<[f32; 4]>,
    /// Cumulative fraction of the total weight at the end of each row, and at the end of each column within a
    /// row.
    rows: Vec<f32>,
    columns: Vec<f32>,
    /// Rotation or reflection from world axes to the map's local axes.
    to_local: Mat3A,
    pub polarized: Polarized,
}

impl Sky {
    /// Creates a map of `width` × `height` texels, top row first. `to_world` maps local axes to world axes
    /// and may include a reflection. Returns `None` if the map is black.
    pub fn new(
        [width, height]: [usize; 2],
        texels: Vec<[f32; 4]>,
        placed: Rows,
        to_world: Mat3A,
        polarized: Polarized,
    ) -> Option<Self> {
        // A map with a single row is constant from pole to pole.
        let placed = if height == 1 { Rows::Centres } else { placed };
        let cells = match placed {
            Rows::Centres => height,
            Rows::Poles => height - 1,
        };
        let bright = |i: usize, j: usize| max_lane(Spectral::new(texels[j * width + i]));
        let weight = |i: usize, j: usize| {
            let mut sum = 0.0;
            let rows = match placed {
                Rows::Centres => j.saturating_sub(1)..=(j + 1).min(height - 1),
                Rows::Poles => j..=j + 1,
            };
            for row in rows {
                for di in [width - 1, 0, 1] {
                    sum += bright((i + di) % width, row);
                }
            }
            let theta = PI * (j as f32 + 0.5) / cells as f32;
            f64::from(sum * theta.sin())
        };
        let (mut rows, mut columns, mut all) = (vec![], vec![], 0.0);
        for j in 0..cells {
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
            placed,
            cells,
            texels,
            rows: rows.iter().map(|r| (r / all) as f32).collect(),
            columns: columns.iter().map(|c| *c as f32).collect(),
            to_local: to_world.transpose(),
            polarized,
        })
    }

    /// Returns width and height in texels.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    pub fn rows(&self) -> Rows {
        self.placed
    }

    /// Returns the rotation or reflection from the map's local axes to world axes.
    pub fn to_world(&self) -> Mat3A {
        self.to_local.transpose()
    }

    /// Returns the position of a unit direction in the map as a continuous column and row, in cells.
    #[inline]
    fn place(&self, dir: Vec3A) -> [f32; 2] {
        let d = self.to_local * dir;
        let turn = d.x.atan2(-d.z) / TAU;
        [turn.rem_euclid(1.0) * self.width as f32, d.y.clamp(-1.0, 1.0).acos() / PI * self.cells as f32]
    }

    /// Returns the radiance from a unit direction, W/(m² sr nm).
    #[inline]
    pub fn radiance(&self, dir: Vec3A) -> Spectral {
        let [x, y] = self.place(dir);
        let x = x - 0.5;
        let y = match self.placed {
            Rows::Centres => y - 0.5,
            Rows::Poles => y,
        };
        let at = |i: f32, j: f32| {
            let i = (i as i64).rem_euclid(self.width as i64) as usize;
            let j = (j as i64).clamp(0, self.height as i64 - 1) as usize;
            Spectral::new(self.texels[j * self.width + i])
        };
        bilinear(x, y, at)
    }

    /// Returns the probability density of [`Self::sample`] per steradian.
    #[inline]
    pub fn density(&self, dir: Vec3A) -> f32 {
        let [x, y] = self.place(dir);
        let (i, j) = ((x as usize).min(self.width - 1), (y as usize).min(self.cells - 1));
        let below = |list: &[f32], k: usize| list[k] - if k > 0 { list[k - 1] } else { 0.0 };
        let row = &self.columns[j * self.width..(j + 1) * self.width];
        let share = below(&self.rows, j) * below(row, i);
        let sin = (PI * y / self.cells as f32).sin();
        // The solid angle is dω = sinθ dθ dφ.
        share * (self.width * self.cells) as f32 / (PI * TAU * sin.max(1e-6))
    }

    #[inline]
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
        let (theta, phi) = (PI * y / self.cells as f32, TAU * x / self.width as f32);
        let (sin, cos) = theta.sin_cos();
        // The transpose of `to_local` maps local to world axes.
        (self.to_local.transpose() * Vec3A::new(sin * phi.sin(), cos, -sin * phi.cos())).normalize()
    }

    /// Samples light from the sky at point `p`. The light starts at a distance of `far` metres from `p`.
    /// `chance` is the probability of sampling the sky.
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

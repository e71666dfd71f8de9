//! Ends paths. These functions append the elements of a finished [`Chain`] that can be non-zero to a list.

use super::chain::{Chain, rotate_row, row_times_block};
use super::extent::Extent;
use super::frame::turn;
use super::scatter::Scatter;
use crate::spectrum::Spectral;
use glam::Vec3A;

impl Chain {
    /// Ends the path at an emitter. Appends to `elements`, row by row, the elements that can be non-zero.
    #[inline]
    pub fn finish(&self, elements: &mut Vec<Spectral>) -> Extent {
        let (rows, cols) = match self {
            Self::RankOne { column_flat, row_flat, .. } => {
                (if *column_flat { 1 } else { 4 }, if *row_flat { 1 } else { 4 })
            }
            _ => (4, 4),
        };
        match self {
            Self::RankOne { column, row, .. } => {
                for c in &column[..rows] {
                    elements.extend(row[..cols].iter().map(|r| *c * *r));
                }
            }
            Self::Full(m) => elements.extend_from_slice(m.m.as_flattened()),
            Self::Rotation { .. } => elements.extend_from_slice(self.to_mueller().m.as_flattened()),
        }
        Extent { rows: rows as u32, cols: cols as u32 }
    }

    /// Ends the path as [`Self::finish`] does, after one more interaction. The interaction is followed by a
    /// factor and a rotation (cos 2θ, sin 2θ) of the frame of incident light. The chain is not copied.
    /// `d_out` and `frame` are as in [`Self::push`].
    #[inline]
    pub fn finish_scattered(
        &self,
        scatter: &Scatter,
        d_out: Vec3A,
        frame: Vec3A,
        factor: Spectral,
        (c2, s2): (f32, f32),
        elements: &mut Vec<Spectral>,
    ) -> Extent {
        let frame_out = match scatter {
            Scatter::Fresnel { s, .. } => *s,
            Scatter::Full { frame_out, .. } => *frame_out,
            Scatter::Depolarize(f) => return self.finish_depolarized(*f * factor, elements),
        };
        let (c_out, s_out) = turn(d_out, frame_out, frame);
        let pass = |row: &[Spectral; 4]| {
            let mut row = *row;
            rotate_row(&mut row, Spectral::splat(c_out), Spectral::splat(s_out));
            let mut row = match scatter {
                Scatter::Fresnel { block, .. } => row_times_block(&row, block),
                Scatter::Full { mueller, .. } => mueller.row_times(&row),
                Scatter::Depolarize(_) => row,
            };
            for element in &mut row {
                *element *= factor;
            }
            rotate_row(&mut row, Spectral::splat(c2), Spectral::splat(s2));
            row
        };
        let rows = match self {
            Self::RankOne { column, row, column_flat, .. } => {
                let row = pass(row);
                let rows = if *column_flat { 1 } else { 4 };
                for c in &column[..rows] {
                    elements.extend_from_slice(&[*c * row[0], *c * row[1], *c * row[2], *c * row[3]]);
                }
                rows
            }
            Self::Full(m) => {
                for row in &m.m {
                    elements.extend_from_slice(&pass(row));
                }
                4
            }
            Self::Rotation { .. } => {
                for row in &self.to_mueller().m {
                    elements.extend_from_slice(&pass(row));
                }
                4
            }
        };
        Extent { rows: rows as u32, cols: 4 }
    }

    /// Ends the path as [`Self::finish`] does, after one more depolarizing interaction of factor `f`. The
    /// chain is not copied.
    #[inline]
    pub fn finish_depolarized(&self, f: Spectral, elements: &mut Vec<Spectral>) -> Extent {
        let rows = match self {
            Self::RankOne { column, row, column_flat, .. } => {
                let g = row[0] * f;
                let rows = if *column_flat { 1 } else { 4 };
                elements.extend(column[..rows].iter().map(|c| *c * g));
                rows
            }
            Self::Rotation { f: g, .. } => {
                elements.push(*g * f);
                1
            }
            Self::Full(m) => {
                elements.extend(m.m.iter().map(|row| row[0] * f));
                4
            }
        };
        Extent { rows: rows as u32, cols: 1 }
    }
}

//! The product of the Mueller matrices along a path, in the most compact exact form.
//!
//! A path is traced from the camera, so the product is extended on the right: `chain ← chain · (next
//! interaction)`. A depolarizing interaction has the matrix f·e₀e₀ᵀ with a factor f per wavelength. After a
//! depolarizing interaction, the product is the outer product of a column (camera side) and a row (projector
//! side). The column and the row together have 8 numbers instead of 16. Usually, only the first number of the
//! column and the first number of the row are non-zero.

use super::frame::turn;
use super::fresnel::FresnelBlock;
use super::mueller::Mueller;
use super::scatter::Scatter;
use crate::spectrum::{Spectral, max_lane};
use glam::Vec3A;

/// The product of all previous interactions. The product maps Stokes vectors from the frame of light arriving
/// along the current ray to the camera frame.
#[derive(Clone, Copy, Debug)]
pub enum Chain {
    /// A factor times a frame rotation (cos 2θ, sin 2θ), for a path without polarizing or depolarizing
    /// interactions so far.
    Rotation { f: Spectral, cos2: f32, sin2: f32 },
    /// A general Mueller matrix.
    Full(Mueller),
    /// The outer product column · rowᵀ.
    RankOne {
        column: [Spectral; 4],
        row: [Spectral; 4],
        /// True if only element 0 of the column is non-zero.
        column_flat: bool,
        /// True if the row is (1, 0, 0, 0).
        row_flat: bool,
    },
}

#[inline]
pub(super) fn rotate_row(row: &mut [Spectral; 4], c: Spectral, s: Spectral) {
    let (a, b) = (row[1], row[2]);
    row[1] = c * a - s * b;
    row[2] = s * a + c * b;
}

#[inline]
pub(super) fn row_times_block(row: &[Spectral; 4], m: &FresnelBlock) -> [Spectral; 4] {
    [
        row[0] * m.a + row[1] * m.b,
        row[0] * m.b + row[1] * m.a,
        row[2] * m.c - row[3] * m.d,
        row[2] * m.d + row[3] * m.c,
    ]
}

impl Chain {
    /// Returns the product at the start of a path: the identity in the camera frame, scaled per lane.
    #[inline]
    pub fn start(f: Spectral) -> Self {
        Self::Rotation { f, cos2: 1.0, sin2: 0.0 }
    }

    /// Multiplies the product by R(θ) on the right. Afterwards the product acts on Stokes vectors in a
    /// frame whose rotation by θ gives the previous frame (see [`Mueller::rotate_in`]).
    #[inline]
    pub fn rotate_in(&mut self, c2: f32, s2: f32) {
        match self {
            // R(a)·R(b) = R(a + b).
            Self::Rotation { cos2, sin2, .. } => {
                (*cos2, *sin2) = (*cos2 * c2 - *sin2 * s2, *sin2 * c2 + *cos2 * s2);
            }
            Self::Full(m) => m.rotate_in(c2, s2),
            Self::RankOne { row, row_flat, .. } => {
                if !*row_flat {
                    rotate_row(row, Spectral::splat(c2), Spectral::splat(s2));
                }
            }
        }
    }

    /// Multiplies the product by an interaction, in place. `d_out` is the direction in which light leaves the
    /// interaction, and `frame` is the current frame of this light. Returns the frame of the incident light,
    /// or `None` if the interaction depolarizes and any frame is therefore valid.
    #[inline]
    pub fn push(&mut self, scatter: &Scatter, d_out: Vec3A, frame: Vec3A) -> Option<Vec3A> {
        match scatter {
            Scatter::Depolarize(f) => {
                self.depolarize(*f);
                None
            }
            Scatter::Fresnel { block, s } => {
                let (c2, s2) = turn(d_out, *s, frame);
                self.rotate_in(c2, s2);
                self.push_block(block);
                Some(*s)
            }
            Scatter::Full { mueller, frame_out, frame_in } => {
                let (c2, s2) = turn(d_out, *frame_out, frame);
                self.rotate_in(c2, s2);
                self.push_full(mueller);
                Some(*frame_in)
            }
        }
    }

    /// Multiplies the product by [`Scatter::Depolarize`] as [`Self::push`] does. Any frame is valid
    /// afterwards.
    #[inline]
    pub fn depolarize(&mut self, f: Spectral) {
        let z = Spectral::ZERO;
        let flat = [Spectral::ONE, z, z, z];
        match self {
            Self::RankOne { column, row, column_flat, row_flat } => {
                let mut g = f;
                // The row of a depolarizing interaction is already (1, 0, 0, 0).
                if !*row_flat {
                    g *= row[0];
                    *row = flat;
                    *row_flat = true;
                }
                for c in &mut column[..if *column_flat { 1 } else { 4 }] {
                    *c *= g;
                }
            }
            Self::Rotation { f: g, .. } => {
                *self =
                    Self::RankOne { column: [*g * f, z, z, z], row: flat, column_flat: true, row_flat: true };
            }
            Self::Full(m) => {
                *self = Self::RankOne {
                    column: [m.m[0][0] * f, m.m[1][0] * f, m.m[2][0] * f, m.m[3][0] * f],
                    row: flat,
                    column_flat: false,
                    row_flat: true,
                };
            }
        }
    }

    #[inline]
    fn push_block(&mut self, b: &FresnelBlock) {
        if matches!(self, Self::Rotation { .. }) {
            *self = Self::Full(self.to_mueller());
        }
        match self {
            Self::RankOne { row, row_flat, .. } => {
                *row = row_times_block(row, b);
                *row_flat = false;
            }
            Self::Full(m) => {
                for row in &mut m.m {
                    *row = row_times_block(row, b);
                }
            }
            Self::Rotation { .. } => {}
        }
    }

    #[inline]
    fn push_full(&mut self, b: &Mueller) {
        match self {
            Self::RankOne { row, row_flat, .. } => {
                *row = b.row_times(row);
                *row_flat = false;
            }
            Self::Full(m) => {
                for row in &mut m.m {
                    *row = b.row_times(row);
                }
            }
            Self::Rotation { .. } => *self = Self::Full(self.to_mueller() * *b),
        }
    }

    /// Multiplies the product on the right by the transpose of another product, which was built from the
    /// emitter with transposed interactions. The two products must have the same frame for the light between
    /// the subpaths.
    #[inline]
    pub fn times_transposed(&mut self, other: &Self) {
        let dot =
            |a: &[Spectral; 4], b: &[Spectral; 4]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
        if let Self::Rotation { f, cos2, sin2 } = other {
            self.rotate_in(*cos2, -*sin2);
            self.scale(*f);
            return;
        }
        *self = match (&*self, other) {
            (
                Self::RankOne { column, row, column_flat, .. },
                Self::RankOne { column: far, row: between, column_flat: far_flat, .. },
            ) => {
                let g = dot(row, between);
                Self::RankOne {
                    column: column.map(|c| c * g),
                    row: *far,
                    column_flat: *column_flat,
                    row_flat: *far_flat,
                }
            }
            (Self::RankOne { column, row, column_flat, .. }, other) => {
                let m = other.to_mueller().m;
                Self::RankOne {
                    column: *column,
                    row: std::array::from_fn(|j| dot(row, &m[j])),
                    column_flat: *column_flat,
                    row_flat: false,
                }
            }
            (own, Self::RankOne { column: far, row: between, column_flat: far_flat, .. }) => {
                let m = own.to_mueller().m;
                Self::RankOne {
                    column: std::array::from_fn(|i| dot(&m[i], between)),
                    row: *far,
                    column_flat: false,
                    row_flat: *far_flat,
                }
            }
            (own, other) => Self::Full(own.to_mueller() * other.to_mueller().transposed()),
        };
    }

    /// Returns D · self · D with D = diag(1, 1, -1, 1). The result is the transpose of the product for light
    /// in the opposite direction (see [`Scatter::reversed`]).
    #[inline]
    pub fn mirrored(&self) -> Self {
        let mut out = *self;
        match &mut out {
            Self::Rotation { sin2, .. } => *sin2 = -*sin2,
            Self::Full(m) => m.mirror(),
            Self::RankOne { column, row, .. } => {
                column[2] = -column[2];
                row[2] = -row[2];
            }
        }
        out
    }

    #[inline]
    pub fn scale(&mut self, f: Spectral) {
        match self {
            Self::Rotation { f: g, .. } => *g *= f,
            Self::Full(m) => *m = m.scaled(f),
            Self::RankOne { column, .. } => *column = column.map(|c| c * f),
        }
    }

    /// Returns the maximum M00 over the lanes, for Russian roulette.
    #[inline]
    pub fn max_m00(&self) -> f32 {
        max_lane(self.m00())
    }

    /// Returns true if M00 is 0 at all wavelengths.
    #[inline(always)]
    pub fn is_dark(&self) -> bool {
        self.m00().simd_eq(Spectral::ZERO).all()
    }

    #[inline(always)]
    fn m00(&self) -> Spectral {
        match self {
            Self::Rotation { f, .. } => *f,
            Self::Full(m) => m.m[0][0],
            Self::RankOne { column, row, .. } => column[0] * row[0],
        }
    }

    #[inline]
    pub fn to_mueller(&self) -> Mueller {
        match self {
            Self::Rotation { f, cos2, sin2 } => {
                let (c, s) = (*f * Spectral::splat(*cos2), *f * Spectral::splat(*sin2));
                let z = Spectral::ZERO;
                Mueller { m: [[*f, z, z, z], [z, c, s, z], [z, -s, c, z], [z, z, z, *f]] }
            }
            Self::Full(m) => *m,
            Self::RankOne { column, row, .. } => Mueller { m: column.map(|c| row.map(|r| c * r)) },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polarization::elements::{depolarizer, polarizer, retarder};
    use crate::polarization::extent::Extent;
    use crate::polarization::fresnel::{FresnelBlock, conductor};

    fn block(cos: f32) -> FresnelBlock {
        conductor(cos, Spectral::new([0.4, 1.5, 0.2, 2.0]), Spectral::splat(2.5))
    }

    /// Returns the direction perpendicular to the z axis at an angle in degrees from x.
    fn at(deg: f32) -> Vec3A {
        let (s, c) = deg.to_radians().sin_cos();
        Vec3A::new(c, s, 0.0)
    }

    fn fresnel(cos: f32, deg: f32) -> Scatter {
        Scatter::Fresnel { block: block(cos), s: at(deg) }
    }

    fn full() -> Scatter {
        let mueller = retarder(0.3, 1.1) * polarizer(1.0) * block(0.6).to_mueller();
        Scatter::Full { mueller, frame_out: at(40.0), frame_in: at(-65.0) }
    }

    /// Verifies that every form of a chain equals the product of 4×4 matrices.
    #[test]
    fn chain_equals_plain_products() {
        let d = Vec3A::Z;
        let gray = Spectral::new([0.5, 0.6, 0.7, 0.8]);
        let steps = [
            fresnel(0.3, 20.0),
            fresnel(0.7, 75.0),
            Scatter::Depolarize(gray),
            fresnel(0.5, -30.0),
            fresnel(0.9, 110.0),
            full(),
            Scatter::Depolarize(gray),
        ];
        for first in 0..steps.len() {
            for last in first..=steps.len() {
                let (mut chain, mut frame) = (Chain::start(Spectral::ONE), at(5.0));
                let mut plain = Mueller::identity();
                for step in &steps[first..last] {
                    match step {
                        Scatter::Depolarize(f) => plain = plain * depolarizer().scaled(*f),
                        Scatter::Fresnel { block, s } => {
                            let (c2, s2) = turn(d, *s, frame);
                            plain.rotate_in(c2, s2);
                            plain = plain * block.to_mueller();
                        }
                        Scatter::Full { mueller, frame_out, .. } => {
                            let (c2, s2) = turn(d, *frame_out, frame);
                            plain.rotate_in(c2, s2);
                            plain = plain * *mueller;
                        }
                    }
                    frame = chain.push(step, d, frame).unwrap_or(frame);
                }
                let check = |elements: &[Spectral], got: Extent, plain: &Mueller| {
                    let (rows, cols) = (got.rows as usize, got.cols as usize);
                    assert_eq!(elements.len(), rows * cols);
                    for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))) {
                        if i < rows && j < cols {
                            let diff = elements[i * cols + j] - plain.m[i][j];
                            assert!(max_lane(diff.abs()) < 1e-6, "{first}..{last} [{i}][{j}]");
                        } else {
                            assert_eq!(plain.m[i][j], Spectral::ZERO);
                        }
                    }
                };
                let mut elements = vec![];
                let got = chain.finish(&mut elements);
                check(&elements, got, &plain);
                for step in &steps[1..] {
                    let (mut ended, mut whole) = (chain, vec![]);
                    let after = ended.push(step, d, frame).unwrap_or(frame);
                    ended.scale(gray);
                    let (c2, s2) = turn(d, at(77.0), after);
                    ended.rotate_in(c2, s2);
                    let got = ended.finish(&mut whole);
                    let mut ended = Mueller { m: [[Spectral::ZERO; 4]; 4] };
                    for (i, row) in whole.chunks_exact(got.cols as usize).enumerate() {
                        ended.m[i][..row.len()].copy_from_slice(row);
                    }
                    let mut elements = vec![];
                    let got = chain.finish_scattered(step, d, frame, gray, (c2, s2), &mut elements);
                    check(&elements, got, &ended);
                }
                elements.clear();
                let got = chain.finish_depolarized(gray, &mut elements);
                check(&elements, got, &(plain * depolarizer().scaled(gray)));
            }
        }
    }

    /// Verifies that a product built from both ends equals a product built from one end, for every position
    /// at which the two parts are joined.
    #[test]
    fn products_from_both_ends_equal_products_from_one() {
        let d = Vec3A::Z;
        let full = full();
        let flat = Scatter::Depolarize(Spectral::splat(0.7));
        for steps in [
            vec![fresnel(0.3, 20.0), full, fresnel(0.7, 75.0)],
            vec![full, flat, fresnel(0.4, 10.0), full],
            vec![fresnel(0.4, 10.0), flat, full, flat, full],
            vec![flat, flat],
            vec![],
        ] {
            let (start, end) = (at(5.0), at(-50.0));
            let whole = {
                let (mut chain, mut frame) = (Chain::start(Spectral::splat(2.0)), start);
                for step in &steps {
                    frame = chain.push(step, d, frame).unwrap_or(frame);
                }
                let (c2, s2) = turn(d, end, frame);
                chain.rotate_in(c2, s2);
                chain.to_mueller()
            };
            for meet in 0..=steps.len() {
                let (mut chain, mut frame) = (Chain::start(Spectral::splat(2.0)), start);
                for step in &steps[..meet] {
                    frame = chain.push(step, d, frame).unwrap_or(frame);
                }
                let (mut light, mut far) = (Chain::start(Spectral::ONE), end);
                for step in steps[meet..].iter().rev() {
                    far = light.push(&step.transposed(), d, far).unwrap_or(far);
                }
                let (c2, s2) = turn(d, far, frame);
                chain.rotate_in(c2, s2);
                chain.times_transposed(&light);
                let got = chain.to_mueller();
                for i in 0..16 {
                    let diff = got.m[i / 4][i % 4] - whole.m[i / 4][i % 4];
                    assert!(max_lane(diff.abs()) < 2e-6, "{} steps, meet at {meet}", steps.len());
                }
            }
        }
    }
}

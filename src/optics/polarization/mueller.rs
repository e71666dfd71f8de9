//! 4×4 Mueller matrices, one per wavelength lane.

use crate::spectrum::Spectral;
use std::ops::{Add, Mul};

/// A Mueller matrix per wavelength lane, `m[out][in]`. The code that uses a matrix documents its frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mueller {
    /// Elements `[out][in]`, each for all wavelengths.
    pub m: [[Spectral; 4]; 4],
}

impl Default for Mueller {
    fn default() -> Self {
        Self::ZERO
    }
}

impl Mueller {
    /// Replaces the matrix by D · self · D with D = diag(1, 1, -1, 1). This replacement flips the second axes
    /// of both frames.
    #[inline]
    pub fn mirror(&mut self) {
        for k in [0, 1, 3] {
            self.m[2][k] = -self.m[2][k];
            self.m[k][2] = -self.m[k][2];
        }
    }

    #[inline]
    pub fn transposed(&self) -> Self {
        Self { m: std::array::from_fn(|i| std::array::from_fn(|j| self.m[j][i])) }
    }

    pub const ZERO: Self = Self { m: [[Spectral::ZERO; 4]; 4] };

    /// Returns the matrix with the same real elements in every lane.
    #[inline]
    pub fn splat(rows: [[f32; 4]; 4]) -> Self {
        Self { m: rows.map(|row| row.map(Spectral::splat)) }
    }

    #[inline]
    pub fn identity() -> Self {
        let mut m = Self::ZERO;
        for i in 0..4 {
            m.m[i][i] = Spectral::ONE;
        }
        m
    }

    #[inline]
    pub fn lane(&self, lane: usize) -> [[f32; 4]; 4] {
        self.m.map(|row| row.map(|e| e.to_array()[lane]))
    }

    #[inline]
    pub fn scaled(&self, f: Spectral) -> Self {
        let mut out = *self;
        // Use a loop, because the compiler does not inline closures of nested array maps.
        for e in out.m.as_flattened_mut() {
            *e *= f;
        }
        out
    }

    /// Applies the matrix to a Stokes vector, `out[i] = Σ_j m[i][j] s[j]`.
    #[inline]
    pub fn apply(&self, s: [Spectral; 4]) -> [Spectral; 4] {
        self.m.map(|row| row[0] * s[0] + row[1] * s[1] + row[2] * s[2] + row[3] * s[3])
    }

    /// Returns a row vector times the matrix, `out[j] = Σ_i row[i] m[i][j]`.
    #[inline]
    pub fn row_times(&self, row: &[Spectral; 4]) -> [Spectral; 4] {
        let m = &self.m;
        std::array::from_fn(|j| row[0] * m[0][j] + row[1] * m[1][j] + row[2] * m[2][j] + row[3] * m[3][j])
    }

    /// Multiplies the matrix by R(θ) on the left. This multiplication rotates the outgoing frame by θ (M' =
    /// R(θ_out) M R(-θ_in)). The arguments are cos 2θ and sin 2θ.
    #[inline]
    pub fn rotate_out(&mut self, cos2: f32, sin2: f32) {
        let (c, s) = (Spectral::splat(cos2), Spectral::splat(sin2));
        for j in 0..4 {
            let (a, b) = (self.m[1][j], self.m[2][j]);
            self.m[1][j] = c * a + s * b;
            self.m[2][j] = c * b - s * a;
        }
    }

    /// Multiplies the matrix by R(θ) on the right. Afterwards the matrix acts on Stokes vectors in a frame
    /// whose rotation by θ gives the previous incoming frame.
    #[inline]
    pub fn rotate_in(&mut self, cos2: f32, sin2: f32) {
        let (c, s) = (Spectral::splat(cos2), Spectral::splat(sin2));
        for row in &mut self.m {
            let (a, b) = (row[1], row[2]);
            row[1] = c * a - s * b;
            row[2] = s * a + c * b;
        }
    }
}

impl Mul for Mueller {
    type Output = Self;
    /// Multiplies two matrices. Light interacts with the right factor first.
    #[inline]
    fn mul(self, rhs: Self) -> Self {
        Self { m: self.m.map(|row| rhs.row_times(&row)) }
    }
}

impl Add for Mueller {
    type Output = Self;
    #[inline]
    fn add(mut self, rhs: Self) -> Self {
        for i in 0..4 {
            for j in 0..4 {
                self.m[i][j] += rhs.m[i][j];
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polarization::elements::rotator;

    #[test]
    fn rotations_are_products_with_the_rotator() {
        let mut m = Mueller::splat([[1., 2., 3., 4.], [5., 6., 7., 8.], [9., 1., 2., 3.], [4., 5., 6., 7.]]);
        let t = 0.3_f32;
        let (s, c) = (2.0 * t).sin_cos();
        let (left, right) = (rotator(t) * m, m * rotator(t));
        let mut r = m;
        r.rotate_out(c, s);
        m.rotate_in(c, s);
        for i in 0..4 {
            for j in 0..4 {
                assert!((r.lane(0)[i][j] - left.lane(0)[i][j]).abs() < 1e-5);
                assert!((m.lane(0)[i][j] - right.lane(0)[i][j]).abs() < 1e-5);
            }
        }
    }
}

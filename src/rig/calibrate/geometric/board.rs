//! The target: a chessboard.

use super::fault::Fault;
use nalgebra::Vector3;

/// A chessboard with squares of one size. Corners are those between four squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Board {
    /// Inner corners along x: one less than squares.
    pub columns: usize,
    /// Inner corners along y.
    pub rows: usize,
    /// Side of a square, metres.
    pub square: f64,
}

/// Most corners along a side: more are a mistake.
const MOST: usize = 1000;

impl Board {
    /// A board.
    ///
    /// # Errors
    /// [`Fault::Board`] if it has fewer than 3 × 3 corners, too many, or no size.
    pub fn new(columns: usize, rows: usize, square: f64) -> Result<Self, Fault> {
        let sane = (3..=MOST).contains(&columns) && (3..=MOST).contains(&rows);
        if sane && square.is_finite() && square > 0.0 {
            Ok(Self {
                columns,
                rows,
                square,
            })
        } else {
            Err(Fault::Board {
                columns,
                rows,
                square,
            })
        }
    }

    /// Number of corners.
    #[must_use]
    pub fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// Never: a board has corners.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Where its corners are, row by row, metres: the first at the origin, x along the columns, y along the rows, and z away
    /// from who looks at its front.
    #[must_use]
    pub fn points(&self) -> Vec<Vector3<f64>> {
        let at = |i: usize| Vector3::new((i % self.columns) as f64, (i / self.columns) as f64, 0.0);
        (0..self.len()).map(|i| at(i) * self.square).collect()
    }
}

//! The calibration target, which is a chessboard.

use super::fault::Fault;
use nalgebra::Vector3;

/// A chessboard with squares of equal size. The corners of the board are the points where four squares meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Board {
    /// Number of inner corners along x, one less than the number of squares.
    pub columns: usize,
    /// Number of inner corners along y.
    pub rows: usize,
    /// Side length of a square in metres.
    pub square: f64,
}

/// Maximum number of corners along a side. Larger numbers are rejected as input errors.
const MOST: usize = 1000;

impl Board {
    /// Creates a board.
    ///
    /// # Errors
    /// Returns [`Fault::Board`] if the square size is invalid, or if the board has too many corners or fewer
    /// than 3 × 3.
    pub fn new(columns: usize, rows: usize, square: f64) -> Result<Self, Fault> {
        let sane = (3..=MOST).contains(&columns) && (3..=MOST).contains(&rows);
        if sane && square.is_finite() && square > 0.0 {
            Ok(Self { columns, rows, square })
        } else {
            Err(Fault::Board { columns, rows, square })
        }
    }

    pub fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// Always returns false, because every board has corners.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the positions of the corners row by row, in metres.
    ///
    /// The first corner is the origin. x increases with the column, y with the row, and z points away from
    /// the viewer.
    pub fn points(&self) -> Vec<Vector3<f64>> {
        let at = |i: usize| Vector3::new((i % self.columns) as f64, (i / self.columns) as f64, 0.0);
        (0..self.len()).map(|i| at(i) * self.square).collect()
    }
}

//! The elements of a Mueller matrix that can be non-zero, so that only these are stored.

/// The part of a finished product that can be non-zero: its first `rows` rows and `cols` columns, 1 or 4 of
/// each. The product maps projector-frame Stokes in to camera-frame Stokes out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Stokes elements out: 1 or 4.
    pub rows: u32,
    /// Stokes elements in: 1 or 4.
    pub cols: u32,
}

impl Extent {
    #[inline]
    pub fn count(self) -> usize {
        (self.rows * self.cols) as usize
    }

    /// Returns the smallest extent that contains both.
    #[inline]
    pub fn with(self, other: Self) -> Self {
        Self { rows: self.rows.max(other.rows), cols: self.cols.max(other.cols) }
    }

    /// Copies the elements of this extent, row by row from `first` in `table`, to the end of the table in the
    /// layout of `larger`. New elements are `zero`. Returns the index of the copy.
    pub fn enlarge<T: Copy>(self, table: &mut Vec<T>, first: u32, larger: Self, zero: T) -> u32 {
        let to = table.len() as u32;
        table.resize(table.len() + larger.count(), zero);
        for i in 0..self.rows {
            for j in 0..self.cols {
                let value = table[(first + i * self.cols + j) as usize];
                table[(to + i * larger.cols + j) as usize] = value;
            }
        }
        to
    }
}

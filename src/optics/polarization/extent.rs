//! The block of a Mueller matrix that can be non-zero. Only the block that can be non-zero is stored.

/// The part of a finished product that can be non-zero. The part consists of the first `rows` rows and the
/// first `cols` columns (1 or 4 each). The product maps projector-frame Stokes vectors to camera-frame Stokes
/// vectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Number of outgoing Stokes elements: 1 or 4.
    pub rows: u32,
    /// Number of incoming Stokes elements: 1 or 4.
    pub cols: u32,
}

impl Extent {
    #[inline]
    pub fn count(self) -> usize {
        (self.rows * self.cols) as usize
    }

    /// Returns the smallest extent that contains both extents.
    #[inline]
    pub fn with(self, other: Self) -> Self {
        Self { rows: self.rows.max(other.rows), cols: self.cols.max(other.cols) }
    }

    /// Copies the elements of this extent to the end of `table`, in the layout of the extent `larger`. The
    /// elements are read row by row from index `first` of the table. New elements are `zero`. Returns the
    /// index of the copy.
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

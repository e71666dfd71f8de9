//! Divides the axes of a slice between the camera axes and the Stokes axes into chunks.

use tensor::axes::SliceLayout;

/// A range of adjacent axes of a layout, divided into chunks.
pub(super) struct Grid {
    /// Number of cells and number of cells per chunk, for each axis.
    axes: Vec<[u64; 2]>,
    pub chunks: u64,
}

impl Grid {
    pub fn new(layout: &SliceLayout, axes: std::ops::Range<usize>) -> Self {
        let axes: Vec<_> = layout.axes[axes].iter().map(|a| [a.len(), a.chunk]).collect();
        Self { chunks: axes.iter().map(|[len, chunk]| len.div_ceil(*chunk)).product(), axes }
    }

    /// Returns the chunk index of cell `cell`, the position of the cell in the chunk, and the number of cells
    /// in the chunk. Cells and chunks are counted row-major over the axes.
    pub fn place(&self, mut cell: u64) -> (u64, usize, usize) {
        if self.chunks == 1 {
            let volume: u64 = self.axes.iter().map(|[len, _]| len).product();
            return (0, cell as usize, volume as usize);
        }
        let (mut chunk, mut at) = (0, 0);
        let (mut chunks, mut volume) = (1, 1);
        for [len, size] in self.axes.iter().rev() {
            let index = cell % len;
            cell /= len;
            chunk += index / size * chunks;
            chunks *= len.div_ceil(*size);
            let first = index / size * size;
            at += (index - first) * volume;
            volume *= (*size).min(len - first);
        }
        (chunk, at as usize, volume as usize)
    }

    /// Appends the first index and the length along each axis of chunk `chunk` to `start` and `shape`.
    pub fn extend(&self, mut chunk: u64, start: &mut Vec<u64>, shape: &mut Vec<u64>) {
        let at = start.len();
        for [len, size] in self.axes.iter().rev() {
            let chunks = len.div_ceil(*size);
            let first = chunk % chunks * size;
            chunk /= chunks;
            start.insert(at, first);
            shape.insert(at, (*size).min(len - first));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies that the cells of unevenly divided axes have distinct positions that agree with their chunks.
    #[test]
    fn cell_positions_agree_with_chunk_boxes() {
        let grid = Grid { axes: vec![[5, 2], [3, 3], [7, 4]], chunks: 6 };
        let mut seen = std::collections::HashSet::new();
        for cell in 0..5 * 3 * 7 {
            let (chunk, at, volume) = grid.place(cell);
            assert!(seen.insert((chunk, at)));
            let (mut start, mut shape) = (vec![9], vec![8]);
            grid.extend(chunk, &mut start, &mut shape);
            assert_eq!((start[0], shape[0]), (9, 8));
            assert_eq!(shape[1..].iter().product::<u64>(), volume as u64);
            let index = [cell / 21, cell / 7 % 3, cell % 7];
            let mut expected = 0;
            for k in 0..3 {
                let inside = index[k] - start[k + 1];
                assert!(index[k] >= start[k + 1] && inside < shape[k + 1]);
                expected = expected * shape[k + 1] + inside;
            }
            assert_eq!(at as u64, expected);
        }
    }
}

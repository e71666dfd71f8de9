//! Handles boxes of row-major arrays: iterates over indices and chunks, and copies between boxes.
//!
//! Indices and shapes are `u64`. In row-major order, the index of the last axis varies fastest.

/// Returns the number of elements of a shape, or `None` on overflow.
pub fn volume(shape: &[u64]) -> Option<usize> {
    shape.iter().try_fold(1_u64, |n, &k| n.checked_mul(k)).and_then(|n| usize::try_from(n).ok())
}

/// Returns whether the box `start..start + shape` is inside an array of shape `bounds` and has the same
/// number of axes.
pub fn contains(bounds: &[u64], start: &[u64], shape: &[u64]) -> bool {
    start.len() == bounds.len()
        && shape.len() == bounds.len()
        && (0..bounds.len()).all(|i| start[i].checked_add(shape[i]).is_some_and(|e| e <= bounds[i]))
}

/// Iterates in row-major order over the indices of the box `lo..hi` (`hi` is excluded). A box without axes
/// has one index.
pub fn indices(lo: &[u64], hi: &[u64]) -> impl Iterator<Item = Vec<u64>> + use<> {
    let (lo, hi) = (lo.to_vec(), hi.to_vec());
    let mut next = lo.iter().zip(&hi).all(|(a, b)| a < b).then(|| lo.clone());
    std::iter::from_fn(move || {
        let current = next.take()?;
        let mut following = current.clone();
        for axis in (0..following.len()).rev() {
            following[axis] += 1;
            if following[axis] < hi[axis] {
                next = Some(following);
                break;
            }
            following[axis] = lo[axis];
        }
        Some(current)
    })
}

/// Iterates in row-major order over the boxes (start, shape) of a regular chunk grid, clipped to the array.
pub fn chunks(shape: &[u64], chunk: &[u64]) -> impl Iterator<Item = (Vec<u64>, Vec<u64>)> + use<> {
    let counts: Vec<u64> = shape.iter().zip(chunk).map(|(&n, &c)| n.div_ceil(c.max(1))).collect();
    let (shape, chunk) = (shape.to_vec(), chunk.to_vec());
    indices(&vec![0; counts.len()], &counts).map(move |index| chunk_box(&shape, &chunk, &index))
}

/// Returns the box (start, shape) of one chunk of a regular grid, clipped to the array.
pub fn chunk_box(shape: &[u64], chunk: &[u64], index: &[u64]) -> (Vec<u64>, Vec<u64>) {
    let start: Vec<u64> = index.iter().zip(chunk).map(|(&i, &c)| i * c).collect();
    let size = (0..shape.len()).map(|a| chunk[a].min(shape[a].saturating_sub(start[a]))).collect();
    (start, size)
}

/// A row-major array and the position of a box in the array.
#[derive(Clone, Copy, Debug)]
pub struct Window<'a> {
    /// Shape of the whole array.
    pub shape: &'a [u64],
    /// Index of the first element of the box.
    pub at: &'a [u64],
}

/// Copies a box of shape `extent` between two row-major arrays.
///
/// # Panics
/// Panics if a box is not inside its array, or if an array has fewer elements than its shape implies.
pub fn copy<T: Copy>(from: &[T], source: Window, into: &mut [T], target: Window, extent: &[u64]) {
    if extent.contains(&0) {
        return;
    }
    // Trailing axes that the box spans completely in both arrays are copied as one run.
    let mut split = extent.len();
    while split > 0 {
        split -= 1;
        if extent[split] != source.shape[split] || extent[split] != target.shape[split] {
            break;
        }
    }
    let run: usize = extent[split..].iter().product::<u64>() as usize;
    let offset = |window: &Window, index: &[u64]| {
        let mut o = 0;
        for axis in 0..window.shape.len() {
            let inner = index.get(axis).copied().unwrap_or(0);
            o = o * window.shape[axis] + window.at[axis] + inner;
        }
        o as usize
    };
    for index in indices(&vec![0; split], &extent[..split]) {
        let (a, b) = (offset(&source, &index), offset(&target, &index));
        into[b..b + run].copy_from_slice(&from[a..a + run]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_run_last_axis_fastest() {
        let all: Vec<_> = indices(&[1, 0], &[3, 2]).collect();
        assert_eq!(all, [[1, 0], [1, 1], [2, 0], [2, 1]]);
        assert_eq!(indices(&[], &[]).count(), 1);
        assert_eq!(indices(&[0, 0], &[2, 0]).count(), 0);
    }

    #[test]
    fn chunks_are_clipped() {
        let all: Vec<_> = chunks(&[5], &[2]).collect();
        assert_eq!(all, [(vec![0], vec![2]), (vec![2], vec![2]), (vec![4], vec![1])]);
    }

    #[test]
    fn copies_a_box_between_arrays() {
        let from: Vec<u32> = (0..24).collect();
        let mut into = vec![0; 20];
        let (source, target) = ([2, 3, 4], [2, 2, 5]);
        copy(
            &from,
            Window { shape: &source, at: &[0, 1, 1] },
            &mut into,
            Window { shape: &target, at: &[0, 0, 2] },
            &[2, 2, 3],
        );
        assert_eq!(&into[..10], [0, 0, 5, 6, 7, 0, 0, 9, 10, 11]);
        let mut whole = vec![0; 24];
        let place = Window { shape: &source, at: &[0, 0, 0] };
        copy(&from, place, &mut whole, place, &source);
        assert_eq!(whole, from);
    }

    #[test]
    fn boxes_outside_are_detected() {
        assert!(contains(&[4, 4], &[1, 0], &[3, 4]));
        assert!(!contains(&[4, 4], &[2, 0], &[3, 4]));
        assert!(!contains(&[4, 4], &[u64::MAX, 0], &[3, 4]));
        assert_eq!(volume(&[u64::MAX, 2]), None);
    }
}

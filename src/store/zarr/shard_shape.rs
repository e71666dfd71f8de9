//! Chooses the shapes of an array's shards and of the chunks in shards, from the file sizes of the
//! unsharded chunks.
//!
//! A chunk in a shard is a block of few pixels. For each pixel, the chunk has all entries of an unsharded
//! chunk. All values of a pixel therefore occupy a small part of a file. A shard is a block of chunks. The
//! shard grows first along the axes after the camera axes, so that one shard contains all values of a pixel.
//! The shard then grows along the camera axes until the shard is large enough.

use super::shard;
use super::shard_grid::Sharding;
use tensor::region;

/// Size limits of shards.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Maximum mean size, in bytes, of a chunk in a shard.
    pub(crate) piece: u64,
    /// Sufficient mean size, in bytes, of an array's shards. Shards of at least this mean size are not
    /// enlarged further.
    pub(crate) enough: u64,
    /// Maximum size of a shard in bytes. The size is limited because a shard is assembled in memory. A shard
    /// of a single unsharded chunk may be larger.
    pub(crate) most: u64,
    /// Maximum number of chunks of a shard. The number is limited because the tail (20 bytes per chunk) is
    /// read before the first value.
    pub(crate) pieces: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { piece: 16 << 10, enough: 4 << 20, most: 48 << 20, pieces: 1 << 12 }
    }
}

/// An array to shard.
pub(super) struct Array<'a> {
    pub(super) shape: &'a [u64],
    pub(super) chunk: &'a [u64],
    /// Number of camera axes, which are the first axes.
    pub(super) camera: usize,
    /// File size of each chunk in bytes, row-major, or 0 for a chunk without a file.
    pub(super) sizes: &'a [u64],
}

pub(super) fn choose(array: &Array, limits: Limits) -> Sharding {
    let inner = inner(array, limits);
    let grid: Vec<u64> = array.shape.iter().zip(array.chunk).map(|(n, c)| n.div_ceil(*c)).collect();
    let mut counts = vec![1; grid.len()];
    while let Some(next) = grown(array, &grid, &counts) {
        let shards = shards(&grid, array.sizes, &counts);
        let (many, total): (u64, u64) =
            shards.iter().fold((0, 0), |(n, t), s| (n + u64::from(*s > 0), t + s));
        if total >= limits.enough.saturating_mul(many.max(1)) {
            break;
        }
        let largest = self::shards(&grid, array.sizes, &next).into_iter().max();
        let pieces = shard::frames(&product(array.chunk, &next), &inner);
        if largest > Some(limits.most) || pieces.is_none_or(|n| n > limits.pieces) {
            break;
        }
        counts = next;
    }
    Sharding { inner, chunk: array.chunk.to_vec(), shard: product(array.chunk, &counts) }
}

fn product(a: &[u64], b: &[u64]) -> Vec<u64> {
    a.iter().zip(b).map(|(a, b)| a * b).collect()
}

/// Returns the shape of chunks in shards. The unsharded chunk is divided along the camera axes until the
/// chunk is small enough.
fn inner(array: &Array, limits: Limits) -> Vec<u64> {
    let mut inner = array.chunk.to_vec();
    let stored = array.sizes.iter().filter(|s| **s > 0).count().max(1);
    let total: u64 = array.sizes.iter().sum();
    // Mean size of a chunk in bytes.
    let mut bytes = total as f64 / stored as f64;
    let whole = region::volume(array.chunk).unwrap_or(usize::MAX);
    while bytes > limits.piece as f64 {
        let Some(axis) = (0..array.camera).max_by_key(|a| inner[*a]).filter(|a| inner[*a] > 1) else {
            break;
        };
        let factor = (2..=inner[axis]).find(|f| inner[axis].is_multiple_of(*f)).unwrap_or(1);
        let next = inner[axis] / factor;
        // Do not increase the number of frames for values that compress to less than one byte each, because
        // the tail should be short.
        let pieces = whole / (region::volume(&inner).unwrap_or(1) / factor as usize).max(1);
        if pieces > limits.pieces {
            break;
        }
        inner[axis] = next;
        bytes /= factor as f64;
    }
    inner
}

/// Returns the number of unsharded chunks of a shard along each axis after one growth step, or `None` if the
/// shard already contains all chunks.
fn grown(array: &Array, grid: &[u64], counts: &[u64]) -> Option<Vec<u64>> {
    let more = |axis: &usize| counts[*axis] < grid[*axis];
    let behind = (array.camera..grid.len()).rev().find(more);
    let camera = || (0..array.camera).filter(more).min_by_key(|a| counts[*a] * array.chunk[*a]);
    let axis = behind.or_else(camera)?;
    let mut next = counts.to_vec();
    next[axis] = (2 * next[axis]).min(grid[axis]);
    Some(next)
}

/// Returns the sizes, in bytes, of all shards of an array. `counts` is the number of unsharded chunks of a
/// shard along each axis.
fn shards(grid: &[u64], sizes: &[u64], counts: &[u64]) -> Vec<u64> {
    let of: Vec<u64> = grid.iter().zip(counts).map(|(g, c)| g.div_ceil(*c)).collect();
    let mut bytes = vec![0; region::volume(&of).unwrap_or(0)];
    for (index, size) in region::indices(&vec![0; grid.len()], grid).zip(sizes) {
        let at = index.iter().zip(counts).zip(&of).fold(0, |at, ((i, c), n)| at * n + i / c);
        bytes[at as usize] += size;
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(shape: &[u64], chunk: &[u64], bytes: u64) -> Sharding {
        let grid: u64 = shape.iter().zip(chunk).map(|(n, c)| n.div_ceil(*c)).product();
        let sizes = &vec![bytes; grid as usize];
        let camera = 2;
        let array = Array { shape, chunk, camera, sizes };
        choose(&array, Limits::default())
    }

    #[test]
    fn a_pixel_is_in_one_shard_and_a_shard_is_large() {
        // There are 64 tiles of 32 × 32 pixels with 200 bins and 16 Mueller elements. A chunk contains one
        // Mueller element and has 300 kB.
        let found = cut(&[256, 256, 200, 4, 4], &[32, 32, 200, 1, 1], 300 << 10);
        assert_eq!(found.inner[2..], [200, 1, 1]);
        let pixels = found.inner[0] * found.inner[1];
        assert!((16..=64).contains(&pixels), "{found:?}");
        assert_eq!(found.shard[2..], [200, 4, 4], "all of a pixel");
        assert_eq!(found.shard[..2], [32, 32], "16 chunks are enough");
    }

    #[test]
    fn small_arrays_have_one_shard() {
        let found = cut(&[100, 90], &[32, 32], 2000);
        assert_eq!((found.inner, found.shard), (vec![32, 32], vec![128, 96]));
        let odd = cut(&[7, 11, 5], &[7, 7, 5], 60 << 10);
        assert_eq!((odd.inner, odd.shard), (vec![7, 1, 5], vec![7, 14, 5]));
    }

    #[test]
    fn shard_size_is_bounded() {
        let found = cut(&[64, 64, 9], &[32, 32, 9], 80 << 20);
        assert_eq!(found.shard, [32, 32, 9]);
        // An empty array has one shard with a short tail.
        let nothing = cut(&[4096, 4096, 9], &[32, 32, 9], 0);
        assert!(shard::frames(&nothing.shard, &nothing.inner).unwrap() <= Limits::default().pieces);
    }
}

//! From path contributions to means and standard errors of every slice, in one pass.
//!
//! One camera sample is one random variable: all its contributions to an element are added before they are squared, so
//! the variance is that of independent samples. A pixel is finished before the next begins, so what is live is small:
//! the cells of one pixel (sparse, in f64), then the finished values of one tile (sparse, in f32).

use super::axes::SliceLayout;
use super::plan::DROPPED;
pub use super::plan::{Contribution, Contributions, NO_PIXEL, SlicePlan};
use super::store::{AccessError, Field, StoredSlice};
use crate::polarization::chain::Extent;
use crate::spectrum::Spectral;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use wide::f64x4;

/// Cells of a pixel are looked up in a plain table up to this many possible cells.
const DIRECT_CELLS: u64 = 1 << 16;

/// Multiplicative hashing of cell keys (Knuth): keys are small integers, attackers there are none.
#[derive(Default)]
pub struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, bytes: &[u8]) {
        for b in bytes {
            self.write_u64(u64::from(*b));
        }
    }
    fn write_u64(&mut self, v: u64) {
        self.0 = (self.0 ^ v).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    }
}

type KeyMap = HashMap<u64, u32, BuildHasherDefault<KeyHasher>>;

/// Where the cells of one pixel are found.
enum CellIndex {
    Direct(Vec<u32>),
    Hashed(KeyMap),
}

/// One live cell of the current pixel.
struct Cell {
    key: u64,
    /// Sample whose contributions are pending.
    sample: u32,
    /// Extent that can be non-zero.
    rows: usize,
    cols: usize,
}

/// The sums of one slice over the samples of the current camera pixel.
struct PixelSums {
    index: CellIndex,
    cells: Vec<Cell>,
    pending: Vec<Spectral>,
    sum: Vec<f64x4>,
    square: Vec<f64x4>,
}

fn widen(s: Spectral) -> f64x4 {
    f64x4::new(s.to_array().map(f64::from))
}

impl PixelSums {
    fn new(plan: &SlicePlan) -> Self {
        let cells = plan.inner + plan.overflow;
        Self {
            index: if cells <= DIRECT_CELLS {
                CellIndex::Direct(vec![u32::MAX; cells as usize])
            } else {
                CellIndex::Hashed(KeyMap::default())
            },
            cells: Vec::new(),
            pending: Vec::new(),
            sum: Vec::new(),
            square: Vec::new(),
        }
    }

    /// Moves a cell's pending sample into its sums.
    #[inline]
    fn fold(&mut self, slot: usize, elements: usize) {
        let cell = &self.cells[slot];
        for i in 0..cell.rows {
            for j in 0..cell.cols {
                let at = slot * elements + 4 * i + j;
                let p = widen(self.pending[at]);
                self.pending[at] = Spectral::ZERO;
                self.sum[at] += p;
                self.square[at] += p * p;
            }
        }
    }

    #[inline]
    fn add(
        &mut self,
        key: u64,
        sample: u32,
        extent: Extent,
        values: &[Spectral],
        weight: f32,
        elements: usize,
    ) {
        let entry = match &mut self.index {
            CellIndex::Direct(table) => &mut table[key as usize],
            CellIndex::Hashed(map) => map.entry(key).or_insert(u32::MAX),
        };
        if *entry == u32::MAX {
            *entry = self.cells.len() as u32;
            self.cells.push(Cell {
                key,
                sample,
                rows: 0,
                cols: 0,
            });
            let n = self.cells.len() * elements;
            self.pending.resize(n, Spectral::ZERO);
            self.sum.resize(n, f64x4::ZERO);
            self.square.resize(n, f64x4::ZERO);
        }
        let slot = *entry as usize;
        if self.cells[slot].sample != sample {
            self.fold(slot, elements);
            self.cells[slot].sample = sample;
        }
        let cell = &mut self.cells[slot];
        let w = Spectral::splat(weight);
        let stride = extent.cols as usize;
        let (rows, cols) = if elements == 1 {
            (1, 1)
        } else {
            (extent.rows as usize, stride)
        };
        cell.rows = cell.rows.max(rows);
        cell.cols = cell.cols.max(cols);
        for (i, row) in values.chunks_exact(stride).take(rows).enumerate() {
            let at = slot * elements + 4 * i;
            for (sum, value) in self.pending[at..at + cols].iter_mut().zip(row) {
                *sum += *value * w;
            }
        }
    }

    fn clear(&mut self) {
        match &mut self.index {
            CellIndex::Direct(table) => {
                for c in &self.cells {
                    table[c.key as usize] = u32::MAX;
                }
            }
            CellIndex::Hashed(map) => map.clear(),
        }
        self.cells.clear();
        self.pending.clear();
        self.sum.clear();
        self.square.clear();
    }
}

/// The finished values of one slice over one tile, sparse.
struct TileValues {
    /// First index along `y`, `x`, and how many of each.
    start: [u64; 2],
    shape: [u64; 2],
    /// (local camera index · cells + cell) of every entry.
    keys: Vec<u64>,
    /// Means then variances of the mean of every entry: 2 · elements · wavelengths numbers.
    values: Vec<f32>,
    /// Entries by key, where several pixels share one (binned cameras).
    shared: Option<KeyMap>,
}

/// All slices over one tile: fed sample by sample, pixel by pixel, then written.
pub struct TileAccumulator<'a> {
    plans: &'a [SlicePlan],
    sums: Vec<PixelSums>,
    tiles: Vec<TileValues>,
    /// A chunk of means and one of errors, all zero between uses: fresh memory of that size costs more than filling it.
    scratch: [Vec<f32>; 2],
}

impl<'a> TileAccumulator<'a> {
    /// An accumulator for tiles of the given slices; reused from tile to tile by one thread.
    #[must_use]
    pub fn new(plans: &'a [SlicePlan]) -> Self {
        Self {
            plans,
            sums: plans.iter().map(PixelSums::new).collect(),
            tiles: Vec::new(),
            scratch: Default::default(),
        }
    }

    /// Starts the tile of camera pixels x0..x1, y0..y1.
    pub fn begin_tile(&mut self, [x0, y0]: [u32; 2], [x1, y1]: [u32; 2]) {
        self.tiles.clear();
        for plan in self.plans {
            let range = |table: &[u32], a: u32, b: u32| {
                let kept = || table[a as usize..b as usize].iter().filter(|i| **i != DROPPED);
                match (kept().min(), kept().max()) {
                    (Some(&lo), Some(&hi)) => (u64::from(lo), u64::from(hi - lo + 1)),
                    _ => (0, 0),
                }
            };
            let (y, ny) = range(&plan.camera[0], y0, y1);
            let (x, nx) = range(&plan.camera[1], x0, x1);
            self.tiles.push(TileValues {
                start: [y, x],
                shape: [ny, nx],
                keys: Vec::new(),
                values: Vec::new(),
                shared: (plan.pixels_per_element() > 1).then(KeyMap::default),
            });
        }
    }

    /// True if any slice keeps camera pixel (x, y).
    #[must_use]
    pub fn wants(&self, x: u32, y: u32) -> bool {
        self.plans.iter().any(|p| p.camera_index(x, y).is_some())
    }

    /// Adds all contributions of one camera sample of pixel (x, y).
    #[inline]
    pub fn add_sample(&mut self, x: u32, y: u32, sample: u32, contributions: &Contributions) {
        for (plan, sums) in self.plans.iter().zip(&mut self.sums) {
            if plan.camera_index(x, y).is_none() {
                continue;
            }
            let pixel = y * plan.camera_width + x;
            for c in &contributions.list {
                if let Some((cell, weight)) = plan.cell(c, pixel) {
                    sums.add(cell, sample, c.extent, contributions.of(c), weight, plan.elements);
                }
            }
        }
    }

    /// Finishes pixel (x, y), of which `n` samples count (those without light included).
    pub fn end_pixel(&mut self, x: u32, y: u32, n: u32) {
        for ((plan, sums), tile) in self.plans.iter().zip(&mut self.sums).zip(&mut self.tiles) {
            let Some([iy, ix]) = plan.camera_index(x, y) else {
                continue;
            };
            let local = (u64::from(iy) - tile.start[0]) * tile.shape[1] + u64::from(ix) - tile.start[1];
            let pixels = plan.per_index[0][iy as usize] * plan.per_index[1][ix as usize];
            sums.finish_pixel(plan, tile, local, n, f64::from(pixels));
        }
    }

    /// Writes the tile to the stored slices (one a plan, in order).
    ///
    /// # Errors
    /// If the store refuses.
    pub fn write(&mut self, stored: &[StoredSlice]) -> Result<(), AccessError> {
        for ((plan, tile), slice) in self.plans.iter().zip(&self.tiles).zip(stored) {
            tile.write(plan, slice, &mut self.scratch)?;
        }
        Ok(())
    }
}

impl PixelSums {
    /// Turns the sums of a pixel into the mean and the variance of the mean, and adds them to the tile with weight
    /// 1/pixels and 1/pixels² (pixels are independent).
    fn finish_pixel(&mut self, plan: &SlicePlan, tile: &mut TileValues, local: u64, n: u32, pixels: f64) {
        let (e, l) = (plan.elements, plan.wavelengths);
        let stride = 2 * e * l;
        let n = f64::from(n);
        for slot in 0..self.cells.len() {
            self.fold(slot, e);
            let cell = &self.cells[slot];
            let key = local * (plan.inner + plan.overflow) + cell.key;
            let entry = match &mut tile.shared {
                None => tile.keys.len(),
                Some(map) => *map.entry(key).or_insert(tile.keys.len() as u32) as usize,
            };
            if entry == tile.keys.len() {
                tile.keys.push(key);
                tile.values.resize(tile.values.len() + stride, 0.0);
            }
            let out = &mut tile.values[entry * stride..(entry + 1) * stride];
            for i in 0..cell.rows {
                for j in 0..cell.cols {
                    let at = 4 * i + j;
                    let sum = self.sum[slot * e + at].to_array();
                    let square = self.square[slot * e + at].to_array();
                    for k in 0..l {
                        let mean = sum[k] / n;
                        // NaN for a single sample: its error is unknown, not zero.
                        let spread = (square[k] - sum[k] * mean).max(0.0);
                        let variance = spread / ((n - 1.0) * n);
                        out[at * l + k] += (mean / pixels) as f32;
                        out[(e + at) * l + k] += (variance / (pixels * pixels)) as f32;
                    }
                }
            }
        }
        self.clear();
    }
}

impl TileValues {
    fn write(
        &self,
        plan: &SlicePlan,
        slice: &StoredSlice,
        scratch: &mut [Vec<f32>; 2],
    ) -> Result<(), AccessError> {
        let cells = plan.inner + plan.overflow;
        let (mut window, mut outside) = (Vec::new(), Vec::new());
        for (entry, key) in self.keys.iter().enumerate() {
            let (local, cell) = (key / cells, key % cells);
            if cell < plan.inner {
                window.push((local, cell, entry));
            } else {
                outside.push((local, cell - plan.inner, entry));
            }
        }
        self.write_part(
            plan,
            slice,
            &plan.layout,
            window,
            [Field::Mean, Field::StdError],
            scratch,
        )?;
        if plan.overflow > 0 {
            let layout = plan.layout.without_time();
            let fields = [Field::Overflow, Field::OverflowStdError];
            self.write_part(plan, slice, &layout, outside, fields, scratch)?;
        }
        Ok(())
    }

    /// Writes entries (local camera index, cell, entry) chunk by chunk.
    fn write_part(
        &self,
        plan: &SlicePlan,
        slice: &StoredSlice,
        layout: &SliceLayout,
        mut entries: Vec<(u64, u64, usize)>,
        fields: [Field; 2],
        scratch: &mut [Vec<f32>; 2],
    ) -> Result<(), AccessError> {
        let (e, l) = (plan.elements, plan.wavelengths);
        let axes = &layout.axes[2..];
        let axes = &axes[..axes.len() - if e == 16 { 3 } else { 1 }];
        // Multi-index of a cell, and the number of the chunk that it lies in.
        let place = |mut cell: u64| {
            let mut index = [0_u64; 8];
            for (k, axis) in axes.iter().enumerate().rev() {
                index[k] = cell % axis.len();
                cell /= axis.len();
            }
            index
        };
        let chunk_of = |cell: u64| {
            let index = place(cell);
            axes.iter().enumerate().fold(0_u64, |n, (k, axis)| {
                n * axis.len().div_ceil(axis.chunk) + index[k] / axis.chunk
            })
        };
        entries.sort_unstable_by_key(|(local, cell, _)| (chunk_of(*cell), *local, *cell));
        for group in entries.chunk_by(|a, b| chunk_of(a.1) == chunk_of(b.1)) {
            let index = place(group[0].1);
            let mut start = self.start.to_vec();
            let mut shape = self.shape.to_vec();
            for (k, axis) in axes.iter().enumerate() {
                let first = index[k] / axis.chunk * axis.chunk;
                start.push(first);
                shape.push(axis.chunk.min(axis.len() - first));
            }
            let inner: u64 = shape[2..].iter().product();
            let width = e * l;
            let length = (shape[0] * shape[1] * inner) as usize * width;
            let [means, errors] = scratch;
            for part in [&mut *means, &mut *errors] {
                if part.len() < length {
                    part.resize(length, 0.0);
                }
            }
            let (first, extent) = (start.clone(), shape.clone());
            let offset_of = |local: u64, cell: u64| {
                let index = place(cell);
                let offset = (0..axes.len()).fold(0, |n, k| n * extent[2 + k] + index[k] - first[2 + k]);
                (local * inner + offset) as usize * width
            };
            for &(local, cell, entry) in group {
                let at = offset_of(local, cell);
                let values = &self.values[entry * 2 * width..(entry + 1) * 2 * width];
                means[at..at + width].copy_from_slice(&values[..width]);
                for (out, variance) in errors[at..at + width].iter_mut().zip(&values[width..]) {
                    *out = variance.sqrt();
                }
            }
            let tail = if e == 16 {
                vec![4, 4, l as u64]
            } else {
                vec![l as u64]
            };
            start.extend(tail.iter().map(|_| 0));
            shape.extend(tail);
            let written = [(fields[0], &*means), (fields[1], &*errors)]
                .into_iter()
                .try_for_each(|(field, data)| slice.write(field, &start, &shape, &data[..length]));
            for &(local, cell, _) in group {
                let at = offset_of(local, cell);
                means[at..at + width].fill(0.0);
                errors[at..at + width].fill(0.0);
            }
            written?;
        }
        Ok(())
    }
}

//! Accumulates path contributions into means and standard errors of every slice, in one pass.
//!
//! Estimates treat each camera sample, or each group of jointly stratified samples, as one independent random
//! variable. All contributions of a group to an element are added before the sum is squared. Each pixel is
//! finished before the next begins. Memory therefore contains only the cells of one pixel (sparse, f64) and
//! the finished values of one tile (sparse, f32).

mod grid;
pub mod plan;
mod selected;
mod tile_values;
mod totals;

use optics::polarization::extent::Extent;
use optics::spectrum::Spectral;
pub use plan::{Contribution, Contributions, NO_PIXEL, SlicePlan};
use plan::{DROPPED, EVERY};
pub use selected::{Selected, chance_in};
use tensor::sink::{SampleCounts, Sink, TileRecord};
use tile_values::{KeyMap, Scratch, TileValues};
pub use totals::Counted;
use totals::TotalSums;
use wide::f64x4;

/// Maximum number of cells per pixel for which the cell index is a plain table. For more cells, the cell
/// index is a hash map.
const DIRECT_CELLS: u64 = 1 << 16;

/// Maps the key of a cell to the index of the cell among the cells of the current pixel.
enum CellIndex {
    Direct(Vec<u32>),
    Hashed(KeyMap),
}

/// One cell of the current pixel that has received contributions.
struct Cell {
    key: u64,
    /// Group of samples whose contributions have not been added to the sums yet.
    group: u32,
    /// Index in [`PixelSums::sums`] of the cell's first element. The cell has `extent` rows and columns.
    first: u32,
    extent: Extent,
}

/// Sums of the contributions to one matrix element of a cell.
#[derive(Clone, Copy)]
struct Sums {
    pending: Spectral,
    sum: f64x4,
    square: f64x4,
}

impl Sums {
    const ZERO: Self = Self { pending: Spectral::ZERO, sum: f64x4::ZERO, square: f64x4::ZERO };

    /// Adds the pending sum of the current sample group to `sum`, and the square of the pending sum to
    /// `square`.
    #[inline]
    fn fold(&mut self) {
        let p = widen(self.pending);
        self.pending = Spectral::ZERO;
        self.sum += p;
        self.square += p * p;
    }
}

/// The sums of one slice over the samples of the current camera pixel.
struct PixelSums {
    index: CellIndex,
    cells: Vec<Cell>,
    /// Sums of the elements of all cells. The list contains only the elements that can be non-zero.
    sums: Vec<Sums>,
    total: TotalSums,
}

#[inline]
fn widen(s: Spectral) -> f64x4 {
    let [a, b, c, d] = s.to_array();
    f64x4::new([f64::from(a), f64::from(b), f64::from(c), f64::from(d)])
}

#[inline]
fn narrow(d: f64x4) -> Spectral {
    let [a, b, c, d] = d.to_array();
    Spectral::new([a as f32, b as f32, c as f32, d as f32])
}

impl PixelSums {
    fn new(plan: &SlicePlan) -> Self {
        let cells = plan.cells();
        Self {
            index: if cells <= DIRECT_CELLS {
                CellIndex::Direct(vec![u32::MAX; cells as usize])
            } else {
                CellIndex::Hashed(KeyMap::default())
            },
            cells: Vec::new(),
            sums: Vec::new(),
            total: TotalSums::default(),
        }
    }

    /// Enlarges cell number `slot` so that the cell has space for the elements of `extent`.
    #[cold]
    fn grow(&mut self, slot: usize, extent: Extent) {
        let cell = &mut self.cells[slot];
        let larger = cell.extent.with(extent);
        cell.first = cell.extent.enlarge(&mut self.sums, cell.first, larger, Sums::ZERO);
        cell.extent = larger;
    }

    #[inline(always)]
    fn add(&mut self, key: u64, group: u32, extent: Extent, values: &[Spectral], weight: f32) {
        let w = Spectral::splat(weight);
        let entry = match &mut self.index {
            CellIndex::Direct(table) => &mut table[key as usize],
            CellIndex::Hashed(map) => map.entry(key).or_insert(u32::MAX),
        };
        if *entry == u32::MAX {
            *entry = self.cells.len() as u32;
            self.cells.push(Cell { key, group, first: self.sums.len() as u32, extent });
            self.sums.extend(values.iter().map(|value| Sums { pending: *value * w, ..Sums::ZERO }));
            return;
        }
        let slot = *entry as usize;
        if let ([value], 1) = (values, self.cells[slot].extent.count()) {
            // This code is the fast path, because most contributions have only one element, M00.
            let cell = &mut self.cells[slot];
            let sums = &mut self.sums[cell.first as usize];
            if cell.group != group {
                cell.group = group;
                sums.fold();
            }
            sums.pending += *value * w;
            return;
        }
        if self.cells[slot].extent.with(extent) != self.cells[slot].extent {
            self.grow(slot, extent);
        }
        let cell = &mut self.cells[slot];
        let first = cell.first as usize;
        if cell.group != group {
            cell.group = group;
            for sums in &mut self.sums[first..first + cell.extent.count()] {
                sums.fold();
            }
        }
        for (i, row) in values.chunks_exact(extent.cols as usize).enumerate() {
            let at = first + i * cell.extent.cols as usize;
            for (sums, value) in self.sums[at..at + row.len()].iter_mut().zip(row) {
                sums.pending += *value * w;
            }
        }
    }

    /// Computes the mean of a pixel and the variance of the mean. Adds the mean to the tile with the weight
    /// 1/`pixels`, where `pixels` is the number of camera pixels in the bin. Adds the variance with the
    /// weight 1/`pixels`², because pixels are independent.
    #[inline]
    fn finish_pixel(&mut self, plan: &SlicePlan, tile: &mut TileValues, local: u64, n: Counted, pixels: f64) {
        let (samples, groups) = (f64::from(n.samples), f64::from(n.groups));
        let per_sample = f64x4::splat(1.0 / samples);
        let per_group = f64x4::splat(1.0 / groups);
        // Compute the variance of the mean over groups. On average, the sum of a group is `size` times the
        // value of a sample. The variance is NaN for a single group.
        let size = samples / groups;
        let per_degree = f64x4::splat(1.0 / ((groups - 1.0) * groups * size * size));
        let (share, share2) = (f64x4::splat(1.0 / pixels), f64x4::splat(1.0 / (pixels * pixels)));
        for cell in &self.cells {
            let first = cell.first as usize;
            let key = local * plan.cells() + cell.key;
            let finished = self.sums[first..first + cell.extent.count()].iter_mut().map(|sums| {
                sums.fold();
                let mean = sums.sum * per_sample;
                let spread = (sums.square - sums.sum * (sums.sum * per_group)).max(f64x4::ZERO);
                [narrow(mean * share), narrow(spread * per_degree * share2)]
            });
            tile.add(key, cell.extent, finished);
        }
        let total = self.total.finish(n, plan.wavelengths);
        tile.add_total(local, total / (pixels * pixels));
        self.clear();
    }

    #[inline]
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
        self.sums.clear();
    }
}

/// The finished values of all slices in one tile, as a back end returns them.
pub struct TileSums<'a> {
    plans: &'a [SlicePlan],
    slices: Vec<TileValues>,
    scratch: Scratch,
    /// First camera pixel (x, y) of the tile, and the position (x, y) one past the last pixel.
    pixels: [[u32; 2]; 2],
    /// Number of valid samples per pixel, row-major.
    counts: Vec<u32>,
    pub record: TileRecord,
}

impl TileSums<'_> {
    /// Writes all values to a sink, followed by the tile record.
    ///
    /// # Errors
    /// Returns the error of the sink if the sink cannot store the values.
    pub fn put<S: Sink>(&mut self, sink: &S) -> Result<(), S::Error> {
        for (number, (plan, values)) in self.plans.iter().zip(&self.slices).enumerate() {
            values.put(number, plan, sink, &mut self.scratch)?;
        }
        let [[x0, y0], [x1, y1]] = self.pixels;
        sink.put_samples(&SampleCounts {
            start: [y0, x0].map(u64::from),
            shape: [y1 - y0, x1 - x0].map(u64::from),
            counts: &self.counts,
        })?;
        sink.tile_done(&self.record)
    }
}

/// Accumulates the contributions to all slices in one tile, pixel by pixel and sample by sample.
pub struct TileAccumulator<'a> {
    plans: &'a [SlicePlan],
    sums: Vec<PixelSums>,
    pub tile: TileSums<'a>,
    /// Row-major index of the current camera pixel.
    pixel: u32,
    keeping: Vec<usize>,
    /// True if at least one slice samples paths for selected projector pixels.
    aimed: bool,
    /// Probability of each s' in the epipolar band of the current camera pixel, per slice (0 without a band).
    in_band: Vec<f32>,
}

impl<'a> TileAccumulator<'a> {
    /// Creates an accumulator for tiles of the given slices, with `passes` passes over each pixel. An
    /// accumulator can be reused for any number of tiles.
    pub fn new(plans: &'a [SlicePlan], passes: usize) -> Self {
        Self {
            plans,
            sums: plans.iter().map(PixelSums::new).collect(),
            tile: TileSums {
                plans,
                slices: plans.iter().map(|p| TileValues::new(p, passes)).collect(),
                scratch: Scratch::default(),
                pixels: [[0; 2]; 2],
                counts: Vec::new(),
                record: TileRecord::default(),
            },
            pixel: 0,
            keeping: Vec::new(),
            aimed: plans.iter().any(|p| p.selected().is_some()),
            in_band: vec![0.0; plans.len()],
        }
    }

    /// Starts tile number `tile`, which covers camera columns x0..x1 and rows y0..y1.
    pub fn begin_tile(&mut self, tile: u32, [x0, y0]: [u32; 2], [x1, y1]: [u32; 2]) {
        self.tile.pixels = [[x0, y0], [x1, y1]];
        self.tile.counts.clear();
        self.tile.record = TileRecord { tile, ..TileRecord::default() };
        for (plan, tile) in self.plans.iter().zip(&mut self.tile.slices) {
            let range = |table: &[u32], a: u32, b: u32| {
                let kept = || table[a as usize..b as usize].iter().filter(|i| **i != DROPPED);
                match (kept().min(), kept().max()) {
                    (Some(&lo), Some(&hi)) => (u64::from(lo), u64::from(hi - lo + 1)),
                    _ => (0, 0),
                }
            };
            let (y, ny) = range(&plan.camera[0], y0, y1);
            let (x, nx) = range(&plan.camera[1], x0, x1);
            tile.begin([y, x], [ny, nx]);
        }
    }

    /// Starts camera pixel (x, y). Returns false if no slice keeps the pixel. A pixel that no slice keeps is
    /// already finished.
    #[inline]
    pub(crate) fn begin_pixel(&mut self, x: u32, y: u32) -> bool {
        self.pixel = self.plans.first().map_or(0, |p| y * p.camera_width + x);
        self.keeping.clear();
        let kept = (0..self.plans.len()).filter(|k| self.plans[*k].camera_index(x, y).is_some());
        self.keeping.extend(kept);
        if self.keeping.is_empty() {
            self.tile.counts.push(0);
        }
        !self.keeping.is_empty()
    }

    /// Sets the projector pixels s' of each slice's band for the current pixel. The list is empty if there is
    /// no band.
    #[inline]
    pub fn set_bands(&mut self, bands: &[Vec<u32>]) {
        for (chance, band) in self.in_band.iter_mut().zip(bands) {
            *chance = chance_in(band);
        }
    }

    /// Adds all contributions of one camera sample of the current pixel. `elements` contains the Mueller
    /// elements of the contributions. Samples of one `group` must be added consecutively.
    #[inline]
    pub fn add_sample(&mut self, group: u32, list: &[Contribution], elements: &[Spectral]) {
        if self.aimed {
            self.add_aimed(group, list, elements);
        } else {
            self.add_to::<false>(group, list, elements);
        }
    }

    #[inline(never)]
    fn add_aimed(&mut self, group: u32, list: &[Contribution], elements: &[Spectral]) {
        self.add_to::<true>(group, list, elements);
    }

    /// Implements [`Self::add_sample`]. `AIMED` is true if some contributions belong to a single slice.
    #[inline(always)]
    fn add_to<const AIMED: bool>(&mut self, group: u32, list: &[Contribution], elements: &[Spectral]) {
        let pixel = self.pixel;
        for k in &self.keeping {
            let (plan, sums) = (&self.plans[*k], &mut self.sums[*k]);
            let mut total = Spectral::ZERO;
            for c in list {
                if AIMED && c.slice != EVERY && c.slice != *k as u32 {
                    continue;
                }
                if let Some((cell, mut weight)) = plan.cell(c, pixel) {
                    if AIMED {
                        weight *= plan.share(c, self.in_band[*k]);
                    }
                    let (extent, values) = if plan.elements == 1 {
                        // The slice keeps only element M00.
                        (Extent { rows: 1, cols: 1 }, &c.of(elements)[..1])
                    } else {
                        (c.extent, c.of(elements))
                    };
                    sums.add(cell, group, extent, values, weight);
                    total += values[0] * Spectral::splat(weight);
                }
            }
            sums.total.add(group, total);
        }
    }

    /// Finishes a pass over pixel (x, y). Passes are independent, so the means and variances of the passes
    /// are added.
    #[inline]
    pub fn end_pass(&mut self, x: u32, y: u32, n: Counted) {
        let slices = self.plans.iter().zip(&mut self.sums);
        for ((plan, sums), tile) in slices.zip(&mut self.tile.slices) {
            let Some([iy, ix]) = plan.camera_index(x, y) else {
                continue;
            };
            let local = tile.local(iy, ix);
            let pixels = plan.per_index[0][iy as usize] * plan.per_index[1][ix as usize];
            sums.finish_pixel(plan, tile, local, n, f64::from(pixels));
        }
    }

    /// Finishes the current pixel and records its number of samples.
    #[inline]
    pub fn end_pixel(&mut self, samples: u32) {
        self.tile.counts.push(samples);
    }
}

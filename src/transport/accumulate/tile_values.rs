//! The finished values of one slice in one tile, stored sparsely, and the conversion of these values to
//! chunks.
//!
//! Most elements of a tensor are zero, for example in bins without light and in the matrices of unpolarized
//! light. Only non-zero elements are stored, and chunks without values are skipped.

use super::grid::Grid;
use super::plan::SlicePlan;
use optics::polarization::extent::Extent;
use optics::spectrum::Spectral;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use tensor::axes::{AxisKind, SliceLayout};
use tensor::field::Field;
use tensor::sink::{self, Piece, Sink};

/// Multiplicative hashing of cell keys (Knuth). Keys are small integers that an attacker cannot choose.
#[derive(Default)]
pub(super) struct KeyHasher(u64);

impl Hasher for KeyHasher {
    #[inline]
    fn finish(&self) -> u64 {
        self.0
    }
    #[inline]
    fn write(&mut self, bytes: &[u8]) {
        for b in bytes {
            self.write_u64(u64::from(*b));
        }
    }
    #[inline]
    fn write_u64(&mut self, v: u64) {
        self.0 = (self.0 ^ v).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    }
}

pub(super) type KeyMap = HashMap<u64, u32, BuildHasherDefault<KeyHasher>>;

/// Number of values in a stretch, the unit in which chunks are marked and cleared.
const STRETCH: usize = sink::STRETCH / 4;

/// Buffers for one chunk of means and one chunk of errors. All values are zero before a chunk is filled. The
/// buffers are reused, because allocation is slow.
#[derive(Default)]
pub(super) struct Scratch {
    means: Vec<f32>,
    errors: Vec<f32>,
    /// One bit per stretch, set if a value in the stretch was written.
    touched: Vec<u64>,
}

impl Scratch {
    /// Enlarges the buffers to at least `length` values.
    fn reserve(&mut self, length: usize) {
        if self.means.len() < length {
            self.means.resize(length, 0.0);
            self.errors.resize(length, 0.0);
            self.touched.resize(length.div_ceil(STRETCH).div_ceil(64), 0);
        }
    }

    /// Marks the stretch that contains value number `number`.
    #[inline]
    fn touch(&mut self, number: usize) {
        let stretch = number / STRETCH;
        self.touched[stretch / 64] |= 1 << (stretch % 64);
    }

    /// Sets all values in marked stretches to zero, and removes the marks.
    fn clear(&mut self) {
        for (word, bits) in self.touched.iter_mut().enumerate() {
            while *bits != 0 {
                let first = (64 * word + bits.trailing_zeros() as usize) * STRETCH;
                *bits &= *bits - 1;
                let stretch = first..(first + STRETCH).min(self.means.len());
                self.means[stretch.clone()].fill(0.0);
                self.errors[stretch].fill(0.0);
            }
        }
    }
}

/// Mean and variance of the mean of one matrix element.
type Finished = [Spectral; 2];

struct Entry {
    /// Key of the entry: local index of the camera element × number of cells per camera element + cell index.
    key: u64,
    /// Index of the entry's first matrix element in the list of values. Elements are row-major.
    first: u32,
    extent: Extent,
}

#[derive(Clone, Copy)]
struct Placed {
    /// Index of the chunk within the tile, over the axes between the camera axes and the Stokes axes.
    chunk: u64,
    /// Position in the chunk, in units of the number of values along the Stokes and wavelength axes.
    at: usize,
    entry: u32,
}

/// The finished values of one slice in one tile, stored sparsely.
pub(super) struct TileValues {
    /// First indices along `y` and `x`.
    start: [u64; 2],
    shape: [u64; 2],
    entries: Vec<Entry>,
    values: Vec<Finished>,
    /// Variance of the mean of the total ([`super::totals`]), per camera element.
    totals: Vec<f64>,
    /// Entry index by key. The map is present if several pixels (of a binned camera) or several passes share
    /// a key.
    shared: Option<KeyMap>,
}

impl TileValues {
    /// Creates an empty table for a slice whose pixels are finished in `passes` passes.
    pub(super) fn new(plan: &SlicePlan, passes: usize) -> Self {
        Self {
            start: [0; 2],
            shape: [0; 2],
            entries: Vec::new(),
            values: Vec::new(),
            totals: Vec::new(),
            shared: (plan.pixels_per_element() > 1 || passes > 1).then(KeyMap::default),
        }
    }

    /// Clears the table but keeps its memory, and sets the range of camera elements along `y`, `x` to
    /// `start..start + shape`.
    pub(super) fn begin(&mut self, start: [u64; 2], shape: [u64; 2]) {
        (self.start, self.shape) = (start, shape);
        self.entries.clear();
        self.values.clear();
        self.totals.clear();
        self.totals.resize((shape[0] * shape[1]) as usize, 0.0);
        if let Some(map) = &mut self.shared {
            map.clear();
        }
    }

    /// Returns the index of a camera element (indices along `y`, `x`) within the tile.
    #[inline]
    pub(super) fn local(&self, iy: u32, ix: u32) -> u64 {
        (u64::from(iy) - self.start[0]) * self.shape[1] + u64::from(ix) - self.start[1]
    }

    /// Adds the means and variances of a cell's elements, row by row. The values of cells with equal keys are
    /// summed.
    pub(super) fn add(&mut self, key: u64, extent: Extent, finished: impl Iterator<Item = Finished>) {
        let first = self.values.len() as u32;
        let fresh = self.entries.len() as u32;
        if let Some(map) = &mut self.shared {
            let entry = *map.entry(key).or_insert(fresh);
            if entry != fresh {
                self.merge(entry as usize, extent, finished);
                return;
            }
        }
        self.entries.push(Entry { key, first, extent });
        self.values.extend(finished);
    }

    /// Adds `variance` to the variance of the total of camera element `local`.
    #[inline]
    pub(super) fn add_total(&mut self, local: u64, variance: f64) {
        self.totals[local as usize] += variance;
    }

    fn merge(&mut self, entry: usize, extent: Extent, finished: impl Iterator<Item = Finished>) {
        let entry = &mut self.entries[entry];
        let wanted = entry.extent.with(extent);
        if wanted != entry.extent {
            let zero = [Spectral::ZERO; 2];
            entry.first = entry.extent.enlarge(&mut self.values, entry.first, wanted, zero);
            entry.extent = wanted;
        }
        let first = entry.first;
        for (n, [mean, variance]) in finished.enumerate() {
            let (i, j) = (n as u32 / extent.cols, n as u32 % extent.cols);
            let [sum, sum_variance] = &mut self.values[(first + i * wanted.cols + j) as usize];
            *sum += mean;
            *sum_variance += variance;
        }
    }

    /// Writes the tile to a sink as slice number `number`.
    ///
    /// # Errors
    /// Returns the error of the sink if the sink cannot store the values.
    pub(super) fn put<S: Sink>(
        &self,
        number: usize,
        plan: &SlicePlan,
        sink: &S,
        scratch: &mut Scratch,
    ) -> Result<(), S::Error> {
        let inside = Part {
            number,
            plan,
            layout: &plan.layout,
            cells: 0..plan.inner,
            fields: [Field::Mean, Field::StdError],
        };
        self.put_part(&inside, sink, scratch)?;
        if plan.overflow > 0 {
            let outside = Part {
                layout: &plan.layout.without_time(),
                cells: plan.inner..plan.inner + plan.overflow,
                fields: [Field::Overflow, Field::OverflowStdError],
                ..inside
            };
            self.put_part(&outside, sink, scratch)?;
        }
        self.put_totals(number, sink)
    }

    /// Writes the standard errors of the totals to a sink.
    fn put_totals<S: Sink>(&self, number: usize, sink: &S) -> Result<(), S::Error> {
        let data: Vec<f32> = self.totals.iter().map(|v| v.sqrt() as f32).collect();
        if data.is_empty() {
            return Ok(());
        }
        sink.put(&Piece {
            slice: number,
            field: Field::TotalStdError,
            start: &self.start,
            shape: &self.shape,
            data: &data,
            touched: &vec![u64::MAX; data.len().div_ceil(STRETCH).div_ceil(64)],
        })
    }

    /// Writes one part of the slice to a sink, one chunk at a time.
    ///
    /// Code that is generic over the sink is compiled in the sink's crate, at the optimization level of that
    /// crate. Loops over entries are therefore separate functions that do not depend on the sink.
    fn put_part<S: Sink>(&self, part: &Part, sink: &S, scratch: &mut Scratch) -> Result<(), S::Error> {
        let (grid, placed) = self.placed(part);
        // A chunk contains all matrix elements or, if there are too many elements, a part of the rows and
        // columns.
        let chunk = |kind| part.layout.find(kind).map_or(1, |i| part.layout.axes[i].chunk as u32);
        let block = [chunk(AxisKind::StokesOut), chunk(AxisKind::StokesIn)];
        for group in placed.chunk_by(|a, b| a.chunk == b.chunk) {
            let Sorted { extent, tall, wide } = self.sorted(group);
            for row in (0..extent.rows).step_by(block[0] as usize) {
                for column in (0..extent.cols).step_by(block[1] as usize) {
                    let matrix = Block { first: [row, column], shape: block };
                    let group = match (row, column) {
                        (0, 0) => group,
                        (_, 0) => &tall,
                        _ => &wide,
                    };
                    let cells = ChunkCells { grid: &grid, group, matrix };
                    self.put_chunk(part, &cells, sink, scratch)?;
                }
            }
        }
        Ok(())
    }

    /// Returns the positions of a part's entries, sorted by chunk.
    fn placed(&self, part: &Part) -> (Grid, Vec<Placed>) {
        let Part { plan, layout, cells, .. } = part;
        let trailing = if plan.elements == 16 { 3 } else { 1 };
        let grid = Grid::new(layout, 2..layout.axes.len() - trailing);
        let mut placed = Vec::with_capacity(self.entries.len());
        for (number, entry) in self.entries.iter().enumerate() {
            let local = entry.key / plan.cells();
            let cell = entry.key - local * plan.cells();
            if cells.contains(&cell) {
                let (chunk, at, volume) = grid.place(cell - cells.start);
                placed.push(Placed { chunk, at: local as usize * volume + at, entry: number as u32 });
            }
        }
        if grid.chunks > 1 {
            placed.sort_unstable_by_key(|p| p.chunk);
        }
        (grid, placed)
    }

    /// Groups the entries of a chunk by the number of rows and columns of their matrices.
    fn sorted(&self, group: &[Placed]) -> Sorted {
        let extent_of = |p: &Placed| self.entries[p.entry as usize].extent;
        // Few cells have elements other than M00. The loops over the other elements visit only these cells.
        let having = |more: fn(Extent) -> bool| -> Vec<Placed> {
            group.iter().filter(|p| more(extent_of(p))).copied().collect()
        };
        Sorted {
            extent: group.iter().fold(Extent { rows: 0, cols: 0 }, |e, p| e.with(extent_of(p))),
            tall: having(|e| e.rows > 1),
            wide: having(|e| e.cols > 1),
        }
    }

    /// Writes one chunk of means and one chunk of errors to a sink.
    fn put_chunk<S: Sink>(
        &self,
        part: &Part,
        cells: &ChunkCells,
        sink: &S,
        scratch: &mut Scratch,
    ) -> Result<(), S::Error> {
        let (start, shape) = self.filled(part, cells, scratch);
        let length = shape.iter().product::<u64>() as usize;
        let written = [(part.fields[0], &scratch.means), (part.fields[1], &scratch.errors)]
            .into_iter()
            .try_for_each(|(field, data)| {
                sink.put(&Piece {
                    slice: part.number,
                    field,
                    start: &start,
                    shape: &shape,
                    data: &data[..length],
                    touched: &scratch.touched,
                })
            });
        scratch.clear();
        written
    }

    /// Fills the scratch buffers with one chunk, and returns the first indices and the shape of the chunk.
    fn filled(&self, part: &Part, cells: &ChunkCells, scratch: &mut Scratch) -> (Vec<u64>, Vec<u64>) {
        let plan = part.plan;
        let ChunkCells { grid, group, matrix } = cells;
        let (mut start, mut shape) = (self.start.to_vec(), self.shape.to_vec());
        grid.extend(group[0].chunk, &mut start, &mut shape);
        if plan.elements == 16 {
            start.extend(matrix.first.map(u64::from));
            shape.extend(matrix.shape.map(u64::from));
        }
        start.push(0);
        shape.push(plan.wavelengths as u64);
        scratch.reserve(shape.iter().product::<u64>() as usize);
        // The number of wavelengths is constant, so that the compiler does not turn copies into calls.
        let scatter = match plan.wavelengths {
            1 => Self::scatter::<1>,
            2 => Self::scatter::<2>,
            3 => Self::scatter::<3>,
            _ => Self::scatter::<4>,
        };
        scatter(self, group, matrix, scratch);
        (start, shape)
    }

    /// Copies the values of the entries in `group` to their positions in the chunk.
    fn scatter<const L: usize>(&self, group: &[Placed], matrix: &Block, scratch: &mut Scratch) {
        for p in group {
            let entry = &self.entries[p.entry as usize];
            for i in matrix.rows(entry.extent) {
                for j in matrix.columns(entry.extent) {
                    let at = (p.at * matrix.count() + matrix.position(i, j)) * L;
                    let [mean, variance] = self.values[(entry.first + i * entry.extent.cols + j) as usize];
                    scratch.means[at..at + L].copy_from_slice(&mean.to_array()[..L]);
                    scratch.errors[at..at + L].copy_from_slice(&variance.sqrt().to_array()[..L]);
                    scratch.touch(at);
                    scratch.touch(at + L - 1);
                }
            }
        }
    }
}

/// The entries of a chunk, grouped by the number of rows and columns of their matrices.
struct Sorted {
    /// Largest number of rows and columns among the entries.
    extent: Extent,
    /// Entries whose matrix has more than one row.
    tall: Vec<Placed>,
    /// Entries whose matrix has more than one column.
    wide: Vec<Placed>,
}

/// A part of a slice: a range of cells, stored in two fields (means and errors) with the same layout.
struct Part<'a> {
    number: usize,
    plan: &'a SlicePlan,
    layout: &'a SliceLayout,
    cells: std::ops::Range<u64>,
    fields: [Field; 2],
}

struct ChunkCells<'a> {
    grid: &'a Grid,
    group: &'a [Placed],
    matrix: Block,
}

/// A block of rows and columns of a Mueller matrix.
struct Block {
    first: [u32; 2],
    shape: [u32; 2],
}

impl Block {
    fn count(&self) -> usize {
        (self.shape[0] * self.shape[1]) as usize
    }

    /// Returns the rows of the block that a matrix of extent `extent` contains.
    fn rows(&self, extent: Extent) -> std::ops::Range<u32> {
        self.first[0]..(self.first[0] + self.shape[0]).min(extent.rows)
    }

    fn columns(&self, extent: Extent) -> std::ops::Range<u32> {
        self.first[1]..(self.first[1] + self.shape[1]).min(extent.cols)
    }

    /// Returns the index of element (i, j) in the block, row-major.
    fn position(&self, i: u32, j: u32) -> usize {
        ((i - self.first[0]) * self.shape[1] + j - self.first[1]) as usize
    }
}

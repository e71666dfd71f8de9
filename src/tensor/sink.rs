//! Where finished tiles go: a store on disk, arrays in memory, or what a caller makes of them.

use crate::axes::SliceLayout;
use crate::field::Field;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Bytes of data that one bit of [`Piece::touched`] stands for.
pub const STRETCH: usize = 256;

/// One slice of a render, as its sink must know it.
#[derive(Clone, Debug)]
pub struct JobSlice {
    /// Name, axes and chunks.
    pub layout: SliceLayout,
    /// What is known of it besides: attributes of a stored group.
    pub attributes: Map<String, Value>,
}

/// A render as its sink must know it before the first tile.
#[derive(Clone, Debug)]
pub struct Job {
    /// The slices, in order; [`Piece::slice`] counts them.
    pub slices: Vec<JobSlice>,
    /// Provenance: scene, seed, samples, devices, units.
    pub attributes: Map<String, Value>,
    /// Camera width and height in pixels.
    pub camera: [u32; 2],
    /// Edge of a tile in camera pixels.
    pub tile: u32,
}

impl Job {
    /// Number of tiles, which are counted row by row.
    #[must_use]
    pub fn tiles(&self) -> u32 {
        self.camera[0].div_ceil(self.tile) * self.camera[1].div_ceil(self.tile)
    }
}

/// Some values of one field of one slice: a box of one chunk. What no piece covers is zero.
#[derive(Clone, Copy, Debug)]
pub struct Piece<'a> {
    /// Number of the slice in [`Job::slices`].
    pub slice: usize,
    /// Which array of it.
    pub field: Field,
    /// First index along every axis of the field.
    pub start: &'a [u64],
    /// Length along every axis.
    pub shape: &'a [u64],
    /// Values, row-major (the last axis is fastest).
    pub data: &'a [f32],
    /// A bit for every [`STRETCH`] bytes of the data, the first one lowest, unset where all are zero.
    pub touched: &'a [u64],
}

/// How many samples of each camera pixel of a tile count.
#[derive(Clone, Copy, Debug)]
pub struct SampleCounts<'a> {
    /// First row and column.
    pub start: [u64; 2],
    /// Rows and columns.
    pub shape: [u64; 2],
    /// Row-major.
    pub counts: &'a [u32],
}

/// What is known of one finished tile.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize, PartialEq)]
pub struct TileRecord {
    /// Tile number, row-major.
    pub tile: u32,
    /// Camera samples taken.
    pub samples: u64,
    /// Samples thrown away because a value was not finite.
    pub discarded: u64,
    /// Rays traced.
    pub rays: u64,
    /// Seconds of one thread.
    pub seconds: f64,
}

/// What a render did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// True if every tile is finished; false after an interruption.
    pub complete: bool,
    /// Tiles that are finished, earlier runs included.
    pub tiles_done: u32,
    /// Tiles in all.
    pub tiles: u32,
    /// Samples discarded, earlier runs included.
    pub discarded: u64,
    /// Samples of this run.
    pub samples: u64,
    /// Rays of this run.
    pub rays: u64,
    /// Rays of earlier runs.
    pub rays_before: u64,
    /// Seconds of this run.
    pub wall_s: f64,
}

/// Takes the tiles of one render. [`Sink::begin`] comes first and [`Sink::end`] last; between them, `put`,
/// `put_samples` and then `tile_done` of a tile come from one thread, those of different tiles from any threads at once.
pub trait Sink: Sync {
    /// Why values were not taken.
    type Error: std::error::Error + Send + Sync + 'static;

    /// Makes ready for a render, and says which tiles of it are finished already.
    ///
    /// # Errors
    /// If there is no place for it.
    fn begin(&mut self, job: &Job) -> Result<Vec<TileRecord>, Self::Error>;

    /// Takes some values.
    ///
    /// # Errors
    /// If they cannot be kept; the render stops.
    fn put(&self, piece: &Piece) -> Result<(), Self::Error>;

    /// Takes the sample counts of a tile.
    ///
    /// # Errors
    /// If they cannot be kept; the render stops.
    fn put_samples(&self, samples: &SampleCounts) -> Result<(), Self::Error>;

    /// All of a tile has been put.
    ///
    /// # Errors
    /// If that cannot be noted; the render stops.
    fn tile_done(&self, record: &TileRecord) -> Result<(), Self::Error>;

    /// The render ends, complete or interrupted.
    ///
    /// # Errors
    /// If it cannot be finished.
    fn end(&mut self, summary: &Summary) -> Result<(), Self::Error>;
}

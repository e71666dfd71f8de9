//! Defines sinks. A sink receives finished tiles, and is a store on disk, arrays in memory, or a custom
//! implementation.

use crate::axes::SliceLayout;
use crate::field::Field;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Number of bytes of data that one bit of [`Piece::touched`] represents.
pub const STRETCH: usize = 256;

/// Description of one slice of a render, passed to the sink.
#[derive(Clone, Debug)]
pub struct JobSlice {
    /// Name, axes and chunks of the slice.
    pub layout: SliceLayout,
    /// Attributes of the slice's group in the store.
    pub attributes: Map<String, Value>,
}

/// Description of a render, passed to the sink before the first tile.
#[derive(Clone, Debug)]
pub struct Job {
    /// Slices, in the order of the index [`Piece::slice`].
    pub slices: Vec<JobSlice>,
    /// Provenance of the render, such as scene, seed, samples, devices and units.
    pub attributes: Map<String, Value>,
    /// Camera width and height, in pixels.
    pub camera: [u32; 2],
    /// Edge length of a tile, in camera pixels.
    pub tile: u32,
}

impl Job {
    /// Returns the number of tiles, which are numbered row by row.
    pub fn tiles(&self) -> u32 {
        self.camera[0].div_ceil(self.tile) * self.camera[1].div_ceil(self.tile)
    }
}

/// Values of one field of one slice in a box inside one chunk. Elements that no piece covers are zero.
#[derive(Clone, Copy, Debug)]
pub struct Piece<'a> {
    /// Index of the slice in [`Job::slices`].
    pub slice: usize,
    pub field: Field,
    /// Index of the first element along every axis of the field.
    pub start: &'a [u64],
    /// Number of elements along every axis.
    pub shape: &'a [u64],
    /// Values of the elements in row-major order (the index of the last axis varies fastest).
    pub data: &'a [f32],
    /// Bit mask with one bit per [`STRETCH`] bytes of data, lowest bit first. A bit is 0 if all corresponding
    /// bytes are zero.
    pub touched: &'a [u64],
}

/// Number of valid samples of each camera pixel of a tile.
#[derive(Clone, Copy, Debug)]
pub struct SampleCounts<'a> {
    /// First row and column of the tile.
    pub start: [u64; 2],
    /// Number of rows and columns of the tile.
    pub shape: [u64; 2],
    /// Number of valid samples per pixel, row-major.
    pub counts: &'a [u32],
}

/// Statistics of one finished tile.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize, PartialEq)]
pub struct TileRecord {
    /// Tile number, row-major.
    pub tile: u32,
    /// Number of camera samples taken.
    pub samples: u64,
    /// Number of samples discarded because a value was not finite.
    pub discarded: u64,
    /// Number of rays traced.
    pub rays: u64,
    /// Time that the rendering thread spent on the tile, in seconds.
    pub seconds: f64,
}

/// Statistics of a render.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// True if every tile is finished, or false after an interruption.
    pub complete: bool,
    /// Number of finished tiles, including those of earlier runs.
    pub tiles_done: u32,
    pub tiles: u32,
    /// Number of discarded samples, including those of earlier runs.
    pub discarded: u64,
    /// Number of camera samples of this run.
    pub samples: u64,
    /// Number of rays of this run.
    pub rays: u64,
    /// Number of rays of earlier runs.
    pub rays_before: u64,
    /// Duration of this run, in seconds.
    pub wall_s: f64,
}

/// Receives the tiles of one render.
///
/// [`Sink::begin`] is called first and [`Sink::end`] last. Between `begin` and `end`, one thread per tile
/// calls `put`, `put_samples` and then `tile_done`. Calls for different tiles may be concurrent.
pub trait Sink: Sync {
    /// Error type of the sink.
    type Error: std::error::Error + Send + Sync + 'static;

    /// Prepares for a render and returns the tiles that are already finished.
    ///
    /// # Errors
    /// Returns an error if the destination cannot be created or opened.
    fn begin(&mut self, job: &Job) -> Result<Vec<TileRecord>, Self::Error>;

    /// Stores a piece of values.
    ///
    /// # Errors
    /// Returns an error if the values cannot be stored. The error stops the render.
    fn put(&self, piece: &Piece) -> Result<(), Self::Error>;

    /// Stores the sample counts of a tile.
    ///
    /// # Errors
    /// Returns an error if the counts cannot be stored. The error stops the render.
    fn put_samples(&self, samples: &SampleCounts) -> Result<(), Self::Error>;

    /// Marks a tile as finished, after all values of the tile have been stored.
    ///
    /// # Errors
    /// Returns an error if the tile cannot be recorded. The error stops the render.
    fn tile_done(&self, record: &TileRecord) -> Result<(), Self::Error>;

    /// Ends a complete or interrupted render.
    ///
    /// # Errors
    /// Returns an error if the output cannot be completed.
    fn end(&mut self, summary: &Summary) -> Result<(), Self::Error>;
}

//! Corners of chessboards in images: saddles, refined by a model of what a corner looks like, joined to a grid.

pub mod grid;
pub mod saddle;
pub mod search;

pub use search::{Found, find};

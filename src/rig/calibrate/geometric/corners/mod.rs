//! Detects chessboard corners in images: finds saddle points, refines them with a corner model, and joins
//! them to a grid.

pub mod grid;
pub mod saddle;
pub mod search;

pub use search::{Found, find};

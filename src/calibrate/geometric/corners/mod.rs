//! Detects chessboard corners. Finds saddle points, fits a corner model, and joins the corners into a grid.

pub mod grid;
pub mod saddle;
pub mod search;

pub use search::{Found, find};

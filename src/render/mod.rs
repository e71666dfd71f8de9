//! From a scene to stored slices of T. Stops at Mueller matrices: no illumination state is applied here.

mod connect;
pub mod path;
pub mod progress;
mod sheets;
pub mod tile;
mod views;

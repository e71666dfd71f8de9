//! From a scene to stored slices of T. Stops at Mueller matrices: no illumination state is applied here.

pub mod bidirectional;
mod bridge;
mod connect;
pub mod coverage;
mod emission;
mod flight;
mod join;
mod join_manifold;
mod manifold;
mod mirrors;
pub mod path;
mod point;
pub mod progress;
mod roulette;
mod sheets;
mod splats;
pub mod tile;
mod tracer;
mod views;
mod walk;
mod weight;

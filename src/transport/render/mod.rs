//! Renders the slices of a scene as tiles, by path sampling, connections and scheduling.

mod bidirectional;
pub mod coverage;
mod emitter_hits;
pub mod gaps;
pub mod layers;
mod manifold;
mod path;
mod roulette;
pub mod schedule;
mod state;
pub mod strategies;
mod subpath;
#[cfg(test)]
mod tests;
mod transmission;

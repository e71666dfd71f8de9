//! From a scene to finished tiles of its slices.

mod aim;
pub mod backend;
mod bidirectional;
mod bridge;
mod connect;
pub mod coverage;
mod emission;
mod environment;
mod flight;
mod gaps;
mod glints;
mod job;
mod join;
mod join_lights;
mod join_manifold;
mod light_walk;
mod manifold;
mod mirrors;
mod mirrors_copied;
mod path;
mod point;
mod roulette;
mod route;
pub mod schedule;
mod sheets;
mod spill;
mod splats;
mod state;
#[cfg(test)]
mod tests;
mod tiles;
mod tracer;
mod views;
mod walk;
mod weight;

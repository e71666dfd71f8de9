//! Sunstone computes polarized, time-resolved light transport: the 7D tensor T(s, s', p, p', t) of
//! Baek & Heide, "Polarimetric Spatio-Temporal Light Transport Probing" (SIGGRAPH Asia 2021).
//!
//! Modules are listed in dependency order: a module uses only those above it.

pub mod spectrum;
pub mod units;

pub mod polarization;
pub mod sampling;

pub mod geometry;

pub mod material;

pub mod medium;

pub mod tensor;

pub mod scene;

pub mod render;

pub mod decompose;

pub mod capture;

pub mod reconstruct;

pub mod figure;

//! Sunstone computes polarized, time-resolved light transport: the 7D tensor T(s, s', p, p', t) of
//! Baek & Heide, "Polarimetric Spatio-Temporal Light Transport Probing" (SIGGRAPH Asia 2021).
//!
//! This is the front door. Behind it are rooms, crates of their own, each of which uses only those above it:
//! [`base`], [`optics`], [`tensor`], [`store`], [`transport`], [`scene`], [`polarimetry`], [`pbrdf`], [`figure`].

pub mod figures;
pub mod render;

pub use {base, figure, optics, pbrdf, polarimetry, scene, store, tensor, transport};

//! Measures shape under subsurface scattering (Baek & Heide 2021, section 8, Fig. 11). Structured light
//! yields depth, and polarization yields normals. The third method combines depth and normals. Each quantity
//! is computed from all light or from epipolar light.
//!
//! > T(s, u) ─ pattern ─► captures ─ code ─► projector column ─ triangulation ─► depth ─► normals
//! >                                                                       └─ with Stokes images ─► fused depth ─► normals
//!
//! Every pattern of structured light drives whole projector columns. A capture is therefore linear in T(s,
//! u), the tensor summed over the projector's rows ([`column_light`]). No separate renders are needed for the
//! patterns.
//!
//! **Frames.** Depths are z along the camera's axis, in metres. Normals are unit vectors in the camera's
//! frame (x right, y down, z forward) that point toward the camera. Unknown values are NaN. Pixel (i, j)
//! covers [i, i+1) × [j, j+1), so the centre of column i is i + ½.

pub mod application;
#[cfg(test)]
mod application_tests;
pub mod column_light;
pub mod errors;
pub mod fusion;
pub mod gray_code;
pub mod joint;
mod learning;
pub mod likelihood;
pub mod log_depth;
pub mod logical_codes;
pub mod methods;
pub mod micro_phase_shift;
pub mod phase_shift;
pub mod polarization;
pub mod propagation;
mod seen;
pub mod surface_normals;
#[cfg(test)]
mod synthetic;
pub mod triangulation;
pub mod zenith;

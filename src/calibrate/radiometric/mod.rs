//! Radiometric calibration of cameras: dark frame, linearity, gain, flat field, correction of
//! frames.
//!
//! > DN = b + d t + y,  y (1 + Σ c_j (y/Y)^j) = r s H,  Var y_lin = σ² + y_lin/g
//!
//! - b: offset of each pixel.
//! - d: dark current of each pixel; t: exposure.
//! - s: response to the light H (irradiance times exposure); r: response of each pixel, with mean
//!   1.
//! - c_j: polynomial that describes the nonlinearity; Y: saturation signal.
//! - g: gain in e⁻/DN by photon transfer. The variance of shot noise equals its mean (EMVA Standard
//!   1288, release 4.0, sections 6 to 8; there K = 1/g).
//!
//! Variances are those between frames, so they exclude differences between pixels.
//!
//! All standard errors are estimated from the frames. `light_sigma` adds the standard error of the
//! light.

pub mod apply;
pub mod dark;
mod error;
pub mod flat;
pub mod levels;
pub mod linearity;
pub mod stack;
pub mod transfer;

pub use error::RadiometricError;

#[cfg(test)]
mod tests;

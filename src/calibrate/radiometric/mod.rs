//! Radiometric calibration of cameras. Determines dark frame, linearity, gain and flat field, and corrects
//! frames.
//!
//! > DN = b + d t + y,  y (1 + Σ c_j (y/Y)^j) = r s H,  Var y_lin = σ² + y_lin/g
//!
//! - b is the offset of each pixel.
//! - d is the dark current of each pixel, and t the exposure time.
//! - s is the response to the light H (irradiance times exposure time), and r the relative response of
//!   each pixel, with mean 1.
//! - c_j are the coefficients of the polynomial that describes the nonlinearity, and Y is the saturation
//!   signal.
//! - g is the gain in e⁻/DN, measured by photon transfer (EMVA Standard 1288, release 4.0, sections 6 to 8,
//!   in which K = 1/g). Photon transfer uses the fact that the variance of the number of electrons equals the
//!   mean number.
//!
//! Variances are those between frames, so they exclude differences between pixels.
//!
//! All standard errors are estimated from the frames. The option `light_sigma` adds the standard error of
//! the light.

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

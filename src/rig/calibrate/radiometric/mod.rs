//! Cameras: dark frame, linearity, gain by photon transfer, flat field, and frames corrected by them.
//!
//! > DN = b + d t + y,  y (1 + Σ c_j (y/Y)^j) = r s H,  Var y_lin = σ² + y_lin/g
//!
//! with each pixel's offset b and dark current d (exposure t), the response s to light H (irradiance times exposure), each pixel's
//! response r about a mean of 1, a polynomial by which the camera departs from a line (Y the signal at which it saturates), and
//! the gain g in e⁻/DN by photon transfer: shot noise has the variance of its mean (EMVA Standard 1288, release 4.0, sections
//! 6 to 8; there K = 1/g). Variances are those from frame to frame, so differences between pixels do not enter them.
//!
//! All standard errors are by counting, of what the frames themselves show; `light_sigma` adds that of the light.

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

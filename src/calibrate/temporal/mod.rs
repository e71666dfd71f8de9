//! Temporal calibration of photon counters from histograms of a plane. Determines the time zero of each
//! pixel, the response to a short pulse, and the clock.
//!
//! > λ_i = A [H((i+1)Δ - t - z) - H(iΔ - t - z)] + B + p y_i/A_i
//!
//! λ_i is the number of detections per pulse in bin i while the diode is armed.
//!
//! - A is the signal of the pulse, t the known travel time of light, Δ the bin width, and z the time zero
//!   of the pixel.
//! - H is the cumulative response ([`polarimetry::capture::detector::response`]). The centre of its
//!   Gaussian part defines the time zero.
//! - B is the rate of ambient light and dark counts.
//! - p is the probability of afterpulses. y_i is the number of afterpulses in bin i that the histogram's
//!   counts would cause for p = 1.
//! - A_i is the number of pulses for which the diode is armed in bin i
//!   ([`polarimetry::capture::detector::pile_up`]). A_i accounts for pile-up in the likelihood:
//!
//! > synchronous: ln L = Σ n_i ln(1 - exp(-λ_i)) - (A_i - n_i) λ_i
//! >
//! > free-running: ln L = Σ n_i ln λ_i - A_i λ_i
//!
//! The synchronous formula is exact. The free-running formula is the likelihood of a point process,
//! and assumes that bins are short compared with the dead time. Fisher scoring finds the maximum.
//!
//! All pixels share the response, which is fitted to the brightest captures jointly with A, B and z of
//! these captures. The error of each pixel's z combines the error from the pixel's counts with the error
//! of the response.

pub mod aligned;
pub mod captures;
mod impulse;
mod likelihood;
mod response_fit;
pub mod template;
pub mod zero;

pub use impulse::{Impulse, Shape};

#[cfg(test)]
mod tests;

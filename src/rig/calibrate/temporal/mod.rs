//! Photon counters: each pixel's time zero, the response to a short pulse, and the clock, from histograms of a plane.
//!
//! > λ_i = A [H((i+1)Δ - t - z) - H(iΔ - t - z)] + B + p y_i/A_i
//!
//! detections per pulse in bin i while the diode is armed: A of the pulse, whose travel time t is known, z the pixel's time
//! zero, H the response ([`polarimetry::capture::detector::response`], whose Gaussian part is centred on 0: that says what
//! "zero" means), B of light from elsewhere and dark counts, and after-pulses of probability p that the histogram's own
//! counts make some time later, y_i. What is known of counts is how many pulses A_i found the diode armed
//! ([`polarimetry::capture::detector::pile_up`]), so pile-up is part of the likelihood:
//!
//! > synchronous: ln L = Σ n_i ln(1 - exp(-λ_i)) - (A_i - n_i) λ_i;  free-running: ln L = Σ n_i ln λ_i - A_i λ_i.
//!
//! The first is exact, the second that of a point process with this intensity (bins short against the dead time). The maximum is
//! found by Fisher's scoring. The response is that of all pixels, so it is fitted to the brightest captures together, their
//! A, B and z beside it; each pixel's z then has its own error and the response's.

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

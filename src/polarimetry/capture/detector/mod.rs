//! Simulates detectors. A detector model computes the readings of an instrument for a known radiance, and
//! estimates the radiance from the readings.
//!
//! > radiance → (shot noise, dark counts, clipping, dead time) → readings → radiance with its variance
//!
//! Simulated measurements of a render are therefore processed in the same way as laboratory measurements.
//! [`cmos`] is a camera (linear model of EMVA 1288). [`polarizer_array`] is the mosaic of polarizers on the
//! camera's sensor. [`spad`] is a single-photon avalanche diode with time-correlated counting. Radiance is in
//! the scene's units. The factor `photons_per_unit` converts radiance to photons.
//!
//! All random numbers come from counter-based streams ([`random::stream`]), so readings do not depend on
//! threads or order.

pub mod cmos;
pub mod error;
pub mod estimate;
pub mod file;
pub mod pile_up;
pub mod polarizer_array;
pub mod random;
pub mod response;
pub mod spad;
mod tcspc;
#[cfg(test)]
pub(super) mod testing;

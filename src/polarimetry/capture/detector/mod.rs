//! Detectors: what instruments read where the renderer knows the radiance, and what such readings tell of it.
//!
//! > radiance → (shot noise, dark counts, clipping, dead time) → readings → radiance with its variance
//!
//! Both directions are here, so a measurement can be made of a render and then be treated as one of a laboratory:
//! [`cmos`] is a camera (EMVA 1288's linear model), [`polarizer_array`] the mosaic of polarizers on its sensor, and
//! [`spad`] a single-photon avalanche diode with time-correlated counting. Units of radiance are the scene's; one
//! scale, `photons_per_unit`, leads from them to photons.
//!
//! All random numbers come from counter-based streams ([`random::stream`]), so readings do not depend on threads or order.

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

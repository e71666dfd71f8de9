//! Probes a stored tensor: selects, sums, contracts and convolves the tensor chunk by chunk.
//!
//! Baek & Heide (2021) define the operations:
//! - Contraction with an illumination, I(s,p,t) = Σ_{s',p'} T P (`eq:general_light_transport`).
//! - Convolution with a pulse along t.
//! - The classical matrices (`eq:tensor2pol`) T_s = Σ_t T(:,:,0,0,t), T_t = Σ_{s,s'} T(s,s',0,0,:), T_p =
//!   Σ_{s,s',t} T(s,s',:,:,t).
//!
//! All steps are linear, so a probe is one weighted sum. The sum is computed in f64 in a fixed order, so
//! the result does not depend on the number of threads. Memory usage is limited to the result and, per
//! thread, one row of chunks of camera pixels.
//!
//! **Standard errors.** Elements of one camera pixel are estimated from the same samples and may be
//! correlated in any way. The standard error of a weighted sum over elements of one pixel has the bound
//! Σ|w|·se, which is valid for any correlation. Different camera pixels are estimated from different samples,
//! so errors add in quadrature over y and x.

mod engine;
mod error;
mod left_out;
mod parse;
mod pattern;
mod plan;
mod request;
mod run;
mod write;

pub use self::error::ProbeError;
pub use self::left_out::LeftOut;
pub use self::parse::{ParseError, parse_axes, parse_stokes};
pub use self::pattern::Pattern;
pub use self::request::{CoordRange, Probe, Pulse, Selection};
pub use self::run::ProbeResult;
pub use self::write::{std_error_path, write_npy};

#[cfg(test)]
mod tests;

//! Probing: slicing, summing, contracting and convolving a stored tensor, chunk by chunk.
//!
//! After the tensor theory of Baek & Heide 2021: contraction with an illumination, I(s,p,t) = Σ_{s',p'} T P
//! (`eq:general_light_transport`), convolution with a pulse along t, and the classical matrices (`eq:tensor2pol`)
//! T_s = Σ_t T(:,:,0,0,t), T_t = Σ_{s,s'} T(s,s',0,0,:), T_p = Σ_{s,s',t} T(s,s',:,:,t).
//!
//! All of it is linear, so a probe is one weighted sum, done in f64 in a fixed order: the result does not depend on
//! the number of threads. What is in memory is the result and, per thread, one row of chunks of camera pixels.
//!
//! **Standard errors.** Elements of one camera pixel are estimated from the same samples and may be correlated in
//! any way, so a weighted sum over them gets the bound Σ|w|·se, which holds whatever the correlation. Different
//! camera pixels are estimated from different samples, so over y and x errors add in quadrature.

mod engine;
mod parse;
mod pattern;
mod plan;
mod write;

use std::path::PathBuf;

use crate::zarr::{AccessError, CreateError, StoredSlice};
use tensor::array::Tensor;
use tensor::axes::AxisKind;
use tensor::field::Field;

pub use self::parse::{ParseError, parse_axes, parse_stokes};
pub use self::pattern::Pattern;
pub use self::write::{std_error_path, write_npy};

/// What to keep of one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Selection {
    /// The axis.
    pub axis: AxisKind,
    /// The coordinates to keep, in the unit of the axis.
    pub range: CoordRange,
}

impl Selection {
    /// The entry nearest to a coordinate; the axis disappears.
    #[must_use]
    pub fn nearest(axis: AxisKind, coordinate: f64) -> Self {
        Self {
            axis,
            range: CoordRange::Nearest(coordinate),
        }
    }
}

/// Coordinates along an axis, in its unit (pixel, ps, nm or index).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CoordRange {
    /// The entry nearest to the coordinate; the axis disappears.
    Nearest(f64),
    /// From the entry nearest to the first to the entry nearest to the second, both included; the axis stays.
    /// Bin edges work too: halfway between two entries, a range begins with the later and ends with the earlier.
    /// Infinite ends mean "from the start" and "to the end".
    Between(f64, f64),
}

/// A light pulse, to convolve the time axis with. Its sum is made 1, so that it moves light and makes none.
#[derive(Clone, Debug, PartialEq)]
pub enum Pulse {
    /// A Gaussian centred on the emission time, sampled at the bin spacing.
    Gaussian {
        /// Full width at half maximum in picoseconds.
        fwhm_ps: f64,
    },
    /// Samples at the bin spacing; the first is at the emission time.
    Samples(Vec<f64>),
}

/// What to do with a stored slice. Steps apply in this order: contraction with pattern and Stokes state, convolution
/// with the pulse, selection, sum. The default probe returns the slice as it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Probe {
    /// Parts of axes to keep; at most one selection an axis.
    pub select: Vec<Selection>,
    /// Axes to sum over what is selected of them. Axes that the slice does not resolve are summed already.
    pub sum: Vec<AxisKind>,
    /// Drive of every projector pixel, P(s'): contracts v and u.
    pub pattern: Option<Pattern>,
    /// Stokes state that leaves every projector pixel, p' (projector frame): contracts `stokes_in`.
    pub stokes: Option<[f32; 4]>,
    /// Pulse shape along t.
    pub pulse: Option<Pulse>,
}

/// The result of a probe.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeResult {
    /// Values, W/(m² sr nm) per unit projector drive, over the axes that are left.
    pub mean: Tensor,
    /// Standard errors of `mean` (see the module), same shape.
    pub std_error: Tensor,
    /// The same probe of the light that arrived outside the stored time bins; without a time axis. `None` if the
    /// slice does not resolve time.
    pub overflow: Option<Tensor>,
    /// Light that the pulse moved out of the stored time bins; without a time axis. `None` without a pulse.
    pub shifted_out: Option<Tensor>,
    /// First edge and bin width of the time axis in picoseconds, if there is one.
    pub time: Option<(f64, f64)>,
    /// What the person should know: drive on projector pixels that the slice does not keep, and the like.
    pub notes: Vec<String>,
}

/// A probe does not fit the slice, or the slice cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ProbeError {
    /// An axis is selected that the slice does not have.
    #[error("slice `{slice}` has no axis `{axis}`; it has: {available}")]
    NoAxis {
        /// Name of the slice.
        slice: String,
        /// The axis asked for.
        axis: &'static str,
        /// The axes it has.
        available: String,
    },
    /// A selection is empty or ambiguous.
    #[error("selection on axis `{axis}`: {reason}")]
    Selection {
        /// The axis.
        axis: &'static str,
        /// What is wrong and how to mend it.
        reason: String,
    },
    /// A pattern does not fit the projector axes.
    #[error("pattern of {width} × {height} pixels for slice `{slice}`: {reason}")]
    Pattern {
        /// Name of the slice.
        slice: String,
        /// Width of the pattern in pixels.
        width: u32,
        /// Height of the pattern in pixels.
        height: u32,
        /// What is wrong and how to mend it.
        reason: String,
    },
    /// A Stokes state is given, but the slice was stored for unpolarized light alone.
    #[error(
        "slice `{slice}` keeps intensity alone: give the Stokes state 1,0,0,0 or render polarization `mueller`"
    )]
    Stokes {
        /// Name of the slice.
        slice: String,
    },
    /// A pulse cannot be applied.
    #[error("pulse for slice `{slice}`: {reason}")]
    Pulse {
        /// Name of the slice.
        slice: String,
        /// What is wrong and how to mend it.
        reason: String,
    },
    /// The result does not fit in memory.
    #[error("the result would hold {elements} elements: select less, or sum over an axis")]
    TooLarge {
        /// Number of elements.
        elements: u128,
    },
    /// The slice cannot be read.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// A store for the result cannot be created.
    #[error(transparent)]
    Create(#[from] CreateError),
    /// A file cannot be written.
    #[error("cannot write {path}: {cause}; check that the directory is writable and the disk has room")]
    Write {
        /// The file.
        path: PathBuf,
        /// The refusal.
        cause: String,
    },
}

impl Probe {
    /// T_s = Σ_t T(:,:,0,0,t): spatial light transport. Bounces and components are summed, wavelengths kept.
    #[must_use]
    pub fn spatial() -> Self {
        Self::unpolarized(&[AxisKind::T])
    }

    /// T_t = Σ_{s,s'} T(s,s',0,0,:): temporal light transport. Bounces and components are summed, wavelengths kept.
    #[must_use]
    pub fn temporal() -> Self {
        Self::unpolarized(&[AxisKind::Y, AxisKind::X, AxisKind::V, AxisKind::U])
    }

    /// T_p = Σ_{s,s',t} T(s,s',:,:,t): polarimetric light transport, a Mueller matrix. Bounces and components are
    /// summed, wavelengths kept.
    #[must_use]
    pub fn polarimetric() -> Self {
        use AxisKind::{Bounces, Component, T, U, V, X, Y};
        Self {
            sum: vec![Y, X, V, U, T, Bounces, Component],
            ..Self::default()
        }
    }

    fn unpolarized(sum: &[AxisKind]) -> Self {
        let mut probe = Self {
            sum: sum.to_vec(),
            ..Self::default()
        };
        probe.sum.extend([AxisKind::Bounces, AxisKind::Component]);
        probe.select = [AxisKind::StokesOut, AxisKind::StokesIn]
            .map(|axis| Selection::nearest(axis, 0.0))
            .into();
        probe
    }

    /// Probes a slice.
    ///
    /// # Errors
    /// If the probe does not fit the slice, the result does not fit in memory, or a chunk is damaged.
    pub fn run(&self, slice: &StoredSlice) -> Result<ProbeResult, ProbeError> {
        let plan = plan::Plan::new(self, slice, Field::Mean)?;
        let (mean, std_error, shifted_out) = engine::run(&plan, slice, Field::Mean, Field::StdError)?;
        let overflow = if slice.has(Field::Overflow) {
            let plan = plan::Plan::new(&self.without_time(), slice, Field::Overflow)?;
            Some(engine::run(&plan, slice, Field::Overflow, Field::OverflowStdError)?.0)
        } else {
            None
        };
        Ok(ProbeResult {
            mean,
            std_error,
            overflow,
            shifted_out,
            time: plan.time,
            notes: plan.notes,
        })
    }

    /// The same probe for arrays without a time axis.
    fn without_time(&self) -> Self {
        let mut probe = self.clone();
        probe.select.retain(|s| s.axis != AxisKind::T);
        probe.pulse = None;
        probe
    }
}

#[cfg(test)]
mod tests;

//! What can be asked of a stored slice.

use super::pattern::Pattern;
use tensor::axes::AxisKind;

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

impl Probe {
    /// T_s = Σ_t T(:,:,0,0,t): spatial light transport. Bounces, components and labels are summed, wavelengths kept.
    #[must_use]
    pub fn spatial() -> Self {
        Self::unpolarized(&[AxisKind::T])
    }

    /// T_t = Σ_{s,s'} T(s,s',0,0,:): temporal light transport. Bounces, components and labels are summed, wavelengths kept.
    #[must_use]
    pub fn temporal() -> Self {
        Self::unpolarized(&[AxisKind::Y, AxisKind::X, AxisKind::V, AxisKind::U])
    }

    /// T_p = Σ_{s,s',t} T(s,s',:,:,t): polarimetric light transport, a Mueller matrix. Bounces, components and labels
    /// are summed, wavelengths kept.
    #[must_use]
    pub fn polarimetric() -> Self {
        use AxisKind::{Bounces, Component, Label, T, U, V, X, Y};
        Self {
            sum: vec![Y, X, V, U, T, Bounces, Component, Label],
            ..Self::default()
        }
    }

    fn unpolarized(sum: &[AxisKind]) -> Self {
        let mut probe = Self {
            sum: sum.to_vec(),
            ..Self::default()
        };
        probe
            .sum
            .extend([AxisKind::Bounces, AxisKind::Component, AxisKind::Label]);
        probe.select = [AxisKind::StokesOut, AxisKind::StokesIn]
            .map(|axis| Selection::nearest(axis, 0.0))
            .into();
        probe
    }

    /// The same probe for arrays without a time axis.
    pub(super) fn without_time(&self) -> Self {
        let mut probe = self.clone();
        probe.select.retain(|s| s.axis != AxisKind::T);
        probe.pulse = None;
        probe
    }
}

//! Defines requests to a stored slice: selections, pulses and probes.

use super::pattern::Pattern;
use tensor::axes::AxisKind;

/// The part of one axis that a probe keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Selection {
    pub axis: AxisKind,
    /// Coordinates to keep, in the unit of the axis.
    pub range: CoordRange,
}

impl Selection {
    /// Selects the entry nearest to a coordinate, and removes the axis.
    pub fn nearest(axis: AxisKind, coordinate: f64) -> Self {
        Self { axis, range: CoordRange::Nearest(coordinate) }
    }
}

/// Coordinates along an axis, in the unit of the axis (pixel, ps, nm or index).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CoordRange {
    /// The entry nearest to the coordinate. The axis is removed.
    Nearest(f64),
    /// All entries from the entry nearest to the first coordinate to the entry nearest to the second
    /// coordinate, both included. The axis is kept. Bin edges are also valid coordinates. At a coordinate
    /// halfway between two entries, a range begins with the later entry or ends with the earlier entry.
    /// Negative and positive infinity select the start and the end of the axis.
    Between(f64, f64),
}

/// A light pulse for convolution along the time axis. The pulse is normalized to the sum 1, which preserves
/// energy.
#[derive(Clone, Debug, PartialEq)]
pub enum Pulse {
    /// A Gaussian pulse centred on the emission time, sampled at the bin spacing.
    Gaussian {
        /// Full width at half maximum in picoseconds.
        fwhm_ps: f64,
    },
    /// Samples of the pulse at the bin spacing, beginning at the emission time.
    Samples(Vec<f64>),
}

/// A probe of a stored slice. The default probe returns the slice unchanged. The steps apply in the following
/// order:
/// 1. Contraction with the pattern and the Stokes state.
/// 2. Convolution with the pulse.
/// 3. Selection.
/// 4. Sum.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Probe {
    /// Parts of axes to keep, with at most one selection per axis.
    pub select: Vec<Selection>,
    /// Axes to sum over, within their selections. Axes that the slice does not resolve are ignored, because
    /// they are already summed.
    pub sum: Vec<AxisKind>,
    /// Drive P(s') of every projector pixel, 0..1. The probe contracts the axes v and u with this pattern.
    pub pattern: Option<Pattern>,
    /// Stokes state p' of the light from every projector pixel, in the projector frame. The probe contracts
    /// the axis `stokes_in` with this state.
    pub stokes: Option<[f32; 4]>,
    /// Pulse with which the probe convolves the axis t.
    pub pulse: Option<Pulse>,
}

impl Probe {
    /// Returns the probe of spatial light transport, T_s = Σ_t T(:,:,0,0,t). Bounces, components and labels
    /// are summed. Wavelengths are kept.
    pub fn spatial() -> Self {
        Self::unpolarized(&[AxisKind::T])
    }

    /// Returns the probe of temporal light transport, T_t = Σ_{s,s'} T(s,s',0,0,:). Bounces, components and
    /// labels are summed. Wavelengths are kept.
    pub fn temporal() -> Self {
        Self::unpolarized(&[AxisKind::Y, AxisKind::X, AxisKind::V, AxisKind::U])
    }

    /// Returns the probe of polarimetric light transport, the Mueller matrix T_p = Σ_{s,s',t} T(s,s',:,:,t).
    /// Bounces, components and labels are summed. Wavelengths are kept.
    pub fn polarimetric() -> Self {
        use AxisKind::{Bounces, Component, Label, T, U, V, X, Y};
        Self { sum: vec![Y, X, V, U, T, Bounces, Component, Label], ..Self::default() }
    }

    fn unpolarized(sum: &[AxisKind]) -> Self {
        let mut probe = Self { sum: sum.to_vec(), ..Self::default() };
        probe.sum.extend([AxisKind::Bounces, AxisKind::Component, AxisKind::Label]);
        probe.select =
            [AxisKind::StokesOut, AxisKind::StokesIn].map(|axis| Selection::nearest(axis, 0.0)).into();
        probe
    }

    /// Returns a copy of the probe without the steps along the time axis, for arrays that lack this axis.
    pub(super) fn without_time(&self) -> Self {
        let mut probe = self.clone();
        probe.select.retain(|s| s.axis != AxisKind::T);
        probe.pulse = None;
        probe
    }
}

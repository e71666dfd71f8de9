//! Selection of the parts of T(s, s', p, p', t) to keep: one independent choice per axis.
//!
//! A [`Slice`] is plain data, already resolved against the scene. All slices are filled in the same pass.

/// Selection and layout of camera pixels s (axes `y`, `x`).
#[derive(Clone, Debug, PartialEq)]
pub enum CameraSelect {
    /// All pixels.
    All,
    /// Whole rows (increasing y indices): axes `y` (listed rows) and `x`.
    Rows(Vec<u32>),
    /// Whole columns (increasing x indices): axes `y` and `x` (listed columns).
    Columns(Vec<u32>),
    /// A rectangle of pixels.
    Block(Block),
    /// Means over boxes of `nx` × `ny` pixels.
    Binned {
        /// Columns per box.
        nx: u32,
        /// Rows per box.
        ny: u32,
    },
}

/// Selection of projector pixels s' (axes `v` row and `u` column, if resolved).
#[derive(Clone, Debug, PartialEq)]
pub enum ProjectorSelect {
    /// Σ over all s', including light that has no s', such as that of a point emitter. No axis.
    Sum,
    /// All s'.
    All,
    /// Whole projector rows (increasing v indices).
    Rows(Vec<u32>),
    /// Whole projector columns (increasing u indices).
    Columns(Vec<u32>),
    /// A rectangle of projector pixels.
    Block(Block),
    /// Sums over boxes of `nx` × `ny` projector pixels: the response to a fully lit box.
    Binned {
        /// Columns per box.
        nx: u32,
        /// Rows per box.
        ny: u32,
    },
    /// Σ over s' weighted per projector pixel (row-major): a drive image in 0..1, or a coordinate. No axis.
    Mask {
        /// Name of the image or coordinate.
        name: String,
        /// One weight per projector pixel.
        weights: Vec<f32>,
    },
    /// Σ over the s' whose centre is within the half width of the epipolar line of s. No axis.
    Epipolar {
        /// Half width of the strip around the line, in projector pixels.
        half_width_px: f32,
    },
    /// The s' of [`Self::Epipolar`], summed by column or row: one axis, `u` or `v`.
    EpipolarAlong {
        /// Half width of the strip around the line, in projector pixels.
        half_width_px: f32,
        /// Axis that resolves them.
        along: ProjectorAxis,
    },
    /// Σ over all other s'. No axis.
    NonEpipolar {
        /// Half width of the excluded strip, in projector pixels.
        half_width_px: f32,
    },
    /// Only s' = s (camera and projector have the same resolution). No axis.
    Coaxial,
    /// Only light that has no s': that of all emitters except the projector. No axis.
    Ambient,
}

/// An axis of the projector's image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProjectorAxis {
    /// Columns (axis `u`).
    U,
    /// Rows (axis `v`).
    V,
}

/// A rectangle of pixels: `x`, `y` the first column and row, `w`, `h` the size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    pub x: u32,
    pub y: u32,
    pub w: u32,
    pub h: u32,
}

/// Selection of travel time t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TimeSelect {
    /// Steady state: Σ over all t. No axis.
    Sum,
    /// `bins` bins of `bin_ps` picoseconds from `start_ps`; the overflow array stores light outside the bins.
    Bins {
        /// First edge, in picoseconds.
        start_ps: f64,
        /// Width of a bin, in picoseconds.
        bin_ps: f64,
        /// Number of bins.
        bins: u32,
    },
}

/// Selection of the Stokes dimensions p, p'.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Polarization {
    /// All 16 Mueller elements: axes `stokes_out`, `stokes_in`.
    Mueller,
    /// M00 only: unpolarized light in, intensity out. No axis.
    Intensity,
}

/// One slice of the tensor: a choice for every axis, and optional axes that no real camera can measure.
#[derive(Clone, Debug, PartialEq)]
pub struct Slice {
    /// Name of the group in the store.
    pub name: String,
    pub camera: CameraSelect,
    pub projector: ProjectorSelect,
    pub time: TimeSelect,
    pub polarization: Polarization,
    /// Resolves the number of surface interactions (axis `bounces`, 0 = emitter seen directly).
    pub bounces: bool,
    /// Separates direct light, whose only surface interaction was lit by the emitter (component 0), from all
    /// other light (component 1, "indirect"): axis `component`.
    pub split_first_bounce: bool,
    /// Separates light by its path's label: axis `label`, with the sets of [`crate::label`].
    pub labels: bool,
}

//! Defines which parts of T(s, s', p, p', t) a render stores, with one independent choice per dimension.
//!
//! A [`Slice`] contains only resolved data, without references to the scene. One render fills all slices.

/// Selection and layout of camera pixels s (axes `y`, `x`).
#[derive(Clone, Debug, PartialEq)]
pub enum CameraSelect {
    /// All camera pixels.
    All,
    /// Whole rows, given by increasing y indices. The axis `y` contains only these rows.
    Rows(Vec<u32>),
    /// Whole columns, given by increasing x indices. The axis `x` contains only these columns.
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

/// Selection of projector pixels s' (axes `v` for rows and `u` for columns).
#[derive(Clone, Debug, PartialEq)]
pub enum ProjectorSelect {
    /// Sum over all s'. The sum includes light without an s', such as light from a point emitter. Adds no
    /// axis.
    Sum,
    /// All projector pixels.
    All,
    /// Whole projector rows, given by increasing v indices.
    Rows(Vec<u32>),
    /// Whole projector columns, given by increasing u indices.
    Columns(Vec<u32>),
    /// A rectangle of projector pixels.
    Block(Block),
    /// Sums over boxes of `nx` × `ny` projector pixels. Each sum is the response to a box whose pixels all
    /// have drive 1.
    Binned {
        /// Columns per box.
        nx: u32,
        /// Rows per box.
        ny: u32,
    },
    /// Weighted sum over s'. The weight of a projector pixel is its value in a drive image (0..1) or its
    /// coordinate. Adds no axis.
    Mask {
        /// Name of the drive image or coordinate.
        name: String,
        /// One weight per projector pixel, row-major.
        weights: Vec<f32>,
    },
    /// Sum over the s' whose centres are at most the half width away from the epipolar line of s. Adds no
    /// axis.
    Epipolar {
        /// Half width of the strip around the line, in projector pixels.
        half_width_px: f32,
    },
    /// The s' of [`Self::Epipolar`], summed by projector column or row. Adds one axis, `u` or `v`.
    EpipolarAlong {
        /// Half width of the strip around the line, in projector pixels.
        half_width_px: f32,
        /// Projector axis that the slice resolves.
        along: ProjectorAxis,
    },
    /// Sum over all s' outside the strip around the epipolar line of s. Adds no axis.
    NonEpipolar {
        /// Half width of the excluded strip, in projector pixels.
        half_width_px: f32,
    },
    /// Only s' = s (camera and projector have the same resolution). Adds no axis.
    Coaxial,
    /// Only light without an s', from emitters other than the projector. Adds no axis.
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

/// A rectangle of pixels: first column `x`, first row `y`, width `w` and height `h`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    pub x: u32,
    pub y: u32,
    pub w: u32,
    pub h: u32,
}

/// Selection of the travel time t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TimeSelect {
    /// Steady state: sum over all t. Adds no axis.
    Sum,
    /// Time bins of equal width. The overflow array stores the light outside the bins.
    Bins {
        /// First edge of the first bin, in picoseconds.
        start_ps: f64,
        /// Width of a bin, in picoseconds.
        bin_ps: f64,
        bins: u32,
    },
}

/// Selection of the Stokes dimensions p, p'.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Polarization {
    /// All 16 Mueller elements. Adds the axes `stokes_out` and `stokes_in`.
    Mueller,
    /// Only M00, the intensity response to unpolarized light. Adds no axis.
    Intensity,
}

/// One slice of the tensor, with a choice for every dimension and with optional axes that no real camera can
/// measure.
#[derive(Clone, Debug, PartialEq)]
pub struct Slice {
    /// Name of the group in the store.
    pub name: String,
    pub camera: CameraSelect,
    pub projector: ProjectorSelect,
    pub time: TimeSelect,
    pub polarization: Polarization,
    /// True if the slice resolves the number of surface interactions (axis `bounces`). The number is 0 for an
    /// emitter that the camera sees directly.
    pub bounces: bool,
    /// True if the slice separates direct from indirect light (axis `component`). Component 0 is light with a
    /// single surface interaction, at a surface that an emitter illuminates directly. Component 1 is all
    /// other light.
    pub split_first_bounce: bool,
    /// True if the slice separates light by the label of the path (axis `label`, see [`crate::label`]).
    pub labels: bool,
}

//! What to keep of T(s, s', p, p', t): one independent choice per axis.
//!
//! A [`Slice`] is plain data, already resolved against the scene (files read, names checked). All slices of a
//! render are filled in the same pass.

/// Which camera pixels s are kept, and how they are laid out (axes `y`, `x`).
#[derive(Clone, Debug, PartialEq)]
pub enum CameraSelect {
    /// Every pixel.
    All,
    /// Whole rows (y indices, rising): axes `y` (listed rows) and `x`.
    Rows(Vec<u32>),
    /// Whole columns (x indices, rising): axes `y` and `x` (listed columns).
    Columns(Vec<u32>),
    /// A rectangle of pixels.
    Block(Block),
    /// Means over boxes of `nx` × `ny` pixels.
    Binned {
        /// Columns in a box.
        nx: u32,
        /// Rows in a box.
        ny: u32,
    },
}

/// Which projector pixels s' are kept (axes `v` row, `u` column where they are resolved).
#[derive(Clone, Debug, PartialEq)]
pub enum ProjectorSelect {
    /// Σ over every s' (and over light that has no s', such as a point emitter's). No axis.
    Sum,
    /// Every s'.
    All,
    /// Whole projector rows (v indices, rising).
    Rows(Vec<u32>),
    /// Whole projector columns (u indices, rising).
    Columns(Vec<u32>),
    /// A rectangle of projector pixels.
    Block(Block),
    /// Sums over boxes of `nx` × `ny` projector pixels (the response to a box lit as a whole).
    Binned {
        /// Columns in a box.
        nx: u32,
        /// Rows in a box.
        ny: u32,
    },
    /// Σ over s' with a weight per projector pixel, row-major: a drive image in 0..1, or a coordinate. No axis.
    Mask {
        /// Name of the image or coordinate.
        name: String,
        /// One weight per projector pixel.
        weights: Vec<f32>,
    },
    /// Σ over the s' whose centre lies within the half width (projector pixels) of the epipolar line of s. No axis.
    Epipolar {
        /// Half width of the strip about the line, projector pixels.
        half_width_px: f32,
    },
    /// The s' of [`Self::Epipolar`], resolved by their column or row: one axis, `u` or `v`, each entry Σ over those in it.
    EpipolarAlong {
        /// Half width of the strip about the line, projector pixels.
        half_width_px: f32,
        /// What resolves them.
        along: ProjectorAxis,
    },
    /// Σ over all other s'. No axis.
    NonEpipolar {
        /// Half width of the strip that is left out, projector pixels.
        half_width_px: f32,
    },
    /// Only s' = s (camera and projector have the same resolution). No axis.
    Coaxial,
    /// Only light that has no s': of all emitters but the projector. No axis.
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
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub w: u32,
    /// Rows.
    pub h: u32,
}

/// What is kept of travel time t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TimeSelect {
    /// Steady state: Σ over all t. No axis.
    Sum,
    /// `bins` bins of `bin_ps` picoseconds from `start_ps`; light outside goes into the overflow array.
    Bins {
        /// First edge, picoseconds.
        start_ps: f64,
        /// Width of a bin, picoseconds.
        bin_ps: f64,
        /// Number of bins.
        bins: u32,
    },
}

/// What is kept of the Stokes dimensions p, p'.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Polarization {
    /// All 16 Mueller elements: axes `stokes_out`, `stokes_in`.
    Mueller,
    /// M00 alone: unpolarized light in, intensity out. No axis.
    Intensity,
}

/// One slice of the tensor: a choice for every axis, plus axes that no real camera could see.
#[derive(Clone, Debug, PartialEq)]
pub struct Slice {
    /// Name of the group in the store.
    pub name: String,
    /// Camera pixels.
    pub camera: CameraSelect,
    /// Projector pixels.
    pub projector: ProjectorSelect,
    /// Travel time.
    pub time: TimeSelect,
    /// Stokes dimensions.
    pub polarization: Polarization,
    /// Resolve the number of surface interactions (axis `bounces`, 0 = emitter seen directly).
    pub bounces: bool,
    /// Split into light whose one surface interaction was lit by the emitter (component 0, "direct") and all the
    /// rest (component 1, "indirect"): axis `component`.
    pub split_first_bounce: bool,
    /// Part light by what its path did: axis `label`, whose coordinates are the sets of [`crate::label`].
    pub labels: bool,
}

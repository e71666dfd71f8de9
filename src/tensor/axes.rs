//! Defines the named axes of a stored slice, with their units and their fixed order.
//!
//! The order is `y, x | v, u | t | bounces | component | label | stokes_out, stokes_in | wavelength`. An axis
//! is present only if the slice resolves its dimension. `wavelength` is always last, so that the values of
//! all wavelengths fill the lanes of one SIMD register.

use super::label;
use super::slice::{Block, CameraSelect, Polarization, ProjectorAxis, ProjectorSelect, Slice, TimeSelect};

/// Maximum number of elements in a chunk (8 MiB of f32). The limit ensures that memory usage depends only on
/// the tile size.
pub const MAX_CHUNK_ELEMENTS: u64 = 1 << 21;

/// Number of elements of a chunk (4 MiB of f32) above which each matrix element has separate chunks. With
/// separate chunks, matrix elements that are zero in a whole tile need no chunks. A reader can read one
/// matrix element without the other 15 elements.
const WHOLE_MATRIX_ELEMENTS: u64 = 1 << 20;

/// Dimension of the transport tensor T that an axis resolves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AxisKind {
    /// Camera row.
    Y,
    /// Camera column.
    X,
    /// Projector row.
    V,
    /// Projector column.
    U,
    /// Travel time.
    T,
    /// Number of surface interactions of the path.
    Bounces,
    /// Component of the light: 0 direct, 1 indirect.
    Component,
    /// Kinds of interactions of the path, as a set of bits (see [`crate::label`]).
    Label,
    /// Outgoing Stokes element p.
    StokesOut,
    /// Incoming Stokes element p'.
    StokesIn,
    Wavelength,
}

impl ProjectorAxis {
    /// Returns the axis kind of a slice for this projector axis.
    pub fn kind(self) -> AxisKind {
        match self {
            Self::U => AxisKind::U,
            Self::V => AxisKind::V,
        }
    }
}

impl AxisKind {
    /// All axis kinds, in storage order.
    pub const ALL: [Self; 11] = [
        Self::Y,
        Self::X,
        Self::V,
        Self::U,
        Self::T,
        Self::Bounces,
        Self::Component,
        Self::Label,
        Self::StokesOut,
        Self::StokesIn,
        Self::Wavelength,
    ];

    /// Returns the name of the dimension in the store.
    pub fn name(self) -> &'static str {
        match self {
            Self::Y => "y",
            Self::X => "x",
            Self::V => "v",
            Self::U => "u",
            Self::T => "t",
            Self::Bounces => "bounces",
            Self::Component => "component",
            Self::Label => "label",
            Self::StokesOut => "stokes_out",
            Self::StokesIn => "stokes_in",
            Self::Wavelength => "wavelength",
        }
    }

    /// Returns the axis kind whose dimension has the given name in the store, or `None`.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|k| k.name() == name)
    }

    /// Returns the unit of the coordinates ("1" for plain indices).
    pub fn units(self) -> &'static str {
        match self {
            Self::Y | Self::X | Self::V | Self::U => "pixel",
            Self::T => "ps",
            Self::Wavelength => "nm",
            Self::Bounces | Self::Component | Self::Label | Self::StokesOut | Self::StokesIn => "1",
        }
    }

    /// Returns a one-line description of the axis.
    pub fn long_name(self) -> &'static str {
        match self {
            Self::Y => "camera row (pixel centre)",
            Self::X => "camera column (pixel centre)",
            Self::V => "projector row (pixel centre)",
            Self::U => "projector column (pixel centre)",
            Self::T => "travel time (bin centre)",
            Self::Bounces => "surface interactions between projector and camera",
            Self::Component => "0 = direct (one surface interaction), 1 = indirect",
            Self::Label => "what the path did, a set of bits: 1 medium, 2 specular, 4 glossy, 8 diffuse",
            Self::StokesOut => "Stokes element that reaches the camera, camera frame",
            Self::StokesIn => "Stokes element that leaves the projector, projector frame",
            Self::Wavelength => "vacuum wavelength",
        }
    }
}

/// One axis of a stored slice with its coordinate values.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Dimension that the axis resolves.
    pub kind: AxisKind,
    /// Coordinate of each entry, in the unit of [`AxisKind::units`]. The coordinate of a pixel is its index
    /// (the pixel's centre minus 0.5), and the coordinate of a bin of pixels or time is the bin's centre.
    pub coords: Vec<f64>,
    /// Chunk length along the axis.
    pub chunk: u64,
}

impl Axis {
    pub fn len(&self) -> u64 {
        self.coords.len() as u64
    }

    pub fn is_empty(&self) -> bool {
        self.coords.is_empty()
    }

    /// Returns the index of the entry nearest to `coordinate`. Of two equally near entries, returns the
    /// first. For an empty axis, returns 0.
    pub fn nearest(&self, coordinate: f64) -> usize {
        let distance = |i: usize| (self.coords[i] - coordinate).abs();
        (0..self.coords.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
    }
}

/// Returns the first and last pixel of each box of a binned axis, given the boxes' centres. The boxes are
/// contiguous and begin at pixel 0.
///
/// # Errors
/// Returns the first value of `centres` that cannot be the centre of a contiguous box.
pub fn boxes(centres: &[f64]) -> Result<Vec<(u32, u32)>, f64> {
    let mut first = 0.0;
    let mut all = Vec::with_capacity(centres.len());
    for &centre in centres {
        let last = 2.0 * centre - first;
        // The condition also rejects NaN.
        if !(last >= first && last.fract() == 0.0 && last < f64::from(u32::MAX)) {
            return Err(centre);
        }
        all.push((first as u32, last as u32));
        first = last + 1.0;
    }
    Ok(all)
}

/// Sizes of a scene that determine the axes of a [`Slice`].
#[derive(Clone, Debug, PartialEq)]
pub struct Extents {
    /// Camera width and height, in pixels.
    pub camera: [u32; 2],
    /// Projector width and height, in pixels, or `None` if the scene has no projector.
    pub projector: Option<[u32; 2]>,
    pub wavelengths_nm: Vec<f64>,
    /// Maximum path length: bounces range from 0 to `max_depth - 1`.
    pub max_depth: u32,
    /// Edge length of a square tile, in camera pixels.
    pub tile: u32,
}

/// The axes of one stored slice.
#[derive(Clone, Debug, PartialEq)]
pub struct SliceLayout {
    /// Name of the group in the store.
    pub name: String,
    /// Axes in storage order (row-major: the index of the last axis varies fastest).
    pub axes: Vec<Axis>,
    /// First edge and bin width of the time axis, in picoseconds, or `None` if the slice has no time axis.
    pub time: Option<(f64, f64)>,
    /// True if the store contains the standard errors of the totals of camera elements
    /// ([`crate::field::Field::TotalStdError`]). Renders store these standard errors.
    pub totals: bool,
}

fn indices(n: u32) -> Vec<f64> {
    (0..n).map(f64::from).collect()
}

fn listed(list: &[u32]) -> Vec<f64> {
    list.iter().copied().map(f64::from).collect()
}

fn span(first: u32, count: u32) -> Vec<f64> {
    (first..first + count).map(f64::from).collect()
}

/// Returns the centres of the boxes of `n` pixels that cover `total` pixels. The last box may be smaller.
fn binned(total: u32, n: u32) -> Vec<f64> {
    (0..total).step_by(n as usize).map(|a| f64::from(a + (a + n).min(total) - 1) / 2.0).collect()
}

impl SliceLayout {
    /// Creates the layout of a slice for the given extents, and chooses the chunk lengths.
    pub fn new(slice: &Slice, extents: &Extents) -> Self {
        let mut axes = Vec::new();
        let mut push = |kind, coords: Vec<f64>, chunk: u64| {
            axes.push(Axis { kind, chunk: chunk.clamp(1, coords.len().max(1) as u64), coords });
        };
        let [w, h] = extents.camera;
        let tile = u64::from(extents.tile);
        match &slice.camera {
            CameraSelect::All => {
                push(AxisKind::Y, indices(h), tile);
                push(AxisKind::X, indices(w), tile);
            }
            CameraSelect::Rows(rows) => {
                push(AxisKind::Y, listed(rows), 1);
                push(AxisKind::X, indices(w), tile);
            }
            CameraSelect::Columns(columns) => {
                push(AxisKind::Y, indices(h), tile);
                push(AxisKind::X, listed(columns), 1);
            }
            CameraSelect::Block(b) => {
                push(AxisKind::Y, span(b.y, b.h), tile);
                push(AxisKind::X, span(b.x, b.w), tile);
            }
            CameraSelect::Binned { nx, ny } => {
                push(AxisKind::Y, binned(h, *ny), tile / u64::from(*ny));
                push(AxisKind::X, binned(w, *nx), tile / u64::from(*nx));
            }
        }
        if let Some([pw, ph]) = extents.projector {
            let whole = u64::MAX;
            match &slice.projector {
                ProjectorSelect::All => {
                    push(AxisKind::V, indices(ph), whole);
                    push(AxisKind::U, indices(pw), whole);
                }
                ProjectorSelect::Rows(rows) => {
                    push(AxisKind::V, listed(rows), whole);
                    push(AxisKind::U, indices(pw), whole);
                }
                ProjectorSelect::Columns(columns) => {
                    push(AxisKind::V, indices(ph), whole);
                    push(AxisKind::U, listed(columns), whole);
                }
                ProjectorSelect::Block(Block { x, y, w, h }) => {
                    push(AxisKind::V, span(*y, *h), whole);
                    push(AxisKind::U, span(*x, *w), whole);
                }
                ProjectorSelect::Binned { nx, ny } => {
                    push(AxisKind::V, binned(ph, *ny), whole);
                    push(AxisKind::U, binned(pw, *nx), whole);
                }
                ProjectorSelect::EpipolarAlong { along, .. } => {
                    let size = match along {
                        ProjectorAxis::U => pw,
                        ProjectorAxis::V => ph,
                    };
                    push(along.kind(), indices(size), whole);
                }
                ProjectorSelect::Sum
                | ProjectorSelect::Mask { .. }
                | ProjectorSelect::Epipolar { .. }
                | ProjectorSelect::NonEpipolar { .. }
                | ProjectorSelect::Coaxial
                | ProjectorSelect::Ambient => {}
            }
        }
        let mut time = None;
        if let TimeSelect::Bins { start_ps, bin_ps, bins } = slice.time {
            let centres = (0..bins).map(|i| start_ps + (f64::from(i) + 0.5) * bin_ps);
            push(AxisKind::T, centres.collect(), u64::MAX);
            time = Some((start_ps, bin_ps));
        }
        if slice.bounces {
            push(AxisKind::Bounces, indices(extents.max_depth), u64::MAX);
        }
        if slice.split_first_bounce {
            push(AxisKind::Component, indices(2), u64::MAX);
        }
        if slice.labels {
            push(AxisKind::Label, indices(label::COUNT), u64::MAX);
        }
        if slice.polarization == Polarization::Mueller {
            push(AxisKind::StokesOut, indices(4), 4);
            push(AxisKind::StokesIn, indices(4), 4);
        }
        push(AxisKind::Wavelength, extents.wavelengths_nm.clone(), 4);
        bound_chunks(&mut axes);
        Self { name: slice.name.clone(), axes, time, totals: true }
    }

    /// Returns the length of every axis, in storage order.
    pub fn shape(&self) -> Vec<u64> {
        self.axes.iter().map(Axis::len).collect()
    }

    /// Returns the chunk length along every axis, in storage order.
    pub fn chunk_shape(&self) -> Vec<u64> {
        self.axes.iter().map(|a| a.chunk).collect()
    }

    /// Returns the index of the axis of the given kind, or `None` if the slice has no such axis.
    pub fn find(&self, kind: AxisKind) -> Option<usize> {
        self.axes.iter().position(|a| a.kind == kind)
    }

    /// Returns the layout without the time axis, under the same name. The overflow arrays have this layout.
    pub fn without_time(&self) -> Self {
        let mut axes = self.axes.clone();
        axes.retain(|a| a.kind != AxisKind::T);
        divide_matrix(&mut axes);
        Self { name: self.name.clone(), axes, time: None, totals: false }
    }

    /// Returns the layout of arrays with one value per camera element (axes `y` and `x` only), under the
    /// same name.
    pub fn camera_alone(&self) -> Self {
        let mut axes = self.axes.clone();
        axes.retain(|a| matches!(a.kind, AxisKind::Y | AxisKind::X));
        Self { name: self.name.clone(), axes, time: None, totals: false }
    }
}

fn chunk_size(axes: &[Axis]) -> u64 {
    axes.iter().map(|a| a.chunk).product()
}

/// Divides the chunks into chunks of single matrix elements if they have more than [`WHOLE_MATRIX_ELEMENTS`]
/// elements. Smaller chunks contain whole matrices.
fn divide_matrix(axes: &mut [Axis]) {
    let stokes = |axes: &mut [Axis], chunk: u64| {
        for axis in axes {
            if matches!(axis.kind, AxisKind::StokesOut | AxisKind::StokesIn) {
                axis.chunk = chunk;
            }
        }
    };
    stokes(axes, 4);
    if chunk_size(axes) > WHOLE_MATRIX_ELEMENTS {
        stokes(axes, 1);
    }
}

/// Limits the chunk size. First divides the chunks by matrix element, and then halves the chunks along the
/// axes V, U, T and Label, in this order.
fn bound_chunks(axes: &mut [Axis]) {
    divide_matrix(axes);
    for kind in [AxisKind::V, AxisKind::U, AxisKind::T, AxisKind::Label] {
        while chunk_size(axes) > MAX_CHUNK_ELEMENTS {
            match axes.iter_mut().find(|a| a.kind == kind && a.chunk > 1) {
                Some(axis) => axis.chunk = axis.chunk.div_ceil(2),
                None => break,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn extents() -> Extents {
        Extents {
            camera: [64, 48],
            projector: Some([32, 16]),
            wavelengths_nm: vec![450.0, 550.0, 660.0],
            max_depth: 6,
            tile: 16,
        }
    }

    fn slice() -> Slice {
        Slice {
            name: "s".into(),
            camera: CameraSelect::All,
            projector: ProjectorSelect::All,
            time: TimeSelect::Bins { start_ps: 100.0, bin_ps: 25.0, bins: 256 },
            polarization: Polarization::Mueller,
            bounces: true,
            split_first_bounce: true,
            labels: true,
        }
    }

    #[test]
    fn axes_are_in_order_and_chunks_are_bounded() {
        let l = SliceLayout::new(&slice(), &extents());
        assert_eq!(l.shape(), [48, 64, 16, 32, 256, 6, 2, 16, 4, 4, 3]);
        assert!(l.chunk_shape().iter().product::<u64>() <= MAX_CHUNK_ELEMENTS);
        assert_eq!(l.axes[4].coords[0], 112.5);
        assert_eq!(l.without_time().shape(), [48, 64, 16, 32, 6, 2, 16, 4, 4, 3]);
    }

    #[test]
    fn the_nearest_entry_is_the_first_of_equals() {
        let axis = Axis { kind: AxisKind::Wavelength, coords: vec![450.0, 550.0, 660.0], chunk: 3 };
        assert_eq!([0.0, 500.0, 501.0, 1e9].map(|nm| axis.nearest(nm)), [0, 0, 1, 2]);
    }

    #[test]
    fn bins_keep_their_centres() {
        assert_eq!(binned(10, 4), [1.5, 5.5, 8.5]);
        assert_eq!(boxes(&binned(10, 4)), Ok(vec![(0, 3), (4, 7), (8, 9)]));
        for bad in [f64::NAN, -1.0, 0.3, 1e300, f64::INFINITY] {
            assert!(boxes(&[1.5, bad]).is_err(), "{bad}");
        }
        let mut s = slice();
        s.camera = CameraSelect::Binned { nx: 2, ny: 4 };
        s.projector = ProjectorSelect::Sum;
        s.time = TimeSelect::Sum;
        s.bounces = false;
        s.split_first_bounce = false;
        s.labels = false;
        s.polarization = Polarization::Intensity;
        let l = SliceLayout::new(&s, &extents());
        assert_eq!(l.shape(), [12, 32, 3]);
        assert_eq!(l.chunk_shape(), [4, 8, 3]);
    }
}

//! Maps each path contribution to an element of a slice, with tables that are computed once per render.

use super::selected::Selected;
use optics::polarization::extent::Extent;
use optics::spectrum::Spectral;
use tensor::axes::{AxisKind, Extents, SliceLayout};
use tensor::slice::{CameraSelect, Polarization, ProjectorAxis, ProjectorSelect, Slice, TimeSelect};

/// Light that reaches the camera along one path, per unit projector drive.
#[derive(Clone, Copy, Debug)]
pub struct Contribution {
    /// Index of the contribution's first Mueller element in [`Contributions::elements`].
    pub first: u32,
    /// Number of matrix rows and columns.
    pub extent: Extent,
    /// Travel time in picoseconds, or infinity for emitters whose light has no travel time.
    pub time_ps: f64,
    /// Row-major index of projector pixel s', or [`NO_PIXEL`] for light of other emitters.
    pub pixel: u32,
    /// Distance of s' from the epipolar line of s in projector pixels. The value is set only if a slice is
    /// epipolar.
    pub epipolar_px: f32,
    pub bounces: u32,
    /// Path label as defined in [`tensor::label`]. The value is unspecified if no slice has labels.
    pub label: u8,
    /// Index of the only slice that counts the contribution, or `EVERY`. The index is set if the path was
    /// sampled for an s' of that slice.
    pub slice: u32,
    /// Density of sampling the path for a given s', divided by the density of sampling the path for all
    /// slices. The probability of selecting s' is excluded from the first density. The ratio is 0 if the path
    /// cannot be sampled for a given s'.
    pub rival: f32,
}

/// Output buffers for the contributions of one camera sample.
pub struct Contributions<'a> {
    /// The contributions, in the order in which the path produced them.
    pub list: &'a mut Vec<Contribution>,
    /// Mueller elements from projector frame to camera frame, in W/(m² sr nm). Only elements that can be
    /// non-zero are stored, e.g. only M00 for depolarized light. Other samples share the buffer.
    pub elements: &'a mut Vec<Spectral>,
    /// True if at least one slice needs path labels. Each kind of scattering lobe is then a separate
    /// contribution.
    pub labelled: bool,
}

impl<'a> Contributions<'a> {
    #[inline(always)]
    pub fn new(list: &'a mut Vec<Contribution>, elements: &'a mut Vec<Spectral>, labelled: bool) -> Self {
        Self { list, elements, labelled }
    }

    /// Appends a contribution whose elements are already at the end of the list of elements.
    #[inline(always)]
    pub fn push(&mut self, extent: Extent, time_ps: f64, pixel: u32, bounces: u32, label: u8) {
        self.list.push(Contribution {
            first: (self.elements.len() - extent.count()) as u32,
            extent,
            time_ps,
            pixel,
            epipolar_px: 0.0,
            bounces,
            label,
            slice: EVERY,
            rival: 0.0,
        });
    }
}

impl Contribution {
    /// Returns the contribution's elements, row by row, from the list of all elements.
    #[inline]
    pub fn of<'a>(&self, elements: &'a [Spectral]) -> &'a [Spectral] {
        &elements[self.first as usize..self.first as usize + self.extent.count()]
    }
}

/// Value of [`Contribution::pixel`] for light that does not come from a projector pixel.
pub const NO_PIXEL: u32 = u32::MAX;

/// Value of [`Contribution::slice`] for light that counts for all slices.
pub(super) const EVERY: u32 = u32::MAX;

/// Table entry that marks a row or column of pixels that a slice does not keep.
pub(super) const DROPPED: u32 = u32::MAX;

/// Maps contributions to the elements of one slice. The tables are computed once per render and shared by
/// all threads.
pub struct SlicePlan {
    slice: Slice,
    /// Projector pixels for which the slice samples separate paths, or `None` if there are too many of these
    /// pixels.
    selected: Option<Selected>,
    pub layout: SliceLayout,
    /// Index along `y` of each camera row and index along `x` of each camera column, or [`DROPPED`].
    pub(super) camera: [Vec<u32>; 2],
    /// Number of pixels averaged per index along `y` and `x` (1 unless the camera axes are binned).
    pub(super) per_index: [Vec<u32>; 2],
    /// Index of each projector row along `v` and column along `u`, or [`DROPPED`]. The lists are empty if s'
    /// is unresolved.
    projector: [Vec<u32>; 2],
    projector_width: u32,
    pub(super) camera_width: u32,
    columns: u64,
    bins: u64,
    bounces: u64,
    components: u64,
    labels: u64,
    /// Number of cells of one camera element inside the time window. The cells outside the window follow
    /// these cells.
    pub(super) inner: u64,
    pub(super) overflow: u64,
    pub(super) elements: usize,
    pub(super) wavelengths: usize,
}

/// Pixels that a slice keeps along one axis: a range (first pixel, count, pixels per index) or a list.
#[derive(Clone, Copy)]
enum Kept<'a> {
    Run(u32, u32, u32),
    List(&'a [u32]),
}

impl Kept<'_> {
    const ALL: Self = Self::binned(1);

    const fn binned(bin: u32) -> Self {
        Self::Run(0, u32::MAX, bin)
    }

    /// Returns the index of each of the `n` pixels along the axis, or [`DROPPED`].
    fn indices(&self, n: u32) -> Vec<u32> {
        let index = |i: u32| match *self {
            Self::List(list) => list.binary_search(&i).map_or(DROPPED, |k| k as u32),
            Self::Run(first, count, bin) if i >= first && i - first < count => (i - first) / bin,
            Self::Run(..) => DROPPED,
        };
        (0..n).map(index).collect()
    }
}

impl SlicePlan {
    /// Prepares a slice for a render of the given extents.
    pub fn new(slice: &Slice, extents: &Extents) -> Self {
        let [w, h] = extents.camera;
        let [rows, columns] = match &slice.camera {
            CameraSelect::All => [Kept::ALL; 2],
            CameraSelect::Rows(r) => [Kept::List(r), Kept::ALL],
            CameraSelect::Columns(c) => [Kept::ALL, Kept::List(c)],
            CameraSelect::Block(b) => [Kept::Run(b.y, b.h, 1), Kept::Run(b.x, b.w, 1)],
            CameraSelect::Binned { nx, ny } => [Kept::binned(*ny), Kept::binned(*nx)],
        };
        let camera = [rows.indices(h), columns.indices(w)];
        let count = |table: &[u32]| {
            let mut counts = Vec::new();
            for &i in table.iter().filter(|i| **i != DROPPED) {
                counts.resize(counts.len().max(i as usize + 1), 0);
                counts[i as usize] += 1;
            }
            counts
        };
        let per_index = [count(&camera[0]), count(&camera[1])];
        let [pw, ph] = extents.projector.unwrap_or([0, 0]);
        let projector = match &slice.projector {
            ProjectorSelect::All => Some([Kept::ALL; 2]),
            ProjectorSelect::Rows(r) => Some([Kept::List(r), Kept::ALL]),
            ProjectorSelect::Columns(c) => Some([Kept::ALL, Kept::List(c)]),
            ProjectorSelect::Block(b) => Some([Kept::Run(b.y, b.h, 1), Kept::Run(b.x, b.w, 1)]),
            ProjectorSelect::Binned { nx, ny } => Some([Kept::binned(*ny), Kept::binned(*nx)]),
            _ => None,
        };
        let indices = |[rows, columns]: [Kept; 2]| [rows.indices(ph), columns.indices(pw)];
        let projector = projector.map_or([vec![], vec![]], indices);
        let layout = SliceLayout::new(slice, extents);
        let len = |kind| layout.find(kind).map_or(1, |i| layout.axes[i].len());
        let (bins, bounces, components) =
            (len(AxisKind::T), len(AxisKind::Bounces), len(AxisKind::Component));
        let labels = len(AxisKind::Label);
        let columns = len(AxisKind::U);
        let resolved = len(AxisKind::V) * columns;
        let inner = resolved * bins * bounces * components * labels;
        Self {
            slice: slice.clone(),
            selected: Selected::of(slice, extents),
            camera,
            per_index,
            projector,
            projector_width: pw,
            camera_width: w,
            columns,
            bins,
            bounces,
            components,
            labels,
            inner,
            overflow: if layout.time.is_some() { inner / bins } else { 0 },
            elements: if slice.polarization == Polarization::Mueller { 16 } else { 1 },
            wavelengths: extents.wavelengths_nm.len(),
            layout,
        }
    }

    /// Returns the number of cells of one camera element, including those outside the time window.
    #[inline]
    pub(super) fn cells(&self) -> u64 {
        self.inner + self.overflow
    }

    /// Returns the maximum number of camera pixels per element (bins at the border may contain fewer).
    pub fn pixels_per_element(&self) -> u32 {
        let max = |v: &Vec<u32>| v.iter().copied().max().unwrap_or(1);
        max(&self.per_index[0]) * max(&self.per_index[1])
    }

    /// Returns the projector pixels for which separate paths are sampled, or `None` if there are too many
    /// such pixels.
    pub fn selected(&self) -> Option<&Selected> {
        self.selected.as_ref()
    }

    /// Returns the balance-heuristic weight of a contribution that can be sampled both for all slices and for
    /// one s'. The weight is 1 for all other contributions. `in_band` is as in [`Selected::chance`].
    #[inline]
    pub(super) fn share(&self, c: &Contribution, in_band: f32) -> f32 {
        match &self.selected {
            Some(selected) if c.rival > 0.0 => {
                let rival = selected.chance(c.pixel, in_band) * c.rival;
                if c.slice == EVERY { 1.0 / (1.0 + rival) } else { 1.0 / (1.0 + 1.0 / rival) }
            }
            _ => 1.0,
        }
    }

    /// Returns true if the slice uses [`Contribution::label`].
    pub(crate) fn needs_labels(&self) -> bool {
        self.slice.labels
    }

    /// Returns true if the slice uses [`Contribution::epipolar_px`].
    pub(crate) fn needs_epipolar(&self) -> bool {
        matches!(
            self.slice.projector,
            ProjectorSelect::Epipolar { .. }
                | ProjectorSelect::EpipolarAlong { .. }
                | ProjectorSelect::NonEpipolar { .. }
        )
    }

    /// Returns the indices of camera pixel (x, y) along `y` and `x`, or `None` if the slice omits the pixel.
    #[inline]
    pub(crate) fn camera_index(&self, x: u32, y: u32) -> Option<[u32; 2]> {
        let at = [self.camera[0][y as usize], self.camera[1][x as usize]];
        (at[0] != DROPPED && at[1] != DROPPED).then_some(at)
    }

    /// Returns the cell and the weight of a contribution to camera pixel number `camera_pixel`. Cells are
    /// row-major over v, u, t, bounces, component, label. The cells outside the time window follow the cells
    /// inside the window.
    #[inline(always)]
    pub(super) fn cell(&self, c: &Contribution, camera_pixel: u32) -> Option<(u64, f32)> {
        let mut weight = 1.0;
        let mut cell = 0_u64;
        match &self.slice.projector {
            ProjectorSelect::Sum => {}
            ProjectorSelect::Ambient if c.pixel == NO_PIXEL => {}
            ProjectorSelect::Ambient => return None,
            _ if c.pixel == NO_PIXEL => return None,
            ProjectorSelect::Mask { weights, .. } => {
                weight = weights[c.pixel as usize];
                if weight == 0.0 {
                    return None;
                }
            }
            ProjectorSelect::Epipolar { half_width_px } => {
                if c.epipolar_px > *half_width_px {
                    return None;
                }
            }
            ProjectorSelect::EpipolarAlong { half_width_px, along } => {
                if c.epipolar_px > *half_width_px {
                    return None;
                }
                cell = u64::from(match along {
                    ProjectorAxis::U => c.pixel % self.projector_width,
                    ProjectorAxis::V => c.pixel / self.projector_width,
                });
            }
            ProjectorSelect::NonEpipolar { half_width_px } => {
                if c.epipolar_px <= *half_width_px {
                    return None;
                }
            }
            ProjectorSelect::Coaxial => {
                if c.pixel != camera_pixel {
                    return None;
                }
            }
            _ => {
                let (v, u) = (c.pixel / self.projector_width, c.pixel % self.projector_width);
                let (v, u) = (self.projector[0][v as usize], self.projector[1][u as usize]);
                if v == DROPPED || u == DROPPED {
                    return None;
                }
                cell = u64::from(v) * self.columns + u64::from(u);
            }
        }
        let mut outside = false;
        if let TimeSelect::Bins { start_ps, bin_ps, .. } = self.slice.time {
            let bin = (c.time_ps - start_ps) / bin_ps;
            if bin >= 0.0 && bin < self.bins as f64 {
                cell = cell * self.bins + bin as u64;
            } else {
                outside = true;
            }
        }
        if self.bounces > 1 || self.slice.bounces {
            cell = cell * self.bounces + u64::from(c.bounces).min(self.bounces - 1);
        }
        if self.components > 1 {
            cell = cell * 2 + u64::from(c.bounces != 1);
        }
        if self.labels > 1 {
            cell = cell * self.labels + u64::from(c.label);
        }
        Some((if outside { self.inner + cell } else { cell }, weight))
    }
}

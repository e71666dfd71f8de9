//! Reduces a slice to an image, tile by tile. An answer may be incomplete, and a later answer completes it.
//!
//! A tile consists of whole chunks of camera pixels. Each tile is one probe, so the values equal those of the
//! command `sunstone probe`. If the image has more values than the page accepts, blocks of camera entries are
//! averaged. Different camera pixels are estimated from different samples, so errors of a block add in
//! quadrature.

use crate::answer::{Answer, Array};
use crate::describe::axes;
use crate::error::ViewError;
use crate::request::ImageRequest;
use rayon::ThreadPool;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::{Duration, Instant};
use store::doubt;
use store::probe::{CoordRange, LeftOut, Probe, ProbeResult, Selection};
use store::zarr::StoredSlice;
use tensor::array::Tensor;
use tensor::axes::{Axis, AxisKind};

/// Time after which an incomplete image is sent. The time doubles with each answer, up to `LATEST`, because
/// answers cost time as well.
const FIRST: Duration = Duration::from_millis(150);
const LATEST: Duration = Duration::from_secs(2);

/// Maximum number of camera entries per tile along each axis. Small slices have one chunk for the whole
/// image, and would otherwise appear at once after a long time.
const LARGEST_TILE: usize = 64;

/// Maximum number of values of an image.
pub(crate) const MOST: usize = 1 << 24;

/// An image that is being computed.
pub(crate) struct Job {
    slice: StoredSlice,
    /// Whether the store of the slice is finished.
    finished: bool,
    probe: Probe,
    request: ImageRequest,
    region: [usize; 4],
    bin: usize,
    /// Axes of the result. The first axes are `y` and `x`.
    axes: Vec<Axis>,
    /// Number of values per pixel of the result.
    inner: usize,
    mean: Array,
    std_error: Option<Array>,
    /// Tiles that are not computed yet, in units of entries of the slice, last first.
    tiles: Vec<[usize; 4]>,
    all_tiles: usize,
    notes: Vec<String>,
    left_out: LeftOut,
    answers: u32,
}

impl Job {
    /// Plans an image.
    pub(crate) fn new(
        slice: StoredSlice,
        finished: bool,
        mut request: ImageRequest,
    ) -> Result<Self, ViewError> {
        let mut probe = request.probe.probe()?;
        let layout = slice.layout();
        request.limit = request.limit.clamp(1, MOST);
        let weighted = [(AxisKind::StokesOut, request.output), (AxisKind::StokesIn, request.input)];
        for (kind, _) in weighted.into_iter().filter(|(_, weights)| weights.is_some()) {
            let by_stokes = kind == AxisKind::StokesIn && probe.stokes.is_some();
            if by_stokes || probe.select.iter().any(|s| s.axis == kind) {
                let reason = format!("the weights already contract the axis `{}`", kind.name());
                return Err(ViewError::Request(reason));
            }
        }
        for (kind, weights) in
            [(AxisKind::StokesOut, &mut request.output), (AxisKind::StokesIn, &mut request.input)]
        {
            let unit = |i: usize| [0, 1, 2, 3].map(|k| if k == i { 1.0 } else { 0.0 });
            // Reading one element is faster than contracting four.
            if layout.find(kind).is_some()
                && let Some(i) = (0..4).find(|i| *weights == Some(unit(*i)))
            {
                probe.select.push(Selection::nearest(kind, i as f64));
                *weights = None;
            }
        }
        let (Some(y), Some(x)) = (layout.find(AxisKind::Y), layout.find(AxisKind::X)) else {
            let reason = format!("slice `{}` has no camera pixels", slice.name());
            return Err(ViewError::Request(reason));
        };
        if probe.select.iter().any(|s| matches!(s.axis, AxisKind::Y | AxisKind::X)) {
            return Err(ViewError::Request("an image selects camera pixels by its region".into()));
        }
        let (rows, columns) = (&layout.axes[y], &layout.axes[x]);
        let [height, width] = [rows, columns].map(|a| a.coords.len());
        let region = request.region.unwrap_or([0, height, 0, width]);
        let [y0, y1, x0, x1] = region;
        if !(y0 < y1 && y1 <= height && x0 < x1 && x1 <= width) {
            return Err(ViewError::Request(format!(
                "the region {region:?} is not inside {height} x {width}"
            )));
        }
        let kept = |kind: AxisKind| match kind {
            AxisKind::Y | AxisKind::X | AxisKind::Wavelength | AxisKind::StokesOut => true,
            AxisKind::StokesIn => probe.stokes.is_none(),
            AxisKind::T => request.time,
            _ => false,
        };
        probe.sum = layout.axes.iter().map(|a| a.kind).filter(|kind| !kept(*kind)).collect();
        let contracted = |kind: AxisKind| match kind {
            AxisKind::StokesOut => request.output.is_some(),
            AxisKind::StokesIn => request.input.is_some(),
            _ => false,
        };
        let removed = |kind: AxisKind| {
            let one = |s: &Selection| s.axis == kind && matches!(s.range, CoordRange::Nearest(_));
            contracted(kind) || probe.select.iter().any(one)
        };
        let rest: Vec<&Axis> = layout.axes[2..].iter().filter(|a| kept(a.kind) && !removed(a.kind)).collect();
        // A range along a kept axis makes the result smaller than the axis.
        let most: usize = rest.iter().map(|a| a.coords.len()).product();
        let mut bin = 1;
        while (y1 - y0).div_ceil(bin) * (x1 - x0).div_ceil(bin) * most > request.limit {
            if bin >= (y1 - y0).max(x1 - x0) {
                return Err(ViewError::Request(format!(
                    "one pixel has {most} values, more than the limit of {}; select fewer entries",
                    request.limit
                )));
            }
            bin *= 2;
        }
        let side = |axis: &Axis| (axis.chunk as usize).min(LARGEST_TILE).max(bin).next_multiple_of(bin);
        let mut tiles = vec![];
        for top in cuts(y0, y1, side(rows)) {
            for left in cuts(x0, x1, side(columns)) {
                tiles.push([top.0, top.1, left.0, left.1]);
            }
        }
        // From the centre outwards.
        let middle = |tile: &[usize; 4]| {
            let along = |a: usize, b: usize, lo: usize, hi: usize| (a + b).abs_diff(lo + hi);
            along(tile[0], tile[1], y0, y1) + along(tile[2], tile[3], x0, x1)
        };
        tiles.sort_by_key(|tile| std::cmp::Reverse(middle(tile)));
        let mut job = Self {
            all_tiles: tiles.len(),
            axes: vec![],
            inner: 0,
            mean: Arc::default(),
            std_error: None,
            slice,
            finished,
            probe,
            request,
            region,
            bin,
            tiles,
            notes: vec![],
            left_out: LeftOut::default(),
            answers: 0,
        };
        job.allocate()?;
        Ok(job)
    }

    /// Computes the first tile, which gives the axes of the result, and allocates the result.
    fn allocate(&mut self) -> Result<(), ViewError> {
        let tile = self.tiles.pop().unwrap_or_else(|| unreachable!("a region is not empty"));
        let first = self.tile(tile)?;
        let [y0, y1, x0, x1] = self.region;
        let block = |kind: AxisKind, from: usize, to: usize| {
            let coords = &self.slice.layout().axes[usize::from(kind == AxisKind::X)].coords[from..to];
            let mean = |c: &[f64]| c.iter().sum::<f64>() / c.len() as f64;
            Axis { kind, coords: coords.chunks(self.bin).map(mean).collect(), chunk: 1 }
        };
        let mut axes = vec![block(AxisKind::Y, y0, y1), block(AxisKind::X, x0, x1)];
        axes.extend(first.axes.iter().skip(2).cloned());
        self.inner = axes[2..].iter().map(|a| a.coords.len()).product();
        let values = axes[0].coords.len() * axes[1].coords.len() * self.inner;
        self.axes = axes;
        self.mean = Arc::new(vec![f32::NAN; values]);
        self.std_error = self.request.errors.then(|| Arc::new(vec![f32::NAN; values]));
        self.notes.clone_from(&first.notes);
        // The tile's note about unreliable error estimates gives way to that of the region. In an unfinished
        // store, the estimates also count pixels that are not rendered yet.
        let of_tile = doubt::note(&self.slice, Some([tile[0]..tile[1], tile[2]..tile[3]]))?;
        self.notes.retain(|note| Some(note) != of_tile.as_ref());
        if self.finished {
            self.notes.extend(doubt::note(&self.slice, Some([y0..y1, x0..x1]))?);
        }
        self.put(tile, first);
        Ok(())
    }

    /// Continues for a short time.
    pub(crate) fn go_on(&mut self, pool: &ThreadPool) -> Result<(), ViewError> {
        let limit = LATEST.min(FIRST * 2_u32.saturating_pow(self.answers.min(8)));
        self.answers += 1;
        let start = Instant::now();
        while !self.tiles.is_empty() && start.elapsed() < limit {
            let batch = self.tiles.split_off(self.tiles.len().saturating_sub(pool.current_num_threads()));
            let tiles = || batch.par_iter().map(|tile| self.tile(*tile)).collect::<Result<Vec<_>, _>>();
            let done = match pool.install(tiles) {
                Ok(done) => done,
                Err(e) => {
                    self.tiles.extend(batch);
                    return Err(e);
                }
            };
            for (tile, values) in batch.iter().zip(done) {
                self.put(*tile, values);
            }
        }
        Ok(())
    }

    pub(crate) fn is_done(&self) -> bool {
        self.tiles.is_empty()
    }

    /// Returns the size of the result in bytes.
    pub(crate) fn bytes(&self) -> usize {
        4 * (self.mean.len() + self.std_error.as_ref().map_or(0, |e| e.len()))
    }

    /// Returns the number of camera entries along each side of an averaged block.
    pub(crate) fn bin(&self) -> usize {
        self.bin
    }

    /// Returns the axes and the values of the present state.
    pub(crate) fn matrices(&self) -> (&[Axis], &[f32]) {
        (&self.axes, &self.mean)
    }

    /// Returns the present state of the image.
    pub(crate) fn answer(&self) -> Answer {
        let mut fields = vec!["mean"];
        let mut arrays = vec![self.mean.clone()];
        if let Some(errors) = &self.std_error {
            fields.push("std_error");
            arrays.push(errors.clone());
        }
        let done = 1.0 - self.tiles.len() as f64 / self.all_tiles as f64;
        let notes: Vec<String> = self.notes.iter().cloned().chain(self.left_out.notes()).collect();
        let header: Value = json!({
            "axes": axes(&self.axes), "notes": notes, "fields": fields,
            "region": self.region, "bin": self.bin, "done": done,
        });
        Answer::Arrays(header, arrays)
    }

    /// Computes the contracted values of one tile.
    fn tile(&self, tile: [usize; 4]) -> Result<Values, ViewError> {
        let layout = self.slice.layout();
        let mut probe = self.probe.clone();
        for (axis, range) in layout.axes.iter().take(2).zip(tile.chunks(2)) {
            let range = CoordRange::Between(axis.coords[range[0]], axis.coords[range[1] - 1]);
            probe.select.push(Selection { axis: axis.kind, range });
        }
        Ok(Values::of(probe.run(&self.slice)?, &self.request))
    }

    /// Writes a tile into the result, and averages blocks.
    fn put(&mut self, [y0, y1, x0, x1]: [usize; 4], tile: Values) {
        self.left_out.add(tile.left_out);
        let (bin, inner) = (self.bin, self.inner);
        let columns = self.axes[1].coords.len();
        let width = x1 - x0;
        let mean = Arc::make_mut(&mut self.mean);
        let mut errors = self.std_error.as_mut().map(Arc::make_mut);
        for by in (y0..y1).step_by(bin) {
            for bx in (x0..x1).step_by(bin) {
                let to = ((by - self.region[0]) / bin * columns + (bx - self.region[2]) / bin) * inner;
                let entries = || {
                    let rows = by..(by + bin).min(y1);
                    rows.flat_map(|y| {
                        (bx..(bx + bin).min(x1)).map(move |x| ((y - y0) * width + x - x0) * inner)
                    })
                };
                if bin == 1 {
                    let from = entries().next().unwrap_or_else(|| unreachable!("a block has an entry"));
                    mean[to..to + inner].copy_from_slice(&tile.mean[from..from + inner]);
                    if let Some(errors) = &mut errors {
                        errors[to..to + inner].copy_from_slice(&tile.std_error[from..from + inner]);
                    }
                    continue;
                }
                for k in 0..inner {
                    let known = || entries().map(|e| e + k).filter(|e| tile.mean[*e].is_finite());
                    let n = known().count();
                    let sum: f64 = known().map(|e| f64::from(tile.mean[e])).sum();
                    mean[to + k] = if n == 0 { f32::NAN } else { (sum / n as f64) as f32 };
                    if let Some(errors) = &mut errors {
                        let squares: f64 = known().map(|e| f64::from(tile.std_error[e]).powi(2)).sum();
                        errors[to + k] = if n == 0 { f32::NAN } else { (squares.sqrt() / n as f64) as f32 };
                    }
                }
            }
        }
    }
}

/// Cuts a range of entries at multiples of `side`, counted from its start.
fn cuts(from: usize, to: usize, side: usize) -> impl Iterator<Item = (usize, usize)> + Clone {
    (from..to).step_by(side).map(move |a| (a, (a + side).min(to)))
}

/// Contracted values of a tile.
struct Values {
    axes: Vec<Axis>,
    mean: Vec<f32>,
    std_error: Vec<f32>,
    notes: Vec<String>,
    left_out: LeftOut,
}

impl Values {
    /// Contracts the Stokes axes of a probe's result with the weights of a request.
    fn of(mut result: ProbeResult, request: &ImageRequest) -> Self {
        for (kind, weights) in [(AxisKind::StokesOut, request.output), (AxisKind::StokesIn, request.input)] {
            let Some(weights) = weights.map(|w| w.map(f64::from)) else {
                continue;
            };
            result.mean = contracted(&result.mean, kind, weights);
            for left_out in [&mut result.overflow, &mut result.shifted_out].into_iter().flatten() {
                *left_out = contracted(left_out, kind, weights);
            }
            // Elements of a pixel may be correlated in any way, so the sum of the errors is the bound.
            result.std_error = contracted(&result.std_error, kind, weights.map(f64::abs));
        }
        Self {
            left_out: LeftOut::of(&result),
            axes: result.mean.axes,
            mean: result.mean.data,
            std_error: result.std_error.data,
            notes: result.notes,
        }
    }
}

/// Returns the weighted sum over an axis of four entries, without that axis. Returns a copy if the axis is
/// absent.
fn contracted(tensor: &Tensor, kind: AxisKind, weights: [f64; 4]) -> Tensor {
    let Some(axis) = tensor.find(kind) else {
        return tensor.clone();
    };
    let mut axes = tensor.axes.clone();
    axes.remove(axis);
    let inner: usize = axes[axis..].iter().map(|a| a.coords.len()).product();
    let mut out = Tensor::zeros(&tensor.name, axes);
    for (i, value) in out.data.iter_mut().enumerate() {
        let first = i / inner * 4 * inner + i % inner;
        let terms = weights.iter().enumerate().filter(|(_, w)| **w != 0.0);
        *value = terms.map(|(k, w)| w * f64::from(tensor.data[first + k * inner])).sum::<f64>() as f32;
    }
    out
}

//! Executes a plan: reads chunks, computes weighted sums in f64, and adds up camera pixels in a fixed order.

use rayon::prelude::*;

use super::error::ProbeError;
use super::plan::{AxisPlan, Plan, Share};
use crate::zarr::StoredSlice;
use tensor::array::Tensor;
use tensor::axes::{Axis, AxisKind};
use tensor::field::Field;
use tensor::region;

/// Number of sums above which the engine tests whether memory suffices before the allocation, because a
/// failed `vec!` aborts the process.
const LARGE: usize = 1 << 25;

/// Maximum number of boxes whose chunks are fetched in advance.
const AHEAD: usize = 64;

/// Half-open ranges of entries, one per axis.
type Ranges = Vec<(usize, usize)>;

/// Weighted sums for the camera pixels of one block.
struct Partial {
    mean: Vec<f64>,
    /// Upper bound Σ|w|·se of the standard error of each sum.
    bound: Vec<f64>,
}

/// Returns the mean and the standard error of the result. With a pulse, also returns the mean of the light
/// that the pulse shifted out of the stored time bins.
pub(super) fn run(
    plan: &Plan,
    slice: &StoredSlice,
    mean: Field,
    error: Field,
) -> Result<(Tensor, Tensor, Option<Tensor>), ProbeError> {
    let layout = slice.field_layout(mean)?;
    let camera = plan.axes.iter().take_while(|a| matches!(a.kind, AxisKind::Y | AxisKind::X)).count();
    let segments: Vec<Vec<(usize, usize)>> =
        plan.axes.iter().zip(&layout.axes).map(|(p, a)| split(p, a.chunk as usize)).collect();
    let (blocks, inner) = segments.split_at(camera);
    let mut blocks = boxes(blocks);
    let rest: usize = plan.axes[camera..].iter().map(|a| a.slots).product();
    let total: usize = plan.axes.iter().map(|a| a.slots).product();
    let (mut sum, mut variance) = (zeros(1, total)?, zeros(1, total)?);
    loop {
        let batch: Vec<Ranges> = blocks.by_ref().take(rayon::current_num_threads().max(1)).collect();
        if batch.is_empty() {
            break;
        }
        let partials: Vec<Partial> = batch
            .par_iter()
            .map(|block| gather(plan, slice, [mean, error], block, inner, rest))
            .collect::<Result<_, ProbeError>>()?;
        for (block, partial) in batch.iter().zip(&partials) {
            let lo: Vec<u64> = block.iter().map(|r| r.0 as u64).collect();
            let hi: Vec<u64> = block.iter().map(|r| r.1 as u64).collect();
            for (pixel, index) in region::indices(&lo, &hi).enumerate() {
                let slot = plan.axes[..camera]
                    .iter()
                    .zip(&index)
                    .fold(0, |o, (axis, &i)| o * axis.slots + axis.targets[i as usize - axis.first][0].0);
                let (from, to) = (pixel * rest, slot * rest);
                for k in 0..rest {
                    sum[to + k] += partial.mean[from + k];
                    variance[to + k] += partial.bound[from + k].powi(2);
                }
            }
        }
    }
    let std_error: Vec<f64> = variance.into_iter().map(f64::sqrt).collect();
    let (mean, shifted) = finish(plan, slice.name(), &sum);
    Ok((mean, finish(plan, slice.name(), &std_error).0, shifted))
}

/// Returns `pixels` × `rest` zeros for the sums, or an error if the sums do not fit into memory.
fn zeros(pixels: usize, rest: usize) -> Result<Vec<f64>, ProbeError> {
    let refused = || ProbeError::TooLarge { elements: pixels as u128 * rest as u128 };
    let elements = pixels.checked_mul(rest).ok_or_else(refused)?;
    if elements > LARGE && Vec::<f64>::new().try_reserve_exact(elements).is_err() {
        return Err(refused());
    }
    Ok(vec![0.0; elements])
}

/// Splits the range of an axis at chunk boundaries.
fn split(axis: &AxisPlan, chunk: usize) -> Vec<(usize, usize)> {
    let mut pieces = Vec::new();
    let mut at = axis.first;
    while at < axis.end {
        let next = ((at / chunk + 1) * chunk).min(axis.end);
        pieces.push((at, next));
        at = next;
    }
    pieces
}

/// Iterates over all boxes that consist of one range per axis. The last axis varies fastest.
fn boxes(segments: &[Vec<(usize, usize)>]) -> impl Iterator<Item = Ranges> + '_ {
    let counts: Vec<u64> = segments.iter().map(|s| s.len() as u64).collect();
    region::indices(&vec![0; counts.len()], &counts)
        .map(move |index| index.iter().zip(segments).map(|(&i, s)| s[i as usize]).collect())
}

fn gather(
    plan: &Plan,
    slice: &StoredSlice,
    fields: [Field; 2],
    block: &Ranges,
    inner: &[Vec<(usize, usize)>],
    rest: usize,
) -> Result<Partial, ProbeError> {
    let pixels: usize = block.iter().map(|r| r.1 - r.0).product();
    let mut partial = Partial { mean: zeros(pixels, rest)?, bound: zeros(pixels, rest)? };
    let region = |part: &Ranges| -> (Vec<u64>, Vec<u64>) {
        let ranges = block.iter().chain(part);
        ranges.map(|r| (r.0 as u64, (r.1 - r.0) as u64)).unzip()
    };
    let mut ahead = 0;
    for (k, part) in boxes(inner).enumerate() {
        if ahead == k {
            let next: Vec<_> = boxes(inner).skip(k).take(AHEAD).map(|part| region(&part)).collect();
            ahead += slice.fetch_ahead(&fields, &next)?;
        }
        let ranges: Ranges = block.iter().chain(&part).copied().collect();
        let (start, shape) = region(&part);
        let (tail, run) = tail(plan, block.len(), &ranges);
        let walk = Walk {
            targets: targets(plan, block, &ranges, rest).drain(..tail).collect(),
            run,
            joint: joint(plan, &ranges),
            mean: slice.read(fields[0], &start, &shape)?,
            std_error: slice.read(fields[1], &start, &shape)?,
        };
        walk.go(0, 0, 0, 1.0, &mut partial);
    }
    Ok(partial)
}

/// Returns the index of the first axis of a run, and the number of values in the run. A run combines the
/// trailing axes that the probe keeps unchanged and that lie completely in the box.
fn tail(plan: &Plan, camera: usize, ranges: &Ranges) -> (usize, usize) {
    let (mut tail, mut run) = (ranges.len(), 1);
    while tail > camera {
        let (axis, range) = (&plan.axes[tail - 1], ranges[tail - 1]);
        let in_place = |(i, row): (usize, &Vec<Share>)| matches!(row[..], [(slot, 1.0)] if slot == i);
        let whole = range == (axis.first, axis.end) && axis.slots == axis.targets.len();
        let joint = plan.joint.is_some() && matches!(axis.kind, AxisKind::V | AxisKind::U);
        if joint || !whole || !axis.targets.iter().enumerate().all(in_place) {
            break;
        }
        run *= axis.slots;
        tail -= 1;
    }
    (tail, run)
}

/// Returns the targets (offset into the partial sums, and weight) of every entry of a box, for every axis.
fn targets(plan: &Plan, block: &Ranges, ranges: &Ranges, rest: usize) -> Vec<Vec<Vec<Share>>> {
    let mut stride = 1;
    let mut all = Vec::with_capacity(ranges.len());
    for (i, (axis, range)) in plan.axes.iter().zip(ranges).enumerate().rev() {
        if i < block.len() {
            let inner: usize = block[i + 1..].iter().map(|r| r.1 - r.0).product();
            all.push((0..range.1 - range.0).map(|k| vec![(k * inner * rest, 1.0)]).collect());
        } else {
            let rows = &axis.targets[range.0 - axis.first..range.1 - axis.first];
            let scaled = |row: &Vec<Share>| row.iter().map(|&(slot, w)| (slot * stride, w)).collect();
            all.push(rows.iter().map(scaled).collect());
            stride *= axis.slots;
        }
    }
    all.reverse();
    all
}

/// Returns the index of the axis v, and the pattern's weights of the box's entries (v, u). Returns `None` if
/// no pattern contracts these axes.
fn joint(plan: &Plan, ranges: &Ranges) -> Option<(usize, Vec<f64>)> {
    let weights = plan.joint.as_ref()?;
    let v = plan.axes.iter().position(|a| a.kind == AxisKind::V)?;
    let columns = plan.axes[v + 1].end;
    let row = |i: usize| &weights[i * columns + ranges[v + 1].0..i * columns + ranges[v + 1].1];
    Some((v, (ranges[v].0..ranges[v].1).flat_map(row).copied().collect()))
}

/// One box of values, with the targets of these values in the sums.
struct Walk {
    /// Targets of the entries of all axes except the trailing axes that form a run.
    targets: Vec<Vec<Vec<Share>>>,
    /// Number of values per run.
    run: usize,
    joint: Option<(usize, Vec<f64>)>,
    mean: Vec<f32>,
    std_error: Vec<f32>,
}

impl Walk {
    /// Adds all values whose indices begin with a prefix. `source` is the flat index of the prefix, and `to`
    /// is the prefix's offset in the sums.
    fn go(&self, axis: usize, source: usize, to: usize, weight: f64, into: &mut Partial) {
        if axis == self.targets.len() {
            let values = &self.mean[source * self.run..(source + 1) * self.run];
            let errors = &self.std_error[source * self.run..(source + 1) * self.run];
            let sums = into.mean[to..to + self.run].iter_mut().zip(&mut into.bound[to..to + self.run]);
            for ((sum, bound), (value, error)) in sums.zip(values.iter().zip(errors)) {
                *sum += weight * f64::from(*value);
                *bound += weight.abs() * f64::from(*error);
            }
        } else if let Some((v, weights)) = self.joint.as_ref().filter(|(v, _)| *v == axis) {
            let n = self.targets[*v].len() * self.targets[v + 1].len();
            for (i, w) in weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
                self.go(axis + 2, source * n + i, to, weight * w, into);
            }
        } else {
            let rows = &self.targets[axis];
            let base = source * rows.len();
            for (i, row) in rows.iter().enumerate() {
                for &(offset, w) in row.iter().filter(|t| t.1 != 0.0) {
                    self.go(axis + 1, base + i, to + offset, weight * w, into);
                }
            }
        }
    }
}

/// Converts the sums to an f32 tensor. With a pulse, returns the light that the pulse shifted out of the
/// stored time bins as a second tensor.
fn finish(plan: &Plan, name: &str, sums: &[f64]) -> (Tensor, Option<Tensor>) {
    let tensor = |axes: Vec<Axis>, data: Vec<f32>| Tensor { name: name.to_owned(), axes, data };
    if !plan.convolved {
        return (tensor(plan.kept.clone(), sums.iter().map(|v| *v as f32).collect()), None);
    }
    let t = plan.axes.iter().position(|a| a.kind == AxisKind::T).unwrap_or(0);
    let slots = plan.axes[t].slots;
    let inner: usize = plan.axes[t + 1..].iter().map(|a| a.slots).product();
    let (mut inside, mut outside) = (Vec::new(), Vec::new());
    for lane in sums.chunks_exact(slots * inner) {
        let (stay, leave) = lane.split_at((slots - 1) * inner);
        inside.extend(stay.iter().map(|v| *v as f32));
        outside.extend(leave.iter().map(|v| *v as f32));
    }
    let without_time = plan.kept.iter().filter(|a| a.kind != AxisKind::T).cloned().collect();
    (tensor(plan.kept.clone(), inside), Some(tensor(without_time, outside)))
}

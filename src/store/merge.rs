//! Merges renders of one scene with different seeds. The result equals the result of one render with all
//! samples.
//!
//! For an element that belongs to one camera pixel (`pixels_per_element` = 1), the pooled values are exact
//! (Chan, Golub & LeVeque 1979). The values are equivalent to pooling Σx and Σx². N samples with mean m and
//! standard error e have the sum of squared deviations M = e²·N(N−1). The pooled values are m = Σ Nᵢmᵢ / ΣNᵢ,
//! M = Σ Mᵢ + Σ Nᵢ(mᵢ − m)², e² = M / (N(N−1)) with N = ΣNᵢ.
//!
//! A group of samples that are stratified together counts as one sample, so N is the number of groups
//! (`replicates_per_pixel`).
//!
//! Errors of totals (`total_std_error`) are pooled in the same way, where m is the total of the means. The
//! merged store has no errors of totals if an input has none, as in stores of earlier versions.
//!
//! Sums are computed in f64. The remaining error is the rounding of the stored f32 values.
//!
//! If an element averages several pixels, its samples are not identically distributed, and only the mean of
//! each store is known. The pooled values of such an element are m = Σ Nᵢmᵢ / ΣNᵢ, e² = Σ Nᵢ²eᵢ² / (ΣNᵢ)².
//!
//! Parts of one render ([`tensor::part`]) share no samples, so they are joined and not pooled. The result
//! equals the whole render byte for byte.

mod error;
mod join;
mod pool;
pub mod rounds;
mod totals;

pub use error::MergeError;
pub use join::JoinError;
use pool::Pool;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::{Map, Value, json};

use crate::denoised;
use crate::place::is_address;
use crate::zarr::{AccessError, SampleGrid, StoredSlice, TensorStore};
use base::whole_file;
use tensor::axes::{self, AxisKind, SliceLayout};
use tensor::field::Field;
use tensor::region;
use tensor::target::ATTRIBUTE;

/// A store to merge, with its number of samples.
pub(crate) struct Input {
    pub(crate) store: TensorStore,
    attributes: Map<String, Value>,
    pub(crate) samples_per_pixel: Option<f64>,
    /// Number of samples that are stratified together and form one random variable.
    group: f64,
}

impl Input {
    pub(crate) fn of(store: TensorStore) -> Self {
        let attributes = store.attributes();
        let samples_per_pixel = attributes.get("samples_per_pixel").and_then(Value::as_f64);
        let replicates = attributes.get("replicates_per_pixel").and_then(Value::as_f64);
        let group = samples_per_pixel.zip(replicates).map_or(1.0, |(n, r)| n / r);
        Self {
            group: if group >= 1.0 { group } else { 1.0 },
            store,
            attributes,
            samples_per_pixel: samples_per_pixel.filter(|n| *n >= 0.0),
        }
    }
}

/// First and last pixel of every entry of an axis.
type Ranges = Vec<(u32, u32)>;

/// One slice of one input store.
struct Part<'a> {
    slice: StoredSlice,
    input: &'a Input,
    /// Pixels of the entries of the axes y and x, if an element's number of samples comes from the counts
    /// per pixel.
    pixels: Option<[Ranges; 2]>,
}

/// One slice of all input stores.
pub(crate) struct Parts<'a> {
    parts: Vec<Part<'a>>,
    /// Whether each element belongs to one camera pixel, so that its samples are identically distributed.
    equal: bool,
}

/// Merges the stores `inputs` into a new store `out`. An existing store is replaced only if `options.replace`
/// is true.
///
/// Sample counts come from the array `samples` of a store. If the array does not exist, sample counts come
/// from the root attribute `samples_per_pixel`. The root attributes of `out` are computed from the inputs.
/// `seeds` are concatenated. `samples_per_pixel`, `discarded_samples` and `wall_time_s` are summed.
/// `merged_from` lists the inputs. All other root attributes have the values of the first input.
///
/// If the inputs are the parts of one render, `out` equals the whole render byte for byte, except for
/// `wall_time_s`, which is the sum over the parts.
///
/// # Errors
/// Returns an error if reading or writing fails, or if the inputs cannot be merged. Valid inputs are renders
/// of one scene (`scene_sha256`) with the same slices and different `seeds`, or all parts of one render.
pub fn merge(inputs: &[PathBuf], out: &Path, options: Options) -> Result<(), MergeError> {
    let is_out = |input: &&PathBuf| whole_file::is_same(input, out) || *input == out;
    if let Some(input) = inputs.iter().find(is_out) {
        return Err(MergeError::Itself { path: input.clone() });
    }
    at_once(inputs, out, || merge_all(inputs, out, options))
}

/// Number of chunks that are merged concurrently. Each thread needs one chunk of every input in memory, at
/// most about 100 MB.
const THREADS: usize = 8;

/// Runs the merge `work`. If an input or the output is at a URL, `work` runs on at least [`THREADS`] threads
/// to saturate the bandwidth.
pub(crate) fn at_once<T: Send>(inputs: &[PathBuf], out: &Path, work: impl FnOnce() -> T + Send) -> T {
    let far = is_address(out) || inputs.iter().any(|input| is_address(input));
    let more = rayon::current_num_threads() < THREADS;
    let pool = (far && more).then(|| rayon::ThreadPoolBuilder::new().num_threads(THREADS).build());
    match pool {
        Some(Ok(pool)) => pool.install(work),
        _ => work(),
    }
}

fn merge_all(inputs: &[PathBuf], out: &Path, options: Options) -> Result<(), MergeError> {
    if let Some(part) = inputs.iter().find(|input| join::is_part(input)) {
        if options.partial {
            return Err(JoinError::Partial { path: part.clone() }.into());
        }
        return Ok(join::join(inputs, out, options.replace)?);
    }
    let inputs = open_inputs(inputs, options.partial)?;
    let names = inputs[0].store.slice_names();
    let slices: Vec<Parts> = names.iter().map(|name| parts(&inputs, name)).collect::<Result<_, _>>()?;
    let pooled = Pooled {
        inputs: &inputs,
        slices: &slices,
        attributes: &merged_attributes(&inputs),
        origin: &merge_origin(&inputs, options),
    };
    pool_into(out, &pooled, options.replace, options.partial)
}

/// The inputs of a merge, and the attributes of the output.
struct Pooled<'a> {
    inputs: &'a [Input],
    slices: &'a [Parts<'a>],
    attributes: &'a Map<String, Value>,
    /// Text that identifies everything on which the values depend.
    origin: &'a str,
}

/// Pools slices into a new store.
fn pool_into(out: &Path, pooled: &Pooled, replace: bool, partial: bool) -> Result<(), MergeError> {
    let layouts: Vec<_> = pooled
        .slices
        .iter()
        .map(|s| {
            let layout = SliceLayout {
                totals: s.parts.iter().all(|p| p.slice.layout().totals),
                ..s.parts[0].slice.layout().clone()
            };
            (layout, s.parts[0].slice.attributes().clone())
        })
        .collect();
    let fill = |merged: &TensorStore| {
        for parts in pooled.slices {
            let slice = merged.slice(parts.parts[0].slice.name())?;
            merge_slice(parts, &slice, partial)?;
            merge_totals(parts, &slice, partial)?;
        }
        merge_samples(pooled.inputs, merged)?;
        Ok(merged.finish()?)
    };
    TensorStore::create_from(
        out,
        &layouts,
        pooled.attributes,
        common_grid(pooled.inputs),
        replace,
        Some(pooled.origin),
        fill,
    )
    .map(drop)
}

#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    pub replace: bool,
    /// Whether to accept unfinished renders. Values that are missing in all inputs are NaN.
    pub partial: bool,
}

/// Returns a text that identifies everything on which values computed from stores depend: the command, the
/// stores and their contents.
fn origin<'a>(command: &str, stores: impl Iterator<Item = &'a TensorStore>) -> String {
    let line = |store: &TensorStore| format!("{} {}\n", store.path().display(), store.fingerprint());
    format!("{command}\n{}", stores.map(line).collect::<String>())
}

fn merge_origin(inputs: &[Input], options: Options) -> String {
    let command = format!("merge by {}, partial: {}", env!("CARGO_PKG_VERSION"), options.partial);
    origin(&command, inputs.iter().map(|input| &input.store))
}

/// Returns the grid of the sample counts, if the sample counts of all inputs have the same shape.
pub(crate) fn common_grid(inputs: &[Input]) -> Option<SampleGrid> {
    let mut shapes = inputs.iter().map(|i| i.store.samples_shape());
    let (shape, chunk) = shapes.next()??;
    let same = shapes.all(|s| s.is_some_and(|s| s.0 == shape));
    same.then_some(SampleGrid::new(shape, chunk))
}

/// If the merged store has sample counts, writes the sample counts per pixel, summed over the inputs.
pub(crate) fn merge_samples(inputs: &[Input], merged: &TensorStore) -> Result<(), AccessError> {
    let Some((shape, chunk)) = merged.samples_shape() else {
        return Ok(());
    };
    let chunks: Vec<_> = region::chunks(&shape, &chunk).collect();
    chunks.par_iter().try_for_each(|(start, size)| {
        let (start, size) = ([start[0], start[1]], [size[0], size[1]]);
        let mut sum = inputs[0].store.read_samples(start, size)?;
        for input in &inputs[1..] {
            let counts = input.store.read_samples(start, size)?;
            sum.iter_mut().zip(counts).for_each(|(s, c)| *s = s.saturating_add(c));
        }
        merged.write_samples(start, size, &sum)
    })
}

/// Opens a slice in all stores, and checks that the slices match.
pub(crate) fn parts<'a>(inputs: &'a [Input], name: &str) -> Result<Parts<'a>, MergeError> {
    let first = inputs[0].store.slice(name)?;
    let size = pixels_per_element(&first)?;
    let equal = size == 1;
    let mut parts = Vec::with_capacity(inputs.len());
    for input in inputs {
        let fault = || MergeError::Layout {
            first: inputs[0].store.path().to_owned(),
            second: input.store.path().to_owned(),
            slice: name.to_owned(),
        };
        if input.store.slice_names() != inputs[0].store.slice_names() {
            return Err(fault());
        }
        let slice = input.store.slice(name)?;
        if !same_axes(slice.layout(), first.layout()) || pixels_per_element(&slice)? != size {
            return Err(fault());
        }
        let pixels = pixels(input, &slice, equal)?;
        parts.push(Part { slice, input, pixels });
    }
    Ok(Parts { parts, equal })
}

fn pixels_per_element(slice: &StoredSlice) -> Result<u64, MergeError> {
    let attribute = slice.attributes().get("pixels_per_element");
    attribute
        .and_then(Value::as_u64)
        .ok_or_else(|| MergeError::Attribute { path: slice.path().to_owned(), key: "pixels_per_element" })
}

/// Returns the value of [`Part::pixels`] for a slice.
fn pixels(input: &Input, slice: &StoredSlice, equal: bool) -> Result<Option<[Ranges; 2]>, MergeError> {
    let layout = slice.layout();
    let camera = layout.find(AxisKind::Y).zip(layout.find(AxisKind::X));
    let (Some((shape, _)), Some((0, 1))) = (input.store.samples_shape(), camera) else {
        return match input.samples_per_pixel {
            Some(_) => Ok(None),
            None => {
                Err(MergeError::Attribute { path: input.store.path().to_owned(), key: "samples_per_pixel" })
            }
        };
    };
    let along = |axis: usize| {
        let coords = &layout.axes[axis].coords;
        let fault = |coordinate| MergeError::Pixels {
            path: slice.path().to_owned(),
            axis: layout.axes[axis].kind.name(),
            coordinate,
        };
        let all = if equal {
            match coords.iter().find(|c| c.fract() != 0.0) {
                Some(bad) => return Err(fault(*bad)),
                None => coords.iter().map(|&c| (c as u32, c as u32)).collect(),
            }
        } else {
            axes::boxes(coords).map_err(fault)?
        };
        // The boxes are sorted, so checking the last one is enough.
        match all.last() {
            Some((_, last)) if u64::from(*last) >= shape[axis] => Err(fault(coords[coords.len() - 1])),
            _ => Ok(all),
        }
    };
    Ok(Some([along(0)?, along(1)?]))
}

fn same_axes(a: &SliceLayout, b: &SliceLayout) -> bool {
    let key = |l: &SliceLayout| -> Vec<_> { l.axes.iter().map(|x| (x.kind, x.coords.clone())).collect() };
    a.time == b.time && key(a) == key(b)
}

pub(crate) fn open_inputs(paths: &[PathBuf], partial: bool) -> Result<Vec<Input>, MergeError> {
    if paths.len() < 2 {
        return Err(MergeError::TooFew);
    }
    let mut inputs: Vec<Input> = Vec::new();
    let mut seen = BTreeSet::new();
    for path in paths {
        let store = if partial { TensorStore::open_partial(path)? } else { TensorStore::open(path)? };
        denoised::refuse(&store)?;
        let input = Input::of(store);
        let (store, attributes) = (&input.store, &input.attributes);
        let missing = |key| MergeError::Attribute { path: path.clone(), key };
        if attributes.get("scene_sha256").is_none_or(|v| !v.is_string()) {
            return Err(missing("scene_sha256"));
        }
        if let Some(first) = inputs.first()
            && first.attributes["scene_sha256"] != attributes["scene_sha256"]
        {
            return Err(MergeError::Scenes { first: first.store.path().to_owned(), second: path.clone() });
        }
        if let Some(first) = inputs.first()
            && first.attributes.get("integrator") != attributes.get("integrator")
        {
            return Err(MergeError::Integrators {
                first: first.store.path().to_owned(),
                second: path.clone(),
            });
        }
        let seeds = attributes.get("seeds").and_then(Value::as_array).ok_or_else(|| missing("seeds"))?;
        for seed in seeds {
            let seed = seed
                .as_u64()
                .map(i128::from)
                .or(seed.as_i64().map(i128::from))
                .ok_or_else(|| missing("seeds"))?;
            if !seen.insert(seed) {
                return Err(MergeError::Seed { path: path.clone(), seed });
            }
        }
        if input.samples_per_pixel.is_none() && store.samples_shape().is_none() {
            return Err(missing("samples_per_pixel"));
        }
        inputs.push(input);
    }
    Ok(inputs)
}

pub(crate) fn merged_attributes(inputs: &[Input]) -> Map<String, Value> {
    let mut attributes = inputs[0].attributes.clone();
    let seeds: Vec<Value> =
        inputs.iter().filter_map(|i| i.attributes.get("seeds")?.as_array()).flatten().cloned().collect();
    attributes.insert("seeds".into(), json!(seeds));
    for key in ["samples_per_pixel", "replicates_per_pixel", "discarded_samples", "wall_time_s"] {
        let values: Vec<&Value> = inputs.iter().filter_map(|i| i.attributes.get(key)).collect();
        if values.is_empty() {
            continue;
        }
        let mut whole = values.iter().map(|v| v.as_u64());
        let whole = whole.try_fold(0_u64, |sum, n| sum.checked_add(n?));
        let sum =
            whole.map_or_else(|| json!(values.iter().filter_map(|v| v.as_f64()).sum::<f64>()), |n| json!(n));
        attributes.insert(key.into(), sum);
    }
    let from: Vec<String> = inputs.iter().map(|i| i.store.path().display().to_string()).collect();
    attributes.insert("merged_from".into(), json!(from));
    // The target error of one render does not apply to a merged store.
    attributes.remove(ATTRIBUTE);
    attributes
}

fn merge_slice(parts: &Parts, merged: &StoredSlice, partial: bool) -> Result<(), MergeError> {
    let equal = parts.equal;
    for (mean, error) in [(Field::Mean, Field::StdError), (Field::Overflow, Field::OverflowStdError)] {
        if !merged.has(mean) {
            continue;
        }
        let chunks: Vec<_> = merged.chunks(mean)?.collect();
        chunks.par_iter().try_for_each(|(start, shape)| -> Result<(), MergeError> {
            // A resumed merge skips complete chunks. A chunk with a file of means and a file of errors is
            // complete, because errors are written last.
            if merged.is_stored(mean, start)? && merged.is_stored(error, start)? {
                return Ok(());
            }
            let n = region::volume(shape).unwrap_or(0);
            let mut pools = vec![Pool::default(); n];
            for part in &parts.parts {
                let m = part.slice.read(mean, start, shape)?;
                let e = part.slice.read(error, start, shape)?;
                let counts = element_counts(part, start, shape)?;
                let inner = n / counts.len().max(1);
                let group = part.input.group;
                for (i, pool) in pools.iter_mut().enumerate() {
                    pool.add(counts[i / inner] / group, f64::from(m[i]), f64::from(e[i]), equal);
                }
            }
            let nothing = |p: &Pool| partial && p.n == 0.0;
            let value = |p: &Pool, value: f64| if nothing(p) { f32::NAN } else { value as f32 };
            let m: Vec<f32> = pools.iter().map(|p| value(p, p.mean)).collect();
            let e: Vec<f32> = pools.iter().map(|p| value(p, p.std_error(equal))).collect();
            merged.write(mean, start, shape, &m)?;
            Ok(merged.write(error, start, shape, &e)?)
        })?;
    }
    Ok(())
}

/// If the merged slice has errors of totals, writes their pooled values.
fn merge_totals(parts: &Parts, merged: &StoredSlice, partial: bool) -> Result<(), MergeError> {
    let field = Field::TotalStdError;
    if !merged.has(field) {
        return Ok(());
    }
    let [_, width] = merged.field_layout(field)?.shape()[..] else {
        return Ok(());
    };
    let means = parts.parts.iter().map(|part| totals::means(&part.slice));
    let means = means.collect::<Result<Vec<_>, _>>()?;
    let chunks: Vec<_> = merged.chunks(field)?.collect();
    chunks.par_iter().try_for_each(|(start, shape)| {
        let mut pools = vec![Pool::default(); shape.iter().product::<u64>() as usize];
        for (part, means) in parts.parts.iter().zip(&means) {
            let errors = part.slice.read(field, start, shape)?;
            let counts = element_counts(part, start, shape)?;
            let per_count = pools.len() / counts.len().max(1);
            let rows = start[0]..start[0] + shape[0];
            let elements = rows.flat_map(|y| (start[1]..start[1] + shape[1]).map(move |x| y * width + x));
            for (i, (pool, element)) in pools.iter_mut().zip(elements).enumerate() {
                let n = counts[i / per_count] / part.input.group;
                pool.add(n, means[element as usize], f64::from(errors[i]), parts.equal);
            }
        }
        let error = |pool: &Pool| match pool.n {
            0.0 if partial => f32::NAN,
            _ => pool.std_error(parts.equal) as f32,
        };
        let errors: Vec<f32> = pools.iter().map(error).collect();
        Ok(merged.write(field, start, shape, &errors)?)
    })
}

/// Returns the number of samples of every camera element (y, x) of a region, row-major. Returns a single
/// number if the slice has no camera axes or if all counts are equal.
fn element_counts(part: &Part, start: &[u64], shape: &[u64]) -> Result<Vec<f64>, MergeError> {
    let Some([rows, columns]) = &part.pixels else {
        return Ok(vec![part.input.samples_per_pixel.unwrap_or(0.0)]);
    };
    let own = |all: &[(u32, u32)], axis: usize| -> Vec<(u64, u64)> {
        let own = &all[start[axis] as usize..(start[axis] + shape[axis]) as usize];
        own.iter().map(|&(a, b)| (a.into(), b.into())).collect()
    };
    let (ys, xs) = (own(rows, 0), own(columns, 1));
    let span = |b: &[(u64, u64)]| (b[0].0, b[b.len() - 1].1 - b[0].0 + 1);
    let ((y0, h), (x0, w)) = (span(&ys), span(&xs));
    let samples = part.input.store.read_samples([y0, x0], [h, w])?;
    let mut counts = Vec::with_capacity(ys.len() * xs.len());
    for &(top, bottom) in &ys {
        for &(left, right) in &xs {
            let sum: u64 = (top..=bottom)
                .flat_map(|y| (left..=right).map(move |x| ((y - y0) * w + x - x0) as usize))
                .map(|i| u64::from(samples[i]))
                .sum();
            counts.push(sum as f64);
        }
    }
    Ok(counts)
}

#[cfg(test)]
mod tests;

//! Denoises stores for figures. The resulting store is marked as denoised ([`store::denoised`]).
//!
//! A slice is read in bands of rows, with [`HALO`] additional rows on both sides. Along axes other than rows,
//! columns and Stokes elements, the slice is read chunk by chunk. Memory use is thus limited to about
//! [`BAND`] values. The result is bit-identical for all heights of bands. Rows and columns that are not
//! adjacent in the camera (`rows = [10, 150]`) are denoised as separate images.

use polarimetry::denoise::average::average;
use polarimetry::denoise::guide::{Guide, GuideBuilder};
use polarimetry::denoise::weights::Weights;
use polarimetry::denoise::{HALO, REACH, STRENGTHS, Values};
use serde_json::{Value, json};
use std::ops::Range;
use std::path::{Path, PathBuf};
use store::denoised::ATTRIBUTE;
use store::matching_stores::MatchingStores;
use store::merge::MergeError;
use store::zarr::{AccessError, CreateError, OpenError, StoredSlice, TensorStore};
use tensor::axes::{Axis, AxisKind, SliceLayout};
use tensor::field::Field;
use tensor::region;

/// Approximate maximum number of values of one array in memory. This number determines the height of bands.
pub const BAND: usize = 1 << 23;

/// Minimum number of rows of a band.
const LEAST_ROWS: usize = 16;

/// Number of values per pixel that are always in memory. The values are the weights of the pixel's
/// neighbours.
const LEAST_NUMBERS: usize = 128;

/// The reason why a store was not denoised.
#[derive(Debug, thiserror::Error)]
pub enum DenoiseError {
    /// The stores cannot be read, or are not renders of the same scene.
    #[error(transparent)]
    Inputs(#[from] MergeError),
    /// The number of stores is not 1 or 2.
    #[error(
        "expected 1 store, or 2 renders of one scene with different seeds, got {0} stores; combine more than 2 renders with `sunstone merge`"
    )]
    TooMany(usize),
    /// A field of an input is not rendered yet, or is missing.
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The output cannot be created.
    #[error(transparent)]
    Create(#[from] CreateError),
}

impl DenoiseError {
    /// Returns whether the cause is a system error rather than the input.
    pub fn is_of_system(&self) -> bool {
        match self {
            Self::Inputs(e) => e.is_of_system(),
            Self::Access(e) => e.is_of_system(),
            Self::Create(e) => e.is_of_system(),
            Self::TooMany(_) | Self::Open(_) => false,
        }
    }
}

/// The result of denoising one slice.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    pub slice: String,
    /// Estimated RMS error of all means, divided by the RMS error of the pooled input renders. `None` if the
    /// slice is not an image or has no standard errors, and was therefore copied.
    pub error: Option<f64>,
}

/// Denoises a store, or two renders of one scene with different seeds, into a new store `out`. Slices without
/// camera rows and columns are copied from the first store.
///
/// # Errors
/// Returns [`DenoiseError`] if an input is invalid or the output cannot be written.
pub fn denoise(inputs: &[PathBuf], out: &Path, replace: bool) -> Result<Vec<Outcome>, DenoiseError> {
    denoise_in_bands(inputs, out, replace, BAND)
}

/// Does the same as [`denoise`], with bands of about `band` values.
///
/// # Errors
/// Returns [`DenoiseError`] if an input is invalid or the output cannot be written.
pub fn denoise_in_bands(
    inputs: &[PathBuf],
    out: &Path,
    replace: bool,
    band: usize,
) -> Result<Vec<Outcome>, DenoiseError> {
    if inputs.len() > 2 {
        return Err(DenoiseError::TooMany(inputs.len()));
    }
    let equal = MatchingStores::open(inputs)?;
    let stores: Vec<&TensorStore> = equal.stores().collect();
    if let Some(unfinished) = stores.iter().find(|s| !s.is_finished()) {
        return Err(AccessError::unfinished(unfinished.path(), unfinished.part()).into());
    }
    let mut slices = vec![];
    for name in stores[0].slice_names() {
        let all = stores.iter().map(|s| s.slice(name)).collect::<Result<Vec<_>, _>>()?;
        slices.push(all);
    }
    let layouts: Vec<_> = slices
        .iter()
        .map(|all| {
            // Denoising correlates pixels, so the standard errors of totals are unknown.
            let layout = SliceLayout { totals: false, ..all[0].layout().clone() };
            (layout, all[0].attributes().clone())
        })
        .collect();
    let mut attributes = equal.attributes();
    attributes.insert(ATTRIBUTE.into(), mark(&stores, &slices));
    let mut outcomes = vec![];
    let fill = |made: &TensorStore| -> Result<(), DenoiseError> {
        for all in &slices {
            let target = made.slice(all[0].name())?;
            let error = if is_image(&all[0]) {
                image(all, &equal.shares(), &target, band)?
            } else {
                copy(&all[0], &target)?;
                None
            };
            let slice = target.name().to_owned();
            outcomes.push(Outcome { slice, error });
        }
        equal.write_samples(made)?;
        Ok(made.finish()?)
    };
    TensorStore::create_filled(out, &layouts, &attributes, equal.grid(), replace, fill)?;
    Ok(outcomes)
}

/// Returns the store attribute that records the inputs and the method.
fn mark(stores: &[&TensorStore], slices: &[Vec<StoredSlice>]) -> Value {
    let of = |s: &&TensorStore| json!({"path": s.path().display().to_string(), "manifest": s.fingerprint()});
    let copied: Vec<&str> = slices.iter().filter(|s| !is_image(&s[0])).map(|s| s[0].name()).collect();
    json!({
        "by": format!("sunstone {}", env!("CARGO_PKG_VERSION")),
        "method": "non-local means, one weight for all numbers of a pair of pixels",
        "weights_from": if stores.len() > 1 { "the other render" } else { "the render itself" },
        "reach_px": REACH,
        "outliers": if stores.len() == 2 { "of one render alone, replaced by the mean of their neighbours" } else { "kept" },
        "strengths": STRENGTHS,
        "of": stores.iter().map(of).collect::<Vec<_>>(),
        "copied": copied,
    })
}

/// Returns whether a slice has camera rows and columns.
fn is_image(slice: &StoredSlice) -> bool {
    slice.find(AxisKind::Y) == Some(0) && slice.find(AxisKind::X) == Some(1)
}

/// Copies a slice unchanged to another store.
fn copy(from: &StoredSlice, to: &StoredSlice) -> Result<(), DenoiseError> {
    for field in Field::ALL.into_iter().filter(|f| from.has(*f) && to.has(*f)) {
        for (start, shape) in from.chunks(field)? {
            to.write(field, &start, &shape, &from.read(field, &start, &shape)?)?;
        }
    }
    Ok(())
}

/// Splits an axis into runs of adjacent entries.
fn runs(axis: &Axis, single: bool) -> Vec<Range<usize>> {
    let mut all: Vec<Range<usize>> = vec![];
    for (i, c) in axis.coords.iter().enumerate() {
        match all.last_mut() {
            Some(run) if !single || c - axis.coords[i - 1] <= 1.0 => run.end = i + 1,
            _ => all.push(i..i + 1),
        }
    }
    all
}

/// Sums of squared standard errors before and after denoising.
#[derive(Default)]
struct Squares {
    before: f64,
    after: f64,
}

/// Denoises one slice, and returns [`Outcome::error`].
fn image(
    renders: &[StoredSlice],
    shares: &[f32],
    target: &StoredSlice,
    band: usize,
) -> Result<Option<f64>, DenoiseError> {
    let layout = target.layout();
    let single = target.attributes().get("pixels_per_element").and_then(Value::as_u64) == Some(1);
    let rest = &layout.axes[2..];
    let chunk: u64 = rest.iter().map(|a| a.chunk).product();
    let mut squares = Squares::default();
    for columns in runs(&layout.axes[1], single) {
        let rows = band / (columns.len() * (chunk as usize).max(LEAST_NUMBERS)).max(1);
        let whole = layout.axes[0].chunk as usize;
        let rows = (rows / whole * whole).max(rows.min(whole)).max(LEAST_ROWS);
        for run in runs(&layout.axes[0], single) {
            for first in run.clone().step_by(rows) {
                let part = Part {
                    rows: first..(first + rows).min(run.end),
                    read: first.saturating_sub(HALO).max(run.start)..(first + rows + HALO).min(run.end),
                    columns: columns.clone(),
                };
                part.denoise(renders, shares, target, &mut squares)?;
            }
        }
    }
    let ratio = (squares.after / squares.before).sqrt();
    Ok(ratio.is_finite().then_some(ratio))
}

/// A band of a slice, given by the rows to write, the rows to read, and the range of columns.
struct Part {
    rows: Range<usize>,
    read: Range<usize>,
    columns: Range<usize>,
}

impl Part {
    /// Returns the first index and the shape of the box that covers the given rows, the part's columns and a
    /// range of the remaining axes.
    fn over(&self, rows: &Range<usize>, start: &[u64], shape: &[u64]) -> [Vec<u64>; 2] {
        let pixels = [rows, &self.columns];
        let first = pixels.iter().map(|r| r.start as u64).chain(start.iter().copied());
        let size = pixels.iter().map(|r| r.len() as u64).chain(shape.iter().copied());
        [first.collect(), size.collect()]
    }

    fn denoise(
        &self,
        renders: &[StoredSlice],
        shares: &[f32],
        target: &StoredSlice,
        squares: &mut Squares,
    ) -> Result<(), DenoiseError> {
        let fields = [(Field::Mean, Field::StdError), (Field::Overflow, Field::OverflowStdError)];
        let weights = Weights::new(&self.guide(renders, shares)?);
        for (mean, error) in fields.into_iter().filter(|(mean, _)| target.has(*mean)) {
            for (start, shape) in rest_chunks(target, mean)? {
                let parts = renders.iter().map(|slice| self.read(slice, [mean, error], &start, &shape));
                let parts = parts.collect::<Result<Vec<_>, _>>()?;
                let made = average(&weights, &parts);
                let [at, size] = self.over(&self.rows, &start, &shape);
                let row = self.columns.len() * made.channels;
                let skip = self.rows.start - self.read.start;
                let own = skip * row..(skip + self.rows.len()) * row;
                target.write(mean, &at, &size, &made.mean[own.clone()])?;
                target.write(error, &at, &size, &made.error[own.clone()])?;
                if mean == Field::Mean {
                    let square = |e: &f32| f64::from(*e).powi(2);
                    for i in own.filter(|i| made.error[*i].is_finite()) {
                        squares.after += square(&made.error[i]);
                        let of = |(p, s): (&Values, &f32)| square(&p.error[i]) * square(s);
                        squares.before += parts.iter().zip(shares).map(of).sum::<f64>();
                    }
                }
            }
        }
        Ok(())
    }

    fn guide(&self, renders: &[StoredSlice], shares: &[f32]) -> Result<Guide, DenoiseError> {
        let mut builders = vec![];
        for slice in renders {
            let size = [self.read.len(), self.columns.len()];
            let mut builder = GuideBuilder::new(size, &slice.layout().axes[2..]);
            for (start, shape) in rest_chunks(slice, Field::Mean)? {
                let values = self.read(slice, [Field::Mean, Field::StdError], &start, &shape)?;
                builder.add(&start, &shape, &values.mean, &values.error);
            }
            if slice.has(Field::Overflow) {
                for (start, shape) in rest_chunks(slice, Field::Overflow)? {
                    let values =
                        self.read(slice, [Field::Overflow, Field::OverflowStdError], &start, &shape)?;
                    builder.look(&values.mean);
                    builder.look(&values.error);
                }
            }
            builders.push(builder);
        }
        Ok(Guide::new(builders, shares.to_vec()))
    }

    fn read(
        &self,
        slice: &StoredSlice,
        [mean, error]: [Field; 2],
        start: &[u64],
        shape: &[u64],
    ) -> Result<Values, AccessError> {
        let [at, size] = self.over(&self.read, start, shape);
        Ok(Values {
            size: [self.read.len(), self.columns.len()],
            channels: shape.iter().product::<u64>() as usize,
            mean: slice.read(mean, &at, &size)?,
            error: slice.read(error, &at, &size)?,
        })
    }
}

/// First index and shape of a box in an array.
type Region = (Vec<u64>, Vec<u64>);

/// Returns the chunks of a field along the axes after rows and columns.
fn rest_chunks(slice: &StoredSlice, field: Field) -> Result<Vec<Region>, AccessError> {
    let layout = slice.field_layout(field)?;
    let rest = &layout.axes[2..];
    let shape: Vec<u64> = rest.iter().map(Axis::len).collect();
    let chunk: Vec<u64> = rest.iter().map(|a| a.chunk).collect();
    Ok(region::chunks(&shape, &chunk).collect())
}

//! Pools the rounds of one render. Each round is a separate store with independent samples. The number of
//! samples differs between tiles ([`tensor::target`]).
//!
//! The pooled mean is the mean of all samples, m = Σ Nᵢmᵢ / ΣNᵢ. Rounds are independent and have separate
//! errors eᵢ, so the pooled error is e² = Σ Nᵢ²eᵢ² / (ΣNᵢ)².

use super::{
    Input, MergeError, Parts, Pooled, common_grid, element_counts, merged_attributes, origin, parts,
    pool_into, totals,
};
use crate::denoised;
use crate::merge::pool::Pool;
use crate::zarr::TensorStore;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use tensor::field::Field;
use tensor::target::{Lit, ROUND, Survey, TILE_SAMPLES, Tile};

/// Minimum total of a lit pixel, as a fraction of the 99th percentile of all totals.
const LIT: f64 = 0.01;

fn open(rounds: &[PathBuf]) -> Result<Vec<Input>, MergeError> {
    let open = |path: &PathBuf| -> Result<Input, MergeError> {
        let store = TensorStore::open(path)?;
        denoised::refuse(&store)?;
        // With a group size of 1, the weights of the stores are their sample counts.
        Ok(Input { group: 1.0, ..Input::of(store) })
    };
    rounds.iter().map(open).collect()
}

/// Opens a slice in all rounds. Samples are identically distributed only within each round.
fn slice_of<'a>(inputs: &'a [Input], name: &str) -> Result<Parts<'a>, MergeError> {
    Ok(Parts { equal: false, ..parts(inputs, name)? })
}

/// Returns the number of samples per pixel of each tile, summed over rounds.
fn tile_samples(inputs: &[Input]) -> Result<Vec<u32>, MergeError> {
    let mut all: Vec<u32> = vec![];
    for input in inputs {
        let missing = || MergeError::Attribute { path: input.store.path().to_owned(), key: TILE_SAMPLES };
        let counts = input.attributes.get(TILE_SAMPLES).and_then(Value::as_array);
        let counts = counts.ok_or_else(missing)?;
        if all.is_empty() {
            all = vec![0; counts.len()];
        }
        if counts.len() != all.len() {
            return Err(missing());
        }
        for (sum, count) in all.iter_mut().zip(counts) {
            let count = count.as_u64().and_then(|n| u32::try_from(n).ok());
            *sum = sum.saturating_add(count.ok_or_else(missing)?);
        }
    }
    Ok(all)
}

/// Returns the relative error and the sample count of each lit pixel of a slice, estimated from all rounds.
///
/// A pixel is lit if its total is at least 1 % of the 99th percentile of all totals. The total of a pixel is
/// M00, summed over all entries of the pixel and averaged over wavelengths. The error of a pixel is the
/// standard error of the total divided by the total.
///
/// # Errors
/// Returns an error if the stores are not rounds of one render, lack the slice or cannot be read.
pub fn survey(rounds: &[PathBuf], slice: &str) -> Result<Survey, MergeError> {
    let inputs = open(rounds)?;
    let Some(first) = inputs.first() else {
        return Ok(Survey::default());
    };
    let missing = |key| MergeError::Attribute { path: first.store.path().to_owned(), key };
    let grid = common_grid(&inputs).ok_or_else(|| missing("samples_per_pixel"))?;
    let ([w, h], edge) = (grid.camera, grid.tile);
    let across = w.div_ceil(edge);
    let samples = tile_samples(&inputs)?;
    if samples.len() != (across * h.div_ceil(edge)) as usize {
        return Err(missing(TILE_SAMPLES));
    }
    let pixels = |tile: u32| {
        let length = |at: u32, of: u32| edge.min(of - at * edge);
        length(tile % across, w) * length(tile / across, h)
    };
    let tiles =
        (0..).zip(&samples).map(|(n, samples)| Tile { pixels: pixels(n), samples: *samples, kept: false });
    let mut tiles: Vec<Tile> = tiles.collect();

    let parts = slice_of(&inputs, slice)?.parts;
    let field = Field::TotalStdError;
    if !parts.iter().all(|p| p.slice.has(field)) {
        return Err(missing("total_std_error"));
    }
    let shape = parts[0].slice.field_layout(field)?.shape();
    let Some([rows, columns]) = parts[0].pixels.clone() else {
        return Err(missing("samples_per_pixel"));
    };
    let mut pools = vec![Pool::default(); rows.len() * columns.len()];
    for part in &parts {
        let means = totals::means(&part.slice)?;
        let errors = part.slice.read(field, &[0, 0], &shape)?;
        let counts = element_counts(part, &[0, 0], &shape)?;
        for (pool, ((n, mean), error)) in pools.iter_mut().zip(counts.iter().zip(&means).zip(&errors)) {
            pool.add(*n, *mean, f64::from(*error), false);
        }
    }
    let mut bright: Vec<f64> = pools.iter().map(|p| p.mean).collect();
    bright.sort_unstable_by(f64::total_cmp);
    let least = LIT * bright.get(bright.len().saturating_sub(1) * 99 / 100).unwrap_or(&0.0);
    let mut lit = vec![];
    let places = rows.iter().flat_map(|r| columns.iter().map(move |c| (r, c)));
    for (pool, (row, column)) in pools.iter().zip(places) {
        let tile = row.0 / edge * across + column.0 / edge;
        tiles[tile as usize].kept = true;
        if pool.mean > 0.0 && pool.mean >= least {
            let size = f64::from((row.1 - row.0 + 1) * (column.1 - column.0 + 1));
            let error = pool.std_error(false) / pool.mean;
            lit.push(Lit {
                tile,
                samples: pool.n / size,
                error: if error.is_nan() { f64::INFINITY } else { error },
            });
        }
    }
    Ok(Survey { lit, tiles, across })
}

/// Pools all rounds into a new store `out`, and adds the root attributes `extra`. An existing store is
/// replaced only if `replace` is true.
///
/// # Errors
/// Returns an error if the stores are not rounds of one render, or if reading or writing fails.
pub fn pool(
    rounds: &[PathBuf],
    out: &Path,
    extra: &Map<String, Value>,
    replace: bool,
) -> Result<(), MergeError> {
    let inputs = open(rounds)?;
    let Some(first) = inputs.first() else {
        return Err(MergeError::TooFew);
    };
    let slices = first.store.slice_names().iter().map(|name| slice_of(&inputs, name));
    let slices = slices.collect::<Result<Vec<_>, _>>()?;
    let own = [ROUND, TILE_SAMPLES, "merged_from"];
    let mut attributes: Map<String, Value> =
        merged_attributes(&inputs).into_iter().filter(|(key, _)| !own.contains(&key.as_str())).collect();
    attributes.insert("seeds".into(), first.attributes.get("seeds").cloned().unwrap_or_default());
    let most = tile_samples(&inputs)?.into_iter().max();
    attributes.insert("samples_per_pixel".into(), json!(most));
    let rays = inputs.iter().filter_map(|i| i.attributes.get("rays")?.as_u64());
    attributes.insert("rays".into(), json!(rays.fold(0, u64::saturating_add)));
    attributes.extend(extra.clone());
    let command = concat!("rounds by ", env!("CARGO_PKG_VERSION"));
    let origin = origin(command, inputs.iter().map(|input| &input.store));
    let pooled = Pooled { inputs: &inputs, slices: &slices, attributes: &attributes, origin: &origin };
    pool_into(out, &pooled, replace, false)
}

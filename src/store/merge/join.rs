//! Joins the parts of one render tile by tile. The result equals the whole render byte for byte.
//!
//! Each tile belongs to one part, so no values are summed. A chunk that belongs to one part is copied. A
//! chunk that is not aligned with tiles can belong to several parts. Each element of this chunk belongs to
//! one part, so the chunk is assembled element by element.

mod error;
mod set;

pub use error::JoinError;
use set::Set;

use super::origin;
use crate::zarr::{SampleGrid, StoredSlice, TensorStore};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use tensor::field::Field;
use tensor::part;
use tensor::region;

/// Returns whether a store is a finished or unfinished part of a render.
pub(super) fn is_part(path: &Path) -> bool {
    TensorStore::open(path).is_ok_and(|store| store.part().is_some())
}

/// Joins parts into a new store `out`. An existing store is replaced only if `replace` is true.
pub(super) fn join(inputs: &[PathBuf], out: &Path, replace: bool) -> Result<(), JoinError> {
    let set = Set::open(inputs)?;
    let parts = set.stores();
    let first = parts[0];
    let names = first.slice_names();
    let slices = names
        .iter()
        .map(|name| parts.iter().map(|store| store.slice(name)).collect())
        .collect::<Result<Vec<Vec<StoredSlice>>, _>>()?;
    let layouts: Vec<_> =
        slices.iter().map(|of| (of[0].layout().clone(), of[0].written_attributes())).collect();
    let grid = first.samples_shape().map(|(shape, chunk)| SampleGrid::new(shape, chunk));
    let fill = |whole: &TensorStore| -> Result<(), JoinError> {
        for of in &slices {
            join_slice(of, &whole.slice(of[0].name())?)?;
        }
        join_samples(&parts, whole)?;
        Ok(whole.finish()?)
    };
    let origin = origin(concat!("join by ", env!("CARGO_PKG_VERSION")), parts.iter().copied());
    TensorStore::create_from(out, &layouts, &attributes(&parts), grid, replace, Some(&origin), fill).map(drop)
}

/// Returns the attributes of the whole render. The attributes `discarded_samples`, `rays` and `wall_time_s`
/// are summed over the parts. All other attributes are common to all parts.
fn attributes(parts: &[&TensorStore]) -> Map<String, Value> {
    let all: Vec<_> = parts.iter().map(|store| store.attributes()).collect();
    let mut whole = all[0].clone();
    whole.shift_remove(part::ATTRIBUTE);
    whole.insert("status".into(), json!("complete"));
    for key in ["discarded_samples", "rays"] {
        let sum = all.iter().filter_map(|a| a.get(key)?.as_u64()).fold(0, u64::saturating_add);
        whole.insert(key.into(), json!(sum));
    }
    let seconds = all.iter().filter_map(|a| a.get("wall_time_s")?.as_f64());
    whole.insert("wall_time_s".into(), json!(seconds.sum::<f64>()));
    whole
}

fn join_slice(parts: &[StoredSlice], whole: &StoredSlice) -> Result<(), JoinError> {
    for field in Field::ALL.into_iter().filter(|field| whole.has(*field)) {
        let chunks: Vec<_> = whole.chunks(field)?.collect();
        chunks.par_iter().try_for_each(|(start, shape)| -> Result<(), JoinError> {
            // A chunk with a file is complete, so a resumed merge skips the chunk.
            if whole.is_stored(field, start)? {
                return Ok(());
            }
            let mut having = vec![];
            for part in parts {
                if part.is_listed(field, start)? {
                    having.push(part);
                }
            }
            match having[..] {
                [] => Ok(()),
                [one] => Ok(whole.copy_chunk(field, start, one)?),
                _ => put_together(&having, whole, field, start, shape),
            }
        })?;
    }
    Ok(())
}

/// Writes a chunk to which several parts contribute different elements.
fn put_together(
    parts: &[&StoredSlice],
    whole: &StoredSlice,
    field: Field,
    start: &[u64],
    shape: &[u64],
) -> Result<(), JoinError> {
    let mut values = parts[0].read(field, start, shape)?;
    for (n, part) in parts.iter().enumerate().skip(1) {
        for (value, other) in values.iter_mut().zip(part.read(field, start, shape)?) {
            if value.to_bits() == 0 {
                *value = other;
            } else if other.to_bits() != 0 {
                return Err(JoinError::Twice {
                    first: parts[..n].iter().map(|p| p.path().to_owned()).collect(),
                    second: part.path().to_owned(),
                    field: field.name(),
                });
            }
        }
    }
    Ok(whole.write(field, start, shape, &values)?)
}

fn join_samples(parts: &[&TensorStore], whole: &TensorStore) -> Result<(), JoinError> {
    let Some((shape, chunk)) = whole.samples_shape() else {
        return Ok(());
    };
    let chunks: Vec<_> = region::chunks(&shape, &chunk).collect();
    chunks.par_iter().enumerate().try_for_each(|(tile, (start, _))| {
        let owner = |store: &&&TensorStore| store.part().is_some_and(|p| p.contains(tile as u32));
        match parts.iter().find(owner) {
            Some(store) => Ok(whole.copy_samples([start[0], start[1]], store)?),
            None => Ok(()),
        }
    })
}

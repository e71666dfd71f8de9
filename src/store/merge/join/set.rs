//! The complete set of parts of one render, in which each part occurs once.

use super::error::JoinError;
use crate::zarr::{AccessError, TensorStore};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use tensor::part::{self, Part};

/// Maximum number of parts or tiles that a message lists.
const NAMED: usize = 12;

/// Names of root attributes whose values may differ between the parts of one render.
const OWN: [&str; 4] = [part::ATTRIBUTE, "discarded_samples", "rays", "wall_time_s"];

pub(super) struct Set(Vec<(Part, TensorStore)>);

impl Set {
    /// Opens parts and checks that they are a complete set. A part may occur twice if both copies are
    /// bit-identical.
    pub(super) fn open(paths: &[PathBuf]) -> Result<Self, JoinError> {
        let mut set: Vec<(Part, TensorStore)> = Vec::new();
        for path in paths {
            let (part, store) = open(path, paths)?;
            if let Some((_, first)) = set.first() {
                check_same_render(first, &store)?;
            }
            match set.iter().find(|(other, _)| *other == part) {
                Some((_, twin)) => check_twins(twin, &store, part)?,
                None => set.push((part, store)),
            }
        }
        // Sort the parts, so that the result does not depend on the order of the inputs.
        set.sort_by_key(|(part, _)| *part);
        let tiles = tiles(&set[0].1)?;
        check_complete(&set, tiles)?;
        Ok(Self(set))
    }

    pub(super) fn stores(&self) -> Vec<&TensorStore> {
        self.0.iter().map(|(_, store)| store).collect()
    }
}

fn open(path: &Path, all: &[PathBuf]) -> Result<(Part, TensorStore), JoinError> {
    let found = TensorStore::open(path)?;
    let Some(part) = found.part() else {
        let mut others = all.iter().filter_map(|p| Some((p, TensorStore::open(p).ok()?.part()?)));
        return Err(match others.next() {
            Some((of, part)) => JoinError::Mixed { part: of.clone(), of: part, other: path.to_owned() },
            None => JoinError::NoPart { path: path.to_owned() },
        });
    };
    let unfinished = || JoinError::Unfinished { path: path.to_owned(), part };
    let store = if base::journal::exists(path) { None } else { TensorStore::open_part(path)? };
    let store = store.ok_or_else(unfinished)?;
    crate::denoised::refuse(&store)?;
    Ok((part, store))
}

fn tiles(store: &TensorStore) -> Result<u32, JoinError> {
    let Some((shape, chunk)) = store.samples_shape() else {
        return Err(AccessError::NoSamples { path: store.path().to_owned() }.into());
    };
    Ok((shape[0].div_ceil(chunk[0]) * shape[1].div_ceil(chunk[1])) as u32)
}

fn check_same_render(first: &TensorStore, second: &TensorStore) -> Result<(), JoinError> {
    let differs = |what: &str, theirs: String, ours: String| -> Result<(), JoinError> {
        Err(JoinError::Renders {
            first: first.path().to_owned(),
            second: second.path().to_owned(),
            what: what.to_owned(),
            theirs,
            ours,
        })
    };
    let (a, b) = (first.attributes(), second.attributes());
    let keys: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
    // Compare short attributes first, so that the message names a short attribute. The scene's text is long,
    // and another attribute contains the text's checksum.
    let (long, short): (Vec<&String>, Vec<&String>) = keys.into_iter().partition(|key| *key == "scene");
    for key in short.into_iter().chain(long) {
        let (theirs, ours) = (a.get(key), b.get(key));
        if !OWN.contains(&key.as_str()) && theirs != ours {
            return differs(key, shown(theirs), shown(ours));
        }
    }
    let names = |store: &TensorStore| store.slice_names().join(", ");
    if first.slice_names() != second.slice_names() {
        return differs("slices", names(first), names(second));
    }
    for name in first.slice_names() {
        let (a, b) = (first.slice(name)?, second.slice(name)?);
        if a.layout() != b.layout() || a.attributes() != b.attributes() {
            let shape = |l: &tensor::axes::SliceLayout| format!("shape {:?}", l.shape());
            return differs(&format!("slice {name}"), shape(a.layout()), shape(b.layout()));
        }
    }
    if first.samples_shape() != second.samples_shape() {
        let shape = |store: &TensorStore| format!("{:?}", store.samples_shape());
        return differs("samples", shape(first), shape(second));
    }
    Ok(())
}

/// Formats an attribute's value for a message.
fn shown(value: Option<&Value>) -> String {
    let text = value.map_or("nothing".into(), Value::to_string);
    match text.char_indices().nth(60) {
        Some((at, _)) => format!("{}…", &text[..at]),
        None => text,
    }
}

fn check_twins(first: &TensorStore, second: &TensorStore, part: Part) -> Result<(), JoinError> {
    match first.first_difference(second) {
        None => Ok(()),
        Some(file) => Err(JoinError::Differ {
            first: first.path().to_owned(),
            second: second.path().to_owned(),
            part,
            file,
        }),
    }
}

/// Checks that every tile is in exactly one part.
fn check_complete(set: &[(Part, TensorStore)], tiles: u32) -> Result<(), JoinError> {
    let mut owners: Vec<Option<usize>> = vec![None; tiles as usize];
    for (n, (part, store)) in set.iter().enumerate() {
        for tile in part.tiles(tiles) {
            if let Some(owner) = owners[tile as usize].replace(n) {
                let (other, first) = &set[owner];
                return Err(JoinError::Overlap {
                    first: first.path().to_owned(),
                    part: *other,
                    second: store.path().to_owned(),
                    other: *part,
                    tile,
                });
            }
        }
    }
    let missing: Vec<u32> = (0..tiles).filter(|tile| owners[*tile as usize].is_none()).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let parts: Vec<Part> = set.iter().map(|(part, _)| *part).collect();
    Err(describe(&parts, &missing))
}

/// Returns the error for missing parts if all parts are `K/N` with the same N. Otherwise, returns the error
/// for missing tiles.
fn describe(parts: &[Part], missing: &[u32]) -> JoinError {
    if let Part::Share { of, .. } = parts[0]
        && parts.iter().all(|p| matches!(p, Part::Share { of: n, .. } if *n == of))
    {
        let absent: Vec<u32> =
            (1..=of).filter(|number| !parts.contains(&Part::Share { number: *number, of })).collect();
        let option = match absent[..] {
            [one] => format!("--part {one}/{of}"),
            _ => format!("--part K/{of}"),
        };
        let missing = match &absent[..] {
            [one] => format!("part {one} of {of} is"),
            several => format!("parts {} of {of} are", listed(several.iter().map(u32::to_string))),
        };
        return JoinError::Missing { missing, option };
    }
    let mut ranges: Vec<(u32, u32)> = Vec::new();
    for &tile in missing {
        match ranges.last_mut() {
            Some((_, last)) if *last + 1 == tile => *last = tile,
            _ => ranges.push((tile, tile)),
        }
    }
    let (first, last) = ranges[0];
    let names = ranges
        .iter()
        .map(|(first, last)| if first == last { first.to_string() } else { format!("{first} to {last}") });
    JoinError::Missing {
        missing: match missing {
            [one] => format!("tile {one} is"),
            _ => format!("tiles {} are", listed(names)),
        },
        option: match ranges.len() {
            1 => format!("--tiles {first}-{last}"),
            _ => "--tiles A-B".into(),
        },
    }
}

/// Formats a list of at most [`NAMED`] names, and the number of further names.
fn listed(names: impl Iterator<Item = String>) -> String {
    let names: Vec<String> = names.collect();
    match names.len().checked_sub(NAMED) {
        Some(more) if more > 0 => format!("{} and {more} more", names[..NAMED].join(", ")),
        _ => match names.split_last() {
            Some((last, rest)) if !rest.is_empty() => format!("{} and {last}", rest.join(", ")),
            _ => names.concat(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_parts_are_named() {
        let share = |number| Part::Share { number, of: 8 };
        let text = |parts: &[Part], missing: &[u32]| describe(parts, missing).to_string();
        let two = text(&[1, 2, 4, 6, 7, 8].map(share), &[2, 4, 10]);
        assert!(two.starts_with("parts 3 and 5 of 8 are missing") && two.contains("--part K/8"), "{two}");
        let one = text(&[1, 2, 3, 4, 5, 6, 8].map(share), &[6]);
        assert!(one.starts_with("part 7 of 8 is missing") && one.contains("--part 7/8"), "{one}");
        let mixed = text(&[share(1), Part::Tiles { first: 1, last: 3 }], &[5, 6, 7, 9]);
        assert!(mixed.starts_with("tiles 5 to 7 and 9 are missing"), "{mixed}");
        let range = text(&[Part::Tiles { first: 4, last: 9 }], &[0, 1, 2, 3]);
        assert!(range.contains("--tiles 0-3"), "{range}");
        let many: Vec<u32> = (0..60).map(|n| 2 * n).collect();
        let all = text(&[Part::Tiles { first: 1, last: 1 }], &many);
        assert!(all.contains("22 and 48 more"), "{all}");
    }
}

//! Defines parts of a render. A part is the set of tiles of camera pixels that one of several machines
//! renders.
//!
//! A tile is a pure function of scene, seed and samples, so the parts together are bit-identical to the whole
//! render. Tiles are assigned to the parts in turn. Contiguous regions of an image, such as dark sky or
//! glass, have similar render times, so each part takes about the same time.

use serde_json::{Map, Value, json};
use std::fmt;

/// Name of the root attribute of a store that identifies the store's part of a render.
pub const ATTRIBUTE: &str = "part";

/// A subset of the tiles of a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// Every `of`-th tile, beginning with tile `number` if tiles are counted from 1.
    Share {
        /// Number of this part, from 1 to `of`.
        number: u32,
        /// Total number of parts.
        of: u32,
    },
    /// A range of tiles, which are numbered from 0, row by row.
    Tiles {
        /// First tile of the range.
        first: u32,
        /// Last tile of the range (inclusive).
        last: u32,
    },
}

impl Part {
    /// Returns an error message if the part is invalid for a render of `tiles` tiles. A share may be empty.
    pub fn fault(self, tiles: u32) -> Option<String> {
        match self {
            Self::Share { number, of } if number == 0 || number > of => {
                Some(format!("part {number}/{of} does not exist; give a part from 1/{of} to {of}/{of}"))
            }
            Self::Tiles { first, last } if first > last => {
                Some(format!("the range of tiles {first} to {last} is empty; give the lower number first"))
            }
            Self::Tiles { last, .. } if last >= tiles => {
                let most = tiles.saturating_sub(1);
                Some(format!("tile {last} does not exist; the image has tiles 0 to {most}"))
            }
            _ => None,
        }
    }

    /// Returns whether the part contains a tile.
    pub fn contains(self, tile: u32) -> bool {
        match self {
            Self::Share { number, of } => of > 0 && tile % of == number.wrapping_sub(1),
            Self::Tiles { first, last } => (first..=last).contains(&tile),
        }
    }

    /// Iterates over the tiles of the part, for a render of `tiles` tiles.
    pub fn tiles(self, tiles: u32) -> impl Iterator<Item = u32> {
        (0..tiles).filter(move |tile| self.contains(*tile))
    }

    /// Converts the part to a store attribute: `{"number": 3, "of": 8}` or `{"tiles": [0, 31]}`.
    pub fn to_json(self) -> Value {
        match self {
            Self::Share { number, of } => json!({"number": number, "of": of}),
            Self::Tiles { first, last } => json!({"tiles": [first, last]}),
        }
    }

    /// Parses a store attribute written by [`Self::to_json`]. Returns `None` for any other value.
    pub fn from_json(value: &Value) -> Option<Self> {
        let number = |value: &Value| u32::try_from(value.as_u64()?).ok();
        let part = match value.get("tiles") {
            Some(tiles) => Self::Tiles { first: number(tiles.get(0)?)?, last: number(tiles.get(1)?)? },
            None => Self::Share { number: number(value.get("number")?)?, of: number(value.get("of")?)? },
        };
        (part.fault(u32::MAX).is_none() && part.to_json() == *value).then_some(part)
    }

    /// Returns the part in the root attributes of a store, or `None` if the store is a whole render.
    pub fn of_attributes(attributes: &Map<String, Value>) -> Option<Self> {
        attributes.get(ATTRIBUTE).and_then(Self::from_json)
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Share { number, of } => write!(f, "part {number} of {of}"),
            Self::Tiles { first, last } if first == last => write!(f, "tile {first}"),
            Self::Tiles { first, last } => write!(f, "tiles {first} to {last}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies that every tile is in exactly one share, and that sizes of shares differ by at most one tile.
    #[test]
    fn every_tile_is_in_exactly_one_share() {
        for (of, tiles) in [(1, 7), (3, 7), (7, 7), (8, 7), (5, 0)] {
            let shares: Vec<Vec<u32>> =
                (1..=of).map(|number| Part::Share { number, of }.tiles(tiles).collect()).collect();
            let mut all = shares.concat();
            all.sort_unstable();
            assert_eq!(all, (0..tiles).collect::<Vec<_>>());
            let sizes = shares.iter().map(Vec::len);
            assert!(sizes.clone().max().unwrap_or(0) - sizes.min().unwrap_or(0) <= 1);
        }
    }

    #[test]
    fn attributes_round_trip_and_invalid_ones_are_refused() {
        let parts = [Part::Share { number: 3, of: 8 }, Part::Tiles { first: 0, last: 31 }];
        for part in parts {
            assert_eq!(Part::from_json(&part.to_json()), Some(part));
        }
        for wrong in [
            json!(null),
            json!("3/8"),
            json!({"number": 9, "of": 8}),
            json!({"number": 0, "of": 0}),
            json!({"number": 1.5, "of": 8}),
            json!({"tiles": [5, 4]}),
            json!({"tiles": [0]}),
            json!({"tiles": [0, 1, 2]}),
            json!({"number": 1, "of": 2, "more": 3}),
        ] {
            assert_eq!(Part::from_json(&wrong), None, "{wrong}");
        }
    }

    #[test]
    fn errors_name_the_valid_range() {
        let fault = |part: Part| part.fault(12).unwrap_or_default();
        assert!(fault(Part::Share { number: 9, of: 8 }).contains("8/8"));
        assert!(fault(Part::Tiles { first: 3, last: 12 }).contains("0 to 11"));
        assert!(fault(Part::Tiles { first: 3, last: 2 }).contains("lower"));
        assert_eq!(Part::Share { number: 20, of: 20 }.fault(12), None);
        assert!(!Part::Share { number: 0, of: 0 }.contains(0));
    }
}

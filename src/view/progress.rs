//! Progress of a render that another process writes.

use crate::answer::Answer;
use crate::error::ViewError;
use crate::open::Shown;
use serde_json::{Map, Value, json};
use tensor::sink::TileRecord;

/// Returns the number of finished tiles. The page computes the error from the values that it shows.
pub(crate) fn progress(shown: &Shown) -> Result<Answer, ViewError> {
    if shown.is_captures {
        return Ok(Answer::Json(Value::Null));
    }
    let store = shown.tensor()?;
    let finished = store.is_finished();
    let tiles = tiles(&store.attributes()).unwrap_or(0);
    let done = if finished {
        tiles
    } else {
        let records: Vec<TileRecord> = base::journal::read(&shown.path).unwrap_or_default();
        let mut known: Vec<u32> = records.iter().map(|r| r.tile).collect();
        known.sort_unstable();
        known.dedup();
        known.len() as u64
    };
    Ok(Answer::Json(json!({"tilesDone": done, "tiles": tiles, "finished": finished})))
}

/// Returns the number of tiles of a render.
fn tiles(attributes: &Map<String, Value>) -> Option<u64> {
    let side = attributes.get("tile")?.as_u64().filter(|n| *n > 0)?;
    let resolution = attributes.get("camera")?.get("resolution")?.as_array()?;
    resolution.iter().map(|n| Some(n.as_u64()?.div_ceil(side))).product()
}

//! Frames of a rig's run, as the sensor gave them.

use crate::answer::Answer;
use crate::error::ViewError;
use serde_json::{Value, json};
use std::sync::Arc;
use store::zarr::frames::FrameStore;

/// Returns the numbers per frame that the run recorded, such as angles and exposure times, in the order of
/// their names.
pub(crate) fn columns(frames: &FrameStore) -> Vec<Value> {
    let folder = frames.path().join("frames");
    let mut names: Vec<String> = std::fs::read_dir(&folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name != "raw" && frames.layout().axes.iter().all(|a| a.name != *name))
        .collect();
    names.sort();
    let column = |name: String| {
        // Maps of the sensor have another length, and are no columns.
        let values = frames.read_column(&name).ok().flatten()?;
        let text = base::input::read_text(&folder.join(&name).join("zarr.json")).ok()?;
        let description: Value = serde_json::from_str(&text).ok()?;
        let units = description["attributes"]["units"].as_str().unwrap_or("1").to_owned();
        Some(json!({"name": name, "units": units, "values": values}))
    };
    names.into_iter().filter_map(column).collect()
}

/// Returns the frame at an index along each of the run's axes.
pub(crate) fn frame(frames: &FrameStore, index: &[usize]) -> Result<Answer, ViewError> {
    let layout = frames.layout();
    let shape = layout.shape();
    let (run, of_frame) = shape.split_at(layout.run_axes);
    let inside = index.len() == run.len() && index.iter().zip(run).all(|(i, n)| (*i as u64) < *n);
    if !inside {
        let reason = format!("frame {index:?} is not inside the run, whose axes have the lengths {run:?}");
        return Err(ViewError::Request(reason));
    }
    let number = index.iter().zip(run).fold(0, |at, (i, n)| at * *n as usize + i);
    let length = layout.frame_len();
    let (chunk, at) = (number / layout.frames_per_chunk(), number % layout.frames_per_chunk());
    let numbers = frames.read_chunk(chunk)?;
    let values: Vec<f32> = numbers[at * length..(at + 1) * length].iter().map(|n| *n as f32).collect();
    Ok(Answer::Arrays(json!({"shape": of_frame, "fields": ["values"]}), vec![Arc::new(values)]))
}

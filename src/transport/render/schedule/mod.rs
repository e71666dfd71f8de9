//! Schedules the rendering of tiles. A tile counts as finished when the sink has stored it completely.

mod backend;
mod job;
pub(super) mod tiles;
mod tracer;

use super::bidirectional::SharedLight;
use crate::scene::Scene;
use backend::Cpu;
use job::{job, plans};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use tensor::part::{self, Part};
pub use tensor::sink::Summary;
use tensor::sink::{Sink, TileRecord};
use tensor::target::TILE_SAMPLES;
pub(super) use tracer::WALKS_AT_ONCE;

#[derive(Debug, thiserror::Error)]
pub enum RenderError<E: std::error::Error + 'static> {
    #[error("the scene has no slices; add at least one [[slices]] table")]
    NoSlices,
    /// The part does not exist in the image, or the settings of the part are inconsistent.
    #[error("{0}")]
    Part(String),
    /// No threads are available for rendering.
    #[error("cannot start threads: {0}; use fewer threads")]
    Threads(String),
    #[error(transparent)]
    Sink(E),
}

/// Receives the progress of a render, and can stop the render. Worker threads call the methods once per tile.
pub trait Watch: Sync {
    /// Reports that a tile is finished. `summary` contains the totals of all finished tiles.
    fn tile_done(&self, summary: &Summary);
    /// Returns true if no further tile should be started.
    fn interrupted(&self) -> bool;
}

/// A [`Watch`] that reports nothing and never stops the render.
pub struct Unwatched;

impl Watch for Unwatched {
    fn tile_done(&self, _: &Summary) {}
    fn interrupted(&self) -> bool {
        false
    }
}

/// The part of a render that one machine computes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Share<'a> {
    /// Part of the image to render. `None` selects all tiles.
    pub part: Option<Part>,
    /// Folder through which the parts of a render exchange light subpaths, or `None` for no exchange.
    pub light: Option<&'a Path>,
    /// Number of samples per pixel for each tile, at most `spp` in the settings. Tiles with 0 samples are
    /// skipped.
    pub samples: Option<&'a [u32]>,
}

impl Share<'_> {
    /// Returns the tiles of the share, for an image that has `tiles` tiles.
    fn tiles(self, tiles: u32) -> Result<Vec<u32>, String> {
        if let Some(counts) = self.samples
            && counts.len() != tiles as usize
        {
            return Err(format!(
                "got sample counts for {} tiles, but the image has {tiles} tiles",
                counts.len()
            ));
        }
        let any = |tile: &u32| self.samples.is_none_or(|counts| counts[*tile as usize] > 0);
        let Some(part) = self.part else {
            return Ok((0..tiles).filter(any).collect());
        };
        part.fault(tiles).map_or(Ok(()), Err)?;
        Ok(part.tiles(tiles).filter(any).collect())
    }

    /// Returns the object that exchanges the light subpaths of the render that `attributes` describe, or
    /// `None` if there is no exchange.
    fn light(self, attributes: &Map<String, Value>, labelled: bool) -> Result<Option<SharedLight>, String> {
        let Some(folder) = self.light else {
            return Ok(None);
        };
        let Some(Part::Share { number, of }) = self.part else {
            return Err("ranges of tiles cannot share light paths; use parts K/N".into());
        };
        // Only Sunstone reads the key, so the hash of the standard library suffices.
        let mut hash = DefaultHasher::new();
        (Value::Object(attributes.clone()).to_string(), labelled).hash(&mut hash);
        let key = format!("{:016x}", hash.finish());
        Ok(Some(SharedLight::new(folder, key, number, of)))
    }
}

/// Renders all slices of a scene into a sink, on the current rayon pool. The result is bit-identical for any
/// division into parts. The attributes `extra` are stored in addition to the provenance of the scene.
///
/// # Errors
/// Returns a [`RenderError`] if the scene has no slices, the share is invalid, threads cannot be started, or
/// the sink fails. Tiles that the sink stored before the error are complete.
pub fn render<S: Sink>(
    scene: &Scene,
    extra: &[(&str, Value)],
    share: Share,
    sink: &mut S,
    watch: &dyn Watch,
) -> Result<Summary, RenderError<S::Error>> {
    render_in_parts(scene, extra, share, sink, watch, WALKS_AT_ONCE)
}

/// Renders as [`render`] does, with the vertices of at most `walks_at_once` light subpaths in memory.
pub(super) fn render_in_parts<S: Sink>(
    scene: &Scene,
    extra: &[(&str, Value)],
    share: Share,
    sink: &mut S,
    watch: &dyn Watch,
    walks_at_once: u64,
) -> Result<Summary, RenderError<S::Error>> {
    if scene.slices.is_empty() {
        return Err(RenderError::NoSlices);
    }
    let plans = plans(scene);
    let mut job = job(scene, &plans);
    let extra = extra.iter().map(|(name, value)| ((*name).to_owned(), value.clone()));
    job.attributes.extend(extra);
    let tiles = share.tiles(job.tiles()).map_err(RenderError::Part)?;
    if let Some(counts) = share.samples {
        job.attributes.insert(TILE_SAMPLES.into(), json!(counts));
    }
    let mut backend = Cpu::new(scene, &plans, walks_at_once, share.samples);
    backend.light = share.light(&job.attributes, backend.labelled()).map_err(RenderError::Part)?;
    if let Some(part) = share.part {
        job.attributes.insert(part::ATTRIBUTE.into(), part.to_json());
    }
    let records = sink.begin(&job).map_err(RenderError::Sink)?;
    let summary = run(&backend, &tiles, &records, sink, watch).map_err(RenderError::Sink)?;
    sink.end(&summary).map_err(RenderError::Sink)?;
    Ok(summary)
}

/// Renders the given tiles, except those that are recorded as complete.
fn run<S: Sink>(
    backend: &Cpu,
    tiles: &[u32],
    records: &[TileRecord],
    sink: &S,
    watch: &dyn Watch,
) -> Result<Summary, S::Error> {
    let begun = Instant::now();
    let mut todo: BTreeSet<u32> = tiles.iter().copied().collect();
    let mut before = Summary { tiles: tiles.len() as u32, ..Summary::default() };
    for r in records.iter().filter(|r| todo.remove(&r.tile)) {
        before.tiles_done += 1;
        before.discarded += r.discarded;
        before.rays_before += r.rays;
    }
    // The totals of all finished tiles, updated after each tile.
    let totals = Mutex::new(before);
    let add = |record: Option<&TileRecord>| {
        let mut totals = totals.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(record) = record {
            totals.tiles_done += 1;
            totals.samples += record.samples;
            totals.discarded += record.discarded;
            totals.rays += record.rays;
        }
        totals.complete = totals.tiles_done == totals.tiles;
        totals.wall_s = begun.elapsed().as_secs_f64();
        totals.clone()
    };
    let todo: Vec<u32> = todo.into_iter().collect();
    tracing::info!("rendering {} of {} tiles", todo.len(), tiles.len());
    backend.render(
        &todo,
        || watch.interrupted(),
        |sums| {
            sums.put(sink)?;
            let record = &sums.record;
            tracing::debug!("tile {}: {} rays in {:.2} s", record.tile, record.rays, record.seconds);
            watch.tile_done(&add(Some(record)));
            Ok(())
        },
    )?;
    Ok(add(None))
}

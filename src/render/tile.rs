//! The work: tiles of camera pixels, each finished completely and written before the next.
//!
//! A tile's values depend on scene, seed and sample count alone, so neither threads nor interruptions change a byte.

use super::path::BATCH;
use super::progress::{Journal, TileRecord};
use super::tracer::{Prepared, Tracer, tiles_at_once};
use crate::scene::Scene;
use crate::scene::epipolar::Epipolar;
use crate::tensor::accumulate::{NO_PIXEL, SlicePlan, TileAccumulator};
use crate::tensor::slice::Slice;
use crate::tensor::store::{AccessError, CreateError, OpenError, SampleGrid, StoredSlice, TensorStore};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Where to and how to write.
#[derive(Clone, Debug, Default)]
pub struct Target {
    /// The store to make.
    pub path: PathBuf,
    /// Go on with an unfinished render at `path`.
    pub resume: bool,
    /// Replace a store at `path`.
    pub replace: bool,
}

/// Why a render stopped.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The store cannot be made.
    #[error(transparent)]
    Create(#[from] CreateError),
    /// The store cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// A chunk cannot be written.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The journal cannot be written.
    #[error(
        "cannot write the progress journal in {path}: {cause}; make room or check permissions, then run again with --resume"
    )]
    Journal { path: PathBuf, cause: std::io::Error },
    /// The scene has no slices.
    #[error("the scene keeps nothing of T; add at least one [[slices]] to it")]
    NoSlices,
    /// What is to be resumed is another render.
    #[error(
        "cannot resume {path}: its {what} differs ({theirs}, now {ours}); use the same scene file and options, or another -o"
    )]
    Mismatch {
        path: PathBuf,
        what: &'static str,
        theirs: String,
        ours: String,
    },
}

/// What a render did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// True if every tile is finished; false after an interruption.
    pub complete: bool,
    pub tiles_done: u32,
    pub tiles: u32,
    /// Samples discarded, earlier runs included.
    pub discarded: u64,
    /// Samples and rays of this run.
    pub samples: u64,
    pub rays: u64,
    /// Seconds of this run.
    pub wall_s: f64,
}

/// How a render reports and is stopped; called from worker threads, once a tile.
pub trait Watch: Sync {
    /// A tile is finished; `summary` holds the totals so far.
    fn tile_done(&self, summary: &Summary);
    /// True if no new tile shall be begun.
    fn interrupted(&self) -> bool;
}

/// Watches nothing.
pub struct Unwatched;

impl Watch for Unwatched {
    fn tile_done(&self, _: &Summary) {}
    fn interrupted(&self) -> bool {
        false
    }
}

/// Pixels of tile number `tile`: first and one past last (x, y).
fn tile_pixels(scene: &Scene, tile: u32) -> ([u32; 2], [u32; 2]) {
    let ([w, h], n) = (scene.camera.resolution, scene.settings.tile);
    let across = w.div_ceil(n);
    let (x0, y0) = (tile % across * n, tile / across * n);
    ([x0, y0], [(x0 + n).min(w), (y0 + n).min(h)])
}

/// Number of tiles.
pub(super) fn tile_count(scene: &Scene) -> u32 {
    let ([w, h], n) = (scene.camera.resolution, scene.settings.tile);
    w.div_ceil(n) * h.div_ceil(n)
}

/// Renders all slices of a scene into a store, on the current rayon thread pool.
///
/// # Errors
/// [`RenderError`]; what was finished stays on disk and can be resumed.
pub fn render(scene: &Scene, target: &Target, watch: &dyn Watch) -> Result<Summary, RenderError> {
    if scene.slices.is_empty() {
        return Err(RenderError::NoSlices);
    }
    let begun = Instant::now();
    let plans: Vec<SlicePlan> = scene
        .slices
        .iter()
        .map(|s| SlicePlan::new(s, &scene.extents()))
        .collect();
    let attributes = provenance(scene);
    let store = open_store(scene, target, &plans, &attributes)?;
    let status = store.attributes().get("status").cloned();
    if target.resume && status == Some(json!("complete")) && !Journal::exists(&target.path) {
        return Ok(Summary {
            complete: true,
            tiles_done: tile_count(scene),
            tiles: tile_count(scene),
            ..Summary::default()
        });
    }
    let journal_error = |cause| RenderError::Journal {
        path: target.path.clone(),
        cause,
    };
    let (journal, records) = Journal::open(&target.path).map_err(journal_error)?;
    let stored: Vec<StoredSlice> = plans
        .iter()
        .map(|p| store.slice(p.name()))
        .collect::<Result<_, _>>()?;
    let epipolar = match &scene.projector {
        Some(p) if plans.iter().any(SlicePlan::needs_epipolar) => Epipolar::new(&scene.camera, &p.pinhole),
        _ => None,
    };
    let tiles = tile_count(scene);
    let mut done = vec![false; tiles as usize];
    // What earlier runs finished, and what this one does.
    let (before, totals) = (Totals::default(), Totals::default());
    for r in &records {
        if (r.tile as usize) < done.len() && !done[r.tile as usize] {
            done[r.tile as usize] = true;
            before.add(r);
        }
    }
    let summary = || Summary {
        complete: before.tiles() + totals.tiles() == tiles,
        tiles_done: before.tiles() + totals.tiles(),
        tiles,
        discarded: before.get(&before.discarded) + totals.get(&totals.discarded),
        samples: totals.get(&totals.samples),
        rays: totals.get(&totals.rays),
        wall_s: begun.elapsed().as_secs_f64(),
    };
    let todo: Vec<u32> = (0..tiles).filter(|t| !done[*t as usize]).collect();
    tracing::info!(
        "{} of {tiles} tiles to render, {} slices",
        todo.len(),
        plans.len()
    );
    // One a thread, made once: they are large.
    let idle = Mutex::new(Vec::<(TileAccumulator, Tracer)>::new());
    let idle = || idle.lock().unwrap_or_else(PoisonError::into_inner);
    for tiles in todo.chunks(tiles_at_once(scene)) {
        if watch.interrupted() {
            break;
        }
        let prepared = Prepared::new(scene, tiles);
        tiles
            .par_iter()
            .with_max_len(1)
            .map(|&tile| {
                if watch.interrupted() {
                    return Ok(());
                }
                let spare = idle().pop();
                let (mut accumulator, mut tracer) =
                    spare.unwrap_or_else(|| (TileAccumulator::new(&plans), Tracer::new(&prepared)));
                let record = render_tile(
                    scene,
                    &prepared,
                    epipolar.as_ref(),
                    tile,
                    &mut accumulator,
                    &mut tracer,
                    &store,
                    &stored,
                )?;
                idle().push((accumulator, tracer));
                journal.push(&record).map_err(journal_error)?;
                tracing::debug!("tile {tile}: {} rays in {:.2} s", record.rays, record.seconds);
                totals.add(&record);
                watch.tile_done(&summary());
                Ok(())
            })
            .collect::<Result<(), RenderError>>()?;
    }
    let result = summary();
    let complete = result.complete;
    let mut attributes = store.attributes();
    let earlier = attributes
        .get("wall_time_s")
        .and_then(Value::as_f64)
        .unwrap_or(0.0);
    attributes.insert("wall_time_s".into(), json!(earlier + result.wall_s));
    attributes.insert("discarded_samples".into(), json!(result.discarded));
    attributes.insert("rays".into(), json!(before.get(&before.rays) + result.rays));
    attributes.insert(
        "status".into(),
        json!(if complete { "complete" } else { "incomplete" }),
    );
    store.set_attributes(attributes)?;
    if complete {
        store.finish()?;
        journal.remove().map_err(journal_error)?;
    }
    Ok(result)
}

/// Attributes that say what was rendered, before it is.
fn provenance(scene: &Scene) -> Map<String, Value> {
    let pose = |p: &crate::scene::pinhole::Pinhole| {
        json!({
            "resolution": p.resolution,
            "focal_px": [p.focal.x, p.focal.y],
            "principal_px": [p.principal.x, p.principal.y],
            "distortion": {"k1": p.distortion.k1, "k2": p.distortion.k2, "k3": p.distortion.k3,
                           "p1": p.distortion.p1, "p2": p.distortion.p2},
            "origin_m": p.origin.to_array(),
            "right": p.axes.x_axis.to_array(), "down": p.axes.y_axis.to_array(), "forward": p.axes.z_axis.to_array(),
        })
    };
    let mut map = Map::new();
    let mut put = |k: &str, v: Value| map.insert(k.into(), v);
    put("title", json!(scene.name));
    put("source", json!(format!("sunstone {}", env!("CARGO_PKG_VERSION"))));
    put("version", json!(env!("CARGO_PKG_VERSION")));
    put(
        "conventions",
        json!(
            "Stokes, Mueller and frames as in CONVENTIONS.md (Mitsuba 3's); Mueller matrices map projector-frame Stokes to camera-frame Stokes"
        ),
    );
    put("scene_sha256", json!(scene.sha256));
    put("seeds", json!([scene.settings.seed]));
    put("samples_per_pixel", json!(scene.settings.spp));
    put("max_depth", json!(scene.settings.max_depth));
    put(
        "integrator",
        json!(format!("{:?}", scene.settings.integrator).to_lowercase()),
    );
    put("tile", json!(scene.settings.tile));
    put("wavelengths_nm", json!(scene.wavelengths.nm()));
    put("camera", pose(&scene.camera));
    if let Some(p) = &scene.projector {
        let mut v = pose(&p.pinhole);
        v["irradiance"] = json!(p.irradiance.to_array()[..scene.wavelengths.count()]);
        v["coaxial"] = json!(p.coaxial);
        put("projector", v);
    }
    put("figures", json!(scene.figures));
    put("status", json!("incomplete"));
    map
}

/// Makes the store, or opens the one to resume after checking that it is the same render.
fn open_store(
    scene: &Scene,
    target: &Target,
    plans: &[SlicePlan],
    attributes: &Map<String, Value>,
) -> Result<TensorStore, RenderError> {
    if target.resume && target.path.exists() {
        let store = TensorStore::open_for_write(&target.path)?;
        let theirs = store.attributes();
        for what in [
            "scene_sha256",
            "seeds",
            "samples_per_pixel",
            "max_depth",
            "tile",
            "version",
        ] {
            let (a, b) = (theirs.get(what), attributes.get(what));
            if a != b {
                let show = |v: Option<&Value>| v.map_or("nothing".into(), Value::to_string);
                return Err(RenderError::Mismatch {
                    path: target.path.clone(),
                    what,
                    theirs: show(a),
                    ours: show(b),
                });
            }
        }
        // Tiles that the journal calls finished are so for these slices alone.
        let ours: Vec<&str> = plans.iter().map(SlicePlan::name).collect();
        if store.slice_names() != ours {
            return Err(RenderError::Mismatch {
                path: target.path.clone(),
                what: "list of slices",
                theirs: store.slice_names().join(", "),
                ours: ours.join(", "),
            });
        }
        return Ok(store);
    }
    let slices: Vec<_> = scene
        .slices
        .iter()
        .zip(plans)
        .map(|(s, p)| (p.layout().clone(), slice_attributes(scene, s, p)))
        .collect();
    let grid = SampleGrid {
        camera: scene.camera.resolution,
        tile: scene.settings.tile,
    };
    Ok(TensorStore::create(
        &target.path,
        &slices,
        attributes,
        Some(grid),
        target.replace,
    )?)
}

fn slice_attributes(scene: &Scene, slice: &Slice, plan: &SlicePlan) -> Map<String, Value> {
    use crate::tensor::slice::ProjectorSelect as P;
    let mut map = Map::new();
    // What probing needs to lay a drive pattern over the slice's projector axes.
    if let Some(p) = &scene.projector {
        let bin = match slice.projector {
            P::Binned { nx, ny } => [nx, ny],
            _ => [1, 1],
        };
        map.insert("projector_size".into(), json!(p.pinhole.resolution));
        map.insert("projector_bin".into(), json!(bin));
    }
    map.insert("pixels_per_element".into(), json!(plan.pixels_per_element()));
    let projector = match &slice.projector {
        P::Sum => "sum".into(),
        P::All => "all".into(),
        P::Rows(_) => "rows".into(),
        P::Columns(_) => "columns".into(),
        P::Block(_) => "block".into(),
        P::Binned { nx, ny } => format!("binned {nx} x {ny}"),
        P::Mask { name, .. } => format!("mask {name}"),
        P::Epipolar { half_width_px } => format!("epipolar, half width {half_width_px} px"),
        P::NonEpipolar { half_width_px } => format!("nonepipolar, half width {half_width_px} px"),
        P::Coaxial => "coaxial".into(),
    };
    map.insert("projector_selection".into(), json!(projector));
    map
}

/// Renders one tile and writes it.
#[allow(clippy::too_many_arguments)]
fn render_tile(
    scene: &Scene,
    prepared: &Prepared,
    epipolar: Option<&Epipolar>,
    tile: u32,
    accumulator: &mut TileAccumulator,
    tracer: &mut Tracer,
    store: &TensorStore,
    stored: &[StoredSlice],
) -> Result<TileRecord, RenderError> {
    let begun = Instant::now();
    let ([x0, y0], [x1, y1]) = tile_pixels(scene, tile);
    let mut record = TileRecord {
        tile,
        samples: 0,
        discarded: 0,
        rays: 0,
        seconds: 0.0,
    };
    let mut counts = Vec::with_capacity(((x1 - x0) * (y1 - y0)) as usize);
    accumulator.begin_tile([x0, y0], [x1, y1]);
    for (x, y) in (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))) {
        if !accumulator.begin_pixel(x, y) {
            counts.push(0);
            continue;
        }
        let line = epipolar.map(|e| (e, e.line(&scene.camera, x, y)));
        let mut counted = 0;
        for first in (0..scene.settings.spp).step_by(BATCH) {
            let samples = first..(first + BATCH as u32).min(scene.settings.spp);
            let (rays, lists, elements) = tracer.trace(scene, prepared, [x, y], samples.clone());
            record.rays += u64::from(rays);
            let all_finite = finite(elements);
            for (sample, list) in samples.zip(lists) {
                if !all_finite && list.iter().any(|c| !finite(c.of(elements))) {
                    record.discarded += 1;
                    continue;
                }
                if let Some((e, line)) = line {
                    for c in list.iter_mut().filter(|c| c.pixel != NO_PIXEL) {
                        c.epipolar_px = e.distance_px(line, c.pixel);
                    }
                }
                accumulator.add_sample(sample, list, elements);
                counted += 1;
            }
        }
        record.samples += u64::from(scene.settings.spp);
        accumulator.end_pixel(x, y, counted);
        counts.push(counted);
    }
    accumulator.write(stored)?;
    let (start, shape) = ([y0, x0].map(u64::from), [y1 - y0, x1 - x0].map(u64::from));
    store.write_samples(start, shape, &counts)?;
    record.seconds = begun.elapsed().as_secs_f64();
    Ok(record)
}

/// True if every number is finite.
#[inline]
fn finite(elements: &[crate::spectrum::Spectral]) -> bool {
    let mut sum = crate::spectrum::Spectral::ZERO;
    for e in elements {
        // Zero times a finite number is zero, times anything else NaN.
        sum += *e * crate::spectrum::Spectral::ZERO;
    }
    sum.to_array().iter().all(|s| *s == 0.0)
}

/// Running totals, added to by all threads.
#[derive(Default)]
struct Totals {
    tiles: AtomicU64,
    samples: AtomicU64,
    discarded: AtomicU64,
    rays: AtomicU64,
}

impl Totals {
    fn add(&self, r: &TileRecord) {
        self.samples.fetch_add(r.samples, Ordering::Relaxed);
        self.discarded.fetch_add(r.discarded, Ordering::Relaxed);
        self.rays.fetch_add(r.rays, Ordering::Relaxed);
        self.tiles.fetch_add(1, Ordering::Relaxed);
    }

    fn get(&self, counter: &AtomicU64) -> u64 {
        counter.load(Ordering::Relaxed)
    }

    fn tiles(&self) -> u32 {
        self.get(&self.tiles) as u32
    }
}

/// True if `path` holds an unfinished render.
#[must_use]
pub fn is_unfinished(path: &Path) -> bool {
    Journal::exists(path)
}

//! Renders tiles of camera pixels and accumulates their values.
//!
//! The only inputs of the renderer are plain-data tables, which are the tables of the scene and the plans of
//! the slices. The values of a tile depend only on scene, seed and sample count. The output is therefore
//! bit-identical for any number of threads and after interruptions.

use super::tiles;
use super::tracer::{Pass, Prepared, TileParts, Tracer, tiles_at_once};
use crate::accumulate::{Counted, NO_PIXEL, Selected, SlicePlan, TileAccumulator, TileSums};
use crate::device::epipolar::{Epipolar, EpipolarLine};
use crate::render::bidirectional::SharedLight;
use crate::render::path::{BATCH, Selection, Wants};
use crate::scene::Scene;
use optics::spectrum::Spectral;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// A back end that renders on the threads of the current rayon pool.
pub(super) struct Cpu<'a> {
    scene: &'a Scene,
    plans: &'a [SlicePlan],
    epipolar: Option<Epipolar>,
    /// Maximum number of light subpaths whose vertices are kept in memory (about 50 bytes each). The image is
    /// rendered in as many parts as this limit requires. The output does not depend on the limit.
    walks_at_once: u64,
    /// Light subpaths that are shared with other parts of the render. The output does not depend on sharing.
    pub light: Option<SharedLight>,
    /// Number of samples per pixel for each tile, at most the `spp` of the scene. A tile is bit-identical to
    /// the same tile of a render whose `spp` equals the number of samples of the tile.
    samples: Option<&'a [u32]>,
}

impl<'a> Cpu<'a> {
    /// Prepares to render tiles with at most `walks_at_once` light subpaths in memory. `samples` contains the
    /// number of samples per pixel for each tile. The default number is the `spp` of the scene.
    pub fn new(
        scene: &'a Scene,
        plans: &'a [SlicePlan],
        walks_at_once: u64,
        samples: Option<&'a [u32]>,
    ) -> Self {
        let epipolar = match &scene.projector {
            Some(p) if plans.iter().any(SlicePlan::needs_epipolar) => {
                Epipolar::new(&scene.camera, &p.pinhole)
            }
            _ => None,
        };
        Self { scene, plans, epipolar, walks_at_once: walks_at_once.max(1), light: None, samples }
    }

    /// Returns the number of samples per pixel of a tile.
    fn samples_of(&self, tile: u32) -> u32 {
        let own = self.samples.and_then(|s| s.get(tile as usize).copied());
        own.unwrap_or(self.scene.settings.spp)
    }

    /// Returns true if at least one slice separates light by path label.
    pub(super) fn labelled(&self) -> bool {
        self.plans.iter().any(SlicePlan::needs_labels)
    }

    /// Returns the slices that sample pixels s' for a camera pixel, with their bands.
    fn selections<'b>(
        &'b self,
        [x, y]: [u32; 2],
        bands: &'b [Vec<u32>],
    ) -> impl Iterator<Item = Selection<'b>> {
        let plans = (0..).zip(self.plans).zip(bands);
        plans.filter_map(move |((slice, plan), band)| {
            let selected = plan.selected()?;
            plan.camera_index(x, y)?;
            let none = matches!(selected, Selected::Band { .. }) && band.is_empty();
            (!none).then_some(Selection { slice, selected, band })
        })
    }

    /// Lists, for each slice that samples an epipolar band, the pixels in the band of a camera pixel. Bands
    /// with too many pixels remain empty.
    fn list_bands(&self, [x, y]: [u32; 2], line: Option<(&Epipolar, EpipolarLine)>, bands: &mut [Vec<u32>]) {
        for (plan, band) in self.plans.iter().zip(bands) {
            let Some(&Selected::Band { half_width_px, most }) = plan.selected() else {
                continue;
            };
            band.clear();
            if let (Some((epipolar, line)), Some(_)) = (line, plan.camera_index(x, y)) {
                epipolar.list_within(line, half_width_px, band);
                if band.len() > most {
                    band.clear();
                }
            }
        }
    }

    fn tile(&self, prepared: &Prepared, tile: u32, accumulator: &mut TileAccumulator, tracer: &mut Tracer) {
        let begun = Instant::now();
        let scene = self.scene;
        let pixels = tiles::pixels(scene, tile);
        let spp = self.samples_of(tile);
        let (columns, rows) = (&pixels.x, &pixels.y);
        accumulator.begin_tile(tile, [columns.start, rows.start], [columns.end, rows.end]);
        let mut bands = vec![Vec::new(); self.plans.len()];
        for (x, y) in rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y))) {
            if !accumulator.begin_pixel(x, y) {
                continue;
            }
            let line = self.epipolar.as_ref().map(|e| (e, e.line(&scene.camera, x, y)));
            self.list_bands([x, y], line, &mut bands);
            accumulator.set_bands(&bands);
            let selections: Vec<Selection> = self.selections([x, y], &bands).collect();
            let wants = Wants { selections: &selections, labels: self.labelled() };
            let mut all = None;
            for pass in prepared.passes(scene, spp) {
                let Pass { count, group, .. } = pass;
                let mut counted = 0;
                for first in (0..count).step_by(BATCH) {
                    let samples = first..(first + BATCH as u32).min(count);
                    let (rays, lists, elements) =
                        tracer.trace(scene, prepared, pass, [x, y], samples.clone(), wants);
                    accumulator.tile.record.rays += u64::from(rays);
                    let all_finite = finite(elements);
                    for (sample, list) in samples.zip(lists) {
                        if !all_finite && list.iter().any(|c| !finite(c.of(elements))) {
                            accumulator.tile.record.discarded += 1;
                            continue;
                        }
                        if let Some((e, line)) = line {
                            for c in list.iter_mut().filter(|c| c.pixel != NO_PIXEL) {
                                c.epipolar_px = e.distance_px(line, c.pixel);
                            }
                        }
                        accumulator.add_sample(group.number(sample), list, elements);
                        counted += 1;
                    }
                }
                let counted = Counted { samples: counted, groups: counted.min(count / group.size()) };
                accumulator.end_pass(x, y, counted);
                all.get_or_insert(counted.samples);
            }
            accumulator.tile.record.samples += u64::from(spp);
            accumulator.end_pixel(all.unwrap_or(0));
        }
        accumulator.tile.record.seconds = begun.elapsed().as_secs_f64();
    }
}

impl Cpu<'_> {
    /// Renders tiles in any order and on any threads, and passes each finished tile to `take`. No further
    /// tile is started after `stop` returns true or `take` fails.
    ///
    /// # Errors
    /// Returns the error of `take` if `take` fails.
    pub fn render<E: Send>(
        &self,
        tiles: &[u32],
        stop: impl Fn() -> bool + Sync,
        take: impl Fn(&mut TileSums) -> Result<(), E> + Sync,
    ) -> Result<(), E> {
        if tiles.is_empty() {
            return Ok(());
        }
        // Each thread reuses one accumulator and one tracer, because they are large.
        let idle = Mutex::new(Vec::<(TileAccumulator, Tracer)>::new());
        let idle = || idle.lock().unwrap_or_else(PoisonError::into_inner);
        let parts: Vec<&[u32]> = tiles.chunks(tiles_at_once(self.scene, self.walks_at_once)).collect();
        let of = TileParts::new(self.scene, &parts);
        let Some(mut prepared) = Prepared::new(self.scene, &of, self.labelled(), self.light.as_ref(), &stop)
        else {
            return Ok(());
        };
        let passes = prepared.passes(self.scene, self.scene.settings.spp).count();
        for (part, tiles) in parts.into_iter().enumerate() {
            if stop() {
                break;
            }
            prepared.turn_to(self.scene, &of, part);
            let prepared = &prepared;
            tiles
                .par_iter()
                .with_max_len(1)
                .map(|&tile| {
                    if stop() {
                        return Ok(());
                    }
                    let spare = idle().pop();
                    let (mut accumulator, mut tracer) = spare
                        .unwrap_or_else(|| (TileAccumulator::new(self.plans, passes), Tracer::default()));
                    self.tile(prepared, tile, &mut accumulator, &mut tracer);
                    take(&mut accumulator.tile)?;
                    idle().push((accumulator, tracer));
                    Ok(())
                })
                .collect::<Result<(), E>>()?;
        }
        Ok(())
    }
}

/// Returns true if all numbers are finite.
#[inline]
fn finite(elements: &[Spectral]) -> bool {
    let mut sum = Spectral::ZERO;
    for e in elements {
        // The product of zero and a finite number is zero. The product of zero and infinity or NaN is NaN.
        sum += *e * Spectral::ZERO;
    }
    sum.to_array().iter().all(|s| *s == 0.0)
}

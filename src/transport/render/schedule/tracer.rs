//! Samples the paths of a camera pixel. The paths are unidirectional or bidirectional, or both kinds are
//! sampled in turn.

use super::tiles;
use crate::accumulate::Contribution;
use crate::render::bidirectional::{NO_PART, Parts, Plan, SharedLight, Walks, samples};
use crate::render::path::{Batch, Paths, Views, Wants};
use crate::scene::{Integrator, Scene};
use optics::sampling::stream::Group;
use optics::spectrum::Spectral;
use std::ops::Range;

/// The kind of paths that a pass samples.
#[derive(Clone, Copy)]
pub(super) enum PassKind {
    Paths,
    Walks,
}

#[derive(Clone, Copy)]
pub(super) struct Pass {
    pub kind: PassKind,
    /// Number of samples per pixel. `group` is the grouping of the samples for stratification.
    pub count: u32,
    pub group: Group,
}

#[derive(Default)]
pub(super) struct Tracer {
    paths: Paths,
    walks: Walks,
}

/// Precomputed data that a [`Tracer`] needs for one part of the image.
pub(super) struct Prepared {
    paths: Option<Views>,
    walks: Option<Plan>,
}

/// Maximum number of light subpaths whose vertices are kept in memory. An image that needs more subpaths is
/// rendered in parts.
pub(crate) const WALKS_AT_ONCE: u64 = 1 << 22;

/// Returns true if all paths must be bidirectional. Bidirectional paths support all features but are slower
/// than [`Paths`].
fn needs_walks(scene: &Scene) -> bool {
    scene.filled
        || scene.has_lenses()
        || scene.camera.parallel
        || match scene.settings.integrator {
            Integrator::Bidirectional => true,
            Integrator::Caustics => false,
            Integrator::Path | Integrator::Auto => scene.settings.manifold,
        }
}

/// Returns the number of tiles that can be rendered after one preparation.
pub(super) fn tiles_at_once(scene: &Scene, walks_at_once: u64) -> usize {
    let all = tiles::count(scene) as usize;
    if !scene.settings.integrator.walks_from_light() {
        return all;
    }
    let [w, h] = scene.camera.resolution.map(u64::from);
    let walks = w * h * u64::from(samples(scene, scene.settings.spp));
    all.div_ceil(walks.div_ceil(walks_at_once) as usize)
}

/// Maps tiles to parts of the image.
pub(super) struct TileParts {
    of: Vec<u32>,
    count: usize,
}

impl TileParts {
    /// Assigns each tile to the part whose list contains the tile.
    pub fn new(scene: &Scene, parts: &[&[u32]]) -> Self {
        let mut of = vec![NO_PART; tiles::count(scene) as usize];
        for (part, tiles) in (0..).zip(parts) {
            tiles.iter().for_each(|tile| of[*tile as usize] = part);
        }
        Self { of, count: parts.len() }
    }

    fn parts(&self, scene: &Scene) -> Parts<impl Fn(u32) -> u32 + Sync> {
        Parts { count: self.count, of: |pixel| self.of[tiles::of(scene, pixel) as usize] }
    }
}

impl Prepared {
    /// Prepares the rendering of an image in parts. `labelled` is true if slices need path labels. `light`
    /// provides light subpaths that are shared with other machines. Returns `None` if `stop` returns true.
    pub fn new(
        scene: &Scene,
        parts: &TileParts,
        labelled: bool,
        light: Option<&SharedLight>,
        stop: &(impl Fn() -> bool + Sync),
    ) -> Option<Self> {
        let all_by_walks = needs_walks(scene);
        let walks = all_by_walks || scene.settings.integrator == Integrator::Caustics;
        Some(Self {
            paths: (!all_by_walks).then(|| Views::new(scene)),
            walks: if walks {
                Some(Plan::new(scene, &parts.parts(scene), labelled, light, stop)?)
            } else {
                None
            },
        })
    }

    pub fn turn_to(&mut self, scene: &Scene, parts: &TileParts, part: usize) {
        if let Some(plan) = &mut self.walks {
            plan.turn_to(scene, &parts.parts(scene), part);
        }
    }

    /// Returns the passes over each pixel that has `spp` samples. The results of the passes are added.
    pub fn passes(&self, scene: &Scene, spp: u32) -> impl Iterator<Item = Pass> + use<> {
        let paths = self.paths.is_some().then_some(Pass {
            kind: PassKind::Paths,
            count: spp,
            group: Group::of(spp, scene.settings.replicates),
        });
        let count = samples(scene, spp);
        let walks = self.walks.is_some().then_some(Pass {
            kind: PassKind::Walks,
            count,
            group: Group::of(count, scene.settings.replicates),
        });
        paths.into_iter().chain(walks)
    }
}

impl Tracer {
    /// Traces samples of a pixel. Returns the number of rays, the contributions of each sample, and the
    /// Mueller elements of all contributions.
    pub fn trace(
        &mut self,
        scene: &Scene,
        prepared: &Prepared,
        pass: Pass,
        pixel: [u32; 2],
        samples: Range<u32>,
        wants: Wants,
    ) -> (u32, &mut [Vec<Contribution>], &[Spectral]) {
        match (pass.kind, &prepared.paths, &prepared.walks) {
            (PassKind::Paths, Some(views), _) => {
                let batch = Batch { scene, views, pixel, samples, group: pass.group, wants };
                let rays = self.paths.trace(&batch);
                (rays, &mut self.paths.lists, &self.paths.elements)
            }
            (PassKind::Walks, _, Some(plan)) => {
                let rays = self.walks.trace(scene, plan, pixel, samples, pass.group);
                (rays, &mut self.walks.lists, &self.walks.elements)
            }
            // The remaining combinations do not occur, because all passes have been prepared.
            _ => (0, &mut [], &[]),
        }
    }
}

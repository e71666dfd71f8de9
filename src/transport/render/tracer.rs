//! How the paths of a camera pixel are made: plain paths from the camera, or walks where a scene needs more.

use super::bidirectional::{Parts, Plan, Walks};
use super::path::Paths;
use super::spill::NO_PART;
use super::tiles;
use super::views::Views;
use crate::accumulate::Contribution;
use crate::device::pinhole::Pinhole;
use crate::scene::{Integrator, Scene};
use optics::spectrum::Spectral;
use std::ops::Range;

/// Makes the paths of one thread.
pub(super) enum Tracer {
    Paths(Paths),
    Walks(Box<Walks>),
}

/// What [`Tracer`]s work out beforehand, for a part of the image.
pub(super) enum Prepared {
    Paths(Views),
    Walks(Plan),
}

/// Walks from the light of which a part of the image has as many points in memory; more than these and it is rendered in parts.
pub(super) const WALKS_AT_ONCE: u64 = 1 << 22;

/// True if paths must be made by walks: with all that [`Paths`] cannot do, and slower.
fn needs_walks(scene: &Scene) -> bool {
    let lens = |p: &Pinhole| p.lens.radius > 0.0;
    scene.filled
        || scene.settings.manifold
        || scene.settings.integrator == Integrator::Bidirectional
        || lens(&scene.camera)
        || scene.projector.as_ref().is_some_and(|p| lens(&p.pinhole))
}

/// How many tiles are rendered after one preparation.
pub(super) fn tiles_at_once(scene: &Scene, walks_at_once: u64) -> usize {
    let all = tiles::count(scene) as usize;
    if scene.settings.integrator == Integrator::Path {
        return all;
    }
    let [w, h] = scene.camera.resolution.map(u64::from);
    let walks = w * h * u64::from(scene.settings.spp);
    all.div_ceil(walks.div_ceil(walks_at_once) as usize)
}

/// Which part of the image each tile is in.
pub(super) struct TileParts {
    of: Vec<u32>,
    count: usize,
}

impl TileParts {
    /// Of tiles that are rendered part by part.
    pub fn new(scene: &Scene, parts: &[&[u32]]) -> Self {
        let mut of = vec![NO_PART; tiles::count(scene) as usize];
        for (part, tiles) in (0..).zip(parts) {
            tiles.iter().for_each(|tile| of[*tile as usize] = part);
        }
        Self {
            of,
            count: parts.len(),
        }
    }

    fn parts(&self, scene: &Scene) -> Parts<impl Fn(u32) -> u32 + Sync> {
        Parts {
            count: self.count,
            of: |pixel| self.of[tiles::of(scene, pixel) as usize],
        }
    }
}

impl Prepared {
    /// For an image in parts; `None` once `stop` says so.
    pub fn new(scene: &Scene, parts: &TileParts, stop: &impl Fn() -> bool) -> Option<Self> {
        if !needs_walks(scene) {
            return Some(Self::Paths(Views::new(scene)));
        }
        Plan::new(scene, &parts.parts(scene), stop).map(Self::Walks)
    }

    /// Turns to a part.
    pub fn turn_to(&mut self, scene: &Scene, parts: &TileParts, part: usize) {
        if let Self::Walks(plan) = self {
            plan.turn_to(scene, &parts.parts(scene), part);
        }
    }
}

impl Tracer {
    /// Of the kind that was prepared for.
    pub fn new(prepared: &Prepared) -> Self {
        match prepared {
            Prepared::Paths(_) => Self::Paths(Paths::default()),
            Prepared::Walks(_) => Self::Walks(Box::default()),
        }
    }

    /// Traces samples of a camera pixel: the rays that it took, what each sample brings, and all of their elements.
    pub fn trace(
        &mut self,
        scene: &Scene,
        prepared: &Prepared,
        pixel: [u32; 2],
        samples: Range<u32>,
    ) -> (u32, &mut [Vec<Contribution>], &[Spectral]) {
        match (self, prepared) {
            (Self::Paths(paths), Prepared::Paths(views)) => {
                let rays = paths.trace(scene, views, pixel, samples);
                (rays, &mut paths.lists, &paths.elements)
            }
            (Self::Walks(walks), Prepared::Walks(plan)) => {
                let rays = walks.trace(scene, plan, pixel, samples);
                (rays, &mut walks.lists, &walks.elements)
            }
            // Tracers are made for what was prepared.
            _ => (0, &mut [], &[]),
        }
    }
}

//! How the paths of a camera pixel are made: plain paths from the camera, or walks where a scene needs more.

use super::bidirectional::{Plan, Walks};
use super::path::Paths;
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

/// Walks from the light that are kept in mind at once; more than these and the image is rendered in parts.
const WALKS_AT_ONCE: u64 = 1 << 22;

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
pub(super) fn tiles_at_once(scene: &Scene) -> usize {
    let all = tiles::count(scene) as usize;
    if scene.settings.integrator == Integrator::Path {
        return all;
    }
    let [w, h] = scene.camera.resolution.map(u64::from);
    let walks = w * h * u64::from(scene.settings.spp);
    all.div_ceil(walks.div_ceil(WALKS_AT_ONCE) as usize)
}

impl Prepared {
    pub fn new(scene: &Scene, tiles: &[u32]) -> Self {
        if !needs_walks(scene) {
            return Self::Paths(Views::new(scene));
        }
        let mut asked = vec![false; tiles::count(scene) as usize];
        for tile in tiles {
            asked[*tile as usize] = true;
        }
        Self::Walks(Plan::new(scene, |pixel| asked[tiles::of(scene, pixel) as usize]))
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

//! Light subpaths, identified by their numbers. Each subpath depends only on its number and the seed.

use super::{Plan, WalkNumber, Walks, most};
use crate::render::state::From;
use crate::render::subpath::{Ends, First, Limits, Sender, Splitting};
use crate::scene::Scene;
use optics::sampling::stream::Stream;

/// Key that separates the random streams of light subpaths from those of camera samples.
const LIGHT_SEED: u64 = 0x5bd1_e995_9d1b_54a3;

/// A light subpath that has already been traced.
pub(super) struct LightSubpath {
    pub ends: Ends,
    pub sender: Sender,
    /// Random stream of the subpath, positioned after the random numbers that the subpath has used.
    pub stream: Stream,
    pub limits: Limits,
}

impl Walks {
    /// Traces a light subpath, or the first branch of a split subpath, up to vertex `point`. Returns `None`
    /// if the scene has no emitters.
    pub(super) fn light_subpath(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        number: WalkNumber,
        (point, splitting): (usize, Splitting),
    ) -> Option<LightSubpath> {
        self.scratch.seen[1] = None;
        let (setup, seed) = (&plan.setup, plan.seed ^ LIGHT_SEED);
        let mut stream = Stream::new(seed, number.walk, number.sample);
        let ends = Ends::draw(scene, &mut stream);
        let start = setup.emission.start(scene, &ends, spread(seed, number), &mut stream)?;
        let limits = Limits {
            interactions: most(scene),
            point,
            escapes: false,
            labelled: setup.labelled,
            first: if setup.redirected { First::Redirects } else { First::Anything },
            splitting,
        };
        self.light.run(scene, &setup.guide, From::Light, &start.end, &mut stream, limits);
        Some(LightSubpath { ends, sender: start.sender, stream, limits })
    }
}

/// Returns the image point of the projector at which a subpath starts. The points of one sample are spread
/// evenly by the additive recurrence of the plastic number (Roberts 2018). A random shift that is common to
/// all points makes each point uniformly distributed.
#[inline]
fn spread(seed: u64, number: WalkNumber) -> [f32; 2] {
    let mut shift = Stream::new(seed, u32::MAX, number.sample);
    let k = f64::from(number.walk);
    [0.754_877_666_246_692_7, 0.569_840_290_998_053_2].map(|step| {
        let at = (f64::from(shift.uniform()) + k * step).fract() as f32;
        // Rounding to f32 must not give 1.
        at.min(1.0 - f32::EPSILON / 2.0)
    })
}

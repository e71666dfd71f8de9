//! Light tracing: connects vertices of light subpaths to the camera, directly or through interfaces.
//!
//! Visible vertices are found once for a part of the image ([`super::splats`]) and stored as the numbers of
//! the subpath and of the vertex. For the pixel that sees the vertices, the subpaths are traced again.

use super::bidirectional::{Plan, Walks, brings, wanted};
use super::emission::Sender;
use super::join::{Joiner, behind};
use super::join_manifold::Takers;
use super::light_walk::Begun;
use super::manifold::Way;
use super::parting::Parting;
use super::point::Point;
use super::splats::{Splat, WalkNumber};
use crate::accumulate::{Contributions, NO_PIXEL};
use crate::material::Lanes;
use crate::scene::Scene;
use crate::strategy::Strategy;
use glam::Vec3A;

impl Walks {
    /// Traces a light subpath and calls `found` with each vertex that the camera sees. `out` is a buffer.
    pub(super) fn look(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        number: WalkNumber,
        out: &mut Contributions,
        found: &mut dyn FnMut(u32, Splat),
    ) {
        let Some(mut begun) = self.light_walk(scene, plan, number, (usize::MAX, Parting::All)) else {
            return;
        };
        loop {
            self.look_from_branch(scene, plan, (number, &mut begun), out, found);
            if !self.light.next_branch(scene, &plan.setup.guide, begun.limits) {
                break;
            }
        }
    }

    /// Calls `found` as [`Self::look`] does, for the vertices that belong only to the current branch.
    fn look_from_branch(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        (number, begun): (WalkNumber, &mut Begun),
        out: &mut Contributions,
        found: &mut dyn FnMut(u32, Splat),
    ) {
        let Begun { ends, sender, stream, .. } = begun;
        let (sender, lineage) = (*sender, self.light.lineage);
        let mut joiner = Joiner::new(scene, &plan.setup, [ends, ends], &mut self.scratch, stream, out);
        for s in plan.first().max(self.light.fresh + 1)..=self.light.points.len() {
            let light = &self.light.points[..s];
            let point = &light[s - 1];
            if !point.connects(scene) || !wanted(scene, s, 1) {
                continue;
            }
            let mut keep = |joiner: &mut Joiner, pixel, way: Option<(&Way, Takers)>| {
                let Some(factor) = decide(joiner, light, sender, way) else {
                    return;
                };
                let seen = joiner.scratch.seen[1].and_then(|(_, density)| density);
                let (dir, interfaces, lanes) = way.map_or((Vec3A::ZERO, 0, 0), |(way, takers)| {
                    (way.dir, way.count() as u8, takers.lanes.mask)
                });
                let splat = Splat {
                    walk: number,
                    seen: seen.unwrap_or(f32::NAN),
                    factor,
                    dir: dir.to_array(),
                    point: (s - 1) as u16,
                    lineage,
                    interfaces,
                    lanes,
                    unused: [0; 3],
                };
                found(pixel, splat);
            };
            if let Some(mut pixel) = ends.camera.pixel(point.surface.p) {
                if s == 2 && ends.coaxial && sender.pixel != NO_PIXEL {
                    pixel = sender.pixel;
                }
                keep(&mut joiner, pixel, None);
            }
            if plan.setup.strategies.has(Strategy::SmoothInterfaces) {
                joiner.views_by_manifold(light, |joiner, pixel, way, takers| {
                    keep(joiner, pixel, Some((way, takers)));
                });
            }
        }
    }

    /// Connects a vertex of a light subpath to the camera that sees it. Returns the number of rays.
    pub(super) fn splat(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        splat: &Splat,
        out: &mut Contributions,
    ) -> u32 {
        let last = usize::from(splat.point);
        let Some(Begun { ends, sender, mut stream, .. }) =
            self.light_walk(scene, plan, splat.walk, (last, Parting::Follow(splat.lineage)))
        else {
            return 0;
        };
        let Some(light) = self.light.points.get(..=last) else {
            return 0;
        };
        let known = (!splat.seen.is_nan()).then_some(splat.seen);
        self.scratch.seen[1] = behind(light).map(|first| (first, known));
        let mut joiner = Joiner::new(scene, &plan.setup, [&ends, &ends], &mut self.scratch, &mut stream, out);
        if splat.interfaces == 0 {
            joiner.splat(light, sender, splat.factor);
        } else {
            let lanes = Lanes { mask: splat.lanes };
            let (interfaces, lane) = (usize::from(splat.interfaces), lanes.nth(0));
            let dir = Vec3A::from_array(splat.dir);
            if let Some(way) = joiner.known_view(&light[last], dir, interfaces, lane) {
                let takers = Takers { lanes, lane, factor: splat.factor };
                joiner.splat_way(light, sender, &way, takers);
            }
        }
        joiner.rays + self.light.rays
    }
}

/// Decides by roulette whether to keep a vertex of a light subpath that is seen directly or along a
/// specular path. Returns the weight of the vertex. The unweighted contribution is an upper bound of the
/// weighted contribution, which takes longer to compute and is evaluated only for the remaining vertices.
/// To trace the subpath again takes longest.
fn decide(joiner: &mut Joiner, light: &[Point], sender: Sender, way: Option<(&Way, Takers)>) -> Option<f32> {
    let weighs = joiner.weighs;
    let mut factor = way.map_or(1.0, |(_, takers)| takers.factor);
    for weighed in [false, true].into_iter().filter(|weighed| weighs || !weighed) {
        joiner.weighs = weighed;
        match way {
            None => joiner.splat(light, sender, 1.0),
            Some((way, takers)) => {
                let once = Takers { factor: 1.0, ..takers };
                joiner.splat_way(light, sender, way, once);
            }
        }
        joiner.weighs = weighs;
        let brings = brings(&joiner.out);
        joiner.out.list.clear();
        joiner.out.elements.clear();
        // The contribution is zero if the connection is blocked.
        if brings == 0.0 {
            return None;
        }
        factor *= joiner.setup.roulette.spin(brings * factor, joiner.stream)?;
    }
    Some(factor)
}

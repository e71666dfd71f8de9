//! Light tracing: connects vertices of light subpaths to the camera, directly or through interfaces.
//!
//! Vertices that are visible in a part of the image are found once ([`super::splats`]) and stored as a
//! subpath number and a vertex number. To render a pixel, the subpaths of the vertices that the pixel sees
//! are traced again.

use super::light_subpaths::LightSubpath;
use super::{Connector, Plan, Splat, WalkNumber, Walks, behind, brings, wanted};
use crate::accumulate::{Contributions, NO_PIXEL};
use crate::material::Lanes;
use crate::render::manifold::{PathLanes, SpecularPath};
use crate::render::subpath::{Sender, Splitting, Vertex};
use crate::scene::Scene;
use crate::strategy::Strategy;
use glam::Vec3A;

impl Walks {
    /// Traces a light subpath and calls `found` for each vertex that the camera sees. `out` is a buffer.
    pub(super) fn look(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        number: WalkNumber,
        out: &mut Contributions,
        found: &mut dyn FnMut(u32, Splat),
    ) {
        let Some(mut subpath) = self.light_subpath(scene, plan, number, (usize::MAX, Splitting::All)) else {
            return;
        };
        loop {
            self.look_from_branch(scene, plan, (number, &mut subpath), out, found);
            if !self.light.next_branch(scene, &plan.setup.guide, subpath.limits) {
                break;
            }
        }
    }

    /// Calls `found`, as [`Self::look`] does, for the vertices that belong only to the current branch.
    fn look_from_branch(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        (number, subpath): (WalkNumber, &mut LightSubpath),
        out: &mut Contributions,
        found: &mut dyn FnMut(u32, Splat),
    ) {
        let LightSubpath { ends, sender, stream, .. } = subpath;
        let (sender, lineage) = (*sender, self.light.lineage);
        let mut connector = Connector::new(scene, &plan.setup, [ends, ends], &mut self.scratch, stream, out);
        for s in plan.first().max(self.light.fresh + 1)..=self.light.points.len() {
            let light = &self.light.points[..s];
            let point = &light[s - 1];
            if !point.connects(scene) || !wanted(scene, s, 1) {
                continue;
            }
            let mut keep = |connector: &mut Connector, pixel, path: Option<(&SpecularPath, PathLanes)>| {
                let Some(factor) = decide(connector, light, sender, path) else {
                    return;
                };
                let seen = connector.scratch.seen[1].and_then(|(_, density)| density);
                let (dir, interfaces, lanes) = path.map_or((Vec3A::ZERO, 0, 0), |(path, wavelengths)| {
                    (path.dir, path.count() as u8, wavelengths.lanes.mask)
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
                keep(&mut connector, pixel, None);
            }
            if plan.setup.strategies.has(Strategy::SmoothInterfaces) {
                connector.views_by_manifold(light, |connector, pixel, path, wavelengths| {
                    keep(connector, pixel, Some((path, wavelengths)));
                });
            }
        }
    }

    /// Connects a vertex of a light subpath to the camera. Returns the number of traced rays.
    pub(super) fn splat(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        splat: &Splat,
        out: &mut Contributions,
    ) -> u32 {
        let last = usize::from(splat.point);
        let Some(LightSubpath { ends, sender, mut stream, .. }) =
            self.light_subpath(scene, plan, splat.walk, (last, Splitting::Follow(splat.lineage)))
        else {
            return 0;
        };
        let Some(light) = self.light.points.get(..=last) else {
            return 0;
        };
        let known = (!splat.seen.is_nan()).then_some(splat.seen);
        self.scratch.seen[1] = behind(light).map(|first| (first, known));
        let mut connector =
            Connector::new(scene, &plan.setup, [&ends, &ends], &mut self.scratch, &mut stream, out);
        if splat.interfaces == 0 {
            connector.splat(light, sender, splat.factor);
        } else {
            let lanes = Lanes { mask: splat.lanes };
            let (interfaces, lane) = (usize::from(splat.interfaces), lanes.nth(0));
            let dir = Vec3A::from_array(splat.dir);
            if let Some(path) = connector.known_view(&light[last], dir, interfaces, lane) {
                let wavelengths = PathLanes { lanes, lane, factor: splat.factor };
                connector.splat_path(light, sender, &path, wavelengths);
            }
        }
        connector.rays + self.light.rays
    }
}

/// Decides by roulette whether to keep a vertex of a light subpath that the camera sees directly or along a
/// specular path. Returns the weight of the vertex. The decision uses the contribution without MIS weight,
/// which is an upper bound for the contribution with MIS weight. The MIS weight takes longer to compute and
/// is evaluated only for kept vertices. The most expensive step is to trace a subpath again for each kept
/// vertex.
fn decide(
    connector: &mut Connector,
    light: &[Vertex],
    sender: Sender,
    path: Option<(&SpecularPath, PathLanes)>,
) -> Option<f32> {
    let weighs = connector.weighs;
    let mut factor = path.map_or(1.0, |(_, wavelengths)| wavelengths.factor);
    for weighed in [false, true].into_iter().filter(|weighed| weighs || !weighed) {
        connector.weighs = weighed;
        match path {
            None => connector.splat(light, sender, 1.0),
            Some((path, wavelengths)) => {
                let once = PathLanes { factor: 1.0, ..wavelengths };
                connector.splat_path(light, sender, path, once);
            }
        }
        connector.weighs = weighs;
        let brings = brings(&connector.out);
        connector.out.list.clear();
        connector.out.elements.clear();
        // `brings` is zero if the connection is blocked.
        if brings == 0.0 {
            return None;
        }
        factor *= connector.setup.roulette.spin(brings * factor, connector.stream)?;
    }
    Some(factor)
}

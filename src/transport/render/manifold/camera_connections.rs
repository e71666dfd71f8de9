//! Connections of a light subpath to the camera through smooth interfaces ([`manifold`](super)).

use super::{PathLanes, Route};
use crate::render::bidirectional::{Connector, Line, Record, meet, most};
use crate::render::manifold::{self, Goal, SpecularPath};
use crate::render::state::Beam;
use crate::render::subpath::{Sender, Vertex, last};
use crate::render::transmission::Allowed;
use base::units::picoseconds;
use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::polarization::frame::{perpendicular, turn};
use optics::spectrum::Spectral;

impl Connector<'_> {
    /// Searches for specular paths through interfaces from the last vertex of a light subpath to the camera.
    /// Calls `f` with each path, its camera pixel and its wavelengths.
    pub fn views_by_manifold(
        &mut self,
        light: &[Vertex],
        mut f: impl FnMut(&mut Self, u32, &SpecularPath, PathLanes),
    ) {
        let y = last(light);
        let camera = self.ends[0].camera;
        let Some(dir) = (camera.origin - y.surface.p).try_normalize() else {
            return;
        };
        let scattered = y.scatter_flux(self.scene, dir, y.back);
        let density = camera.pixels_per_steradian(-dir) / self.setup.walks as f32;
        let to = camera.origin;
        let Some((start, route, factor)) = self.spin(y, to, scattered, density) else {
            return;
        };
        let scene = self.scene;
        self.for_each_path(
            y,
            |_, lane| Some((manifold::find(scene, start, &route, Goal { to, lane })?, factor)),
            |connector, path, wavelengths| {
                if let Some(pixel) = camera.pixel(path.first) {
                    f(connector, pixel, path, wavelengths);
                }
            },
        );
    }

    /// Returns the specular path along `dir` from a vertex through `interfaces` interfaces to the camera.
    #[inline]
    pub fn known_view(&self, y: &Vertex, dir: Vec3A, interfaces: usize, lane: usize) -> Option<SpecularPath> {
        let to = self.ends[0].camera.origin;
        let route = Route::through(interfaces);
        manifold::along(self.scene, self.straight(y, to)?, &route, dir, Goal { to, lane })
    }

    /// Appends the contribution of a specular path from a light vertex to the camera.
    ///
    /// The path was traced from the vertex, so the matrix K of the path applies to light that travels from
    /// the camera. The matrix for light that travels to the camera is D Kᵀ D with D = diag(1, 1, -1, 1). This
    /// matrix scales radiance by the inverse factor.
    pub fn splat_path(
        &mut self,
        light: &[Vertex],
        sender: Sender,
        path: &SpecularPath,
        wavelengths: PathLanes,
    ) {
        let (scene, camera) = (self.scene, &self.ends[0].camera);
        let y = last(light);
        let interactions = y.interactions + 1 + path.count() as u32;
        let Some(sheets) = most(scene).checked_sub(interactions) else {
            return;
        };
        let (mut whole, mut lobes) = (None, vec![]);
        if self.out.labelled {
            lobes = y.lobes_flux(scene, path.dir, y.back);
        } else {
            whole = y.scatter_flux(scene, path.dir, y.back);
        }
        if whole.is_none() && lobes.is_empty() {
            return;
        }
        let across = perpendicular(path.dir);
        let (mut back, mut frame) = (Chain::start(Spectral::ONE), across);
        let allowed = Allowed { sheets, lane: wavelengths.lane };
        let to = camera.origin;
        let Some(passed) = path.follow(scene, &mut back, &mut frame, to, allowed, &mut self.rays) else {
            return;
        };
        let mut end = self.setup.emission.camera_end(scene, camera, path.emitted);
        // The camera's pinhole is outside all media.
        let factor = wavelengths.factor * end.density
            / (self.setup.walks as f32 * path.spread * path.squared_indices(&passed));
        end.chain.scale(wavelengths.lanes.ones() * Spectral::splat(factor));
        let line = Line {
            dirs: [path.emitted, path.dir],
            passed: 1.0,
            arrivals: [None, Some(path.density(end.density, &passed))],
        };
        let weight = self.weight(&[Vertex::end(scene, &end)], light, sender.source, line);
        let mut chain = end.chain;
        chain.scale(Spectral::splat(weight));
        let (c2, s2) = turn(-path.emitted, frame, end.frame);
        chain.rotate_in(c2, s2);
        chain.times_transposed(&back.mirrored());
        let whole = whole.iter().map(|scatter| (0, scatter));
        for (kind, scatter) in whole.chain(lobes.iter().map(|(kind, s)| (*kind, s))) {
            let mut chain = chain;
            let frame = chain.push(scatter, path.dir, across).unwrap_or_else(|| perpendicular(y.back));
            let record = Record {
                time_ps: picoseconds(y.optical_m + passed.optical_m),
                pixel: sender.pixel,
                interactions: interactions + passed.sheets,
                label: y.label | kind | path.label(),
            };
            let beam = Beam { travel: -y.back, frame };
            meet(chain, beam, y, &record, &mut self.out);
        }
    }
}

//! Connections of a light subpath to the camera through smooth interfaces ([`super::manifold`]).

use super::bridge::Allowed;
use super::emission::Sender;
use super::join::{Joiner, Line, Record, meet, most};
use super::join_manifold::Takers;
use super::manifold::{self, Goal, Way};
use super::point::{Point, last};
use super::route::Route;
use super::state::Beam;
use base::units::picoseconds;
use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::polarization::frame::{perpendicular, turn};
use optics::spectrum::Spectral;

impl Joiner<'_> {
    /// Searches for specular paths through interfaces from the last vertex of a light subpath to the
    /// camera. Calls `f` with each path, its camera pixel and its wavelengths.
    pub fn views_by_manifold(&mut self, light: &[Point], mut f: impl FnMut(&mut Self, u32, &Way, Takers)) {
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
        self.each_way(
            y,
            |_, lane| Some((manifold::find(scene, start, &route, Goal { to, lane })?, factor)),
            |joiner, way, takers| {
                if let Some(pixel) = camera.pixel(way.first) {
                    f(joiner, pixel, way, takers);
                }
            },
        );
    }

    /// Returns the path along `dir` through `interfaces` interfaces from a vertex to the camera.
    #[inline]
    pub fn known_view(&self, y: &Point, dir: Vec3A, interfaces: usize, lane: usize) -> Option<Way> {
        let to = self.ends[0].camera.origin;
        let route = Route::through(interfaces);
        manifold::along(self.scene, self.straight(y, to)?, &route, dir, Goal { to, lane })
    }

    /// Appends the contribution of a specular path from a light vertex to the camera.
    ///
    /// The path was traced from the vertex, so the matrix K of the path is that of light from the camera.
    /// Light to the camera has the matrix D Kᵀ D, with the inverse scaling of radiance.
    pub fn splat_way(&mut self, light: &[Point], sender: Sender, way: &Way, takers: Takers) {
        let (scene, camera) = (self.scene, &self.ends[0].camera);
        let y = last(light);
        let interactions = y.interactions + 1 + way.count() as u32;
        let Some(sheets) = most(scene).checked_sub(interactions) else {
            return;
        };
        let (mut whole, mut lobes) = (None, vec![]);
        if self.out.labelled {
            lobes = y.lobes_flux(scene, way.dir, y.back);
        } else {
            whole = y.scatter_flux(scene, way.dir, y.back);
        }
        if whole.is_none() && lobes.is_empty() {
            return;
        }
        let across = perpendicular(way.dir);
        let (mut back, mut frame) = (Chain::start(Spectral::ONE), across);
        let allowed = Allowed { sheets, lane: takers.lane };
        let to = camera.origin;
        let Some(passed) = way.follow(scene, &mut back, &mut frame, to, allowed, &mut self.rays) else {
            return;
        };
        let mut end = self.setup.emission.camera_end(scene, camera, way.emitted);
        // The camera's pinhole is outside all media.
        let factor = takers.factor * end.density
            / (self.setup.walks as f32 * way.spread * way.squared_indices(&passed));
        end.chain.scale(takers.lanes.ones() * Spectral::splat(factor));
        let line = Line {
            dirs: [way.emitted, way.dir],
            passed: 1.0,
            arrivals: [None, Some(way.density(end.density, &passed))],
        };
        let weight = self.weight(&[Point::end(scene, &end)], light, sender.source, line);
        let mut chain = end.chain;
        chain.scale(Spectral::splat(weight));
        let (c2, s2) = turn(-way.emitted, frame, end.frame);
        chain.rotate_in(c2, s2);
        chain.times_transposed(&back.mirrored());
        let whole = whole.iter().map(|scatter| (0, scatter));
        for (kind, scatter) in whole.chain(lobes.iter().map(|(kind, s)| (*kind, s))) {
            let mut chain = chain;
            let frame = chain.push(scatter, way.dir, across).unwrap_or_else(|| perpendicular(y.back));
            let record = Record {
                time_ps: picoseconds(y.optical_m + passed.optical_m),
                pixel: sender.pixel,
                interactions: interactions + passed.sheets,
                label: y.label | kind | way.label(),
            };
            let beam = Beam { travel: -y.back, frame };
            meet(chain, beam, y, &record, &mut self.out);
        }
    }
}

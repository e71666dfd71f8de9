//! Connections of camera subpaths to area lights, the sky and directional lights ([`crate::light`]).
//!
//! Light subpaths do not start at these emitters. Each path is therefore sampled by at most two techniques,
//! which are a connection and a hit on the emitter ([`crate::render::emitter_hits`]).

use super::Connector;
use crate::accumulate::NO_PIXEL;
use crate::geometry::ray::Ray;
use crate::light::{Drawn, share};
use crate::material::Filling;
use crate::medium::nesting::Nest;
use crate::render::state::From;
use crate::render::subpath::{End, Sender, Vertex, last};
use optics::polarization::chain::Chain;
use optics::spectrum::Spectral;

impl Connector<'_> {
    /// Connects the last vertex of a camera subpath to all directional lights and to one sampled light.
    pub fn connect_lights(&mut self, camera: &[Vertex]) {
        let (scene, guide, point) = (self.scene, &self.setup.guide, last(camera));
        let p = point.surface.p;
        let [u, v] = self.stream.uniform2();
        let mut choice = [self.scene.lights.begin(self.stream.uniform())];
        let lights = &scene.lights;
        let distant = lights.distant.iter().filter_map(|d| d.toward(p, scene.far));
        let at = point.receiver(scene);
        lights.choose(&[at], &mut choice);
        let drawn = lights.draw(&scene.materials.textures, &at, &choice[0], [u, v], scene.far);
        let weighs = std::mem::replace(&mut self.weighs, false);
        for drawn in distant.chain(drawn) {
            let share = if drawn.density > 0.0 {
                share(drawn.density, point.density(scene, guide, From::Camera, point.back, drawn.wi))
            } else {
                1.0
            };
            self.connect_drawn(camera, &drawn, share);
        }
        self.weighs = weighs;
    }

    fn connect_drawn(&mut self, camera: &[Vertex], drawn: &Drawn, share: f32) {
        let dir = -drawn.wi;
        // The factor compensates for the division by the squared distance along the connection.
        let intensity = share * drawn.distance * drawn.distance;
        let mut chain = Chain::start(drawn.irradiance * Spectral::splat(intensity));
        let frame = drawn.polarized.begin(&mut chain, dir);
        let end = End {
            ray: Ray { origin: drawn.position, dir },
            chain,
            frame,
            density: 0.0,
            // The field `filling` is unused, because connections are traced from the side of the camera.
            filling: Filling::VACUUM,
            nest: Nest::default(),
        };
        let mut emitter = Vertex::end(self.scene, &end);
        emitter.optical_m = drawn.start_m;
        let sender = Sender { source: 0, pixel: NO_PIXEL };
        self.connect(camera, &[emitter], sender, None);
    }
}

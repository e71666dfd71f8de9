//! Next-event estimation from inside a medium through rough interfaces.
//!
//! Light inside a solid medium that will leave toward a pinhole travels within a narrow cone. A rough
//! interface with index n deflects outgoing light n times as much as incoming light. Facets within an angle α
//! of the normal therefore refract only light from a cone with a half angle of about α/3. The cone contains
//! at most a hundredth of all directions. A subpath that samples the phase function rarely enters this cone.
//! A subpath that does enter the cone contributes a hundred times the mean.
//!
//! At a medium vertex near the surface, a direction is therefore sampled from the directions into which the
//! interface refracts light of the emitter. Facets visible from the emitter are sampled at the point where
//! the straight line to the emitter leaves the medium. The path then continues along the sampled direction to
//! the surface. From the surface, the path continues in a straight line to the emitter. The balance heuristic
//! (Veach 1997, sect. 9.2) combines the two estimates of a path. Let p be the density of the subpath (phase
//! function × transmittance) and q the density of the sampled direction. The densities are per steradian at
//! the medium vertex. The two estimates are
//!
//! > f/p · p/(p + q) and f/q · q/(p + q).
//!
//! For smooth interfaces, the cone is a single direction, which [`crate::render::manifold`] finds.

use super::Connector;
use crate::geometry::ray::{Ray, Surface};
use crate::render::state::{From, State};
use crate::render::subpath::{Flight, Hero, Landing, Sender, Site, Vertex, last, mean_transmittance};
use crate::render::transmission::has_no_effect;
use crate::scene::Scene;
use glam::Vec3A;
use optics::spectrum::Spectral;
use tensor::label;

/// Maximum optical depth to the surface. At larger depths, the little light that remains is sampled by
/// subpaths.
const REACH: f32 = 5.0;

/// The exit, which is the point where the straight line from a medium vertex to an emitter leaves the medium.
struct Exit {
    surface: Surface,
    /// Unit direction from the exit to the emitter.
    out: Vec3A,
}

impl Exit {
    /// Finds the exit for vertex `z` in medium `id` and an emitter at `to`. Returns `None` if no rough
    /// interface is within the optical depth [`REACH`].
    fn find(scene: &Scene, id: u32, z: &Vertex, to: Vec3A) -> Option<Self> {
        let p = z.surface.p;
        let dir = (to - p).try_normalize()?;
        let clearest = scene.media.clearest(id, scene.wavelengths.count());
        let ray = Ray { origin: p, dir };
        let hit = scene.geometry.intersect(&ray, REACH / clearest)?;
        let surface = scene.geometry.surface(&ray, &hit);
        // Surfaces inside an object of higher priority have no effect.
        let noticed = !has_no_effect(scene, &z.nest, surface.material);
        if !(noticed && scene.materials.is_rough_interface(surface.material)) {
            return None;
        }
        let out = (to - surface.p).try_normalize()?;
        // The line must leave the medium.
        (surface.ng.dot(out) > 0.0).then_some(Self { surface, out })
    }

    /// Returns the density per steradian with which the direction `wi` in the medium is sampled.
    fn density(&self, scene: &Scene, wi: Vec3A) -> f32 {
        if self.surface.ng.dot(wi) >= 0.0 {
            return 0.0;
        }
        let s = &self.surface;
        scene.materials.pdf(s.material, s, self.out, wi)
    }
}

/// Returns true if `to` is outside the surface at vertex `y`, and the path reaches `y` from inside.
fn leaves(y: &Vertex, to: Vec3A) -> bool {
    y.surface.ng.dot(to - y.surface.p) > 0.0 && y.surface.ng.dot(y.back) < 0.0
}

/// Returns the density per steradian with which a subpath from vertex `z` in medium `id` reaches vertex `y`.
fn walks(connector: &Connector, z: &Vertex, id: u32, y: &Vertex) -> f32 {
    let scene = connector.scene;
    let to = y.surface.p - z.surface.p;
    let ray = Ray { origin: z.surface.p, dir: to.normalize_or(Vec3A::Z) };
    let depth = scene.media.depth(id, &ray, to.length());
    let density = z.density(scene, &connector.setup.guide, From::Camera, z.back, -y.back);
    density * mean_transmittance(scene, depth)
}

impl Connector<'_> {
    /// Returns the MIS weight of a subpath on which vertex `y` follows vertex `z` and receives light from an
    /// emitter at `to`.
    pub fn share_of_walk(&mut self, z: &Vertex, y: &Vertex, to: Vec3A) -> f32 {
        let (Site::Volume(id), Site::Surface) = (z.site, y.site) else {
            return 1.0;
        };
        if !leaves(y, to) {
            return 1.0;
        }
        self.rays += 1;
        let drawn = Exit::find(self.scene, id, z, to).map_or(0.0, |exit| exit.density(self.scene, y.back));
        if drawn == 0.0 {
            return 1.0;
        }
        let own = walks(self, z, id, y);
        own / (own + drawn)
    }

    /// Connects a medium vertex at the end of a camera subpath to all emitters through a nearby rough
    /// interface, and appends the contributions. Returns true if a rough interface is between the vertex and
    /// each emitter.
    pub fn connect_through_rough(&mut self, camera: &[Vertex]) -> bool {
        let (scene, emission) = (self.scene, &self.setup.emission);
        let z = last(camera);
        let Site::Volume(id) = z.site else {
            return false;
        };
        let mut all = true;
        for source in 0..emission.count() {
            let to = emission.position(scene, self.ends[0], source);
            self.rays += 1;
            match Exit::find(scene, id, z, to) {
                Some(exit) => self.connect_by(&exit, z, id, source),
                None => all = false,
            }
        }
        all
    }

    /// Connects a vertex in medium `id` to one emitter.
    fn connect_by(&mut self, exit: &Exit, z: &Vertex, id: u32, source: usize) {
        let (scene, emission) = (self.scene, &self.setup.emission);
        let (s, mut lanes) = (&exit.surface, scene.lanes());
        let Some(drawn) = scene.materials.sample(s.material, s, exit.out, &mut lanes, self.stream) else {
            return;
        };
        let density = exit.density(scene, drawn.wi);
        if drawn.delta || density <= 0.0 {
            return;
        }
        let dir = -drawn.wi;
        let Some(y) = self.fly(z, id, dir) else {
            return;
        };
        let Some(pixel) = emission.pixel(scene, self.ends[0], source, y.surface.p) else {
            return;
        };
        let Some(mut emitter) = emission.emitter(scene, self.ends[0], source, y.surface.p) else {
            return;
        };
        if !leaves(&y, emitter.surface.p) {
            return;
        }
        let own = walks(self, z, id, &y);
        emitter.chain.scale(Spectral::splat(1.0 / (own + density)));
        self.connect(&[y], &[emitter], Sender { source, pixel }, None);
    }

    /// Traces a straight line from a medium vertex to the next surface that affects light.
    fn fly(&mut self, z: &Vertex, id: u32, dir: Vec3A) -> Option<Vertex> {
        let scene = self.scene;
        let came = Ray { origin: z.surface.p, dir: -z.back };
        let mut flight = Flight {
            state: State {
                ray: came,
                from: z.at,
                chain: z.chain,
                frame: z.frame,
                optical_m: z.optical_m,
                filling: z.filling,
                lanes: z.lanes,
                label: z.label | label::MEDIUM,
            },
            end: From::Camera,
            depth: Spectral::ZERO,
            nest: z.nest,
            hero: Hero::only(z.lanes),
            draws: false,
        };
        flight.push(&scene.media.eval(id, z.back, dir));
        flight.state.ray.dir = dir;
        flight.settle();
        match flight.fly(scene, self.stream, &mut self.rays) {
            Landing::At(Site::Surface, surface, _) => {
                Some(flight.landed(Site::Surface, surface, z.interactions + 1))
            }
            _ => None,
        }
    }
}

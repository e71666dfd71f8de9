//! A random walk through surfaces and media, from the camera or from an emitter.
//!
//! A walk leaves points behind that those of another walk can be connected to. At each it keeps the Mueller product from
//! its end: from the camera C = M₁ M₂ ⋯, from an emitter the transpose of L = ⋯ M₂ M₁, which grows on the same side, so
//! that a whole path is C · L and both walks are made by the same steps. Interactions at a point are not in its product.
//!
//! Densities are per area (per volume in media) up to the medium's own μ_t at either point, which is the same factor from
//! both sides. They are functions of the path alone, not of the wavelengths that a walk still carries, so that weights
//! made of them sum to one.

use super::bridge::{Start, filling};
use super::path::crossed;
use crate::geometry::ray::{Ray, Surface};
use crate::material::{Lanes, Medium, NO_CRYSTAL};
use crate::medium::nesting::Nest;
use crate::polarization::chain::{Chain, Scatter};
use crate::polarization::frame::perpendicular;
use crate::sampling::stream::Stream;
use crate::scene::Scene;
use crate::spectrum::Spectral;
use glam::Vec3A;

/// Which end a walk starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum From {
    Camera,
    Light,
}

/// A walk's end: a point without extent, and what leaves it.
#[derive(Clone, Copy)]
pub(super) struct End {
    pub ray: Ray,
    pub chain: Chain,
    pub frame: Vec3A,
    /// Density of the ray's direction per steradian.
    pub density: f32,
    pub medium: Medium,
    pub nest: Nest,
}

/// Where a point of a walk is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// At the walk's end.
    Pinhole,
    Surface,
    /// Inside the medium of this number.
    Volume(u32),
}

/// A point of a walk.
#[derive(Clone, Copy)]
pub(super) struct Point {
    pub place: Place,
    /// Of a volume or an end, its position alone counts.
    pub surface: Surface,
    /// Unit direction to the point before.
    pub back: Vec3A,
    /// Mueller product from the walk's end to the light that arrives here, and that light's frame.
    pub chain: Chain,
    pub frame: Vec3A,
    /// Optical path length from the walk's end, metres.
    pub optical_m: f64,
    /// What is on the side of `back`.
    pub medium: Medium,
    pub nest: Nest,
    pub lanes: Lanes,
    /// Interactions before this one.
    pub interactions: u32,
    /// True if the walk went on by a delta lobe.
    pub delta: bool,
    /// Density with which the walk came here, and with which one the other way would have come from the next point.
    pub forward: f32,
    pub reverse: f32,
    /// What turns a density of the direction `back` into one at the point before.
    pub spread: f32,
}

/// A walk's points, its end first.
#[derive(Default)]
pub(super) struct Walk {
    pub points: Vec<Point>,
    /// What is left of it where nothing was hit: the direction, product, frame and number of interactions.
    pub escape: Option<(Vec3A, Chain, Vec3A, u32)>,
    /// Rays traced.
    pub rays: u32,
}

/// The state of a walk between two points.
struct Flight {
    ray: Ray,
    /// Where the ray really starts.
    from: Vec3A,
    chain: Chain,
    frame: Vec3A,
    optical_m: f64,
    /// Optical depth since the last point.
    depth: Spectral,
    medium: Medium,
    nest: Nest,
    lanes: Lanes,
    hero: Hero,
}

/// The wavelength that draws all distances and directions of a walk in media, and how likely each living one would have
/// drawn the same, relative to each other.
///
/// Weights are over the mean density of all living wavelengths of the *whole* walk (Wilkie et al. 2014, "Hero wavelength
/// spectral sampling"). Means event by event would let them grow with the number of events.
struct Hero {
    lane: usize,
    likely: Spectral,
}

impl Hero {
    /// Any of the living lanes.
    fn draw(lanes: Lanes, stream: &mut Stream) -> Self {
        let alive = lanes.count().max(1);
        let lane = lanes.nth(((stream.uniform() * alive as f32) as u32).min(alive - 1));
        Self {
            lane,
            likely: lanes.ones(),
        }
    }

    /// A dispersive interface leaves one lane.
    fn only(lanes: Lanes) -> Self {
        Self {
            lane: lanes.nth(0),
            likely: lanes.ones(),
        }
    }

    /// Takes on that an event has happened whose density is `densities` by lane; returns what to divide by, `None` where the
    /// event is too unlikely for numbers.
    fn event(&mut self, densities: Spectral) -> Option<f32> {
        let sum = |s: Spectral| s.to_array().iter().sum::<f32>();
        let all = sum(self.likely);
        self.likely *= densities;
        let now = sum(self.likely);
        if !(now > 0.0 && now.is_finite()) {
            return None;
        }
        // Kept near 1: only ratios count.
        self.likely *= Spectral::splat(1.0 / now);
        Some(now / all)
    }
}

/// What ends a flight.
enum Landing {
    At(Place, Surface),
    Escaped,
    Absorbed,
}

/// The mean transmittance over all of the scene's wavelengths.
#[inline]
pub(super) fn mean_transmittance(scene: &Scene, depth: Spectral) -> f32 {
    if depth == Spectral::ZERO {
        return 1.0;
    }
    let passed = (-depth).exp() * scene.wavelengths.ones();
    passed.to_array().iter().sum::<f32>() / scene.wavelengths.count() as f32
}

impl Point {
    /// A walk's end. Its density is that of the direction in which the walk starts.
    pub fn end(scene: &Scene, end: &End) -> Self {
        let p = end.ray.origin;
        Self {
            place: Place::Pinhole,
            surface: Surface {
                p,
                ..Surface::default()
            },
            back: -end.ray.dir,
            chain: end.chain,
            frame: end.frame,
            optical_m: 0.0,
            medium: end.medium,
            nest: end.nest,
            lanes: Lanes::first(scene.wavelengths.count()),
            interactions: 0,
            delta: false,
            forward: end.density,
            reverse: 0.0,
            spread: 0.0,
        }
    }

    /// The light that leaves along `wo` of that which comes from `wi`, both away from the point.
    ///
    /// On surfaces it is the Mueller BSDF times |cosθ_i|, in media the phase function.
    pub fn scatter(&self, scene: &Scene, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        match self.place {
            Place::Surface => scene.materials.eval(self.surface.material, &self.surface, wo, wi),
            Place::Volume(id) => Some(scene.media.eval(id, wo, wi)),
            Place::Pinhole => None,
        }
    }

    /// The intensity that leaves along `wo` per flux that arrives from `wi`.
    pub fn scatter_flux(&self, scene: &Scene, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let scatter = self.scatter(scene, wo, wi)?;
        if self.place != Place::Surface {
            return Some(scatter);
        }
        // Shading normals may light a point from where its true surface is grazed.
        let cos = self.cosine(wi);
        (cos > 0.0).then(|| scatter.scaled(Spectral::splat(self.cosine(wo) / cos)))
    }

    /// Density per steradian with which a walk that came from direction `from` goes on along `to`.
    pub fn density(&self, scene: &Scene, from: Vec3A, to: Vec3A) -> f32 {
        match self.place {
            Place::Surface => scene
                .materials
                .pdf(self.surface.material, &self.surface, from, to),
            Place::Volume(id) => {
                let all = Lanes::first(scene.wavelengths.count());
                scene.media.pdf(id, all, from, to)
            }
            Place::Pinhole => 0.0,
        }
    }

    /// Area that the point shows along a unit direction, per area.
    pub fn cosine(&self, dir: Vec3A) -> f32 {
        match self.place {
            Place::Surface => self.surface.ng.dot(dir).abs(),
            _ => 1.0,
        }
    }

    /// True if light can come here from, or go to, any point.
    pub fn connects(&self, scene: &Scene) -> bool {
        match self.place {
            Place::Surface => scene.materials.is_smooth(self.surface.material),
            _ => true,
        }
    }

    /// A ray's origin toward `dir` off the surface.
    pub fn leave(&self, scene: &Scene, dir: Vec3A) -> Vec3A {
        match self.place {
            Place::Surface => scene.geometry.leave(&self.surface, dir),
            _ => self.surface.p,
        }
    }

    /// The start of a line along `dir`.
    pub fn line(&self, scene: &Scene, dir: Vec3A) -> Start {
        let (mut medium, mut nest) = (self.medium, self.nest);
        let s = &self.surface;
        if self.place == Place::Surface && s.ng.dot(self.back) * s.ng.dot(dir) < 0.0 {
            nest.cross(&scene.boundaries, s.material, s.ng.dot(dir) < 0.0);
            let beyond = scene.materials.beyond(s.material, s, self.back, self.lanes);
            medium = beyond.unwrap_or(medium);
        }
        let origin = self.leave(scene, dir);
        Start {
            ray: Ray { origin, dir },
            from: s.p,
            medium,
            nest,
        }
    }
}

impl Flight {
    /// Lets the medium act on the light along the way to a surface.
    fn cross(&mut self, scene: &Scene, from: From, surface: &Surface) {
        if self.medium.crystal == NO_CRYSTAL {
            return;
        }
        if let Some(act) = crossed(scene, self.medium, self.ray.dir, self.from, surface) {
            self.push(&act, from);
        }
    }

    /// Takes on what happens to the light that runs along the ray: an interaction in its true direction.
    fn push(&mut self, scatter: &Scatter, from: From) {
        let next = match from {
            From::Camera => self.chain.push(scatter, -self.ray.dir, self.frame),
            From::Light => self.chain.push(&scatter.transposed(), self.ray.dir, self.frame),
        };
        self.frame = next.unwrap_or(Vec3A::ZERO);
    }

    /// A frame for the ray, where what it met left it open.
    fn settle(&mut self) {
        if self.frame == Vec3A::ZERO {
            self.frame = perpendicular(self.ray.dir);
        }
    }

    /// Flies on to the next thing that happens.
    fn fly(&mut self, scene: &Scene, from: From, stream: &mut Stream, rays: &mut u32) -> Landing {
        loop {
            *rays += 1;
            let hit = scene.geometry.intersect(&self.ray, f32::INFINITY);
            let surface = hit.map(|hit| scene.geometry.surface(&self.ray, &hit));
            let way = surface.map_or(f32::INFINITY, |s| (s.p - self.from).length());
            if let Some(id) = self.nest.medium(&scene.boundaries)
                && let Some(landing) = self.through(scene, id, way, stream)
            {
                return landing;
            }
            let Some(surface) = surface else {
                return Landing::Escaped;
            };
            self.optical_m += f64::from(self.medium.index) * f64::from(way);
            self.cross(scene, from, &surface);
            self.settle();
            let id = surface.material;
            if !scene.materials.is_null(id) && !self.nest.hides(&scene.boundaries, id) {
                return Landing::At(Place::Surface, surface);
            }
            let before = self.nest.medium(&scene.boundaries);
            let enters = surface.ng.dot(self.ray.dir) < 0.0;
            self.nest.cross(&scene.boundaries, id, enters);
            if self.nest.medium(&scene.boundaries) != before {
                self.medium = filling(scene, &self.nest, self.lanes.nth(0));
            }
            self.from = surface.p;
            self.ray.origin = scene.geometry.leave(&surface, self.ray.dir);
        }
    }

    /// Goes `way` metres through a medium, or less if the light is scattered or absorbed there.
    ///
    /// The hero wavelength draws the distance.
    fn through(&mut self, scene: &Scene, id: u32, way: f32, stream: &mut Stream) -> Option<Landing> {
        let medium = &scene.media.list[id as usize];
        let extinction = medium.absorption + medium.scattering;
        let passed = |length: f32| {
            let depth = extinction * Spectral::splat(length);
            // Infinite ways through lanes that are clear.
            extinction.simd_eq(Spectral::ZERO).select(Spectral::ZERO, depth)
        };
        if medium.scattering == Spectral::ZERO {
            self.depth += passed(way);
            self.chain.scale((-passed(way)).exp());
            return None;
        }
        // Never 0.
        let u = 1.0 - stream.uniform();
        let length = -u.ln() / extinction.to_array()[self.hero.lane];
        if length < way {
            let depth = passed(length);
            let transmittance = (-depth).exp();
            let Some(density) = self.hero.event(extinction * transmittance) else {
                return Some(Landing::Absorbed);
            };
            self.chain
                .scale(medium.scattering * transmittance * Spectral::splat(1.0 / density));
            self.depth += depth;
            self.optical_m += f64::from(self.medium.index) * f64::from(length);
            let p = self.from + self.ray.dir * length;
            return Some(Landing::At(
                Place::Volume(id),
                Surface {
                    p,
                    ..Surface::default()
                },
            ));
        }
        let depth = passed(way);
        let transmittance = (-depth).exp();
        let Some(chance) = self.hero.event(transmittance) else {
            return Some(Landing::Absorbed);
        };
        self.chain.scale(transmittance * Spectral::splat(1.0 / chance));
        self.depth += depth;
        None
    }
}

/// Where a walk goes on.
struct Onward {
    wi: Vec3A,
    /// In the true direction of the light; divided by the density and, for light, per flux.
    scatter: Scatter,
    delta: bool,
    medium: Option<Medium>,
}

/// Samples where a walk that came from direction `back` to a surface goes on.
fn onward(
    scene: &Scene,
    from: From,
    s: &Surface,
    back: Vec3A,
    lanes: &mut Lanes,
    stream: &mut Stream,
) -> Option<Onward> {
    let (materials, id, before) = (&scene.materials, s.material, *lanes);
    let sampled = materials.sample(id, s, back, lanes, stream)?;
    let mut onward = Onward {
        wi: sampled.wi,
        scatter: sampled.scatter,
        delta: sampled.delta,
        medium: sampled.medium,
    };
    if from == From::Camera {
        return Some(onward);
    }
    // The other way through the surface.
    let (cos_in, cos_out) = (s.ng.dot(back).abs(), s.ng.dot(sampled.wi).abs());
    if cos_in <= 0.0 {
        return None;
    }
    let all = before.count() as usize == scene.wavelengths.count();
    if !sampled.delta && (all || sampled.medium.is_none()) {
        *lanes = before;
        let density = materials.pdf(id, s, back, sampled.wi);
        if density <= 0.0 {
            return None;
        }
        let factor = Spectral::splat(cos_out / (cos_in * density));
        onward.scatter = materials.eval(id, s, sampled.wi, back)?.scaled(factor);
        return Some(onward);
    }
    onward.scatter = sampled.scatter.reversed();
    if !sampled.delta {
        // Shading normals are not the same from both sides.
        let (shading_in, shading_out) = (s.ns.dot(back).abs(), s.ns.dot(sampled.wi).abs());
        let factor = shading_in * cos_out / (cos_in * shading_out).max(f32::MIN_POSITIVE);
        onward.scatter = onward.scatter.scaled(Spectral::splat(factor));
    }
    if let Some(far) = sampled.medium
        && !materials.is_crystal(id)
        && let Some(near) = materials.beyond(id, s, sampled.wi, *lanes)
    {
        // Radiance grows with the squared index, flux does not. (Light never stops inside a crystal.)
        let ratio = far.index / near.index;
        onward.scatter = onward.scatter.scaled(Spectral::splat(ratio * ratio));
    }
    Some(onward)
}

impl Walk {
    /// Walks from an end through at most `most` interactions; with `escapes` it goes on after the last of them to see
    /// whether it leaves the scene.
    pub fn run(
        &mut self,
        scene: &Scene,
        from: From,
        end: &End,
        stream: &mut Stream,
        (most, escapes): (u32, bool),
    ) {
        self.points.clear();
        self.escape = None;
        self.rays = 0;
        let all = Lanes::first(scene.wavelengths.count());
        let mut flight = Flight {
            ray: end.ray,
            from: end.ray.origin,
            chain: end.chain,
            frame: end.frame,
            optical_m: 0.0,
            depth: Spectral::ZERO,
            medium: end.medium,
            nest: end.nest,
            lanes: all,
            hero: if scene.filled {
                Hero::draw(all, stream)
            } else {
                Hero::only(all)
            },
        };
        let full = end.chain.max_m00();
        self.points.push(Point::end(scene, end));
        let (mut interactions, mut density) = (0, end.density);
        loop {
            let (place, surface) = match flight.fly(scene, from, stream, &mut self.rays) {
                Landing::At(place, surface) => (place, surface),
                Landing::Escaped => {
                    self.escape = Some((flight.ray.dir, flight.chain, flight.frame, interactions));
                    return;
                }
                Landing::Absorbed => return,
            };
            if interactions >= most {
                return;
            }
            let back = -flight.ray.dir;
            let (lanes, arrived, frame) = (flight.lanes, flight.chain, flight.frame);
            let mut next = None;
            if place == Place::Surface {
                let mut lanes = flight.lanes;
                next = onward(scene, from, &surface, back, &mut lanes, stream);
                if let Some(n) = &next {
                    if lanes != flight.lanes {
                        flight.hero = Hero::only(lanes);
                    }
                    flight.lanes = lanes;
                    flight.push(&n.scatter, from);
                    if scene.sheets && n.delta && n.wi == -back && n.medium.is_none() {
                        // Straight through a sheet: no point of its own, as on a line between points.
                        flight.settle();
                        interactions += 1;
                        flight.from = surface.p;
                        flight.ray.origin = scene.geometry.leave(&surface, flight.ray.dir);
                        continue;
                    }
                }
            }
            let Some(k) = self.points.len().checked_sub(1) else {
                return;
            };
            let mut point = Point {
                place,
                surface,
                back,
                chain: arrived,
                frame,
                optical_m: flight.optical_m,
                medium: flight.medium,
                nest: flight.nest,
                lanes,
                interactions,
                delta: false,
                forward: 0.0,
                reverse: 0.0,
                spread: 0.0,
            };
            let to = surface.p - self.points[k].surface.p;
            let distance2 = to.length_squared().max(f32::MIN_POSITIVE);
            let passed = mean_transmittance(scene, flight.depth) / distance2;
            point.forward = density * passed * point.cosine(back);
            point.spread = passed * self.points[k].cosine(back);
            interactions += 1;
            let wi = match (place, next) {
                (Place::Volume(id), _) => {
                    let lane = flight.hero.lane;
                    let (wi, scatter, densities) = scene.media.sample_lane(id, back, lane, stream);
                    let Some(drawn) = flight.hero.event(densities) else {
                        self.points.push(point);
                        return;
                    };
                    // The same from both sides: particles are their own mirror images.
                    flight.push(&scatter.scaled(Spectral::splat(1.0 / drawn)), from);
                    density = all.mean(densities);
                    self.points[k].reverse = density * point.spread;
                    wi
                }
                (_, Some(next)) => {
                    point.delta = next.delta;
                    let mut reverse = 1.0;
                    density = 1.0;
                    if !next.delta {
                        density = point.density(scene, back, next.wi);
                        reverse = point.density(scene, next.wi, back);
                    }
                    self.points[k].reverse = reverse * point.spread;
                    if surface.ng.dot(back) * surface.ng.dot(next.wi) < 0.0 {
                        let enters = surface.ng.dot(next.wi) < 0.0;
                        flight.nest.cross(&scene.boundaries, surface.material, enters);
                    }
                    flight.medium = next.medium.unwrap_or(flight.medium);
                    next.wi
                }
                (_, None) => {
                    self.points.push(point);
                    return;
                }
            };
            self.points.push(point);
            if interactions >= most && !escapes {
                return;
            }
            if interactions >= scene.settings.rr_depth {
                let keep = (flight.chain.max_m00() / full).clamp(0.0, 0.95);
                if stream.uniform() >= keep {
                    return;
                }
                flight.chain.scale(Spectral::splat(1.0 / keep));
            } else if flight.chain.is_dark() {
                return;
            }
            flight.from = surface.p;
            let origin = point.leave(scene, wi);
            flight.ray = Ray { origin, dir: wi };
            flight.settle();
            flight.depth = Spectral::ZERO;
        }
    }
}

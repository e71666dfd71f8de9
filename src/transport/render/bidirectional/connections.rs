//! Connections between camera subpaths and light subpaths, and the MIS weights of these connections.

use super::mis::{Densities, Tries, power_heuristic};
use crate::accumulate::Contributions;
use crate::geometry::rounding::END_GAP;
use crate::material::NO_CRYSTAL;
use crate::render::manifold::Mirrors;
use crate::render::roulette::Roulette;
use crate::render::state::{Beam, From};
use crate::render::subpath::{Emission, Ends, Guide, Sender, Site, Vertex, last, mean_transmittance};
use crate::render::transmission::{Allowed, End, Start, trace_line};
use crate::scene::Scene;
use crate::strategy::Strategies;
use arrayvec::ArrayVec;
use base::units::picoseconds;
use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::polarization::frame::{perpendicular, turn};
use optics::sampling::stream::Stream;
use optics::spectrum::{Spectral, max_lane};

/// The data shared by all connections of a render.
pub(crate) struct Setup {
    pub emission: Emission,
    /// True if only redirected light is sampled ([`super`]). In this case, a camera subpath ends at its first
    /// surface if this surface is Lambertian.
    pub redirected: bool,
    /// Number of light subpaths per sample.
    pub walks: u32,
    /// Fraction of samples in which vertices of the camera subpath are connected to vertices of the light
    /// subpath.
    pub connections: f32,
    pub strategies: Strategies,
    /// Mirrors for which reflected paths to emitters are searched.
    pub mirrors: Mirrors,
    /// Targets of guided scattering in media.
    pub guide: Guide,
    pub roulette: Roulette,
    /// True if at least one slice separates light by path label.
    pub labelled: bool,
}

/// The first vertex at which connections can end, for a subpath that starts with interfaces. The pair
/// contains the index of this vertex and the density per perpendicular area with which subpaths reach the
/// vertex. The density is `None` if the path through the interfaces cannot be found from the vertex.
pub(super) type Seen = Option<(usize, Option<f32>)>;

/// Buffers that a thread reuses for all connections.
#[derive(Default)]
pub(crate) struct Scratch {
    /// Sampling densities of the vertices of the current camera subpath and light subpath.
    densities: [Vec<Densities>; 2],
    pub seen: [Seen; 2],
}

/// Returns the maximum number of interactions on a path.
#[inline]
pub(crate) fn most(scene: &Scene) -> u32 {
    scene.settings.max_depth - 1
}

/// The line between the last vertices of two subpaths.
pub(crate) struct Line {
    /// Unit directions of the line from the camera vertex and from the light vertex.
    pub dirs: [Vec3A; 2],
    /// Transmittance along the line, averaged over wavelengths and divided by the squared length, 1/m².
    pub passed: f32,
    /// Densities, per perpendicular area, with which the opposite subpath reaches the camera vertex and the
    /// light vertex. The densities are set only for a refracted or reflected line.
    pub arrivals: [Option<f32>; 2],
}

impl Line {
    #[inline]
    fn straight(dir: Vec3A, passed: f32) -> Self {
        Self { dirs: [dir, -dir], passed, arrivals: [None; 2] }
    }
}

/// Returns the index of the first vertex of a subpath at which connections can end.
#[inline]
pub(crate) fn behind(walk: &[Vertex]) -> Option<usize> {
    let last = walk.len() - 1;
    (1..=last).find(|i| !walk[*i].delta || *i == last)
}

/// Properties of a path that are not part of the path's Mueller matrix.
pub(crate) struct Record {
    pub time_ps: f64,
    pub pixel: u32,
    pub interactions: u32,
    pub label: u8,
}

/// Multiplies the Mueller product `chain` of the camera subpath by the product of the light vertex `y`, and
/// appends the path to `out`. `chain` acts on light with the direction and frame `beam`.
#[inline]
pub(crate) fn meet(mut chain: Chain, beam: Beam, y: &Vertex, record: &Record, out: &mut Contributions) {
    let (c2, s2) = turn(beam.travel, y.frame, beam.frame);
    chain.rotate_in(c2, s2);
    chain.times_transposed(&y.chain);
    let extent = chain.finish(out.elements);
    out.push(extent, record.time_ps, record.pixel, record.interactions, record.label);
}

/// The properties of an unblocked line.
struct Followed {
    optical_m: f64,
    sheets: u32,
    passed: f32,
}

/// Connects subpaths and appends the contributions.
pub(crate) struct Connector<'a> {
    pub scene: &'a Scene,
    pub setup: &'a Setup,
    /// Possible start vertices of the camera subpath and of the light subpath.
    pub ends: [&'a Ends; 2],
    pub scratch: &'a mut Scratch,
    /// True if connections need MIS weights. False if no other strategy samples the same paths.
    pub weighs: bool,
    pub stream: &'a mut Stream,
    /// The list to which contributions are appended.
    pub out: Contributions<'a>,
    pub rays: u32,
}

impl<'a> Connector<'a> {
    /// Creates a connector for subpaths from the given ends.
    pub fn new(
        scene: &'a Scene,
        setup: &'a Setup,
        ends: [&'a Ends; 2],
        scratch: &'a mut Scratch,
        stream: &'a mut Stream,
        out: &'a mut Contributions,
    ) -> Self {
        Self {
            stream,
            scene,
            setup,
            ends,
            scratch,
            weighs: setup.strategies.walk_from_light() && scene.settings.strategy.is_none(),
            out: Contributions::new(out.list, out.elements, out.labelled),
            rays: 0,
        }
    }

    /// Connects the last vertex of a light subpath to the camera, with weight `factor`.
    pub fn splat(&mut self, light: &[Vertex], sender: Sender, factor: f32) {
        let camera = &self.ends[0].camera;
        let point = last(light);
        let dir = (point.surface.p - camera.origin).normalize_or(camera.axes.z_axis);
        let mut end = self.setup.emission.camera_end(self.scene, camera, dir);
        end.chain.scale(Spectral::splat(end.density / self.setup.walks as f32));
        self.connect(&[Vertex::end(self.scene, &end)], light, sender, Some(factor));
    }

    /// Connects the last vertices of a camera subpath and a light subpath, and appends the contribution. Each
    /// of these vertices may be the end of its subpath (pinhole or emitter). If the caller has already made
    /// the roulette decision, `factor` is the resulting weight.
    pub fn connect(&mut self, camera: &[Vertex], light: &[Vertex], sender: Sender, factor: Option<f32>) {
        if self.are_separated(camera, light) {
            return;
        }
        if !self.out.labelled {
            self.connect_lobes(camera, light, sender, (factor, [None; 2]));
            return;
        }
        let (scene, z, y) = (self.scene, last(camera), last(light));
        let to = y.surface.p - z.surface.p;
        let Some(way) = to.try_normalize() else {
            return;
        };
        // Make one roulette decision for all lobes.
        let Some(factor) = factor.or_else(|| {
            let mut chain = z.chain;
            if z.site != Site::Pinhole {
                let _ = chain.push(&z.scatter(scene, z.back, way)?, z.back, z.frame);
            }
            let lets = match y.site {
                Site::Pinhole => 1.0,
                _ => max_lane(y.scatter_flux(scene, -way, y.back)?.m00()),
            };
            let expected = chain.max_m00() * y.chain.max_m00() * lets / to.length_squared();
            self.spin_line([z, y], expected)
        }) else {
            return;
        };
        // Combine each kind of lobe of one vertex with each kind of the other vertex.
        let kinds = |p: &Vertex, wo, wi| -> ArrayVec<Option<u8>, 4> {
            if p.site == Site::Pinhole {
                return std::iter::once(None).collect();
            }
            let lobes = p.lobes(scene, wo, wi);
            lobes.into_iter().map(|(kind, _)| Some(kind)).collect()
        };
        let of_light = kinds(y, -way, y.back);
        for of_z in kinds(z, z.back, way) {
            for of_y in &of_light {
                self.connect_lobes(camera, light, sender, (Some(factor), [of_z, *of_y]));
            }
        }
    }

    /// Returns true if the straight line between the last vertices of two subpaths starts and ends in
    /// different media. The connection is then blocked, and no ray is traced. Returns false if the scene
    /// contains sheets.
    #[inline]
    fn are_separated(&self, camera: &[Vertex], light: &[Vertex]) -> bool {
        let (scene, z, y) = (self.scene, last(camera), last(light));
        if scene.sheets || !scene.filled {
            return false;
        }
        let to = y.surface.p - z.surface.p;
        z.medium_toward(scene, to) != y.medium_toward(scene, -to)
    }

    /// Decides by roulette whether to evaluate a connection with a contribution of about `expected`. Returns
    /// the weight of the connection, or `None` to skip the connection.
    #[inline(always)]
    fn spin_line(&mut self, ends: [&Vertex; 2], expected: f32) -> Option<f32> {
        // Camera and light subpaths are connected only in a fraction of samples.
        let often = if ends.iter().all(|p| p.site != Site::Pinhole) { self.setup.connections } else { 1.0 };
        let factor = self.setup.roulette.spin(expected / often, self.stream)?;
        Some(factor / often)
    }

    /// Implements [`Self::connect`] for the lobes of one kind at each vertex. `None` as the kind means all
    /// lobes.
    fn connect_lobes(
        &mut self,
        camera: &[Vertex],
        light: &[Vertex],
        sender: Sender,
        (factor, kinds): (Option<f32>, [Option<u8>; 2]),
    ) {
        let scene = self.scene;
        let (z, y) = (last(camera), last(light));
        if z.lanes.mask & y.lanes.mask == 0 {
            return;
        }
        let inner = |p: &Vertex| u32::from(p.site != Site::Pinhole);
        let interactions = z.interactions + y.interactions + inner(z) + inner(y);
        let Some(sheets) = most(scene).checked_sub(interactions) else {
            return;
        };
        let to = y.surface.p - z.surface.p;
        let distance2 = to.length_squared();
        let Some(dir) = to.try_normalize() else {
            return;
        };
        let (mut chain, mut frame) = (z.chain, z.frame);
        if z.site != Site::Pinhole {
            let Some(scatter) = z.scatter_by(scene, kinds[0], z.back, dir) else {
                return;
            };
            frame = chain.push(&scatter, z.back, frame).unwrap_or_else(|| perpendicular(dir));
        }
        let mut last = None;
        if y.site != Site::Pinhole {
            last = y.scatter_flux_by(scene, kinds[1], -dir, y.back);
            if last.is_none() {
                return;
            }
        }
        let Some(factor) = factor.or_else(|| {
            let lets = last.as_ref().map_or(1.0, |scatter| max_lane(scatter.m00()));
            self.spin_line([z, y], chain.max_m00() * y.chain.max_m00() * lets / distance2)
        }) else {
            return;
        };
        let mut line = z.line(scene, dir);
        let end = End { aim: y.reach(scene, -dir, distance2.sqrt()), at: y.at };
        let whole = end.aim - line.ray.origin;
        line.ray.dir = whole.normalize_or(dir);
        let lane = z.lanes.nth(0);
        let Some(way) = self.follow(&mut chain, &mut frame, &line, end, Allowed { sheets, lane }) else {
            return;
        };
        let straight = Line::straight(dir, way.passed / distance2);
        let weight = if self.is_sole(camera, light) {
            1.0
        } else {
            self.weight(camera, light, sender.source, straight)
        };
        chain.scale(Spectral::splat(weight * factor / distance2));
        let travel = match &last {
            Some(scatter) => {
                frame = chain.push(scatter, -dir, frame).unwrap_or_else(|| perpendicular(y.back));
                -y.back
            }
            None => -dir,
        };
        let record = Record {
            time_ps: picoseconds(z.optical_m + way.optical_m + y.optical_m),
            pixel: sender.pixel,
            interactions: interactions + way.sheets,
            label: kinds.iter().fold(z.label | y.label, |all, kind| all | kind.unwrap_or(0)),
        };
        meet(chain, Beam { travel, frame }, y, &record, &mut self.out);
    }

    /// Traces a connection. Returns `None` if the connection is blocked.
    #[inline]
    fn follow(
        &mut self,
        chain: &mut Chain,
        frame: &mut Vec3A,
        line: &Start,
        end: End,
        allowed: Allowed,
    ) -> Option<Followed> {
        let scene = self.scene;
        if scene.sheets || scene.filled || line.filling.crystal != NO_CRYSTAL {
            let way = trace_line(scene, chain, frame, line, end, allowed, &mut self.rays)?;
            return Some(Followed {
                optical_m: way.optical_m,
                sheets: way.sheets,
                passed: mean_transmittance(scene, way.depth),
            });
        }
        let length = (end.aim - line.ray.origin).length();
        self.rays += 1;
        if scene.geometry.occluded(&line.ray, length * (1.0 - END_GAP)) {
            return None;
        }
        let optical_m = f64::from(line.filling.index) * line.at.distance(end.at);
        Some(Followed { optical_m, sheets: 0, passed: 1.0 })
    }

    /// Returns true if no other strategy samples the path of a straight connection of these subpaths.
    fn is_sole(&self, camera: &[Vertex], light: &[Vertex]) -> bool {
        // If light reaches a surface only by specular events, connections from the surface sample the path.
        let lambert = |p: &Vertex| p.is_lambert(self.scene) && behind(light) != Some(light.len() - 1);
        self.setup.redirected && camera.len() == 1 && lambert(last(light))
    }

    /// Returns the MIS weight of a connection among all strategies that can sample the same path.
    pub fn weight(&mut self, camera: &[Vertex], light: &[Vertex], source: usize, line: Line) -> f32 {
        let (scene, guide) = (self.scene, &self.setup.guide);
        if !self.weighs {
            return 1.0;
        }
        let seen = [self.seen_from(camera), self.seen_through(light, source)];
        for (walk, out) in [camera, light].into_iter().zip(self.scratch.densities.iter_mut()) {
            out.clear();
            out.extend(walk.iter().enumerate().map(|(i, p)| Densities {
                own: p.forward,
                other: p.reverse,
                connects: !p.delta || i + 1 == walk.len(),
                particle: matches!(p.site, Site::Volume(_)),
            }));
        }
        let (z, y) = (last(camera), last(light));
        let [from_camera, from_light] = &mut self.scratch.densities;
        // Compute the densities with which the opposite subpath samples each end of the line and the
        // predecessor of the end.
        let [toward_light, toward_camera] = line.dirs;
        let to_z = line.arrivals[0].unwrap_or_else(|| {
            line.passed
                * match y.site {
                    Site::Pinhole => self.setup.emission.density(scene, self.ends[0], source, toward_camera),
                    _ => y.density(scene, guide, From::Light, y.back, toward_camera),
                }
        });
        let to_y = line.arrivals[1].unwrap_or_else(|| {
            line.passed
                * match z.site {
                    Site::Pinhole => z.forward,
                    _ => z.density(scene, guide, From::Camera, z.back, toward_light),
                }
        });
        let sides = [
            (camera, from_camera, to_z, toward_light, seen[0], From::Light),
            (light, from_light, to_y, toward_camera, seen[1], From::Camera),
        ];
        for (walk, out, density, dir, seen, from) in sides {
            let k = walk.len() - 1;
            let point = &walk[k];
            out[k].other = density * point.cosine(dir);
            if k > 0 {
                out[k - 1].other = point.density(scene, guide, from, dir, point.back) * point.spread;
            }
            if let Some((first, density)) = seen {
                // The segment through interfaces counts as one step, as in manifold connections.
                out.drain(1..first);
                out[1].own = density;
            }
        }
        let tries = Tries {
            light: self.setup.emission.chance(source),
            splats: self.setup.walks as f32,
            connections: self.setup.connections,
            strategies: self.setup.strategies,
        };
        let [camera, light] = &self.scratch.densities;
        power_heuristic(light, camera, tries)
    }
}

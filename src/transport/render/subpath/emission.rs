//! Starts light subpaths. Emitters are sampled by power, and directions are sampled by emitted intensity.

use super::projector_distribution::ProjectorDistribution;
use super::{End, Vertex};
use crate::accumulate::NO_PIXEL;
use crate::device::emitter::PointEmitter;
use crate::device::pinhole::Pinhole;
use crate::device::projector::Projector;
use crate::geometry::ray::Ray;
use crate::material::Filling;
use crate::medium::nesting::Nest;
use crate::render::transmission::surrounding;
use crate::scene::Scene;
use glam::{DVec2, Vec3A};
use optics::polarization::chain::Chain;
use optics::polarization::frame::project;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    Projector,
    /// Point emitter with this number.
    Point(usize),
}

/// The emitter to which a source refers.
enum Emitter<'a> {
    Projector(&'a Projector),
    Point(&'a PointEmitter),
}

/// All emitters at which subpaths can start, and the media around the emitters and around the camera.
pub(crate) struct Emission {
    /// Each source, with the probability of sampling this source.
    sources: Vec<(Source, f32)>,
    /// Filled objects that contain each source. `camera` lists the filled objects that contain the camera.
    nests: Vec<Nest>,
    pub camera: Nest,
    /// Density of start points on the projector's image, or `None` for a uniform density.
    starts: Option<ProjectorDistribution>,
}

/// The pinholes for one sample. The pinholes are those of the devices, or random points on the lenses of the
/// devices.
#[derive(Clone, Copy)]
pub(crate) struct Ends {
    pub camera: Pinhole,
    pub projector: Option<Projector>,
    /// True if the camera and the projector share a pinhole.
    pub coaxial: bool,
}

impl Ends {
    pub fn new(scene: &Scene) -> Self {
        Self {
            camera: scene.camera,
            projector: scene.projector,
            coaxial: scene.projector.is_some_and(|p| p.coaxial),
        }
    }

    /// Samples uniformly distributed points on the lenses.
    #[inline]
    pub fn draw(scene: &Scene, stream: &mut Stream) -> Self {
        let mut ends = Self::new(scene);
        if ends.camera.lens.radius > 0.0 {
            ends.camera = ends.camera.through_lens(stream.uniform2());
            // Light that leaves through one point of the lens may return through another point.
            ends.coaxial = false;
        }
        if let Some(p) = &mut ends.projector
            && p.pinhole.lens.radius > 0.0
        {
            p.pinhole = p.pinhole.through_lens(stream.uniform2());
        }
        ends
    }

    /// Returns the direction of the camera ray at an image position. A parallel camera is moved to the image
    /// position.
    #[inline]
    pub fn look(&mut self, at: DVec2) -> Vec3A {
        if self.camera.parallel {
            self.camera = self.camera.at(at);
        }
        self.camera.direction(at)
    }
}

/// The source of the light on a path.
#[derive(Clone, Copy)]
pub(crate) struct Sender {
    /// Index of the source.
    pub source: usize,
    /// Projector pixel s', or [`NO_PIXEL`] for a point emitter.
    pub pixel: u32,
}

/// The start of a light subpath, and the source of the light.
pub(crate) struct Emitted {
    pub end: End,
    pub sender: Sender,
}

/// Returns the filled objects that contain a point. A ray from the point to infinity leaves these objects
/// more often than the ray enters them.
pub(crate) fn surroundings(scene: &Scene, p: Vec3A) -> Nest {
    let mut nest = Nest::default();
    if !scene.filled {
        return nest;
    }
    // Scenes are unlikely to contain surfaces that are aligned with this direction.
    let dir = Vec3A::new(0.362_7, 0.541_3, 0.758_6).normalize();
    let mut ray = Ray { origin: p, dir };
    let mut net = vec![0_i32; scene.boundaries.len()];
    let mut left = vec![];
    // The number of surfaces is limited, because a grazing ray could loop forever.
    for _ in 0..10_000 {
        let Some(hit) = scene.geometry.intersect(&ray, f32::INFINITY) else {
            break;
        };
        let surface = scene.geometry.surface(&ray, &hit);
        let object = scene.boundaries[surface.material as usize].object;
        if let Some(net) = net.get_mut(object as usize) {
            *net += if surface.ng.dot(dir) > 0.0 { 1 } else { -1 };
            if *net == 1 {
                left.push(object);
            }
        }
        ray.origin = scene.geometry.leave(&surface, dir);
    }
    // The object that the ray left first is the object that was entered last.
    for id in left.iter().rev().filter(|id| net[**id as usize] > 0) {
        nest.cross(&scene.boundaries, *id, true);
    }
    nest
}

/// Returns the density per steradian of directions that are uniformly distributed over the image.
#[inline]
fn even(device: &Pinhole, dir: Vec3A) -> f32 {
    let [w, h] = device.resolution.map(|n| n as f32);
    device.pixels_per_steradian(dir) / (w * h)
}

impl Emission {
    pub fn new(scene: &Scene) -> Self {
        let mean = |s: Spectral| s.to_array().iter().sum::<f32>();
        let projector = scene.projector.iter().map(|p| {
            let [w, h] = p.pinhole.resolution.map(f64::from);
            let area = w * h / (p.pinhole.focal.x * p.pinhole.focal.y);
            (Source::Projector, mean(p.irradiance) * area as f32)
        });
        let points = scene.points.iter().enumerate();
        let points = points.map(|(i, p)| (Source::Point(i), mean(p.intensity) * p.profile.solid_angle()));
        let mut sources: Vec<(Source, f32)> = projector.chain(points).collect();
        let all: f32 = sources.iter().map(|s| s.1).sum();
        sources.retain(|s| s.1 > 0.0);
        for s in &mut sources {
            s.1 /= all;
        }
        let mut out =
            Self { sources, nests: vec![], camera: surroundings(scene, scene.camera.origin), starts: None };
        out.nests = (0..out.count())
            .map(|i| surroundings(scene, out.position(scene, &Ends::new(scene), i)))
            .collect();
        out
    }

    /// Returns the same emission, but most subpaths from the projector start toward redirecting surfaces.
    pub fn importance_sampled(self, scene: &Scene) -> Self {
        let starts = scene.projector.as_ref().and_then(|p| ProjectorDistribution::new(scene, &p.pinhole));
        Self { starts, ..self }
    }

    #[inline]
    pub fn count(&self) -> usize {
        self.sources.len()
    }

    /// Returns the probability that a subpath starts at source number `source`.
    #[inline]
    pub fn chance(&self, source: usize) -> f32 {
        self.sources[source].1
    }

    #[inline]
    fn emitter_of<'a>(&self, scene: &'a Scene, ends: &'a Ends, source: usize) -> Emitter<'a> {
        match (self.sources[source].0, &ends.projector) {
            (Source::Point(i), _) => Emitter::Point(&scene.points[i]),
            (Source::Projector, Some(p)) => Emitter::Projector(p),
            (Source::Projector, None) => unreachable!("the projector is a source only if it exists"),
        }
    }

    #[inline]
    pub fn position(&self, scene: &Scene, ends: &Ends, source: usize) -> Vec3A {
        match self.emitter_of(scene, ends, source) {
            Emitter::Point(point) => point.position,
            Emitter::Projector(p) => p.pinhole.origin,
        }
    }

    /// Returns the intensity of a source in the unit direction `dir`, and the horizontal axis of the emitted
    /// Stokes vectors.
    #[inline]
    pub fn intensity(&self, scene: &Scene, ends: &Ends, source: usize, dir: Vec3A) -> (Spectral, Vec3A) {
        match self.emitter_of(scene, ends, source) {
            Emitter::Point(point) => {
                let share = point.profile.value(dir);
                (point.share(&scene.materials.textures, dir, share), point.axis)
            }
            Emitter::Projector(p) => {
                let cos = dir.dot(p.pinhole.axes.z_axis);
                let factor = Spectral::splat(1.0 / (cos * cos * cos));
                (p.irradiance * factor, p.pinhole.axes.x_axis)
            }
        }
    }

    /// Returns the projector pixel through which a source illuminates the point `p`, or [`NO_PIXEL`] for
    /// point emitters. Returns `None` if the source does not illuminate the point.
    #[inline]
    pub fn pixel(&self, scene: &Scene, ends: &Ends, source: usize, p: Vec3A) -> Option<u32> {
        match self.emitter_of(scene, ends, source) {
            Emitter::Point(point) => {
                (point.profile.value((p - point.position).normalize_or_zero()) > 0.0).then_some(NO_PIXEL)
            }
            Emitter::Projector(projector) => projector.pinhole.pixel(p),
        }
    }

    /// Returns the density per steradian with which a subpath from a source starts in direction `dir`.
    #[inline]
    pub fn density(&self, scene: &Scene, ends: &Ends, source: usize, dir: Vec3A) -> f32 {
        match self.emitter_of(scene, ends, source) {
            Emitter::Point(point) => point.profile.density(dir),
            Emitter::Projector(p) => {
                let [w, h] = p.pinhole.resolution.map(|n| n as f32);
                let even = even(&p.pinhole, dir);
                match &self.starts {
                    Some(starts) => {
                        let at = p.pinhole.project(p.pinhole.origin + dir);
                        at.map_or(even, |(at, _)| even * starts.density([at.x as f32 / w, at.y as f32 / h]))
                    }
                    None => even,
                }
            }
        }
    }

    /// Starts a subpath. Samples a source by power, and samples the start direction from `at`. `at` contains
    /// two uniform random numbers in [0, 1). Returns `None` if the scene has no sources.
    pub fn start(&self, scene: &Scene, ends: &Ends, at: [f32; 2], stream: &mut Stream) -> Option<Emitted> {
        let mut u = stream.uniform();
        let last = self.sources.len().checked_sub(1)?;
        let mut source = 0;
        while source < last && u >= self.sources[source].1 {
            u -= self.sources[source].1;
            source += 1;
        }
        let (dir, pixel, density) = match self.emitter_of(scene, ends, source) {
            Emitter::Projector(p) => {
                let at = self.starts.as_ref().map_or(at, |starts| starts.point(at));
                // Use `at`, because rounding of the direction might give an adjacent cell.
                let relative = self.starts.as_ref().map_or(1.0, |starts| starts.density(at));
                let [w, h] = p.pinhole.resolution;
                let at = [at[0] * w as f32, at[1] * h as f32].map(f64::from);
                let at = DVec2::from_array(at);
                let dir = p.pinhole.direction(at);
                (dir, p.pinhole.number(at), relative * even(&p.pinhole, dir))
            }
            Emitter::Point(point) => {
                let dir = point.profile.sample(at);
                (dir, NO_PIXEL, point.profile.density(dir))
            }
        };
        let (intensity, axis) = self.intensity(scene, ends, source, dir);
        let flux = intensity * Spectral::splat(1.0 / (density * self.chance(source)));
        let (origin, nest) = (self.position(scene, ends, source), self.nests[source]);
        Some(Emitted {
            end: End {
                ray: Ray { origin, dir },
                chain: Chain::start(flux),
                frame: project(axis, dir),
                density,
                filling: surrounding(scene, &nest, 0),
                nest,
            },
            sender: Sender { source, pixel },
        })
    }

    /// Returns the camera as the end of camera subpaths whose rays start in direction `dir`.
    #[inline]
    pub fn camera_end(&self, scene: &Scene, camera: &Pinhole, dir: Vec3A) -> End {
        let nest = if camera.parallel { surroundings(scene, camera.origin) } else { self.camera };
        End {
            ray: Ray { origin: camera.origin, dir },
            chain: Chain::start(scene.wavelengths.ones()),
            frame: camera.frame(dir),
            density: camera.pixels_per_steradian(dir),
            filling: surrounding(scene, &nest, 0),
            nest,
        }
    }

    /// Returns a source as the end of a line from the point `p`, or `None` if source and point coincide.
    #[inline]
    pub fn emitter(&self, scene: &Scene, ends: &Ends, source: usize, p: Vec3A) -> Option<Vertex> {
        let origin = self.position(scene, ends, source);
        let dir = (p - origin).try_normalize()?;
        let (intensity, axis) = self.intensity(scene, ends, source, dir);
        Some(Vertex::end(
            scene,
            &End {
                ray: Ray { origin, dir },
                chain: Chain::start(intensity),
                frame: project(axis, dir),
                density: self.density(scene, ends, source, dir),
                // The field `filling` is unused, because connections are traced from the side of the camera.
                filling: Filling::VACUUM,
                nest: Nest::default(),
            },
        ))
    }
}

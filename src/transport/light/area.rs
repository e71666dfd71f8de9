//! Area lights: emissive surfaces with the same radiance in all directions, on the front or on both sides.
//!
//! The light tree ([`super::tree`]) chooses a triangle of a mesh. A point on the chosen triangle is sampled
//! uniformly by area. For a mesh of at most two triangles, the point is sampled uniformly over the area of
//! the whole mesh. For a sphere, directions are sampled in the cone that the sphere subtends from an outside
//! point (Shirley, Wang & Zimmerman 1996).

use super::Drawn;
use super::bounds::Bounds;
use super::filter::Polarized;
use super::profile::cone;
use crate::geometry::mesh::Mesh;
use crate::geometry::quadric::{Quadric, QuadricKind};
use crate::geometry::ray::Surface;
use crate::geometry::rounding::{self, UNIT};
use crate::material::texture::{Spectrum, Textures};
use glam::{Vec2, Vec3A};
use optics::spectrum::{Spectral, max_lane};
use std::f32::consts::TAU;

/// A triangle of an emissive mesh.
#[derive(Clone, Copy, Debug)]
struct Facet {
    corner: Vec3A,
    edges: [Vec3A; 2],
    /// Unit normal of the front side.
    normal: Vec3A,
    /// Rounding constant of the triangle (see [`Surface::rounding`]).
    rounding: f32,
    uvs: [Vec2; 3],
    /// Total area of the triangles up to and including this triangle, as a fraction of the mesh's area.
    until: f32,
}

impl Facet {
    /// Returns the area of the triangle, m². The area is never 0.
    #[inline]
    fn area(&self) -> f32 {
        let [a, b] = self.edges;
        (0.5 * a.cross(b).length()).max(f32::MIN_POSITIVE)
    }

    /// Returns the mean radiance over the triangle in the brightest wavelength lane, W/(m² sr nm).
    fn mean_radiance(&self, radiance: &Spectrum, textures: &Textures) -> f32 {
        const N: u32 = 4;
        let [a, b, c] = self.uvs;
        let at = |k: u32| {
            let (u, v) = ((k % N) as f32 + 0.5, (k / N) as f32 + 0.5);
            let root = (u / N as f32).sqrt();
            let (s, t) = (root * (1.0 - v / N as f32), root * v / N as f32);
            max_lane(radiance.at(textures, (a * (1.0 - s - t) + b * s + c * t).to_array()))
        };
        (0..N * N).map(at).sum::<f32>() / (N * N) as f32
    }
}

/// The shape of an area light.
#[derive(Clone, Debug)]
enum Form {
    Mesh(Vec<Facet>),
    Quadric(Box<Quadric>),
}

/// An emissive surface.
#[derive(Clone, Debug)]
pub struct AreaLight {
    /// Radiance in W/(m² sr nm), either uniform or multiplied by an image over the texture coordinates.
    pub radiance: Spectrum,
    pub two_sided: bool,
    pub polarized: Polarized,
    /// True if each triangle is a separate light in the light tree.
    split: bool,
    form: Form,
    /// Area of the surface, m².
    area: f32,
}

impl AreaLight {
    /// Creates a light from a mesh in world space.
    pub fn mesh(mesh: &Mesh, radiance: Spectrum, two_sided: bool, polarized: Polarized) -> Self {
        let mut facets = Vec::with_capacity(mesh.indices.len());
        let mut area = 0.0_f64;
        for triangle in &mesh.indices {
            let [a, b, c] = triangle.map(|i| Vec3A::from(mesh.positions[i as usize]));
            let edges = [b - a, c - a];
            let cross = edges[0].cross(edges[1]);
            area += 0.5 * f64::from(cross.length());
            let uvs = if mesh.uvs.is_empty() {
                // Use the default texture coordinates of the tracer.
                [Vec2::ZERO, Vec2::X, Vec2::Y]
            } else {
                triangle.map(|i| mesh.uvs[i as usize])
            };
            facets.push(Facet {
                corner: a,
                edges,
                normal: cross.normalize_or(Vec3A::Z),
                rounding: rounding::of_triangle(edges[0], edges[1]),
                uvs,
                until: area as f32,
            });
        }
        for facet in &mut facets {
            facet.until /= (area as f32).max(f32::MIN_POSITIVE);
        }
        Self { radiance, two_sided, polarized, split: false, form: Form::Mesh(facets), area: area as f32 }
    }

    /// Creates a light from a sphere, disk or cylinder.
    pub fn quadric(quadric: Quadric, radiance: Spectrum, two_sided: bool, polarized: Polarized) -> Self {
        let area = quadric.area();
        Self { radiance, two_sided, polarized, split: false, form: Form::Quadric(Box::new(quadric)), area }
    }

    /// Returns the area of the surface, m².
    pub fn area(&self) -> f32 {
        self.area
    }

    /// Makes each triangle a separate light if there are more than two triangles and if hits on the triangles
    /// can be distinguished. `numbered` is true if hits can be distinguished (see
    /// [`crate::geometry::bvh::Geometry::facet`]).
    pub(super) fn split(&mut self, numbered: bool) {
        self.split = numbered && matches!(&self.form, Form::Mesh(facets) if facets.len() > 2);
    }

    /// Returns the number of lights into which the light tree divides this light.
    pub fn parts(&self) -> usize {
        match &self.form {
            Form::Mesh(facets) if self.split => facets.len(),
            _ => 1,
        }
    }

    /// Appends the bounds of this light's parts. Radiant intensities are estimates for the brightest
    /// wavelength lane, W/(sr nm).
    pub(super) fn bounds(&self, textures: &Textures, out: &mut Vec<Bounds>) {
        let mean = self.mean_radiance(textures);
        let facets = match &self.form {
            Form::Mesh(facets) => facets,
            Form::Quadric(quadric) => {
                let (low, high) = quadric.bounds();
                out.push(if quadric.kind == QuadricKind::Disk {
                    let (_, normal) = quadric.point([0.5; 2]);
                    Bounds::flat(low, high, normal, self.two_sided, self.area * mean)
                } else {
                    // The mean projected area of a convex body is a quarter of its surface area (Cauchy).
                    Bounds::all_around(low, high, 0.25 * self.area * mean)
                });
                return;
            }
        };
        let of_facets = facets.iter().map(|facet| {
            let [a, b, c] = [Vec3A::ZERO, facet.edges[0], facet.edges[1]].map(|edge| facet.corner + edge);
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let radiance = if self.split && self.radiance.texture.is_some() {
                // The few image samples may miss bright texels, so include the mean of the whole image.
                0.5 * (mean + facet.mean_radiance(&self.radiance, textures))
            } else {
                mean
            };
            Bounds::flat(low, high, facet.normal, self.two_sided, facet.area() * radiance)
        });
        if self.split {
            out.extend(of_facets);
        } else {
            out.extend(of_facets.reduce(|all, facet| all.union(&facet)));
        }
    }

    /// Returns the mean radiance over the unit square of texture coordinates, for the brightest wavelength
    /// lane.
    fn mean_radiance(&self, textures: &Textures) -> f32 {
        const N: u32 = 16;
        if self.radiance.texture.is_none() {
            return max_lane(self.radiance.value);
        }
        let at = |i: u32| (i as f32 + 0.5) / N as f32;
        let radiances = (0..N * N).map(|k| max_lane(self.radiance.at(textures, [at(k % N), at(k / N)])));
        radiances.sum::<f32>() / (N * N) as f32
    }

    /// Returns the radiance that the surface emits along the unit direction `to`, W/(m² sr nm).
    #[inline]
    pub fn toward(&self, textures: &Textures, normal: Vec3A, uv: [f32; 2], to: Vec3A) -> Spectral {
        if self.two_sided || normal.dot(to) > 0.0 { self.radiance.at(textures, uv) } else { Spectral::ZERO }
    }

    /// Returns the axis and the minimum cosine of the cone that a sphere subtends from an outside point `p`.
    #[inline]
    fn cone(quadric: &Quadric, p: Vec3A) -> Option<(Vec3A, f32)> {
        let (centre, radius) = quadric.ball()?;
        let to = centre - p;
        let sin2 = radius * radius / to.length_squared();
        // For a point close to the surface, rounding errors would make some rays miss the sphere.
        (sin2 < 0.999).then(|| (to.normalize(), (1.0 - sin2).sqrt()))
    }

    /// Samples a point of a part for a receiver at `p`, from three uniform random numbers in [0, 1). `chance`
    /// is the probability of choosing the part. Returns `None` if the point emits no light toward `p`.
    #[inline]
    pub(super) fn draw(
        &self,
        textures: &Textures,
        p: Vec3A,
        [which, u, v]: [f32; 3],
        (part, chance): (usize, f32),
    ) -> Option<Drawn> {
        let (at, normal, uv, rounding) = match &self.form {
            Form::Mesh(facets) => {
                let facet = if self.split {
                    facets.get(part)?
                } else {
                    facets.get(facets.partition_point(|f| f.until <= which).min(facets.len() - 1))?
                };
                // Sample the triangle uniformly by area (Osada et al. 2002).
                let root = u.sqrt();
                let (s, t) = (root * (1.0 - v), root * v);
                let [a, b, c] = facet.uvs;
                let uv = a * (1.0 - s - t) + b * s + c * t;
                (
                    facet.corner + facet.edges[0] * s + facet.edges[1] * t,
                    facet.normal,
                    uv.to_array(),
                    facet.rounding,
                )
            }
            Form::Quadric(quadric) => {
                let image = self.radiance.texture.is_some();
                let uv = |at: Vec3A| if image { quadric.uv(at) } else { [0.0; 2] };
                if let Some((axis, least)) = Self::cone(quadric, p) {
                    let dir = cone(axis, least, [u, v]);
                    let t = quadric.intersect(p, dir, f32::INFINITY);
                    if t == f32::INFINITY {
                        return None;
                    }
                    let (at, normal, _) = quadric.surface(p + dir * t);
                    (at, normal, uv(at), quadric.rounding)
                } else {
                    let (at, normal) = quadric.point([u, v]);
                    (at, normal, uv(at), quadric.rounding)
                }
            }
        };
        let to = at - p;
        let wi = to.try_normalize()?;
        // Offset the point from the surface, because the surface would otherwise occlude the point.
        let off = rounding * UNIT * at.abs().max_element().max(to.length());
        let position = at + normal * off.copysign(-normal.dot(wi));
        let radiance = self.toward(textures, normal, uv, -wi);
        let at = Surface { p: at, ng: normal, ..Surface::default() };
        let density = chance * self.density(p, wi, &at, part);
        if radiance == Spectral::ZERO || density <= 0.0 || !density.is_finite() {
            return None;
        }
        Some(Drawn {
            wi,
            position,
            distance: (position - p).length(),
            irradiance: radiance * Spectral::splat(1.0 / density),
            density,
            start_m: 0.0,
            polarized: self.polarized,
        })
    }

    /// Returns the probability density per steradian with which [`Self::draw`] samples the point `at` of a
    /// part for a receiver at `p`. `dir` is the unit direction from `p` to `at`.
    #[inline]
    pub(super) fn density(&self, p: Vec3A, dir: Vec3A, at: &Surface, part: usize) -> f32 {
        let per_area = match &self.form {
            Form::Mesh(facets) if self.split => 1.0 / facets[part].area(),
            Form::Mesh(_) => 1.0 / self.area,
            Form::Quadric(quadric) => match Self::cone(quadric, p) {
                Some((_, least)) => return 1.0 / (TAU * (1.0 - least)),
                None => quadric.density(at.p),
            },
        };
        let cos = at.ng.dot(dir).abs();
        per_area * (at.p - p).length_squared() / cos.max(f32::MIN_POSITIVE)
    }
}

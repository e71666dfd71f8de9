//! Surfaces that shine: the same radiance in all directions of their front, or of both sides.
//!
//! Points are drawn by area, triangle by triangle, but on balls, where directions are drawn within the cone that a ball
//! fills as seen from outside (Shirley, Wang & Zimmerman 1996).

use super::drawn::Drawn;
use super::filter::Polarized;
use super::profile::cone;
use crate::geometry::mesh::Mesh;
use crate::geometry::quadric::Quadric;
use crate::geometry::ray::Surface;
use crate::geometry::rounding::{self, UNIT};
use crate::material::texture::{Spectrum, Textures};
use glam::{Vec2, Vec3A};
use optics::spectrum::{Spectral, max_lane};
use std::f32::consts::{PI, TAU};

/// A triangle of a shining mesh.
#[derive(Clone, Copy, Debug)]
struct Facet {
    corner: Vec3A,
    edges: [Vec3A; 2],
    /// Unit normal, toward its front.
    normal: Vec3A,
    /// As [`Surface::rounding`].
    rounding: f32,
    uvs: [Vec2; 3],
    /// Share of the area up to the end of this one.
    until: f32,
}

/// The shape of a light.
#[derive(Clone, Debug)]
enum Form {
    Mesh(Vec<Facet>),
    Quadric(Box<Quadric>),
}

/// A surface that shines.
#[derive(Clone, Debug)]
pub struct AreaLight {
    /// Radiance, W/(m² sr nm), which may be an image over the texture coordinates.
    pub radiance: Spectrum,
    /// It shines to both sides, not to its front alone.
    pub two_sided: bool,
    /// Its frame and filter.
    pub polarized: Polarized,
    /// Probability with which it is drawn.
    pub chance: f32,
    form: Form,
    /// Square metres.
    area: f32,
}

impl AreaLight {
    /// A mesh in world space.
    #[must_use]
    pub fn mesh(mesh: &Mesh, radiance: Spectrum, two_sided: bool, polarized: Polarized) -> Self {
        let mut facets = Vec::with_capacity(mesh.indices.len());
        let mut area = 0.0_f64;
        for triangle in &mesh.indices {
            let [a, b, c] = triangle.map(|i| Vec3A::from(mesh.positions[i as usize]));
            let edges = [b - a, c - a];
            let cross = edges[0].cross(edges[1]);
            area += 0.5 * f64::from(cross.length());
            let uvs = if mesh.uvs.is_empty() {
                // As the tracer numbers the points of triangles without coordinates.
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
        Self {
            radiance,
            two_sided,
            polarized,
            chance: 0.0,
            form: Form::Mesh(facets),
            area: area as f32,
        }
    }

    /// A sphere, disk or cylinder.
    #[must_use]
    pub fn quadric(quadric: Quadric, radiance: Spectrum, two_sided: bool, polarized: Polarized) -> Self {
        let area = quadric.area();
        Self {
            radiance,
            two_sided,
            polarized,
            chance: 0.0,
            form: Form::Quadric(Box::new(quadric)),
            area,
        }
    }

    /// Square metres.
    #[must_use]
    pub fn area(&self) -> f32 {
        self.area
    }

    /// About the power, W/nm in the brightest lane: what choosing among lights needs.
    #[must_use]
    pub fn power(&self, textures: &Textures) -> f32 {
        const N: u32 = 16;
        let at = |i: u32| (i as f32 + 0.5) / N as f32;
        let mean: f32 = (0..N * N)
            .map(|k| max_lane(self.radiance.at(textures, [at(k % N), at(k / N)])))
            .sum::<f32>()
            / (N * N) as f32;
        let sides = if self.two_sided { 2.0 } else { 1.0 };
        sides * PI * self.area * mean
    }

    /// Radiance that leaves the surface along the unit direction `to`.
    #[inline]
    #[must_use]
    pub fn toward(&self, textures: &Textures, normal: Vec3A, uv: [f32; 2], to: Vec3A) -> Spectral {
        if self.two_sided || normal.dot(to) > 0.0 {
            self.radiance.at(textures, uv)
        } else {
            Spectral::ZERO
        }
    }

    /// Least cosine of the cone that a ball fills as seen from `p`, outside of it.
    #[inline]
    fn cone(quadric: &Quadric, p: Vec3A) -> Option<(Vec3A, f32)> {
        let (centre, radius) = quadric.ball()?;
        let to = centre - p;
        let sin2 = radius * radius / to.length_squared();
        // Close to the surface rounding would make rays miss.
        (sin2 < 0.999).then(|| (to.normalize(), (1.0 - sin2).sqrt()))
    }

    /// Draws a point toward `p` by three uniforms; `None` where its back is turned.
    #[inline]
    #[must_use]
    pub(super) fn draw(&self, textures: &Textures, p: Vec3A, [which, u, v]: [f32; 3]) -> Option<Drawn> {
        let (at, normal, uv, rounding) = match &self.form {
            Form::Mesh(facets) => {
                let facet = facets.get(facets.partition_point(|f| f.until <= which).min(facets.len() - 1))?;
                // Uniform over a triangle (Osada et al. 2002).
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
                if let Some((axis, least)) = Self::cone(quadric, p) {
                    let dir = cone(axis, least, [u, v]);
                    let t = quadric.intersect(p, dir, f32::INFINITY);
                    if t == f32::INFINITY {
                        return None;
                    }
                    let (at, normal, _) = quadric.surface(p + dir * t);
                    (at, normal, quadric.uv(at), quadric.rounding)
                } else {
                    let (at, normal) = quadric.point([u, v]);
                    (at, normal, quadric.uv(at), quadric.rounding)
                }
            }
        };
        let to = at - p;
        let wi = to.try_normalize()?;
        // Off the surface, which would hide itself.
        let off = rounding * UNIT * at.abs().max_element().max(to.length());
        let position = at + normal * off.copysign(-normal.dot(wi));
        let radiance = self.toward(textures, normal, uv, -wi);
        let at = Surface {
            p: at,
            ng: normal,
            ..Surface::default()
        };
        let density = self.chance * self.density(p, wi, &at);
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

    /// Density per steradian with which [`Self::draw`] finds, from `p`, the point `at` in the unit direction `dir`.
    #[inline]
    #[must_use]
    pub(super) fn density(&self, p: Vec3A, dir: Vec3A, at: &Surface) -> f32 {
        let per_area = match &self.form {
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

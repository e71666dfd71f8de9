//! Visibility from a pinhole. The view stores the nearest primitive and possible occluders in each small
//! pyramid of directions.
//!
//! The pinholes of projector and camera are fixed, and millions of rays start or end at these pinholes. Most
//! pyramids contain a single primitive, or one primitive in front of all others. For pyramids of both kinds,
//! visibility and first hits are known without tracing a ray. Pyramids that contain an edge require a ray.
//! All bounds are conservative, so that the results equal those of traced rays.

use super::bvh::{Geometry, QUADRIC};
use super::many::{Many, turned};
use super::ray::{Hit, Ray, Surface};
use super::survey::{Bounds, DEPTH_MARGIN, Grid, Survey};
use super::tree::fetch;
use glam::{Mat3A, Vec2, Vec3A};

/// Maximum number of pyramids along an axis. A larger table would not fit into the processor's caches.
const MOST: u32 = 256;
/// The bounds of a pyramid in eight bytes. The compact format reduces memory traffic. A depth is the upper
/// half of an `f32`, rounded conservatively.
#[derive(Clone, Copy, Debug)]
struct Pyramid {
    leaf: u32,
    others: u16,
    cover: u16,
}

impl Pyramid {
    fn new(bounds: &Bounds) -> Self {
        Self {
            leaf: bounds.leaf,
            others: (bounds.others.to_bits() >> 16) as u16,
            // Round up. Infinity is excluded, because incrementing the bits of infinity would give NaN.
            cover: if bounds.cover < f32::MAX / 2.0 {
                (bounds.cover.to_bits() >> 16) as u16 + 1
            } else {
                (f32::INFINITY.to_bits() >> 16) as u16
            },
        }
    }

    #[inline(always)]
    fn others(self) -> f32 {
        f32::from_bits(u32::from(self.others) << 16)
    }

    #[inline(always)]
    fn cover(self) -> f32 {
        f32::from_bits(u32::from(self.cover) << 16)
    }
}

/// Index that denotes no pyramid.
const OUTSIDE: u32 = u32::MAX;

/// The pyramids of directions from a pinhole, with their bounds.
pub struct View {
    grid: Grid,
    origin: Vec3A,
    /// Rotation from world axes to the pinhole's axes (right, down, forward).
    to_local: Mat3A,
    pyramids: Vec<Pyramid>,
}

impl View {
    /// Computes the view from `origin` of directions between `lo` and `hi` (right/forward, down/forward). The
    /// grid has at most `size` pyramids along its axes. The columns of `axes` are right, down, forward.
    /// Returns `None` if an object is too close to the pinhole for a useful view.
    pub fn new(
        geometry: &Geometry,
        origin: Vec3A,
        axes: Mat3A,
        [lo, hi]: [Vec2; 2],
        size: [u32; 2],
    ) -> Option<Self> {
        let size = size.map(|n| n.clamp(1, MOST));
        let grid = Grid { first: lo, density: Vec2::new(size[0] as f32, size[1] as f32) / (hi - lo), size };
        let to_local = axes.transpose();
        let survey = Survey::of(geometry, grid, origin, to_local)?;
        Some(Self { grid, origin, to_local, pyramids: survey.bounds.iter().map(Pyramid::new).collect() })
    }

    /// Returns the indices of the pyramids that contain the points, given as arrays of right, down and
    /// forward coordinates (x, y, z). A point outside the grid receives the index `OUTSIDE`. The compiler
    /// vectorizes the plain loops.
    #[inline(always)]
    pub fn cells<const N: usize>(&self, local: &Many<N>) -> [u32; N] {
        let [columns, rows] = self.grid.size;
        let mut cells = [OUTSIDE; N];
        for i in 0..N {
            let z = local[2][i];
            let x = (local[0][i] / z - self.grid.first.x) * self.grid.density.x;
            let y = (local[1][i] / z - self.grid.first.y) * self.grid.density.y;
            let right = (z > 0.0) & (x >= 0.0) & (y >= 0.0);
            let inside = right & (x < columns as f32) & (y < rows as f32);
            let cell = (y as i32 as u32).wrapping_mul(columns).wrapping_add(x as i32 as u32);
            cells[i] = if inside { cell } else { OUTSIDE };
        }
        cells
    }

    /// Returns [`Self::cells`] for world directions.
    #[inline(always)]
    pub(crate) fn cells_toward<const N: usize>(&self, dir: &Many<N>) -> [u32; N] {
        self.cells(&turned(&self.to_local, dir))
    }

    /// Prefetches the bounds of pyramid `cell`.
    #[inline(always)]
    pub fn expect(&self, cell: u32) {
        if let Some(pyramid) = self.pyramids.get(cell as usize) {
            fetch(pyramid);
        }
    }

    /// Returns true if a hit is visible from the pinhole, false if the hit is occluded, and `None` if only a
    /// ray can decide. `depth` is the distance from the pinhole to the hit along the forward axis, metres.
    /// `cell` is the pyramid that contains the hit.
    #[inline(always)]
    pub fn sees(&self, cell: u32, depth: f32, hit: &Hit, surface: &Surface) -> Option<bool> {
        let pyramid = self.pyramids.get(cell as usize)?;
        if depth * (1.0 - DEPTH_MARGIN) > pyramid.cover() {
            return Some(false);
        }
        // A sphere occludes its far side.
        let facing = hit.leaf & QUADRIC == 0 || surface.ng.dot(self.origin - surface.p) > 0.0;
        let own = hit.leaf == pyramid.leaf && facing;
        (own && depth * (1.0 + DEPTH_MARGIN) < pyramid.others()).then_some(true)
    }

    /// Returns the first hit of a ray from the pinhole in pyramid `cell`, if the bounds determine the hit.
    #[inline(always)]
    pub(crate) fn first_hit(&self, cell: u32, geometry: &Geometry, ray: &Ray) -> Option<Hit> {
        let pyramid = self.pyramids.get(cell as usize)?;
        // The nearest primitive is known if this primitive covers the pyramid in front of all other
        // primitives.
        if pyramid.cover() < pyramid.others() { geometry.meet(ray, pyramid.leaf) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::super::builder::GeometryBuilder;
    use super::super::mesh::Mesh;
    use super::super::quadric::{Quadric, QuadricKind};
    use super::super::tests::crowd;
    use super::*;
    use glam::{Affine3A, Quat, Vec3};
    use optics::sampling::stream::Stream;
    use optics::sampling::warp;

    /// Returns a closed room that contains spheres, a tube, a disk and many triangles.
    fn room(stream: &mut Stream) -> Geometry {
        let mut builder = GeometryBuilder::default();
        let quarter = std::f32::consts::FRAC_PI_2;
        for turn in [
            Quat::IDENTITY,
            Quat::from_rotation_x(quarter),
            Quat::from_rotation_x(-quarter),
            Quat::from_rotation_y(quarter),
            Quat::from_rotation_y(-quarter),
        ] {
            let mut wall = Mesh::rectangle();
            let place = Affine3A::from_translation(Vec3::new(-0.5, -0.5, 0.0));
            let size = Affine3A::from_scale(Vec3::new(4.0, 4.0, 1.0));
            let back = Affine3A::from_translation(Vec3::new(0.0, 0.0, -2.0));
            wall.transform(&(Affine3A::from_quat(turn) * back * size * place));
            builder.mesh(&wall, 0);
        }
        builder.mesh(&crowd(stream, 60, (Vec3A::new(-0.8, 0.7, -0.6), 0.6), 0.3), 0);
        for (kind, scale, at) in [
            (QuadricKind::Sphere, Vec3::splat(0.5), Vec3::new(0.8, -1.0, 0.0)),
            (QuadricKind::Sphere, Vec3::splat(0.2), Vec3::new(0.6, -0.6, 0.8)),
            (QuadricKind::Sphere, Vec3::new(0.3, 0.5, 0.3), Vec3::new(-0.9, -1.2, 0.2)),
            (QuadricKind::Disk, Vec3::splat(0.5), Vec3::new(1.1, 1.0, -1.0)),
            (QuadricKind::Cylinder, Vec3::splat(0.3), Vec3::new(0.2, 0.9, -1.5)),
        ] {
            let place = Affine3A::from_scale_rotation_translation(scale, Quat::from_rotation_x(0.3), at);
            builder.quadric(Quadric::new(kind, place, 0));
        }
        builder.build()
    }

    /// Returns a wavy mesh between two spheres in front of a wall. The mesh has enough triangles to be added
    /// to the bounds as boxes of the tree.
    fn waves() -> Geometry {
        let n = 190_u32;
        let point = |i: u32| {
            let [x, y] = [i % (n + 1), i / (n + 1)].map(|k| k as f32 / n as f32 * 3.6 - 1.8);
            Vec3::new(x, y, 0.3 * (5.0 * x).sin() * (4.0 * y).cos())
        };
        let corner = |i: u32| i / n * (n + 1) + i % n;
        let mut builder = GeometryBuilder::default();
        let squares = (0..n * n).map(corner);
        builder.own_mesh(
            Mesh {
                positions: (0..(n + 1) * (n + 1)).map(point).collect(),
                indices: squares.flat_map(|c| [[c, c + 1, c + n + 2], [c, c + n + 2, c + n + 1]]).collect(),
                ..Mesh::default()
            },
            0,
        );
        let mut wall = Mesh::rectangle();
        let back = Affine3A::from_scale_rotation_translation(
            Vec3::splat(1.9),
            Quat::IDENTITY,
            Vec3::new(0.0, 0.0, -1.5),
        );
        wall.transform(&back);
        builder.own_mesh(wall, 1);
        for (radius, at) in [(0.4, Vec3::new(0.5, 0.5, 1.2)), (0.3, Vec3::new(-0.5, -0.4, -0.8))] {
            let place = Affine3A::from_scale_rotation_translation(Vec3::splat(radius), Quat::IDENTITY, at);
            builder.quadric(Quadric::new(QuadricKind::Sphere, place, 2));
        }
        builder.build()
    }

    /// Verifies that the view decides the visibility of most points, and that these decisions agree with
    /// traced rays.
    #[test]
    fn views_agree_with_rays() {
        let mut stream = Stream::new(11, 0, 0);
        let g = room(&mut stream);
        let [asked, spoken, free, firsts] = agree(&g, &mut stream, [256, 200], 30_000);
        assert!(spoken > asked / 2 && free > spoken / 4 && free < spoken, "{free} {spoken} {asked}");
        assert!(firsts > 27_000, "{firsts}");
    }

    /// Verifies that the view decides the visibility of most points next to or in front of a large mesh. The
    /// decisions must agree with traced rays.
    #[test]
    fn views_of_large_meshes_agree_with_rays() {
        let mut stream = Stream::new(13, 0, 0);
        let g = waves();
        assert!(g.counts().0 > 1 << 16);
        let [asked, spoken, free, firsts] = agree(&g, &mut stream, [32, 25], 100_000);
        assert!(spoken > asked / 100 && free > 500 && firsts > 500, "{free} {spoken} {asked} {firsts}");
    }

    /// Compares a view with rays. Returns four numbers: queries, queries that the view decides, unoccluded
    /// points, and first hits.
    fn agree(g: &Geometry, stream: &mut Stream, size: [u32; 2], rays: u32) -> [u32; 4] {
        let (lo, hi) = (Vec2::new(-0.9, -0.8), Vec2::new(0.8, 0.7));
        let [mut asked, mut spoken, mut free, mut firsts] = [0_u32; 4];
        for origin in [Vec3A::new(0.1, 0.2, 3.9), Vec3A::new(-1.5, 1.2, 2.5), Vec3A::new(0.4, -1.9, 1.9)] {
            let axes = Mat3A::from_quat(Quat::from_rotation_y(0.1 * origin.x))
                * Mat3A::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
            let view = View::new(g, origin, axes, [lo, hi], size).expect("no primitive is too close");
            for _ in 0..rays {
                // Trace rays from random points in the room to surfaces.
                let at = Vec3A::new(stream.uniform(), stream.uniform(), stream.uniform()) * 3.8 - 1.9;
                let ray = Ray { origin: at, dir: warp::sphere(stream.uniform2()) };
                let Some(hit) = g.intersect(&ray, f32::INFINITY) else {
                    continue;
                };
                let surface = g.surface(&ray, &hit);
                let local = view.to_local * (surface.p - origin);
                let [cell] = view.cells(&local.to_array().map(|v| [v]));
                if cell == OUTSIDE {
                    continue;
                }
                asked += 1;
                let start = g.leave(&surface, origin - surface.p);
                let to = origin - start;
                let back = Ray { origin: start, dir: to.normalize() };
                if let Some(seen) = view.sees(cell, local.z, &hit, &surface) {
                    spoken += 1;
                    free += u32::from(seen);
                    assert_eq!(seen, !g.occluded(&back, to.length() * (1.0 - 1e-5)), "{hit:?} {local}");
                }
            }
            for _ in 0..rays / 2 {
                let [u, v] = stream.uniform2();
                let d = lo + (hi - lo) * Vec2::new(u, v);
                let ray = Ray { origin, dir: (axes * Vec3A::from(d.extend(1.0))).normalize() };
                let [cell] = view.cells_toward(&ray.dir.to_array().map(|v| [v]));
                if let Some(hit) = view.first_hit(cell, g, &ray) {
                    firsts += 1;
                    let found = g.intersect(&ray, f32::INFINITY).expect("the ray hits a surface");
                    assert_eq!((hit.leaf, hit.t), (found.leaf, found.t));
                }
            }
        }
        [asked, spoken, free, firsts]
    }

    /// Verifies that no view is created for a pinhole inside a sphere or just in front of a wall.
    #[test]
    fn pinholes_close_to_surfaces_have_no_view() {
        let mut stream = Stream::new(12, 0, 0);
        let g = room(&mut stream);
        let window = [Vec2::splat(-0.5), Vec2::splat(0.5)];
        let axes = Mat3A::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
        for origin in [Vec3A::new(0.8, -1.0, 0.1), Vec3A::new(0.3, 0.2, -1.9999)] {
            assert!(View::new(&g, origin, axes, window, [64, 64]).is_none());
        }
    }
}

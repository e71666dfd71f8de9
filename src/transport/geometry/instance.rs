//! Groups of surfaces and their copies, as tables: where a copy is, and how a ray looks from there.
//!
//! On rounding: a ray's origin is taken relative to the instance first, so that its error is one of its distance to the
//! instance and not of coordinates; then it is moved along itself to where the group's sphere begins. So it meets the
//! group's triangles from as near as their size, wherever it comes from, and the skin that closes the gaps between them
//! is one of the group's size too.

use super::ray::Ray;
use super::rounding;
use super::tree::Tree;
use glam::{DAffine3, Mat3A, Vec3A};
use obvhs::aabb::Aabb;

/// Surfaces that may have many copies.
pub(super) struct Group {
    /// Over packs and quadrics of the [`Geometry`].
    pub(super) tree: Tree,
    /// Everything lies within this distance of the group's origin.
    pub(super) reach: f32,
    /// How far its triangles reach beyond their edges, in its own metres.
    pub(super) skin: f32,
}

impl Group {
    /// Memory that it takes beside packs, triangles and quadrics.
    pub(super) fn bytes(&self) -> usize {
        size_of::<Self>() + self.tree.bytes()
    }
}

/// A copy of a group.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instance {
    /// Linear part of the map to the world, and where the group's origin comes to lie.
    pub(super) to_world: Mat3A,
    pub(super) origin: Vec3A,
    /// Inverse of `to_world`.
    pub(super) to_local: Mat3A,
    /// Number of the group.
    pub(super) group: u32,
}

/// A ray in a group's coordinates.
pub(super) struct Local {
    pub(super) ray: Ray,
    /// How far the ray was moved along itself, in the group's metres.
    pub(super) start: f32,
    /// The group's metres a metre along the ray.
    pub(super) scale: f32,
}

impl Local {
    /// Distance in the world.
    #[inline]
    pub(super) fn world(&self, t: f32) -> f32 {
        (self.start + t) / self.scale
    }
}

impl Instance {
    /// A group at its place; the map must be invertible (the scene builder checks).
    pub(super) fn new(group: u32, to_world: &DAffine3) -> Self {
        Self {
            to_world: to_world.matrix3.as_mat3().into(),
            origin: to_world.translation.as_vec3a(),
            to_local: to_world.matrix3.inverse().as_mat3().into(),
            group,
        }
    }

    /// A point of the group in the world.
    #[inline]
    pub(super) fn place(&self, p: Vec3A) -> Vec3A {
        self.to_world * p + self.origin
    }

    /// At most so many metres in the world come of one in the group.
    pub(super) fn stretch(&self) -> f32 {
        stretch(self.to_world)
    }

    /// Bounds in the world.
    pub(super) fn bounds(&self, group: &Group) -> Aabb {
        let m = self.to_world;
        let mut all = Aabb::empty();
        // Those of the root's children are tighter together than the one about all.
        for (b, _) in group.tree.children(0) {
            let (middle, half) = ((b.min + b.max) * 0.5, (b.max - b.min) * 0.5);
            let half = (m.x_axis * half.x).abs() + (m.y_axis * half.y).abs() + (m.z_axis * half.z).abs();
            let middle = self.place(middle);
            // Some units in the last place, which is where the corners of the copy are.
            let pad = (half + middle.abs() + self.origin.abs()) * 1e-6;
            all.extend(middle - half - pad);
            all.extend(middle + half + pad);
        }
        all
    }

    #[inline]
    pub(super) fn local(&self, ray: &Ray, reach: f32) -> Local {
        let origin = self.to_local * (ray.origin - self.origin);
        let dir = self.to_local * ray.dir;
        let scale = dir.length();
        let dir = dir / scale;
        let start = (-origin.dot(dir) - reach).max(0.0);
        Local {
            ray: Ray {
                origin: origin + dir * start,
                dir,
            },
            start,
            scale,
        }
    }

    /// The unit normal of a copy.
    #[inline]
    pub(super) fn normal(&self, n: Vec3A) -> Vec3A {
        // By the inverse transpose, which keeps outward outward in mirror images.
        (self.to_local.transpose() * n).normalize()
    }

    /// Rounding of a copy of a surface, see [`Surface::rounding`](super::ray::Surface::rounding).
    #[inline]
    pub(super) fn rounding(&self, own: f32) -> f32 {
        rounding::placed(own, self.stretch(), stretch(self.to_local))
    }

    #[inline]
    pub(super) fn mirrors(&self) -> bool {
        self.to_world.determinant() < 0.0
    }
}

/// No vector grows by more than this in a map.
pub(super) fn stretch(m: Mat3A) -> f32 {
    // The Frobenius norm bounds the spectral one.
    (m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()).sqrt()
}

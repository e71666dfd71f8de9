//! Groups of surfaces and their instances: transforms, bounds, and rays in group coordinates.
//!
//! To limit rounding errors, the origin of a ray is first made relative to the position of the instance. The
//! rounding error then scales with the distance to the instance, not with world coordinates. The origin is
//! then moved along the ray to the bounding sphere of the group. The distance from the moved origin to the
//! triangles is therefore about the size of the group at most. The overlap that closes gaps between triangles
//! is sized for this distance.

use super::ray::Ray;
use super::rounding;
use super::tree::Tree;
use glam::{DAffine3, Mat3A, Vec3A};
use obvhs::aabb::Aabb;

/// A set of surfaces that may have many instances.
pub(super) struct Group {
    /// Tree over packs and quadrics. The leaf indices refer to the packs and quadrics of [`Geometry`].
    pub(super) tree: Tree,
    /// Radius of the bounding sphere about the group's origin, metres in group coordinates.
    pub(super) reach: f32,
    /// Distance by which triangles extend beyond their edges, metres in group coordinates.
    pub(super) skin: f32,
}

impl Group {
    /// Returns the memory used by the group, in bytes, without packs, triangles and quadrics.
    pub(super) fn bytes(&self) -> usize {
        size_of::<Self>() + self.tree.bytes()
    }
}

/// An instance of a group.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instance {
    /// Linear part of the map to the world, followed by the world position of the group's origin.
    pub(super) to_world: Mat3A,
    pub(super) origin: Vec3A,
    /// Inverse of `to_world`.
    pub(super) to_local: Mat3A,
    /// Index of the group.
    pub(super) group: u32,
}

/// A ray in group coordinates.
pub(super) struct Local {
    pub(super) ray: Ray,
    /// Distance by which the ray's origin was moved along the ray, metres in group coordinates.
    pub(super) start: f32,
    /// Factor that converts distances along the world ray to distances in group coordinates.
    pub(super) scale: f32,
}

impl Local {
    /// Converts a distance in group coordinates to a distance in the world, metres.
    #[inline]
    pub(super) fn world(&self, t: f32) -> f32 {
        (self.start + t) / self.scale
    }
}

impl Instance {
    /// Places a group. The map must be invertible, which the scene builder checks.
    pub(super) fn new(group: u32, to_world: &DAffine3) -> Self {
        Self {
            to_world: to_world.matrix3.as_mat3().into(),
            origin: to_world.translation.as_vec3a(),
            to_local: to_world.matrix3.inverse().as_mat3().into(),
            group,
        }
    }

    /// Transforms a point of the group to the world.
    #[inline]
    pub(super) fn place(&self, p: Vec3A) -> Vec3A {
        self.to_world * p + self.origin
    }

    /// Returns an upper bound on the factor by which the map from group to world stretches lengths.
    pub(super) fn stretch(&self) -> f32 {
        stretch(self.to_world)
    }

    /// Returns the bounding box of the instance in the world.
    pub(super) fn bounds(&self, group: &Group) -> Aabb {
        let m = self.to_world;
        let mut all = Aabb::empty();
        // The boxes of the root's children give tighter bounds than the root's box.
        for (b, _) in group.tree.children(0) {
            let (middle, half) = ((b.min + b.max) * 0.5, (b.max - b.min) * 0.5);
            let half = (m.x_axis * half.x).abs() + (m.y_axis * half.y).abs() + (m.z_axis * half.z).abs();
            let middle = self.place(middle);
            // Pad the box by several units in the last place, to cover the rounding errors of the corners.
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
        Local { ray: Ray { origin: origin + dir * start, dir }, start, scale }
    }

    /// Transforms a unit normal to the world.
    #[inline]
    pub(super) fn normal(&self, n: Vec3A) -> Vec3A {
        // The inverse transpose keeps outward normals outward, even if the map is a reflection.
        (self.to_local.transpose() * n).normalize()
    }

    /// Returns the rounding constant ([`Surface::rounding`](super::ray::Surface::rounding)) of a surface in
    /// an instance.
    #[inline]
    pub(super) fn rounding(&self, own: f32) -> f32 {
        rounding::placed(own, self.stretch(), stretch(self.to_local))
    }

    #[inline]
    pub(super) fn mirrors(&self) -> bool {
        self.to_world.determinant() < 0.0
    }
}

/// Returns an upper bound on the length of any unit vector after transformation by the map `m`.
pub(super) fn stretch(m: Mat3A) -> f32 {
    // The Frobenius norm bounds the spectral norm.
    (m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()).sqrt()
}

//! Rays, hits and surface points.

use glam::{Mat3A, Vec3A};
use std::num::NonZeroU32;

/// A ray. Distances along the ray are in metres.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Origin in world space, metres.
    pub origin: Vec3A,
    /// Direction, a unit vector.
    pub dir: Vec3A,
}

/// A hit of a ray, from which the surface point can be computed.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Distance along the ray, metres.
    pub t: f32,
    /// Index of the primitive in BVH leaf order.
    pub leaf: u32,
    /// The world or the instance that contains the primitive.
    pub owner: Owner,
    /// Barycentric coordinate of the triangle's second vertex (0 for quadrics).
    pub u: f32,
    /// Barycentric coordinate of the triangle's third vertex (0 for quadrics).
    pub v: f32,
}

/// Owner of a primitive: the world or an instance. The stored value is never 0, so that `Option<Hit>` is not
/// larger than `Hit`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Owner(NonZeroU32);

impl Owner {
    pub const WORLD: Self = Self(NonZeroU32::MIN);

    /// Returns the owner for the instance with index `number`, which must be below 2³¹.
    #[inline]
    pub const fn instance(number: u32) -> Self {
        Self(NonZeroU32::MIN.saturating_add(number).saturating_add(1))
    }

    /// Returns the index of the instance that owns the primitive, or `None` for the world.
    #[inline(always)]
    pub fn number(self) -> Option<u32> {
        self.0.get().checked_sub(2)
    }
}

/// A point on a surface.
#[derive(Clone, Copy, Debug, Default)]
pub struct Surface {
    /// Position in world space, metres.
    pub p: Vec3A,
    /// Unit geometric normal, which points to the outside of the shape (by winding or by definition).
    pub ng: Vec3A,
    /// Unit shading normal, in the hemisphere of `ng`.
    pub ns: Vec3A,
    /// Direction of increasing texture coordinate u (∂p/∂u). The vector is not normalized and not exactly
    /// perpendicular to `ns` (see [`Surface::tangent_frame`]).
    pub tangent: Vec3A,
    /// ∂p/∂v if the scene has bump maps, otherwise 0. In scenes with bump maps, the length of `tangent` is
    /// that of ∂p/∂u.
    pub bitangent: Vec3A,
    pub uv: [f32; 2],
    pub material: u32,
    /// Maximum rounding error of surface points and hits, in units of 2⁻²⁴ times their coordinates.
    pub rounding: f32,
}

impl Surface {
    /// Returns the orthonormal frame with axes x (along ∂p/∂u), y, and z = `ns`. The frame maps local
    /// directions to the world. Angles of polarizing elements and normal maps are relative to the tangent
    /// frame.
    #[inline]
    pub fn tangent_frame(&self) -> Mat3A {
        let x = optics::polarization::frame::project(self.tangent, self.ns);
        Mat3A::from_cols(x, self.ns.cross(x), self.ns)
    }
}

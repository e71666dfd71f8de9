//! Rays, and hits before anything but their distance is known.

use glam::{Mat3A, Vec3A};
use std::num::NonZeroU32;

/// A ray; `dir` is a unit vector, distances are metres.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it starts, world, metres.
    pub origin: Vec3A,
    /// Where it goes, a unit vector.
    pub dir: Vec3A,
}

/// The nearest hit of a ray: enough to find the rest.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Distance along the ray, metres.
    pub t: f32,
    /// Index of the primitive in BVH leaf order.
    pub leaf: u32,
    /// What the primitive belongs to.
    pub owner: Owner,
    /// Barycentric coordinate of a triangle's second vertex (0 for quadrics).
    pub u: f32,
    /// Barycentric coordinate of a triangle's third vertex (0 for quadrics).
    pub v: f32,
}

/// What a primitive belongs to: the world itself, or an instance. Never 0, so that a hit and no hit take no more room.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Owner(NonZeroU32);

impl Owner {
    /// The world itself.
    pub const WORLD: Self = Self(NonZeroU32::MIN);

    /// The instance of a number, below 2³¹.
    #[inline]
    #[must_use]
    pub const fn instance(number: u32) -> Self {
        Self(NonZeroU32::MIN.saturating_add(number).saturating_add(1))
    }

    /// The instance's number; `None` for the world itself.
    #[inline(always)]
    #[must_use]
    pub fn number(self) -> Option<u32> {
        self.0.get().checked_sub(2)
    }
}

/// A point on a surface.
#[derive(Clone, Copy, Debug, Default)]
pub struct Surface {
    /// Position, metres.
    pub p: Vec3A,
    /// Unit geometric normal, toward the outside of the shape (by winding or by definition).
    pub ng: Vec3A,
    /// Unit shading normal, in the hemisphere of `ng`.
    pub ns: Vec3A,
    /// Direction in which the texture coordinate u grows (∂p/∂u), neither unit nor exactly perpendicular to `ns`; see
    /// [`Surface::tangent_frame`].
    pub tangent: Vec3A,
    /// ∂p/∂v, and `tangent` is then ∂p/∂u in length too, in scenes with bump maps; else 0.
    pub bitangent: Vec3A,
    /// Texture coordinates.
    pub uv: [f32; 2],
    /// Index of the material.
    pub material: u32,
    /// How far rounding may put points and hits off the surface, in units of 2⁻²⁴ of their coordinates.
    pub rounding: f32,
}

impl Surface {
    /// Orthonormal x (along ∂p/∂u), y and z = `ns`: what element angles and normal maps count from. Columns take local
    /// directions to the world.
    #[inline]
    #[must_use]
    pub fn tangent_frame(&self) -> Mat3A {
        let x = optics::polarization::frame::project(self.tangent, self.ns);
        Mat3A::from_cols(x, self.ns.cross(x), self.ns)
    }
}

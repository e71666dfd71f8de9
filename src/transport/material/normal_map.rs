//! Bump maps and normal maps: an image perturbs the shading normal of another material.
//!
//! A bump map contains heights along the shading normal n, in units of `strength` metres. The surface
//! derivatives become ∂p/∂u + n ∂h/∂u and ∂p/∂v + n ∂h/∂v. The new normal is perpendicular to both
//! derivatives (Blinn 1978, "Simulation of wrinkled surfaces"; Mitsuba's `bumpmap`).
//!
//! A normal map contains unit vectors in the tangent frame (x along ∂p/∂u, z along the shading normal). Each
//! component c is stored as (c + 1)/2 (Cohen et al. 1998), with +y up as in OpenGL.

use super::Materials;
use crate::geometry::ray::Surface;
use glam::Vec3A;

/// Another material with perturbed normals.
#[derive(Clone, Copy, Debug)]
pub struct NormalMap {
    pub material: u32,
    /// Index of the image. The first three channels of a normal map are x, y, z. The first channel of a bump
    /// map is the height.
    pub texture: u32,
    /// For a normal map, the factor that multiplies x and y. A factor of 0 gives the shading normal, and 1
    /// gives the stored normals. For a bump map, the height in metres for the image value 1.
    pub strength: f32,
    /// True for a bump map, false for a normal map.
    pub heights: bool,
}

/// Minimum cosine between the perturbed normal and the geometric normal.
const LEAST_COS: f32 = 0.02;

impl NormalMap {
    /// Returns the surface with the perturbed normal. The perturbed normal stays on the side of the geometric
    /// normal.
    #[inline]
    pub(super) fn turned(&self, materials: &Materials, at: &Surface) -> Surface {
        let mut n = if self.heights { self.raised(materials, at) } else { self.stored(materials, at) };
        let cos = n.dot(at.ng);
        if cos < LEAST_COS {
            n = (n + at.ng * (LEAST_COS - cos)).normalize_or(at.ng);
        }
        Surface { ns: n, ..*at }
    }

    /// Returns the perturbed normal of a bump map.
    fn raised(&self, materials: &Materials, at: &Surface) -> Vec3A {
        let slope = materials.textures.gradient(self.texture, at.uv);
        let [u, v] = [(at.tangent, slope[0]), (at.bitangent, slope[1])]
            .map(|(along, slope)| along + at.ns * (slope * self.strength - at.ns.dot(along)));
        let n = u.cross(v).normalize_or(at.ns);
        if n.dot(at.ns) < 0.0 { -n } else { n }
    }

    /// Returns the perturbed normal of a normal map.
    #[inline]
    fn stored(&self, materials: &Materials, at: &Surface) -> Vec3A {
        let [x, y, z, _] = materials.textures.eval(self.texture, at.uv).to_array();
        let local = Vec3A::new(
            (2.0 * x - 1.0) * self.strength,
            (2.0 * y - 1.0) * self.strength,
            (2.0 * z - 1.0).max(0.0),
        );
        (at.tangent_frame() * local).normalize_or(at.ns)
    }
}

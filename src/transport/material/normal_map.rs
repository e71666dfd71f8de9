//! Normals from an image: a material on a surface whose shading normal is turned by what the image says.
//!
//! Of a bump map the image holds heights along the shading normal n, metres times a factor: the surface's derivatives along its texture
//! coordinates become ∂p/∂u + n ∂h/∂u and ∂p/∂v + n ∂h/∂v, and the normal is across both (Blinn 1978, "Simulation of wrinkled
//! surfaces"; Mitsuba's `bumpmap`). Of a normal map the image holds unit vectors in the tangent frame (x along ∂p/∂u, y, z along the shading normal), each coordinate c
//! stored as (c + 1)/2 (Cohen et al. 1998; OpenGL's green-up variant).

use super::lanes::Lanes;
use super::lobe::{Lobe, Sampled, Specular};
use super::parts::Parts;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;

/// Another material under turned normals.
#[derive(Clone, Copy, Debug)]
pub struct NormalMap {
    /// Number of the material.
    pub material: u32,
    /// Index of the image; its first three channels are x, y, z, or the first is a height.
    pub texture: u32,
    /// Multiplies x and y: 0 flattens, 1 is as stored. Of heights: metres where the image is 1.
    pub strength: f32,
    /// It is a bump map.
    pub heights: bool,
}

/// Least cosine between the turned normal and the true one.
const LEAST_COS: f32 = 0.02;

impl NormalMap {
    /// The surface with its turned normal, which stays on the true normal's side.
    #[inline]
    pub(super) fn turned(&self, materials: &impl Parts, at: &Surface) -> Surface {
        let mut n = if self.heights {
            self.raised(materials, at)
        } else {
            self.stored(materials, at)
        };
        let cos = n.dot(at.ng);
        if cos < LEAST_COS {
            n = (n + at.ng * (LEAST_COS - cos)).normalize_or(at.ng);
        }
        Surface { ns: n, ..*at }
    }

    /// The normal of a surface with heights on it.
    fn raised(&self, materials: &impl Parts, at: &Surface) -> Vec3A {
        let slope = materials.textures().gradient(self.texture, at.uv);
        let [u, v] = [(at.tangent, slope[0]), (at.bitangent, slope[1])]
            .map(|(along, slope)| along + at.ns * (slope * self.strength - at.ns.dot(along)));
        let n = u.cross(v).normalize_or(at.ns);
        if n.dot(at.ns) < 0.0 { -n } else { n }
    }

    /// The normal that the image says.
    #[inline]
    fn stored(&self, materials: &impl Parts, at: &Surface) -> Vec3A {
        let [x, y, z, _] = materials.textures().eval(self.texture, at.uv).to_array();
        let local = Vec3A::new(
            (2.0 * x - 1.0) * self.strength,
            (2.0 * y - 1.0) * self.strength,
            (2.0 * z - 1.0).max(0.0),
        );
        (at.tangent_frame() * local).normalize_or(at.ns)
    }

    /// See [`Parts::eval`].
    #[inline]
    #[must_use]
    pub fn eval(&self, materials: &impl Parts, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        materials.eval(self.material, &self.turned(materials, at), wo, wi)
    }

    /// See [`Parts::pdf`].
    #[inline]
    #[must_use]
    pub fn pdf(&self, materials: &impl Parts, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        materials.pdf(self.material, &self.turned(materials, at), wo, wi)
    }

    /// See [`Parts::sample`].
    #[inline]
    pub fn sample(
        &self,
        materials: &impl Parts,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        materials.sample(self.material, &self.turned(materials, at), wo, lanes, stream)
    }

    /// See [`Parts::specular`].
    #[inline]
    #[must_use]
    pub fn specular(
        &self,
        materials: &impl Parts,
        at: &Surface,
        wo: Vec3A,
        lobe: Lobe,
        lane: usize,
    ) -> Option<Specular> {
        materials.specular(self.material, &self.turned(materials, at), wo, lobe, lane)
    }
}

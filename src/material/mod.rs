//! Polarimetric BRDFs: one a file, dispatched by enum over plain data.
//!
//! Directions: `wo` points to where light goes (the camera side), `wi` to where it comes from, both away from the
//! surface and of unit length, in world space. Everything is Σ over the projected solid angle of `wi`: values include
//! |cosθ_i|. Opaque materials are two-sided: the shading normal is turned toward `wo`.

pub mod conductor;
pub mod dielectric;
pub mod diffuse;
pub mod rough_conductor;

use crate::geometry::ray::Surface;
use crate::polarization::chain::Scatter;
use crate::sampling::stream::Stream;
use crate::spectrum::Spectral;
use glam::Vec3A;

/// A material as the tracer sees it.
#[derive(Clone, Copy, Debug)]
pub enum Material {
    Diffuse(diffuse::Diffuse),
    Conductor(conductor::Conductor),
    RoughConductor(rough_conductor::RoughConductor),
    Dielectric(dielectric::Dielectric),
}

/// Albedo images: spectral texels of all textures in one table.
#[derive(Clone, Debug, Default)]
pub struct Textures {
    /// Width, height and first texel of every texture.
    pub images: Vec<(u32, u32, u32)>,
    /// Texels, top row first.
    pub texels: Vec<[f32; 4]>,
}

impl Textures {
    /// Bilinear, repeating; uv (0, 0) is the lower left corner of the image.
    #[inline]
    #[must_use]
    pub fn eval(&self, texture: u32, uv: [f32; 2]) -> Spectral {
        let (w, h, first) = self.images[texture as usize];
        let x = uv[0].rem_euclid(1.0) * w as f32 - 0.5;
        let y = (1.0 - uv[1].rem_euclid(1.0)) * h as f32 - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let at = |i: f32, j: f32| {
            let i = (i as i64).rem_euclid(i64::from(w)) as u32;
            let j = (j as i64).rem_euclid(i64::from(h)) as u32;
            Spectral::new(self.texels[(first + j * w + i) as usize])
        };
        let lerp = |a: Spectral, b: Spectral, t: f32| a + (b - a) * Spectral::splat(t);
        let top = lerp(at(x0, y0), at(x0 + 1.0, y0), fx);
        let bottom = lerp(at(x0, y0 + 1.0), at(x0 + 1.0, y0 + 1.0), fx);
        lerp(top, bottom, fy)
    }
}

/// One sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct Sampled {
    /// Where light comes from.
    pub wi: Vec3A,
    /// Interaction divided by the density of `wi` (and by the probability of its lobe).
    pub scatter: Scatter,
    /// True if `wi` came from a delta lobe.
    pub delta: bool,
    /// Refractive index of the medium that `wi` lies in, where light crossed an interface.
    pub medium: Option<f32>,
}

/// The wavelength lanes that a path still carries: dispersion leaves one of them.
#[derive(Clone, Copy, Debug)]
pub struct Lanes {
    /// Bit i: lane i is alive.
    pub mask: u8,
}

impl Lanes {
    /// The first `n` lanes.
    #[must_use]
    pub fn first(n: usize) -> Self {
        Self {
            mask: ((1_u16 << n) - 1) as u8,
        }
    }

    /// How many lanes are alive.
    #[inline]
    #[must_use]
    pub fn count(self) -> u32 {
        self.mask.count_ones()
    }

    /// The `k`-th living lane.
    #[inline]
    #[must_use]
    pub fn nth(self, k: u32) -> usize {
        let mut left = k;
        (0..4)
            .find(|i| {
                let alive = self.mask >> i & 1 == 1;
                let found = alive && left == 0;
                if alive && left > 0 {
                    left -= 1;
                }
                found
            })
            .unwrap_or(0)
    }
}

/// The shading normal on the side of `wo`, or `None` if shading and geometry disagree about that side.
#[inline]
fn facing(surface: &Surface, wo: Vec3A) -> Option<Vec3A> {
    let side = surface.ng.dot(wo);
    let n = if side < 0.0 { -surface.ns } else { surface.ns };
    (n.dot(wo) > 0.0).then_some(n)
}

/// True if `wi` leaves on the same side of the true surface as `wo`.
#[inline]
fn same_side(surface: &Surface, wo: Vec3A, wi: Vec3A) -> bool {
    surface.ng.dot(wo) * surface.ng.dot(wi) > 0.0
}

/// The frame vector s of a reflection or refraction: perpendicular to the plane of `a` and `b`.
#[inline]
fn s_vector(a: Vec3A, b: Vec3A) -> Vec3A {
    let s = a.cross(b);
    let n2 = s.length_squared();
    if n2 > 1e-12 {
        s * n2.sqrt().recip()
    } else {
        crate::polarization::frame::perpendicular(b)
    }
}

impl Material {
    /// True if light can reach `wo` from other than finitely many directions, so that it can be lit by a point.
    #[inline]
    #[must_use]
    pub fn is_smooth(&self) -> bool {
        matches!(self, Self::Diffuse(_) | Self::RoughConductor(_))
    }

    /// Mueller BRDF times |cosθ_i|, W/W per projected solid angle; `None` where it is zero.
    #[inline]
    #[must_use]
    pub fn eval(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        match self {
            Self::Diffuse(m) => m.eval(textures, at, wo, wi),
            Self::RoughConductor(m) => m.eval(at, wo, wi),
            Self::Conductor(_) | Self::Dielectric(_) => None,
        }
    }

    /// Density of [`Self::sample`] per solid angle of `wi`; 0 for delta lobes.
    #[must_use]
    pub fn pdf(&self, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        match self {
            Self::Diffuse(_) => diffuse::pdf(at, wo, wi),
            Self::RoughConductor(m) => m.pdf(at, wo, wi),
            Self::Conductor(_) | Self::Dielectric(_) => 0.0,
        }
    }

    /// Samples where the light at `wo` comes from; `None` if it is absorbed.
    #[inline]
    pub fn sample(
        &self,
        textures: &Textures,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        match self {
            Self::Diffuse(m) => m.sample(textures, at, wo, stream),
            Self::Conductor(m) => m.sample(at, wo),
            Self::RoughConductor(m) => m.sample(at, wo, stream),
            Self::Dielectric(m) => m.sample(at, wo, lanes, stream),
        }
    }
}

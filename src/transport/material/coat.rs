//! Transmission of light into and out of a dielectric coat, through the mean surface or through facets.
//!
//! The body of [`super::plastic`] is illuminated through the coat. There are three models of the power
//! transmittance at angle θ:
//!
//! - smooth: the Fresnel transmittance of the mean surface, for any roughness (Baek et al. 2018; Mitsuba's
//!   `pplastic`);
//! - facets: the fraction T(θ) = 1 - E(θ) of light that the facets do not reflect, where E is the directional
//!   albedo of the coat. A coat over a white body reflects all light;
//! - single passage: the fraction of light that one facet refracts and no other facet masks. Inside, only the
//!   light that a single facet reflects is included (Mitsuba's `roughplastic`). The model loses light that
//!   hits a second facet: 2 % of the light at α = 0.1, and two thirds at α = 1.
//!
//! Let D_v be the density of the normals h that are visible from `wo`. The directional albedo is E = ∫ D_v
//! F(wo·h) G2/G1 dh, and the single-passage transmittance is T_single = ∫ D_v (1 - F(wo·h)) G1(wt) dh. The
//! diattenuation of the transmission is also a mean over facets: Σ D_v T_b(wo·h) cos 2φ, where φ is the angle
//! between the planes of incidence.
//!
//! The transmittance and the diattenuation are tabulated over cosθ, and over α if α is an image. The tables
//! are the texels of two [`Textures`] images.

use super::facets::{Roughness, refract};
use super::texture::{Filter, Image, Textures, Wrap};
use glam::Vec3A;
use optics::polarization::fresnel;
use optics::polarization::fresnel::FresnelBlock;
use optics::sampling::microfacet::{Masking, Microfacet};
use optics::spectrum::Spectral;

/// Models of transmission through a coat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Passage {
    /// Fresnel transmission of the smooth mean surface.
    #[default]
    Smooth,
    /// Transmission of all light that the facets do not reflect.
    Facets,
    /// Transmission through a single facet.
    Single,
}

/// Number of columns of a table, one per value of cosθ.
const COSINES: u32 = 64;
/// Number of rows of a table, one per value of α.
const ALPHAS: u32 = 16;
/// Number of sampled directions per dimension for one table entry.
const DRAWN: u32 = 32;
/// Number of sampled directions per dimension inside the coat, where total internal reflection makes the
/// integrand discontinuous.
const DRAWN_INSIDE: u32 = 64;

/// Power transmission of a coat, as elements M00 and M01, in the frame whose axis is perpendicular to the
/// plane of incidence.
#[derive(Clone, Copy, Debug)]
pub struct Passed {
    /// M00, the transmittance of unpolarized light.
    pub a: Spectral,
    /// M01, the product of diattenuation and transmittance.
    pub b: Spectral,
}

impl From<FresnelBlock> for Passed {
    #[inline]
    fn from(f: FresnelBlock) -> Self {
        Self { a: f.a, b: f.b }
    }
}

/// Tables of the transmission of a rough coat.
#[derive(Clone, Copy, Debug)]
pub struct Table {
    /// Indices of the images of M00 and M01.
    images: [u32; 2],
    /// True for the single-passage model, false for the facets model.
    pub single: bool,
}

impl Table {
    /// Returns the transmission at cosine `cos` > 0 and roughness α.
    #[inline]
    pub fn at(&self, textures: &Textures, cos: f32, alpha: f32) -> Passed {
        let [a, b] = self.images.map(|image| textures.eval(image, [cos, alpha]));
        Passed { a, b }
    }

    /// Tabulates a coat with relative index `eta` (1 in unused lanes) and adds the tables to `textures`.
    pub fn new(textures: &mut Textures, roughness: &Roughness, eta: Spectral, single: bool) -> Self {
        let rows = if roughness.alpha.texture.is_some() { ALPHAS } else { 1 };
        let mut entries = vec![];
        for row in 0..rows {
            // Texture coordinate v increases from the last row to the first.
            let alpha = match rows {
                1 => roughness.alpha.value,
                _ => 1.0 - (row as f32 + 0.5) / rows as f32,
            };
            let model = model(roughness, alpha);
            for column in 0..COSINES {
                entries.push(passed(&model, eta, (column as f32 + 0.5) / COSINES as f32, single));
            }
        }
        let images = [|p: &Passed| p.a, |p: &Passed| p.b].map(|element| {
            let first = textures.texels.len() as u32;
            textures.texels.extend(entries.iter().map(|p| element(p).to_array()));
            textures.images.push(Image {
                wrap: Wrap::Clamp,
                filter: Filter::Bilinear,
                ..Image::new([COSINES, rows], first)
            });
            textures.images.len() as u32 - 1
        });
        Self { images, single }
    }
}

fn model(roughness: &Roughness, alpha: f32) -> Microfacet {
    Microfacet {
        distribution: roughness.distribution,
        masking: roughness.masking,
        alpha: alpha.max(super::facets::LEAST_ALPHA),
    }
}

/// Returns the unit vector in the plane y = 0 whose z component is `cos`.
fn toward(cos: f32) -> Vec3A {
    Vec3A::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos)
}

/// Calls `f` for facet normals h that are visible from `wo`, sampled on an n × n grid.
fn over_visible(model: &Microfacet, wo: Vec3A, n: u32, mut f: impl FnMut(Vec3A)) {
    for i in 0..n * n {
        let u = [i % n, i / n].map(|k| (k as f32 + 0.5) / n as f32);
        f(model.visible_normal(wo, u));
    }
}

/// Returns the directional albedo of the coat: the fraction of power that the facets reflect at cosine `cos`.
pub fn reflected(model: &Microfacet, eta: Spectral, cos: f32, n: u32) -> Spectral {
    let wo = toward(cos);
    let g1 = model.g1(wo);
    let mut sum = Spectral::ZERO;
    over_visible(model, wo, n, |h| {
        let wi = super::facets::reflect(wo, h);
        if wi.z > 0.0 {
            let kept = model.g2(wo, wi) / g1;
            sum += fresnel::dielectric(wo.dot(h), eta).reflection.a * Spectral::splat(kept);
        }
    });
    sum / Spectral::splat((n * n) as f32)
}

/// Returns the transmission through the facets at cosine of incidence `cos`.
fn passed(model: &Microfacet, eta: Spectral, cos: f32, single: bool) -> Passed {
    let wo = toward(cos);
    let (mut a, mut b) = (Spectral::ZERO, Spectral::ZERO);
    over_visible(model, wo, DRAWN, |h| {
        let cos = wo.dot(h);
        let mut through = fresnel::dielectric(cos, eta).transmission;
        if single {
            // The refracted direction depends on wavelength.
            let kept = eta.to_array().map(|eta| match refract(wo, h, eta) {
                Some(wt) if wt.z < 0.0 => model.g1(wt),
                _ => 0.0,
            });
            through = through.scaled(Spectral::new(kept));
        }
        a += through.a;
        // The angle from the s direction of the mean surface (y) to the s direction of the facet is φ.
        // Compute cos 2φ.
        let s = h.cross(wo);
        let length2 = s.length_squared();
        if length2 > 1e-12 {
            b += through.b * Spectral::splat(2.0 * s.y * s.y / length2 - 1.0);
        }
    });
    let count = Spectral::splat((DRAWN * DRAWN) as f32);
    Passed {
        a: if single { a / count } else { Spectral::ONE - reflected(model, eta, cos, DRAWN) },
        b: b / count,
    }
}

/// Returns ∫ R(θ) 2 cosθ d(cosθ), the fraction of a Lambertian body's light that the coat reflects back.
///
/// The result is for a single α. If α is an image, the result is for half of the image's factor. In the
/// facets model, the result is computed from outside directions by reciprocity. An integral over inside
/// directions is not needed.
pub fn internal_reflectance(roughness: &Roughness, eta: Spectral, passage: Passage) -> Spectral {
    if passage == Passage::Smooth {
        return smooth_internal_reflectance(eta);
    }
    let alpha = roughness.alpha;
    let model = model(roughness, if alpha.texture.is_some() { 0.5 * alpha.value } else { alpha.value });
    let mut sum = Spectral::ZERO;
    if passage == Passage::Single {
        let inside = Microfacet {
            // Inside the coat, the two directions are masked independently (Walter et al. 2007).
            masking: Masking::Separable,
            ..model
        };
        // Use Mitsuba's quadrature. The cosines of this quadrature include both endpoints. As a result, 1 - F
        // is 2 % too low at small α.
        for k in 0..COSINES {
            let cos = (k as f32 / (COSINES - 1) as f32).max(1e-6);
            let weight = Spectral::splat(2.0 * cos / COSINES as f32);
            sum += weight * reflected(&inside, Spectral::ONE / eta, cos, DRAWN_INSIDE);
        }
        return sum;
    }
    for column in 0..COSINES {
        let cos = (column as f32 + 0.5) / COSINES as f32;
        let weight = Spectral::splat(2.0 * cos / COSINES as f32);
        sum += weight * (Spectral::ONE - reflected(&model, eta, cos, DRAWN));
    }
    Spectral::ONE - sum / (eta * eta)
}

/// Returns ∫ R(θ) 2 cosθ d(cosθ) for light inside an interface with relative index `eta`. The error of the
/// midpoint rule is at most 1e-6.
pub fn smooth_internal_reflectance(eta: Spectral) -> Spectral {
    const N: u32 = 4096;
    // Integrate over outside angles, because this integrand is smooth: (1 - F) η² = ∫ T(θ) 2 cosθ d(cosθ).
    // The integrand over inside angles is not smooth, because of total internal reflection.
    let mut sum = Spectral::ZERO;
    for k in 0..N {
        let cos = (k as f32 + 0.5) / N as f32;
        sum += fresnel::dielectric(cos, eta).transmission.a * Spectral::splat(2.0 * cos / N as f32);
    }
    Spectral::ONE - sum / (eta * eta)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::texture::Scalar;
    use optics::sampling::microfacet::Distribution;

    fn rough(alpha: f32, masking: Masking) -> Roughness {
        Roughness { distribution: Distribution::Ggx, masking, alpha: Scalar::uniform(alpha) }
    }

    /// Verifies that facets with small α transmit light as Fresnel's equations predict for the mean surface.
    #[test]
    fn smooth_facets_transmit_like_the_mean_surface() {
        let eta = Spectral::splat(1.5);
        let smooth = rough(0.002, Masking::Correlated);
        for single in [false, true] {
            let mut textures = Textures::default();
            let table = Table::new(&mut textures, &smooth, eta, single);
            for cos in [0.1_f32, 0.3, 0.6, 0.95] {
                let got = table.at(&textures, cos, 0.002);
                let want = fresnel::dielectric(cos, eta).transmission;
                for (got, want) in [(got.a, want.a), (got.b, want.b)] {
                    let (got, want) = (got.to_array()[0], want.to_array()[0]);
                    assert!((got - want).abs() < 2e-3, "cos {cos}: {got}, not {want}");
                }
            }
        }
        for passage in [Passage::Facets, Passage::Single] {
            let got = internal_reflectance(&smooth, eta, passage).to_array()[0];
            let want = smooth_internal_reflectance(eta).to_array()[0];
            assert!((got - want).abs() < 1.2e-2, "{passage:?}: {got}, not {want}");
        }
    }

    /// Compares the single-passage model (GGX, relative index 1.49) with Mitsuba 3.9.1, evaluated with 65,536
    /// normals. The reference functions are `eval_transmittance` and `eval_reflectance`, whose values
    /// `roughplastic` tabulates.
    #[test]
    fn a_single_passage_matches_roughplastic() {
        let eta = Spectral::splat(1.49);
        for (alpha, inside, through) in [
            (0.1_f32, 0.554_f32, [0.961_f32, 0.948, 0.908, 0.689]),
            (0.4, 0.348, [0.949, 0.915, 0.868, 0.728]),
            (1.0, 0.116, [0.883, 0.764, 0.652, 0.424]),
        ] {
            let r = rough(alpha, Masking::Separable);
            let mut textures = Textures::default();
            let table = Table::new(&mut textures, &r, eta, true);
            for (degrees, want) in [0.5_f32, 45.0, 60.0, 80.0].into_iter().zip(through) {
                let cos = degrees.to_radians().cos();
                let got = table.at(&textures, cos, alpha).a.to_array()[0];
                assert!((got - want).abs() < 4e-3, "α {alpha}, {degrees}°: {got}, not {want}");
            }
            let got = internal_reflectance(&r, eta, Passage::Single).to_array()[0];
            assert!((got - inside).abs() < 1e-2, "α {alpha}: {got}, not {inside}");
        }
    }

    /// Verifies that M01 never exceeds M00.
    #[test]
    fn passages_are_realizable() {
        for distribution in [Distribution::Ggx, Distribution::Beckmann] {
            for alpha in [0.001, 0.05, 0.3, 1.0] {
                for single in [false, true] {
                    let r = Roughness { distribution, ..rough(alpha, Masking::Correlated) };
                    for cos in [0.01, 0.2, 0.7, 1.0] {
                        let p = passed(&model(&r, alpha), Spectral::splat(1.6), cos, single);
                        let (a, b) = (p.a.to_array()[0], p.b.to_array()[0]);
                        assert!(a > 0.0 && a <= 1.0 && b.abs() <= a, "α {alpha}, cos {cos}: {a}, {b}");
                    }
                }
            }
        }
    }
}

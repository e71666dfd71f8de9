//! Smooth dielectric interface: reflection and refraction, chosen by their power.
//!
//! Radiance is scaled by the squared ratio of the indices when it crosses. Where the index depends on wavelength,
//! refracted wavelengths part ways: one of them, drawn uniformly, goes on and carries the weight of all (Wilkie et al.
//! 2014, "Hero wavelength spectral sampling"); reflection keeps them all.

use super::{Lanes, Sampled, s_vector};
use crate::geometry::ray::Surface;
use crate::polarization::chain::Scatter;
use crate::polarization::fresnel;
use crate::sampling::stream::Stream;
use crate::spectrum::Spectral;
use glam::Vec3A;

/// Smooth interface between the inside of a closed surface and what is outside it.
#[derive(Clone, Copy, Debug)]
pub struct Dielectric {
    /// Refractive index inside per wavelength (1 in unused lanes).
    pub interior: Spectral,
    /// Refractive index outside per wavelength (1 in unused lanes).
    pub exterior: Spectral,
    /// True if a living lane's index differs from another's.
    pub dispersive: bool,
}

impl Dielectric {
    /// See [`super::Material::sample`].
    #[inline]
    pub fn sample(&self, at: &Surface, wo: Vec3A, lanes: &mut Lanes, stream: &mut Stream) -> Option<Sampled> {
        let outside = at.ng.dot(wo) > 0.0;
        let n = if outside { at.ns } else { -at.ns };
        let cos_o = n.dot(wo);
        if cos_o <= 0.0 {
            return None;
        }
        // Index on the side of `wo`, and on the other.
        let (near, far) = if outside {
            (self.exterior, self.interior)
        } else {
            (self.interior, self.exterior)
        };
        let eta = far / near;
        let f = fresnel::dielectric(cos_o, eta);
        let reflectances = f.reflection.a.to_array();
        let alive = lanes.count().max(1);
        let mean = (0..alive).map(|k| reflectances[lanes.nth(k)]).sum::<f32>() / alive as f32;
        let s = s_vector(n, wo);
        if stream.uniform() < mean {
            let wi = (n * (2.0 * cos_o) - wo).normalize();
            return (at.ng.dot(wi) * at.ng.dot(wo) > 0.0).then(|| Sampled {
                wi,
                scatter: Scatter::Fresnel {
                    block: f.reflection.scaled(Spectral::splat(1.0 / mean)),
                    s,
                },
                delta: true,
                medium: None,
            });
        }
        let mut weight = Spectral::splat(1.0 / (1.0 - mean));
        let mut lane = lanes.nth(0);
        if self.dispersive && alive > 1 {
            lane = lanes.nth(((stream.uniform() * alive as f32) as u32).min(alive - 1));
            lanes.mask = 1 << lane;
            let mut hero = [0.0; 4];
            hero[lane] = alive as f32;
            weight *= Spectral::new(hero);
        }
        let eta_lane = eta.to_array()[lane];
        let sin2_t = (1.0 - cos_o * cos_o) / (eta_lane * eta_lane);
        if sin2_t >= 1.0 {
            return None;
        }
        let cos_t = (1.0 - sin2_t).sqrt();
        let wi = (n * (cos_o / eta_lane - cos_t) - wo * (1.0 / eta_lane)).normalize();
        if at.ng.dot(wi) * at.ng.dot(wo) >= 0.0 {
            return None;
        }
        // Radiance per squared index is what travels unchanged; power transmittance is the same both ways.
        let scale = weight / (eta * eta);
        Some(Sampled {
            wi,
            scatter: Scatter::Fresnel {
                block: f.transmission.scaled(scale),
                s,
            },
            delta: true,
            medium: Some(far.to_array()[lane]),
        })
    }
}

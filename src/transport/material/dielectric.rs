//! Smooth dielectric interface. Reflection and refraction are sampled in proportion to power.
//!
//! Refraction scales radiance by the squared ratio of the indices. If the index depends on wavelength,
//! refraction separates the wavelengths. The path then continues with a single, uniformly sampled wavelength,
//! which represents all wavelengths (Wilkie et al. 2014, "Hero wavelength spectral sampling"). Reflection
//! keeps all wavelengths.

use super::facets::{reflect, refract};
use super::filling::Filling;
use super::lanes::Lanes;
use super::lobe::{Lobe, Sampled, Specular};
use super::side::{facing, s_vector, same_side};
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::fresnel;
use optics::polarization::fresnel::DielectricFresnel;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// Smooth interface between the inside and the outside of a closed surface.
#[derive(Clone, Copy, Debug)]
pub struct Dielectric {
    /// Refractive index inside per wavelength (1 in unused lanes).
    pub interior: Spectral,
    /// Refractive index outside per wavelength (1 in unused lanes).
    pub exterior: Spectral,
    /// True if the index differs between used lanes.
    pub dispersive: bool,
}

/// An interface at one point for light that leaves along `wo`.
pub(super) struct Interface {
    /// Shading normal, on the side of `wo`.
    n: Vec3A,
    wo: Vec3A,
    /// Index on the far side. `eta` is `far` divided by the index on the near side.
    far: Spectral,
    eta: Spectral,
    fresnel: DielectricFresnel,
}

/// Returns the direction from which light is refracted into direction `wo`. `eta` is the index on the far
/// side divided by the index on the near side. Returns `None` under total internal reflection, or if shading
/// and geometric normals disagree about the side.
#[inline]
fn through(at: &Surface, n: Vec3A, wo: Vec3A, eta: f32) -> Option<Vec3A> {
    let wi = refract(wo, n, eta)?.normalize();
    (at.ng.dot(wi) * at.ng.dot(wo) < 0.0).then_some(wi)
}

impl Interface {
    /// Returns the reflected or transmitted lobe. The refracted direction is that of wavelength `lane`.
    #[inline]
    pub(super) fn specular(&self, at: &Surface, lobe: Lobe, lane: usize) -> Option<Specular> {
        let Self { n, wo, .. } = *self;
        let s = s_vector(n, wo);
        if lobe == Lobe::Reflected {
            let wi = reflect(wo, n).normalize();
            return same_side(at, wo, wi).then_some(Specular {
                wi,
                scatter: Scatter::Fresnel { block: self.fresnel.reflection, s },
                filling: None,
            });
        }
        // Radiance divided by the squared index is invariant. Light in opposite directions has equal
        // transmittance.
        Some(Specular {
            wi: through(at, n, wo, self.eta.to_array()[lane])?,
            scatter: Scatter::Fresnel {
                block: self.fresnel.transmission.scaled(Spectral::ONE / (self.eta * self.eta)),
                s,
            },
            filling: Some(Filling::clear(self.far.to_array()[lane])),
        })
    }
}

impl Dielectric {
    /// Returns the index on the side of `wo`, then the index on the other side.
    #[inline]
    pub(super) fn sides(&self, at: &Surface, wo: Vec3A) -> (Spectral, Spectral) {
        if at.ng.dot(wo) > 0.0 { (self.exterior, self.interior) } else { (self.interior, self.exterior) }
    }

    /// Returns the medium on the side opposite `wo`.
    #[inline]
    pub fn beyond(&self, at: &Surface, wo: Vec3A, lanes: Lanes) -> Filling {
        Filling::clear(self.sides(at, wo).1.to_array()[lanes.nth(0)])
    }

    /// Returns the direction on the far side from which light is refracted into direction `wo`. In addition,
    /// returns the index on the side of `wo` divided by the index on the far side. Returns `None` under total
    /// internal reflection, or if shading and geometric normals disagree.
    #[inline]
    pub(super) fn refracted(&self, at: &Surface, wo: Vec3A, lane: usize) -> Option<(Vec3A, f32)> {
        let n = facing(at, wo)?;
        let (near, far) = self.sides(at, wo);
        let (near, far) = (near.to_array()[lane], far.to_array()[lane]);
        Some((through(at, n, wo, far / near)?, near / far))
    }

    /// Returns the interface for light that leaves along `wo`, or `None` if the shading and geometric normals
    /// disagree about the side.
    #[inline]
    pub(super) fn interface(&self, at: &Surface, wo: Vec3A) -> Option<Interface> {
        let n = facing(at, wo)?;
        let (near, far) = self.sides(at, wo);
        let eta = far / near;
        Some(Interface { n, wo, far, eta, fresnel: fresnel::dielectric(n.dot(wo), eta) })
    }

    #[inline]
    pub fn sample(&self, at: &Surface, wo: Vec3A, lanes: &mut Lanes, stream: &mut Stream) -> Option<Sampled> {
        let interface = self.interface(at, wo)?;
        let reflectance = lanes.mean(interface.fresnel.reflection.a);
        if stream.uniform() < reflectance {
            return interface.specular(at, Lobe::Reflected, 0).map(|s| s.chosen(reflectance));
        }
        let (lane, weight) = self.refracted_lane(lanes, stream);
        let mut s = interface.specular(at, Lobe::Transmitted, lane)?.chosen(1.0 - reflectance);
        s.scatter = s.scatter.scaled(weight);
        Some(s)
    }

    /// Samples the wavelength that a refracted path keeps. Returns the lane of this wavelength, and the
    /// weight with which the lane represents all live wavelengths.
    #[inline]
    pub(super) fn refracted_lane(&self, lanes: &mut Lanes, stream: &mut Stream) -> (usize, Spectral) {
        if self.dispersive && lanes.count() > 1 {
            lanes.choose_hero(stream)
        } else {
            (lanes.nth(0), Spectral::ONE)
        }
    }
}

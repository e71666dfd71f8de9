//! Smooth dielectric interface: reflection and refraction, chosen by their power.
//!
//! Radiance is scaled by the squared ratio of the indices when it crosses. Where the index depends on wavelength,
//! refracted wavelengths part ways: one of them, drawn uniformly, goes on and carries the weight of all (Wilkie et al.
//! 2014, "Hero wavelength spectral sampling"); reflection keeps them all.

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

/// An interface as light that leaves along `wo` met it.
pub(super) struct Interface {
    /// Shading normal on the side of `wo`.
    n: Vec3A,
    wo: Vec3A,
    /// Index on the far side, and that over the near side's.
    far: Spectral,
    eta: Spectral,
    fresnel: DielectricFresnel,
}

/// Where light comes from that is refracted along `wo`, `eta` being the far index over the near one; `None` under total
/// reflection, or if shading and geometry disagree about the side.
#[inline]
fn through(at: &Surface, n: Vec3A, wo: Vec3A, eta: f32) -> Option<Vec3A> {
    let wi = refract(wo, n, eta)?.normalize();
    (at.ng.dot(wi) * at.ng.dot(wo) < 0.0).then_some(wi)
}

impl Interface {
    /// One of its two lobes, refracted as wavelength `lane` is.
    #[inline]
    pub(super) fn specular(&self, at: &Surface, lobe: Lobe, lane: usize) -> Option<Specular> {
        let Self { n, wo, .. } = *self;
        let s = s_vector(n, wo);
        if lobe == Lobe::Reflected {
            let wi = reflect(wo, n).normalize();
            return same_side(at, wo, wi).then_some(Specular {
                wi,
                scatter: Scatter::Fresnel {
                    block: self.fresnel.reflection,
                    s,
                },
                filling: None,
            });
        }
        // Radiance per squared index is what travels unchanged; power transmittance is the same both ways.
        Some(Specular {
            wi: through(at, n, wo, self.eta.to_array()[lane])?,
            scatter: Scatter::Fresnel {
                block: self
                    .fresnel
                    .transmission
                    .scaled(Spectral::ONE / (self.eta * self.eta)),
                s,
            },
            filling: Some(Filling::clear(self.far.to_array()[lane])),
        })
    }
}

impl Dielectric {
    /// Index on the side of `wo`, and on the other.
    #[inline]
    pub(super) fn sides(&self, at: &Surface, wo: Vec3A) -> (Spectral, Spectral) {
        if at.ng.dot(wo) > 0.0 {
            (self.exterior, self.interior)
        } else {
            (self.interior, self.exterior)
        }
    }

    /// The medium on the other side than `wo`.
    #[inline]
    #[must_use]
    pub fn beyond(&self, at: &Surface, wo: Vec3A, lanes: Lanes) -> Filling {
        Filling::clear(self.sides(at, wo).1.to_array()[lanes.nth(0)])
    }

    /// The direction on the other side whose light leaves along `wo`, and the ratio of the indices, that on the side of `wo`
    /// over the other; `None` under total reflection, or if shading and geometry disagree.
    #[inline]
    pub(super) fn refracted(&self, at: &Surface, wo: Vec3A, lane: usize) -> Option<(Vec3A, f32)> {
        let n = facing(at, wo)?;
        let (near, far) = self.sides(at, wo);
        let (near, far) = (near.to_array()[lane], far.to_array()[lane]);
        Some((through(at, n, wo, far / near)?, near / far))
    }

    /// What light that leaves along `wo` met; `None` if shading and geometry disagree about the side.
    #[inline]
    pub(super) fn interface(&self, at: &Surface, wo: Vec3A) -> Option<Interface> {
        let n = facing(at, wo)?;
        let (near, far) = self.sides(at, wo);
        let eta = far / near;
        Some(Interface {
            n,
            wo,
            far,
            eta,
            fresnel: fresnel::dielectric(n.dot(wo), eta),
        })
    }

    /// See [`super::Materials::sample`].
    #[inline]
    pub fn sample(&self, at: &Surface, wo: Vec3A, lanes: &mut Lanes, stream: &mut Stream) -> Option<Sampled> {
        let interface = self.interface(at, wo)?;
        let reflectance = lanes.mean(interface.fresnel.reflection.a);
        if stream.uniform() < reflectance {
            return interface
                .specular(at, Lobe::Reflected, 0)
                .map(|s| s.chosen(reflectance));
        }
        let (lane, weight) = self.refracted_lane(lanes, stream);
        let mut s = interface
            .specular(at, Lobe::Transmitted, lane)?
            .chosen(1.0 - reflectance);
        s.scatter = s.scatter.scaled(weight);
        Some(s)
    }

    /// The wavelength whose refraction a path follows, and the weight that makes it stand for all that it leaves behind.
    #[inline]
    pub(super) fn refracted_lane(&self, lanes: &mut Lanes, stream: &mut Stream) -> (usize, Spectral) {
        if self.dispersive && lanes.count() > 1 {
            lanes.choose_hero(stream)
        } else {
            (lanes.nth(0), Spectral::ONE)
        }
    }
}

//! The lobes of a material by kind, for slices with path labels. For a scattering event, this module returns
//! the label bits ([`tensor::label`]) and the contribution of each kind of lobe.
//!
//! Reflection by a smooth surface is specular. Reflection by facets and single scattering below a plastic
//! coat are glossy. Reflection by Lambertian surfaces and plastic bodies is diffuse. Smooth transmission sets
//! no bit. Transmission through facets is glossy. A measured table is both glossy and diffuse.

use super::lobe::{Lobes, Sampled};
use super::{Material, Materials, mirror_or_sheet};
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;
use tensor::label::{DIFFUSE, GLOSSY, SPECULAR};

impl Materials {
    /// Returns the result of [`Self::eval`], divided into kinds of lobe. The list is empty if the result is
    /// zero.
    pub fn lobes(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> Lobes {
        let whole = |kind: u8| self.eval(id, at, wo, wi).map(|s| (kind, s)).into_iter().collect();
        match &self.list[id as usize] {
            Material::Diffuse(_) => whole(DIFFUSE),
            Material::RoughConductor(_) | Material::RoughDielectric(_) | Material::RoughCrystal(_) => {
                whole(GLOSSY)
            }
            Material::Measured(_) => whole(GLOSSY | DIFFUSE),
            Material::Plastic(m) => m
                .eval_parted(&self.textures, at, wo, wi)
                .map_or_else(Lobes::new, |[glossy, diffuse]| vec![(GLOSSY, glossy), (DIFFUSE, diffuse)]),
            Material::TwoSided(m) => {
                m.side(at, wo).map_or_else(Lobes::new, |side| self.lobes(side, at, wo, wi))
            }
            Material::Blend(m) => {
                let mut all = Lobes::new();
                for (id, share) in m.shares(self, at).into_iter().filter(|(_, share)| *share > 0.0) {
                    for (kind, scatter) in self.lobes(id, at, wo, wi) {
                        let scatter = scatter.scaled(Spectral::splat(share));
                        match all.iter_mut().find(|(k, _)| *k == kind) {
                            Some((_, sum)) => *sum = sum.plus(&scatter, wo, wi),
                            None => all.push((kind, scatter)),
                        }
                    }
                }
                all
            }
            Material::NormalMap(m) => self.lobes(m.material, &m.turned(self, at), wo, wi),
            Material::PartialDepolarizer(m) => {
                let mut all = self.lobes(m.material, at, wo, wi);
                all.iter_mut().for_each(|(_, s)| *s = m.apply(self, at, s, wo, wi));
                all
            }
            mirror_or_sheet!() | Material::Dielectric(_) | Material::Crystal(_) => Lobes::new(),
        }
    }

    /// Samples one kind of lobe by its intensity for unpolarized light. Returns the kind and its scattering
    /// matrix divided by the probability, or `None` if there are no lobes.
    pub(crate) fn draw_lobe(
        &self,
        id: u32,
        at: &Surface,
        [wo, wi]: [Vec3A; 2],
        stream: &mut Stream,
    ) -> Option<(u8, Scatter)> {
        let mut lobes = self.lobes(id, at, wo, wi);
        if lobes.len() < 2 {
            return lobes.pop();
        }
        let brings = |s: &Scatter| s.m00().reduce_add();
        let all: f32 = lobes.iter().map(|(_, s)| brings(s)).sum();
        let mut u = stream.uniform() * all;
        let last = lobes.len() - 1;
        let (kind, scatter) = lobes.iter().enumerate().find_map(|(i, (kind, s))| {
            let here = u < brings(s) || i == last;
            u -= brings(s);
            here.then_some((*kind, s))
        })?;
        let chance = brings(scatter) / all;
        // If all lobes have intensity 0, the function may return any lobe.
        (chance > 0.0).then(|| (kind, scatter.scaled(Spectral::splat(1.0 / chance))))
    }

    /// Returns the path-label bits of a sampled direction.
    ///
    /// If several kinds of lobe contribute to the direction, one kind is sampled. The matrix in `sampled` is
    /// then replaced by the matrix of the sampled kind. This matrix is divided by the total density of all
    /// kinds and by the probability of the kind.
    pub fn part(&self, id: u32, at: &Surface, wo: Vec3A, sampled: &mut Sampled, stream: &mut Stream) -> u8 {
        let wi = sampled.wi;
        if sampled.delta {
            return if at.ng.dot(wo) * at.ng.dot(wi) > 0.0 { SPECULAR } else { 0 };
        }
        if let [(kind, _)] = self.lobes(id, at, wo, wi)[..] {
            return kind;
        }
        let density = self.pdf(id, at, wo, wi);
        match self.draw_lobe(id, at, [wo, wi], stream) {
            Some((kind, scatter)) if density > 0.0 => {
                sampled.scatter = scatter.scaled(Spectral::splat(1.0 / density));
                kind
            }
            _ => {
                sampled.scatter = sampled.scatter.scaled(Spectral::ZERO);
                0
            }
        }
    }
}

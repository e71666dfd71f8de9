//! The points that a walk leaves behind, for those of another walk to be connected to.
//!
//! At each a walk keeps the Mueller product from its end: from the camera C = M₁ M₂ ⋯, from an emitter the transpose of
//! L = ⋯ M₂ M₁, which grows on the same side, so that a whole path is C · L and both walks are made by the same steps.
//! Interactions at a point are not in its product.
//!
//! Densities are per area (per volume in media) up to the medium's own μ_t at either point, which is the same factor from
//! both sides. They are functions of the path alone, not of the wavelengths that a walk still carries, so that weights
//! made of them sum to one.

use super::bridge::Start;
use super::guide::{At, Guide};
use super::state::From;
use crate::geometry::ray::{Ray, Surface};
use crate::light::receiver::Receiver;
use crate::material::{Filling, Lanes, Lobes};
use crate::medium::nesting::Nest;
use crate::scene::Scene;
use glam::{DVec3, Vec3A};
use optics::polarization::chain::Chain;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;
use tensor::label;

/// A walk's end: a point without extent, and what leaves it.
#[derive(Clone, Copy)]
pub(super) struct End {
    pub ray: Ray,
    pub chain: Chain,
    pub frame: Vec3A,
    /// Density of the ray's direction per steradian.
    pub density: f32,
    pub filling: Filling,
    pub nest: Nest,
}

/// Where a point of a walk is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Site {
    /// At the walk's end.
    Pinhole,
    Surface,
    /// Inside the medium of this number.
    Volume(u32),
}

/// The lobes of one kind.
fn of_kind(lobes: Lobes, kind: u8) -> Option<Scatter> {
    lobes.into_iter().find(|(k, _)| *k == kind).map(|(_, s)| s)
}

/// A point of a walk.
#[derive(Clone, Copy)]
pub(super) struct Point {
    pub site: Site,
    /// Of a volume or an end, its position alone counts.
    pub surface: Surface,
    /// The same where the ray met it, in double precision: ways are measured from there.
    pub at: DVec3,
    /// Unit direction to the point before.
    pub back: Vec3A,
    /// Mueller product from the walk's end to the light that arrives here, and that light's frame.
    pub chain: Chain,
    pub frame: Vec3A,
    /// Optical path length from the walk's end, metres.
    pub optical_m: f64,
    /// What is on the side of `back`.
    pub filling: Filling,
    pub nest: Nest,
    pub lanes: Lanes,
    /// Interactions before this one, and what they did ([`tensor::label`]).
    pub interactions: u32,
    pub label: u8,
    /// True if the walk went on by a delta lobe.
    pub delta: bool,
    /// Density with which the walk came here, and with which one the other way would have come from the next point.
    pub forward: f32,
    pub reverse: f32,
    /// What turns a density of the direction `back` into one at the point before.
    pub spread: f32,
}

impl Point {
    /// A walk's end. Its density is that of the direction in which the walk starts.
    #[inline]
    pub fn end(scene: &Scene, end: &End) -> Self {
        let p = end.ray.origin;
        Self {
            site: Site::Pinhole,
            surface: Surface {
                p,
                ..Surface::default()
            },
            at: p.as_dvec3(),
            back: -end.ray.dir,
            chain: end.chain,
            frame: end.frame,
            optical_m: 0.0,
            filling: end.filling,
            nest: end.nest,
            lanes: scene.lanes(),
            interactions: 0,
            label: 0,
            delta: false,
            forward: end.density,
            reverse: 0.0,
            spread: 0.0,
        }
    }

    /// The light that leaves along `wo` of that which comes from `wi`, both away from the point.
    ///
    /// On surfaces it is the Mueller BSDF times |cosθ_i|, in media the phase function.
    #[inline]
    pub fn scatter(&self, scene: &Scene, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        match self.site {
            Site::Surface => scene.materials.eval(self.surface.material, &self.surface, wo, wi),
            Site::Volume(id) => Some(scene.media.eval(id, wo, wi)),
            Site::Pinhole => None,
        }
    }

    /// [`Self::scatter`] by kinds, with what they set in a label.
    pub fn lobes(&self, scene: &Scene, wo: Vec3A, wi: Vec3A) -> Lobes {
        match self.site {
            Site::Surface => scene
                .materials
                .lobes(self.surface.material, &self.surface, wo, wi),
            Site::Volume(id) => vec![(label::MEDIUM, scene.media.eval(id, wo, wi))],
            Site::Pinhole => vec![],
        }
    }

    /// The intensity that leaves along `wo` per flux that arrives from `wi`.
    #[inline]
    pub fn scatter_flux(&self, scene: &Scene, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let scatter = self.scatter(scene, wo, wi)?;
        if self.site != Site::Surface {
            return Some(scatter);
        }
        // Shading normals may light a point from where its true surface is grazed.
        let cos = self.cosine(wi);
        (cos > 0.0).then(|| scatter.scaled(Spectral::splat(self.cosine(wo) / cos)))
    }

    /// [`Self::scatter`] by lobes of one kind, if one is named.
    #[inline]
    pub fn scatter_by(&self, scene: &Scene, kind: Option<u8>, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        match kind {
            None => self.scatter(scene, wo, wi),
            Some(kind) => of_kind(self.lobes(scene, wo, wi), kind),
        }
    }

    /// [`Self::scatter_flux`] likewise.
    #[inline]
    pub fn scatter_flux_by(&self, scene: &Scene, kind: Option<u8>, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        match kind {
            None => self.scatter_flux(scene, wo, wi),
            Some(kind) => of_kind(self.lobes_flux(scene, wo, wi), kind),
        }
    }

    /// [`Self::scatter_flux`] by kinds, as [`Self::lobes`].
    pub fn lobes_flux(&self, scene: &Scene, wo: Vec3A, wi: Vec3A) -> Lobes {
        let mut lobes = self.lobes(scene, wo, wi);
        let cos = self.cosine(wi);
        if cos <= 0.0 {
            lobes.clear();
        }
        if self.site == Site::Surface {
            let factor = Spectral::splat(self.cosine(wo) / cos);
            lobes.iter_mut().for_each(|(_, s)| *s = s.scaled(factor));
        }
        lobes
    }

    /// The medium that light which is scattered here comes through, if the point is one where walks may turn.
    #[inline]
    pub fn medium(&self, scene: &Scene) -> Option<u32> {
        match self.site {
            Site::Volume(id) => Some(id),
            Site::Surface if scene.filled && self.is_lambert(scene) => self.nest.medium(&scene.boundaries),
            _ => None,
        }
    }

    /// The point as what light is chosen for.
    #[inline]
    pub fn receiver(&self, scene: &Scene) -> Receiver {
        match self.site {
            Site::Surface => Receiver::on(&scene.materials, &self.surface, self.back),
            Site::Volume(_) | Site::Pinhole => Receiver::anywhere(self.surface.p),
        }
    }

    /// Density per steradian with which a walk of one end that came from direction `back` goes on along `to`.
    #[inline]
    pub fn density(&self, scene: &Scene, guide: &Guide, from: From, back: Vec3A, to: Vec3A) -> f32 {
        let own = match self.site {
            Site::Surface => {
                let s = &self.surface;
                Spectral::splat(scene.materials.pdf(s.material, s, back, to))
            }
            Site::Volume(id) => scene.media.densities_toward(id, back, to),
            Site::Pinhole => return 0.0,
        };
        let Some(medium) = self.medium(scene) else {
            return own.to_array()[0];
        };
        let at = At {
            medium,
            p: self.surface.p,
            from,
        };
        let own = match self.site {
            Site::Volume(_) => own * Spectral::splat(guide.lean(at, back, to).factor),
            _ => own,
        };
        scene
            .lanes()
            .mean(guide.toward(&scene.media, at, to).densities(own))
    }

    /// Area that the point shows along a unit direction, per area.
    #[inline]
    pub fn cosine(&self, dir: Vec3A) -> f32 {
        match self.site {
            Site::Surface => self.surface.ng.dot(dir).abs(),
            _ => 1.0,
        }
    }

    /// True if light can come here from, or go to, any point.
    #[inline]
    pub fn connects(&self, scene: &Scene) -> bool {
        match self.site {
            Site::Surface => scene.materials.has_extended_lobe(self.surface.material),
            _ => true,
        }
    }

    /// True on plain Lambert surfaces.
    #[inline]
    pub fn is_lambert(&self, scene: &Scene) -> bool {
        matches!(self.site, Site::Surface) && scene.materials.lambert(self.surface.material).is_some()
    }

    /// A ray's origin toward `dir` off the surface.
    #[inline]
    pub fn leave(&self, scene: &Scene, dir: Vec3A) -> Vec3A {
        match self.site {
            Site::Surface => scene.geometry.leave(&self.surface, dir),
            _ => self.surface.p,
        }
    }

    /// The medium that a line along `dir` starts in.
    #[inline]
    pub fn medium_toward(&self, scene: &Scene, dir: Vec3A) -> Option<u32> {
        let s = &self.surface;
        match self.site {
            Site::Volume(id) => Some(id),
            Site::Surface if s.ng.dot(self.back) * s.ng.dot(dir) < 0.0 => {
                let mut nest = self.nest;
                nest.cross(&scene.boundaries, s.material, s.ng.dot(dir) < 0.0);
                nest.medium(&scene.boundaries)
            }
            _ => self.nest.medium(&scene.boundaries),
        }
    }

    /// What a line of so many metres that comes from direction `dir` is aimed at: off the surface.
    #[inline]
    pub fn reach(&self, scene: &Scene, dir: Vec3A, length: f32) -> Vec3A {
        match self.site {
            Site::Surface => scene.geometry.reach(&self.surface, dir, length),
            _ => self.surface.p,
        }
    }

    /// The start of a line along `dir`.
    #[inline]
    pub fn line(&self, scene: &Scene, dir: Vec3A) -> Start {
        let (mut filling, mut nest) = (self.filling, self.nest);
        let s = &self.surface;
        if self.site == Site::Surface && s.ng.dot(self.back) * s.ng.dot(dir) < 0.0 {
            nest.cross(&scene.boundaries, s.material, s.ng.dot(dir) < 0.0);
            let beyond = scene.materials.beyond(s.material, s, self.back, self.lanes);
            filling = beyond.unwrap_or(filling);
        }
        let origin = self.leave(scene, dir);
        Start {
            ray: Ray { origin, dir },
            from: s.p,
            at: self.at,
            filling,
            nest,
        }
    }
}

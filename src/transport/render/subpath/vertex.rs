//! Vertices of a subpath, which can be connected to vertices of another subpath.
//!
//! Each vertex stores the Mueller product from the end of its subpath. For a camera subpath, the product is C
//! = M₁ M₂ ⋯. For a light subpath, the product is the transpose of L = ⋯ M₂ M₁. Matrices are appended to C
//! and to the transpose of L on the same side, so both kinds of subpaths use the same code. The Mueller
//! product of a whole path is C · L. The stored products exclude the scattering at the vertex itself.
//!
//! Densities are per area on surfaces, and per volume in media. The factor μ_t of the medium at each vertex
//! is omitted, because this factor is the same from both ends. Densities depend only on the path, not on the
//! live wavelengths of a subpath, so that MIS weights add up to one.

use super::guide::{At, Guide};
use crate::geometry::ray::{Ray, Surface};
use crate::light::receiver::Receiver;
use crate::material::{Filling, Lanes, Lobes};
use crate::medium::nesting::Nest;
use crate::render::state::From;
use crate::render::transmission::Start;
use crate::scene::Scene;
use glam::{DVec3, Vec3A};
use optics::polarization::chain::Chain;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;
use tensor::label;

/// The end of a subpath, which is a point without extent, and the ray that starts at this point.
#[derive(Clone, Copy)]
pub(crate) struct End {
    pub ray: Ray,
    pub chain: Chain,
    pub frame: Vec3A,
    /// Sampling density of the ray's direction per steradian.
    pub density: f32,
    pub filling: Filling,
    pub nest: Nest,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Site {
    Pinhole,
    Surface,
    /// A scattering event in the medium with this index.
    Volume(u32),
}

/// Returns the last vertex of a subpath.
#[inline]
pub(crate) fn last(walk: &[Vertex]) -> &Vertex {
    walk.last().expect("a subpath has an end")
}

/// Returns the scattering matrix of the lobes of one kind.
fn of_kind(lobes: Lobes, kind: u8) -> Option<Scatter> {
    lobes.into_iter().find(|(k, _)| *k == kind).map(|(_, s)| s)
}

#[derive(Clone, Copy)]
pub(crate) struct Vertex {
    pub site: Site,
    /// Surface at the vertex. For a medium vertex or an end, only the position is valid.
    pub surface: Surface,
    /// Exact position at which the ray hit the vertex, for path lengths.
    pub at: DVec3,
    /// Unit direction to the previous vertex.
    pub back: Vec3A,
    /// Mueller product from the end of the subpath to the light that reaches this vertex. `frame` is the
    /// frame of this light.
    pub chain: Chain,
    pub frame: Vec3A,
    /// Optical path length from the end of the subpath, in metres.
    pub optical_m: f64,
    /// The medium on the side of `back`.
    pub filling: Filling,
    pub nest: Nest,
    pub lanes: Lanes,
    /// Number of interactions before this vertex. `label` is the path label of these interactions
    /// ([`tensor::label`]).
    pub interactions: u32,
    pub label: u8,
    /// True if the subpath continued from this vertex along a delta lobe.
    pub delta: bool,
    /// Density with which the subpath sampled this vertex, per area on a surface and per volume in a medium.
    pub forward: f32,
    /// Density with which a subpath in the opposite direction would have sampled this vertex from the
    /// following vertex.
    pub reverse: f32,
    /// Factor that converts the density of direction `back` to the density of the previous vertex.
    pub spread: f32,
}

impl Vertex {
    /// Returns the end of a subpath as a vertex. The density of this vertex is the density of the start
    /// direction.
    #[inline]
    pub fn end(scene: &Scene, end: &End) -> Self {
        let p = end.ray.origin;
        Self {
            site: Site::Pinhole,
            surface: Surface { p, ..Surface::default() },
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

    /// Returns the scattering matrix from `wi` to `wo`. Both directions point away from the vertex.
    ///
    /// On surfaces, the matrix is the Mueller BSDF times |cosθ_i|. In media, the matrix is the phase
    /// function.
    #[inline]
    pub fn scatter(&self, scene: &Scene, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        match self.site {
            Site::Surface => scene.materials.eval(self.surface.material, &self.surface, wo, wi),
            Site::Volume(id) => Some(scene.media.eval(id, wo, wi)),
            Site::Pinhole => None,
        }
    }

    /// Returns [`Self::scatter`] by kind of lobe, each with its path-label bits.
    pub fn lobes(&self, scene: &Scene, wo: Vec3A, wi: Vec3A) -> Lobes {
        match self.site {
            Site::Surface => scene.materials.lobes(self.surface.material, &self.surface, wo, wi),
            Site::Volume(id) => vec![(label::MEDIUM, scene.media.eval(id, wo, wi))],
            Site::Pinhole => vec![],
        }
    }

    /// Returns the scattering matrix for the intensity along `wo`, divided by the flux from `wi`.
    #[inline]
    pub fn scatter_flux(&self, scene: &Scene, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let scatter = self.scatter(scene, wo, wi)?;
        if self.site != Site::Surface {
            return Some(scatter);
        }
        // With shading normals, light from below the geometric surface may reach the vertex.
        let cos = self.cosine(wi);
        (cos > 0.0).then(|| scatter.scaled(Spectral::splat(self.cosine(wo) / cos)))
    }

    /// Returns [`Self::scatter`], restricted to lobes of `kind` if `kind` is set.
    #[inline]
    pub fn scatter_by(&self, scene: &Scene, kind: Option<u8>, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        match kind {
            None => self.scatter(scene, wo, wi),
            Some(kind) => of_kind(self.lobes(scene, wo, wi), kind),
        }
    }

    /// Returns [`Self::scatter_flux`], restricted to lobes of `kind` if `kind` is set.
    #[inline]
    pub fn scatter_flux_by(&self, scene: &Scene, kind: Option<u8>, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        match kind {
            None => self.scatter_flux(scene, wo, wi),
            Some(kind) => of_kind(self.lobes_flux(scene, wo, wi), kind),
        }
    }

    /// Returns [`Self::scatter_flux`] by kind of lobe, as [`Self::lobes`] does.
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

    /// Returns the index of the medium through which light arrives, if guiding is possible at the vertex.
    #[inline]
    pub fn medium(&self, scene: &Scene) -> Option<u32> {
        match self.site {
            Site::Volume(id) => Some(id),
            Site::Surface if scene.filled && self.is_lambert(scene) => self.nest.medium(&scene.boundaries),
            _ => None,
        }
    }

    /// Returns the vertex as a receiving point for choosing lights.
    #[inline]
    pub fn receiver(&self, scene: &Scene) -> Receiver {
        match self.site {
            Site::Surface => Receiver::on(&scene.materials, &self.surface, self.back),
            Site::Volume(_) | Site::Pinhole => Receiver::anywhere(self.surface.p),
        }
    }

    /// Returns the density per steradian of the direction `to`, for a subpath that started at the end `from`
    /// and reached the vertex from direction `back`.
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
        let at = At { medium, p: self.surface.p, from };
        let own = match self.site {
            Site::Volume(_) => own * Spectral::splat(guide.lean(at, back, to).factor),
            _ => own,
        };
        scene.lanes().mean(guide.toward(&scene.media, at, to).densities(own))
    }

    /// Returns the ratio of projected to actual area along a unit direction. The ratio is the cosine, or 1 in
    /// a medium.
    #[inline]
    pub fn cosine(&self, dir: Vec3A) -> f32 {
        match self.site {
            Site::Surface => self.surface.ng.dot(dir).abs(),
            _ => 1.0,
        }
    }

    /// Returns true if connections can end at the vertex. On a surface, the material must have at least one
    /// lobe that is not a delta lobe.
    #[inline]
    pub fn connects(&self, scene: &Scene) -> bool {
        match self.site {
            Site::Surface => scene.materials.has_extended_lobe(self.surface.material),
            _ => true,
        }
    }

    /// Returns true if the vertex is on a plain Lambertian surface.
    #[inline]
    pub fn is_lambert(&self, scene: &Scene) -> bool {
        matches!(self.site, Site::Surface) && scene.materials.lambert(self.surface.material).is_some()
    }

    /// Returns the origin of a ray along `dir`, offset from the surface.
    #[inline]
    pub fn leave(&self, scene: &Scene, dir: Vec3A) -> Vec3A {
        match self.site {
            Site::Surface => scene.geometry.leave(&self.surface, dir),
            _ => self.surface.p,
        }
    }

    /// Returns the medium in which a line that leaves along `dir` starts.
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

    /// Returns the target of a line of `length` metres that arrives from direction `dir`. The target is
    /// offset from the surface.
    #[inline]
    pub fn reach(&self, scene: &Scene, dir: Vec3A, length: f32) -> Vec3A {
        match self.site {
            Site::Surface => scene.geometry.reach(&self.surface, dir, length),
            _ => self.surface.p,
        }
    }

    /// Returns the start of a line that leaves along `dir`.
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
        Start { ray: Ray { origin, dir }, from: s.p, at: self.at, filling, nest }
    }
}

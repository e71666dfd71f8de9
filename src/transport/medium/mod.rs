//! Participating media, which scatter and absorb light. Each phase function has a separate source file and is
//! dispatched by enum.
//!
//! Scattering matrices are per steradian and normalized to ∫ S11 dω = 1. Directions and frames are defined in
//! [`scattered`]. `mie`, `size_distribution`, `bulk` and `presets` compute the data of [`Media`] in f64.

pub mod bulk;
pub mod grid;
pub mod henyey_greenstein;
pub mod mie;
pub mod nesting;
pub mod presets;
mod products;
pub mod rayleigh;
pub mod scattered;
pub mod size_distribution;
pub mod table;
pub mod water;

use crate::geometry::ray::Ray;
use crate::material::Lanes;
use bulk::{Optics, PhaseOptics};
use glam::Vec3A;
use grid::Grid;
use optics::polarization::fresnel::FresnelBlock;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::sampling::warp;
use optics::spectrum::Spectral;
use scattered::{Angle, plane_normal};
use std::f32::consts::PI;

/// Value of the isotropic phase function, per steradian.
const ISOTROPIC: f32 = 0.25 / PI;

/// Phase function of a medium.
#[derive(Clone, Copy, Debug)]
pub enum Phase {
    /// Isotropic scattering that depolarizes completely.
    Isotropic,
    Rayleigh(rayleigh::Rayleigh),
    HenyeyGreenstein(henyey_greenstein::HenyeyGreenstein),
    /// Tabulated scattering matrix, with its index in [`Media::tables`].
    Table(u32),
}

/// Value of [`Medium::density`] and [`Medium::albedo`] that denotes no grid.
pub const NO_GRID: u32 = u32::MAX;

/// A medium that is homogeneous, except for the grids to which it refers.
#[derive(Clone, Copy, Debug)]
pub struct Medium {
    /// Absorption coefficient μ_a, 1/m (0 in unused lanes).
    pub absorption: Spectral,
    /// Scattering coefficient μ_s, 1/m (0 in unused lanes).
    pub scattering: Spectral,
    /// Real refractive index of the host medium (1 in unused lanes).
    pub index: Spectral,
    pub phase: Phase,
    /// Index of a grid in [`Media::grids`] that multiplies both coefficients. Outside the grid's box, the
    /// factor is 0.
    pub density: u32,
    /// Index of a grid in [`Media::grids`] with the fraction of `scattering` that remains scattering. The
    /// remaining fraction is absorbed.
    pub albedo: u32,
}

/// All media of a scene with their shared tables and grids.
#[derive(Clone, Debug, Default)]
pub struct Media {
    pub list: Vec<Medium>,
    pub tables: Vec<table::Table>,
    pub grids: Vec<Grid>,
}

impl Medium {
    /// Returns the extinction coefficient μ_t = μ_a + μ_s at density 1, 1/m.
    #[inline]
    fn extinction(&self) -> Spectral {
        self.absorption + self.scattering
    }
}

impl Media {
    /// Adds a medium and returns its index.
    pub fn push(&mut self, optics: &Optics) -> u32 {
        let lane = |value: fn(&bulk::Bulk) -> f64, unused: f32| {
            let at = |i: usize| optics.bulk.get(i).map_or(unused, |b| value(b) as f32);
            Spectral::new([at(0), at(1), at(2), at(3)])
        };
        let phase = match &optics.phase {
            PhaseOptics::Isotropic => Phase::Isotropic,
            PhaseOptics::Rayleigh(p) => Phase::Rayleigh(*p),
            PhaseOptics::HenyeyGreenstein(p) => Phase::HenyeyGreenstein(*p),
            PhaseOptics::Particles(e) if e.iter().all(bulk::Ensemble::is_clear) => Phase::Isotropic,
            PhaseOptics::Particles(ensembles) => {
                self.tables.push(table::Table::new(ensembles));
                Phase::Table(self.tables.len() as u32 - 1)
            }
        };
        self.list.push(Medium {
            absorption: lane(|b| b.absorption, 0.0),
            scattering: lane(|b| b.scattering, 0.0),
            index: lane(|b| b.index, 1.0),
            phase,
            density: NO_GRID,
            albedo: NO_GRID,
        });
        self.list.len() as u32 - 1
    }

    /// Returns the extinction coefficient μ_t at a point, 1/m.
    #[inline]
    pub fn extinction(&self, id: u32, p: Vec3A) -> Spectral {
        let medium = &self.list[id as usize];
        match self.grids.get(medium.density as usize) {
            None => medium.extinction(),
            Some(grid) => medium.extinction() * grid.at(p),
        }
    }

    /// Returns the scattering coefficient μ_s at a point, 1/m.
    #[inline]
    pub fn scattering(&self, id: u32, p: Vec3A) -> Spectral {
        let medium = &self.list[id as usize];
        let density = self.grids.get(medium.density as usize).map(|grid| grid.at(p));
        let albedo = self.grids.get(medium.albedo as usize).map(|grid| grid.beyond(p));
        let factors = [density, albedo].into_iter().flatten();
        factors.fold(medium.scattering, |s, factor| s * factor)
    }

    /// Returns the optical depth of a ray segment with a length of `length` metres.
    #[inline]
    pub fn depth(&self, id: u32, ray: &Ray, length: f32) -> Spectral {
        let medium = &self.list[id as usize];
        match self.grids.get(medium.density as usize) {
            None => medium.extinction() * Spectral::splat(length),
            Some(grid) => medium.extinction() * grid.integral(ray, length),
        }
    }

    /// Returns the distance along a ray at which the optical depth of a lane reaches `depth`, metres.
    #[inline]
    pub fn reach(&self, id: u32, ray: &Ray, lane: usize, depth: f32) -> f32 {
        let medium = &self.list[id as usize];
        let extinction = medium.extinction().to_array()[lane];
        match self.grids.get(medium.density as usize) {
            None => depth / extinction,
            Some(grid) => grid.reach(ray, lane, depth / extinction),
        }
    }

    /// Returns the minimum extinction coefficient μ_t over all lanes of a homogeneous medium, 1/m, or 0 for
    /// other media.
    #[inline]
    pub(crate) fn clearest(&self, id: u32, lanes: usize) -> f32 {
        let medium = &self.list[id as usize];
        if medium.density != NO_GRID {
            return 0.0;
        }
        let extinction = medium.extinction().to_array();
        extinction[..lanes].iter().fold(f32::INFINITY, |a, b| a.min(*b))
    }

    /// Returns the Mueller phase function per steradian. The matrix maps light that travels along `-wi` to
    /// light that travels along `wo`. `wi` and `wo` are unit vectors that point away from the scattering
    /// point. The first axis of both frames is the normal of the scattering plane.
    #[inline]
    pub fn eval(&self, id: u32, wo: Vec3A, wi: Vec3A) -> Scatter {
        let at = Angle::between(wo, wi);
        self.scatter(self.list[id as usize].phase, at, || plane_normal(wo, wi))
    }

    /// Returns the density of [`Self::sample_direction`] per steradian of `wi`, averaged over the live lanes.
    #[inline]
    pub fn pdf(&self, id: u32, lanes: Lanes, wo: Vec3A, wi: Vec3A) -> f32 {
        lanes.mean(self.densities_toward(id, wo, wi))
    }

    /// Returns the density of [`Self::sample_direction`] per steradian of `wi` for each lane.
    #[inline]
    pub(crate) fn densities_toward(&self, id: u32, wo: Vec3A, wi: Vec3A) -> Spectral {
        self.densities(self.list[id as usize].phase, Angle::between(wo, wi))
    }

    /// Samples the direction from which light along `wo` arrives, with the phase function of lane `lane`.
    #[inline]
    pub fn sample_direction(&self, id: u32, wo: Vec3A, lane: usize, stream: &mut Stream) -> Vec3A {
        match self.sample_angle(self.list[id as usize].phase, lane, stream) {
            Some(at) => at.direction(wo, stream.uniform()).0,
            None => warp::sphere(stream.uniform2()),
        }
    }

    /// Samples a scattering angle with the phase function of lane `lane`. Returns `None` if the phase
    /// function is isotropic.
    #[inline]
    fn sample_angle(&self, phase: Phase, lane: usize, stream: &mut Stream) -> Option<Angle> {
        match phase {
            Phase::Isotropic => None,
            Phase::Rayleigh(p) => Some(p.sample(stream.uniform())),
            Phase::HenyeyGreenstein(p) => Some(p.sample(lane, stream.uniform())),
            Phase::Table(t) => Some(self.tables[t as usize].sample(lane, stream)),
        }
    }

    /// Returns the scattering matrix at a scattering angle. `s` returns the normal of the scattering plane
    /// and is called only if the normal is needed.
    #[inline]
    fn scatter(&self, phase: Phase, at: Angle, s: impl FnOnce() -> Vec3A) -> Scatter {
        match phase {
            Phase::Isotropic => Scatter::Depolarize(Spectral::splat(ISOTROPIC)),
            Phase::Rayleigh(p) => {
                let e = p.elements(at).splat();
                if p.is_pure() {
                    let block = FresnelBlock { a: e.s11, b: e.s12, c: e.s33, d: e.s34 };
                    Scatter::Fresnel { block, s: s() }
                } else {
                    e.scatter(s())
                }
            }
            Phase::HenyeyGreenstein(p) if p.depolarizes() => Scatter::Depolarize(p.intensity(at)),
            Phase::HenyeyGreenstein(p) => p.elements(at).scatter(s()),
            Phase::Table(t) => Scatter::Fresnel { block: self.tables[t as usize].block(at), s: s() },
        }
    }

    /// Returns the sampling density of each lane at a scattering angle, per steradian.
    #[inline]
    fn densities(&self, phase: Phase, at: Angle) -> Spectral {
        match phase {
            Phase::Isotropic => Spectral::splat(ISOTROPIC),
            Phase::Rayleigh(p) => Spectral::splat(p.intensity(at)),
            Phase::HenyeyGreenstein(p) => p.intensity(at),
            Phase::Table(t) => self.tables[t as usize].densities(at),
        }
    }
}

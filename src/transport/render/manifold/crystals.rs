//! Specular paths to a pinhole through birefringent crystals that produce double images. As in
//! [`manifold`](super), the search starts from the straight line. A separate search is made for each
//! combination of ordinary and extraordinary waves.
//!
//! Derivatives of rays with respect to their direction are approximated by finite differences.

use super::{Bend, INTERFACES, MOST_SURFACES, Shot, SpecularPath, newton, passes};
use crate::geometry::ray::{Ray, Surface};
use crate::material::{Lobe, Specular};
use crate::medium::nesting::Nest;
use crate::render::transmission::Start;
use crate::scene::Scene;
use arrayvec::ArrayVec;
use glam::Vec3A;
use optics::polarization::frame::basis;

/// Maximum number of crystals on a path. Each crystal has two waves.
const CRYSTALS: u32 = 4;

/// Maximum number of Newton steps. A few steps suffice, because crystals deflect light only slightly.
const STEPS: usize = 12;

/// Angular step for finite differences, radians. The step is far above rounding errors but small enough for
/// linearity.
const STEP: f32 = 1e-3;

/// Maximum Newton step, radians.
const LEAP: f32 = 0.3;

/// The parameters of a search for a path through crystals.
pub(super) struct CrystalSearch<'a> {
    scene: &'a Scene,
    start: Start,
    to: Vec3A,
    /// Number of surfaces that refract the path. `crystals` is the number of crystals on the path.
    bends: usize,
    crystals: u32,
}

/// The wavelength of a path, and the wave in each crystal. In `waves`, each bit belongs to one crystal and is
/// 1 for the extraordinary wave. The lowest bit belongs to the next crystal.
#[derive(Clone, Copy)]
pub(super) struct Choice {
    pub lane: usize,
    pub waves: u32,
}

impl<'a> CrystalSearch<'a> {
    /// Prepares a search along a straight line. Returns `None` if the line is blocked or crosses no crystal
    /// that produces double images.
    pub fn straight(scene: &'a Scene, start: Start, to: Vec3A) -> Option<Self> {
        let (mut bends, mut crystals, mut inside) = (0, 0, false);
        let (mut ray, mut nest) = (start.ray, start.nest);
        for _ in 0..MOST_SURFACES {
            let length = (to - ray.origin).length();
            let Some(hit) = scene.geometry.intersect(&ray, length) else {
                let all = crystals > 0 && crystals <= CRYSTALS && bends <= INTERFACES && !inside;
                return all.then_some(Self { scene, start, to, bends, crystals });
            };
            let surface = scene.geometry.surface(&ray, &hit);
            let id = surface.material;
            let enters = surface.ng.dot(ray.dir) < 0.0;
            if scene.materials.splits(id) {
                // The line must leave each crystal before the line enters the next crystal.
                if inside == enters {
                    return None;
                }
                inside = enters;
                crystals += u32::from(enters);
                bends += 1;
            } else if !passes(scene, &nest, &surface, ray.dir) {
                if inside || !scene.materials.is_interface(id) {
                    return None;
                }
                bends += 1;
            }
            nest.cross(&scene.boundaries, id, enters);
            ray.origin = scene.geometry.leave(&surface, ray.dir);
        }
        None
    }

    /// Returns all combinations of waves in the crystals, as bit sets.
    pub fn waves(&self) -> std::ops::Range<u32> {
        0..1 << self.crystals
    }

    /// Returns the delta lobe that a path follows at a surface.
    fn lobe(&self, surface: &Surface, dir: Vec3A, Choice { lane, waves }: Choice) -> Option<Specular> {
        let materials = &self.scene.materials;
        if materials.splits(surface.material) {
            return materials.passed(surface.material, surface, -dir, lane, (waves & 1) as usize);
        }
        materials
            .is_interface(surface.material)
            .then(|| materials.specular(surface.material, surface, -dir, Lobe::Transmitted, lane))?
    }

    /// Traces a ray through all refracting surfaces, up to the point that is nearest to the goal. Calls
    /// `bent` for each interaction on the ray.
    fn shoot(&self, mut dir: Vec3A, mut choice: Choice, mut bent: impl FnMut(Bend)) -> Option<Shot> {
        let scene = self.scene;
        let (mut nest, mut from): (Nest, Vec3A) = (self.start.nest, self.start.from);
        let mut origin = self.start.ray.origin;
        let (mut left, mut length) = (self.bends, 0.0);
        for _ in 0..MOST_SURFACES {
            if left == 0 {
                return Shot::past(self.to, from, dir, [[Vec3A::ZERO; 2]; 2], length);
            }
            let ray = Ray { origin, dir };
            let hit = scene.geometry.intersect(&ray, f32::INFINITY)?;
            let surface = scene.geometry.surface(&ray, &hit);
            let id = surface.material;
            let enters = surface.ng.dot(dir) < 0.0;
            length += (surface.p - from).length();
            let splits = scene.materials.splits(id);
            if splits || !passes(scene, &nest, &surface, dir) {
                let lobe = self.lobe(&surface, dir, choice)?;
                bent(Bend {
                    surface,
                    before: dir,
                    after: lobe.wi,
                    lobe: Lobe::Transmitted,
                    scatter: lobe.scatter,
                    filling: lobe.filling,
                });
                dir = lobe.wi;
                left -= 1;
                // A wave ends where the ray leaves the crystal.
                choice.waves >>= u32::from(splits && !enters);
            }
            nest.cross(&scene.boundaries, id, enters);
            origin = scene.geometry.leave(&surface, dir);
            from = surface.p;
        }
        None
    }

    /// Returns the Newton step for a direction, and the area J at the goal per solid angle, m²/sr.
    fn newton(&self, dir: Vec3A, choice: Choice, shot: &Shot) -> Option<(Vec3A, f32)> {
        let across = basis(dir);
        let slope = |axis: Vec3A| {
            let ends = [STEP, -STEP].map(|step| {
                let turned = (dir + axis * step).normalize();
                self.shoot(turned, choice, |_| ()).map(|s| self.crossing(&s, shot.dir))
            });
            Some((ends[0]? - ends[1]?) / (2.0 * STEP))
        };
        newton(dir, &Shot { slopes: [slope(across.x_axis)?, slope(across.y_axis)?], ..*shot })
    }

    /// Returns the intersection of a ray with the plane through the goal with normal `n`. The result is
    /// relative to the goal.
    fn crossing(&self, shot: &Shot, n: Vec3A) -> Vec3A {
        shot.miss - shot.dir * (shot.miss.dot(n) / shot.dir.dot(n))
    }

    /// Finds the path for a combination of waves.
    pub fn find(&self, choice: Choice) -> Option<SpecularPath> {
        let mut dir = self.start.ray.dir;
        let mut shot = self.shoot(dir, choice, |_| ())?;
        for _ in 0..STEPS {
            let near = shot.is_near();
            let (step, spread) = self.newton(dir, choice, &shot)?;
            if near {
                let mut bends = ArrayVec::new();
                self.shoot(dir, choice, |bend| bends.push(bend))?;
                return SpecularPath::known(self.start, dir, spread, bends);
            }
            dir = (dir + step * (LEAP / step.length()).min(1.0)).normalize();
            shot = self.shoot(dir, choice, |_| ())?;
        }
        None
    }
}

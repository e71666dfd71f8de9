//! Rays that are traced toward an emitter through interfaces, and the Newton step for the direction of such a
//! ray. The step changes the direction so that the ray hits the emitter (Igehy 1999, "Tracing ray
//! differentials").
//!
//! For flat panes, the first ray determines the positions of the planes and the refraction at each plane. The
//! direction is then computed from the planes without further intersection tests. A final ray verifies that
//! the same panes are hit along this direction.

use super::INTERFACES;
use crate::geometry::ray::Surface;
use crate::material::Materials;
use arrayvec::ArrayVec;
use glam::Vec3A;
use optics::polarization::frame::basis;

/// Maximum distance between the emitter and a ray that counts as a hit, relative to the path length.
const NEAR: f32 = 5e-6;

/// Maximum number of Newton steps for the planes of panes. Three or four steps usually suffice.
const STEPS: usize = 8;

/// A ray traced toward an emitter. Contains the vector from the emitter to the ray and the derivatives of
/// this vector.
#[derive(Clone, Copy)]
pub(super) struct Shot {
    /// Unit direction at the end of the ray. `miss` is the vector from the emitter to the nearest point of
    /// the ray, perpendicular to `dir`. `slopes` are the derivatives of `miss` with respect to the two angles
    /// of the initial direction.
    pub dir: Vec3A,
    pub miss: Vec3A,
    pub slopes: [Vec3A; 2],
    pub length: f32,
}

impl Shot {
    /// Extends a ray from `from` past `to`. `length` is the path length up to `from`. `p` and `d` are the
    /// derivatives of position and direction. Returns `None` if the ray points away from `to`.
    #[inline]
    pub fn past(to: Vec3A, from: Vec3A, dir: Vec3A, [p, d]: [[Vec3A; 2]; 2], length: f32) -> Option<Self> {
        let way = (to - from).dot(dir);
        if way <= 0.0 {
            return None;
        }
        let end = from + dir * way;
        let slopes = [0, 1].map(|k| {
            let s: Vec3A = p[k] + d[k] * way;
            s - dir * dir.dot(s)
        });
        Some(Self { dir, miss: end - to, slopes, length: length + way })
    }

    /// Returns true if the ray hits the emitter.
    #[inline]
    pub fn is_near(&self) -> bool {
        self.miss.length() < NEAR * self.length
    }
}

/// Returns the Newton step and the absolute value of the Jacobian determinant, |J|. The step is perpendicular
/// to `dir` and moves a ray along `dir` closer to the emitter.
#[inline]
pub(super) fn newton(dir: Vec3A, shot: &Shot) -> Option<(Vec3A, f32)> {
    let q = basis(shot.dir);
    let at = |v: Vec3A| [v.dot(q.x_axis), v.dot(q.y_axis)];
    let ([a, c], [b, d], [x, y]) = (at(shot.slopes[0]), at(shot.slopes[1]), at(shot.miss));
    let det = a * d - b * c;
    // The comparison with `partial_cmp` also rejects NaN.
    if det.abs().partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return None;
    }
    let across = basis(dir);
    let step = across.x_axis * ((b * y - d * x) / det) + across.y_axis * ((c * x - a * y) / det);
    Some((step, det.abs()))
}

#[derive(Default)]
pub(super) struct Panes {
    met: ArrayVec<Surface, INTERFACES>,
    /// True if at least one surface is not a flat interface, or if there are too many surfaces.
    others: bool,
}

impl Panes {
    #[inline]
    pub fn add(&mut self, surface: &Surface, flat: bool) {
        self.others |= !flat || self.met.try_push(*surface).is_err();
    }

    /// Returns the direction in which a ray of wavelength lane `lane` from a point reaches `to` through the
    /// planes of all panes. The search starts from a given direction. Returns `None` if there is no such
    /// direction, or if a surface is not flat.
    pub fn aim(
        &self,
        materials: &Materials,
        (from, mut dir): (Vec3A, Vec3A),
        to: Vec3A,
        lane: usize,
    ) -> Option<Vec3A> {
        if self.others {
            return None;
        }
        let mut shot = self.shoot(materials, from, dir, to, lane)?;
        for _ in 0..STEPS {
            let (step, _) = newton(dir, &shot)?;
            let (near, next) = (shot.is_near(), (dir + step).normalize());
            let nearer = self.shoot(materials, from, next, to, lane)?;
            if nearer.miss.length() < shot.miss.length() {
                (dir, shot) = (next, nearer);
            } else if !near {
                return None;
            }
            // When the ray is near the goal, one more step reaches rounding precision.
            if near {
                return Some(dir);
            }
        }
        None
    }

    /// Traces a ray through the planes of all panes.
    #[inline]
    fn shoot(
        &self,
        materials: &Materials,
        mut from: Vec3A,
        mut dir: Vec3A,
        to: Vec3A,
        lane: usize,
    ) -> Option<Shot> {
        let across = basis(dir);
        let mut slopes_p = [Vec3A::ZERO; 2];
        let mut slopes_d = [across.x_axis, across.y_axis];
        let mut length = 0.0;
        for s in &self.met {
            let slant = dir.dot(s.ng);
            let step = (s.p - from).dot(s.ng) / slant;
            if step.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
                return None;
            }
            let (after, ratio) = materials.refracted(s.material, s, -dir, lane)?;
            let (cos, cos_far) = (dir.dot(s.ns), after.dot(s.ns));
            for k in 0..2 {
                let p = slopes_p[k] + slopes_d[k] * step;
                slopes_p[k] = p - dir * (p.dot(s.ng) / slant);
                let pulled = (ratio - ratio * ratio * cos / cos_far) * slopes_d[k].dot(s.ns);
                slopes_d[k] = slopes_d[k] * ratio - s.ns * pulled;
            }
            from += dir * step;
            length += step;
            dir = after;
        }
        Shot::past(to, from, dir, [slopes_p, slopes_d], length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::Material;
    use crate::material::dielectric::Dielectric;
    use optics::spectrum::Spectral;

    /// Refractive indices of air, glass and water.
    const INDICES: [f64; 3] = [1.0, 1.52, 1.333];

    /// Returns materials for glass in air and for water in glass. The indices at the second wavelength are
    /// slightly different.
    fn materials() -> Materials {
        let interface = |interior: f64, exterior: f64| {
            let of = |n: f64| Spectral::new([n as f32, n as f32 + 0.02, 1.0, 1.0]);
            Material::Dielectric(Dielectric {
                interior: of(interior),
                exterior: if exterior == 1.0 { Spectral::ONE } else { of(exterior) },
                dispersive: true,
            })
        };
        Materials {
            list: vec![interface(INDICES[1], INDICES[0]), interface(INDICES[2], INDICES[1])],
            ..Materials::default()
        }
    }

    fn pane(material: u32, z: f32) -> Surface {
        Surface { p: Vec3A::new(-3.0, 2.0, z), ng: Vec3A::Z, ns: Vec3A::Z, material, ..Surface::default() }
    }

    /// Verifies that the direction from water through a pane agrees with the solution of Snell's law in
    /// double precision.
    #[test]
    fn directions_through_panes_obey_snell() {
        let materials = materials();
        let from = Vec3A::new(0.02, -0.01, -0.03);
        let mut panes = Panes::default();
        panes.add(&pane(1, 0.0), true);
        panes.add(&pane(0, 0.005), true);
        for (lane, more) in [(0, 0.0), (1, f64::from(0.02_f32))] {
            let [air, glass, water] = [INDICES[0], INDICES[1] + more, INDICES[2] + more];
            for to in [[0.02, -0.01, 0.4], [0.3, -0.2, 0.5], [-0.22, 0.05, 0.3]].map(Vec3A::from_array) {
                let way = [to.x - from.x, to.y - from.y].map(f64::from);
                let across = way[0].hypot(way[1]);
                // Compute the lateral displacement of a ray with n sin θ = k.
                let side = |k: f64| {
                    let layers = [(0.03, water), (0.005, glass), (f64::from(to.z) - 0.005, air)];
                    layers.iter().map(|(d, n)| d * k / (n * n - k * k).sqrt()).sum::<f64>()
                };
                let (mut low, mut high) = (0.0, 1.0 - 1e-12);
                for _ in 0..100 {
                    let k = (low + high) / 2.0;
                    if side(k) < across { low = k } else { high = k }
                }
                let sin = low / water;
                let want = Vec3A::new(
                    (way[0] / across.max(1e-30) * sin) as f32,
                    (way[1] / across.max(1e-30) * sin) as f32,
                    (1.0 - sin * sin).sqrt() as f32,
                );
                let straight = (to - from).normalize();
                let found = panes.aim(&materials, (from, straight), to, lane).expect("there is a path");
                assert!((found - want).length() < 3e-6, "found {found}, expected {want}");
            }
        }
    }

    /// Verifies that no direction is returned for curved panes or under total internal reflection.
    #[test]
    fn curved_panes_and_total_reflection_give_no_direction() {
        let materials = materials();
        let (from, to) = (Vec3A::new(0.0, 0.0, -0.1), Vec3A::new(0.1, 0.0, 0.4));
        let aim = |flat: bool, dir: Vec3A| {
            let mut panes = Panes::default();
            panes.add(&pane(1, 0.0), true);
            panes.add(&pane(0, 0.005), flat);
            panes.aim(&materials, (from, dir.normalize()), to, 0)
        };
        assert!(aim(true, to - from).is_some());
        assert!(aim(false, to - from).is_none());
        assert!(aim(true, Vec3A::new(1.0, 0.0, 0.1)).is_none());
    }
}

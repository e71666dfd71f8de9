//! Sphere, disk and cylinder, intersected exactly in their own space.
//!
//! Object space: unit sphere about the origin; unit disk in z = 0 facing +z; open tube of radius 1 from z = 0 to 1
//! facing outward. An affine map takes them to the world, so ellipsoids and elliptic tubes are possible.

use glam::{Affine3A, Mat3A, Vec3A};
use std::f32::consts::{PI, TAU};

/// Which surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum QuadricKind {
    Sphere,
    Disk,
    Cylinder,
}

/// A quadric placed in the world.
#[derive(Clone, Copy, Debug)]
pub struct Quadric {
    pub kind: QuadricKind,
    /// Index of the material.
    pub material: u32,
    to_world: Affine3A,
    to_object: Affine3A,
    /// Inverse transpose of `to_world`: maps normals.
    normals: Mat3A,
}

/// Roots of a·t² - 2·b·t + c with the sign convention of the half-b form, without cancellation (Haines et al. 2019,
/// "Precision improvements for ray/sphere intersection"); `disc` is b² - a·c computed by the caller.
fn roots(a: f32, b: f32, c: f32, disc: f32) -> Option<[f32; 2]> {
    if disc < 0.0 || a <= 0.0 {
        return None;
    }
    let q = b + disc.sqrt().copysign(b);
    let (t0, t1) = if q == 0.0 { (0.0, 0.0) } else { (c / q, q / a) };
    Some(if t0 < t1 { [t0, t1] } else { [t1, t0] })
}

impl Quadric {
    /// Places a quadric; `to_world` must be invertible (the scene builder checks).
    #[must_use]
    pub fn new(kind: QuadricKind, to_world: Affine3A, material: u32) -> Self {
        let to_object = to_world.inverse();
        Self {
            kind,
            material,
            to_world,
            to_object,
            normals: to_object.matrix3.transpose(),
        }
    }

    /// Nearest distance in (tmin, tmax), infinity for none.
    #[must_use]
    pub fn intersect(&self, origin: Vec3A, dir: Vec3A, tmin: f32, tmax: f32) -> f32 {
        let o = self.to_object.transform_point3a(origin);
        let d = self.to_object.transform_vector3a(dir);
        let inside = |t: f32| t > tmin && t < tmax;
        match self.kind {
            QuadricKind::Sphere => {
                let a = d.length_squared();
                let b = -o.dot(d);
                // Discriminant from the closest approach, exact for far and near origins alike.
                let closest = o + d * (b / a);
                let disc = a * (1.0 - closest.length_squared());
                let c = (o.length() - 1.0) * (o.length() + 1.0);
                let Some([t0, t1]) = roots(a, b, c, disc) else {
                    return f32::INFINITY;
                };
                [t0, t1].into_iter().find(|t| inside(*t)).unwrap_or(f32::INFINITY)
            }
            QuadricKind::Disk => {
                let t = -o.z / d.z;
                let (x, y) = (o.x + t * d.x, o.y + t * d.y);
                if inside(t) && x * x + y * y <= 1.0 {
                    t
                } else {
                    f32::INFINITY
                }
            }
            QuadricKind::Cylinder => {
                let a = d.x * d.x + d.y * d.y;
                let b = -(o.x * d.x + o.y * d.y);
                let (cx, cy) = (o.x + d.x * b / a, o.y + d.y * b / a);
                let disc = a * (1.0 - (cx * cx + cy * cy));
                let r = o.x.hypot(o.y);
                let Some(both) = roots(a, b, (r - 1.0) * (r + 1.0), disc) else {
                    return f32::INFINITY;
                };
                both.into_iter()
                    .find(|&t| inside(t) && (0.0..=1.0).contains(&(o.z + t * d.z)))
                    .unwrap_or(f32::INFINITY)
            }
        }
    }

    /// Position (put back on the surface), unit outward normal and ∂p/∂u (unnormalized) at a hit.
    ///
    /// u runs about the axis of a sphere (v from its +z pole down) and of a cylinder. A disk's u is the radius, but its
    /// tangent is the object's x axis everywhere, so that a disk of polarizer has one direction.
    #[must_use]
    pub fn surface(&self, hit: Vec3A) -> (Vec3A, Vec3A, Vec3A) {
        let o = self.to_object.transform_point3a(hit);
        let (o, n, u) = match self.kind {
            QuadricKind::Sphere => {
                let n = o.normalize();
                (n, n, Vec3A::new(-n.y, n.x, 0.0))
            }
            QuadricKind::Disk => (Vec3A::new(o.x, o.y, 0.0), Vec3A::Z, Vec3A::X),
            QuadricKind::Cylinder => {
                let r = o.x.hypot(o.y).max(f32::MIN_POSITIVE);
                let n = Vec3A::new(o.x / r, o.y / r, 0.0);
                (Vec3A::new(n.x, n.y, o.z), n, Vec3A::new(-n.y, n.x, 0.0))
            }
        };
        (
            self.to_world.transform_point3a(o),
            (self.normals * n).normalize(),
            self.to_world.transform_vector3a(u),
        )
    }

    /// Texture coordinates at a point of the surface.
    #[must_use]
    pub fn uv(&self, p: Vec3A) -> [f32; 2] {
        let o = self.to_object.transform_point3a(p);
        let turn = o.y.atan2(o.x).rem_euclid(TAU) / TAU;
        match self.kind {
            QuadricKind::Sphere => [turn, (o.z / o.length()).clamp(-1.0, 1.0).acos() / PI],
            QuadricKind::Disk => [o.x.hypot(o.y), turn],
            QuadricKind::Cylinder => [turn, o.z],
        }
    }

    /// World bounds (min, max).
    #[must_use]
    pub fn bounds(&self) -> (Vec3A, Vec3A) {
        let m = self.to_world.matrix3;
        let t = self.to_world.translation;
        let (half, centre) = match self.kind {
            // Support of an ellipsoid along each world axis: the length of the matrix row.
            QuadricKind::Sphere => (rows_length(m, true), t),
            QuadricKind::Disk => (rows_length(m, false), t),
            QuadricKind::Cylinder => (rows_length(m, false) + (m.z_axis * 0.5).abs(), t + m.z_axis * 0.5),
        };
        // A hair of padding so that flat and rounded surfaces never fall outside their box.
        let pad = half * 1e-5 + centre.abs() * 1e-6 + Vec3A::splat(1e-9);
        (centre - half - pad, centre + half + pad)
    }
}

/// Length of every matrix row over all three, or the first two, columns.
fn rows_length(m: Mat3A, three: bool) -> Vec3A {
    let sq = |v: Vec3A| v * v;
    let s = sq(m.x_axis) + sq(m.y_axis) + if three { sq(m.z_axis) } else { Vec3A::ZERO };
    Vec3A::new(s.x.sqrt(), s.y.sqrt(), s.z.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{stream::Stream, warp};
    use glam::{Quat, Vec3};

    fn all() -> [Quadric; 3] {
        let t = Affine3A::from_scale_rotation_translation(
            Vec3::new(0.5, 0.5, 0.8),
            Quat::from_rotation_x(0.7),
            Vec3::new(3.0, -2.0, 1.0),
        );
        [QuadricKind::Sphere, QuadricKind::Disk, QuadricKind::Cylinder].map(|k| Quadric::new(k, t, 0))
    }

    #[test]
    fn known_distances() {
        let s = Quadric::new(QuadricKind::Sphere, Affine3A::IDENTITY, 0);
        let d = Vec3A::new(0.0, 0.0, -1.0);
        let at = |o: Vec3A| s.intersect(o, d, 0.0, f32::INFINITY);
        assert!((at(Vec3A::new(0.0, 0.0, 5.0)) - 4.0).abs() < 1e-6);
        assert!((at(Vec3A::ZERO) - 1.0).abs() < 1e-6, "from inside");
        assert_eq!(at(Vec3A::new(1.01, 0.0, 5.0)), f32::INFINITY);
        assert_eq!(at(Vec3A::new(0.0, 0.0, -5.0)), f32::INFINITY, "behind");
        let far = s.intersect(Vec3A::new(0.0, 0.0, 1e4), d, 0.0, f32::INFINITY);
        assert!((far - 9999.0).abs() < 1e-2);
    }

    #[test]
    fn hits_lie_on_the_surface_and_in_the_bounds() {
        let mut stream = Stream::new(0, 0, 0);
        for q in all() {
            let (lo, hi) = q.bounds();
            let mut hits = 0;
            for _ in 0..20_000 {
                let o = Vec3A::new(3.0, -2.0, 1.0) + warp::sphere(stream.uniform2()) * 3.0;
                let target = Vec3A::new(3.0, -2.0, 1.0) + warp::sphere(stream.uniform2()) * 0.6;
                let d = (target - o).normalize();
                let t = q.intersect(o, d, 0.0, f32::INFINITY);
                if t.is_finite() {
                    hits += 1;
                    let p = o + d * t;
                    let (on, n, _) = q.surface(p);
                    assert!((on - p).length() < 2e-5);
                    assert!((n.length() - 1.0).abs() < 1e-5);
                    assert!(p.cmpge(lo).all() && p.cmple(hi).all(), "{:?}", q.kind);
                }
            }
            assert!(hits > 500, "{:?} {hits}", q.kind);
        }
    }
}

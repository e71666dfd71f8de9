//! Spheres, disks and cylinders, intersected exactly in object space.
//!
//! In object space, the shapes are:
//! - the unit sphere centred on the origin,
//! - the unit disk at z = 0 facing +z,
//! - the open tube of radius 1 from z = 0 to z = 1, facing outward.
//!
//! An affine map transforms the shapes to world space. In world space, the shapes may be ellipsoids and
//! elliptic tubes.

use super::instance::stretch;
use super::rounding;
use glam::{Affine3A, Mat3A, Vec3A};
use optics::sampling::warp;
use std::f32::consts::{PI, TAU};

/// The kind of a quadric. Lengths are in object space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum QuadricKind {
    /// Unit sphere centred on the origin.
    Sphere,
    /// Unit disk at z = 0, facing +z.
    Disk,
    /// Open tube of radius 1 from z = 0 to z = 1, facing outward.
    Cylinder,
}

/// A quadric with its transform to the world.
#[derive(Clone, Copy, Debug)]
pub struct Quadric {
    pub kind: QuadricKind,
    pub material: u32,
    to_world: Affine3A,
    to_object: Affine3A,
    /// Inverse transpose of `to_world` times `facing`. The product transforms normals.
    normals: Mat3A,
    /// 1 if normals point outward, -1 if they point inward.
    facing: f32,
    /// Centre and radius of a surface that is a sphere in the world, metres. The radius is 0 for other
    /// surfaces.
    centre: Vec3A,
    radius: f32,
    /// Axis of rotation along which the texture coordinate u increases.
    turn: Vec3A,
    /// Rounding constant (see [`Surface::rounding`](super::ray::Surface::rounding)).
    pub(crate) rounding: f32,
}

/// Returns the roots of a·t² - 2·b·t + c in ascending order, without cancellation (Haines et al. 2019,
/// "Precision improvements for ray/sphere intersection").
///
/// `disc` is b² - a·c, computed by the caller. For a ray that starts inside a sphere (c < 0), two roots
/// always exist. If rounding makes `disc` negative for an origin inside the sphere, `disc` is replaced by its
/// lower bound -a·c.
#[inline]
fn roots(a: f32, b: f32, c: f32, mut disc: f32) -> Option<[f32; 2]> {
    if disc < 0.0 && c < 0.0 {
        disc = -a * c;
    }
    if disc < 0.0 || a <= 0.0 {
        return None;
    }
    let q = b + disc.sqrt().copysign(b);
    let (t0, t1) = if q == 0.0 { (0.0, 0.0) } else { (c / q, q / a) };
    Some(if t0 < t1 { [t0, t1] } else { [t1, t0] })
}

impl Quadric {
    /// Places a quadric. `to_world` must be invertible, which the scene builder checks.
    pub fn new(kind: QuadricKind, to_world: Affine3A, material: u32) -> Self {
        let to_object = to_world.inverse();
        let radius = if kind == QuadricKind::Sphere { similarity(to_world.matrix3) } else { 0.0 };
        let [out, back] = [to_world, to_object].map(|m| stretch(m.matrix3));
        Self {
            kind,
            material,
            to_world,
            to_object,
            normals: to_object.matrix3.transpose(),
            facing: 1.0,
            centre: to_world.translation,
            radius,
            rounding: if radius > 0.0 { rounding::BALL } else { rounding::placed(rounding::BALL, out, back) },
            turn: to_world.matrix3.z_axis * to_world.matrix3.determinant().signum(),
        }
    }

    /// Returns the same surface with front and back exchanged.
    pub fn flipped(mut self) -> Self {
        self.facing = -self.facing;
        self.normals *= -1.0;
        self
    }

    /// Returns the surface translated by `by`, metres.
    pub(super) fn shifted(&self, by: Vec3A) -> Self {
        let mut to_world = self.to_world;
        to_world.translation += by;
        let moved = Self::new(self.kind, to_world, self.material);
        if self.facing < 0.0 { moved.flipped() } else { moved }
    }

    /// Returns the centre and the radius (metres) of a surface that is a sphere in world space, or `None` for
    /// other surfaces.
    pub fn ball(&self) -> Option<(Vec3A, f32)> {
        (self.radius > 0.0).then_some((self.centre, self.radius))
    }

    /// Returns the distance to the nearest hit on a sphere in (0, tmax), or infinity if there is none (see
    /// [`roots`]).
    #[inline(always)]
    fn meet_ball(&self, origin: Vec3A, dir: Vec3A, tmax: f32) -> f32 {
        let o = origin - self.centre;
        let b = -o.dot(dir);
        let closest = o + dir * b;
        let r = self.radius;
        let mut disc = r * r - closest.length_squared();
        if disc < 0.0 {
            // The computation is the same as in [`roots`].
            let distance = o.length();
            disc = (r - distance) * (r + distance);
            if disc <= 0.0 {
                return f32::INFINITY;
            }
        }
        let distance = o.length();
        let q = b + disc.sqrt().copysign(b);
        let other = (distance - r) * (distance + r) / q;
        let (near, far) = if q < other { (q, other) } else { (other, q) };
        if near > 0.0 && near < tmax {
            near
        } else if far > 0.0 && far < tmax {
            far
        } else {
            f32::INFINITY
        }
    }

    /// Returns the distance to the nearest hit in (0, tmax), or infinity if there is none. `dir` is a unit
    /// vector.
    #[inline(always)]
    pub fn intersect(&self, origin: Vec3A, dir: Vec3A, tmax: f32) -> f32 {
        if self.radius > 0.0 {
            return self.meet_ball(origin, dir, tmax);
        }
        self.meet(origin, dir, tmax)
    }

    /// Returns the result of [`Self::intersect`] for a surface that is not a sphere in world space.
    #[inline]
    fn meet(&self, origin: Vec3A, dir: Vec3A, tmax: f32) -> f32 {
        let o = self.to_object.transform_point3a(origin);
        let d = self.to_object.transform_vector3a(dir);
        let inside = |t: f32| t > 0.0 && t < tmax;
        match self.kind {
            QuadricKind::Sphere => {
                let a = d.length_squared();
                let b = -o.dot(d);
                // Use the point of closest approach, which is accurate for distant and near origins.
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
                if inside(t) && x * x + y * y <= 1.0 { t } else { f32::INFINITY }
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

    /// Returns three vectors at a hit: the position (projected onto the surface), the unit outward normal,
    /// and ∂p/∂u (unnormalized).
    ///
    /// u is the azimuth about the axis of a sphere or a cylinder. On a sphere, v is 0 at the +z pole. On a
    /// disk, u is the radius, but the tangent is the object's x axis everywhere. A polarizer on a disk
    /// therefore has a uniform axis.
    #[inline(always)]
    pub fn surface(&self, hit: Vec3A) -> (Vec3A, Vec3A, Vec3A) {
        if self.radius > 0.0 {
            let n = (hit - self.centre).normalize();
            // Rotate about the object's own axis, even if the map to world space is a reflection.
            let u = self.turn.cross(n);
            return (self.centre + n * self.radius, n * self.facing, u);
        }
        self.own_surface(hit)
    }

    /// Returns the result of [`Self::surface`] for a surface that is not a sphere in world space.
    #[inline]
    fn own_surface(&self, hit: Vec3A) -> (Vec3A, Vec3A, Vec3A) {
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

    /// Returns the derivative of the unit outward normal with respect to the position on the surface, 1/m.
    #[inline]
    pub fn bend(&self, p: Vec3A) -> Mat3A {
        let o = self.to_object.transform_point3a(p);
        let (n, slope) = match self.kind {
            QuadricKind::Sphere => (o, Mat3A::IDENTITY),
            QuadricKind::Disk => return Mat3A::ZERO,
            QuadricKind::Cylinder => {
                (Vec3A::new(o.x, o.y, 0.0), Mat3A::from_diagonal(glam::Vec3::new(1.0, 1.0, 0.0)))
            }
        };
        normalized_slope(self.normals * n, self.normals * slope * self.to_object.matrix3)
    }

    /// Returns ∂p/∂u and ∂p/∂v of [`Self::uv`] at a surface point. The derivatives ∂p/∂u and ∂p/∂v are 0 at
    /// the poles of a sphere and at the centre of a disk. Elsewhere on a disk, ∂p/∂u is the tangent of
    /// [`Self::surface`], and ∂p/∂v is 0.
    pub fn derivatives(&self, p: Vec3A) -> [Vec3A; 2] {
        let o = self.to_object.transform_point3a(p);
        let r = o.x.hypot(o.y);
        if r == 0.0 {
            return [Vec3A::ZERO; 2];
        }
        let (out, around) = (Vec3A::new(o.x / r, o.y / r, 0.0), Vec3A::new(-o.y, o.x, 0.0) * TAU);
        let own = match self.kind {
            QuadricKind::Sphere => [around, (out * o.z - Vec3A::Z * r) * PI],
            QuadricKind::Disk => [Vec3A::X, Vec3A::ZERO],
            QuadricKind::Cylinder => [around, Vec3A::Z],
        };
        own.map(|d| self.to_world.transform_vector3a(d))
    }

    /// Returns the texture coordinates at a point of the surface.
    #[inline]
    pub fn uv(&self, p: Vec3A) -> [f32; 2] {
        let o = self.to_object.transform_point3a(p);
        let turn = o.y.atan2(o.x).rem_euclid(TAU) / TAU;
        match self.kind {
            QuadricKind::Sphere => [turn, (o.z / o.length()).clamp(-1.0, 1.0).acos() / PI],
            QuadricKind::Disk => [o.x.hypot(o.y), turn],
            QuadricKind::Cylinder => [turn, o.z],
        }
    }

    /// Returns the ratio of surface area in the world to surface area in object space, at a point given in
    /// object space.
    #[inline]
    fn growth(&self, o: Vec3A) -> f32 {
        let m = self.to_world.matrix3;
        match self.kind {
            QuadricKind::Sphere => m.determinant().abs() * (self.normals * o).length(),
            QuadricKind::Disk => m.x_axis.cross(m.y_axis).length(),
            QuadricKind::Cylinder => {
                let around = m.y_axis * o.x - m.x_axis * o.y;
                around.cross(m.z_axis).length()
            }
        }
    }

    /// Samples a point uniformly by area in object space, and returns this point and the unit normal in world
    /// space.
    pub fn point(&self, u: [f32; 2]) -> (Vec3A, Vec3A) {
        let o = match self.kind {
            QuadricKind::Sphere => warp::sphere(u),
            QuadricKind::Disk => warp::concentric_disk(u).extend(0.0).into(),
            QuadricKind::Cylinder => {
                let (s, c) = warp::sin_cos_turns(u[0]);
                Vec3A::new(c, s, u[1])
            }
        };
        let (p, n, _) = self.surface(self.to_world.transform_point3a(o));
        (p, n)
    }

    /// Returns the probability density per area of [`Self::point`], 1/m².
    pub fn density(&self, p: Vec3A) -> f32 {
        let o = self.to_object.transform_point3a(p);
        let own = match self.kind {
            QuadricKind::Sphere => 4.0 * PI,
            QuadricKind::Disk => PI,
            QuadricKind::Cylinder => TAU,
        };
        1.0 / (own * self.growth(o))
    }

    /// Returns true if a sphere or tube contains the point after the surface is scaled by `grown` about the
    /// centre.
    pub fn holds(&self, p: Vec3A, grown: f32) -> bool {
        let o = self.to_object.transform_point3a(p);
        match self.kind {
            QuadricKind::Sphere => o.length() < grown,
            QuadricKind::Disk => false,
            QuadricKind::Cylinder => o.truncate().length() < grown && (o.z - 0.5).abs() < 0.5 * grown,
        }
    }

    /// Returns the surface area, m².
    pub fn area(&self) -> f32 {
        const N: usize = 64;
        if let Some((_, radius)) = self.ball() {
            return 4.0 * PI * radius * radius;
        }
        let at = |i: usize| (i as f32 + 0.5) / N as f32;
        let one = |k: usize| f64::from(1.0 / self.density(self.point([at(k % N), at(k / N)]).0));
        ((0..N * N).map(one).sum::<f64>() / (N * N) as f64) as f32
    }

    /// Returns the world bounds (min, max).
    pub fn bounds(&self) -> (Vec3A, Vec3A) {
        let m = self.to_world.matrix3;
        let t = self.to_world.translation;
        let (half, centre) = match self.kind {
            // The half extent of an ellipsoid along a world axis is the length of a matrix row.
            QuadricKind::Sphere => (rows_length(m, true), t),
            QuadricKind::Disk => (rows_length(m, false), t),
            QuadricKind::Cylinder => (rows_length(m, false) + (m.z_axis * 0.5).abs(), t + m.z_axis * 0.5),
        };
        // Pad the box so that flat surfaces and rounded coordinates stay inside.
        let pad = half * 1e-5 + centre.abs() * 1e-6 + Vec3A::splat(1e-9);
        (centre - half - pad, centre + half + pad)
    }
}

/// Returns the derivative of a normalized vector, given the vector before normalization and the derivative of
/// that vector.
#[inline]
pub(super) fn normalized_slope(v: Vec3A, slope: Mat3A) -> Mat3A {
    let length = v.length().max(f32::MIN_POSITIVE);
    let n = v / length;
    let across = |c: Vec3A| (c - n * n.dot(c)) / length;
    Mat3A::from_cols(across(slope.x_axis), across(slope.y_axis), across(slope.z_axis))
}

/// Returns the scale factor of a similarity transform, or 0 for other maps.
pub(super) fn similarity(m: Mat3A) -> f32 {
    let r = m.x_axis.length();
    let uneven = [
        m.y_axis.length() - r,
        m.z_axis.length() - r,
        m.x_axis.dot(m.y_axis) / r,
        m.y_axis.dot(m.z_axis) / r,
        m.z_axis.dot(m.x_axis) / r,
    ];
    if uneven.iter().all(|u| u.abs() <= 1e-6 * r) { r } else { 0.0 }
}

/// Returns the length of each matrix row over all three columns, or over the first two if `three` is false.
fn rows_length(m: Mat3A, three: bool) -> Vec3A {
    let sq = |v: Vec3A| v * v;
    let s = sq(m.x_axis) + sq(m.y_axis) + if three { sq(m.z_axis) } else { Vec3A::ZERO };
    Vec3A::new(s.x.sqrt(), s.y.sqrt(), s.z.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Quat, Vec3};
    use optics::sampling::stream::Stream;

    /// Verifies that the special case of spheres in world space gives the same hits, normals and tangents as
    /// the general method in object space. One of the two spheres is reflected.
    #[test]
    fn balls_are_spheres() {
        let mut stream = Stream::new(4, 0, 0);
        for scale in [Vec3::splat(0.7), Vec3::new(-0.7, 0.7, 0.7)] {
            let place = Affine3A::from_scale_rotation_translation(
                scale,
                Quat::from_rotation_x(0.7),
                Vec3::new(3.0, -2.0, 1.0),
            );
            let ball = Quadric::new(QuadricKind::Sphere, place, 0);
            assert!(ball.ball().is_some_and(|(_, r)| (r - 0.7).abs() < 1e-6));
            let plain = Quadric { radius: 0.0, ..ball };
            let mut hits = 0;
            for _ in 0..5000 {
                let centre = Vec3A::new(3.0, -2.0, 1.0);
                let o = centre + warp::sphere(stream.uniform2()) * 3.0 * stream.uniform();
                let d = (centre + warp::sphere(stream.uniform2()) * 0.8 - o).normalize();
                let [a, b] = [&ball, &plain].map(|q| q.intersect(o, d, f32::INFINITY));
                let p = (o + d * a - centre).length();
                if a.is_infinite() != b.is_infinite() {
                    assert!((p - 0.7).abs() < 1e-3 || !p.is_finite());
                    continue;
                }
                if a.is_finite() {
                    hits += 1;
                    assert!((a - b).abs() < 1e-4 * (1.0 + a), "{a} {b}");
                    let (x, y) = (ball.surface(o + d * a), plain.surface(o + d * a));
                    assert!((x.0 - y.0).length() < 2e-6 && (x.1 - y.1).length() < 1e-5);
                    assert!((x.2 - y.2).length() < 1e-5);
                }
            }
            assert!(hits > 3000);
        }
        let uneven = Affine3A::from_scale(Vec3::new(1.0, 1.0, 1.001));
        assert!(Quadric::new(QuadricKind::Sphere, uneven, 0).ball().is_none());
    }

    /// Compares the derivative of the normal with finite differences.
    #[test]
    fn normal_derivatives_match_finite_differences() {
        let mut stream = Stream::new(5, 0, 0);
        let ball = Quadric::new(QuadricKind::Sphere, Affine3A::from_scale(Vec3::splat(0.7)), 0);
        for q in all().into_iter().chain([ball]) {
            let mut tried = 0;
            while tried < 200 {
                let (lo, hi) = q.bounds();
                let o = (lo + hi) * 0.5 + warp::sphere(stream.uniform2()) * 3.0;
                let d = ((lo + hi) * 0.5 + warp::sphere(stream.uniform2()) * 0.3 - o).normalize();
                let t = q.intersect(o, d, f32::INFINITY);
                if !t.is_finite() {
                    continue;
                }
                tried += 1;
                let (p, n, tangent) = q.surface(o + d * t);
                let along = tangent.normalize() * 1e-2;
                let (a, b) = (q.surface(p + along), q.surface(p - along));
                let want = (a.1 - b.1) / 2e-2;
                let got = q.bend(p) * ((a.0 - b.0) / 2e-2);
                assert!((got - want).length() < 2e-3 * (1.0 + want.length()), "{got} {want}");
                assert!(got.dot(n).abs() < 1e-4);
            }
        }
    }

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
        let at = |o: Vec3A| s.intersect(o, d, f32::INFINITY);
        assert!((at(Vec3A::new(0.0, 0.0, 5.0)) - 4.0).abs() < 1e-6);
        assert!((at(Vec3A::ZERO) - 1.0).abs() < 1e-6, "from inside");
        assert_eq!(at(Vec3A::new(1.01, 0.0, 5.0)), f32::INFINITY);
        assert_eq!(at(Vec3A::new(0.0, 0.0, -5.0)), f32::INFINITY, "behind");
        let far = s.intersect(Vec3A::new(0.0, 0.0, 1e4), d, f32::INFINITY);
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
                let t = q.intersect(o, d, f32::INFINITY);
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

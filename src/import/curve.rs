//! Converts curves with a radius at each point (Mitsuba 3's `bsplinecurve` and `linearcurve`) to triangle
//! meshes.
//!
//! The surface is a tube along a uniform cubic B-spline, or a sequence of spheres at the points joined by
//! cones. Texture coordinates are Mitsuba's. u varies around the tube, starting from a frame defined by the
//! z axis. v varies along all segments of the file.

use super::error::{ImportError, ImportProblem};
use super::text;
use glam::{DAffine3, DQuat, DVec3, DVec4, Vec2};
use std::f64::consts::{FRAC_PI_2, TAU};
use transport::geometry::mesh::Mesh;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A uniform cubic B-spline with open ends.
    BSpline,
    /// A sphere at each point, joined by cones that touch the spheres.
    Linear,
}

#[derive(Clone, Debug)]
pub struct Tubes {
    /// Triangles that face outward, with normals and Mitsuba's texture coordinates.
    pub mesh: Mesh,
    /// Number of corners of a polygonal cross-section. The polygon has the same circumference as the circle.
    pub sides: u32,
    /// Upper bound of the distance between the mesh and the surface of the curves, in metres.
    pub deviation: f64,
}

const MOST: usize = 4_000_000;
/// Possible numbers of corners of a cross-section. The first number for which the mesh satisfies [`MOST`] is
/// used.
const SIDES: [u32; 3] = [24, 12, 6];
const PIECES: f64 = 64.0;
/// Tolerances above which a curve is split into more pieces: chord distance relative to the radius,
/// and rotation of the tangent in radians.
const CHORD: f64 = 0.01;
const TURN: f64 = TAU / 36.0;
const FIX: &str = "write one point per line as x y z radius, with an empty line between curves";

/// Parses curves. Each line is one point (x, y, z, radius). Empty lines separate curves. `place` transforms
/// points but not radii.
///
/// # Errors
/// Returns [`ImportError`] with the line number, if:
/// - A number is missing or not finite.
/// - A radius is negative.
/// - A curve has too few points or no extent.
/// - All radii are 0.
/// - More than 4 million triangles are needed.
pub fn parse_curves(bytes: &[u8], kind: Kind, place: &DAffine3) -> Result<Tubes, ImportError> {
    let curves = points(bytes, kind, place)?;
    let least = if kind == Kind::BSpline { 3 } else { 1 };
    let segments: usize = curves.iter().map(|c| c.len() - least).sum();
    for sides in SIDES {
        let mut sweep = Sweep::new(sides, segments);
        let mut before = 0;
        for curve in &curves {
            match kind {
                Kind::BSpline => sweep.spline(curve, before)?,
                Kind::Linear => sweep.cones(curve, before),
            }
            before += curve.len() - least;
            if sweep.mesh.indices.len() > MOST {
                break;
            }
        }
        if sweep.mesh.indices.len() <= MOST {
            let Sweep { mesh, deviation, .. } = sweep;
            mesh.validate().map_err(|cause| ImportProblem::Mesh { name: String::new(), cause })?;
            return Ok(Tubes { mesh, sides, deviation });
        }
    }
    Err(ImportError::new(
        format!("the curves need more than {MOST} triangles"),
        "split the file into several files, or use fewer points",
    ))
}

fn points(bytes: &[u8], kind: Kind, place: &DAffine3) -> Result<Vec<Vec<DVec4>>, ImportError> {
    let (mut curves, mut open): (Vec<Vec<DVec4>>, bool) = (vec![], false);
    let text = text::decode(bytes);
    for (number, line) in (1..).zip(text::lines(&text)) {
        if line.trim().is_empty() {
            open = false;
            continue;
        }
        let wrong = |what: String| Err(ImportError::new(what, FIX).at_line(number));
        let values: Option<Vec<f64>> = line.split_whitespace().map(|word| word.parse().ok()).collect();
        let Some(&[x, y, z, radius]) = values.as_deref() else {
            return wrong(format!("expected four numbers (x y z radius), got `{}`", line.trim()));
        };
        let p = place.transform_point3(DVec3::new(x, y, z));
        if !p.as_vec3().is_finite() || !(radius as f32).is_finite() {
            return wrong(format!("a coordinate or the radius is not a finite number: `{}`", line.trim()));
        }
        if radius < 0.0 {
            return wrong(format!("expected a radius of at least 0, got {radius}"));
        }
        if !open {
            curves.push(vec![]);
            open = true;
        }
        curves.last_mut().expect("one is open").push(p.extend(radius));
    }
    let least = if kind == Kind::BSpline { 4 } else { 2 };
    match curves.iter().position(|c| c.len() < least) {
        Some(i) => Err(ImportError::new(
            format!("curve {} has {} points, but expected at least {least}", i + 1, curves[i].len()),
            FIX,
        )),
        None if curves.is_empty() => Err(ImportProblem::EmptyFile.into()),
        None => Ok(curves),
    }
}

/// A cross-section of a tube. At the corner in the outward direction `e`, the surface normal is parallel to
/// (q - w·e) e - s.
#[derive(Clone, Copy)]
struct Ring {
    center: DVec3,
    tangent: DVec3,
    radius: f64,
    v: f64,
    q: f64,
    w: DVec3,
    s: DVec3,
}

/// Returns Mitsuba's two axes perpendicular to a tangent. u is 1/4 along the first axis and 0 along the
/// second axis.
fn across(tangent: DVec3) -> [DVec3; 2] {
    let rotated = (DVec3::Z - tangent * tangent.z).try_normalize();
    let rotated = rotated.unwrap_or(DVec3::Y);
    [rotated, rotated.cross(tangent)]
}

struct Sweep {
    mesh: Mesh,
    deviation: f64,
    sides: u32,
    segments: f64,
    /// Distance of a corner from the axis, divided by the radius of the circle with the same circumference.
    corner: f64,
}

impl Sweep {
    fn new(sides: u32, segments: usize) -> Self {
        let half = TAU / 2.0 / f64::from(sides);
        Self {
            mesh: Mesh::default(),
            deviation: 0.0,
            sides,
            segments: segments as f64,
            corner: half / half.sin(),
        }
    }

    /// Adds the corners of a ring as vertices, starting at corner `shift`, and returns the index of the first
    /// vertex.
    fn ring(&mut self, ring: &Ring, shift: i64) -> u32 {
        let first = self.mesh.positions.len() as u32;
        let [rotated, radial] = across(ring.tangent);
        for k in 0..=i64::from(self.sides) {
            let u = (k + shift) as f64 / f64::from(self.sides);
            // Corners at the seam must be bit-identical.
            let turn = (k + shift).rem_euclid(i64::from(self.sides)) as f64 / f64::from(self.sides) * TAU;
            let e = radial * turn.cos() + rotated * turn.sin();
            let normal = (e * (ring.q - ring.w.dot(e)).max(1e-3 * ring.q) - ring.s).normalize_or(e);
            self.mesh.positions.push((ring.center + e * (ring.radius * self.corner)).as_vec3());
            self.mesh.normals.push(normal.as_vec3());
            self.mesh.uvs.push(Vec2::new(u as f32, ring.v as f32));
        }
        first
    }

    /// Joins consecutive rings by triangles. A triangle is omitted if all its normals are `hidden`.
    fn join(&mut self, rings: &[Ring], hidden: impl Fn(DVec3) -> bool) {
        let Some(first) = rings.first() else { return };
        let mut near = self.ring(first, 0);
        for pair in rings.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            // Rotation of Mitsuba's frame about the tangent between the rings, in units of corners.
            let carried = DQuat::from_rotation_arc(a.tangent, b.tangent) * across(a.tangent)[1];
            let [rotated, radial] = across(b.tangent);
            let turn = carried.dot(rotated).atan2(carried.dot(radial));
            let shift = (turn / TAU * f64::from(self.sides)).round() as i64;
            let far = self.ring(&b, shift);
            for k in 0..self.sides {
                let [p, q, r, s] = [near + k, near + k + 1, far + k + 1, far + k];
                for corners in [[p, q, r], [p, r, s]] {
                    let [x, y, z] = corners.map(|i| self.mesh.positions[i as usize]);
                    let flat = (y - x).as_dvec3().cross((z - x).as_dvec3()) == DVec3::ZERO;
                    let unseen = || corners.iter().all(|i| hidden(self.mesh.normals[*i as usize].as_dvec3()));
                    if !flat && !unseen() {
                        self.mesh.indices.push(corners);
                    }
                }
            }
            near = if shift == 0 { far } else { self.ring(&b, 0) };
            let thickest = a.radius.max(b.radius);
            let sagitta = 1.0 - self.corner * (TAU / 2.0 / f64::from(self.sides)).cos();
            self.deviation = self.deviation.max(thickest * sagitta);
        }
    }

    fn spline(&mut self, curve: &[DVec4], before: usize) -> Result<(), ImportError> {
        let mut rings = vec![];
        let mut bend: f64 = 0.0;
        for (i, p) in curve.windows(4).enumerate() {
            let p = [p[0], p[1], p[2], p[3]];
            let at = |v: f64| position(&p, v);
            let chord = |v: f64| at(0.0).lerp(at(1.0), v);
            let (mut off, mut turned, mut thickest): (f64, f64, f64) = (0.0, 0.0, 0.0);
            for k in 0..8 {
                let v = f64::from(k) / 8.0;
                let [a, b] = [v, v + 0.125].map(|v| derivatives(&p, v)[0].truncate());
                turned += if a == DVec3::ZERO || b == DVec3::ZERO { 0.0 } else { a.angle_between(b) };
                let axis = (at(1.0) - at(0.0)).truncate().normalize_or_zero();
                let from = at(v) - chord(v);
                off = off.max(from.truncate().reject_from_normalized(axis).length() + from.w.abs());
                thickest = thickest.max(at(v).w);
            }
            // With n pieces, the distance between chord and curve is n² times smaller.
            let wanted = (off / (CHORD * thickest.max(1e-3 * off))).sqrt().max(turned / TURN);
            let pieces = wanted.ceil().clamp(1.0, PIECES);
            bend = bend.max(off / (pieces * pieces));
            let from = u32::from(i > 0);
            for k in from..=pieces as u32 {
                let v = f64::from(k) / pieces;
                let [d, dd] = derivatives(&p, v);
                let (velocity, here) = (d.truncate(), at(v));
                rings.push(Ring {
                    center: here.truncate(),
                    tangent: velocity.normalize_or_zero(),
                    radius: here.w,
                    v: ((before + i) as f64 + v) / self.segments,
                    q: velocity.length_squared(),
                    w: dd.truncate() * here.w,
                    s: velocity * d.w,
                });
            }
        }
        // Where the derivative is zero, use the tangent of a neighbouring ring.
        let mut last = rings.iter().map(|r| r.tangent).find(|t| *t != DVec3::ZERO);
        for ring in &mut rings {
            if ring.tangent == DVec3::ZERO {
                let Some(tangent) = last else {
                    let what = "all points of a curve coincide";
                    return Err(ImportError::new(what, "remove the curve, or correct the points"));
                };
                (ring.tangent, ring.q, ring.w, ring.s) = (tangent, 1.0, DVec3::ZERO, DVec3::ZERO);
            }
            last = Some(ring.tangent);
        }
        self.join(&rings, |_| false);
        self.deviation = self.deviation.max(bend);
        Ok(())
    }

    fn cones(&mut self, curve: &[DVec4], before: usize) {
        let within = |a: &DVec4, b: &DVec4| a.truncate().distance(b.truncate()) <= b.w - a.w;
        // Spheres with their texture coordinate v. A sphere inside a neighbouring sphere is not visible and
        // therefore omitted.
        let mut spheres: Vec<(DVec4, f64)> = vec![];
        for (i, p) in curve.iter().enumerate() {
            while spheres.last().is_some_and(|(last, _)| within(last, p)) {
                spheres.pop();
            }
            if !spheres.last().is_some_and(|(last, _)| within(p, last)) {
                spheres.push((*p, (before + i) as f64 / self.segments));
            }
        }
        // A cone's axis, and the latitude (radians, about that axis) at which the cone touches its spheres.
        let touching = |p: &[(DVec4, f64)]| {
            let along = (p[1].0 - p[0].0).truncate();
            (along.normalize(), ((p[0].0.w - p[1].0.w) / along.length()).asin())
        };
        let cones: Vec<(DVec3, f64)> = spheres.windows(2).map(touching).collect();
        let ring = |(p, v): (DVec4, f64), tangent: DVec3, latitude: f64| {
            let (sin, cos) = latitude.sin_cos();
            let pole = latitude.abs() == FRAC_PI_2;
            Ring {
                center: p.truncate() + tangent * (p.w * sin),
                tangent,
                radius: if pole { 0.0 } else { p.w * cos },
                v,
                q: cos,
                w: DVec3::ZERO,
                s: tangent * -sin,
            }
        };
        for (i, &sphere) in spheres.iter().enumerate() {
            let incoming = i.checked_sub(1).map(|i| cones[i]);
            let outgoing = cones.get(i).copied();
            // Omit the part of the sphere that the cones cover.
            let (tangent, [from, to]) = match (incoming, outgoing) {
                (Some((t, latitude)), _) => (t, [latitude, FRAC_PI_2]),
                (None, Some((t, latitude))) => (t, [-FRAC_PI_2, latitude]),
                (None, None) => (DVec3::X, [-FRAC_PI_2, FRAC_PI_2]),
            };
            let steps = ((to - from) / TAU * f64::from(self.sides)).ceil().max(1.0) as u32;
            let latitude = |k: u32| {
                if k == steps { to } else { from + (to - from) * f64::from(k) / f64::from(steps) }
            };
            let rings: Vec<Ring> = (0..=steps).map(|k| ring(sphere, tangent, latitude(k))).collect();
            let joint = incoming.and(outgoing);
            let sagitta = (TAU / 2.0 / f64::from(self.sides)).sin().powi(2);
            self.deviation = self.deviation.max(sphere.0.w * sagitta);
            self.join(&rings, |n| joint.is_some_and(|(t, latitude)| n.dot(t) >= latitude.sin() - 1e-6));
            if let Some((t, latitude)) = outgoing {
                self.join(&[ring(sphere, t, latitude), ring(spheres[i + 1], t, latitude)], |_| false);
            }
        }
    }
}

/// Returns the point (x, y, z, radius) of a B-spline segment at the parameter v, 0..1.
fn position(p: &[DVec4; 4], v: f64) -> DVec4 {
    let (v2, v3) = (v * v, v * v * v);
    (p[0] * (1.0 - 3.0 * v + 3.0 * v2 - v3)
        + p[1] * (4.0 - 6.0 * v2 + 3.0 * v3)
        + p[2] * (1.0 + 3.0 * v + 3.0 * v2 - 3.0 * v3)
        + p[3] * v3)
        / 6.0
}

/// Returns the first and the second derivative of [`position`] with respect to v.
fn derivatives(p: &[DVec4; 4], v: f64) -> [DVec4; 2] {
    let v2 = v * v;
    let first = p[0] * (2.0 * v - 1.0 - v2)
        + p[1] * (3.0 * v2 - 4.0 * v)
        + p[2] * (1.0 + 2.0 * v - 3.0 * v2)
        + p[3] * v2;
    let second = p[0] * (1.0 - v) + p[1] * (3.0 * v - 2.0) + p[2] * (1.0 - 3.0 * v) + p[3] * v;
    [first / 2.0, second]
}

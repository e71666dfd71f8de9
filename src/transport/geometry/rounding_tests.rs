//! Tests of rays near surfaces. Rays must start and end close to surfaces, must not hit the surface that they
//! leave, and must not pass through other surfaces.

use super::builder::GeometryBuilder;
use super::bvh::Geometry;
use super::mesh::Mesh;
use super::quadric::{Quadric, QuadricKind};
use super::ray::{Hit, Ray, Surface};
use super::rounding::{END_GAP, UNIT};
use glam::{Affine3A, DAffine3, DVec3, Mat3A, Quat, Vec3, Vec3A};
use optics::polarization::frame::basis;
use optics::sampling::stream::Stream;
use optics::sampling::warp;

/// Distances, in metres, from the origin to scenes with a size of 1 m.
const OFFSETS: [f32; 4] = [0.1, 1.0, 100.0, 1e4];

fn turned(stream: &mut Stream) -> Quat {
    let [a, b] = stream.uniform2();
    let axis = warp::sphere([a, b]);
    Quat::from_axis_angle(axis.into(), stream.uniform() * 6.0)
}

/// Returns a unit sphere of triangles centred on the origin, with `n` rows of 2n triangles.
fn ball(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=n {
        for j in 0..2 * n {
            let (t, p) = (
                std::f64::consts::PI * f64::from(i) / f64::from(n),
                std::f64::consts::PI * f64::from(j) / f64::from(n),
            );
            let at = DVec3::new(t.sin() * p.cos(), t.sin() * p.sin(), t.cos());
            mesh.positions.push(at.as_vec3());
        }
    }
    let at = |i: u32, j: u32| {
        // One vertex at each pole.
        if i == 0 || i == n { i * 2 * n } else { i * 2 * n + j % (2 * n) }
    };
    for i in 0..n {
        for j in 0..2 * n {
            if i > 0 {
                mesh.indices.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
            }
            if i + 1 < n {
                mesh.indices.push([at(i, j + 1), at(i + 1, j), at(i + 1, j + 1)]);
            }
        }
    }
    mesh
}

/// Samples a direction on the side of `n`. One direction in four is grazing.
fn away(n: Vec3A, stream: &mut Stream) -> Vec3A {
    let v = warp::sphere(stream.uniform2());
    let side = v - n * (2.0 * v.dot(n).min(0.0));
    if stream.uniform() < 0.25 {
        let across = (side - n * side.dot(n)).normalize_or(basis(n).x_axis);
        (across + n * (1e-3 + 0.01 * stream.uniform())).normalize()
    } else {
        side
    }
}

/// Samples a ray toward a point near `centre`, and returns the ray, its hit and the surface point.
fn met(g: &Geometry, centre: Vec3A, size: f32, stream: &mut Stream) -> Option<(Ray, Hit, Surface)> {
    let target = centre + warp::sphere(stream.uniform2()) * (size * stream.uniform());
    let origin = centre + warp::sphere(stream.uniform2()) * (size * (0.1 + 5.0 * stream.uniform()));
    let ray = Ray { origin, dir: (target - origin).try_normalize()? };
    let hit = g.intersect(&ray, f32::INFINITY)?;
    Some((ray, hit, g.surface(&ray, &hit)))
}

/// Verifies that a ray does not hit the surface that it leaves, and that a surface does not block lines to
/// its own points. The primitives have all sizes and positions. A ray may hit the opposite side or the inside
/// of a curved surface, but nothing nearer.
#[test]
fn rays_do_not_hit_the_surface_they_leave() {
    let mut stream = Stream::new(41, 0, 0);
    let (mut left, mut again, mut lines, mut blocked) = (0, [0; 6], 0, [0; 6]);
    for case in 0..720 {
        let offset = OFFSETS[case % 4];
        let size = [1.0, 0.01, 0.2][case % 3];
        let centre = warp::sphere(stream.uniform2()) * offset;
        let turn = turned(&mut stream);
        let mut builder = GeometryBuilder::default();
        let shape = (case / 12) % 6;
        let place = |scale: Vec3| Affine3A::from_scale_rotation_translation(scale, turn, centre.into());
        match shape {
            0 | 1 => {
                let mut mesh = Mesh::rectangle();
                if shape == 1 {
                    mesh.indices.swap(0, 1);
                }
                mesh.transform(&place(Vec3::new(size, size * (0.05 + stream.uniform()), 1.0)));
                builder.mesh(&mesh, 0);
            }
            2 => builder.quadric(Quadric::new(QuadricKind::Sphere, place(Vec3::splat(size)), 0)),
            3 => builder.quadric(Quadric::new(QuadricKind::Disk, place(Vec3::splat(size)), 0)),
            4 => builder.quadric(Quadric::new(
                QuadricKind::Cylinder,
                place(Vec3::new(size, size, 2.0 * size)),
                0,
            )),
            _ => builder.quadric(Quadric::new(
                QuadricKind::Sphere,
                place(Vec3::new(size, 0.5 * size, 0.3 * size)),
                0,
            )),
        }
        let g = builder.build();
        if shape > 1 && size < 1e4 * UNIT * offset {
            // At this offset, the shape is smaller than the f32 resolution.
            continue;
        }
        for _ in 0..400 {
            let Some((ray, hit, s)) = met(&g, centre, size, &mut stream) else {
                continue;
            };
            for n in [s.ng, -s.ng] {
                let dir = away(n, &mut stream);
                let on = Ray { origin: g.leave(&s, dir), dir };
                left += 1;
                // A ray must not hit the surface that it leaves if the surface is flat, or if the surface is
                // convex and the ray leaves outward.
                let flat = matches!(shape, 0 | 1 | 3);
                let next = g.intersect(&on, f32::INFINITY);
                if flat || n == s.ng {
                    again[shape] += u32::from(next.is_some());
                } else if shape != 4 {
                    // A ray that leaves inward hits the opposite side after the length of a chord.
                    let chord = next.map_or(0.0, |h| h.t);
                    let cos = dir.dot(n);
                    again[shape] += u32::from(chord < 0.05 * size * cos);
                }
            }
            // Trace back to the origin of the ray, in both directions.
            let length = s.p.distance(ray.origin);
            let aim = g.reach(&s, -ray.dir, length);
            let to = aim - ray.origin;
            let whole = to.length();
            lines += 1;
            let line = Ray { origin: ray.origin, dir: to / whole };
            if s.ng.dot(line.dir).abs() > 1e-3 && hit.t > 0.0 {
                blocked[shape] += u32::from(g.occluded(&line, whole * (1.0 - END_GAP)));
            }
        }
    }
    println!("{left} rays: {again:?} self-intersections; {lines} lines: {blocked:?} blocked");
    assert!(left > 120_000 && lines > 60_000);
    assert_eq!((again, blocked), ([0; 6], [0; 6]));
}

/// Verifies that random walks inside closed meshes and quadrics never escape, for all positions and sizes.
#[test]
fn rays_do_not_escape_closed_shapes() {
    let mut stream = Stream::new(42, 0, 0);
    for offset in OFFSETS {
        for (what, scale) in [
            ("mesh", 1.0),
            ("copy", 1e-3),
            ("copy", 1.0),
            ("copy", 1e3),
            ("ball", 1.0),
            ("egg", 1.0),
            ("box", 1.0),
        ] {
            let centre = warp::sphere(stream.uniform2()) * offset;
            let turn = turned(&mut stream);
            // Groups have different sizes, but the instances scale each closed shape to a size of 1 m.
            let place = Affine3A::from_scale_rotation_translation(Vec3::ONE, turn, centre.into());
            let mut builder = GeometryBuilder::default();
            let mut mesh = ball(32);
            match what {
                "mesh" => {
                    mesh.transform(&place);
                    builder.mesh(&mesh, 0);
                }
                "copy" => {
                    mesh.transform(&Affine3A::from_scale(Vec3::splat(1.0 / scale)));
                    let group = builder.begin_group();
                    builder.mesh(&mesh, 0);
                    builder.end_group();
                    let turn = turn.as_dquat();
                    let scale = DVec3::splat(f64::from(scale));
                    builder.instance(
                        group,
                        DAffine3::from_scale_rotation_translation(scale, turn, centre.as_dvec3()),
                    );
                }
                "ball" => builder.quadric(Quadric::new(QuadricKind::Sphere, place, 0)),
                "egg" => {
                    let egg = Affine3A::from_scale(Vec3::new(1.0, 0.7, 0.5));
                    builder.quadric(Quadric::new(QuadricKind::Sphere, place * egg, 0));
                }
                _ => {
                    let mut mesh = Mesh::cube();
                    mesh.transform(&place);
                    builder.mesh(&mesh, 0);
                }
            }
            let g = builder.build();
            let (mut rays, mut lost, mut back) = (0, 0, 0);
            while rays < 5000 {
                let mut ray = Ray { origin: centre, dir: warp::sphere(stream.uniform2()) };
                for _ in 0..100 {
                    rays += 1;
                    let Some(hit) = g.intersect(&ray, f32::INFINITY) else {
                        lost += 1;
                        break;
                    };
                    let s = g.surface(&ray, &hit);
                    if s.ng.dot(ray.dir) < 0.0 {
                        back += 1;
                        break;
                    }
                    let n = -s.ng;
                    ray.dir = (n + warp::sphere(stream.uniform2())).normalize_or(n);
                    ray.origin = g.leave(&s, ray.dir);
                }
            }
            println!("{what} {scale} at {offset}: {rays} rays, {lost} lost, {back} from outside");
            // Near a corner, a point may be behind a wall that is closer than the f32 resolution.
            let known = (UNIT * offset * rays as f32) as i32;
            assert!(lost + back <= known, "{what} {scale} at {offset}: {lost}, {back}");
        }
    }
}

/// Verifies that a ray along the inside of a curved shape hits the shape again, even at grazing angles.
#[test]
fn grazing_rays_do_not_escape_round_shapes() {
    let mut stream = Stream::new(44, 0, 0);
    for (offset, kind, scale) in [
        (0.1, QuadricKind::Sphere, Vec3::ONE),
        (1.0, QuadricKind::Sphere, Vec3::ONE),
        (100.0, QuadricKind::Sphere, Vec3::ONE),
        (1.0, QuadricKind::Sphere, Vec3::new(1.0, 0.6, 0.8)),
        (1.0, QuadricKind::Cylinder, Vec3::ONE),
    ] {
        let centre = warp::sphere(stream.uniform2()) * offset;
        let turn = turned(&mut stream);
        let place = Affine3A::from_scale_rotation_translation(scale, turn, centre.into());
        let mut builder = GeometryBuilder::default();
        builder.quadric(Quadric::new(kind, place, 0));
        let g = builder.build();
        let middle = place.transform_point3a(Vec3A::new(0.0, 0.0, 0.5));
        for _ in 0..100_000 {
            let ray = Ray { origin: middle, dir: warp::sphere(stream.uniform2()) };
            // The ray may leave through the open ends of the tube.
            let Some(hit) = g.intersect(&ray, f32::INFINITY) else {
                continue;
            };
            let s = g.surface(&ray, &hit);
            // A tube is curved only around its axis.
            let round = match kind {
                QuadricKind::Cylinder => s.tangent.normalize(),
                _ => (basis(s.ng) * warp::sphere(stream.uniform2()).with_z(0.0)).normalize_or(s.tangent),
            };
            let cos = 1e-3 * stream.uniform().powi(3);
            let dir = (round - s.ng * cos).normalize();
            let on = Ray { origin: g.leave(&s, -s.ng), dir };
            let next = g.intersect(&on, f32::INFINITY);
            assert!(next.is_some(), "{kind:?} {scale} at {offset}: {cos}");
        }
    }
}

/// Verifies that rays from each of two parallel sheets hit the other sheet. The sheets are 1 µm apart, at a
/// distance of 1 m from the origin.
#[test]
fn sheets_a_micrometre_apart_are_resolved_at_a_metre() {
    let mut stream = Stream::new(43, 0, 0);
    for axis in 0..3 {
        let mut builder = GeometryBuilder::default();
        let turn = [
            Mat3A::from_cols(Vec3A::Y, Vec3A::Z, Vec3A::X),
            Mat3A::from_cols(Vec3A::Z, Vec3A::X, Vec3A::Y),
            Mat3A::IDENTITY,
        ][axis];
        for (z, size, material) in [(1.0, 0.5, 0), (1.0 - 1e-6, 0.3, 1)] {
            let mut mesh = Mesh::rectangle();
            let frame = Mat3A::from_cols(turn.x_axis * size, turn.y_axis * size, turn.z_axis);
            mesh.transform(&Affine3A { matrix3: frame, translation: turn.z_axis * z });
            builder.mesh(&mesh, material);
        }
        let g = builder.build();
        let mut counts = [0; 2];
        for _ in 0..20_000 {
            let [x, y] = stream.uniform2().map(|u| (2.0 * u - 1.0) * 0.29);
            let target = turn.x_axis * x + turn.y_axis * y + turn.z_axis;
            let dir = target.normalize();
            let ray = Ray { origin: Vec3A::ZERO, dir };
            let hit = g.intersect(&ray, f32::INFINITY).expect("the ray hits the sheet");
            let s = g.surface(&ray, &hit);
            counts[0] += u32::from(s.material == 1);
            let on = Ray { origin: g.leave(&s, dir), dir };
            let Some(hit) = g.intersect(&on, f32::INFINITY) else {
                continue;
            };
            let wall = g.surface(&on, &hit);
            let back = Ray { origin: g.leave(&wall, -dir), dir: away(-turn.z_axis, &mut stream) };
            let sheet = g.intersect(&back, f32::INFINITY).map(|h| g.surface(&back, &h));
            // Grazing rays may pass outside the rim of the sheet.
            let near = sheet.is_some_and(|s| s.material == 1) || back.dir.dot(turn.z_axis).abs() < 1e-3;
            // The sheet must block lines to the wall but must not block lines to the sheet itself.
            let stops = |at: &Surface| {
                let to = g.reach(at, -dir, at.p.length());
                let length = to.length();
                let line = Ray { origin: Vec3A::ZERO, dir: to / length };
                g.occluded(&line, length * (1.0 - END_GAP))
            };
            counts[1] += u32::from(wall.material == 0 && near && stops(&wall) && !stops(&s));
        }
        assert_eq!(counts, [20_000; 2], "{axis}");
    }
}

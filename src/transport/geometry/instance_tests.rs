//! Tests that instances are equivalent to copies.

use super::builder::GeometryBuilder;
use super::bvh::Geometry;
use super::mesh::Mesh;
use super::quadric::{Quadric, QuadricKind};
use super::ray::{Hit, Owner, Ray, Surface};
use super::view::View;
use glam::{Affine3A, DAffine3, DQuat, DVec3, Mat3A, Quat, Vec2, Vec3, Vec3A};
use optics::sampling::stream::Stream;
use optics::sampling::warp;

/// Returns a sphere of about 2n² triangles centred on the origin, with dents that remove all symmetry.
fn ball(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=n {
        for j in 0..=n {
            let (u, v) = (j as f32 / n as f32, i as f32 / n as f32);
            let (a, b) = (u * std::f32::consts::TAU, v * std::f32::consts::PI);
            let d = Vec3::new(a.cos() * b.sin(), a.sin() * b.sin(), b.cos());
            mesh.positions.push(d * (1.0 + 0.1 * (3.0 * d.x).sin() * d.y));
            mesh.normals.push(d);
            mesh.uvs.push(Vec2::new(u, v));
        }
    }
    for i in 0..n {
        for j in 0..n {
            let at = |i, j| i * (n + 1) + j;
            mesh.indices.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.indices.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    mesh.drop_degenerate();
    mesh.compact();
    mesh
}

/// Meshes and quadrics of a test group, with their materials.
#[derive(Default)]
struct Things {
    meshes: Vec<(Mesh, u32)>,
    quadrics: Vec<(QuadricKind, Affine3A, u32)>,
}

impl Things {
    fn add(&self, builder: &mut GeometryBuilder, place: &DAffine3) {
        let map = single(place);
        for (mesh, material) in &self.meshes {
            let mut mesh = mesh.clone();
            mesh.transform(&map);
            builder.mesh(&mesh, *material);
        }
        for (kind, own, material) in &self.quadrics {
            builder.quadric(Quadric::new(*kind, map * *own, *material));
        }
    }
}

fn single(a: &DAffine3) -> Affine3A {
    Affine3A::from_mat3_translation(a.matrix3.as_mat3(), a.translation.as_vec3())
}

/// Returns one shape of each kind. No shape is centred on the origin.
fn things(at: Vec3) -> Things {
    let mut smooth = ball(24);
    smooth.transform(&Affine3A::from_scale_rotation_translation(
        Vec3::splat(0.5),
        Quat::from_rotation_x(0.3),
        at + Vec3::new(0.4, 0.0, 0.1),
    ));
    let mut bare = ball(9);
    bare.normals.clear();
    bare.uvs.clear();
    bare.transform(&Affine3A::from_scale_rotation_translation(
        Vec3::splat(0.3),
        Quat::IDENTITY,
        at + Vec3::new(-0.6, 0.3, 0.2),
    ));
    let mut sheet = Mesh::rectangle();
    sheet.transform(&Affine3A::from_rotation_translation(Quat::from_rotation_y(0.5), at - Vec3::Z));
    let quadric = |kind, scale: [f32; 3], offset: [f32; 3], material| {
        let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.3, 0.8, -0.4);
        let place = Affine3A::from_scale_rotation_translation(
            Vec3::from_array(scale),
            turn,
            at + Vec3::from_array(offset),
        );
        (kind, place, material)
    };
    Things {
        meshes: vec![(smooth, 1), (bare, 2), (sheet, 3)],
        quadrics: vec![
            quadric(QuadricKind::Sphere, [0.2; 3], [0.0, -0.7, 0.3], 4),
            quadric(QuadricKind::Sphere, [0.1, 0.3, 0.2], [0.0, 0.8, 0.3], 5),
            quadric(QuadricKind::Disk, [0.3; 3], [-0.5, -0.5, 0.8], 6),
            quadric(QuadricKind::Cylinder, [0.1, 0.1, 0.6], [0.6, 0.5, 0.5], 7),
        ],
    }
}

/// Returns maps of all kinds and sizes: rotations, reflections, non-uniform scales and shears.
fn places(stream: &mut Stream, n: usize) -> Vec<DAffine3> {
    let mut any = || f64::from(stream.uniform());
    (0..n)
        .map(|i| {
            let turn =
                |a: f64, b: f64, c: f64| DQuat::from_euler(glam::EulerRot::XYZ, 6.0 * a, 6.0 * b, 6.0 * c);
            let mut scale = DVec3::splat(0.2 + 0.8 * any());
            if i % 2 == 1 {
                scale *= DVec3::new(0.3 + any(), 0.3 + any(), 0.3 + any());
            }
            if i % 3 == 1 {
                scale.y = -scale.y;
            }
            let at = DVec3::new(any(), any(), any()) * 8.0 - 4.0;
            let skew = DAffine3::from_quat(turn(any(), any(), any()));
            let squeeze = if i % 4 == 3 { DVec3::new(1.0, 0.5, 1.3) } else { DVec3::ONE };
            DAffine3::from_scale_rotation_translation(squeeze, turn(any(), any(), any()), at)
                * skew
                * DAffine3::from_scale(scale)
        })
        .collect()
}

/// Returns the same world twice: once with instances and once with copies.
fn pair(groups: &[Things], places: &[DAffine3]) -> [Geometry; 2] {
    let mut instanced = GeometryBuilder::default();
    let mut copied = GeometryBuilder::default();
    let mut floor = Mesh::rectangle();
    floor.transform(&Affine3A::from_scale_rotation_translation(
        Vec3::splat(6.0),
        Quat::IDENTITY,
        Vec3::new(0.0, 0.0, -6.0),
    ));
    instanced.mesh(&floor, 0);
    copied.mesh(&floor, 0);
    let lamp = Affine3A::from_translation(Vec3::new(0.0, 0.0, 5.0));
    for b in [&mut instanced, &mut copied] {
        b.quadric(Quadric::new(QuadricKind::Sphere, lamp, 8));
    }
    for g in groups {
        instanced.begin_group();
        g.add(&mut instanced, &DAffine3::IDENTITY);
        instanced.end_group();
    }
    for (i, place) in places.iter().enumerate() {
        instanced.instance((i % groups.len()) as u32, *place);
        groups[i % groups.len()].add(&mut copied, place);
    }
    [instanced.build(), copied.build()]
}

fn from_around(stream: &mut Stream, radius: f32) -> Ray {
    let origin = warp::sphere(stream.uniform2()) * radius * stream.uniform();
    let target = warp::sphere(stream.uniform2()) * 5.0;
    Ray { origin, dir: (target - origin).normalize() }
}

fn met(g: &Geometry, ray: &Ray) -> Option<(Hit, Surface)> {
    let hit = g.intersect(ray, f32::INFINITY)?;
    Some((hit, g.surface(ray, &hit)))
}

/// Verifies that random rays hit instances in the same way as copies.
#[test]
fn instances_equal_copies() {
    let mut stream = Stream::new(21, 0, 0);
    // One group contains the origin of its coordinates. The other group is far from its origin, so that the
    // builder moves the origin.
    let groups = [things(Vec3::ZERO), things(Vec3::new(30.0, -20.0, 50.0))];
    let mut where_to = places(&mut stream, 40);
    for (i, p) in where_to.iter_mut().enumerate() {
        if i % 2 == 1 {
            *p *= DAffine3::from_translation(-DVec3::new(30.0, -20.0, 50.0));
        }
    }
    let [one, two] = pair(&groups, &where_to);
    assert_eq!((one.copies(), two.copies()), ((40, 2), (0, 0)));
    let [mut hits, mut in_instances, mut apart, mut bends] = [0; 4];
    let mut kinds = [0; 9];
    for _ in 0..60_000 {
        let ray = from_around(&mut stream, 8.0);
        let (a, b) = (met(&one, &ray), met(&two, &ray));
        let (Some((ha, a)), Some((hb, b))) = (a, b) else {
            apart += usize::from(a.is_some() != b.is_some());
            continue;
        };
        hits += 1;
        // A ray that grazes an edge may hit one geometry and miss the other.
        if a.material != b.material || (ha.t - hb.t).abs() > 1e-4 * (1.0 + hb.t) {
            apart += 1;
            continue;
        }
        // Rounding errors shift the hit along a grazing ray.
        if b.ng.dot(ray.dir).abs() < 0.1 {
            continue;
        }
        in_instances += usize::from(ha.owner != Owner::WORLD);
        kinds[a.material as usize] += 1;
        assert_eq!(hb.owner, Owner::WORLD);
        // The copies of the distant group have the rounding errors of coordinates near 60 m. Points on the
        // instances have smaller errors.
        assert!((a.p - b.p).length() < 1e-4, "{a:?} {b:?}");
        // Adjacent flat triangles have different normals. At an edge, a ray may hit either triangle.
        if a.ng.dot(b.ng) < 0.99999 {
            apart += 1;
            continue;
        }
        assert!(a.ns.dot(b.ns) > 0.9999, "{a:?} {b:?}");
        assert!(a.ng.dot(a.ns) >= 0.0 && (a.ng.length() - 1.0).abs() < 1e-5);
        assert!(a.tangent.normalize().dot(b.tangent.normalize()) > 0.999, "{a:?} {b:?}");
        let off = [0, 1].map(|k| (a.uv[k] - b.uv[k]).abs());
        assert!(off.iter().all(|d| d.min(1.0 - d) < 2e-3), "{a:?} {b:?}");
        let (ka, kb) = (one.bend(&ha, &a), two.bend(&hb, &b));
        let step = a.tangent_frame();
        for along in [step.x_axis, step.y_axis] {
            let (da, db) = (ka * along, kb * along);
            assert!((da - db).length() < 0.02 * (1.0 + db.length()), "{a:?} {da} {db}");
            bends += usize::from(db.length() > 0.1);
        }
        assert!(one.occluded(&ray, ha.t * 1.001) && two.occluded(&ray, hb.t * 1.001));
    }
    assert!(in_instances > 6000 && bends > 3000, "{in_instances} {bends}");
    assert!(apart < hits / 500, "{apart} of {hits}");
    assert!(kinds.iter().all(|n| *n > 30), "{kinds:?}");
}

/// Verifies that the generic code gives bit-identical results.
#[test]
fn generic_code_is_bit_identical() {
    let mut stream = Stream::new(22, 0, 0);
    let (groups, where_to) = ([things(Vec3::ZERO)], places(&mut stream, 10));
    let [one, _] = pair(&groups, &where_to);
    let [two, _] = pair(&groups, &where_to);
    let two = two.plain();
    for _ in 0..20_000 {
        let ray = from_around(&mut stream, 8.0);
        let [a, b] = [&one, &two].map(|g| {
            let hit = g.intersect(&ray, f32::INFINITY);
            hit.map(|h| (h.t.to_bits(), h.leaf, h.owner, h.u.to_bits(), h.v.to_bits()))
        });
        assert_eq!(a, b);
        assert_eq!(one.occluded(&ray, 4.0), two.occluded(&ray, 4.0));
    }
}

/// Verifies that rays do not hit the surface that they leave, and that rays that enter a closed surface hit
/// the inside of this surface. The instances have various sizes and distances.
#[test]
fn rays_do_not_leak_through_closed_instances() {
    let mut stream = Stream::new(23, 0, 0);
    let mut closed = Things::default();
    closed.meshes.push((ball(40), 0));
    let sphere = Things { quadrics: vec![(QuadricKind::Sphere, Affine3A::IDENTITY, 0)], ..Things::default() };
    for (size, at) in [(1.0, 0.0), (1e-2, 3.0), (3.0, 1000.0), (100.0, 0.0)] {
        for thing in [&closed, &sphere] {
            for stretch in [DVec3::ONE, DVec3::new(1.0, -0.2, 3.0)] {
                let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -0.5);
                let place = DAffine3::from_scale_rotation_translation(
                    stretch * size,
                    turn,
                    DVec3::new(at, -0.5 * at, 0.2 * at),
                );
                let mut builder = GeometryBuilder::default();
                builder.begin_group();
                thing.add(&mut builder, &DAffine3::IDENTITY);
                builder.end_group();
                builder.instance(0, place);
                let g = builder.build();
                let [mut again, mut lost, mut missed] = [0; 3];
                for _ in 0..4000 {
                    // Trace a ray from a random point outside to a random point inside.
                    let around = warp::sphere(stream.uniform2()) * (1.5 + 10.0 * stream.uniform());
                    let inside = warp::sphere(stream.uniform2()) * 0.7 * stream.uniform();
                    let [origin, to] = [around, inside].map(|p| single(&place).transform_point3a(p));
                    let ray = Ray { origin, dir: (to - origin).normalize() };
                    let Some((hit, s)) = met(&g, &ray) else {
                        missed += 1;
                        continue;
                    };
                    assert!(hit.t > 0.0 && s.ng.dot(ray.dir) < 1e-3, "outward");
                    let away = Ray { origin: g.leave(&s, s.ng), dir: s.ng };
                    // The dents are shallow, so the ray leaves the object.
                    again += usize::from(g.occluded(&away, f32::INFINITY));
                    let on = Ray { origin: g.leave(&s, ray.dir), dir: ray.dir };
                    lost += usize::from(met(&g, &on).is_none_or(|(_, s)| s.ng.dot(ray.dir) < -0.1));
                }
                assert_eq!([again, lost, missed], [0; 3], "{size} {at} {stretch}");
            }
        }
    }
}

/// Verifies that `Option<Hit>` is not larger than `Hit`.
#[test]
fn an_optional_hit_is_no_larger_than_a_hit() {
    assert_eq!(size_of::<Option<Hit>>(), 20);
    for number in [0, 1, 77, 1 << 30] {
        assert_eq!(Owner::instance(number).number(), Some(number));
    }
    assert_eq!(Owner::WORLD.number(), None);
}

/// Verifies that a thousand instances need little more memory than one instance.
#[test]
fn a_thousand_instances_take_the_memory_of_one() {
    let mesh = ball(100);
    assert!(mesh.indices.len() > 19_000);
    let with = |n: usize| {
        let mut builder = GeometryBuilder::default();
        builder.begin_group();
        builder.mesh(&mesh, 0);
        builder.end_group();
        for i in 0..n {
            let at = DVec3::new((i % 10) as f64, (i / 10 % 10) as f64, (i / 100) as f64) * 3.0;
            builder.instance(0, DAffine3::from_translation(at));
        }
        builder.build()
    };
    let [one, many] = [with(1), with(1000)];
    let mut builder = GeometryBuilder::default();
    builder.mesh(&mesh, 0);
    let single = builder.build().bytes();
    assert!(one.bytes() < single + 1000, "{} {single}", one.bytes());
    let each = (many.bytes() - one.bytes()) as f64 / 999.0;
    // An instance occupies 128 bytes. A tree node occupies 256 bytes for up to eight boxes.
    assert!(each < 300.0, "{each}");
    assert!(many.bytes() < one.bytes() + one.bytes() / 5);
    assert_eq!((many.counts().0, many.copies()), (mesh.indices.len(), (1000, 1)));
    let found: std::collections::BTreeSet<Owner> = (0..1000)
        .filter_map(|i| {
            let at = Vec3A::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32) * 3.0;
            let ray = Ray { origin: at + Vec3A::new(0.1, 0.2, 1.4), dir: -Vec3A::Z };
            many.intersect(&ray, 1.0).map(|h| h.owner)
        })
        .collect();
    assert_eq!(found.len(), 1000);
}

/// Verifies that a view of a world with instances agrees with rays that pass next to, between and through the
/// instances.
#[test]
fn views_include_instances() {
    let mut stream = Stream::new(24, 0, 0);
    let groups = [things(Vec3::ZERO)];
    let [g, _] = pair(&groups, &places(&mut stream, 12));
    let (lo, hi) = (Vec2::new(-0.9, -0.8), Vec2::new(0.8, 0.7));
    let [mut spoken, mut firsts, mut views] = [0; 3];
    for origin in [
        Vec3A::new(0.1, 0.2, 12.0),
        Vec3A::new(2.0, -1.0, 3.5),
        Vec3A::new(-0.5, 1.5, 0.3),
        Vec3A::new(3.5, -2.5, -1.0),
    ] {
        let axes = Mat3A::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
        let Some(view) = View::new(&g, origin, axes, [lo, hi], [256, 200]) else {
            continue;
        };
        views += 1;
        for _ in 0..40_000 {
            let [u, v] = stream.uniform2();
            let d = lo + (hi - lo) * Vec2::new(u, v);
            let ray = Ray { origin, dir: (axes * Vec3A::from(d.extend(1.0))).normalize() };
            let [cell] = view.cells_toward(&ray.dir.to_array().map(|v| [v]));
            let found = g.intersect(&ray, f32::INFINITY);
            if let Some(hit) = view.first_hit(cell, &g, &ray) {
                firsts += 1;
                let found = found.expect("the ray hits a surface");
                assert_eq!((hit.leaf, hit.owner, hit.t), (found.leaf, found.owner, found.t));
            }
            // Trace a random ray to a surface point, then a ray from this point to the pinhole.
            let Some((hit, s)) = met(&g, &from_around(&mut stream, 8.0)) else {
                continue;
            };
            let local = axes.transpose() * (s.p - origin);
            let [cell] = view.cells(&local.to_array().map(|v| [v]));
            let start = g.leave(&s, origin - s.p);
            let to = origin - start;
            let back = Ray { origin: start, dir: to.normalize() };
            if let Some(seen) = view.sees(cell, local.z, &hit, &s) {
                spoken += 1;
                assert_eq!(seen, !g.occluded(&back, to.length() * (1.0 - 1e-5)), "{hit:?}");
            }
        }
    }
    assert!(views >= 3 && spoken > 1000 && firsts > 10_000, "{views} {spoken} {firsts}");
}

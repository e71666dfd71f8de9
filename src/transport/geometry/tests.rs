//! Tests of the builder and the tree: rays must hit the expected surfaces.

use super::builder::GeometryBuilder;
use super::bvh::QUADRIC;
use super::mesh::Mesh;
use super::quadric::{Quadric, QuadricKind};
use super::ray::{Hit, Ray};
use glam::{Affine3A, Vec3, Vec3A};
use optics::sampling::stream::Stream;
use optics::sampling::warp;

/// Returns `n` random triangles of approximate size `size` around points on a sphere.
pub(super) fn crowd(stream: &mut Stream, n: u32, (centre, radius): (Vec3A, f32), size: f32) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..n {
        let c = centre + warp::sphere(stream.uniform2()) * radius;
        for _ in 0..3 {
            mesh.positions.push((c + warp::sphere(stream.uniform2()) * size).into());
        }
        mesh.indices.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh
}

/// Returns a ray from a random point at distance `far` from the origin to a random point at distance `near`.
pub(super) fn inward(stream: &mut Stream, far: f32, near: f32) -> Ray {
    let origin = warp::sphere(stream.uniform2()) * far;
    Ray { origin, dir: (warp::sphere(stream.uniform2()) * near - origin).normalize() }
}

/// Returns the distance along a ray to a triangle's plane, and the smallest barycentric coordinate of the
/// intersection.
fn reference(corners: [Vec3; 3], ray: &Ray) -> (f64, f64) {
    let [a, b, c] = corners.map(glam::Vec3::as_dvec3);
    let (o, d) = (ray.origin.as_dvec3(), ray.dir.as_dvec3());
    let (e1, e2) = (b - a, c - a);
    let n = e1.cross(e2);
    let t = (a - o).dot(n) / d.dot(n);
    let p = o + d * t - a;
    let (u, v) = (p.cross(e2).dot(n) / n.dot(n), e1.cross(p).dot(n) / n.dot(n));
    (t, u.min(v).min(1.0 - u - v))
}

/// Verifies that a rectangle of two triangles becomes one primitive with the same surface.
#[test]
fn rectangles_are_one_primitive() {
    let place = Affine3A::from_scale_rotation_translation(
        Vec3::new(0.7, 1.3, 1.0),
        glam::Quat::from_rotation_x(0.4),
        Vec3::new(0.1, 0.2, 0.3),
    );
    let mut mesh = Mesh::rectangle();
    mesh.transform(&place);
    let mut apart = mesh.clone();
    // In this order, the two triangles are not recognized as a parallelogram.
    apart.indices.swap(0, 1);
    let [one, two] = [&mesh, &apart].map(|m| {
        let mut builder = GeometryBuilder::default();
        builder.mesh(m, 3);
        builder.build()
    });
    assert_eq!(one.packs[0].parallelogram.bits(), 1);
    assert_eq!(two.packs[0].parallelogram.bits(), 0);
    assert_eq!((one.counts(), two.counts()), ((2, 0), (2, 0)));
    let mut stream = Stream::new(8, 0, 0);
    let mut hits = 0;
    for _ in 0..5000 {
        let ray = inward(&mut stream, 4.0, 1.0);
        let [a, b] = [&one, &two].map(|g| g.intersect(&ray, f32::INFINITY).map(|h| g.surface(&ray, &h)));
        let (Some(a), Some(b)) = (a, b) else {
            continue;
        };
        // Rounding errors are large along a grazing ray.
        if a.ng.dot(ray.dir).abs() < 0.1 {
            continue;
        }
        hits += 1;
        assert!((a.p - b.p).length() < 1e-5 && a.ng.dot(b.ng) > 0.999_99 && a.ns.dot(b.ns) > 0.999_99);
        assert!(a.tangent.normalize().dot(b.tangent.normalize()) > 0.9999);
        assert!(a.uv.iter().zip(b.uv).all(|(x, y)| (x - y).abs() < 1e-5) && a.material == 3);
    }
    assert!(hits > 1000);
}

/// Verifies that equal corner normals that are perpendicular to the facet give exactly the facet's normal,
/// and that equal corner normals with another direction are kept.
#[test]
fn normals_perpendicular_to_a_facet_are_not_interpolated() {
    let place = Affine3A::from_rotation_x(0.7) * Affine3A::from_rotation_y(-0.3);
    let ray = Ray { origin: Vec3A::new(0.1, 0.2, 3.0), dir: Vec3A::NEG_Z };
    for tilt in [0.0, 1e-4] {
        let mut mesh = Mesh::rectangle();
        mesh.transform(&place);
        let tilted = glam::Quat::from_rotation_x(tilt);
        mesh.normals.iter_mut().for_each(|n| *n = tilted * *n);
        let mut builder = GeometryBuilder::default();
        builder.mesh(&mesh, 0);
        let geometry = builder.build();
        assert_eq!(geometry.triangles[0].normals().is_none(), tilt == 0.0);
        let hit = geometry.intersect(&ray, f32::INFINITY).expect("a hit");
        let surface = geometry.surface(&ray, &hit);
        assert_eq!(surface.ns == surface.ng, tilt == 0.0);
        assert!((surface.ns - Vec3A::from(mesh.normals[0])).length() < 1e-6);
    }
}

/// Verifies that the tree finds the same hits as a loop over all random triangles and spheres.
#[test]
fn bvh_equals_brute_force() {
    let mut stream = Stream::new(5, 0, 0);
    let mut builder = GeometryBuilder::default();
    let mesh = crowd(&mut stream, 300, (Vec3A::ZERO, 2.0), 0.4);
    builder.mesh(&mesh, 0);
    for _ in 0..50 {
        let c = warp::sphere(stream.uniform2()) * 2.0;
        let t =
            Affine3A::from_scale_rotation_translation(glam::Vec3::splat(0.1), glam::Quat::IDENTITY, c.into());
        builder.quadric(Quadric::new(QuadricKind::Sphere, t, 1));
    }
    let g = builder.build();
    let mut hits = 0;
    for _ in 0..20_000 {
        let ray = inward(&mut stream, 3.0, 1.0);
        let Ray { origin, dir } = ray;
        let quadrics = g.quadrics.iter();
        let round = quadrics.map(|q| q.intersect(origin, dir, f32::INFINITY)).fold(f32::INFINITY, f32::min);
        // Count in double precision the triangles that are certainly hit, and those that may be hit.
        let [mut certain, mut possible] = [f64::from(round); 2];
        for tri in &mesh.indices {
            let (t, margin) = reference(tri.map(|i| mesh.positions[i as usize]), &ray);
            if t > 0.0 && margin > 1e-4 {
                certain = certain.min(t);
            }
            if t > 0.0 && margin > -1e-4 {
                possible = possible.min(t);
            }
        }
        let got = g.intersect(&ray, f32::INFINITY);
        let t = got.map_or(f64::INFINITY, |h| f64::from(h.t));
        assert!(t >= possible - 1e-4 && (t <= certain + 1e-4), "{possible} {t} {certain}");
        assert_eq!(g.occluded(&ray, f32::INFINITY), got.is_some());
        if let Some(h) = got {
            hits += 1;
            let s = g.surface(&ray, &h);
            assert!((s.p - (origin + dir * h.t)).length() < 1e-4);
            let on = Ray { origin: g.leave(&s, s.ng), dir: s.ng };
            let again = g.intersect(&on, f32::INFINITY);
            assert!(again.is_none_or(|a| a.leaf != h.leaf || a.t > 0.05), "hits itself");
        }
    }
    assert!(hits > 5000);
}

/// Verifies that alternating traversals of a large tree find the hits of single rays, for lists of any length.
#[test]
fn hits_of_alternating_rays_are_those_of_single_rays() {
    let mut stream = Stream::new(7, 0, 0);
    let mut builder = GeometryBuilder::default();
    builder.mesh(&crowd(&mut stream, 40_000, (Vec3A::ZERO, 2.0), 0.05), 0);
    let ball = Affine3A::from_scale_rotation_translation(Vec3::splat(0.5), glam::Quat::IDENTITY, Vec3::ZERO);
    builder.quadric(Quadric::new(QuadricKind::Sphere, ball, 1));
    let g = builder.build();
    assert!(g.is_large());
    let [mut triangles, mut balls, mut misses] = [0; 3];
    for count in (0..40).cycle().take(2000) {
        let rays: Vec<Ray> = (0..count).map(|_| inward(&mut stream, 3.0, 2.4)).collect();
        let mut hits = vec![None; count];
        g.intersect_each(&rays.iter().collect::<Vec<_>>(), &mut hits);
        for (ray, hit) in rays.iter().zip(hits) {
            let key = |h: Hit| (h.leaf, [h.t, h.u, h.v].map(f32::to_bits));
            assert_eq!(hit.map(key), g.intersect(ray, f32::INFINITY).map(key));
            match hit {
                Some(h) if h.leaf & QUADRIC == 0 => triangles += 1,
                Some(_) => balls += 1,
                None => misses += 1,
            }
        }
    }
    assert!([triangles, balls, misses].iter().all(|n| *n > 500), "{triangles} {balls} {misses}");
}

/// Verifies that no near, distant, steep or grazing ray passes through the shared edge of two triangles.
#[test]
fn shared_edges_are_closed() {
    let mut stream = Stream::new(6, 0, 0);
    let mut missed = 0;
    for case in 0..200 {
        let size = [0.01, 0.1, 1.0][case % 3];
        let centre = warp::sphere(stream.uniform2()) * 2.0;
        let frame = optics::polarization::frame::basis(warp::sphere(stream.uniform2()));
        let (x, y) = (frame.x_axis * size, frame.y_axis * size);
        let corners = [centre - x - y, centre + x - y, centre + x + y, centre - x + y];
        let mut builder = GeometryBuilder::default();
        // A distant object makes the extent of the scene large compared to the triangles.
        for (points, indices) in [
            (corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]]),
            (vec![Vec3A::splat(8.0), Vec3A::splat(8.1), Vec3A::new(8.0, 8.1, 8.0)], vec![[0, 1, 2]]),
        ] {
            builder.mesh(
                &Mesh { positions: points.into_iter().map(Into::into).collect(), indices, ..Mesh::default() },
                0,
            );
        }
        let g = builder.build();
        for _ in 0..500 {
            let target = corners[0].lerp(corners[2], 0.02 + 0.96 * stream.uniform());
            let origin = target + warp::sphere(stream.uniform2()) * (0.05 + 5.0 * stream.uniform());
            let dir = (target - origin).normalize();
            if dir.dot(frame.z_axis).abs() > 0.05 {
                let ray = Ray { origin, dir };
                missed += u32::from(g.intersect(&ray, f32::INFINITY).is_none());
            }
        }
    }
    assert_eq!(missed, 0);
}

#[test]
fn an_empty_scene_has_no_hits() {
    let g = GeometryBuilder::default().build();
    let ray = Ray { origin: Vec3A::ZERO, dir: Vec3A::X };
    assert!(g.intersect(&ray, f32::INFINITY).is_none());
    assert!(!g.occluded(&ray, f32::INFINITY));
}

/// Verifies that the AVX2 code, the generic code and the code for other processors (feature `portable`) give
/// bit-identical hits. Sums, products, quotients and square roots are the only operations in all three
/// versions, and every processor rounds these operations equally.
#[test]
fn hits_are_bit_identical_on_all_processors() {
    let mut stream = Stream::new(21, 0, 0);
    let mesh = crowd(&mut stream, 500, (Vec3A::ZERO, 2.0), 0.5);
    let build = || {
        let mut builder = GeometryBuilder::default();
        builder.mesh(&mesh, 0);
        builder.mesh(&Mesh::rectangle(), 1);
        for (i, kind) in
            [QuadricKind::Sphere, QuadricKind::Disk, QuadricKind::Cylinder].into_iter().enumerate()
        {
            let place = Affine3A::from_translation(Vec3::new(i as f32 - 1.0, 0.5, 0.2));
            let size = Affine3A::from_scale(Vec3::splat(0.4));
            builder.quadric(Quadric::new(kind, place * size, 2));
        }
        builder.build()
    };
    let (fast, plain) = (build(), build().plain());
    assert!(!plain.avx2);
    // Compute the FNV-1a hash of the bits of all hits.
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let (mut hits, mut hidden) = (0, 0);
    for _ in 0..30_000 {
        let ray = inward(&mut stream, 3.0, 1.0);
        let [a, b] = [&fast, &plain].map(|g| {
            let hit = g.intersect(&ray, f32::INFINITY)?;
            let surface = g.surface(&ray, &hit);
            let numbers = [hit.t, hit.u, hit.v, surface.p.x, surface.ns.y, surface.uv[0]];
            Some((hit.leaf, numbers.map(f32::to_bits)))
        });
        assert_eq!(a, b);
        let [a_hidden, b_hidden] = [&fast, &plain].map(|g| g.occluded(&ray, 2.5));
        assert_eq!(a_hidden, b_hidden);
        hidden += u32::from(a_hidden);
        if let Some((leaf, numbers)) = a {
            hits += 1;
            for n in [leaf, numbers[0], numbers[1], numbers[2]] {
                hash = (hash ^ u64::from(n)).wrapping_mul(0x0100_0000_01b3);
            }
        }
    }
    assert!(hits > 10_000 && hidden > 3_000, "{hits} {hidden}");
    assert_eq!(hash, 0x9208_de61_4f77_581b, "{hash:#018x}");
}

//! Tests of the initial guesses for paths over mirrors.

use super::*;
use crate::geometry::builder::GeometryBuilder;
use crate::geometry::mesh::Mesh;
use crate::geometry::quadric::{Quadric, QuadricKind};
use crate::material::Material;
use crate::material::conductor::Conductor;
use crate::material::diffuse::Diffuse;
use crate::material::facets::Roughness;
use crate::material::rough_conductor::RoughConductor;
use crate::material::texture::{Scalar, Spectrum};
use glam::{Affine3A, Vec3};
use optics::sampling::microfacet::{Distribution, Masking};
use optics::spectrum::Spectral;

const WHITE: u32 = 0;
const GOLD: u32 = 1;
const MATT: u32 = 2;

enum Shape {
    Rectangle(u32, [[f32; 3]; 3]),
    Ball(f32, f32),
}

fn rectangle(material: u32, corner: [f32; 3], u: [f32; 3], v: [f32; 3]) -> Shape {
    Shape::Rectangle(material, [corner, u, v])
}

fn mirrors(shapes: &[Shape]) -> Mirrors {
    let (n, k) = (Spectral::splat(0.4242), Spectral::splat(2.4721));
    let reflectance = Spectrum::uniform(Spectral::ONE);
    let roughness = Roughness {
        distribution: Distribution::Ggx,
        masking: Masking::default(),
        alpha: Scalar::uniform(0.2),
    };
    let materials = Materials {
        list: vec![
            Material::Diffuse(Diffuse { albedo: Spectrum::uniform(Spectral::splat(0.5)) }),
            Material::Conductor(Conductor { n, k, reflectance }),
            Material::RoughConductor(RoughConductor { n, k, reflectance, roughness }),
        ],
        ..Materials::default()
    };
    let mut geometry = GeometryBuilder::default();
    for shape in shapes {
        match shape {
            Shape::Rectangle(material, place) => {
                let [corner, u, v] = place.map(Vec3A::from_array);
                let mut square = Mesh::rectangle();
                let axes = Mat3A::from_cols(u / 2.0, v / 2.0, u.cross(v));
                square.transform(&Affine3A { matrix3: axes, translation: corner + (u + v) / 2.0 });
                geometry.mesh(&square, *material);
            }
            Shape::Ball(x, radius) => {
                let place = Affine3A {
                    matrix3: Mat3A::from_diagonal(Vec3::splat(*radius)),
                    translation: Vec3A::new(*x, 0.0, 0.0),
                };
                geometry.quadric(Quadric::new(QuadricKind::Sphere, place, GOLD));
            }
        }
    }
    Mirrors::new(&geometry.build(), &materials)
}

/// Verifies that mirrors in one plane form one group regardless of the side that they face, and that diffuse
/// and rough surfaces are not mirrors.
#[test]
fn coplanar_parts_form_one_mirror() {
    let (x, y) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    let all = [
        rectangle(GOLD, [0.0; 3], x, y),
        rectangle(GOLD, [1.5, 0.0, 0.0], x, y),
        rectangle(GOLD, [0.0, 0.0, 0.3], x, y),
        rectangle(WHITE, [0.0, 0.0, 0.6], x, y),
        rectangle(MATT, [0.0, 0.0, 0.9], x, y),
    ];
    let mirrors = mirrors(&all);
    assert_eq!((mirrors.flats.len(), mirrors.curved.len()), (2, 0));
    let wide = mirrors.flats.iter().filter(|f| f.radius > 1.2).count();
    assert_eq!(wide, 1);
}

/// Verifies that a path over a flat mirror has equal angles of incidence and reflection. No path leads to the
/// other side of the mirror, or over a point outside the mirror.
#[test]
fn paths_over_a_flat_mirror_have_equal_angles() {
    let all = [rectangle(GOLD, [-1.0, -1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0])];
    let mirrors = mirrors(&all);
    let ways = |a: [f32; 3], b: [f32; 3]| {
        let mut found = vec![];
        mirrors.flat_paths(Vec3A::from_array(a), Vec3A::from_array(b), |seeds| {
            found.push(seeds[0].point);
        });
        found
    };
    let found = ways([-0.3, 0.2, 1.0], [0.6, 0.2, 2.0]);
    assert_eq!(found.len(), 1);
    assert!(found[0].distance(Vec3A::new(0.0, 0.2, 0.0)) < 1e-6, "{found:?}");
    assert!(ways([-0.3, 0.2, 1.0], [0.6, 0.2, -2.0]).is_empty());
    assert!(ways([-0.3, 0.2, 1.0], [9.0, 0.2, 1.0]).is_empty());
}

/// Verifies paths over two mirrors at a right angle. For the tested points, only one order of the mirrors is
/// possible.
#[test]
fn paths_over_two_mirrors_have_equal_angles() {
    let all = [
        rectangle(GOLD, [0.0, -1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]),
        rectangle(GOLD, [0.0, -1.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]),
    ];
    let mirrors = mirrors(&all);
    let (a, b) = (Vec3A::new(1.0, 0.1, 0.5), Vec3A::new(0.5, 0.1, 1.2));
    let mut pairs = 0;
    mirrors.flat_paths(a, b, |seeds| {
        if let [p, q] = seeds {
            pairs += 1;
            let [p, q] = [p.point, q.point];
            // Each reflection reverses the normal component of the direction.
            for (before, after, at) in [((p - a), (q - p), p), ((q - p), (b - q), q)] {
                let n = if at.z.abs() < 1e-6 { Vec3A::Z } else { Vec3A::X };
                let (before, after) = (before.normalize(), after.normalize());
                assert!((before - n * (2.0 * before.dot(n)) - after).length() < 1e-5);
            }
        }
    });
    assert_eq!(pairs, 1);
}

/// Verifies that random points are on curved mirrors, with probabilities proportional to the areas of the
/// mirrors.
#[test]
fn seeds_cover_curved_mirrors() {
    let mirrors = mirrors(&[Shape::Ball(0.0, 1.0), Shape::Ball(4.0, 0.5)]);
    assert_eq!((mirrors.flats.len(), mirrors.curved.len()), (0, 2));
    let (mut stream, n, mut large) = (Stream::new(1, 0, 0), 20_000, 0);
    for _ in 0..n {
        let p = mirrors.draw(&mut stream).expect("a mirror").point;
        let on = |x: f32, radius: f32| (p.distance(Vec3A::new(x, 0.0, 0.0)) - radius).abs() < 1e-5;
        large += u32::from(on(0.0, 1.0));
        assert!(on(0.0, 1.0) || on(4.0, 0.5), "{p}");
    }
    // Expect four fifths of the points on the large sphere, within 5 standard deviations.
    let (share, sigma) = (f64::from(large) / f64::from(n), (0.16 / f64::from(n)).sqrt());
    assert!((share - 0.8).abs() < 5.0 * sigma, "{share}");
}

/// Verifies that points on mirrors with many instances are on the instances, with probabilities proportional
/// to the areas of the instances.
#[test]
fn mirrors_with_many_copies_are_sampled_in_two_steps() {
    const N: u32 = 40_000;
    let ball = |x: f32, radius: f32| Outline::Ball { centre: Vec3A::new(x, 0.0, 0.0), radius };
    let groups = vec![vec![], vec![ball(0.0, 1.0), ball(3.0, 2.0)]];
    let places = [(0, 0.0, 1.0), (1, 100.0, 1.0), (1, 200.0, -2.0)];
    let copies = places.map(|(group, x, scale)| {
        let place = Affine3A::from_scale_rotation_translation(
            Vec3::splat(scale),
            glam::Quat::IDENTITY,
            Vec3::new(x, 0.0, 0.0),
        );
        (group, place)
    });
    let copied = Copied::new(groups, copies.into_iter());
    let unit = 4.0 * std::f32::consts::PI;
    assert!((copied.area() / unit - 25.0).abs() < 1e-3);
    let (mut stream, mut counts) = (Stream::new(4, 0, 0), [0; 4]);
    // Centre and radius of each sphere in world space.
    let balls = [(100.0, 1.0), (103.0, 2.0), (200.0, 2.0), (194.0, 4.0)];
    for _ in 0..N {
        let at = stream.uniform() * copied.area();
        let p = copied.point(at, stream.uniform(), stream.uniform2());
        let on = |(x, r): &(f32, f32)| ((p - Vec3A::new(*x, 0.0, 0.0)).length() - r).abs() < 1e-3;
        counts[balls.iter().position(on).expect("the point is on a sphere")] += 1;
    }
    for ((_, r), n) in balls.iter().zip(counts) {
        let share = f64::from(r * r / 25.0);
        let sigma = (f64::from(N) * share * (1.0 - share)).sqrt();
        assert!((f64::from(n) - f64::from(N) * share).abs() < 5.0 * sigma, "{counts:?}");
    }
}

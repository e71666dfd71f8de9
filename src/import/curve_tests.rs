//! Tests tubes against analytic areas and volumes, and tests invalid files.

use super::curve::{Kind, parse_curves};
use glam::{DAffine3, DVec3};
use std::f64::consts::TAU;
use transport::geometry::mesh::Mesh;

fn text(points: &[[f64; 4]]) -> String {
    points.iter().map(|[x, y, z, r]| format!("{x} {y} {z} {r}\n")).collect()
}

/// Returns the area and the volume of a mesh. The volume is meaningful only for a closed mesh.
pub fn measures(mesh: &Mesh) -> [f64; 2] {
    let (mut area, mut volume) = (0.0, 0.0);
    for corners in &mesh.indices {
        let [a, b, c] = corners.map(|i| mesh.positions[i as usize].as_dvec3());
        area += (b - a).cross(c - a).length() / 2.0;
        volume += a.dot(b.cross(c)) / 6.0;
    }
    [area, volume]
}

fn near(got: f64, want: f64, tolerance: f64) {
    assert!((got / want - 1.0).abs() < tolerance, "{got}, not {want}");
}

fn normals_agree(mesh: &Mesh) {
    for corners in &mesh.indices {
        let [a, b, c] = corners.map(|i| mesh.positions[i as usize].as_dvec3());
        let face = (b - a).cross(c - a).normalize();
        for i in corners {
            let n = mesh.normals[*i as usize].as_dvec3();
            assert!(face.dot(n) > 0.85, "{face} {n}");
        }
    }
}

#[test]
fn a_straight_spline_is_a_cylinder_or_a_cone() {
    // The segments of a B-spline span the second to the second-last point.
    for direction in [DVec3::X, DVec3::Z, DVec3::new(1.0, 2.0, -3.0).normalize()] {
        let at = |k: f64, r: f64| (direction * k).extend(r).to_array();
        let tube = text(&[at(0.0, 0.1), at(1.0, 0.1), at(2.0, 0.1), at(3.0, 0.1), at(4.0, 0.1)]);
        let made = parse_curves(tube.as_bytes(), Kind::BSpline, &DAffine3::IDENTITY).unwrap();
        near(measures(&made.mesh)[0], TAU * 0.1 * 2.0, 1e-4);
        normals_agree(&made.mesh);
        let cone = text(&[at(0.0, 0.0), at(1.0, 0.1), at(2.0, 0.2), at(3.0, 0.3)]);
        let made = parse_curves(cone.as_bytes(), Kind::BSpline, &DAffine3::IDENTITY).unwrap();
        near(measures(&made.mesh)[0], TAU * 0.15 * 1.01_f64.sqrt(), 1e-3);
        normals_agree(&made.mesh);
    }
}

/// Tests a circular tube against the area of a torus by Pappus, (2πR)(2πr). A closed B-spline of 64 points
/// approximates a circle to 1e-5.
#[test]
fn a_circle_is_a_torus() {
    let ring: Vec<[f64; 4]> = (0..67)
        .map(|k| {
            let (s, c) = (TAU * f64::from(k) / 64.0).sin_cos();
            [c, 0.1, s, 0.2]
        })
        .collect();
    let made = parse_curves(text(&ring).as_bytes(), Kind::BSpline, &DAffine3::IDENTITY).unwrap();
    let [area, volume] = measures(&made.mesh);
    let radius = (2.0 + (TAU / 64.0).cos()) / 3.0;
    near(area, TAU * radius * TAU * 0.2, 3e-3);
    near(volume, TAU * radius * TAU / 2.0 * 0.04, 1e-2);
    normals_agree(&made.mesh);
    // Where the tangent is parallel to z, Mitsuba's frame rotates, and no triangle may cross the tube.
    for corners in &made.mesh.indices {
        let [a, b, c] = corners.map(|i| made.mesh.positions[i as usize]);
        assert!(a.distance(b).max(b.distance(c)) < 0.2);
    }
}

#[test]
fn linear_curves_have_spheres_at_their_points() {
    let made = |points: &[[f64; 4]]| {
        parse_curves(text(points).as_bytes(), Kind::Linear, &DAffine3::IDENTITY).unwrap().mesh
    };
    // Two spheres of equal radius form a capsule.
    let capsule = made(&[[0.0, 0.0, 0.0, 0.5], [0.0, 2.0, 0.0, 0.5]]);
    let [area, volume] = measures(&capsule);
    near(area, TAU * 0.5 * (2.0 + 1.0), 1e-2);
    near(volume, TAU / 2.0 * 0.25 * (2.0 + 4.0 / 3.0 * 0.5), 1e-2);
    normals_agree(&capsule);
    // Joints on a straight line and duplicate points do not change the area.
    let straight =
        made(&[[0.0, 0.0, 0.0, 0.5], [0.0, 1.0, 0.0, 0.5], [0.0, 1.0, 0.0, 0.5], [0.0, 2.0, 0.0, 0.5]]);
    near(measures(&straight)[0], area, 2e-2);
    // Two spheres of radii 0.5 and 0.25 are joined by the cone tangent to both spheres, with sin α = 0.25.
    let cone = made(&[[0.0, 0.0, 0.0, 0.5], [1.0, 0.0, 0.0, 0.25]]);
    let (sin, cos) = (0.25_f64, (1.0_f64 - 0.0625).sqrt());
    let caps = TAU * (0.25 * (1.0 + sin) + 0.0625 * (1.0 - sin));
    near(measures(&cone)[0], caps + TAU / 2.0 * 0.75 * cos * cos, 1e-2);
    // A sphere within another sphere is not visible.
    let sphere = made(&[[0.0, 0.0, 0.0, 0.5], [0.1, 0.0, 0.0, 0.1]]);
    near(measures(&sphere)[0], 2.0 * TAU * 0.25, 1.5e-2);
}

#[test]
fn texture_coordinates_run_around_and_along() {
    let lines =
        text(&[[0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 1.0], [2.0, 0.0, 0.0, 1.0], [3.0, 0.0, 0.0, 1.0]]);
    let two = format!("{lines}\n\n{lines}");
    let mesh = parse_curves(two.as_bytes(), Kind::BSpline, &DAffine3::IDENTITY).unwrap().mesh;
    for (p, uv) in mesh.positions.iter().zip(&mesh.uvs) {
        // For a tube along x, Mitsuba's u is 0 in the direction y and 1/4 in the direction z.
        let angle = f64::from(uv.x) * TAU;
        assert!((f64::from(p.y) - angle.cos()).abs() < 0.01 && (f64::from(p.z) - angle.sin()).abs() < 0.01);
    }
    assert!(mesh.uvs.iter().any(|uv| uv.y == 1.0) && mesh.uvs.iter().any(|uv| uv.y == 0.5));
}

#[test]
fn invalid_curves_are_refused_with_a_message() {
    let good = "0 0 0 1\n1 0 0 1\n2 0 0 1\n3 0 0 1\n";
    for (lines, expected) in [
        (String::new(), "empty"),
        ("\n \n".into(), "empty"),
        (good.replace("2 0 0 1", "2 0 0 -1"), "at least 0, got -1"),
        (good.replace("2 0 0 1", "2 0 0 nan"), "not a finite number"),
        (good.replace("2 0 0 1", "2 inf 0 1"), "not a finite number"),
        (good.replace("2 0 0 1", "2 1e300 0 1"), "not a finite number"),
        (good.replace("2 0 0 1", "2 0 0"), "four numbers"),
        (good.replace("2 0 0 1", "2 0 0 1 5"), "four numbers"),
        (good.replace("2 0 0 1", "\n2 0 0 1"), "at least 4"),
        ("0 0 0 1\n".repeat(5), "coincide"),
        (good.replace(" 1\n", " 0\n"), "no triangles"),
    ] {
        let e = parse_curves(lines.as_bytes(), Kind::BSpline, &DAffine3::IDENTITY).unwrap_err();
        assert!(e.to_string().contains(expected), "{lines:?}: {e}");
    }
    // The ends can have several equal points and a radius of 0.
    let ends = "0 0 0 0\n0 0 0 0\n0 0 0 0\n1 0 0 1\n2 0 0 1\n3 0 0 0\n3 0 0 0\n3 0 0 0";
    let made = parse_curves(ends.as_bytes(), Kind::BSpline, &DAffine3::IDENTITY).unwrap();
    assert!(measures(&made.mesh)[1] > 1.0);
}

//! Compares orthographic cameras with closed forms. The tests cover ray positions, intersections, travel
//! times, and refusals.

use crate::optics::{C, assert_refused};
use crate::support::{Rendered, render_text};
use glam::DVec3;
use std::f64::consts::PI;
use sunstone::scene::from_text;
use sunstone::tensor::axes::AxisKind::{StokesIn, StokesOut, T, X, Y};
use sunstone::tensor::field::Field;

/// Scene-file text of a camera that sees the plane z = 0 obliquely. The image is 0.6 m wide and 0.4 m high.
const CAMERA: &str = "[camera]\nresolution = [6, 4]\northographic_width = 0.6\n\
    pose.look_at = { origin = [0, -2, 2], target = [0, 0, 0], up = [0, 1, 0] }\n";
const PLANE: &str = "[materials]\nm.diffuse.albedo = 0.6\n[[objects]]\nmaterial = \"m\"\n\
    shape.rectangle = { corner = [-9, -9, 0], u = [18, 0, 0], v = [0, 18, 0] }\n";

fn head(spp: u32, more: &str) -> String {
    format!("wavelengths_nm = [550]\n[render]\nspp = {spp}\nmax_depth = 2\nseed = 3\n{more}")
}

/// Returns the offset in metres, to the right and down, of a position in pixel (i, j). `a` and `b` are
/// fractions of a pixel.
fn offset(i: usize, j: usize, [a, b]: [f64; 2]) -> [f64; 2] {
    [0.1 * (i as f64 + a - 3.0), 0.1 * (j as f64 + b - 2.0)]
}

fn value(r: &Rendered, i: usize, j: usize, bin: Option<usize>) -> [f64; 2] {
    let mut at = vec![(Y, j), (X, i), (StokesOut, 0), (StokesIn, 0)];
    at.extend(bin.map(|b| (T, b)));
    [Field::Mean, Field::StdError].map(|f| f64::from(r.field("m", f).at(&at)))
}

/// Tests that, under a point light above the plane, each pixel shows the mean irradiance of its own
/// parallelogram on the plane. All parallelograms are at the same distance.
#[test]
fn each_pixel_sees_its_own_area() {
    let light = DVec3::new(0.1, 0.15, 0.3);
    let slice = "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";
    let emitter = "[[emitters]]\npoint = { position = [0.1, 0.15, 0.3], intensity = 2 }\n";
    let r = render_text(&(head(2000, "") + CAMERA + PLANE + emitter + slice));
    let (forward, right) = (DVec3::new(0.0, 1.0, -1.0).normalize(), DVec3::X);
    let down = forward.cross(right);
    for (i, j) in [(0, 0), (5, 0), (2, 1), (3, 2), (1, 3), (5, 3)] {
        let mut want = 0.0;
        for k in 0..400 {
            let mid = |n: i32| (f64::from(n) + 0.5) / 20.0;
            let [x, y] = offset(i, j, [mid(k % 20), mid(k / 20)]);
            let start = DVec3::new(0.0, -2.0, 2.0) + right * x + down * y;
            let p = start + forward * (start.z / -forward.z);
            let to = light - p;
            want += 0.6 / PI * 2.0 * to.z / to.length().powi(3) / 400.0;
        }
        let [got, sigma] = value(&r, i, j, None);
        assert!(
            (got - want).abs() <= 5.0 * sigma + 1e-3 * want && sigma < 0.02 * want,
            "({i}, {j}): {got} ± {sigma:.1e}, closed form {want}"
        );
    }
}

/// Tests that every point on a pixel's ray projects to that pixel.
#[test]
fn points_project_to_the_pixels_that_see_them() {
    let slice = "[[slices]]\nname = \"m\"\n[[emitters]]\nenvironment.radiance = 1\n";
    let scene = from_text("scene.toml".as_ref(), &(head(1, "") + CAMERA + PLANE + slice));
    let camera = scene.unwrap_or_else(|e| panic!("{e}")).camera;
    for (x, y, t) in [(0.5, 0.5, 0.4), (5.25, 3.75, 9.0)] {
        let at = glam::DVec2::new(x, y);
        let ray = camera.at(at);
        let found = camera.project(ray.origin + ray.direction(at) * t).map(|(at, _)| at);
        assert!(found.is_some_and(|f| (f - at).length() < 1e-4), "{found:?}");
        assert_eq!(camera.project(ray.origin - ray.direction(at) * t), None);
    }
}

/// Tests that travel time is measured from the image plane. Without perspective, all columns of a row have
/// equal distances to a parallel surface.
#[test]
fn time_counts_from_the_plane_of_the_image() {
    // Light travels straight down from the light's plane, 3 m above z = 0, and then back along the camera's
    // axis.
    let emitter =
        "[[emitters]]\ndirectional = { direction = [0, 0, -1], irradiance = 1, origin = [0, 0, 3] }\n";
    let slice = "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\ntime = { start_ps = 17000, bin_ps = 500, bins = 10 }\n";
    let r = render_text(&(head(500, "") + CAMERA + PLANE + emitter + slice));
    let diagonal = 0.5_f64.sqrt();
    for (i, j) in [(0, 0), (5, 0), (3, 1), (0, 3)] {
        // The lower part of the image is nearer. The distance of a point of the plane is (2 - y/√2) √2.
        let length = |y: f64| 3.0 + (2.0 - y * diagonal) / diagonal;
        let [_, y] = offset(i, j, [0.5, 0.5]);
        let mean: f64 =
            (0..10).map(|b| value(&r, i, j, Some(b))[0] * (17000.0 + 500.0 * (b as f64 + 0.5))).sum::<f64>()
                / (0..10).map(|b| value(&r, i, j, Some(b))[0]).sum::<f64>();
        let want = length(y) / C;
        assert!((mean - want).abs() < 260.0, "({i}, {j}): {mean} ps, closed form {want}");
    }
}

/// Tests a camera and a sphere of fog. Rays begin in the fog if the image plane is inside the sphere, and in
/// air otherwise.
#[test]
fn rays_begin_in_the_surrounding_medium() {
    let camera = "[camera]\nresolution = [6, 4]\northographic_width = 0.6\n\
        pose.matrix = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]\n";
    let ball = "[materials]\nn.null = {}\n[media]\nfog.homogeneous = { absorption = 3 }\n\
        [[objects]]\nmaterial = \"n\"\ninterior = \"fog\"\nshape.sphere.radius = 0.17\n[[emitters]]\nenvironment.radiance = 1\n";
    let slice = "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";
    let r = render_text(&(head(4000, "") + camera + ball + slice));
    for (i, j) in [(0, 0), (2, 1), (3, 2), (4, 2), (5, 3)] {
        let mut want = 0.0;
        for k in 0..1600 {
            let mid = |n: i32| (f64::from(n) + 0.5) / 40.0;
            let [x, y] = offset(i, j, [mid(k % 40), mid(k / 40)]);
            want += (-3.0 * (0.17_f64.powi(2) - x * x - y * y).max(0.0).sqrt()).exp() / 1600.0;
        }
        let [got, sigma] = value(&r, i, j, None);
        assert!(
            (got - want).abs() <= 5.0 * sigma + 1e-3,
            "({i}, {j}): {got} ± {sigma:.1e}, closed form {want}"
        );
    }
}

/// Tests that features that require a pinhole are refused.
#[test]
fn features_that_need_a_pinhole_are_refused() {
    let projector = "[projector]\nresolution = [4, 4]\nfov_x_deg = 30\n\
        pose.look_at = { origin = [1, 0, 3], target = [0, 0, 0] }\n";
    let slice = "[[slices]]\nname = \"m\"\n";
    let cases = [
        (head(1, "integrator = \"bidirectional\"\n") + CAMERA + PLANE + projector + slice, "no pinhole"),
        (head(1, "integrator = \"caustics\"\n") + CAMERA + PLANE + projector + slice, "no pinhole"),
        (head(1, "") + CAMERA + PLANE + "[projector]\ncoaxial = true\n" + slice, "has no pinhole"),
        (
            head(1, "")
                + CAMERA
                + PLANE
                + projector
                + slice
                + "projector = { epipolar = { half_width_px = 1 } }\n",
            "no epipolar lines",
        ),
        (head(1, "") + CAMERA + "fov_x_deg = 30\n" + PLANE + projector + slice, "exactly one"),
        (
            head(1, "") + CAMERA + "aperture = { radius = 0.1, focus = 1 }\n" + PLANE + projector + slice,
            "cannot have a lens",
        ),
    ];
    for (text, what) in cases {
        assert_refused("scene.toml".as_ref(), &text, what);
    }
}

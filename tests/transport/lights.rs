//! Compares common light sources with closed forms and quadrature, with each integrator. The sources are:
//! - emitting disks, spheres, rectangles, tubes and ellipsoids over a Lambertian plane
//! - the sky
//! - spots, luminaires, directional lights and beams
//!
//! The tests include frames, filters and travel times.

use crate::optics::{C, Device, M, head, mueller, of_image};
use crate::support::{Rendered, render_text};
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::{PI, TAU};
use sunstone::tensor::axes::AxisKind::{StokesIn, StokesOut, T};
use sunstone::tensor::field::Field;

const ALBEDO: f64 = 0.6;
const SLICE: &str = "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";
const BOTH: [&str; 2] = ["path", "bidirectional"];

/// Scene-file text of a Lambertian plane z = 0 whose front faces +z, and of a black material for emitters.
const PLANE: &str = "[materials]\nm.diffuse.albedo = 0.6\nblack.diffuse.albedo = 0\n\
    [[objects]]\nmaterial = \"m\"\nshape.rectangle = { corner = [-9, -9, 0], u = [18, 0, 0], v = [0, 18, 0] }\n";

/// Returns the scene-file text of a camera with one ray to a point of the plane.
pub fn text(integrator: &str, spp: u32, depth: u32, at: [f64; 2], light: &str) -> String {
    let camera = Device::ray([0.3, -4.0, 2.5], DVec3::new(at[0], at[1], 0.0));
    let render = format!("integrator = \"{integrator}\"\n");
    head(spp, depth, 5) + &render + &camera.keys("camera") + PLANE + light + SLICE
}

pub fn m00(r: &Rendered) -> (f64, f64) {
    let at = [(StokesOut, 0), (StokesIn, 0)];
    (f64::from(r.mean("m").at(&at)), f64::from(r.std_error("m").at(&at)))
}

/// Checks that the plane has the radiance that corresponds to `irradiance`, within five standard errors. The
/// relative standard error must be at most `error`.
pub fn check(text: &str, irradiance: f64, error: f64, what: &str) {
    let (got, sigma) = m00(&render_text(text));
    let want = ALBEDO / PI * irradiance;
    assert!(
        (got - want).abs() <= 5.0 * sigma + 3e-5 * want,
        "{what}: {got} ± {sigma:.1e}, closed form {want}"
    );
    assert!(sigma <= error * want, "{what}: error {sigma:.1e} of {want}");
}

/// Returns the scene-file text of an emitting object.
pub fn shining(shape: &str, more: &str) -> String {
    format!("[[objects]]\nmaterial = \"black\"\nshape.{shape}\nemission = {{ radiance = 2{more} }}\n")
}

/// Tests the irradiance of a disk parallel to the plane, at a point off the disk's axis (Siegel & Howell,
/// configuration B-14).
#[test]
fn disks_light_a_plane() {
    let (h, r) = (1.5, 0.8);
    for integrator in BOTH {
        for d in [0.0_f64, 0.4, 2.0] {
            let z = d * d + h * h + r * r;
            let factor = 0.5 * (1.0 - (z - 2.0 * r * r) / (z * z - 4.0 * d * d * r * r).sqrt());
            let light = shining(
                &format!("disk = {{ center = [0.2, 0.1, {h}], normal = [0, 0, -1], radius = {r} }}"),
                "",
            );
            let text = text(integrator, 4000, 2, [0.2, 0.1 + d], &light);
            check(&text, 2.0 * PI * factor, 0.02, &format!("{integrator}, disk {d} m off"));
        }
    }
}

/// Tests that the irradiance of a sphere above the horizon is π L (r/d)² cosθ. If the sphere's cone is
/// sampled, the render is exact up to rounding.
#[test]
fn spheres_light_a_plane() {
    let (centre, r) = (DVec3::new(0.5, -0.4, 1.2), 0.7);
    for integrator in BOTH {
        for at in [[0.5, -0.4], [-0.9, 0.6]] {
            let to = centre - DVec3::new(at[0], at[1], 0.0);
            let d2 = to.length_squared();
            let irradiance = 2.0 * PI * r * r / d2 * (to.z / d2.sqrt());
            let light =
                shining(&format!("sphere = {{ center = {:?}, radius = {r} }}", centre.to_array()), "");
            check(&text(integrator, 4000, 2, at, &light), irradiance, 0.02, &format!("{integrator}, sphere"));
        }
    }
}

/// Returns the irradiance at a point of the plane from a surface of radiance 2, computed by a midpoint rule.
/// For u and v in 0..1, `surface` returns a point, the normal times the area, and half of the radiance at
/// this point.
pub fn quadrature(at: [f64; 2], surface: impl Fn(f64, f64) -> (DVec3, DVec3, f64)) -> f64 {
    const N: u32 = 800;
    let p = DVec3::new(at[0], at[1], 0.0);
    let mid = |i: u32| (f64::from(i) + 0.5) / f64::from(N);
    let one = |k: u32| {
        let (q, area, share) = surface(mid(k % N), mid(k / N));
        let to = q - p;
        let d2 = to.length_squared();
        let facing = -area.dot(to).min(0.0) * to.z.max(0.0) / (d2 * d2);
        2.0 * share * facing
    };
    (0..N * N).map(one).sum::<f64>() / f64::from(N * N)
}

/// Tests the irradiance of a tilted rectangular mesh that emits an image of four squares.
#[test]
fn rectangles_with_images_light_a_plane() {
    let folder = tempfile::tempdir().expect("a folder");
    let image = folder.path().join("squares.png");
    // The top row is first. sRGB 255 is 1, and sRGB 0 is 0.
    image::GrayImage::from_raw(2, 2, vec![255, 0, 0, 255])
        .expect("four pixels")
        .save(&image)
        .expect("a file");
    let (corner, u, v) = (DVec3::new(-0.4, 0.2, 1.0), DVec3::new(0.0, 0.9, 0.3), DVec3::new(0.8, 0.0, 0.1));
    let shape = format!(
        "rectangle = {{ corner = {:?}, u = {:?}, v = {:?} }}",
        corner.to_array(),
        u.to_array(),
        v.to_array()
    );
    let place = |a: f64, b: f64| (corner + u * a + v * b, u.cross(v));
    let (at, more) = ([0.4, -0.3], format!(", image = {{ image = {image:?}, filter = \"nearest\" }}"));
    let plain = quadrature(at, |a, b| (place(a, b).0, place(a, b).1, 1.0));
    let squares = quadrature(at, |a, b| {
        // The upper left and lower right squares are white.
        let white = (a < 0.5) != (b < 0.5);
        (place(a, b).0, place(a, b).1, f64::from(u8::from(white)))
    });
    assert!((squares / plain - 0.5).abs() > 0.01, "the image must show");
    for integrator in BOTH {
        check(&text(integrator, 4000, 2, at, &shining(&shape, "")), plain, 0.02, integrator);
        check(&text(integrator, 8000, 2, at, &shining(&shape, &more)), squares, 0.04, integrator);
    }
}

/// Tests the irradiance of an ellipsoid and of an elliptic tube. Points on each shape are sampled
/// non-uniformly.
#[test]
fn ellipsoids_and_tubes_light_a_plane() {
    let at = [0.3, 0.2];
    let m =
        DMat3::from_cols(DVec3::new(0.5, 0.2, 0.0), DVec3::new(-0.1, 0.9, 0.1), DVec3::new(0.1, 0.0, 0.3));
    let centre = DVec3::new(-0.2, 0.4, 1.1);
    let c = m.transpose();
    let matrix = format!(
        "transform.matrix = [[{}, {}, {}, {}], [{}, {}, {}, {}], [{}, {}, {}, {}], [0, 0, 0, 1]]\n",
        c.x_axis.x,
        c.x_axis.y,
        c.x_axis.z,
        centre.x,
        c.y_axis.x,
        c.y_axis.y,
        c.y_axis.z,
        centre.y,
        c.z_axis.x,
        c.z_axis.y,
        c.z_axis.z,
        centre.z
    );
    let normals = m.inverse().transpose() * m.determinant();
    let ellipsoid = quadrature(at, |a, b| {
        let (z, phi) = (1.0 - 2.0 * a, TAU * b);
        let o = DVec3::new((1.0 - z * z).sqrt() * phi.cos(), (1.0 - z * z).sqrt() * phi.sin(), z);
        (centre + m * o, normals * o * 4.0 * PI, 1.0)
    });
    let tube = quadrature(at, |a, b| {
        let (s, c) = (TAU * a).sin_cos();
        (centre + m * DVec3::new(c, s, b), normals * DVec3::new(c, s, 0.0) * TAU, 1.0)
    });
    for integrator in BOTH {
        let sphere = shining("sphere.radius = 1", "") + &matrix;
        check(&text(integrator, 8000, 2, at, &sphere), ellipsoid, 0.03, "ellipsoid");
        // The tube is open at its ends. The inside of the tube is dark and occludes nothing.
        let cylinder = shining("cylinder = { p0 = [0, 0, 0], p1 = [0, 0, 1], radius = 1 }", "") + &matrix;
        check(&text(integrator, 8000, 2, at, &cylinder), tube, 0.03, "tube");
    }
}

/// Tests the radiance, travel time and polarization of emitters that the camera sees directly. Tests
/// one-sided and two-sided emission.
#[test]
fn directly_seen_lights_are_correct() {
    let seen = |more: &str, from: f64, integrator: &str| {
        let camera = Device::ray([0.0, 0.0, from], DVec3::new(0.0, 0.0, 1.0));
        let light = shining("disk = { center = [0, 0, 1], normal = [0, 0, 1], radius = 0.5 }", more);
        let slices = SLICE.to_owned()
            + "[[slices]]\nname = \"t\"\ntime = { start_ps = 0, bin_ps = 10, bins = 2000 }\n";
        let render = format!("integrator = \"{integrator}\"\n");
        let matter = "[materials]\nblack.diffuse.albedo = 0\n";
        (
            camera.clone(),
            render_text(&(head(16, 3, 1) + &render + &camera.keys("camera") + matter + &light + &slices)),
        )
    };
    for integrator in BOTH {
        let (_, r) = seen("", 3.0, integrator);
        assert!((m00(&r).0 - 2.0).abs() < 1e-5);
        let t = r.mean("t");
        let bin = (2.0 / C / 10.0) as usize;
        assert!((f64::from(t.at(&[(T, bin)])) - 2.0).abs() < 1e-5, "light after the way of 2 m");
        assert_eq!(m00(&seen("", -1.0, integrator).1), (0.0, 0.0), "the back is dark");
        assert!((m00(&seen(", two_sided = true", -1.0, integrator).1).0 - 2.0).abs() < 1e-5);

        // The filter is at 30° from x, in the frame of light that travels to the camera. The camera's right
        // is a different axis.
        let (camera, r) = seen(", polarizer_deg = 30", 3.0, integrator);
        let own = DVec3::X;
        let d = DVec3::Z;
        let y = d.cross(own);
        let (s, c) = (2.0 * 30_f64.to_radians()).sin_cos();
        let across = camera.right;
        // Computes the angle from the camera's right to the filter's axis, about the direction of travel.
        let axis = own * 30_f64.to_radians().cos() + y * 30_f64.to_radians().sin();
        let angle = d.dot(across.cross(axis)).atan2(across.dot(axis));
        let out = [1.0, (2.0 * angle).cos(), (2.0 * angle).sin(), 0.0];
        let into = [1.0, c, s, 0.0];
        let want = M::from_fn(|i, j| out[i] * into[j]);
        crate::optics::assert_close(&mueller(&r.mean("m"), &[]), &want, 1e-5, "filter");

        // With a stated Stokes vector, column 0 is the Stokes vector of the light.
        let (_, r) = seen(", stokes = [1, 0, 0, -0.8]", 3.0, integrator);
        let mut want = M::zeros();
        (want[(0, 0)], want[(3, 0)]) = (2.0, -1.6);
        crate::optics::assert_close(&mueller(&r.mean("m"), &[]), &want, 1e-5, "stokes");
    }
}

/// Tests Malus's law between a light's filter and a polarizer. Column 0 has the factor ½cos²θ, where θ is the
/// angle between filter and polarizer.
#[test]
fn light_through_two_polarizers_obeys_malus() {
    for degrees in [0.0_f64, 25.0, 60.0, 90.0] {
        let camera = Device::ray([0.0, 0.0, 3.0], DVec3::new(0.0, 0.0, 1.0));
        let more = format!(", polarizer_deg = {degrees}");
        let light = shining("disk = { center = [0, 0, 1], normal = [0, 0, 1], radius = 0.5 }", &more);
        let sheet = "[materials]\nblack.diffuse.albedo = 0\npol.polarizer = { axis = [1, 0, 0] }\n[[objects]]\n\
                     material = \"pol\"\nshape.disk = { center = [0, 0, 2], normal = [0, 0, 1], radius = 0.5 }\n";
        let r = render_text(&(head(16, 6, 1) + &camera.keys("camera") + sheet + &light + SLICE));
        let want = 2.0 * 0.5 * degrees.to_radians().cos().powi(2);
        assert!((m00(&r).0 - want).abs() < 1e-5, "{degrees}°: {}, Malus {want}", m00(&r).0);
    }
}

/// Tests that connections sample light through a sheet, and that random paths sample light in a mirror. Tests
/// that no light is counted twice.
#[test]
fn sheets_and_mirrors_neither_lose_nor_double_light() {
    let (h, r) = (1.0, 0.5);
    let light = shining(&format!("disk = {{ center = [0, 0, {h}], normal = [0, 0, -1], radius = {r} }}"), "");
    let factor = r * r / (h * h + r * r);
    let sheet = "[[objects]]\nmaterial = \"p\"\nshape.rectangle = { corner = [-5, -5, 0.5], u = [10, 0, 0], v = [0, 10, 0] }\n";
    // Ideal polarizers transmit half of unpolarized light in each direction.
    let matter = "[materials.p.polarizer]\naxis = [1, 0, 0]\n";
    let text = |integrator: &str, more: &str| {
        let camera = Device::ray([0.02, 0.0, 0.3], DVec3::ZERO);
        let render = format!("integrator = \"{integrator}\"\n");
        head(6000, 6, 5) + &render + &camera.keys("camera") + PLANE + &light + more + SLICE
    };
    for integrator in BOTH {
        // The camera is below the sheet and sees light that passes the sheet. The disk is small, because
        // oblique rays follow the sheet's own law.
        let plain = m00(&render_text(&text(integrator, "")));
        let want = ALBEDO / PI * 2.0 * PI * factor;
        assert!((plain.0 - want).abs() <= 5.0 * plain.1, "{integrator}: {plain:?}, {want}");
        let through = m00(&render_text(&text(integrator, &format!("{matter}{sheet}"))));
        // The sheet's underside reflects nothing, because the sheet absorbs light.
        assert!(
            (through.0 - 0.5 * want).abs() <= 5.0 * through.1 + 1e-3 * want,
            "{integrator}: {through:?}, {}",
            0.5 * want
        );
    }
}

/// Tests that a white sphere, a glass sphere or a cloud without absorption is invisible inside an emitting
/// sphere, with each integrator.
#[test]
fn lossless_objects_vanish_inside_an_emitting_sphere() {
    let cloud = "[media]\nfog.homogeneous = { scattering = 1.5, phase.rayleigh = {} }\n";
    for (matter, interior) in [
        ("w.diffuse.albedo = 1", ""),
        ("w.dielectric.ior = 1.5", ""),
        ("w.null = {}", "interior = \"fog\"\n"),
    ] {
        for integrator in BOTH {
            let camera = Device::look_at([0.0, 0.3, 2.5], DVec3::ZERO, [4, 4], 6.0);
            let render = format!("integrator = \"{integrator}\"\nmanifold = false\n");
            let text = head(600, 400, 31)
                + &render
                + &camera.keys("camera")
                + &format!("[materials]\nblack.diffuse.albedo = 0\n{matter}\n")
                + if interior.is_empty() { "" } else { cloud }
                + "[[objects]]\nmaterial = \"black\"\nshape.sphere.radius = 4\n\
                   emission = { radiance = 1, two_sided = true }\n"
                + &format!("[[objects]]\nmaterial = \"w\"\n{interior}shape.sphere.radius = 1\n")
                + SLICE;
            let (mean, sigma) = of_image(&render_text(&text), "m", 16);
            let off = mean - 1.0;
            assert!(
                off.abs() <= 5.0 * sigma + 1e-5 && sigma < 0.02,
                "{matter}, {integrator}: off by {off} ± {sigma:.1e}"
            );
        }
    }
}

/// Tests the irradiance of an image of the sky with radiance a + b·y, rotated or not. The image illuminates
/// planes that face up, obliquely and down. The irradiance is π a + 2π/3 b n·y.
#[test]
fn skies_light_planes() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("sky.exr");
    let (w, h) = (32_u32, 512_u32);
    image::Rgb32FImage::from_fn(w, h, |_, j| {
        let y = (PI * (f64::from(j) + 0.5) / f64::from(h)).cos();
        image::Rgb([(1.0 + 0.7 * y) as f32; 3])
    })
    .save(&file)
    .expect("a file");
    for (turn, up) in [("", DVec3::Y), ("transform.rotate_deg = [90, 0, 0], ", DVec3::Z)] {
        for integrator in BOTH {
            let light = format!("[[emitters]]\nenvironment = {{ {turn}radiance = 2, image = {file:?} }}\n");
            let want = 2.0 * (PI + TAU / 3.0 * 0.7 * up.z);
            check(
                &text(integrator, 20_000, 2, [0.0, 0.0], &light),
                want,
                0.02,
                &format!("sky {turn}{integrator}"),
            );
        }
    }
}

/// Tests a sky with a single bright texel. Connections must sample the texel, and the camera must see the
/// texel in the correct direction.
#[test]
fn a_bright_texel_is_sampled_and_seen_in_its_direction() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("sun.exr");
    let (w, h) = (256_u32, 128_u32);
    let (i, j) = (40, 50);
    image::Rgb32FImage::from_fn(w, h, |x, y| image::Rgb([if (x, y) == (i, j) { 1000.0 } else { 0.0 }; 3]))
        .save(&file)
        .expect("a file");
    // Column i increases with atan2(x, -z). Row j increases from +y downward.
    let (phi, theta) = (TAU * (f64::from(i) + 0.5) / 256.0, PI * (f64::from(j) + 0.5) / 128.0);
    let sun = DVec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos());
    let plate = crate::optics::plate(DVec3::ZERO, sun, 1.0, "m");
    let camera = Device::ray((sun * 2.0 + DVec3::new(0.3, 0.1, 0.2)).to_array(), DVec3::ZERO);
    let sky = format!("[[emitters]]\nenvironment.image = {file:?}\n");
    let matter = format!("[materials.m.diffuse]\nalbedo = {ALBEDO}\n");
    let text = head(40_000, 2, 3) + &camera.keys("camera") + &matter + &plate + &sky + SLICE;
    // The solid angle of the tent over the adjacent texels equals that of the texel.
    let want = 1000.0 * TAU / 256.0 * PI / 128.0 * theta.sin();
    check(&text, want, 0.01, "sun");
    let camera = Device::ray([0.0; 3], sun);
    let far = crate::optics::plate(DVec3::new(0.0, -50.0, 0.0), DVec3::Y, 1.0, "m");
    let r = render_text(&(head(4, 2, 3) + &camera.keys("camera") + &matter + &far + &sky + SLICE));
    assert!((m00(&r).0 / 1000.0 - 1.0).abs() < 1e-3, "the sun itself: {}", m00(&r).0);
}

/// Tests that the irradiances of directional lights and point lights at single points are exact up to
/// rounding.
#[test]
fn spots_luminaires_directional_light_and_beams() {
    let folder = tempfile::tempdir().expect("a folder");
    let ies = folder.path().join("lamp.ies");
    std::fs::write(
        &ies,
        "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 3 2 1 2 0 0 0\n1 1 9\n0 30 90\n0 90\n100 80 20\n100 40 0\n",
    )
    .expect("a file");
    let at = DVec2::new(0.6, -0.2);
    let p = DVec3::new(at.x, at.y, 0.0);
    let height = 2.0;
    let lamp = DVec3::new(0.1, 0.1, height);
    let to = p - lamp;
    let theta = (height / to.length()).acos().to_degrees();
    let cos = height / to.length();
    let inverse = cos / to.length_squared();
    // The luminaire is bilinear in the angles. Each row covers the angles from 0° to 30°. The position
    // between rows is the horizontal angle from x, mirrored into 0° to 90°.
    let phi = to.y.atan2(to.x).to_degrees().abs();
    let row = |edge: f64| 1.0 + (edge - 1.0) * theta / 30.0;
    let luminaire = row(0.8) + (row(0.4) - row(0.8)) * phi / 90.0;
    assert!(theta < 30.0 && phi < 90.0);
    let divergence = (0.05_f64).tan();
    let widened = |offset: DVec3, axis: DVec3, radius: f64| {
        let along = offset.dot(axis);
        let growth = 1.0 + along * divergence / radius;
        let aside = (offset - axis * along) / growth;
        let travel = (offset - aside).normalize();
        (aside.length_squared(), growth, travel)
    };
    let axis = DVec3::new(0.1, 0.05, -1.0).normalize();
    let (aside2, growth, travel) = widened(p - lamp, axis, 0.8);
    let beam = |a2: f64| 2.0 / (PI * 0.64) * (-2.0 * a2 / 0.64).exp();
    let straight = (p - lamp) - axis * (p - lamp).dot(axis);
    let list = |v: DVec3| format!("{:?}", v.to_array());
    let cases = [
        (
            format!(
                "spot = {{ position = {}, direction = [0, 0, -1], intensity = 3, cutoff_deg = 30, beam_deg = 5 }}",
                list(lamp)
            ),
            3.0 * inverse * (30.0 - theta) / 25.0,
        ),
        (
            format!(
                "spot = {{ position = {}, direction = [0, 0, -1], intensity = 3, cutoff_deg = 10 }}",
                list(lamp)
            ),
            0.0,
        ),
        (
            format!(
                "ies = {{ file = {ies:?}, position = {}, direction = [0, 0, -1], intensity = 3 }}",
                list(lamp)
            ),
            3.0 * inverse * luminaire,
        ),
        (
            "directional = { direction = [0.3, 0.1, -1], irradiance = 2 }".to_owned(),
            2.0 / DVec3::new(0.3, 0.1, -1.0).length(),
        ),
        ("directional = { direction = [0.3, 0.1, 1], irradiance = 2 }".to_owned(), 0.0),
        (
            format!(
                "beam = {{ origin = {}, direction = {}, power = 5, radius = 0.8 }}",
                list(lamp),
                list(axis)
            ),
            5.0 / (PI * 0.64) * -axis.z,
        ),
        (
            format!(
                "beam = {{ origin = {}, direction = {}, power = 5, radius = 0.1 }}",
                list(lamp),
                list(axis)
            ),
            0.0,
        ),
        (
            format!(
                "beam = {{ origin = {}, direction = {}, power = 5, radius = 0.8, gaussian = true }}",
                list(lamp),
                list(axis)
            ),
            5.0 * beam(straight.length_squared()) * -axis.z,
        ),
        (
            format!(
                "beam = {{ origin = {}, direction = {}, power = 5, radius = 0.8, gaussian = true, divergence_mrad = 100 }}",
                list(lamp),
                list(axis)
            ),
            5.0 * beam(aside2) / growth.powi(2) * -travel.z / travel.dot(axis),
        ),
    ];
    for (emitter, irradiance) in cases {
        for integrator in BOTH {
            let light = format!("[[emitters]]\n{emitter}\n");
            let text = text(integrator, 64, 2, at.to_array(), &light);
            let (got, sigma) = m00(&render_text(&text));
            let want = ALBEDO / PI * irradiance;
            assert!(
                (got - want).abs() <= 5.0 * sigma + 2e-4 * want,
                "{integrator} {emitter}: {got} ± {sigma:.1e}, not {want}"
            );
        }
    }
}

/// Tests that all power of a beam reaches a plane. The rays of a camera far above the plane integrate the
/// irradiance over the plane.
#[test]
fn a_beam_loses_no_power() {
    for more in
        ["", ", gaussian = true", ", divergence_mrad = 200", ", gaussian = true, divergence_mrad = 200"]
    {
        let light = format!(
            "[[emitters]]\nbeam = {{ origin = [0, 0, 1.5], direction = [0.2, 0, -1], power = 5, radius = 0.1{more} }}\n"
        );
        // From far above, the rays of a pixel are nearly parallel. 96 pixels cover 3 m.
        let camera = Device::look_at([0.3, 0.0, 3000.0], DVec3::new(0.3, 0.0, 0.0), [96, 96], 96_000.0);
        let text = head(16, 2, 5) + &camera.keys("camera") + PLANE + &light + "[[slices]]\nname = \"m\"\n";
        let r = render_text(&text);
        let pixel = 3.0 / 96.0;
        let power = r.mean("m").data.iter().map(|v| f64::from(*v)).sum::<f64>() * PI / ALBEDO * pixel * pixel;
        assert!((power / 5.0 - 1.0).abs() < 0.01, "beam{more}: {power} of 5 W/nm");
    }
}

/// Tests that travel time starts at the emitting surface, at the plane of a directional light's origin, or at
/// a beam's origin. Light without an origin is counted as overflow.
#[test]
fn travel_time_counts_from_the_emitter() {
    let from = DVec3::new(0.3, -4.0, 2.5);
    let small = shining("disk = { center = [0, 0, 2], normal = [0, 0, -1], radius = 0.001 }", "");
    let cases = [
        (small, Some(2.0)),
        (
            "[[emitters]]\nbeam = { origin = [0, 0, 1], direction = [0, 0, -1], power = 1, radius = 0.1 }\n"
                .into(),
            Some(1.0),
        ),
        (
            "[[emitters]]\ndirectional = { direction = [0, 0, -1], irradiance = 1, origin = [5, 5, 3] }\n"
                .into(),
            Some(3.0),
        ),
        ("[[emitters]]\ndirectional = { direction = [0, 0, -1], irradiance = 1 }\n".into(), None),
    ];
    for (light, way) in cases {
        for integrator in BOTH {
            let text = text(integrator, 64, 2, [0.0, 0.0], &light)
                + "[[slices]]\nname = \"t\"\ntime = { start_ps = 0, bin_ps = 10, bins = 4000 }\n";
            let r = render_text(&text);
            let (all, t) = (m00(&r).0, r.mean("t"));
            let late = f64::from(r.field("t", Field::Overflow).data[0]);
            let got: f64 = match way {
                Some(way) => {
                    let bin = ((from.length() + way) / C / 10.0) as usize;
                    f64::from(t.at(&[(T, bin)]))
                }
                None => late,
            };
            assert!(
                all > 0.0 && (got / all - 1.0).abs() < 1e-4,
                "{integrator} {light}: {got} of {all} in time"
            );
        }
    }
}

/// Tests that the total is the light of the projector and the lamps. Tests that `ambient` contains only the
/// light of the lamps.
#[test]
fn ambient_light_is_the_light_of_the_lamps() {
    let camera = Device::look_at([0.0, -3.0, 2.0], DVec3::ZERO, [6, 6], 8.0);
    let projector = Device::look_at([0.5, -3.0, 2.0], DVec3::ZERO, [4, 4], 6.0);
    let lamp = "[[emitters]]\npoint = { position = [0, 0, 2], intensity = 2 }\n".to_owned()
        + &shining("sphere = { center = [1, 1, 1], radius = 0.3 }", "");
    let slices = "[[slices]]\nname = \"sum\"\n[[slices]]\nname = \"all\"\nprojector = \"all\"\n\
                  [[slices]]\nname = \"lamps\"\nprojector = \"ambient\"\n";
    for integrator in BOTH {
        let text = head(64, 4, 5)
            + &format!("integrator = \"{integrator}\"\n")
            + &camera.keys("camera")
            + &projector.keys("projector")
            + PLANE
            + &lamp
            + slices;
        let r = render_text(&text);
        let (sum, all, lamps) = (r.mean("sum"), r.mean("all"), r.mean("lamps"));
        for (i, sum) in sum.data.iter().enumerate() {
            let own: f32 = all.data[i * 16..(i + 1) * 16].iter().sum();
            assert!(
                lamps.data[i] > 0.0 && (own + lamps.data[i] - sum).abs() <= 1e-5 * sum,
                "pixel {i}, {integrator}"
            );
        }
        assert!(all.data.iter().sum::<f32>() > 0.0);
    }
}

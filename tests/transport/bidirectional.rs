//! Compares bidirectional paths with camera paths in scenes in which camera paths sample all light. Tests
//! each sampling strategy separately.

use crate::optics::{C, Device, GOLD, GOLD_KEYS, M, head, mirror, mueller, plate, project};
use crate::support::{Rendered, render_scene, scene_of};
use glam::DVec3;
use std::f64::consts::PI;
use std::panic::AssertUnwindSafe;
use sunstone::tensor::array::Tensor;
use sunstone::tensor::axes::AxisKind;
use sunstone::transport::scene::{Integrator, Scene};

/// Returns the scene-file text of a camera and a projector, each of 16 x 16 pixels, in front of a box of 2 m.
/// The slices resolve polarization, the number of bounces, time, and projector pixels.
pub fn devices(spp: u32, depth: u32, seed: u32) -> String {
    format!(
        "[render]\nspp = {spp}\nmax_depth = {depth}\nseed = {seed}\nrr_depth = 3\ntile = 16\n\
         [camera]\nresolution = [16, 16]\nfov_x_deg = 42\n\
         pose.look_at = {{ origin = [0.3, 0.4, 3.6], target = [0, 0, 0] }}\n\
         [projector]\nresolution = [16, 16]\nfov_x_deg = 38\nirradiance = [1.0, 2.0, 1.5]\n\
         pose.look_at = {{ origin = [-0.7, 0.8, 3.3], target = [0.1, -0.2, 0], up = [0.2, 1, 0.1] }}\n\
         [[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\ncamera = {{ binned = 8 }}\n\
         [[slices]]\nname = \"t\"\nbounces = true\ncamera = {{ binned = 16 }}\n\
         time = {{ start_ps = 20000, bin_ps = 2000, bins = 10 }}\n\
         [[slices]]\nname = \"p\"\nprojector = {{ binned = 8 }}\ncamera = {{ binned = 8 }}\n"
    )
}

/// Scene-file text of three walls, a floor and a ceiling, which form a box open toward the camera.
pub const WALLS: &str = "
    [[objects]]\nmaterial = \"wall\"\nshape.rectangle = { corner = [-1, -1, -1], u = [2, 0, 0], v = [0, 2, 0] }
    [[objects]]\nmaterial = \"red\"\nshape.rectangle = { corner = [-1, -1, -1], u = [0, 2, 0], v = [0, 0, 2] }
    [[objects]]\nmaterial = \"wall\"\nshape.rectangle = { corner = [1, -1, -1], u = [0, 0, 2], v = [0, 2, 0] }
    [[objects]]\nmaterial = \"floor\"\nshape.rectangle = { corner = [-1, -1, -1], u = [0, 0, 2], v = [2, 0, 0] }
    ";

pub fn with(text: &str, integrator: Integrator, strategy: Option<[u32; 2]>) -> Rendered {
    let mut scene: Scene = scene_of(text);
    // Enables manifold connections for tests that request them.
    let manifold = scene.settings.manifold && text.contains("manifold = true");
    scene.set_integrator(integrator);
    let manifold = manifold || integrator == Integrator::Caustics;
    scene.change_settings(|s| (s.manifold, s.strategy) = (manifold, strategy));
    render_scene(&scene)
}

/// Asserts that two renders agree in every element of every slice within five standard errors. At least
/// `least` elements must be significant, which means that their errors are below `share` of the largest
/// value.
pub fn assert_agree(a: &Rendered, b: &Rendered, share: f32, least: usize) {
    for slice in ["m", "t", "p"] {
        let (x, y): (Tensor, Tensor) = (a.mean(slice), b.mean(slice));
        let (dx, dy) = (a.std_error(slice), b.std_error(slice));
        let top = x.data.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
        let mut sharp = 0;
        for i in 0..x.data.len() {
            let sigma = dx.data[i].hypot(dy.data[i]);
            let diff = (x.data[i] - y.data[i]).abs();
            // Skips elements that are zero in each render, and rounding errors. The error of small elements
            // with few samples is unreliable.
            let known = |value: f32, error: f32| error < 0.05 * value.abs();
            let sampled = known(x.data[i], dx.data[i]) && known(y.data[i], dy.data[i]);
            if diff > 1e-6 * top && (sampled || diff > 3e-3 * top) {
                assert!(
                    diff < 5.0 * sigma,
                    "{slice}[{i}]: {} ± {} and {} ± {}",
                    x.data[i],
                    dx.data[i],
                    y.data[i],
                    dy.data[i]
                );
            }
            sharp += usize::from(sigma < share * top && x.data[i].abs() > 5.0 * sigma);
        }
        if slice == "m" {
            assert!(sharp >= least, "{sharp} elements of {slice} say something");
        }
    }
}

/// Compares camera paths with bidirectional paths.
fn compare(text: &str, share: f32, least: usize) {
    let path = with(text, Integrator::Path, None);
    let both = with(text, Integrator::Bidirectional, None);
    assert_agree(&path, &both, share, least);
}

pub const DIFFUSE: &str = "[materials]\nwall.diffuse.albedo = 0.7\nred.diffuse.albedo = [0.2, 0.3, 0.8]\n\
    floor.diffuse.albedo = 0.5\n";

/// Tests each sampling strategy separately. Each strategy must give the light of all paths whose number of
/// interactions the strategy samples.
#[test]
#[ignore = "slow: tools/check --all"]
fn each_strategy_alone_gives_the_light_of_its_paths() {
    let text = devices(256, 4, 2)
        + "[materials]\nwall.rough_conductor = { metal = \"Au\", alpha = 0.5 }\n\
           red.diffuse.albedo = [0.2, 0.3, 0.8]\nfloor.plastic = { albedo = 0.5, alpha = 0.4, ior = 1.5 }\n"
        + WALLS;
    let path = with(&text, Integrator::Path, None);
    let whole = path.mean("m");
    let bounces = whole.extent(AxisKind::Bounces);
    for [s, t] in [[1, 2], [2, 1], [1, 3], [2, 2], [3, 1], [1, 4], [2, 3], [3, 2], [4, 1]] {
        let alone = with(&text, Integrator::Bidirectional, Some([s, t]));
        let (mean, error) = (alone.mean("m"), alone.std_error("m"));
        let errors = path.std_error("m");
        let mut compared = 0;
        for i in 0..mean.data.len() {
            let of = i / (16 * 3) % bounces;
            let sigma = error.data[i].hypot(errors.data[i]);
            if of as u32 == s + t - 2 {
                let diff = (mean.data[i] - whole.data[i]).abs();
                assert!(diff < 5.0 * sigma + 1e-7, "{s}, {t}: {} {} ± {sigma}", mean.data[i], whole.data[i]);
                compared += usize::from(whole.data[i].abs() > 3.0 * sigma);
            } else {
                assert_eq!(mean.data[i], 0.0, "{s}, {t} makes paths of {of} interactions");
            }
        }
        assert!(compared > 10, "{s}, {t}: {compared}");
    }
}

/// Compares camera paths and bidirectional paths in a scene with metal, plastic, rough glass, polarizing
/// sheets, a smooth-shaded mesh and a point emitter.
#[test]
fn surfaces_of_all_kinds() {
    let knot = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/mirror_room/knot.glb");
    let text = devices(256, 6, 3)
        + "[[emitters]]\npoint = { position = [0.2, 0.8, 0.9], intensity = 0.3 }\n\
           [materials]\nwall.rough_conductor = { metal = \"Au\", alpha = 0.5 }\n\
           red.plastic = { albedo = [0.2, 0.3, 0.8], alpha = 0.3, ior = 1.5 }\nfloor.diffuse.albedo = 0.6\n\
           sheet.polarizer = { axis = [1, 1, 0] }\nwave.retarder = { retardance_deg = 70, axis = [1, 0, 0] }\n"
        + WALLS
        + "[[objects]]\nmaterial = \"sheet\"\nshape.rectangle = { corner = [-0.8, -0.3, 0.5], u = [0.7, 0, 0], v = [0, 0.7, 0] }\n\
           [[objects]]\nmaterial = \"wave\"\nshape.rectangle = { corner = [-0.6, -0.1, 0.6], u = [0.7, 0, 0], v = [0, 0.7, 0] }\n\
           [[objects]]\nmaterial = \"floor\"\nshape.gltf.file = \""
        + knot
        + "\"\ntransform = { scale = 0.8, translate = [0.5, 0.4, -0.3] }\n";
    compare(&text, 0.05, 40);
}

/// Compares camera paths and bidirectional paths for light that rough glass transmits, from each side. The
/// radiance includes a factor of the squared refractive index.
#[test]
fn rough_glass() {
    let text = devices(256, 4, 4)
        + DIFFUSE
        + "glass.rough_dielectric = { ior = 1.5, alpha = 0.5 }\n"
        + WALLS
        + "[[objects]]\nmaterial = \"glass\"\nshape.sphere = { center = [0.0, -0.2, 0.1], radius = 0.55 }\n\
           [[objects]]\nmaterial = \"red\"\nshape.sphere = { center = [0.0, -0.2, 0.1], radius = 0.25 }\n";
    compare(&text, 0.05, 20);
}

pub const FOG: &str =
    "[media.fog.homogeneous]\nscattering = [0.4, 0.7, 1.0]\nabsorption = [0.1, 0.05, 0.2]\n";

/// Tests that a flat mirror reflects the projector's light onto a wall that the camera sees, as if the
/// projector's mirror image emitted the light. Camera paths cannot sample the light of the mirror.
#[test]
fn mirror_reflects_light_onto_a_wall() {
    reflected_onto_a_wall(60.0, 120_000, "");
}

/// Tests the light of the mirror in a pixel that is so narrow that no light subpath hits the surface visible
/// in the pixel.
#[test]
fn mirror_reflects_light_into_a_narrow_pixel() {
    for focal_px in [60.0, 600.0, 6000.0] {
        reflected_onto_a_wall(focal_px, 500, "manifold = true\n");
    }
}

/// Compares the light that a mirror reflects onto a wall with quadrature, in one pixel of a camera with the
/// given focal length.
fn reflected_onto_a_wall(focal_px: f64, spp: u32, more: &str) {
    let lamp = Device::look_at([0.8, 0.1, 0.6], DVec3::new(0.0, 0.0, -0.3), [32, 32], 120.0);
    // Computes the projector's image behind the mirror in the plane x = 0.
    let flip = |v: DVec3| DVec3::new(-v.x, v.y, v.z);
    let image = Device {
        origin: flip(lamp.origin),
        forward: flip(lamp.forward),
        right: flip(lamp.right),
        down: flip(lamp.down),
        ..lamp.clone()
    };
    // Computes the point where the axis of the projector's image meets the wall x = 1.5.
    let point = image.origin + image.forward * ((1.5 - image.origin.x) / image.forward.x);
    let camera = Device::look_at([0.4, 1.2, 1.5], point, [1, 1], focal_px);
    let text = head(spp, 4, 3)
        + more
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!("[materials]\nwhite.diffuse.albedo = 0.5\ngold.conductor = {{ {GOLD_KEYS} }}\n")
        + &plate(DVec3::new(1.5, point.y, point.z), -DVec3::X, 1.0, "white")
        + &plate(DVec3::ZERO, DVec3::X, 0.6, "gold")
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n\
           [[slices]]\nname = \"t\"\nbounces = true\ntime = { bin_ps = 100, bins = 400 }\n";
    let r = with(&text, Integrator::Bidirectional, None);
    assert_eq!(with(&text, Integrator::Path, None).mean("m").at(&[(AxisKind::Bounces, 2)]), 0.0);
    // Over the pixel, all factors except the falloff of the light are constant within 0.1 %. Quadrature
    // integrates the falloff.
    let (mut want, n) = (M::zeros(), 40);
    for k in 0..n * n {
        let at = |i: i32| (f64::from(i) + 0.5) / f64::from(n);
        let d = camera.direction(at(k % n), at(k / n));
        let p = camera.origin + d * ((1.5 - camera.origin.x) / d.x);
        let to = (image.origin - p).normalize();
        let meets = p + to * (-p.x / to.x);
        let (travel_in, travel_out) = ((meets - lamp.origin).normalize(), -to);
        let reflected = mirror(
            travel_in,
            project(lamp.right, travel_in),
            travel_out,
            travel_out.cross(DVec3::X).normalize(),
            GOLD,
        );
        let radiance = 0.5 / PI * image.project(p).1 * to.x.abs();
        let mut wall = M::zeros();
        wall[(0, 0)] = radiance;
        want += wall * reflected / f64::from(n * n);
    }
    let (got, error) = (r.mean("m"), r.std_error("m"));
    let at = [(AxisKind::Bounces, 2)];
    let (got, error) = (mueller(&got, &at), mueller(&error, &at));
    assert!(error[(0, 0)] < 0.03 * want[(0, 0)], "{}", error[(0, 0)] / want[(0, 0)]);
    for j in 0..4 {
        let sigma = error[(0, j)].max(1e-6 * want[(0, 0)]);
        assert!((got[(0, j)] - want[(0, j)]).abs() < 5.0 * sigma, "{j}: {got} is not {want} ± {error}");
    }
    let t = r.mean("t");
    let whole: f32 = (0..400).map(|i| t.at(&[(AxisKind::T, i), at[0]])).sum();
    let time = (camera.origin.distance(point) + point.distance(image.origin)) / C / 100.0;
    let near: f32 = (0..25).map(|i| t.at(&[(AxisKind::T, time as usize + i - 12), at[0]])).sum();
    assert!(near > 0.999 * whole, "{near} of {whole} at bin {time}");
}

/// Returns the scene-file text of a box that a projector and a point light illuminate. The box contains a
/// mirror, a glass sphere, a glossy coat under glass, and a window.
pub fn redirecting(spp: u32, seed: u32) -> String {
    devices(spp, 6, seed).replace("[render]", "[render]\nmanifold = true")
        + DIFFUSE
        + "glass.dielectric = { ior = 1.5 }\npane.thin_dielectric = { ior = 1.5 }\n"
        + "mirror.conductor = { metal = \"Ag\" }\n"
        + WALLS
        + "[[objects]]\nmaterial = \"mirror\"\nshape.rectangle = { corner = [-0.95, -0.9, 0.2], u = [0.3, 0, -0.9], v = [0, 1.2, 0] }
           [[objects]]\nmaterial = \"glass\"\nshape.sphere = { center = [0.3, -0.5, 0.1], radius = 0.35 }
           [[objects]]\nmaterial = \"pane\"\nshape.rectangle = { corner = [0.2, 0.1, 0.4], u = [0.6, 0, -0.1], v = [0, 0.6, 0] }
           [[emitters]]\npoint = { position = [0.5, 0.85, 0.5], intensity = 0.3 }
           "
}

/// Tests that plain paths, plus a few samples of light redirected by mirrors and glass, sample all light of
/// bidirectional paths. Plain paths alone, or redirected light alone, are not sufficient.
#[test]
#[ignore = "slow: tools/check --all"]
fn redirected_light_and_plain_paths_add_up_to_all_light() {
    let text = redirecting(2048, 8);
    assert_eq!(scene_of(&text).settings.integrator, Integrator::Caustics);
    let parts = with(&text, Integrator::Caustics, None);
    let whole = with(&text.replace("seed = 8", "seed = 9"), Integrator::Bidirectional, None);
    assert_agree(&parts, &whole, 0.05, 20);
    // Negative control: the comparison detects the absence of light that plain paths cannot sample.
    let plain = with(&text.replace("manifold = true", ""), Integrator::Path, None);
    let seen = std::panic::catch_unwind(AssertUnwindSafe(|| assert_agree(&plain, &whole, 0.05, 20)));
    assert!(seen.is_err());
}

/// Compares camera paths and bidirectional paths for camera and projector lenses of finite aperture that are
/// out of focus.
#[test]
fn lenses() {
    let lens = |focus: f64| format!("aperture = {{ radius = 0.2, focus = {focus} }}\n");
    let sharp = devices(256, 4, 7) + DIFFUSE + WALLS;
    let text = sharp.replacen("fov_x_deg = 42\n", &("fov_x_deg = 42\n".to_owned() + &lens(3.0)), 1).replacen(
        "fov_x_deg = 38\n",
        &("fov_x_deg = 38\n".to_owned() + &lens(5.0)),
        1,
    );
    compare(&text, 0.02, 15);
    // Negative control: the lenses blur the image, so the light of each projector pixel covers more of the
    // image.
    let lit = |text: &str| {
        let text = text.replace("projector = { binned = 8 }", "projector = { block = [7, 7, 1, 1] }");
        let r =
            with(&text.replace("camera = { binned = 8 }", "camera = { binned = 1 }"), Integrator::Path, None);
        r.mean("p").data.iter().filter(|v| **v > 1e-3).count()
    };
    let (blurred, sharp) = (lit(&text), lit(&sharp));
    assert!(2 * blurred >= 3 * sharp && sharp > 3, "{blurred} {sharp}");
}

/// Tests reciprocity: the light through an object is the same if camera and projector are exchanged. With the
/// focal lengths f of the camera and f' of the projector, T(s, s') f'² = D T'(s', s)ᵀ D f². T' is the
/// transport with exchanged devices, and D = diag(1, 1, -1, 1). The test compares light subpaths with camera
/// subpaths.
#[test]
#[ignore = "slow: tools/check --all"]
fn exchanged_devices_give_the_same_light() {
    let wall = DVec3::new(0.0, 0.0, -0.6);
    let behind = Device::look_at([0.25, 0.1, 1.2], wall, [1, 1], 9.0);
    let beside = Device::look_at([1.4, -0.7, -0.1], wall, [1, 1], 3.0);
    for (material, shape) in [
        ("dielectric = { ior = 1.5 }", "cube = { min = [-1, -1, 0.1], max = [1, 1, 0.4] }"),
        ("dielectric = { ior = [1.4, 1.5, 1.6] }", "sphere = { center = [0.1, 0, 0.2], radius = 0.3 }"),
        (
            "rough_dielectric = { ior = [1.4, 1.5, 1.6], alpha = 0.2 }",
            "sphere = { center = [0.1, 0, 0.2], radius = 0.3 }",
        ),
        (
            "crystal = { name = \"calcite\", axis = [0.3, 0.5, 0.8], split = true }",
            "cube = { min = [-1, -1, 0.1], max = [1, 1, 0.4] }",
        ),
        (
            "crystal = { name = \"quartz\", axis = [0.3, 0.9, 0.1] }",
            "cube = { min = [-1, -1, 0.1], max = [1, 1, 0.11] }",
        ),
        // The crystal has a thickness of 1.5 waves, because thick crystals depolarize light that passes rough
        // faces.
        (
            "crystal = { name = \"quartz\", axis = [0.3, 0.9, 0.1], roughness = 0.2 }",
            "cube = { min = [-1, -1, 0.1], max = [1, 1, 0.1001] }",
        ),
        (
            "retarder = { retardance_deg = 70, angle_deg = 20 }",
            "rectangle = { corner = [-1, -1, 0.1], u = [2, 0.1, 0], v = [0, 2, 0.3] }",
        ),
    ] {
        let text = |camera: &Device, projector: &Device| {
            head(40_000, 6, 12).replace("[550]", "[450, 550, 660]")
                + &camera.keys("camera")
                + &projector.keys("projector")
                + &format!(
                    "[materials]\ngold.rough_conductor = {{ {GOLD_KEYS}, alpha = 0.6 }}\nx.{material}\n"
                )
                + &plate(wall, DVec3::new(0.3, -0.1, 1.0), 0.5, "gold")
                + &format!("[[objects]]\nmaterial = \"x\"\nshape.{shape}\n")
                + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n"
        };
        let there = with(&text(&beside, &behind), Integrator::Bidirectional, None);
        let back = with(&text(&behind, &beside), Integrator::Path, None);
        // The light subpath connects to the camera through the interface. The weight of the connection
        // accounts for camera subpaths.
        let mut scene = scene_of(&text(&behind, &beside));
        scene.change_settings(|s| (s.integrator, s.manifold) = (Integrator::Bidirectional, true));
        let weighed = render_scene(&scene);
        for lane in 0..3 {
            let at = [(AxisKind::Wavelength, lane)];
            let [a, da] =
                [there.mean("m"), there.std_error("m")].map(|t| mueller(&t, &at) * behind.focal.powi(2));
            let [b, db] =
                [back.mean("m"), back.std_error("m")].map(|t| mueller(&t, &at) * beside.focal.powi(2));
            let [c, dc] =
                [weighed.mean("m"), weighed.std_error("m")].map(|t| mueller(&t, &at) * beside.focal.powi(2));
            for k in 0..16 {
                let (sigma, diff) = (dc[k].hypot(db[k]), (c[k] - b[k]).abs());
                assert!(
                    diff < 5.0 * sigma + 1e-6 * b[0],
                    "{material}, lane {lane}, {k}, weighed:\n{c}is not\n{b}±\n{dc}{db}"
                );
            }
            let d = M::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, 1.0));
            let (b, db) = (d * b.transpose() * d, db.transpose());
            let sharp = da[(0, 0)].hypot(db[(0, 0)]) / b[(0, 0)];
            assert!(sharp < 0.03, "{material}: {sharp}");
            for k in 0..16 {
                let (sigma, diff) = (da[k].hypot(db[k]), (a[k] - b[k]).abs());
                assert!(
                    diff < 5.0 * sigma + 1e-6 * b[0],
                    "{material}, lane {lane}, {k}:\n{a}is not\n{b}±\n{da}{db}"
                );
            }
        }
    }
}

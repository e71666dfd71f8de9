//! Tests features that users of other programs requested in public and did not receive. Two more features
//! have separate files: [`crate::projector_sheets`] and [`crate::thin_plates`].

use crate::optics::{Device, GOLD_KEYS, assert_close, ggx_factor, head, mirror, mueller, plate, project};
use crate::support::{Rendered, render_text};
use glam::DVec3;
use nalgebra::Complex;
use std::f64::consts::PI;
use std::path::Path;
use std::process::Command;
use sunstone::render::{Target, Unwatched, render};
use sunstone::scene::materials::MaterialSet;
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::array::Tensor;
use sunstone::tensor::axes::AxisKind::{Component, StokesIn, StokesOut, U, V, Wavelength, X, Y};
use sunstone::tensor::field::Field;
use sunstone::transport::material::measured::axes::Axes;
use sunstone::transport::material::measured::write::{tabulate, write};

const MATRIX: &str = "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";

/// Returns a folder in memory if the system has one.
fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a folder")
}

/// Covers Mitsuba 3's issue 1067, "Rendering problem with measured polarized material". A sphere at the
/// origin was black under the projector if its material was a measured table. Camera and projector are 50 m
/// away and 9° to either side.
///
/// Tests that the sphere equals a sphere of the metal from which the table was made.
#[test]
fn measured_materials_under_a_projector() {
    let folder = folder();
    let path = folder.path().join("gold.pbsdf");
    let text = format!(
        "wavelengths_nm = [550]\n[materials]\ngold.rough_conductor = {{ {GOLD_KEYS}, alpha = 0.4 }}\n"
    );
    let set = MaterialSet::from_text(Path::new("m.toml"), &text).expect("a material");
    tabulate(&path, &Axes::even([37, 31, 46], vec![550]), &[(&set.materials, 0)]).expect("a table");
    let (s, c) = 9_f64.to_radians().sin_cos();
    let at = |side: f64| [50.0 * side * s, 0.0, -50.0 * c];
    let camera = Device::look_at(at(-1.0), DVec3::ZERO, [16, 16], 350.0);
    let lamp = Device::look_at(at(1.0), DVec3::ZERO, [16, 16], 350.0);
    let ball = |material: &str| {
        let text = head(64, 2, 1)
            + &camera.keys("camera")
            + &lamp.keys("projector")
            + &format!("[materials]\nskin.{material}\n")
            + "[[objects]]\nmaterial = \"skin\"\nshape.sphere = { center = [0, 0, 0], radius = 1 }\n"
            + MATRIX;
        render_text(&text).mean("m")
    };
    let table = ball(&format!("measured.file = {:?}", path.display().to_string()));
    let source = ball(&format!("rough_conductor = {{ {GOLD_KEYS}, alpha = 0.4 }}"));
    let mut lit = 0;
    for (x, y) in (0..256).map(|k| (k % 16, k / 16)) {
        let [got, want] = [&table, &source].map(|t| mueller(t, &[(Y, y), (X, x)]));
        // At the rim, the coarse table differs from its source.
        let from_centre = (x as f64 - 7.5).hypot(y as f64 - 7.5) / 7.0;
        if want[(0, 0)] > 0.0 && from_centre < 0.8 {
            assert_close(&got, &want, 0.03, &format!("pixel {x} {y}"));
            lit += 1;
        }
    }
    assert!(lit > 80, "{lit} pixels");
}

/// Environment variable with the folder of the scene that a child process of this test program renders.
#[cfg(target_os = "linux")]
const REPORTED: &str = "SUNSTONE_TEST_RENDER";

/// Runs the code of the child process that [`in_little_memory`] starts. The function itself tests nothing.
#[cfg(target_os = "linux")]
#[test]
#[ignore = "renders what another process tells it to"]
fn child_process_renders() {
    let Some(folder) = std::env::var_os(REPORTED) else {
        return;
    };
    std::env::set_current_dir(folder).expect("the folder");
    let scene = sunstone::scene::load(std::path::Path::new("scene.toml")).expect("the scene");
    let target = Target { path: "out.zarr".into(), ..Target::default() };
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let done = alone.expect("a thread").install(|| render(&scene, &target, &Unwatched));
    assert!(done.expect("a render").complete);
}

/// Renders a wall with a table of `counts` entries and 5 bands, under a projector. The render runs in a
/// process with at most `limit_kib` of memory. Every entry has the same matrix, whose BRDF is 0.1.
#[cfg(target_os = "linux")]
fn in_little_memory(counts: [usize; 3], limit_kib: u64, least_file: u64) {
    let folder = folder();
    let path = folder.path().join("t.pbsdf");
    let axes = Axes::even(counts, vec![450, 500, 550, 600, 650]);
    write(&path, &axes, |_, slab| {
        for (e, x) in slab.iter_mut().enumerate() {
            *x =
                [0.1, 0.0, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, -0.05, 0.0, 0.0, 0.0, 0.0, -0.04][e % 16];
        }
    })
    .expect("a table");
    let size = path.metadata().expect("a file").len();
    assert!(size > least_file, "{size} bytes");
    let camera = Device::look_at([0.1, 0.0, 1.0], DVec3::ZERO, [8, 8], 8.0);
    let lamp = Device::look_at([-0.3, 0.1, 1.0], DVec3::ZERO, [8, 8], 4.0);
    let text = head(16, 4, 1)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + "[materials]\nwall.measured.file = \"t.pbsdf\"\nside.diffuse.albedo = 0.7\n"
        + &plate(DVec3::ZERO, DVec3::Z, 2.0, "wall")
        + &plate(DVec3::X, -DVec3::X, 2.0, "side")
        + MATRIX;
    std::fs::write(folder.path().join("scene.toml"), text).expect("the scene");
    let limited =
        format!("ulimit -d {limit_kib} && exec \"$0\" --ignored --exact wishes::child_process_renders");
    let program = std::env::current_exe().expect("this program");
    let mut command = Command::new("sh");
    command.arg("-c").arg(limited).arg(program).env(REPORTED, folder.path());
    let out = command.output().expect("a shell");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stdout));
    let store = TensorStore::open(&folder.path().join("out.zarr")).expect("a store");
    let m = store.slice("m").expect("the slice").read_all(Field::Mean).expect("values");
    for (x, y) in (0..64).map(|k| (k % 8, k / 8)) {
        let m = mueller(&m, &[(Y, y), (X, x)]);
        assert!(m[(0, 0)] > 0.01, "pixel {x} {y}: {m}");
    }
}

/// Covers Mitsuba 3's issue 1747, "measured_polarized caused out of memory", in a scene with one wall of a
/// box. Tests that a render uses far less memory than the size of the table, because the render maps the
/// file. The table has 80 MB, and the process has 32 MB of memory.
#[cfg(target_os = "linux")]
#[test]
fn measured_tables_need_little_memory() {
    in_little_memory([91, 53, 53], 32 << 10, 80_000_000);
}

/// Covers Mitsuba 3's issue 1737, "Confusion about Stokes output (RGB vs monochrome)". Tests Stokes vectors
/// and Mueller matrices of chosen wavelengths instead of RGB, for optical constants at four wavelengths. Each
/// lane has a separate closed form. A render of a single wavelength gives the same values.
#[test]
fn every_wavelength_has_its_own_matrix() {
    let metals: [(f64, Complex<f64>); 4] = [
        (405.0, Complex::new(1.6, 1.9)),
        (532.0, Complex::new(0.5, 2.3)),
        (632.8, Complex::new(0.2, 3.4)),
        (980.0, Complex::new(0.16, 6.2)),
    ];
    let camera = Device::ray([0.9, 0.2, 1.1], DVec3::ZERO).rolled(0.3);
    let lamp = Device::look_at([-0.8, 0.1, 0.9], DVec3::ZERO, [3, 3], 20.0);
    let (d, d_in) = (camera.origin.normalize(), -lamp.origin.normalize());
    let normal = (d - d_in).normalize();
    let render = |at: &[(f64, Complex<f64>)]| {
        let list = |f: fn(&(f64, Complex<f64>)) -> f64| format!("{:?}", at.iter().map(f).collect::<Vec<_>>());
        let head = head(2, 2, 1).replace("[550]", &list(|m| m.0));
        let metal = format!("n = {}, k = {}, alpha = 0.3", list(|m| m.1.re), list(|m| m.1.im));
        let text = head
            + &camera.keys("camera")
            + &lamp.keys("projector")
            + &format!("[materials]\nm.rough_conductor = {{ {metal} }}\n")
            + &plate(DVec3::ZERO, normal, 0.5, "m")
            + MATRIX;
        render_text(&text).mean("m")
    };
    let factor = ggx_factor(normal, d, -d_in, 0.3) * lamp.project(DVec3::ZERO).1;
    let all = render(&metals);
    let axis = all.axes.iter().find(|a| a.kind == Wavelength).expect("wavelengths");
    assert_eq!(axis.coords, metals.map(|m| m.0));
    for (lane, metal) in metals.iter().enumerate() {
        let want = mirror(d_in, project(lamp.right, d_in), d, project(camera.right, d), metal.1) * factor;
        let got = mueller(&all, &[(Wavelength, lane)]);
        assert_close(&got, &want, 1e-4, &format!("{} nm", metal.0));
        let alone = mueller(&render(&metals[lane..=lane]), &[]);
        assert_close(&alone, &got, 1e-6, &format!("{} nm alone", metal.0));
    }
}

/// Renders a box with many materials, lit by a projector, with one sample per pixel.
fn menagerie(seed: u32) -> Rendered {
    let names = [
        "rough_conductor = { metal = \"Au\", alpha = 0.1 }",
        "plastic = { albedo = 0.5, ior = 1.5, alpha = 0.15 }",
        "rough_dielectric = { ior = 1.5, alpha = 0.2 }",
        "dielectric = { ior = \"N-BK7\" }",
        "conductor = { metal = \"Ag\" }",
        "coated_conductor = { metal = \"Al\", films = [{ ior = \"SiO\", thickness_nm = 120 }] }",
        "polarizer = { angle_deg = 20 }",
        "retarder = { retardance_deg = 90, angle_deg = 50 }",
        "crystal = { name = \"calcite\", axis = [0.1, 1, 0.2] }",
        "thin_dielectric = { ior = 1.5 }",
        "diffuse = { albedo = 0.8 }",
        "partial_depolarizer = { material = \"m0\", fraction = 0.4 }",
    ];
    let mut text = head(1, 8, seed).replace("[550]", "[450, 550, 650]");
    text += &Device::look_at([0.3, 0.1, 2.4], DVec3::ZERO, [24, 24], 14.0).keys("camera");
    text += &Device::look_at([-0.5, 0.3, 2.4], DVec3::ZERO, [16, 16], 8.0).keys("projector");
    text += "[materials]\nwall.diffuse.albedo = 0.8\n";
    for (i, name) in names.iter().enumerate() {
        text += &format!("m{i}.{name}\n");
    }
    for normal in [DVec3::X, DVec3::Y, DVec3::Z] {
        for side in [-1.0, 1.0] {
            // The box is deeper behind the camera.
            let at = if side * normal.z > 0.0 { 2.6 } else { 1.2 };
            text += &plate(normal * side * at, -normal * side, 3.0, "wall");
        }
    }
    for i in 0..names.len() {
        let at = [(i % 4) as f64 * 0.5 - 0.75, (i / 4) as f64 * 0.6 - 0.6, 0.3 * (i % 3) as f64];
        text += &if (6..=9).contains(&i) && i != 8 {
            plate(DVec3::from_array(at), DVec3::new(0.2, -0.1, 1.0), 0.2, &format!("m{i}"))
        } else {
            format!("[[objects]]\nmaterial = \"m{i}\"\nshape.sphere = {{ center = {at:?}, radius = 0.22 }}\n")
        };
    }
    text += "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n\
             time = { start_ps = 5000, bin_ps = 500, bins = 50 }\n\
             [[slices]]\nname = \"boxes\"\npolarization = \"mueller\"\nprojector = { binned = 4 }\n";
    render_text(&text)
}

/// Covers Mitsuba 3's issue 1650, "min(S0) < 0". Tests that no state of light, polarized or not, gives a
/// negative intensity in any pixel, time bin, projector pixel or wavelength. Over all states, the minimum of
/// M00 + M01 s1 + M02 s2 + M03 s3 is M00 - |(M01, M02, M03)|. One sample per pixel prevents averaging.
#[test]
fn no_light_is_negative() {
    let (mut lit, mut full) = (0, 0);
    for seed in 0..6 {
        let r = menagerie(seed);
        for t in [r.mean("m"), r.mean("boxes"), r.field("m", Field::Overflow)] {
            let w = t.extent(Wavelength);
            for values in t.data.chunks_exact(16 * w) {
                for lane in 0..w {
                    let at = |e: usize| f64::from(values[e * w + lane]);
                    let polarized = (1..4).map(|j| at(j).powi(2)).sum::<f64>().sqrt();
                    let leaving = (1..4).map(|i| at(4 * i).powi(2)).sum::<f64>().sqrt();
                    assert!(at(0) >= 0.0, "seed {seed}: s0 = {}", at(0));
                    assert!(at(0) - polarized >= -2e-6 * at(0), "seed {seed}: {} {polarized}", at(0));
                    assert!(at(0) - leaving >= -2e-6 * at(0), "seed {seed}: {} {leaving}", at(0));
                    lit += u32::from(at(0) > 0.0);
                    full += u32::from(polarized > 0.999 * at(0) && at(0) > 0.0);
                }
            }
        }
    }
    assert!(lit > 20_000 && full > 200, "{lit} lit, {full} of them fully polarizing");
}

/// Renders a wall with a raised plate in front of the wall. The slices separate direct and indirect light.
fn relief(camera: &Device, lamp: &Device) -> Rendered {
    let text = head(32, 3, 2)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + "[materials]\nwall.diffuse.albedo = 0.8\n"
        + &plate(DVec3::ZERO, DVec3::Z, 3.0, "wall")
        + &plate(DVec3::new(0.1, 0.0, 0.2), DVec3::new(0.2, 0.0, 1.0), 0.15, "wall")
        + &plate(DVec3::new(-0.6, 0.0, 0.0), DVec3::X, 0.8, "wall")
        + "[[slices]]\nname = \"sum\"\nsplit_first_bounce = true\n\
           [[slices]]\nname = \"u\"\nprojector = { moment = \"u\" }\nsplit_first_bounce = true\n\
           [[slices]]\nname = \"v\"\nprojector = { moment = \"v\" }\nsplit_first_bounce = true\n\
           [[slices]]\nname = \"all\"\nprojector = \"all\"\nsplit_first_bounce = true\n";
    render_text(&text)
}

/// Covers Mitsuba 2's issue 618, "How to trace the true value of rays emitted from a bitmap projector in the
/// camera". Tests that, for every camera pixel, a slice with `moment` divided by the slice with `sum` is the
/// projector pixel from which the light started. The reference is computed from the geometry. (Users compare
/// the result with a decoded structured-light scan.)
#[test]
fn moments_give_the_projector_pixel_of_each_camera_pixel() {
    let camera = Device::look_at([0.2, 0.1, 1.5], DVec3::ZERO, [40, 30], 60.0);
    let lamp = Device::look_at([-0.3, 0.0, 1.4], DVec3::ZERO, [24, 18], 20.0);
    let r = relief(&camera, &lamp);
    let [sum, all] = ["sum", "all"].map(|name| r.mean(name));
    let moments = ["u", "v"].map(|name| r.mean(name));
    let (mut single, mut shadowed) = (0, 0);
    for (x, y) in (0..1200).map(|k| (k % 40, k / 40)) {
        for component in 0..2 {
            let at = [(Y, y), (X, x), (Component, component)];
            let light = f64::from(sum.at(&at));
            for (k, t) in moments.iter().enumerate() {
                let mut total = 0.0;
                for (u, v) in (0..24 * 18).map(|p| (p % 24, p / 24)) {
                    let value = all.at(&[at[0], at[1], at[2], (V, v), (U, u)]);
                    total += f64::from(value) * [u, v][k] as f64;
                }
                assert!((f64::from(t.at(&at)) - total).abs() <= 1e-5 * light * 24.0);
            }
        }
        // For direct light on the wall or the raised plate, computes the projector positions of the pixel's
        // corners.
        let landing: Vec<Option<[u32; 2]>> =
            [(0.01, 0.01), (0.99, 0.01), (0.01, 0.99), (0.99, 0.99), (0.5, 0.5)]
                .iter()
                .map(|(dx, dy)| start(&camera, &lamp, x as f64 + dx, y as f64 + dy))
                .collect();
        let light = f64::from(sum.at(&[(Y, y), (X, x), (Component, 0)]));
        if landing.iter().all(Option::is_none) {
            shadowed += 1;
            assert_eq!(light, 0.0, "pixel {x} {y} lies in shadow");
        } else if let Some(pixel) = landing[0]
            && landing.iter().all(|l| *l == Some(pixel))
        {
            single += 1;
            for (t, want) in moments.iter().zip(pixel) {
                let mean = f64::from(t.at(&[(Y, y), (X, x), (Component, 0)])) / light;
                assert!((mean - f64::from(want)).abs() < 1e-3, "pixel {x} {y}: {mean}, not {want}");
            }
        }
    }
    assert!(single > 200 && shadowed > 20, "{single} with one origin, {shadowed} in shadow");
}

/// Returns the distance along a ray to the nearest of the three planes of wall and plate.
fn nearest(origin: DVec3, dir: DVec3) -> f64 {
    let planes = [
        (DVec3::ZERO, DVec3::Z, 3.0),
        (DVec3::new(0.1, 0.0, 0.2), DVec3::new(0.2, 0.0, 1.0), 0.15),
        (DVec3::new(-0.6, 0.0, 0.0), DVec3::X, 0.8),
    ];
    let hits = planes.into_iter().map(|(centre, normal, half)| {
        let n = normal.normalize();
        let t = (centre - origin).dot(n) / dir.dot(n);
        let p = origin + dir * t - centre;
        let u = n.any_orthonormal_vector();
        let inside = p.dot(u).abs() <= half && p.dot(n.cross(u)).abs() <= half;
        if inside && t > 1e-6 { t } else { f64::INFINITY }
    });
    hits.fold(f64::INFINITY, f64::min)
}

/// Returns the projector pixel that illuminates the point that a camera ray hits. Returns `None` in shadow or
/// outside the projector's image.
fn start(camera: &Device, lamp: &Device, px: f64, py: f64) -> Option<[u32; 2]> {
    let dir = camera.direction(px, py);
    let t = nearest(camera.origin, dir);
    let p = camera.origin + dir * t;
    let to = p - lamp.origin;
    let lit = t.is_finite() && nearest(lamp.origin, to.normalize()) > to.length() * (1.0 - 1e-9);
    let ([u, v], _) = lamp.project(p);
    let inside = (0.0..24.0).contains(&u) && (0.0..18.0).contains(&v);
    (lit && inside).then_some([u as u32, v as u32])
}

/// Tests that moments give the projector pixel if the slice resolves Mueller matrices.
#[test]
fn moments_resolve_mueller_matrices() {
    let camera = Device::ray([0.1, 0.0, 1.5], DVec3::ZERO);
    let lamp = Device::look_at([-0.3, 0.0, 1.4], DVec3::ZERO, [5, 5], 20.0);
    let text = head(4, 2, 2)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + "[materials]\nwall.diffuse.albedo = 0.8\n"
        + &plate(DVec3::ZERO, DVec3::Z, 3.0, "wall")
        + "[[slices]]\nname = \"m\"\nprojector = { moment = \"u\" }\npolarization = \"mueller\"\n";
    let m: Tensor = render_text(&text).mean("m");
    let lambert = 0.8 / PI * lamp.project(DVec3::ZERO).1 * lamp.origin.normalize().z;
    let got = f64::from(m.at(&[(StokesOut, 0), (StokesIn, 0)]));
    assert!((got / (2.0 * lambert) - 1.0).abs() < 1e-5, "{got}");
}

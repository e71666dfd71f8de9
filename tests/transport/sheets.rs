//! Tests polarizer sheets, retarder sheets and coated mirrors. The tests compare renders with closed forms.
//! Further tests check the matrices without a render.

use crate::optics::{
    Device, GOLD, GOLD_KEYS, M, assert_close, ggx_factor, head, mirror, mueller, of_image, project,
    surface_at, turn,
};
use crate::support::render_text;
use glam::{DVec3, Vec3A};
use nalgebra::{Complex, Matrix4x1};
use std::f64::consts::{PI, TAU};
use std::path::Path;
use sunstone::optics::sampling::stream::Stream;
use sunstone::polarimetry::decompose::cloude::is_realizable;
use sunstone::scene::materials::MaterialSet;
use sunstone::transport::geometry::ray::Surface;
use sunstone::transport::material::{Lanes, Lobe};

/// Returns the scene-file text of a sheet of half width 0.2 m about `centre`. The u direction of the sheet is
/// `u`, and its normal is `u × v`.
pub fn sheet(centre: DVec3, u: DVec3, v: DVec3, material: &str) -> String {
    let corner = centre - (u + v) * 0.2;
    format!(
        "[[objects]]\nmaterial = \"{material}\"\nshape.rectangle = {{ corner = {:?}, u = {:?}, v = {:?} }}\n",
        corner.to_array(),
        (u * 0.4).to_array(),
        (v * 0.4).to_array()
    )
}

/// Returns the Stokes vector of a white wall at z = 0, which the projector illuminates from the side. The
/// camera is on the z axis at z = 2 m and looks down. In the image, +x points right and +y points up.
/// `sheets` are between camera and wall.
fn column(materials: &str, sheets: &str) -> Matrix4x1<f64> {
    let lamp = Device::look_at([-0.8, 0.0, 0.3], DVec3::ZERO, [3, 3], 8.0);
    let wall = format!(
        "[materials]\nwall.diffuse.albedo = 1\n{materials}{}",
        sheet(DVec3::ZERO, DVec3::X, DVec3::Y, "wall")
    );
    let camera = Device::look_at([0.0, 0.0, 2.0], DVec3::ZERO, [1, 1], 1e7);
    let slice = "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";
    let text = head(2, 6, 1) + &camera.keys("camera") + &lamp.keys("projector") + &wall + sheets + slice;
    let radiance = lamp.project(DVec3::ZERO).1 * lamp.origin.normalize().z / PI;
    let m = mueller(&render_text(&text).mean("m"), &[]) / radiance;
    assert!(m.columns(1, 3).abs().max() < 1e-6, "a diffuse wall depolarizes");
    m.column(0).into()
}

fn level(z: f64, material: &str) -> String {
    sheet(DVec3::new(0.0, 0.0, z), DVec3::X, DVec3::Y, material)
}

fn stokes(got: Matrix4x1<f64>, want: [f64; 4], what: &str) {
    let want = Matrix4x1::from(want);
    assert!((got - want).abs().max() < 2e-6, "{what}: {got} is not {want}");
}

/// Tests Malus's law for two sheets, which transmit the fraction ½cos²θ, where θ is the angle between their
/// axes. The light is polarized along the sheet near the camera.
#[test]
fn malus_by_two_sheets() {
    for (near, far) in [(0.0_f64, 0.0_f64), (0.0, 30.0), (20.0, 65.0), (45.0, 105.0), (10.0, 100.0)] {
        let materials = format!("a.polarizer.angle_deg = {near:?}\nb.polarizer.angle_deg = {far:?}\n");
        let got = column(&materials, &(level(1.2, "a") + &level(0.9, "b")));
        let pass = 0.5 * (near - far).to_radians().cos().powi(2);
        let (sin, cos) = (2.0 * near.to_radians()).sin_cos();
        stokes(got, [pass, pass * cos, pass * sin, 0.0], &format!("{near}° on {far}°"));
    }
}

/// Tests the transmittance T and the extinction ε of polarizers. Crossed sheets transmit T²ε of unpolarized
/// light, and a single sheet transmits T(1 + ε)/2.
#[test]
fn a_polarizer_leaks() {
    let leaky = "transmittance = 0.8, extinction = 0.01 }\n";
    let materials = format!("a.polarizer = {{ {leaky}b.polarizer = {{ angle_deg = 90, {leaky}");
    let one = column(&materials, &level(1.0, "a"));
    stokes(one, [0.8 * 0.505, 0.8 * 0.495, 0.0, 0.0], "one sheet");
    let both = column(&materials, &(level(1.0, "a") + &level(0.7, "b")));
    stokes(both, [0.0064, 0.0, 0.0, 0.0], "crossed");
}

/// Tests quarter-wave and half-wave sheets over a polarizer at 0°. A quarter-wave sheet at 45° produces right
/// circular light, and at -45° left circular light. A half-wave sheet mirrors the plane of polarization. A
/// sheet's angle describes the same line in space, whether the sheet is seen from the front or from behind.
#[test]
fn retarders_have_the_pinned_signs() {
    let polarizer = "p.polarizer.angle_deg = 0\n";
    let quarter = |keys: &str| format!("{polarizer}q.retarder = {{ retardance_deg = 90, {keys} }}\n");
    let over = level(1.3, "q") + &level(1.0, "p");
    stokes(column(&quarter("angle_deg = 45"), &over), [0.5, 0.0, 0.0, 0.5], "right");
    stokes(column(&quarter("angle_deg = -45"), &over), [0.5, 0.0, 0.0, -0.5], "left");
    stokes(column(&quarter("angle_deg = 90"), &over), [0.5, 0.5, 0.0, 0.0], "along");
    // The wavelength of the scene is 550 nm.
    let nm = format!("{polarizer}q.retarder = {{ retardance_nm = 137.5, angle_deg = 45 }}\n");
    stokes(column(&nm, &over), [0.5, 0.0, 0.0, 0.5], "by nanometres");
    let world = quarter("axis = [1, 1, 0.3]");
    stokes(column(&world, &over), [0.5, 0.0, 0.0, 0.5], "by a world axis");
    let half = format!("{polarizer}q.retarder = {{ retardance_deg = 180, angle_deg = 30 }}\n");
    let (s, c) = 120_f64.to_radians().sin_cos();
    stokes(column(&half, &over), [0.5, 0.5 * c, 0.5 * s, 0.0], "half wave");
    // If the sheet is rotated by 180° about its u axis, its line is at -45° for the camera. An axis that is
    // given in world space does not change.
    let behind = sheet(DVec3::Z * 1.3, DVec3::X, -DVec3::Y, "q") + &level(1.0, "p");
    stokes(column(&quarter("angle_deg = 45"), &behind), [0.5, 0.0, 0.0, -0.5], "behind");
    stokes(column(&world, &behind), [0.5, 0.0, 0.0, 0.5], "world axis behind");
    let material = "p.polarizer.angle_deg = 45\n";
    let behind = sheet(DVec3::Z, DVec3::X, -DVec3::Y, "p");
    stokes(column(material, &behind), [0.5, 0.0, -0.5, 0.0], "polarizer behind");
}

/// Returns the matrix of a diattenuator in the frame of its axis.
pub fn diattenuator(t: f64, e: f64) -> M {
    let (a, b, c) = (t * (1.0 + e) / 2.0, t * (1.0 - e) / 2.0, t * e.sqrt());
    M::new(a, b, 0., 0., b, a, 0., 0., 0., 0., c, 0., 0., 0., 0., c)
}

pub fn retarder(delta: f64) -> M {
    let (s, c) = delta.sin_cos();
    M::new(1., 0., 0., 0., 0., 1., 0., 0., 0., 0., c, s, 0., 0., -s, c)
}

/// Tests all 16 elements of a tilted polarizer and a tilted retarder in front of rough gold, from each side.
#[test]
fn tilted_sheets_in_front_of_metal() {
    let (target, eye) = (DVec3::ZERO, DVec3::new(0.3, -0.5, 1.9));
    let camera = Device::ray(eye.to_array(), target).rolled(0.4);
    let lamp = Device::look_at([-0.9, 0.2, 0.5], target, [3, 3], 20.0).rolled(-0.3);
    let (d, d_in) = (eye.normalize(), -lamp.origin.normalize());
    let normal = (d - d_in).normalize();
    let (tilt_a, tilt_b) = (DVec3::new(0.2, 0.4, 1.0).normalize(), DVec3::new(0.5, -0.6, -0.9).normalize());
    let across = |n: DVec3| {
        let u = n.any_orthonormal_vector();
        (u, n.cross(u))
    };
    let ((ua, va), (ub, vb), (ug, vg)) = (across(tilt_a), across(tilt_b), across(normal));
    let text = head(2, 6, 2)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!(
            "[materials]\ngold.rough_conductor = {{ {GOLD_KEYS}, alpha = 0.4 }}\n\
             p.polarizer = {{ angle_deg = 25, extinction = 0.09, transmittance = 0.7 }}\n\
             r.retarder = {{ angle_deg = -50, retardance_deg = 77, tilt = \"constant\", transmittance = 0.9 }}\n"
        )
        + &sheet(d * 1.3, ua, va, "r")
        + &sheet(d * 0.8, ub, vb, "p")
        + &sheet(target, ug, vg, "gold")
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";
    let x = project(camera.right, d);
    let at = |u: DVec3, v: DVec3, deg: f64| u * deg.to_radians().cos() + v * deg.to_radians().sin();
    let fast = project(at(ua, va, -50.0), d);
    let blocked = project(tilt_b.cross(at(ub, vb, 25.0)), d);
    let pass = d.cross(blocked);
    let want = turn(d, fast, x)
        * retarder(77_f64.to_radians())
        * 0.9
        * turn(d, pass, fast)
        * diattenuator(0.7, 0.09)
        * mirror(d_in, project(lamp.right, d_in), d, pass, GOLD)
        * (ggx_factor(normal, d, -d_in, 0.4) * lamp.project(target).1);
    let got = mueller(&render_text(&text).mean("m"), &[]);
    assert_close(&got, &want, 1e-4, "two tilted sheets");
}

/// Tests all 16 elements of a silver mirror under SiO, at 60° incidence, in front of rough gold. The
/// reference is Airy's sum for films in f64.
#[test]
fn a_coated_mirror_in_front_of_metal() {
    let (n_film, d_film, silver) = (1.978, 85.0, Complex::new(0.0596, 3.5974));
    let way = DVec3::new(60_f64.to_radians().sin(), 0.0, 0.5);
    let (eye, target) = (DVec3::new(-way.x, 0.0, way.z), way * 1.3);
    let camera = Device::ray(eye.to_array(), DVec3::ZERO).rolled(0.2);
    let lamp = Device::look_at([0.9, 0.8, 1.6], target, [3, 3], 20.0);
    let (d_in, d_mid, d_out) = ((target - lamp.origin).normalize(), -way, eye);
    let normal = (d_mid - d_in).normalize();
    let (u, v) = (normal.any_orthonormal_vector(), normal.cross(normal.any_orthonormal_vector()));
    let text = head(2, 6, 3)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!(
            "[materials]\ngold.rough_conductor = {{ {GOLD_KEYS}, alpha = 0.4 }}\n\
             m.coated_conductor = {{ n = 0.0596, k = 3.5974, films = [{{ ior = {n_film}, thickness_nm = {d_film} }}] }}\n"
        )
        + &sheet(DVec3::ZERO, DVec3::X, DVec3::Y, "m")
        + &sheet(target, u, v, "gold")
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n";
    // The ratio of the tangential fields is computed layer by layer. The ratio is proportional to q for s and
    // to q/n² for p.
    let sin2 = Complex::new(0.75, 0.0);
    let root = |n: Complex<f64>| (n * n - sin2).sqrt();
    let film = Complex::new(n_film, 0.0);
    let (q0, q1, q2) = (Complex::new(0.5, 0.0), root(film), root(silver));
    let phase = (Complex::<f64>::i() * q1 * (2.0 * TAU * d_film / 550.0)).exp();
    let airy = |y0: Complex<f64>, y1: Complex<f64>, y2: Complex<f64>| {
        let (a, b) = ((y0 - y1) / (y0 + y1), (y1 - y2) / (y1 + y2) * phase);
        (a + b) / (Complex::new(1.0, 0.0) + a * b)
    };
    let r_s = airy(q0, q1, q2);
    let r_p = airy(q0, q1 / (film * film), q2 / (silver * silver));
    let cross = r_s.conj() * r_p;
    let (a, b) = ((r_s.norm_sqr() + r_p.norm_sqr()) / 2.0, (r_s.norm_sqr() - r_p.norm_sqr()) / 2.0);
    let (c, s) = (cross.re, cross.im);
    let reflection = M::new(a, b, 0., 0., b, a, 0., 0., 0., 0., c, s, 0., 0., -s, c);
    let y = DVec3::Y;
    let want = turn(d_out, y, project(camera.right, d_out))
        * reflection
        * mirror(d_in, project(lamp.right, d_in), d_mid, y, GOLD)
        * (ggx_factor(normal, d_mid, -d_in, 0.4) * lamp.project(target).1);
    let r = render_text(&text);
    let at = [(sunstone::tensor::axes::AxisKind::Bounces, 2)];
    assert_close(&mueller(&r.mean("m"), &at), &want, 1e-4, "silver under SiO");
}

fn materials(text: &str) -> MaterialSet {
    let text = format!("wavelengths_nm = [450, 550, 633, 660]\n[materials]\n{text}");
    MaterialSet::from_text(Path::new("m.toml"), &text).unwrap_or_else(|e| panic!("{e}"))
}

fn surface() -> Surface {
    let n = Vec3A::new(0.48, -0.6, 0.64);
    surface_at(n, Vec3A::new(0.9, 0.2, -0.1), [0.0; 2])
}

fn direction(stream: &mut Stream) -> Vec3A {
    let [u, v] = stream.uniform2();
    let (z, phi) = (2.0 * f64::from(u) - 1.0, TAU * f64::from(v));
    let s = (1.0 - z * z).sqrt();
    DVec3::new(s * phi.cos(), s * phi.sin(), z).as_vec3a()
}

/// Tests sheets for any direction, sheet and wavelength:
/// - Light passes straight through the sheet.
/// - The matrix is realizable and transmits at most the incident light.
/// - The matrix of the reversed ray is Δ Mᵀ Δ with Δ = diag(1, 1, -1, 1), because the sign of s2 changes with
///   the direction of view.
#[test]
fn sheets_are_realizable_and_reciprocal() {
    let set = materials(
        "a.polarizer = { angle_deg = 33, transmittance = [1, 0.9, 0.8, 0.7], extinction = [0, 1e-4, 0.1, 1] }\n\
         b.polarizer.axis = [0.3, 1, 0.2]\n\
         c.retarder = { retardance_deg = [90, 180, 45, 1000], angle_deg = 12 }\n\
         d.retarder = { retardance_nm = 150, axis = [1, 0, 0], tilt = \"constant\" }\n\
         e.retarder = { retardance_deg = 77, angle_deg = -80, tilt = \"cosine\", transmittance = 0.9 }\n",
    );
    let delta = M::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, 1.0));
    let at = surface();
    let mut stream = Stream::new(7, 0, 0);
    let mut strongest = 0.0_f64;
    for case in 0..1000 {
        let wo = direction(&mut stream);
        if at.ng.dot(wo).abs() < 0.02 {
            continue;
        }
        let id = case % 5;
        // Selects an axis perpendicular to the ray, which is the same from each side.
        let x = sunstone::optics::polarization::frame::perpendicular(wo);
        let lobe = |wo: Vec3A| {
            let sampled = set
                .materials
                .sample(id, &at, wo, &mut Lanes::first(4), &mut stream.clone())
                .expect("sheets always pass");
            let s = set.materials.specular(id, &at, wo, Lobe::Transmitted, 0).expect("a lobe");
            assert!(set.materials.specular(id, &at, wo, Lobe::Reflected, 0).is_none());
            assert!(sampled.delta && sampled.wi == -wo && s.wi == -wo && s.filling.is_none());
            let m = s.scatter.between(wo, x, -wo, x);
            assert_eq!(m, sampled.scatter.between(wo, x, -wo, x), "one lobe has probability 1");
            m
        };
        let (forth, back) = (lobe(wo), lobe(-wo));
        for lane in 0..4 {
            let f = forth.lane(lane).map(|row| row.map(f64::from));
            assert!(is_realizable(&f, 1e-6), "material {id}, lane {lane}: {f:?}");
            let polarized = (1..4).map(|j| f[0][j].powi(2)).sum::<f64>().sqrt();
            assert!(f[0][0] + polarized <= 1.0 + 1e-6, "material {id} makes light");
            let f = M::from_fn(|i, j| f[i][j]);
            let b = back.lane(lane);
            let b = M::from_fn(|i, j| f64::from(b[i][j]));
            let want = delta * f.transpose() * delta;
            let off = (b - want).abs().max();
            assert!(off < 3e-6, "material {id}, lane {lane}, {wo}: off by {off}");
            strongest = strongest.max((b - f.transpose()).abs().max());
        }
    }
    assert!(strongest > 0.1, "no case in which the sign flip matters");
}

/// Compares the retardance of a tilted wave plate with the exact phases of the two plane waves in a uniaxial
/// plate of tiny birefringence. Each wave obeys Snell's law with its own normal component of the wave vector.
#[test]
fn a_tilted_plate_has_the_exact_retardance() {
    let (n_o, n_e) = (1.55 - 5e-5, 1.55 + 5e-5);
    let at = surface();
    let set = materials("plate.retarder = { retardance_deg = 50, angle_deg = 20 }\n");
    let frame = at.tangent_frame();
    let (s, c) = 20_f32.to_radians().sin_cos();
    let optic = (frame.y_axis * c - frame.x_axis * s).as_dvec3();
    let mut stream = Stream::new(8, 0, 0);
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    for _ in 0..300 {
        let wo = direction(&mut stream);
        let n = at.ns.as_dvec3();
        let tangential = wo.as_dvec3() - n * n.dot(wo.as_dvec3());
        let (sin2, a) = (tangential.length_squared(), tangential.dot(optic));
        let b2 = sin2 - a * a;
        let q_o = f64::sqrt(n_o * n_o - sin2);
        let q_e = n_e * (1.0 - b2 / (n_e * n_e) - a * a / (n_o * n_o)).sqrt();
        let want = 50_f64.to_radians() * (q_e - q_o) / (n_e - n_o);
        let m = set.materials.specular(0, &at, wo, Lobe::Transmitted, 0).expect("a lobe").scatter;
        let sunstone::optics::polarization::scatter::Scatter::Fresnel { block, s } = m else {
            panic!("a retarder has block form");
        };
        let got = f64::from(block.d.to_array()[1]).atan2(f64::from(block.c.to_array()[1]));
        assert!((got - want).abs() < 2e-4, "{wo}: {got} is not {want}");
        assert!(s.dot(wo).abs() < 1e-6 && (s.length() - 1.0).abs() < 1e-5);
        (least, most) = (least.min(want), most.max(want));
    }
    let d0 = 50_f64.to_radians();
    assert!(least < 0.8 * d0 && most > 1.2 * d0, "{least} to {most}");
    // In the principal planes, the axes are those of the sheet.
    for angle in [0.0_f32, 0.4, 1.2] {
        for axis in [optic.as_vec3a(), at.ns.cross(optic.as_vec3a())] {
            let wo = at.ns * angle.cos() + axis * angle.sin();
            let s = set.materials.specular(0, &at, wo, Lobe::Transmitted, 0).expect("a lobe").scatter;
            let fast = at.ns.cross(optic.as_vec3a());
            let slow = project(optic, wo.as_dvec3()).as_vec3a();
            let fast = project(fast.as_dvec3(), wo.as_dvec3()).as_vec3a();
            let along = s.between(wo, fast, -wo, fast).lane(0);
            let d = along[2][3];
            assert!(d > 0.1 && along[1][1] > 0.999_99 && slow.dot(fast).abs() < 1e-6, "{angle}: {along:?}");
        }
    }
}

/// Tests that the program reports errors in the keys of sheets with location and fix.
#[test]
fn errors_have_position_and_fix() {
    for (text, words) in [
        ("a.polarizer = { angle_deg = 3, axis = [1, 0, 0] }", "both by angle_deg and by axis"),
        ("a.polarizer = { extinction = 1.5 }", "extinction is 1.5"),
        ("a.polarizer = { axis = [0, 0, 0] }", "no direction"),
        ("a.retarder = { angle_deg = 3 }", "exactly one of retardance_deg"),
        ("a.retarder = { retardance_deg = 1, retardance_nm = 1 }", "exactly one of retardance_deg"),
        ("a.retarder = { retardance_deg = [1, 2] }", "2 values for 4 wavelengths"),
        ("a.retarder = { retardance_deg = 1, tilt = \"constant\", ior = 1.5 }", "plate"),
        ("a.retarder = { retardance_deg = 1, tilt = \"wobbly\" }", "unknown name `wobbly`"),
        ("a.crystal = { name = \"kryptonite\", axis = [1, 0, 0] }", "calcite, quartz, sapphire"),
        ("a.crystal = { n_o = 1.5, axis = [1, 0, 0] }", "both n_o and n_e"),
        (
            "a.crystal = { name = \"quartz\", axis = [1, 0, 0], split = true, bandwidth_nm = 1 }",
            "bandwidth_nm has no effect",
        ),
        ("a.crystal = { name = \"quartz\" }", "missing key `axis`"),
        (
            "a.crystal = { name = \"quartz\", axis = [1, 0, 0], split = true, roughness = 0.1 }",
            "requires smooth faces",
        ),
        (
            "a.crystal = { name = \"quartz\", axis = [1, 0, 0], roughness = 0 }",
            "remove roughness for smooth faces",
        ),
        (
            "a.coated_conductor = { metal = \"Al\", films = [{ ior = \"SiO\", k = 1, thickness_nm = 9 }] }",
            "already contain k",
        ),
        (
            "a.coated_conductor = { metal = \"Al\", films = [{ ior = 2, thickness_nm = -9 }] }",
            "thickness_nm is -9",
        ),
        ("a.conductor = { metal = \"unobtainium\" }", "known names: Au, Ag"),
        ("a.dielectric = { ior = \"Au\" }", "not transparent"),
    ] {
        let text = format!("wavelengths_nm = [450, 550, 633, 660]\n[materials]\n{text}\n");
        let Err(error) = MaterialSet::from_text(Path::new("m.toml"), &text) else {
            panic!("{text} is accepted");
        };
        let shown = error.to_string();
        assert!(
            shown.contains(words) && shown.starts_with("m.toml:3:") && shown.contains("fix:"),
            "{text}: {shown}"
        );
    }
    let out = "wavelengths_nm = [200]\n[materials]\na.dielectric.ior = \"N-BK7\"\n";
    let Err(error) = MaterialSet::from_text(Path::new("m.toml"), out) else {
        panic!("200 nm is accepted");
    };
    assert!(error.to_string().contains("cover only 380 to 1000 nm"), "{error}");
}

/// Tests that names of optical constants give the same materials as the values of the constants.
#[test]
fn named_constants_equal_their_values() {
    let set = materials(
        "gold.conductor.metal = \"gold\"\n\
         glass.dielectric.ior = \"BK7\"\n\
         mirror.coated_conductor = { metal = \"Al\", films = [{ ior = \"SiO\", thickness_nm = 120 }] }\n",
    );
    let list = |name: &str| &set.materials.list[set.names[name] as usize];
    use sunstone::transport::material::Material::{CoatedConductor, Conductor, Dielectric};
    let (Conductor(gold), Dielectric(glass), CoatedConductor(mirror)) =
        (list("gold"), list("glass"), list("mirror"))
    else {
        panic!("the materials are of other kinds");
    };
    assert!((gold.n.to_array()[1] - 0.42415).abs() < 1e-5 && (gold.k.to_array()[3] - 3.7015).abs() < 1e-4);
    assert!((glass.interior.to_array()[0] - 1.52532).abs() < 1e-5 && glass.dispersive);
    assert!(mirror.count == 1 && (mirror.films[0].waves.to_array()[1] - 120.0 / 550.0).abs() < 1e-6);
    assert!((mirror.films[0].k.to_array()[0] - 0.063).abs() < 2e-3, "SiO absorbs in the blue");
}

/// Tests a surface that is partly a sheet and partly another material. The brightness of the surface is the
/// fraction of the second part, times the brightness of a surface of the second material.
///
/// The light is a point, the projector or an emitting disk. The test uses each integrator, with and without
/// the tracking of media that a null material requires.
#[test]
fn partial_sheets_are_as_bright_as_their_other_part() {
    let matter = "d.diffuse.albedo = 0.8\nblack.diffuse.albedo = 0\nhole.null = {}\npol.polarizer = { angle_deg = 0 }\n\
                  wave.retarder = { retardance_deg = 90 }\nthin.thin_dielectric = { ior = 1.5 }\n";
    let camera = Device::look_at([0.0, 0.0, 4.0], DVec3::ZERO, [2, 2], 20.0);
    let projector = Device::look_at([0.3, 0.0, 4.0], DVec3::ZERO, [2, 2], 4.0);
    let scene = |part: &str, integrator: &str| {
        head(3000, 5, 9)
            + &format!("integrator = \"{integrator}\"\nmanifold = false\n")
            + &camera.keys("camera")
            + &projector.keys("projector")
            + &format!("[materials]\n{matter}m.blend = {{ a = \"{part}\", b = \"d\", weight = 0.6 }}\n")
            + "[[objects]]\nmaterial = \"m\"\nshape.rectangle = {}\n\
               [[objects]]\nmaterial = \"black\"\nshape.disk = { center = [0, 1, 1], normal = [0, -1, -1], radius = 0.3 }\n\
               emission.radiance = 2\n\
               [[objects]]\nmaterial = \"black\"\nshape.sphere.radius = 30\n\
               [[emitters]]\npoint = { position = [0, 0, 2], intensity = 4 }\n\
               [[slices]]\nname = \"m\"\n"
    };
    let total = |part: &str, integrator: &str| of_image(&render_text(&scene(part, integrator)), "m", 1);
    let (want, spread) = total("black", "path");
    for part in ["hole", "pol", "wave", "thin"] {
        for integrator in ["path", "bidirectional"] {
            let (got, error) = total(part, integrator);
            let sigma = error.hypot(spread);
            assert!(
                (got - want).abs() <= 5.0 * sigma && sigma < 0.01 * want,
                "{part}, {integrator}: {got}, without it {want} ± {sigma:.1e}"
            );
        }
    }
}

//! Tests that slabs of uniaxial crystals act as wave plates between Fresnel faces, in all 16 elements.

use crate::optics::{
    Device, GOLD, GOLD_KEYS, M, assert_close, ggx_factor, head, mirror, mueller, plate, project, surface_at,
    turn,
};
use crate::sheets::{retarder, sheet};
use crate::support::{Rendered, render_text};
use glam::{DVec3, Vec3A};
use std::f64::consts::TAU;
use std::path::Path;
use sunstone::optics::sampling::stream::Stream;
use sunstone::polarimetry::decompose::cloude::is_realizable;
use sunstone::scene::materials::MaterialSet;
use sunstone::tensor::axes::AxisKind::{Bounces, Wavelength};
use sunstone::transport::material::constants::lookup;
use sunstone::transport::material::{Filling, Lanes, Lobe};

/// Refractive indices n_o and n_e of quartz at 550 nm (Ghosh 1999).
pub const QUARTZ: [f64; 2] = [1.54595, 1.55511];

/// Returns the matrix of the Fresnel transmission of power, in the s-frame. `eta` is the index relative to
/// the index on the incident side.
fn transmission(cos_i: f64, eta: f64) -> M {
    let cos_t = (1.0 - (1.0 - cos_i * cos_i) / (eta * eta)).sqrt();
    let (ts, tp) = (2.0 * cos_i / (cos_i + eta * cos_t), 2.0 * cos_i / (eta * cos_i + cos_t));
    let f = eta * cos_t / cos_i;
    let (a, b, c) = (f * (ts * ts + tp * tp) / 2.0, f * (ts * ts - tp * tp) / 2.0, f * ts * tp);
    M::new(a, b, 0., 0., b, a, 0., 0., 0., 0., c, 0., 0., 0., 0., c)
}

/// Returns the matrix and the frame (k × c) of a retarder of `length` along `k`, in a crystal with optic axis
/// `c`.
pub fn way(k: DVec3, c: DVec3, length: f64, [n_o, n_e]: [f64; 2], nm: f64) -> (M, DVec3) {
    let cos2 = k.dot(c).powi(2);
    let n = 1.0 / (cos2 / (n_o * n_o) + (1.0 - cos2) / (n_e * n_e)).sqrt();
    let frame = k.cross(c).normalize_or(k.any_orthonormal_vector());
    (retarder(TAU * length * (n - n_o) / (nm * 1e-9)), frame)
}

/// Point of entry on the slab's upper face. The point is far from the origin. The offset of rays from a
/// surface grows with the coordinates, and would exceed a wavelength at the point of entry.
const AT: DVec3 = DVec3::new(0.5, -0.25, THICK);

/// Returns the scene-file text of a slab perpendicular to z, from z = 0 to `top`.
fn slab(top: f64) -> String {
    format!(
        "[[objects]]\nmaterial = \"crystal\"\nshape.cube = {{ min = [0.25, -0.5, 0.0], max = [0.75, 0.03, {top:?}] }}\n"
    )
}

/// Thickness of the slab, about 1 mm or 16 waves of quartz. The thickness is a power of two, which f32
/// represents exactly.
const THICK: f64 = 1.0 / 1024.0;

/// A scene with a camera above a slab. Below the slab is rough gold that is lit from the side.
pub struct Slab {
    camera: Device,
    lamp: Device,
    /// Direction of the light that leaves to the camera, and the direction of the same light inside the slab.
    d: DVec3,
    inside: DVec3,
    target: DVec3,
}

impl Slab {
    /// Returns a slab of mean index `mean` that the camera sees along -`d`.
    pub fn new(d: DVec3, mean: f64) -> Self {
        let tangential = DVec3::new(d.x, d.y, 0.0) / mean;
        let inside = tangential + DVec3::Z * (1.0 - tangential.length_squared()).sqrt();
        let target = AT - inside * (THICK / inside.z) - d * 0.5;
        let lamp = (target + DVec3::new(0.8, 0.3, 0.2)).to_array();
        Self {
            camera: Device::ray((AT + d * 1.5).to_array(), AT).rolled(0.4),
            lamp: Device::look_at(lamp, target, [3, 3], 20.0).rolled(-0.3),
            d,
            inside,
            target,
        }
    }

    fn normal(&self) -> DVec3 {
        (self.d + (self.lamp.origin - self.target).normalize()).normalize()
    }

    /// Renders the slab with the optic axis `axis`. `wavelengths` is a list in scene-file syntax.
    pub fn render(&self, axis: DVec3, keys: &str, wavelengths: &str) -> Rendered {
        let (n, u) = (self.normal(), self.normal().any_orthonormal_vector());
        // The target is not on the diagonal of the gold plate, where rays could pass between two triangles.
        let centre = self.target + u * 0.01 + n.cross(u) * 0.03;
        let text = head(4000, 5, 21).replace("[550]", wavelengths)
            + &self.camera.keys("camera")
            + &self.lamp.keys("projector")
            + &format!(
                "[materials]\ngold.rough_conductor = {{ {GOLD_KEYS}, alpha = 0.4 }}\n\
                 crystal.crystal = {{ {keys}, axis = {:?} }}\n",
                axis.to_array()
            )
            + &slab(THICK)
            + &plate(centre, n, 0.1, "gold")
            + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n";
        render_text(&text)
    }

    /// Returns the expected light without inner reflections.
    pub fn expected(&self, axis: DVec3, [n_o, n_e]: [f64; 2], nm: f64) -> M {
        let (d, inside, mean) = (self.d, self.inside, f64::midpoint(n_o, n_e));
        let d_in = (self.target - self.lamp.origin).normalize();
        let x = project(self.camera.right, d);
        let s = if d.z > 1.0 - 1e-9 { DVec3::Y } else { DVec3::Z.cross(d).normalize() };
        let (retardance, frame) = way(inside, axis, THICK / inside.z, [n_o, n_e], nm);
        turn(d, s, x)
            * transmission(inside.z, 1.0 / mean)
            * turn(inside, frame, s)
            * retardance
            * turn(inside, s, frame)
            * transmission(d.z, mean)
            * mirror(d_in, project(self.lamp.right, d_in), d, s, GOLD)
            * (ggx_factor(self.normal(), d, -d_in, 0.4) * self.lamp.project(self.target).1)
    }
}

/// Checks a slab. Every sample without inner reflections has the same matrix up to a factor. The normalized
/// matrix is therefore exact, and the factor has a statistical error.
fn check(d: DVec3, axis: DVec3, n: [f64; 2], tolerance: f64, what: &str) {
    let slab = Slab::new(d, f64::midpoint(n[0], n[1]));
    let keys = format!("n_o = {:?}, n_e = {:?}", n[0], n[1]);
    let r = slab.render(axis, &keys, "[550]");
    let (got, want) = (mueller(&r.mean("m"), &[(Bounces, 3)]), slab.expected(axis, n, 550.0));
    let sigma = f64::from(r.std_error("m").at(&[(Bounces, 3)]));
    let (g, w) = (got[(0, 0)], want[(0, 0)]);
    assert!((g - w).abs() < 5.0 * sigma + 1e-4 * w && sigma < 0.02 * w, "{what}: {g} is not {w} ± {sigma}");
    assert_close(&(got / g), &(want / w), tolerance, what);
}

/// Tests that, at normal incidence, a slab with its axis in the face at 45° is a wave plate of 16.3 waves.
#[test]
fn a_quartz_slab_is_a_wave_plate() {
    let axis = DVec3::new(1.0, 1.0, 0.0).normalize();
    let turns = THICK * (QUARTZ[1] - QUARTZ[0]) / 550e-9;
    assert!(turns > 16.0 && (turns.fract() - 0.25).abs() < 0.2, "{turns} turns");
    check(DVec3::Z, axis, QUARTZ, 3e-4, "quartz");
    // Tests negative crystals, and optic axes at other angles to the face.
    let axis = DVec3::new(0.6, -0.2, 0.5).normalize();
    check(DVec3::Z, axis, [1.66127, 1.4875], 2e-3, "calcite");
}

/// Tests a crystal that is given by name. The direction and the retardance must differ between the three
/// wavelengths.
#[test]
fn every_wavelength_has_its_own_retardance() {
    let axis = DVec3::new(0.3, 1.0, 0.0).normalize();
    let slab = Slab::new(DVec3::Z, 1.5);
    let mean = slab.render(axis, "name = \"Quartz\"", "[450, 550, 660]").mean("m");
    let mut phases = vec![];
    for (lane, nm) in [450.0, 550.0, 660.0].into_iter().enumerate() {
        let n = ["quartz_o", "quartz_e"].map(|name| lookup(name, nm).expect("quartz").0);
        let (got, want) = (mueller(&mean, &[(Bounces, 3), (Wavelength, lane)]), slab.expected(axis, n, nm));
        assert_close(&(got / got[(0, 0)]), &(want / want[(0, 0)]), 1e-3, &format!("{nm} nm"));
        phases.push(want[(2, 1)] / want[(0, 0)]);
    }
    assert!(
        phases.windows(2).all(|p| (p[0] - p[1]).abs() > 0.1),
        "{phases:?} are too similar to distinguish"
    );
}

/// Tests the matrices of oblique rays in crystals with arbitrary optic axes.
#[test]
fn oblique_rays_and_axes() {
    for (d, axis) in [
        (DVec3::new(0.4, -0.3, 0.9), DVec3::new(1.0, 1.0, 0.0)),
        (DVec3::new(-0.6, 0.1, 0.8), DVec3::new(0.3, -0.4, 0.7)),
    ] {
        let what = format!("{d} {axis}");
        check(d.normalize(), axis.normalize(), QUARTZ, 1e-3, &what);
    }
}

/// Tests that a crystal acts as glass along the optic axis.
#[test]
fn no_retardance_along_the_axis() {
    check(DVec3::Z, DVec3::Z, QUARTZ, 1e-5, "along the axis");
    let slab = Slab::new(DVec3::Z, 1.55);
    let [glass, plate] = [DVec3::Z, DVec3::X].map(|axis| slab.expected(axis, QUARTZ, 550.0));
    assert!((glass - plate).abs().max() > 0.1 * glass[(0, 0)], "the test cannot tell");
}

/// Tests two inner reflections. The light crosses the slab three times, and each crossing is a different
/// retarder.
#[test]
fn inner_reflections_cross_again() {
    let (n_o, n_e) = (2.99991, 3.00009);
    let axis = DVec3::new(0.5, 1.0, 0.0).normalize();
    let (top, target) = (AT, AT - DVec3::Z * (THICK + 0.5));
    let camera = Device::ray((AT + DVec3::Z * 1.5).to_array(), top).rolled(0.4);
    let lamp =
        Device::look_at((target + DVec3::new(0.8, 0.3, 0.2)).to_array(), target, [3, 3], 20.0).rolled(-0.3);
    let d_in = (target - lamp.origin).normalize();
    let normal = (DVec3::Z - d_in).normalize();
    let text = head(4000, 7, 22)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!(
            "[materials]\ngold.rough_conductor = {{ {GOLD_KEYS}, alpha = 0.4 }}\n\
             crystal.crystal = {{ n_o = {n_o}, n_e = {n_e}, axis = {:?} }}\n",
            axis.to_array()
        )
        + &slab(THICK)
        + &plate(target, normal, 0.002, "gold")
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n";
    let (up, down) = (DVec3::Z, -DVec3::Z);
    let ((rise, f), (fall, _)) =
        (way(up, axis, THICK, [n_o, n_e], 550.0), way(down, axis, THICK, [n_o, n_e], 550.0));
    let face = M::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, -1.0));
    let want = turn(up, f, project(camera.right, up))
        * rise
        * face
        * fall
        * face
        * rise
        * mirror(d_in, project(lamp.right, d_in), up, f, GOLD);
    let got = mueller(&render_text(&text).mean("m"), &[(Bounces, 5)]);
    assert_close(&(got / got[(0, 0)]), &(want / want[(0, 0)]), 1e-3, "three ways");
}

/// Tests a crystal that contains rough gold and a projector. The crystal must also retard the light of the
/// connection to the projector.
#[test]
fn connections_inside_a_crystal() {
    let (n_o, n_e) = (1.5, 1.500_001);
    let axis = DVec3::new(0.7, 0.2, 0.5).normalize();
    let (face, target) = (DVec3::new(0.0, 0.0, 0.5), DVec3::ZERO);
    let camera = Device::ray([0.0, 0.0, 1.5], target).rolled(0.4);
    let lamp = Device::look_at([0.3, 0.1, 0.25], target, [3, 3], 20.0).rolled(-0.3);
    let d_in = (target - lamp.origin).normalize();
    let normal = (DVec3::Z - d_in).normalize();
    let u = normal.any_orthonormal_vector();
    let text = head(4000, 3, 23)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!(
            "[materials]\ngold.rough_conductor = {{ {GOLD_KEYS}, alpha = 0.4 }}\n\
             crystal.crystal = {{ n_o = {n_o}, n_e = {n_e}, axis = {:?} }}\n",
            axis.to_array()
        )
        + &sheet(face, DVec3::X, DVec3::Y, "crystal")
        + &plate(target + u * 0.01 + normal.cross(u) * 0.03, normal, 0.1, "gold")
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n";
    let (out, f) = way(DVec3::Z, axis, 0.5, [n_o, n_e], 550.0);
    let (inn, g) = way(d_in, axis, lamp.origin.length(), [n_o, n_e], 550.0);
    let want = turn(DVec3::Z, f, project(camera.right, DVec3::Z))
        * out
        * mirror(d_in, g, DVec3::Z, f, GOLD)
        * inn
        * turn(d_in, project(lamp.right, d_in), g);
    let got = mueller(&render_text(&text).mean("m"), &[(Bounces, 2)]);
    assert_close(&(got / got[(0, 0)]), &(want / want[(0, 0)]), 1e-3, "from inside");
}

fn crystals(text: &str) -> MaterialSet {
    let text = format!("wavelengths_nm = [450, 550, 633, 660]\n[materials]\n{text}");
    MaterialSet::from_text(Path::new("m.toml"), &text).unwrap_or_else(|e| panic!("{e}"))
}

fn inside_of(set: &MaterialSet, name: &str) -> Filling {
    Filling { index: 1.5, crystal: set.names[name] }
}

/// Tests that the matrices of paths in a crystal are realizable and lossless. Tests that opposite directions
/// have the same eigenpolarizations: M(-k) = Δ M(k)ᵀ Δ.
#[test]
fn paths_are_realizable_and_reciprocal() {
    let set = crystals(
        "a.crystal = { name = \"quartz\", axis = [1, 2, 2], bandwidth_nm = 3 }\n\
         b.crystal = { name = \"calcite\", axis = [0, 0, -1] }\n",
    );
    let delta = M::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, 1.0));
    let mut stream = Stream::new(9, 0, 0);
    for case in 0..500 {
        let [u, v] = stream.uniform2();
        let z = 2.0 * u - 1.0;
        let (sin, cos) = (v * TAU as f32).sin_cos();
        let k = (Vec3A::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + Vec3A::Z * z).normalize();
        let filling = inside_of(&set, ["a", "b"][case % 2]);
        let length = 1e-3 * f64::from(stream.uniform());
        let x = sunstone::optics::polarization::frame::perpendicular(k);
        let matrix = |k: Vec3A| {
            let s = set.materials.propagate(filling, k, length).expect("a crystal");
            s.between(k, x, -k, x)
        };
        let (forth, back) = (matrix(k), matrix(-k));
        for lane in 0..4 {
            let f = forth.lane(lane).map(|row| row.map(f64::from));
            assert!(is_realizable(&f, 1e-6) && f[0] == [1.0, 0.0, 0.0, 0.0], "{f:?}");
            let b = back.lane(lane);
            let b = M::from_fn(|i, j| f64::from(b[i][j]));
            let want = delta * M::from_fn(|i, j| f[i][j]).transpose() * delta;
            assert!((b - want).abs().max() < 1e-5, "{k}: {b} is not {want}");
        }
    }
    let clear = Filling::clear(1.5);
    assert!(set.materials.propagate(clear, Vec3A::Z, 1.0).is_none());
}

/// Tests that, for a broad spectral line, the matrix is the mean of the plate's matrices over a Gaussian
/// spectrum. The mean is computed by quadrature at constant n_e - n_o.
#[test]
fn a_broad_line_is_depolarized_by_a_thick_plate() {
    const FWHM: f64 = 2.0;
    let set = crystals(&format!(
        "a.crystal = {{ n_o = 1.54, n_e = 1.55, axis = [1, 0, 0], bandwidth_nm = {FWHM} }}\n"
    ));
    let sigma = FWHM / (8.0 * 2_f64.ln()).sqrt();
    for length in [0.0, 1e-4, 2e-3, 6e-3, 0.012, 0.1] {
        let s = set.materials.propagate(inside_of(&set, "a"), Vec3A::Z, length).expect("a crystal");
        // The fast axis is along y = k × c.
        let m = s.between(Vec3A::Z, Vec3A::Y, -Vec3A::Z, Vec3A::Y).lane(1);
        let (mut want, mut weight) = ([0.0; 2], 0.0);
        for i in -4000..=4000 {
            let x = f64::from(i) / 4000.0 * 6.0;
            let (w, nm) = ((-x * x / 2.0).exp(), 550.0 + sigma * x);
            let delta = TAU * length * 0.01 / (nm * 1e-9);
            want = [want[0] + w * delta.cos(), want[1] + w * delta.sin()];
            weight += w;
        }
        // The model assumes that δ is linear in λ. The tolerance grows with the curvature of δ across the
        // line.
        let tolerance = 1e-5 + 0.5 * (TAU * length * 0.01 / 550e-9) * (sigma / 550.0).powi(2) * 2.0;
        for (got, want) in [m[2][2], m[2][3]].into_iter().zip(want) {
            assert!(
                (f64::from(got) - want / weight).abs() < tolerance,
                "{length} m: {got} is not {}",
                want / weight
            );
        }
    }
}

/// Tests that faces reflect and transmit like glass of the mean index. Weights are values divided by
/// probabilities.
#[test]
fn faces_act_like_glass_of_the_mean_index() {
    let set = crystals("a.crystal = { n_o = 1.66, n_e = 1.48, axis = [0, 0, 1] }\nb.dielectric.ior = 1.57\n");
    let n = Vec3A::Z;
    let at = surface_at(n, Vec3A::X, [0.0; 2]);
    let [a, b] = ["a", "b"].map(|name| set.names[name]);
    let mut stream = Stream::new(10, 0, 0);
    for wo in [Vec3A::new(0.6, 0.0, 0.8), Vec3A::new(0.0, -0.28, -0.96)] {
        let mut seen = [0; 2];
        for lobe in [Lobe::Reflected, Lobe::Transmitted] {
            let [s, glass] = [a, b].map(|id| set.materials.specular(id, &at, wo, lobe, 0).expect("a lobe"));
            assert!(
                s.wi.distance(glass.wi) < 1e-6
                    && (s.scatter.m00() - glass.scatter.m00()).to_array()[0].abs() < 1e-6
            );
            let through = lobe == Lobe::Transmitted;
            let want = if wo.z > 0.0 { a } else { sunstone::transport::material::NO_CRYSTAL };
            assert_eq!(s.filling.map(|m| m.crystal), through.then_some(want));
        }
        let reflected = set.materials.specular(a, &at, wo, Lobe::Reflected, 0).expect("a lobe");
        for _ in 0..4000 {
            let s = set.materials.sample(a, &at, wo, &mut Lanes::first(4), &mut stream).expect("a sample");
            let through = s.wi.z * wo.z < 0.0;
            seen[usize::from(through)] += 1;
            let lobe = if through { Lobe::Transmitted } else { Lobe::Reflected };
            let r = reflected.scatter.m00().to_array()[0];
            let p = if through { 1.0 - r } else { r };
            let whole = set.materials.specular(a, &at, wo, lobe, 0).expect("a lobe");
            let (got, want) = (s.scatter.m00().to_array()[0] * p, whole.scatter.m00().to_array()[0]);
            assert!((got - want).abs() < 1e-6 && s.delta && s.filling == whole.filling);
        }
        let r = f64::from(reflected.scatter.m00().to_array()[0]);
        let spread = (4000.0 * r * (1.0 - r)).sqrt();
        assert!((f64::from(seen[0]) - 4000.0 * r).abs() < 5.0 * spread, "{seen:?} for {r}");
    }
}

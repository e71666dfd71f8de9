//! Compares the tracer with doubling for multiple scattering in plane-parallel slabs, in all 16 elements.
//!
//! The slab is a wide cube with a null boundary, from z = -τ to 0, with a mean free path of 1 m. A distant
//! projector illuminates the slab with parallel light, and a camera with a single ray sees the slab.
//!
//! Media have index 1. Spheres have the relative index and the wavelength in water of Ramella-Roman, Prahl &
//! Jacques (2005, Opt. Express 13, 4420): 1.59 in 1.33, 632.8 nm.

use crate::doubling::{Slab, direction, horizontal, rayleigh};
use crate::optics::{Device, M, amplitudes, head, mueller, project, samples_factor, turn};
use crate::support::render_text;
use glam::DVec3;
use sunstone::transport::medium::bulk::{Amount, Ensemble};
use sunstone::transport::medium::scattered::Elements;
use sunstone::transport::medium::size_distribution::SizeDistribution;

pub const WATER: f64 = 1.33;
const NM: f64 = 632.8;

/// Half width of the slab in metres. The slab is so wide that no light returns from its sides.
const HALF: f64 = 40.0;
/// Distance of the projector in metres.
const FAR: f64 = 2e4;

pub fn spheres(host: f64, diameter_nm: f64) -> Ensemble {
    let mut ensemble = Ensemble::new(host, NM);
    let sizes = SizeDistribution::Single { radius: 0.5e-9 * diameter_nm };
    ensemble.add(&sizes, [1.59, 0.0], Amount::VolumeFraction(1e-4)).expect("admitted spheres");
    ensemble
}

/// Returns the scattering matrix of spheres per steradian.
pub fn mie(ensemble: &Ensemble) -> impl Fn(f64) -> Elements<f64> + '_ {
    |mu| {
        let [s11, s12, s33, s34] = ensemble.matrix(mu, &mut vec![]);
        Elements { s11, s12, s22: s11, s33, s34, s44: s33 }
    }
}

/// Returns the phase function of a medium file: that of spheres of one diameter, or Rayleigh's.
pub fn phase(diameter_nm: Option<f64>) -> String {
    match diameter_nm {
        None => "phase.rayleigh = {}\n".to_owned(),
        Some(d) => format!(
            "phase.mie.kinds = [{{ index = {:?}, sizes.single.radius_nm = {:?}, amount.per_m3 = 1e9 }}]\n",
            1.59 / WATER,
            d / 2.0
        ),
    }
}

/// Directions of illumination and view. A direction of travel has a signed cosine against z and an azimuth in
/// degrees.
#[derive(Clone, Copy, Debug)]
struct View {
    mu_in: f64,
    phi_in: f64,
    /// Signed cosine of the direction of view against z. The cosine is negative if the slab is seen from
    /// below.
    mu: f64,
    phi: f64,
}

/// Returns the mean radiance per unit irradiance and its standard errors from the tracer, and the mean
/// radiance from doubling. All values refer to the frames of camera and projector, which are rotated by
/// `rolls`.
fn both(phase: &str, slab: &Slab, albedo: f64, view: View, rolls: [f64; 2], samples: [u32; 2]) -> [M; 3] {
    both_under("", phase, slab, albedo, view, rolls, samples)
}

/// Returns the values of [`both`] for a slab below an object. The tracer connects through the object.
fn both_under(
    over: &str,
    phase: &str,
    slab: &Slab,
    albedo: f64,
    view: View,
    rolls: [f64; 2],
    samples: [u32; 2],
) -> [M; 3] {
    let [phi, phi_in] = [view.phi, view.phi_in].map(f64::to_radians);
    let (out, into) = (direction(view.mu, phi), direction(-view.mu_in, phi_in));
    let tau = slab.tau;
    // Light spreads as far as the slab is deep.
    let half = HALF.max(8.0 * tau);
    let seen = DVec3::new(0.0, 0.0, if view.mu > 0.0 { 0.0 } else { -tau });
    let camera = Device::ray((seen + out * 3.0).to_array(), seen).rolled(rolls[0]);
    let lamp =
        Device::look_at((into * -FAR).to_array(), DVec3::ZERO, [1, 1], 0.5 * FAR / half).rolled(rolls[1]);
    let [spp, seed] = samples;
    let through = if over.is_empty() { "" } else { "integrator = \"bidirectional\"\nmanifold = true\n" };
    let text = head(spp, 1000, seed).replace("[550]", &format!("[{:?}]", NM / WATER))
        + through
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!(
            "irradiance = {:?}\n[media.m.homogeneous]\nscattering = {albedo:?}\nabsorption = {:?}\n",
            FAR * FAR,
            1.0 - albedo
        )
        + phase
        + "[materials.glass.dielectric]\nior = 1.5\n"
        + over
        + "[materials.b.null]\n[[objects]]\nmaterial = \"b\"\ninterior = \"m\"\n"
        + &format!(
            "shape.cube = {{ min = [-{half:?}, -{half:?}, -{tau:?}], max = [{half:?}, {half:?}, 0.0] }}\n"
        )
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";
    let r = render_text(&text);
    let [mean, error] = [r.mean("m"), r.std_error("m")].map(|t| mueller(&t, &[]));
    let want = if view.mu > 0.0 {
        slab.reflected(view.mu, view.mu_in, phi - phi_in)
    } else {
        slab.transmitted(-view.mu, view.mu_in, phi - phi_in)
    };
    let after = turn(out, horizontal(phi), project(camera.right, out));
    let before = turn(into, project(lamp.right, into), horizontal(phi_in));
    [mean, error, after * want * before]
}

/// Compares views of a slab with doubling. Approximations in the scene change results by less than 2·10⁻⁴.
fn check(what: &str, phase: &str, slab: &Slab, albedo: f64, views: &[View], spp: u32) {
    check_to(0.04, what, phase, slab, albedo, views, spp);
}

/// Compares views of a slab with doubling, with a given limit `most` of the relative error.
fn check_to(most: f64, what: &str, phase: &str, slab: &Slab, albedo: f64, views: &[View], spp: u32) {
    let (mut gain, mut weights) = (0.0, 0.0);
    for (seed, view) in views.iter().enumerate() {
        let [got, sigma, want] = both(phase, slab, albedo, *view, [0.4, -0.7], [spp, 50 + seed as u32]);
        let m00 = want[(0, 0)];
        let z = M::from_fn(|i, j| {
            (got[(i, j)] - want[(i, j)]) / (sigma[(i, j)].powi(2) + (2e-4 * m00).powi(2)).sqrt()
        });
        let error = sigma[(0, 0)] / m00;
        println!(
            "{what}, {view:?}: {:.4} of {m00:.4} ± {error:.4}, max |z| {:.1}",
            got[(0, 0)],
            z.abs().max()
        );
        assert!(
            z.abs().max() < 5.0,
            "{what}, {view:?}: differences in standard errors\n{z}\n{got}\nis not\n{want}"
        );
        assert!(error < most, "{what}, {view:?}: too few samples to mean anything: {error}");
        gain += (got[(0, 0)] / m00 - 1.0) / (error * error);
        weights += 1.0 / (error * error);
    }
    let (gain, sigma) = (gain / weights, 1.0 / f64::sqrt(weights));
    assert!(gain.abs() < 5.0 * sigma.hypot(2e-4), "{what}: all views are off by {gain} ± {sigma}");
}

fn view([mu_in, phi_in]: [f64; 2], [mu, phi]: [f64; 2]) -> View {
    View { mu_in, phi_in, mu, phi }
}

/// Compares Rayleigh slabs under oblique light with doubling. The slabs are lossless or absorbing, and are
/// seen from each side.
#[test]
fn rayleigh_slabs_match_doubling() {
    let light = [0.6, 25.0];
    let mus = [0.6, 0.8, 0.3, 0.5];
    for (optics, spp, views) in [
        ([1.0, 1.0], 60_000, [[0.8, 85.0], [0.3, 10.0], [-0.5, -40.0]]),
        ([3.0, 0.9], 40_000, [[0.3, -150.0], [-0.8, 60.0], [-0.3, 205.0]]),
    ] {
        let slab = Slab::new(&rayleigh, optics, 12, &mus, &[0, 1, 2], 16);
        let views = views.map(|v| view(light, v));
        check("Rayleigh", &phase(None), &slab, optics[1], &views, spp);
    }
}

/// Compares slabs of spheres of 1 and 2 µm with doubling. The spheres create and preserve circular
/// polarization, and scatter most light forward.
#[test]
#[ignore = "slow: tools/check --all"]
fn mie_slabs_match_doubling() {
    let light = [1.0, 0.0];
    // Larger spheres have finer structure in their backscattering.
    for (diameter, nodes, optics, spp, views) in [
        (1000.0, 12, [2.0, 1.0], 150_000, [[0.6, 30.0], [-0.8, 75.0]]),
        (2000.0, 20, [4.0, 0.99], 120_000, [[0.8, -60.0], [-0.6, 110.0]]),
    ] {
        let ensemble = spheres(WATER, diameter);
        let scattering = mie(&ensemble);
        let slab = Slab::new(&scattering, optics, nodes, &[1.0, 0.6, 0.8], &[0, 2], 14);
        let views = views.map(|v| view(light, v));
        let what = format!("spheres of {diameter} nm");
        check(&what, &phase(Some(diameter)), &slab, optics[1], &views, spp);
    }
}

/// Compares lossless Rayleigh slabs from thin to thick with doubling. The slabs include Coulson's case (τ =
/// 0.5, a sun at cosine 0.2). [`crate::published_slabs`] compares doubling with Coulson's table.
///
/// The variable `SAMPLES` multiplies the numbers of samples.
#[test]
fn rayleigh_slabs_of_all_depths() {
    let factor = samples_factor();
    for (tau, mu_in, spp, views) in [
        (0.1, 0.6, 20_000, [[0.4, 60.0], [-0.4, 10.0]]),
        (0.5, 0.2, 12_000, [[0.4, 60.0], [1.0, 0.0]]),
        (8.0, 0.6, 3000, [[0.4, 60.0], [-1.0, 0.0]]),
        (32.0, 1.0, 1000, [[0.4, 60.0], [1.0, 0.0]]),
    ] {
        let slab = Slab::new(&rayleigh, [tau, 1.0], 16, &[mu_in, 0.4, 1.0, 0.6], &[0, 1, 2], 20);
        let views = views.map(|v| view([mu_in, 0.0], v));
        check_to(0.06, &format!("depth {tau}"), &phase(None), &slab, 1.0, &views, factor * spp);
    }
}

/// Tests all 16 elements of lossless slabs of small spheres (asymmetry 0.82) and large spheres. The slabs are
/// thin or thick, are lit along the normal, and are seen from each side at several angles.
///
/// The reference is doubling, which must lose no light. [`crate::published_slabs`] compares doubling with
/// Ramella-Roman's table of spheres. The negative control is light scattered by spheres of the wrong size.
///
/// The variable `SAMPLES` multiplies the numbers of samples.
#[test]
fn mie_slabs_to_depth_8() {
    mie_slabs(&[
        (0.1, 20_000, [[0.5, 30.0], [-0.9, 75.0]]),
        (1.0, 12_000, [[0.9, -60.0], [-0.5, 110.0]]),
        (8.0, 4000, [[0.3, 20.0], [-0.9, 140.0]]),
    ]);
}

/// Tests that subpaths are not biased toward the light at every step. With a bias at every step, the result
/// would be 14 % too dark at 9000 samples, because the tails of the distribution would not be sampled.
#[test]
#[ignore = "slow: tools/check --all"]
fn mie_slabs_of_depth_32() {
    mie_slabs(&[(32.0, 9000, [[0.5, 75.0], [-0.3, -20.0]])]);
}

fn mie_slabs(cases: &[(f64, u32, [[f64; 2]; 2])]) {
    let factor = samples_factor();
    let sizes = [500.0, 1000.0].map(|nm| {
        let ensemble = spheres(WATER, nm);
        let g = ensemble.bulk(0.0).asymmetry;
        assert!((0.8..0.95).contains(&g), "{nm} nm: {g}");
        println!("spheres of {nm} nm: asymmetry {g:.3}");
        (nm, ensemble)
    });
    let mus = [1.0, 0.9, 0.5, 0.3];
    for &(tau, spp, views) in cases {
        let slabs = sizes.each_ref().map(|(_, ensemble)| {
            let slab = Slab::new(&mie(ensemble), [tau, 1.0], 14, &mus, &[0, 2], 18);
            let [up, down] = slab.shares(1.0);
            assert!((up + down - 1.0).abs() < 1e-4, "depth {tau}: {up} + {down}");
            slab
        });
        let views = views.map(|v| view([1.0, 0.0], v));
        for ((nm, _), slab) in sizes.iter().zip(&slabs) {
            let what = format!("depth {tau}, spheres of {nm} nm");
            check_to(0.1, &what, &phase(Some(*nm)), slab, 1.0, &views, factor * spp);
        }
        // The two sizes of spheres give distinguishable results.
        let [got, sigma, want] =
            both(&phase(Some(sizes[0].0)), &slabs[1], 1.0, views[0], [0.4, -0.7], [factor * spp, 60]);
        let off = M::from_fn(|i, j| (got[(i, j)] - want[(i, j)]) / sigma[(i, j)]).abs().max();
        println!("depth {tau}: the other spheres are {off:.0} errors off");
        assert!(off > 5.0, "depth {tau}: the other spheres are {off} errors off alone");
    }
}

/// Returns the reflection and transmission of a pane of glass at a cosine, with all inner reflections, from
/// either side. The two polarizations and their correlation propagate independently.
fn pane(mu: f64) -> [M; 2] {
    let [s, p] = amplitudes(mu, nalgebra::Complex::new(1.5, 0.0)).map(|r| r.re);
    let once = [s * s, p * p, s * p];
    let passed = [1.0 - s * s, 1.0 - p * p, ((1.0 - s * s) * (1.0 - p * p)).sqrt()];
    let matrix = |[s, p, c]: [f64; 3]| {
        let (a, b) = ((s + p) / 2.0, (s - p) / 2.0);
        M::new(a, b, 0., 0., b, a, 0., 0., 0., 0., c, 0., 0., 0., 0., c)
    };
    let all = |first: [f64; 3], again: [f64; 3]| {
        std::array::from_fn(|i| first[i] + passed[i] * passed[i] * again[i] / (1.0 - once[i] * once[i]))
    };
    [matrix(all(once, once)), matrix(all([0.0; 3], [1.0; 3]))]
}

/// Compares a Rayleigh slab under a pane with the adding-doubling method. Light enters and leaves through the
/// pane. The tracer uses manifold connections through the pane, and bidirectional paths.
#[test]
fn slabs_under_glass_match_adding() {
    let over = format!(
        "[[objects]]\nmaterial = \"glass\"\nshape.cube = {{ min = [-{HALF:?}, -{HALF:?}, 0.2], max = [{HALF:?}, {HALF:?}, 0.25] }}\n"
    );
    let bare = Slab::new(&rayleigh, [1.0, 1.0], 16, &[0.8, 0.9, 0.6], &[0, 1, 2], 16);
    let slab = bare.under(pane);
    let [own, through] = pane(0.6);
    // No light is lost. The pane returns a quarter to a tenth of the upward light.
    assert!((own[(0, 0)] + through[(0, 0)] - 1.0).abs() < 1e-12);
    let factor = samples_factor();
    for (seed, out) in [[0.9, 70.0], [0.6, -150.0]].into_iter().enumerate() {
        let seen = view([0.8, 25.0], out);
        let [got, sigma, want] = both_under(
            &over,
            &phase(None),
            &slab,
            1.0,
            seen,
            [0.4, -0.7],
            [factor * 24_000, 90 + seed as u32],
        );
        let m00 = want[(0, 0)];
        let z = M::from_fn(|i, j| (got[(i, j)] - want[(i, j)]) / sigma[(i, j)].hypot(2e-4 * m00));
        let unglazed = bare.reflected(seen.mu, seen.mu_in, (seen.phi - seen.phi_in).to_radians())[(0, 0)];
        println!(
            "under glass, {seen:?}: {:.5} ± {:.5} of {m00:.5}, without glass {unglazed:.5}, max |z| {:.1}",
            got[(0, 0)],
            sigma[(0, 0)],
            z.abs().max()
        );
        assert!(z.abs().max() < 5.0, "{seen:?}: differences in standard errors\n{z}\n{got}is not\n{want}");
        assert!(sigma[(0, 0)] < 0.03 * m00, "{}: too few samples to mean anything", sigma[(0, 0)] / m00);
        assert!((unglazed - m00).abs() > 5.0 * sigma[(0, 0)], "{unglazed}: nobody would miss the pane");
    }
}

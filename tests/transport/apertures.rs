//! Compares emitters of finite size with a point light in a tank of cloudy water behind glass. Camera paths
//! hit the emitter at random. As the emitter shrinks, its light approaches that of the point light. Manifold
//! connections and bidirectional paths connect to the point light.
//!
//! The variable `SAMPLES` multiplies the numbers of samples.

use crate::optics::samples_factor;
use crate::support::scene_of;
use glam::DVec3;
use std::f64::consts::PI;
use sunstone::tensor::field::Field;
use sunstone::tensor::memory::Arrays;
use sunstone::transport::render::schedule::{Share, Unwatched, render};
use sunstone::transport::scene::Integrator;

const LAMP: DVec3 = DVec3::new(0.09, 0.4, 0.45);

/// Returns the scene-file text of the tank with a Lambertian plate in the water. The camera has one wide
/// pixel.
fn tank(spp: u32, seed: u32, light: &str, object: &str) -> String {
    let spp = spp * samples_factor();
    format!(
        "wavelengths_nm = [550]\n[render]\nspp = {spp}\nmax_depth = 40\nseed = {seed}\nrr_depth = 5\ntile = 1\n\
         [camera]\nresolution = [2, 2]\nfov_x_deg = 8\n\
         pose.look_at = {{ origin = [-0.07, 0.1, 0.5], target = [0, 0.074, 0] }}\n\
         [materials]\nwhite.diffuse.albedo = 0.6\nblack.diffuse.albedo = 0\nglass.dielectric.ior = 1.52\n\
         water.dielectric = {{ ior = 1.333, exterior_ior = 1.52 }}\n\
         [media.milk.homogeneous]\nscattering = 12\nabsorption = 1\nphase.henyey_greenstein = {{ g = 0.6, linear = 0.5, circular = 0.5 }}\n\
         [[objects]]\nmaterial = \"glass\"\nshape.cube = {{ min = [-0.115, 0, -0.06], max = [0.115, 0.15, 0.06] }}\n\
         [[objects]]\nmaterial = \"water\"\ninterior = \"milk\"\n\
         shape.cube = {{ min = [-0.11, 0.005, -0.055], max = [0.11, 0.145, 0.055] }}\n\
         [[objects]]\nmaterial = \"white\"\nshape.rectangle = {{ corner = [-0.05, 0.03, 0], u = [0.1, 0, 0], v = [0, 0.1, 0] }}\n\
         {light}{object}[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n"
    )
}

/// Returns the intensity and the linear Stokes elements under unpolarized illumination, with standard errors.
fn stokes(text: &str, integrator: Integrator) -> [[f64; 2]; 3] {
    let mut scene = scene_of(text);
    scene.set_integrator(integrator);
    let mut arrays = Arrays::default();
    let summary =
        render(&scene, &[], Share::default(), &mut arrays, &Unwatched).expect("arrays take everything");
    println!("{integrator:?}: {:.1} s", summary.wall_s);
    let [mean, error] = [Field::Mean, Field::StdError].map(|f| arrays.get("m", f).expect("the field").data);
    // Averages over the four pixels.
    [0, 4, 8].map(|i| {
        let of = |data: &[f32]| -> Vec<f64> {
            data.iter().skip(i).step_by(16).map(|v| f64::from(*v) / 4.0).collect()
        };
        let squares: f64 = of(&error).iter().map(|e| e * e).sum();
        [of(&mean).iter().sum(), squares.sqrt()]
    })
}

/// Tests that a distant sphere of radius r and constant radiance acts as a point light of intensity π r²
/// times the radiance. The difference decreases with r².
#[test]
fn shrinking_lights_become_points() {
    let at = format!("{:?}", LAMP.to_array());
    let ball = |radius: f64, spp, seed| {
        let radiance = 1.0 / (PI * radius * radius);
        let ball = format!(
            "[[objects]]\nmaterial = \"black\"\nshape.sphere = {{ center = {at}, radius = {radius:?} }}\n\
             emission = {{ radiance = {radiance:?} }}\n"
        );
        stokes(&tank(spp, seed, "", &ball), Integrator::Path)
    };
    let (large, small) = (ball(0.2, 30_000, 1), ball(0.1, 100_000, 2));
    // The emitter illuminates the tank uniformly, and illuminates nothing else.
    let point = format!(
        "[[emitters]]\nspot = {{ position = {at}, direction = [-0.09, -0.33, -0.45], intensity = 1.0, cutoff_deg = 25, beam_deg = 24 }}\n"
    );
    let connected = stokes(&tank(8000, 3, &point, ""), Integrator::Bidirectional);
    for i in 0..3 {
        let [[a, x], [b, y], [c, z]] = [large[i], small[i], connected[i]];
        // Extrapolates the result to radius zero.
        let (want, error) = ((4.0 * b - a) / 3.0, (16.0 * y * y + x * x).sqrt() / 3.0);
        println!(
            "S{i}: radius 0.2 {a:.5} ± {x:.5}, 0.1 {b:.5} ± {y:.5}, none {want:.5} ± {error:.5}; connected {c:.5} ± {z:.5}"
        );
        assert!((c - want).abs() < 5.0 * error.hypot(z), "S{i}: {c} ± {z} is not {want} ± {error}");
    }
    let [[b, y], [c, z]] = [small[0], connected[0]];
    assert!(y < 0.04 * b && z < 0.04 * c, "too few samples to mean anything: {y} of {b}, {z} of {c}");
}

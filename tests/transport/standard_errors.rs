//! Tests standard errors. Over many seeds, deviations from the mean over seeds must agree with the stated
//! errors.

use crate::bidirectional::{FOG, WALLS};
use crate::optics::head;
use crate::support::{mirror_room, scene_of};
use sunstone::tensor::field::Field;
use sunstone::tensor::memory::Arrays;
use sunstone::transport::render::schedule::{Share, Unwatched, render};
use sunstone::transport::scene::{Integrator, Scene};

/// Number of seeds, unless the environment variable `SEEDS` sets another number.
const SEEDS: u64 = 20;
/// Minimum number of elements for a variance.
const LEAST: f64 = 48.0;

const SLICES: &str = r#"
[[slices]]
name = "sum"
[[slices]]
name = "coarse"
camera = { binned = 2 }
[[slices]]
name = "flight"
time = { start_ps = 12000, bin_ps = 500, bins = 20 }
[[slices]]
name = "mueller"
polarization = "mueller"
[[slices]]
name = "epipolar"
projector = { nonepipolar = { half_width_px = 0.5 } }
"#;

/// Tests z = (mean - mean over seeds) / standard error. The factor √(S/(S-1)) accounts for the mean over
/// seeds, which includes the seed itself.
///
/// The test excludes elements with few hits, because the distribution of a few bright hits is not Gaussian.
/// An element has enough hits if its standard error varies by less than 15 % from seed to seed. For n samples
/// of kurtosis κ, the variation is ½ √((κ - 1)/n), so κ < 0.09·n. The selection does not depend on
/// deviations, so it cannot favour small deviations.
#[test]
#[ignore = "slow: tools/check --all"]
fn deviations_between_seeds_are_as_stated() {
    room(Integrator::Path, 256);
}

/// Tests standard errors for samples stratified in 32 groups of 8.
#[test]
#[ignore = "slow: tools/check --all"]
fn deviations_of_groups_are_as_stated() {
    room(Integrator::Path, 32);
}

/// Tests standard errors of the sum of plain paths and 16 samples of redirected light.
#[test]
#[ignore = "slow: tools/check --all"]
fn deviations_of_added_passes_are_as_stated() {
    room(Integrator::Caustics, 256);
}

/// Tests standard errors for a band about epipolar lines with sampled s'.
#[test]
#[ignore = "slow: tools/check --all"]
fn deviations_of_drawn_s_primes_are_as_stated() {
    let band = "[[slices]]\nname = \"band\"\nprojector = { epipolar = { half_width_px = 0.5 } }\nsplit_first_bounce = true\n";
    let mut scene = scene_of(&mirror_room(16, 256, 256, 16, band));
    scene.change_settings(|s| s.replicates = 256);
    scene.set_integrator(Integrator::Path);
    honest("drawn s'", &mut scene, 1.0);
}

/// Tests standard errors in a room. Random paths hit most elements of the slices, so the number of excluded
/// elements is irrelevant.
fn room(integrator: Integrator, replicates: u32) {
    let mut scene = scene_of(&mirror_room(16, 16, 256, 16, SLICES));
    scene.change_settings(|s| s.replicates = replicates);
    scene.set_integrator(integrator);
    honest(&format!("mirror room, {integrator:?}, {replicates}"), &mut scene, 1.0);
}

/// Largest fraction of excluded elements if all elements receive light.
const LEFT_OUT: f64 = 0.01;

/// Returns the scene-file text of the camera and the projector in front of a box of 2 m. The slices resolve
/// time, pixel s' and polarization.
fn box_of(spp: u32, depth: u32, more: &str) -> String {
    format!(
        "wavelengths_nm = [550]\n[render]\nintegrator = \"bidirectional\"\nspp = {spp}\nreplicates = {spp}\nmax_depth = {depth}\n\
         seed = 0\nrr_depth = 3\ntile = 8\n[camera]\nresolution = [4, 4]\nfov_x_deg = 36\n\
         pose.look_at = {{ origin = [0.3, 0.4, 3.6], target = [0, 0, 0] }}\n\
         [projector]\nresolution = [8, 8]\nfov_x_deg = 36\nirradiance = 1.0\n\
         pose.look_at = {{ origin = [-0.7, 0.8, 3.3], target = [0.1, -0.2, 0], up = [0.2, 1, 0.1] }}\n\
         [[slices]]\nname = \"sum\"\n\
         [[slices]]\nname = \"coarse\"\ncamera = {{ binned = 2 }}\n\
         [[slices]]\nname = \"flight\"\ncamera = {{ binned = 4 }}\ntime = {{ start_ps = 22000, bin_ps = 500, bins = 12 }}\n\
         [[slices]]\nname = \"mueller\"\ncamera = {{ binned = 4 }}\npolarization = \"mueller\"\n\
         [[slices]]\nname = \"lit\"\ncamera = {{ binned = 2 }}\nprojector = {{ binned = 4 }}\n\
         [materials]\nwall.diffuse.albedo = 0.7\nred.diffuse.albedo = 0.3\nfloor.diffuse.albedo = 0.5\n{more}{WALLS}"
    )
}

/// Tests standard errors of bidirectional paths, whose splats count as samples of the pixels that the splats
/// hit.
#[test]
fn deviations_of_bidirectional_paths_are_as_stated() {
    honest("bidirectional", &mut scene_of(&box_of(256, 5, "")), LEFT_OUT);
}

/// Tests standard errors of bidirectional paths whose camera subpaths are stratified in 64 groups of 8.
#[test]
#[ignore = "slow: tools/check --all"]
fn deviations_of_groups_of_bidirectional_paths_are_as_stated() {
    let text = box_of(512, 5, "").replace("replicates = 512", "replicates = 64");
    honest("bidirectional groups", &mut scene_of(&text), 1.0);
}

/// Tests standard errors of light that a medium around a ball scatters, with bidirectional paths.
#[test]
#[ignore = "slow: tools/check --all"]
fn deviations_in_media_are_as_stated() {
    let fog = FOG.replace("[0.4, 0.7, 1.0]", "0.7").replace("[0.1, 0.05, 0.2]", "0.1");
    let text = box_of(256, 6, &format!("none.null = {{}}\n{fog}phase.rayleigh = {{}}\n"))
        + "[[objects]]\nmaterial = \"none\"\ninterior = \"fog\"\n\
           shape.cube = { min = [-0.9, -0.9, -0.9], max = [0.9, 0.9, 0.9] }\n\
           [[objects]]\nmaterial = \"red\"\nshape.sphere = { center = [0.1, -0.2, 0.1], radius = 0.3 }\n";
    honest("media", &mut scene_of(&text), LEFT_OUT);
}

/// Tests standard errors of light that multiple scattering polarizes. The scene is a Rayleigh slab of depth
/// 4, seen from below.
#[test]
fn deviations_of_slabs_are_as_stated() {
    let text = head(512, 1000, 0)
        + "integrator = \"path\"\nreplicates = 512\n[camera]\nresolution = [3, 3]\nfx = 1e7\n\
           pose.look_at = { origin = [1.8, 0, -6.4], target = [0, 0, -4] }\n\
           [projector]\nresolution = [1, 1]\nfx = 250\nirradiance = 4e8\n\
           pose.look_at = { origin = [0, 0, 2e4], target = [0, 0, 0], up = [0, 1, 0] }\n\
           [media.m.homogeneous]\nscattering = 1.0\nabsorption = 0.0\nphase.rayleigh = {}\n[materials.b.null]\n\
           [[objects]]\nmaterial = \"b\"\ninterior = \"m\"\nshape.cube = { min = [-40, -40, -4], max = [40, 40, 0] }\n\
           [[slices]]\nname = \"mueller\"\npolarization = \"mueller\"\n";
    honest("slab", &mut scene_of(&text), LEFT_OUT);
}

/// Tests manifold connections through glass and over a mirror, in the weighted combination with subpaths. The
/// test compares intensities only. Few paths contribute to polarization by a mirror, so short renders cannot
/// estimate the error of the polarization.
#[test]
#[ignore = "slow: tools/check --all"]
fn deviations_of_manifolds_are_as_stated() {
    let glass = "glass.dielectric = { ior = 1.5 }\nmirror.conductor = { metal = \"Ag\" }\n";
    let text = box_of(400, 6, glass)
        .replace("seed = 0", "seed = 0\nmanifold = true")
        .replace("polarization = \"mueller\"", "polarization = \"intensity\"")
        + "[[objects]]\nmaterial = \"mirror\"\n\
           shape.rectangle = { corner = [-0.99, -1, -1], u = [0, 0, 2], v = [0, 2, 0] }\n\
           [[objects]]\nmaterial = \"glass\"\nshape.cube = { min = [0, -0.9, 0.3], max = [0.6, 0.2, 0.4] }\n";
    honest("manifold", &mut scene_of(&text), LEFT_OUT);
}

/// Tests that deviations over seeds agree with the stated errors. At most a fraction `left_out` of the lit
/// elements may have too few hits.
fn honest(what: &str, scene: &mut Scene, left_out: f64) {
    let names: Vec<String> = scene.slices.iter().map(|s| s.name.clone()).collect();
    let mut values: Vec<Vec<[Vec<f32>; 2]>> = vec![Vec::new(); names.len()];
    let seeds = std::env::var("SEEDS").map_or(SEEDS, |n| n.parse().expect("a number of seeds"));
    for seed in 0..seeds {
        scene.change_settings(|s| s.seed = 1000 + seed);
        let mut arrays = Arrays::default();
        let summary =
            render(scene, &[], Share::default(), &mut arrays, &Unwatched).expect("arrays take everything");
        assert_eq!(summary.discarded, 0);
        for (name, list) in names.iter().zip(&mut values) {
            list.push([Field::Mean, Field::StdError].map(|f| arrays.take(name, f).expect("the field").data));
        }
    }
    let s = seeds as f64;
    let mut all = [0.0; 3];
    for (name, runs) in names.iter().zip(&values) {
        let (mut elements, mut dropped, mut total, mut squares, mut ratio) = (0, 0, 0.0, 0.0, 0.0);
        for i in 0..runs[0][0].len() {
            let moments = |f: usize| {
                let mean = runs.iter().map(|r| f64::from(r[f][i])).sum::<f64>() / s;
                let spread =
                    runs.iter().map(|r| (f64::from(r[f][i]) - mean).powi(2)).sum::<f64>() / (s - 1.0);
                (mean, spread)
            };
            let ((mean, spread), (error, variation)) = (moments(0), moments(1));
            if error == 0.0 {
                assert!(
                    spread < 1e-10 * mean * mean + 1e-30,
                    "{what}, {name}: element {i} varies without an error"
                );
                continue;
            }
            let ever_dark = runs.iter().any(|r| r[1][i] == 0.0);
            if ever_dark || variation.sqrt() > 0.15 * error {
                dropped += 1;
                continue;
            }
            elements += 1;
            ratio += spread / (error * error);
            for r in runs {
                let z = (f64::from(r[0][i]) - mean) / f64::from(r[1][i]) * (s / (s - 1.0)).sqrt();
                total += z;
                squares += z * z;
            }
        }
        let n = f64::from(elements) * s;
        let variance = squares / n - (total / n).powi(2);
        let dropped_share = f64::from(dropped) / f64::from(elements + dropped);
        println!(
            "{what}, {name}: {elements} elements, {dropped} left out, variance of z {variance:.3}, spread {:.3}",
            ratio / f64::from(elements)
        );
        assert!(
            dropped_share <= left_out,
            "{what}, {name}: {dropped} of {} elements have too few hits",
            elements + dropped
        );
        // `unsure` is five standard errors of the variance, which is large for few elements.
        let unsure = 5.0 * (2.0 / n).sqrt();
        let window = 0.8 * (1.0 - unsure)..1.25 * (1.0 + unsure);
        assert!(window.contains(&variance), "{what}, {name}: z has variance {variance}, not in {window:?}");
        all[0] += n;
        all[1] += total;
        all[2] += squares;
    }
    let [n, total, squares] = all;
    let (variance, most) = (squares / n - (total / n).powi(2), n / s);
    println!("{what}: {most} elements, variance of z {variance:.3}");
    assert!(most >= LEAST, "{what}: only {most} elements have enough hits");
    assert!((0.8..1.25).contains(&variance), "{what}: z has variance {variance}");
}

//! Tests media with density grids. The references are closed forms, white furnaces and homogeneous media.

use crate::lights::m00;
use crate::optics::assert_refused;
use crate::support::render_text;
use std::path::{Path, PathBuf};

/// Writes a grid file with the values of each point, with x varying fastest. Returns the path.
fn vol(folder: &Path, name: &str, size: [i32; 3], channels: i32, values: &[f32]) -> PathBuf {
    let words = [1, size[0], size[1], size[2], channels].map(i32::to_le_bytes);
    let corners = [0.0_f32, 0.0, 0.0, 1.0, 1.0, 1.0].map(f32::to_le_bytes);
    let numbers: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let bytes = [b"VOL\x03", words.as_flattened(), corners.as_flattened(), &numbers].concat();
    let file = folder.join(name);
    std::fs::write(&file, bytes).expect("a file");
    file
}

/// Returns the scene-file text of the unit cube, filled with `medium`, under uniform white light. The camera
/// has one pixel and looks along -z at x = 0.3, y = 0.6.
fn text(integrator: &str, spp: u32, medium: &str, more: &str) -> String {
    format!(
        "wavelengths_nm = [550]\n[render]\nspp = {spp}\nmax_depth = 400\nrr_depth = 1000000\nseed = 4\nintegrator = \"{integrator}\"\n\
         [camera]\nresolution = [1, 1]\nfov_x_deg = 0.01\npose.look_at = {{ origin = [0.3, 0.6, 5], target = [0.3, 0.6, 0] }}\n\
         [[emitters]]\nenvironment.radiance = 1\n[materials]\nn.null = {{}}\n[media]\n{medium}\n\
         [[objects]]\nmaterial = \"n\"\ninterior = \"m\"\nshape.cube = {{ min = [0, 0, 0], max = [1, 1, 1] }}\n{more}\
         [[slices]]\nname = \"m\"\npolarization = \"mueller\"\n"
    )
}

/// Tests that the transmittance is exp(-∫ extinction) for several densities:
/// - a ramp along z from 1 to 3, constant for a quarter at each end
/// - the same ramp in a box of half the cube
/// - the same ramp, rotated away from the ray
/// - the same ramp with nearest-neighbour lookup
#[test]
fn transmittance_is_the_exponential_of_the_integral() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = vol(folder.path(), "ramp.vol", [1, 1, 2], 1, &[1.0, 3.0]);
    let file = file.display();
    let cases = [
        (String::new(), 2.0_f64),
        (", box = [[0, 0, 0], [1, 1, 0.5]]".into(), 1.0),
        (", filter = \"nearest\"".into(), 2.0),
        // The ramp is along x. At x = 0.3, the ramp is 1.2.
        (", transform = { rotate_deg = [0, 90, 0], translate = [0, 0, 1] }".into(), 1.2),
        (", transform = { translate = [0.4, 0, 0] }".into(), 0.0),
    ];
    for (more, depth) in cases {
        let medium =
            format!("m.heterogeneous = {{ absorption = 0.8, density = {{ file = \"{file}\"{more} }} }}");
        let (found, _) = m00(&render_text(&text("path", 4, &medium, "")));
        let want = (-0.8 * depth).exp();
        assert!((found - want).abs() < 2e-4, "{more}: {found}, closed form {want}");
    }
}

/// Tests that a medium that scatters all light has the radiance of the surrounding white light, for any
/// density distribution.
#[test]
fn uneven_lossless_clouds_vanish_in_the_furnace() {
    let folder = tempfile::tempdir().expect("a folder");
    let values: Vec<f32> = (0..27).map(|i| (i * 7 % 11) as f32 * 0.6).collect();
    let file = vol(folder.path(), "cloud.vol", [3, 3, 3], 1, &values);
    for integrator in ["path", "bidirectional"] {
        let medium = format!(
            "m.heterogeneous = {{ scattering = 1.5, phase.henyey_greenstein = {{ g = 0.5 }}, density = {{ file = {file:?} }} }}"
        );
        let (found, sigma) = m00(&render_text(&text(integrator, 4000, &medium, "")));
        assert!(
            (found - 1.0).abs() <= 5.0 * sigma + 1e-4 && sigma < 0.01,
            "{integrator}: {found} ± {sigma:.1e}"
        );
    }
}

/// Tests that a grid of equal values acts as a homogeneous medium, up to rounding along the same paths. The
/// scattering albedo is a constant or a grid.
#[test]
fn equal_values_give_a_homogeneous_medium() {
    let folder = tempfile::tempdir().expect("a folder");
    let two = vol(folder.path(), "two.vol", [2, 3, 2], 1, &[2.0; 12]);
    let share = vol(folder.path(), "share.vol", [1, 1, 1], 3, &[0.9, 0.75, 0.1]);
    let light = "[projector]\nresolution = [4, 4]\nfov_x_deg = 20\npose.look_at = { origin = [1.5, 0.6, 4], target = [0.5, 0.5, 0.5] }\n";
    for integrator in ["path", "bidirectional"] {
        let even = "m.homogeneous = { scattering = 1.8, absorption = 0.6, phase.rayleigh = {} }";
        let same = format!(
            "m.heterogeneous = {{ scattering = 0.9, absorption = 0.3, phase.rayleigh = {{}}, density = {{ file = {two:?} }} }}"
        );
        let shared = format!(
            "m.heterogeneous = {{ scattering = 1.2, phase.rayleigh = {{}}, density = {{ file = {two:?} }}, albedo = {{ file = {share:?} }} }}"
        );
        let [want, found, third] =
            [even, &same, &shared].map(|m| m00(&render_text(&text(integrator, 3000, m, light))).0);
        assert!((found / want - 1.0).abs() < 1e-3, "{integrator}: {found}, {want}");
        assert!((third / want - 1.0).abs() < 1e-3, "{integrator}: {third}, {want}");
    }
}

/// Tests that the two integrators give the same light of a projector in a heterogeneous cloud in front of a
/// wall.
#[test]
fn uneven_clouds_agree_in_both_integrators() {
    let folder = tempfile::tempdir().expect("a folder");
    let values: Vec<f32> = (0..64).map(|i| (i * 13 % 17) as f32 * 0.25).collect();
    let file = vol(folder.path(), "cloud.vol", [4, 4, 4], 1, &values);
    let medium = format!(
        "m.heterogeneous = {{ scattering = 1.2, absorption = 0.2, phase.rayleigh = {{}}, density = {{ file = {file:?} }} }}"
    );
    let more = "[materials.w.diffuse]\nalbedo = 0.7\n[[objects]]\nmaterial = \"w\"\n\
        shape.rectangle = { corner = [-2, -2, -0.3], u = [5, 0, 0], v = [0, 5, 0] }\n\
        [projector]\nresolution = [4, 4]\nfov_x_deg = 20\npose.look_at = { origin = [1.5, 0.6, 4], target = [0.5, 0.5, 0.5] }\n";
    let dark = |t: String| t.replace("[[emitters]]\nenvironment.radiance = 1\n", "");
    let [path, both] =
        ["path", "bidirectional"].map(|i| m00(&render_text(&dark(text(i, 20_000, &medium, more)))));
    let sigma = path.1.hypot(both.1);
    assert!((path.0 - both.0).abs() <= 5.0 * sigma && sigma < 0.01 * path.0, "{path:?}, {both:?}");
}

#[test]
fn invalid_grids_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let good = vol(folder.path(), "good.vol", [1, 1, 2], 1, &[1.0, 2.0]);
    let negative = vol(folder.path(), "negative.vol", [1, 1, 2], 1, &[1.0, -2.0]);
    let pairs = vol(folder.path(), "pairs.vol", [1, 1, 1], 2, &[1.0, 2.0]);
    let short = vol(folder.path(), "short.vol", [9, 9, 9], 1, &[1.0]);
    let with = |density: String, more: &str| {
        let medium =
            format!("m.heterogeneous = {{ scattering = 1, density = {{ file = {density} }}{more} }}");
        text("path", 1, &medium, "")
    };
    let cases = [
        (with(format!("{negative:?}"), ""), "the value -2"),
        (with(format!("{pairs:?}"), ""), "2 values per point"),
        (with(format!("{short:?}"), ""), "the 1 values"),
        (with("\"none.vol\"".into(), ""), "none.vol"),
        (with(format!("{good:?}, box = [[0, 0, 0], [1, 0, 1]]"), ""), "no volume"),
        (with(format!("{good:?}"), &format!(", albedo = {{ file = {good:?} }}")), "the value 2"),
        (text("path", 1, "m.heterogeneous = { scattering = 1 }", ""), "density"),
    ];
    for (text, what) in cases {
        assert_refused("scene.toml".as_ref(), &text, what);
    }
}

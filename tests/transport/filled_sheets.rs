//! Tests the light of objects that are filled with a medium and whose surface does not refract.

use crate::optics::{Device, M, head, mueller, samples_factor};
use crate::support::render_text;
use glam::DVec3;
use std::f64::consts::PI;

/// Optical depth along the sphere's diameter.
const DEPTH: f64 = 2.0;

/// A material that transmits light without refraction, with the transmittance and reflectance of its surface
/// at normal incidence. The light may have passed another surface before.
struct Sheet {
    keys: &'static str,
    /// Transmittance of the first passage, and transmittance of the second passage.
    passes: [f64; 2],
    reflects: f64,
}

const fn straight(keys: &'static str) -> Sheet {
    Sheet { keys, passes: [1.0, 1.0], reflects: 0.0 }
}

/// Reflectance at normal incidence of a plate of index 1.5. The value is 2r/(1 + r) with r = 0.04.
const PLATE: f64 = 0.08 / 1.04;

const SHEETS: [Sheet; 10] = [
    straight("s.null = {}\n"),
    Sheet { keys: "s.thin_dielectric.ior = 1.5\n", passes: [1.0 - PLATE, 1.0 - PLATE], reflects: PLATE },
    straight("s.retarder = { retardance_deg = 70, angle_deg = 30 }\n"),
    Sheet { keys: "s.polarizer = { axis = [0, 1, 0] }\n", passes: [0.5, 1.0], reflects: 0.0 },
    straight("a.null = {}\nb.null = {}\ns.blend = { a = \"a\", b = \"b\", weight = 0.3 }\n"),
    straight("a.null = {}\ns.two_sided = { front = \"a\", back = \"a\" }\n"),
    straight("a.null = {}\ns.partial_depolarizer = { material = \"a\", fraction = 0.5 }\n"),
    straight(
        "a.retarder = { retardance_deg = 70, angle_deg = 30 }\nb.null = {}\nt.two_sided = { front = \"a\", back = \"b\" }\n\
         s.blend = { a = \"t\", b = \"b\", weight = 0.5 }\n",
    ),
    Sheet {
        keys: "a.thin_dielectric.ior = 1.5\ns.two_sided = { front = \"a\", back = \"a\" }\n",
        passes: [1.0 - PLATE, 1.0 - PLATE],
        reflects: PLATE,
    },
    // With a mask, half of the surface is open, and half of the surface absorbs light.
    Sheet {
        keys: "a.null = {}\nb.diffuse.albedo = 0\ns.blend = { a = \"a\", b = \"b\", weight = 0.5 }\n",
        passes: [0.5, 0.5],
        reflects: 0.0,
    },
];

/// Returns the scene-file text of a sphere of radius 0.5 about the origin, which is filled with `medium`.
fn sphere(medium: &str) -> String {
    format!(
        "[media.m.homogeneous]\n{medium}\n[[objects]]\nmaterial = \"s\"\ninterior = \"m\"\n\
         shape.sphere = {{ center = [0, 0, 0], radius = 0.5 }}\n"
    )
}

const SLICE: &str = "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";

/// Returns the mean and the standard error of a pixel that sees along the z axis through the sphere's centre.
fn seen(z: f64, rest: &str, spp: u32, seed: u32, integrator: &str) -> [M; 2] {
    let camera = Device::ray([0.0, 0.0, z], DVec3::new(0.0, 0.0, z - 1.0));
    let text = head(spp * samples_factor(), 200, seed)
        + &format!("integrator = \"{integrator}\"\n")
        + &camera.keys("camera")
        + rest
        + SLICE;
    let r = render_text(&text);
    [r.mean("m"), r.std_error("m")].map(|t| mueller(&t, &[]))
}

fn check([mean, error]: [M; 2], want: f64, what: &str) {
    let (got, sigma) = (mean[(0, 0)], error[(0, 0)]);
    println!("{what}: {got:.5} ± {sigma:.5}, expected {want:.5}");
    assert!((got - want).abs() < 5.0 * sigma + 2e-5 * want, "{what}: {got} ± {sigma} is not {want}");
    assert!(sigma < 0.02 * want, "{what}: too few samples, {sigma} of {want}");
}

/// Tests the transmission of absorbing media behind every kind of sheet under uniform illumination. The
/// camera is outside, along the diameter, or at the centre. The expected values include multiple reflections.
#[test]
fn absorbing_media_behind_every_kind_of_sheet() {
    for (seed, sheet) in SHEETS.iter().enumerate() {
        let rest = format!(
            "[materials]\n{}{}[[emitters]]\nenvironment.radiance = 1\n",
            sheet.keys,
            sphere(&format!("absorption = {DEPTH:?}"))
        );
        let ([t, u], r) = (sheet.passes, sheet.reflects);
        let whole = (-DEPTH).exp();
        // Computes the ratio of light that reaches a face from inside to the light outside, after any number
        // of reflections.
        let outside = r + t * u * whole / (1.0 - r * whole);
        let centre = (-0.5 * DEPTH).exp() * t / (1.0 - r * whole);
        for integrator in ["path", "bidirectional"] {
            for (z, want, place) in [(2.0, outside, "outside"), (0.0, centre, "at the centre")] {
                let got = seen(z, &rest, 20_000, seed as u32, integrator);
                check(got, want, &format!("{} {integrator} {place}", sheet.keys));
            }
        }
    }
}

/// Tests the radiance of a wall that is seen directly. A point light is at the sphere's centre, or on the far
/// side of the sphere.
#[test]
fn connections_to_points_of_light_through_filled_sheets() {
    for (seed, sheet) in SHEETS.iter().enumerate() {
        for (at, ways, faces) in [(0.0, 0.5, 1), (-1.0, 1.0, 2)] {
            // The camera is to the side of the sphere and points to the centre of the wall z = 1.
            let camera = Device::ray([1.5, 0.0, 0.5], DVec3::new(0.0, 0.0, 1.0));
            let rest = format!(
                "[materials]\nwall.diffuse.albedo = 0.5\n{}{}[[objects]]\nmaterial = \"wall\"\n\
                 shape.rectangle = {{ corner = [-0.01, -0.01, 1], u = [0, 0.02, 0], v = [0.02, 0, 0] }}\n\
                 [[emitters]]\nspot = {{ position = [0, 0, {at:?}], direction = [0, 0, 1], intensity = 3.0, cutoff_deg = 1, \
                 beam_deg = 1 }}\n",
                sheet.keys,
                sphere(&format!("absorption = {DEPTH:?}"))
            );
            let [t, u] = sheet.passes;
            let distance = 1.0 - at;
            let passed = (-DEPTH * ways).exp() * if faces == 1 { t } else { t * u };
            // Light that is reflected twice along the axis adds (r a)² to light from behind. A spot at the
            // sphere's centre has no light that is reflected twice, because a mirror image of the spot would
            // have to emit backwards.
            let r = sheet.reflects;
            let direct = 3.0 * passed / (distance * distance) * 0.5 / PI;
            for integrator in ["path", "bidirectional"] {
                let text = head(8000 * samples_factor(), if r > 0.0 { faces + 2 } else { 20 }, seed as u32)
                    + &format!("integrator = \"{integrator}\"\n")
                    + &camera.keys("camera")
                    + &rest
                    + SLICE;
                let rendered = render_text(&text);
                let got = [rendered.mean("m"), rendered.std_error("m")].map(|t| mueller(&t, &[]));
                check(got, direct, &format!("{} {integrator} light at {at}", sheet.keys));
            }
        }
    }
}

/// Tests that sheets without an effect act as the null boundary of a scattering medium.
#[test]
#[ignore = "slow: tools/check --all"]
fn sheets_without_effect_do_not_change_scattering_media() {
    let medium = "absorption = 0.4\nscattering = 3.0\nphase.henyey_greenstein = { g = 0.4, linear = 0.6, circular = 0.5 }";
    let lights = [
        "[[emitters]]\nenvironment.radiance = 1\n",
        "[[emitters]]\npoint = { position = [0.9, 0.3, 0.2], intensity = 3 }\n",
        "[[emitters]]\npoint = { position = [0.1, 0.1, 0.1], intensity = 3 }\n",
    ];
    let idle = [
        "s.retarder = { retardance_deg = 0, angle_deg = 30 }\n",
        "s.thin_dielectric.ior = 1.0\n",
        "a.null = {}\ns.blend = { a = \"a\", b = \"a\", weight = 0.5 }\n",
        "a.null = {}\ns.two_sided = { front = \"a\", back = \"a\" }\n",
    ];
    for (place, z) in [("outside", 2.0), ("inside", 0.2)] {
        for (l, light) in lights.iter().enumerate() {
            for integrator in ["path", "bidirectional"] {
                let scene = |keys: &str| format!("[materials]\n{keys}{}{light}", sphere(medium));
                let spp = 8_000;
                let [want, sigma] = seen(z, &scene("s.null = {}\n"), spp, 7, integrator);
                assert!(
                    sigma[(0, 0)] < 0.05 * want[(0, 0)],
                    "{place} light {l} {integrator}: too few samples, {} of {}",
                    sigma[(0, 0)],
                    want[(0, 0)]
                );
                for (seed, keys) in idle.iter().enumerate() {
                    let [got, error] = seen(z, &scene(keys), spp, 20 + seed as u32, integrator);
                    println!(
                        "{place} light {l} {integrator} {keys}: {:.5} ± {:.5}, null {:.5} ± {:.5}",
                        got[(0, 0)],
                        error[(0, 0)],
                        want[(0, 0)],
                        sigma[(0, 0)]
                    );
                    for i in 0..16 {
                        let bound = 5.0 * error[i].hypot(sigma[i]) + 1e-6;
                        assert!(
                            (got[i] - want[i]).abs() < bound,
                            "{place} light {l} {integrator} {keys}: element {i} {} is not {} within {bound}",
                            got[i],
                            want[i]
                        );
                    }
                }
            }
        }
    }
}

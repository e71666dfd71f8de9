//! White furnace: under constant radiance 1, the returned radiance is each material's directional albedo.

use crate::optics::{Device, head, mueller, of_image};
use crate::support::render_text;
use glam::DVec3;
use sunstone::tensor::axes::AxisKind::{StokesIn, StokesOut, X, Y};

const FURNACE: &str = "[[emitters]]\nenvironment = { radiance = 1 }\n\
    [[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";

fn sphere(material: &str, spp: u32, depth: u32) -> crate::support::Rendered {
    let camera = Device::look_at([0.0, 0.3, 3.0], DVec3::ZERO, [12, 12], 22.0);
    let text = head(spp, depth, 31)
        + &camera.keys("camera")
        + &format!("[materials.m]\n{material}\n[[objects]]\nmaterial = \"m\"\nshape.sphere.radius = 1\n")
        + FURNACE;
    render_text(&text)
}

/// Surfaces that return all light in one bounce vanish in the furnace, in every sample.
#[test]
fn lossless_opaque_spheres_vanish() {
    for material in ["diffuse.albedo = 1", "conductor = { n = 0.001, k = 100 }"] {
        let m = sphere(material, 32, 2).mean("m");
        for (x, y) in (0..12).flat_map(|y| (0..12).map(move |x| (x, y))) {
            let m = mueller(&m, &[(Y, y), (X, x)]);
            assert!((m[(0, 0)] - 1.0).abs() < 1e-5, "{material}: pixel {x} {y} returns {}", m[(0, 0)]);
        }
    }
}

/// So does glass, on average, and unpolarized light stays unpolarized.
#[test]
fn glass_sphere_vanishes() {
    let r = sphere("dielectric.ior = 1.5", 4000, 1000);
    let (mean, error) = (r.mean("m"), r.std_error("m"));
    // Multiple inner reflections are too rare for a single pixel's standard error; rows of 48,000 samples
    // have reliable ones.
    let mut total = [(0.0, 0.0); 4];
    for y in 0..12 {
        for (i, total) in total.iter_mut().enumerate() {
            let (mut off, mut variance) = (0.0, 0.0);
            for x in 0..12 {
                let at = [(Y, y), (X, x), (StokesOut, i), (StokesIn, 0)];
                off += f64::from(mean.at(&at)) - if i == 0 { 1.0 } else { 0.0 };
                variance += f64::from(error.at(&at)).powi(2);
            }
            let (off, sigma) = (off / 12.0, variance.sqrt() / 12.0);
            assert!(off.abs() <= 5.0 * sigma + 2e-6, "row {y}, s{i} is off by {off} ± {sigma:.1e}");
            *total = (total.0 + off / 12.0, total.1 + (sigma / 12.0).powi(2));
        }
    }
    for (i, (off, variance)) in total.into_iter().enumerate() {
        let sigma = variance.sqrt();
        assert!(off.abs() <= 5.0 * sigma + 2e-6, "s{i} of the whole sphere is off by {off} ± {sigma:.1e}");
        assert!(sigma < 1e-3);
    }
}

/// Spheres that lose or gain at most a small part of the light, whatever the number of inner reflections:
/// rough faces lose light between facets, and faces of split crystals are approximate to (n_e - n_o)².
#[test]
fn spheres_nearly_vanish() {
    let split = "axis = [0.5, -0.3, 0.8], split = true";
    for (material, spp, lost, gained) in [
        (
            "rough_dielectric = { ior = 1.5, alpha = 0.05, distribution = \"ggx\" }".to_owned(),
            2000,
            0.03,
            0.0,
        ),
        (
            "rough_dielectric = { ior = 1.5, alpha = 0.05, distribution = \"beckmann\" }".into(),
            2000,
            0.03,
            0.0,
        ),
        ("crystal = { n_o = 1.5, n_e = 1.6, axis = [1, 2, 2], roughness = 0.05 }".into(), 2000, 0.03, 0.0),
        (format!("crystal = {{ n_o = 1.546, n_e = 1.555, {split} }}"), 3000, 1e-4, 1e-4),
        (format!("crystal = {{ n_o = 1.66127, n_e = 1.4875, {split} }}"), 5000, 0.02, 0.02),
    ] {
        let camera = Device::look_at([0.0, 0.3, 3.0], DVec3::ZERO, [4, 4], 8.0);
        let text = head(spp, 1000, 31)
            + &camera.keys("camera")
            + &format!("[materials.m]\n{material}\n[[objects]]\nmaterial = \"m\"\nshape.sphere.radius = 1\n")
            + "[[emitters]]\nenvironment = { radiance = 1 }\n[[slices]]\nname = \"m\"\n";
        let (total, sigma) = of_image(&render_text(&text), "m", 1);
        let off = total - 1.0;
        assert!(
            off < gained + 5.0 * sigma && off > -lost - 5.0 * sigma,
            "{material}: off by {off} ± {sigma:.1e}"
        );
        assert!(sigma < 0.01, "{material}: ± {sigma}");
    }
}

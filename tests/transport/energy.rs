//! Tests materials in a white furnace. Under constant radiance 1, the returned radiance is the directional
//! albedo of the material.

use crate::optics::{Device, M, ggx_g2, head, mirror, mueller, of_image, plate, project};
use crate::support::render_text;
use glam::DVec3;
use nalgebra::Complex;
use std::f64::consts::PI;
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

/// Tests that surfaces that return all light in a single bounce are invisible in the white furnace, in every
/// sample.
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

/// Tests that a glass sphere is invisible in the furnace on average. Tests that unpolarized light stays
/// unpolarized.
#[test]
fn glass_sphere_vanishes() {
    let r = sphere("dielectric.ior = 1.5", 4000, 1000);
    let (mean, error) = (r.mean("m"), r.std_error("m"));
    // Multiple inner reflections are too rare for a reliable standard error of a single pixel. Rows of 48,000
    // samples have reliable standard errors.
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

/// Returns ∫ D G2 F / (4 cosθ_o) dω_i for all Stokes elements under unpolarized light. The function uses a
/// midpoint rule over facet slopes. With tan²θ_h = α² u / (1 - u), D cosθ_h dω_h = du dφ / 2π.
fn directional_albedo(wo: DVec3, right: DVec3, eta: Complex<f64>, alpha: f64) -> [f64; 4] {
    const U: u32 = 600;
    const PHI: u32 = 400;
    let x_out = project(right, wo);
    let mut sum = [0.0; 4];
    for k in 0..U * PHI {
        let u = (f64::from(k / PHI) + 0.5) / f64::from(U);
        let phi = 2.0 * PI * (f64::from(k % PHI) + 0.5) / f64::from(PHI);
        let tan2 = alpha * alpha * u / (1.0 - u);
        let cos_h = 1.0 / (1.0 + tan2).sqrt();
        let sin_h = (1.0 - cos_h * cos_h).sqrt();
        let h = DVec3::new(sin_h * phi.cos(), sin_h * phi.sin(), cos_h);
        let oh = wo.dot(h);
        let wi = h * (2.0 * oh) - wo;
        if oh <= 0.0 || wi.z <= 0.0 {
            continue;
        }
        let weight = ggx_g2(wo.z, wi.z, alpha) * oh / (wo.z * cos_h) / f64::from(U * PHI);
        let m: M = mirror(-wi, project(DVec3::Y, wi), wo, x_out, eta);
        for (i, s) in sum.iter_mut().enumerate() {
            *s += m[(i, 0)] * weight;
        }
    }
    sum
}

/// Tests that rough gold and a lossless rough conductor return their directional albedos, at three angles and
/// for three roughnesses.
#[test]
#[ignore = "slow: tools/check --all"]
fn rough_conductor_returns_its_directional_albedo() {
    for (n, k) in [(0.4242, 2.4721), (0.001, 100.0)] {
        for alpha in [0.1, 0.4, 0.9] {
            for degrees in [10.0_f64, 50.0, 78.0] {
                let (s, c) = degrees.to_radians().sin_cos();
                let wo = DVec3::new(s * 0.8, s * 0.6, c);
                let camera = Device::ray((wo * 2.0).to_array(), DVec3::ZERO).rolled(0.5);
                let text = head(40_000, 2, 32)
                    + &camera.keys("camera")
                    + &format!("[materials]\nm.rough_conductor = {{ n = {n}, k = {k}, alpha = {alpha} }}\n")
                    + &plate(DVec3::ZERO, DVec3::Z, 1.0, "m")
                    + FURNACE;
                let r = render_text(&text);
                let (mean, error) = (r.mean("m"), r.std_error("m"));
                let want = directional_albedo(wo, camera.right, Complex::new(n, k), alpha);
                for (i, want) in want.iter().enumerate() {
                    let at = [(StokesOut, i), (StokesIn, 0)];
                    let (got, sigma) = (f64::from(mean.at(&at)), f64::from(error.at(&at)));
                    // The error of the midpoint rule at the horizon is 3e-5.
                    assert!(
                        (got - want).abs() <= 5.0 * sigma + 3e-5,
                        "n {n}, alpha {alpha}, {degrees}°, s{i}: {got} is not {want} ± {sigma:.1e}"
                    );
                    assert!(sigma < 5e-3);
                    if i == 0 {
                        assert!(got <= 1.0 + 5.0 * sigma + 1e-6, "energy is made");
                    }
                }
            }
        }
    }
}

/// Tests that spheres with a small loss or gain of light are nearly invisible, for any number of inner
/// reflections. Rough faces lose light that is reflected between facets. The model of the faces of split
/// crystals is accurate to the order (n_e - n_o)².
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
        assert!(sigma < 0.006, "{material}: ± {sigma}");
    }
}

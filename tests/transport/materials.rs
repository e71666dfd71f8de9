//! Materials by themselves: samplers follow their densities, weights are values over densities, and light may run
//! backwards.

use crate::optics::{M, turn};
use glam::{DVec3, Mat3A, Vec3A};
use std::f64::consts::TAU;
use sunstone::geometry::ray::Surface;
use sunstone::material::diffuse::Diffuse;
use sunstone::material::facets::Roughness;
use sunstone::material::rough_conductor::RoughConductor;
use sunstone::material::texture::{Scalar, Spectrum};
use sunstone::material::{Lanes, Material, Materials};
use sunstone::polarization::chain::Scatter;
use sunstone::sampling::microfacet::{Distribution, Masking};
use sunstone::sampling::stream::Stream;
use sunstone::spectrum::Spectral;

/// A table of one material, which has number 0.
fn table(material: Material) -> Materials {
    Materials {
        list: vec![material],
        ..Materials::default()
    }
}

fn rough(alpha: f32) -> Materials {
    table(Material::RoughConductor(RoughConductor {
        n: Spectral::new([0.4242, 1.5, 0.2, 2.0]),
        k: Spectral::new([2.4721, 1.9, 3.1, 0.5]),
        roughness: Roughness {
            distribution: Distribution::Ggx,
            masking: Masking::Correlated,
            alpha: Scalar::uniform(alpha),
        },
    }))
}

fn diffuse() -> Materials {
    table(Material::Diffuse(Diffuse {
        albedo: Spectrum::uniform(Spectral::new([0.9, 0.5, 0.2, 0.1])),
    }))
}

/// A frame in general position: columns x, y, normal.
fn axes() -> Mat3A {
    Mat3A::from_rotation_y(0.7) * Mat3A::from_rotation_x(-1.1) * Mat3A::from_rotation_z(0.3)
}

fn surface() -> Surface {
    let n = axes().z_axis;
    Surface {
        p: Vec3A::ZERO,
        ng: n,
        ns: n,
        tangent: axes().x_axis,
        uv: [0.0; 2],
        material: 0,
    }
}

/// A direction of given cosine to the normal and azimuth.
fn toward(cos: f32, phi: f32) -> Vec3A {
    let s = (1.0 - cos * cos).sqrt();
    axes() * Vec3A::new(s * phi.cos(), s * phi.sin(), cos)
}

/// Every material and angle that the tests below go through.
fn cases() -> Vec<(String, Materials, f32)> {
    let mut list = vec![];
    for cos in [1.0_f32, 0.6, 0.2, 0.05] {
        list.push((format!("diffuse, cos {cos}"), diffuse(), cos));
        for alpha in [0.1_f32, 0.3, 0.6, 1.0] {
            list.push((format!("rough {alpha}, cos {cos}"), rough(alpha), cos));
        }
    }
    list
}

/// Pearson's chi² of 10⁵ samples on a 20 × 40 grid over the hemisphere, absorbed samples in a cell of their own.
#[test]
fn samples_follow_their_density() {
    const N: usize = 100_000;
    const ROWS: usize = 20;
    const COLUMNS: usize = 40;
    const SUB: usize = 32;
    for (case, (name, materials, cos)) in cases().into_iter().enumerate() {
        let (at, wo, back) = (surface(), toward(cos, 0.4), axes().transpose());
        let mut observed = vec![0.0_f64; ROWS * COLUMNS + 1];
        let mut stream = Stream::new(41, case as u32, 0);
        for _ in 0..N {
            let mut lanes = Lanes::first(4);
            let sampled = materials.sample(0, &at, wo, &mut lanes, &mut stream);
            let cell = sampled.map_or(ROWS * COLUMNS, |s| {
                let w = back * s.wi;
                assert!(
                    (w.length() - 1.0).abs() < 1e-4 && w.z >= 0.0 && !s.delta,
                    "{name}: {w}"
                );
                let row = ((w.z * ROWS as f32) as usize).min(ROWS - 1);
                let turn = (f64::from(w.y).atan2(f64::from(w.x)) / TAU).rem_euclid(1.0);
                row * COLUMNS + ((turn * COLUMNS as f64) as usize).min(COLUMNS - 1)
            });
            observed[cell] += 1.0;
        }
        // Expected counts by a midpoint rule per cell; dω = dcosθ dφ.
        let area = TAU / (ROWS * COLUMNS * SUB * SUB) as f64;
        let mut expected: Vec<f64> = (0..ROWS * COLUMNS)
            .map(|cell| {
                let (row, column) = ((cell / COLUMNS) as f32, (cell % COLUMNS) as f32);
                let sum: f64 = (0..SUB * SUB)
                    .map(|k| {
                        let step = |i: usize| (i as f32 + 0.5) / SUB as f32;
                        let z = (row + step(k / SUB)) / ROWS as f32;
                        let phi = (column + step(k % SUB)) / COLUMNS as f32 * TAU as f32;
                        f64::from(materials.pdf(0, &at, wo, toward(z, phi)))
                    })
                    .sum();
                sum * area * N as f64
            })
            .collect();
        let inside: f64 = expected.iter().sum();
        assert!(
            inside < N as f64 * 1.003,
            "{name}: density integrates to {}",
            inside / N as f64
        );
        expected.push((N as f64 - inside).max(0.0));
        let (mut chi, mut dof, mut faint) = (0.0, 0.0, [0.0; 2]);
        for (o, e) in observed.iter().zip(&expected) {
            if *e < 10.0 {
                faint[0] += o;
                faint[1] += e;
            } else {
                chi += (o - e).powi(2) / e;
                dof += 1.0;
            }
        }
        let [o, e] = faint;
        assert!(
            (o - e).abs() < 5.0 * e.sqrt() + 10.0,
            "{name}: {o} samples where {e} belong"
        );
        // Wilson–Hilferty: (χ²/k)^(1/3) is nearly normal.
        let z = ((chi / dof).cbrt() - (1.0 - 2.0 / (9.0 * dof))) / (2.0 / (9.0 * dof)).sqrt();
        assert!(
            z < 5.0,
            "{name}: chi² = {chi} on {dof} degrees of freedom, z = {z}"
        );
    }
}

/// a, b, c, d of the lanes of an interaction, and its s vector; a depolarizer has `a` alone.
fn elements(s: &Scatter) -> ([[f32; 4]; 4], Vec3A) {
    match s {
        Scatter::Depolarize(f) => ([f.to_array(), [0.0; 4], [0.0; 4], [0.0; 4]], Vec3A::ZERO),
        Scatter::Fresnel { block: f, s } => ([f.a, f.b, f.c, f.d].map(|e| e.to_array()), *s),
        Scatter::Full { .. } => panic!("none of these materials is as general as that"),
    }
}

/// Sampled weight = eval / pdf in all elements and lanes.
#[test]
fn weights_are_values_over_densities() {
    for (case, (name, materials, cos)) in cases().into_iter().enumerate() {
        let (at, wo) = (surface(), toward(cos, -1.0));
        let mut stream = Stream::new(42, case as u32, 0);
        let mut compared = 0;
        for _ in 0..2000 {
            let mut lanes = Lanes::first(4);
            let Some(sampled) = materials.sample(0, &at, wo, &mut lanes, &mut stream) else {
                continue;
            };
            // At the very horizon f32 directions do not fix the cosine to 1e-4.
            if at.ns.dot(sampled.wi) < 2e-3 {
                continue;
            }
            let pdf = materials.pdf(0, &at, wo, sampled.wi);
            let value = materials
                .eval(0, &at, wo, sampled.wi)
                .expect("a sampled direction has a value");
            let ((got, s), (want, t)) = (
                elements(&sampled.scatter),
                elements(&value.scaled(Spectral::splat(1.0 / pdf))),
            );
            for lane in 0..4 {
                for element in 0..4 {
                    let (g, w) = (got[element][lane], want[element][lane]);
                    assert!(
                        (g - w).abs() <= 1e-4 * want[0][lane],
                        "{name}, lane {lane}, element {element}: {g} is not {w} at wi {}",
                        sampled.wi
                    );
                }
            }
            // The s vector is a polarization axis: its sign has no meaning. Near normal incidence it has no direction.
            if s != Vec3A::ZERO && s.dot(t).abs() < 0.999 {
                assert!(
                    wo.cross(sampled.wi).length() < 1e-2,
                    "{name}: s vectors {s} and {t}"
                );
            }
            compared += 1;
        }
        assert!(compared > 500, "{name}: only {compared} samples");
    }
}

/// Helmholtz reciprocity of Mueller matrices: with the same axes for a ray and its reverse, M(o→i) = Δ M(i→o)ᵀ Δ with
/// Δ = diag(1, 1, -1, 1), because reversing a ray mirrors ±45° and keeps handedness.
#[test]
fn rough_conductor_is_reciprocal() {
    let at = surface();
    let delta = M::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, 1.0));
    let mut stream = Stream::new(43, 0, 0);
    let mut strongest = 0.0_f64;
    for case in 0..2000 {
        let alpha = [0.1, 0.3, 0.8][case % 3];
        let mut draw = || {
            let [u, v] = stream.uniform2();
            (toward(0.05 + 0.95 * u, v * TAU as f32), v)
        };
        let ((a, ta), (b, tb)) = (draw(), draw());
        // An arbitrary axis across each ray, the same in both directions of travel.
        let axis = |d: DVec3, t: f32| {
            let x = d.any_orthonormal_vector();
            x * f64::from(3.0 * t).cos() + d.cross(x) * f64::from(3.0 * t).sin()
        };
        let (da, db) = (a.as_dvec3().normalize(), b.as_dvec3().normalize());
        let (xa, xb) = (axis(da, ta), axis(db, tb));
        let brdf = |o: Vec3A, i: Vec3A, xo: DVec3, xi: DVec3| {
            let value = rough(alpha).eval(0, &at, o, i).unwrap();
            let (e, s) = elements(&value.scaled(Spectral::splat(1.0 / at.ns.dot(i))));
            let [a, b, c, d] = e.map(|lanes| f64::from(lanes[0]));
            let block = M::new(a, b, 0., 0., b, a, 0., 0., 0., 0., c, d, 0., 0., -d, c);
            let s = s.as_dvec3();
            turn(o.as_dvec3(), s, xo) * block * turn(-i.as_dvec3(), xi, s)
        };
        let forth = brdf(a, b, xa, xb);
        let back = brdf(b, a, xb, xa);
        let want = delta * forth.transpose() * delta;
        let scale = want[(0, 0)].max(1e-12);
        let off = (back - want).abs().max() / scale;
        assert!(
            off < 2e-4,
            "alpha {alpha}, {a} and {b}: off by {off}\n{back}\n{want}"
        );
        // Without Δ the law would not hold.
        strongest = strongest.max((back - forth.transpose()).abs().max() / scale);
    }
    assert!(strongest > 0.1, "no case in which the sign flip matters");
}

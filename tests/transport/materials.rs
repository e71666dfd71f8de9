//! Tests single materials. Samplers must follow their densities, weights must be values divided by densities,
//! and light paths must be reversible.

use crate::optics::{M, surface_at, turn};
use glam::{DVec3, Mat3A, Vec3A};
use std::f64::consts::TAU;
use sunstone::optics::polarization::frame::perpendicular;
use sunstone::optics::polarization::scatter::Scatter;
use sunstone::optics::sampling::microfacet::{Distribution, Masking};
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::spectrum::Spectral;
use sunstone::transport::geometry::ray::Surface;
use sunstone::transport::material::diffuse::Diffuse;
use sunstone::transport::material::facets::Roughness;
use sunstone::transport::material::rough_conductor::RoughConductor;
use sunstone::transport::material::texture::{Scalar, Spectrum};
use sunstone::transport::material::{Lanes, Material, Materials};

/// Returns a table of a single material, which has index 0.
pub fn table(material: Material) -> Materials {
    Materials { list: vec![material], ..Materials::default() }
}

fn rough(alpha: f32) -> Materials {
    table(Material::RoughConductor(RoughConductor {
        n: Spectral::new([0.4242, 1.5, 0.2, 2.0]),
        k: Spectral::new([2.4721, 1.9, 3.1, 0.5]),
        reflectance: Spectrum::uniform(Spectral::new([1.0, 0.9, 0.5, 0.2])),
        roughness: Roughness {
            distribution: Distribution::Ggx,
            masking: Masking::Correlated,
            alpha: Scalar::uniform(alpha),
        },
    }))
}

fn diffuse() -> Materials {
    table(Material::Diffuse(Diffuse { albedo: Spectrum::uniform(Spectral::new([0.9, 0.5, 0.2, 0.1])) }))
}

/// Returns a frame in general position, with the columns x, y and normal.
pub fn axes() -> Mat3A {
    Mat3A::from_rotation_y(0.7) * Mat3A::from_rotation_x(-1.1) * Mat3A::from_rotation_z(0.3)
}

pub fn surface() -> Surface {
    let n = axes().z_axis;
    surface_at(n, axes().x_axis, [0.0; 2])
}

/// Returns a direction with the given cosine to the normal and the given azimuth.
pub fn toward(cos: f32, phi: f32) -> Vec3A {
    let s = (1.0 - cos * cos).sqrt();
    axes() * Vec3A::new(s * phi.cos(), s * phi.sin(), cos)
}

/// Returns every material and angle that the tests in this file cover.
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

/// Returns Pearson's chi² of 10⁵ samples on a 40 × 40 grid over the sphere. Absorbed samples have a separate
/// cell. A midpoint rule of `sub`² points per cell gives the expected counts.
///
/// The grid's pole is in the surface plane. Lobes about the normal therefore cover many cells, and the
/// horizon coincides with cell borders.
pub fn follow_density(name: &str, materials: &Materials, wo: Vec3A, seed: u32, sub: usize) {
    const N: usize = 100_000;
    const ROWS: usize = 40;
    const COLUMNS: usize = 40;
    let at = surface();
    let grid = Mat3A::from_cols(axes().y_axis, axes().z_axis, axes().x_axis);
    let mut observed = vec![0.0_f64; ROWS * COLUMNS + 1];
    let mut stream = Stream::new(41, seed, 0);
    for _ in 0..N {
        let mut lanes = Lanes::first(4);
        let sampled = materials.sample(0, &at, wo, &mut lanes, &mut stream);
        let cell = sampled.map_or(ROWS * COLUMNS, |s| {
            assert!((s.wi.length() - 1.0).abs() < 1e-4 && !s.delta, "{name}: {}", s.wi);
            let w = grid.transpose() * s.wi;
            let row = (((w.z + 1.0) / 2.0 * ROWS as f32) as usize).min(ROWS - 1);
            let turn = (f64::from(w.y).atan2(f64::from(w.x)) / TAU).rem_euclid(1.0);
            row * COLUMNS + ((turn * COLUMNS as f64) as usize).min(COLUMNS - 1)
        });
        observed[cell] += 1.0;
    }
    // The grid uses dω = dcosθ dφ.
    let area = 2.0 * TAU / (ROWS * COLUMNS * sub * sub) as f64;
    let step = |i: usize| (i as f32 + 0.5) / sub as f32;
    let mut expected: Vec<f64> = (0..ROWS * COLUMNS)
        .map(|cell| {
            let (row, column) = ((cell / COLUMNS) as f32, (cell % COLUMNS) as f32);
            let mut sum = 0.0;
            for i in 0..sub {
                let z = -1.0 + 2.0 * (row + step(i)) / ROWS as f32;
                let r = (1.0 - z * z).sqrt();
                for j in 0..sub {
                    let phi = (column + step(j)) / COLUMNS as f32 * TAU as f32;
                    let wi = grid * Vec3A::new(r * phi.cos(), r * phi.sin(), z);
                    sum += f64::from(materials.pdf(0, &at, wo, wi));
                }
            }
            sum * area * N as f64
        })
        .collect();
    let inside: f64 = expected.iter().sum();
    assert!(inside < N as f64 * 1.003, "{name}: density integrates to {}", inside / N as f64);
    expected.push((N as f64 - inside).max(0.0));
    pearson(name, &observed, &expected);
}

/// Checks that Pearson's chi² of counts is at most 5 standard deviations above its mean. Small cells are
/// pooled.
pub fn pearson(name: &str, observed: &[f64], expected: &[f64]) {
    let (mut chi, mut dof, mut faint) = (0.0, 0.0, [0.0; 2]);
    for (o, e) in observed.iter().zip(expected) {
        if *e < 10.0 {
            faint[0] += o;
            faint[1] += e;
        } else {
            chi += (o - e).powi(2) / e;
            dof += 1.0;
        }
    }
    let [o, e] = faint;
    assert!((o - e).abs() < 5.0 * e.sqrt() + 10.0, "{name}: {o} samples where {e} belong");
    // By Wilson and Hilferty, (χ²/k)^(1/3) is nearly normal.
    let z = ((chi / dof).cbrt() - (1.0 - 2.0 / (9.0 * dof))) / (2.0 / (9.0 * dof)).sqrt();
    assert!(z < 5.0, "{name}: chi² = {chi} on {dof} degrees of freedom, z = {z}");
}

#[test]
#[ignore = "slow: tools/check --all"]
fn samples_follow_their_density() {
    for (case, (name, materials, cos)) in cases().into_iter().enumerate() {
        follow_density(&name, &materials, toward(cos, 1.4), case as u32, 24);
    }
}

/// Returns all elements and lanes (wavelengths) of an interaction between fixed frames.
pub fn elements(s: &Scatter, wo: Vec3A, wi: Vec3A) -> [[f32; 16]; 4] {
    let m = s.between(wo, perpendicular(wo), wi, perpendicular(wi));
    std::array::from_fn(|lane| std::array::from_fn(|e| m.m[e / 4][e % 4].to_array()[lane]))
}

/// Checks that the sampled weight equals eval / pdf in all elements and lanes, to `tolerance` times M00.
/// Returns the number of compared samples.
pub fn weights_agree(name: &str, materials: &Materials, wo: Vec3A, seed: u32, tolerance: f32) -> u32 {
    let at = surface();
    let mut stream = Stream::new(42, seed, 0);
    let mut compared = 0;
    for _ in 0..2000 {
        let mut lanes = Lanes::first(4);
        let Some(sampled) = materials.sample(0, &at, wo, &mut lanes, &mut stream) else {
            continue;
        };
        let wi = sampled.wi;
        // At the horizon, f32 directions do not determine the cosine to within 1e-4.
        if at.ns.dot(wi).abs() < 2e-3 {
            continue;
        }
        let pdf = materials.pdf(0, &at, wo, wi);
        let value =
            materials.eval(0, &at, wo, wi).unwrap_or_else(|| panic!("{name}: sampled {wi} has no value"));
        let got = elements(&sampled.scatter, wo, wi);
        let want = elements(&value.scaled(Spectral::splat(1.0 / pdf)), wo, wi);
        for (lane, (got, want)) in got.iter().zip(&want).enumerate() {
            for (e, (g, w)) in got.iter().zip(want).enumerate() {
                assert!(
                    (g - w).abs() <= tolerance * want[0],
                    "{name}, lane {lane}, element {}{}: {g} is not {w} at wi {wi}",
                    e / 4,
                    e % 4
                );
            }
        }
        compared += 1;
    }
    compared
}

#[test]
fn weights_are_values_over_densities() {
    for (case, (name, materials, cos)) in cases().into_iter().enumerate() {
        let compared = weights_agree(&name, &materials, toward(cos, -1.0), case as u32, 1e-4);
        assert!(compared > 500, "{name}: only {compared} samples");
    }
}

/// Returns the BSDF of lane 0, without the cosine, between the axes `xo` and `xi`. The function computes the
/// BSDF in f64 from the interaction's own frames.
pub fn bsdf(materials: &Materials, o: Vec3A, i: Vec3A, [xo, xi]: [DVec3; 2]) -> Option<M> {
    let at = surface();
    let s = materials.eval(0, &at, o, i)?;
    let (fo, fi) = match &s {
        Scatter::Depolarize(_) => (o.any_orthonormal_vector(), i.any_orthonormal_vector()),
        Scatter::Fresnel { s, .. } => (*s, *s),
        Scatter::Full { frame_out, frame_in, .. } => (*frame_out, *frame_in),
    };
    let m = s.between(o, fo, i, fi).lane(0);
    let m = M::from_fn(|r, c| f64::from(m[r][c])) / f64::from(at.ns.dot(i).abs());
    Some(turn(o.as_dvec3(), fo.as_dvec3(), xo) * m * turn(-i.as_dvec3(), xi, fi.as_dvec3()))
}

/// Checks Helmholtz reciprocity of Mueller matrices. With the same axes for a ray and its reverse, M(o→i) = Δ
/// M(i→o)ᵀ Δ with Δ = diag(1, 1, -1, 1). The signs of Δ follow because reversing a ray mirrors ±45° and keeps
/// handedness.
///
/// `index` returns the refractive index on a direction's side. For radiance, the BSDF divided by the squared
/// index of the outgoing side is reciprocal (Veach 1997, eq. 5.14).
///
/// The function uses 700 pairs of directions from `pair`. Returns the number of pairs for which the BSDF has
/// a value.
pub fn is_reciprocal(
    name: &str,
    materials: &Materials,
    index: impl Fn(Vec3A) -> f64,
    pair: impl Fn(&mut Stream) -> [Vec3A; 2],
    tolerance: f64,
) -> u32 {
    let value = |a, b, axes| Some(bsdf(materials, a, b, axes)? / index(a).powi(2));
    let (pairs, strongest) = reciprocal(name, value, pair, tolerance);
    assert!(strongest > 0.01, "{name}: no case in which the sign flip matters");
    pairs
}

/// Tests reciprocity for the matrices that `value` returns for given axes. Also returns the largest effect of
/// the sign change in Δ, divided by M00.
pub fn reciprocal(
    name: &str,
    value: impl Fn(Vec3A, Vec3A, [DVec3; 2]) -> Option<M>,
    pair: impl Fn(&mut Stream) -> [Vec3A; 2],
    tolerance: f64,
) -> (u32, f64) {
    let delta = M::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, 1.0));
    let mut stream = Stream::new(43, 0, 0);
    let (mut strongest, mut pairs) = (0.0_f64, 0);
    for _ in 0..700 {
        let [a, b] = pair(&mut stream);
        // Selects an arbitrary axis perpendicular to each ray, equal in each direction of travel.
        let mut axis = |d: Vec3A| {
            let (d, t) = (d.as_dvec3().normalize(), f64::from(stream.uniform()) * TAU);
            let x = d.any_orthonormal_vector();
            x * t.cos() + d.cross(x) * t.sin()
        };
        let (xa, xb) = (axis(a), axis(b));
        let (forth, back) = match (value(a, b, [xa, xb]), value(b, a, [xb, xa])) {
            (Some(forth), Some(back)) => (forth, back),
            (None, None) => continue,
            _ => panic!("{name}: only one way between {a} and {b}"),
        };
        let want = delta * forth.transpose() * delta;
        let scale = want[(0, 0)].max(1e-12);
        let off = (back - want).abs().max() / scale;
        assert!(off < tolerance, "{name}, {a} and {b}: off by {off}\n{back}\n{want}");
        strongest = strongest.max((back - forth.transpose()).abs().max() / scale);
        pairs += 1;
    }
    (pairs, strongest)
}

/// Returns two directions on the front side, at least 3° above the horizon.
pub fn pair_in_front(stream: &mut Stream) -> [Vec3A; 2] {
    std::array::from_fn(|_| {
        let [u, v] = stream.uniform2();
        toward(0.05 + 0.95 * u, v * TAU as f32)
    })
}

#[test]
fn rough_conductor_is_reciprocal() {
    for alpha in [0.1, 0.3, 0.8] {
        let pairs = is_reciprocal("conductor", &rough(alpha), |_| 1.0, pair_in_front, 2e-4);
        assert_eq!(pairs, 700);
    }
}

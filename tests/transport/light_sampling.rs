//! Chi-squared tests of the light sampling routines against their densities.

use glam::{Mat3A, Quat, Vec2, Vec3A};
use std::f32::consts::{PI, TAU};
use sunstone::optics::sampling::stream::Stream;
use sunstone::transport::light::filter::Polarized;
use sunstone::transport::light::profile::{Frustum, Profile};
use sunstone::transport::light::sky::{Rows, Sky};

const ROWS: usize = 16;
const COLUMNS: usize = 32;

/// Compares 2^18 samples with the density on a grid in (z, φ). Returns the deviation of Pearson's chi² from
/// its mean, in standard deviations, and the integral of the density.
fn chi2(sample: impl Fn([f32; 2]) -> Vec3A, density: impl Fn(Vec3A) -> f32) -> (f64, f64) {
    const N: usize = 1 << 18;
    const SUB: usize = 48;
    let mut observed = vec![0.0_f64; ROWS * COLUMNS];
    let mut stream = Stream::new(3, 0, 0);
    for _ in 0..N {
        let w = sample(stream.uniform2());
        assert!((w.length() - 1.0).abs() < 1e-4);
        let row = (((w.z + 1.0) / 2.0 * ROWS as f32) as usize).min(ROWS - 1);
        let turn = (w.y.atan2(w.x) / TAU).rem_euclid(1.0);
        observed[row * COLUMNS + ((turn * COLUMNS as f32) as usize).min(COLUMNS - 1)] += 1.0;
    }
    let (mut chi, mut cells, mut total) = (0.0, 0.0_f64, 0.0);
    for (cell, o) in observed.iter().enumerate() {
        let mut e = 0.0_f64;
        for k in 0..SUB * SUB {
            let at = |i: usize, n: usize, of: usize| (n as f32 + (i as f32 + 0.5) / SUB as f32) / of as f32;
            let z = 2.0 * at(k / SUB, cell / COLUMNS, ROWS) - 1.0;
            let phi = TAU * at(k % SUB, cell % COLUMNS, COLUMNS);
            let r = (1.0 - z * z).sqrt();
            e += f64::from(density(Vec3A::new(r * phi.cos(), r * phi.sin(), z)));
        }
        e *= 4.0 * std::f64::consts::PI / (ROWS * COLUMNS * SUB * SUB) as f64;
        total += e;
        let e = e * N as f64;
        if e >= 10.0 {
            chi += (o - e).powi(2) / e;
            cells += 1.0;
        } else if *o > e + 5.0 * e.sqrt() + 5.0 {
            return (f64::INFINITY, total);
        }
    }
    // By Wilson and Hilferty, (χ²/k)^(1/3) is nearly normal.
    let z = ((chi / cells).cbrt() - (1.0 - 2.0 / (9.0 * cells))) / (2.0 / (9.0 * cells)).sqrt();
    (z, total)
}

fn agree(sample: impl Fn([f32; 2]) -> Vec3A, density: impl Fn(Vec3A) -> f32, what: &str) {
    let (z, total) = chi2(&sample, &density);
    assert!(z < 5.0 && (total - 1.0).abs() < 0.005, "{what}: z = {z:.1}, density of {total} in all");
    // Negative control: the test must detect a rotation of a tenth of the samples by 3 degrees.
    let turned = Quat::from_rotation_y(0.05);
    let (z, _) = chi2(
        |u| {
            let w = sample(u);
            if (u[0] * 1000.0).fract() < 0.1 { turned * w } else { w }
        },
        &density,
    );
    assert!(z > 5.0, "{what}: a planted error is not seen, z = {z:.1}");
}

fn environment([w, h]: [usize; 2], value: impl Fn(usize, usize) -> f32, rows: Rows, to_world: Mat3A) -> Sky {
    let light = Polarized { axis: Vec3A::X, filter: None };
    let texels = (0..w * h).map(|k| {
        let v = value(k % w, k / w);
        [v, 0.5 * v, 0.0, 0.0]
    });
    Sky::new([w, h], texels.collect(), rows, to_world, light).expect("not black")
}

/// Tests the sampling of an image with a dark half, a bright spot and a gradient. The image is rotated and
/// mirrored.
#[test]
fn chi2_sky() {
    let value = |i: usize, j: usize| match (i, j) {
        (5, 4) => 30.0,
        (0..=10, _) => 0.0,
        _ => 1.0 + j as f32,
    };
    let rotated = Mat3A::from_quat(Quat::from_euler(glam::EulerRot::XYZ, 0.4, 1.1, -0.3));
    let mirrored = rotated * Mat3A::from_diagonal(glam::Vec3::new(1.0, -1.0, 1.0));
    for (rows, to_world) in [(Rows::Centres, rotated), (Rows::Centres, mirrored), (Rows::Poles, rotated)] {
        let sky = environment([24, 12], value, rows, to_world);
        agree(|u| sky.sample(u), |d| sky.density(d), &format!("{rows:?} {to_world}"));
    }
}

/// Tests a single lit texel of value 1 in an image of w × h texels whose rows extend from pole to pole. The
/// peak is 1, and the flux is that of a tent function over the adjacent texels.
///
/// With Δ = π/(h - 1) and the texel's polar angle θ, the flux is 2π/w times a factor. The factor is
/// sinθ 2(1 - cosΔ)/Δ, or 1 - sinΔ/Δ at a pole.
#[test]
fn a_lit_texel_keeps_its_peak_and_its_flux() {
    let to_world = Mat3A::from_quat(Quat::from_euler(glam::EulerRot::XYZ, 0.4, 1.1, -0.3));
    for ([w, h], lit) in [
        ([8, 5], [3, 2]),
        ([8, 5], [0, 1]),
        ([8, 5], [7, 0]),
        ([7, 4], [6, 3]),
        ([64, 33], [20, 9]),
        ([2, 3], [1, 1]),
    ] {
        let value = |i, j| f32::from(u8::from([i, j] == lit));
        let sky = environment([w, h], value, Rows::Poles, to_world);
        let step = PI / (h - 1) as f32;
        let (theta, phi) = (lit[1] as f32 * step, std::f32::consts::TAU * (lit[0] as f32 + 0.5) / w as f32);
        let dir = Vec3A::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos());
        let peak = sky.radiance(to_world * dir).to_array()[0];
        // At a pole, rounding determines the column of the texel.
        if lit[1] != 0 && lit[1] != h - 1 {
            assert!((peak - 1.0).abs() < 1e-3, "{w} x {h}, {lit:?}: peak {peak}");
        }
        let tent = if lit[1] == 0 || lit[1] == h - 1 {
            1.0 - step.sin() / step
        } else {
            theta.sin() * 2.0 * (1.0 - step.cos()) / step
        };
        let want = f64::from(std::f32::consts::TAU / w as f32 * tent);
        let (mut sum, mut squares) = (0.0, 0.0);
        let n = 300;
        for k in 0..n * n {
            let u = [(k % n) as f32 + 0.5, (k / n) as f32 + 0.5].map(|v| v / n as f32);
            let d = sky.sample(u);
            let f = f64::from(sky.radiance(d).to_array()[0] / sky.density(d));
            sum += f;
            squares += f * f;
        }
        let mean = sum / f64::from(n * n);
        // A regular grid is more accurate than the same number of random samples.
        let sigma = ((squares / f64::from(n * n) - mean * mean) / f64::from(n * n)).sqrt();
        assert!(
            (mean - want).abs() < 5.0 * sigma && sigma < 0.01 * want,
            "{w} x {h}, {lit:?}: flux {mean} ± {sigma}, closed form {want}"
        );
    }
}

#[test]
fn chi2_spot() {
    let spot = Profile::Spot {
        axis: Vec3A::Z,
        beam: 0.2,
        // The cutoff angle is between two rows of the grid.
        cutoff: PI / 3.0,
    };
    agree(|u| spot.sample(u), |d| spot.density(d), "spot");
}

/// Returns a wide, tilted frustum.
fn frustum() -> Profile {
    let z = Vec3A::new(0.2, -0.6, 1.0).normalize();
    let x = z.cross(Vec3A::X).normalize();
    Profile::Frustum(Frustum {
        to_local: Mat3A::from_cols(x, z.cross(x), z).transpose(),
        half: Vec2::new(0.9, 0.5),
    })
}

#[test]
fn chi2_frustum() {
    let frustum = frustum();
    agree(|u| frustum.sample(u), |d| frustum.density(d), "frustum");
}

/// Tests that the integral of 1/cos³ over the directions of a frustum is the rectangle's area at 1 m.
#[test]
fn a_frustum_has_its_solid_angle() {
    let got = frustum().solid_angle();
    assert!((got / (4.0 * 0.9 * 0.5) - 1.0).abs() < 1e-5, "{got}");
}

/// Tests the relative intensity of a spot, integrated over all directions. With the beam angle b, the closed
/// form is 2π (1 - cos b) plus the integral of the falling part of the profile.
#[test]
fn a_spot_has_its_solid_angle() {
    let (beam, cutoff) = (0.3_f32, 0.9_f32);
    let spot = Profile::Spot { axis: Vec3A::new(0.0, 0.6, 0.8), beam, cutoff };
    let (b, c) = (f64::from(beam), f64::from(cutoff));
    // By parts, ∫ (c - θ)/(c - b) sinθ dθ from b to c is cos b - (sin c - sin b)/(c - b).
    let want = std::f64::consts::TAU * (1.0 - b.cos() + b.cos() - (c.sin() - b.sin()) / (c - b));
    let got = f64::from(spot.solid_angle());
    assert!((got / want - 1.0).abs() < 2e-3, "{got} sr, closed form {want}");
}

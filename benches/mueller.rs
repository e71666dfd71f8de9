//! Measures products of Mueller matrices: chains of plain 4×4 matrices, block chains of the tracer, and
//! Fresnel matrices.

use criterion::{Criterion, criterion_group, criterion_main};
use glam::Vec3A;
use std::hint::black_box;
use sunstone::optics::polarization::chain::Chain;
use sunstone::optics::polarization::fresnel;
use sunstone::optics::polarization::mueller::Mueller;
use sunstone::optics::polarization::scatter::Scatter;
use sunstone::optics::spectrum::Spectral;
use sunstone::polarimetry::decompose::maps::{Quantity, maps};

fn mueller(c: &mut Criterion) {
    let (n, k) = (Spectral::new([1.38, 0.42, 0.14, 1.0]), Spectral::new([1.9, 2.5, 3.7, 0.0]));
    let block = fresnel::conductor(0.6, n, k);
    let mirror = Scatter::Fresnel { block, s: Vec3A::Y };
    let wall = Scatter::Depolarize(Spectral::splat(0.5));
    c.bench_function("fresnel conductor, 4 wavelengths", |b| {
        b.iter(|| fresnel::conductor(black_box(0.6), black_box(n), black_box(k)));
    });
    let m = block.to_mueller();
    c.bench_function("chain of 5, plain 4x4 products", |b| {
        b.iter(|| (0..5).fold(Mueller::identity(), |a, _| a * black_box(m)));
    });
    let run = |steps: &[Scatter]| {
        let (mut chain, mut frame) = (Chain::start(Spectral::ONE), Vec3A::X);
        for s in steps {
            frame = chain.push(black_box(s), Vec3A::Z, frame).unwrap_or(frame);
        }
        chain
    };
    c.bench_function("chain of 5 mirrors", |b| b.iter(|| run(&[mirror; 5])));
    c.bench_function("chain of 5, mirrors and walls", |b| {
        b.iter(|| run(&[mirror, wall, mirror, mirror, wall]));
    });
}

/// Measures the decomposition of `sunstone decompose` for 2²⁰ similar Mueller matrices of a gold-like
/// material.
fn decompose(c: &mut Criterion) {
    let base =
        [0.79, 0.10, 0.02, 0.01, 0.11, 0.75, 0.03, -0.02, 0.01, 0.02, -0.41, -0.55, 0.0, 0.03, 0.56, -0.40];
    let all: Vec<f64> =
        (0..1 << 20).flat_map(|k| base.map(|e: f64| e + 1e-3 * f64::from(k % 97) / 97.0)).collect();
    let wanted: Vec<Quantity> = Quantity::ALL.into_iter().filter(|q| *q != Quantity::Entropy).collect();
    let mut group = c.benchmark_group("Lu-Chipman");
    group.throughput(criterion::Throughput::Elements(1 << 20)).sample_size(10);
    group.bench_function("four scalars", |b| b.iter(|| maps(black_box(&all), &wanted[..4])));
    group.bench_function("all arrays", |b| b.iter(|| maps(black_box(&all), &wanted)));
}

criterion_group!(benches, mueller, decompose);
criterion_main!(benches);

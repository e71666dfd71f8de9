//! Measures image reconstruction in memory, a single pass over the same intensities, and a loss function with
//! its gradient.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rayon::prelude::*;
use std::hint::black_box;
use sunstone::polarimetry::capture::design_matrix::DesignMatrix;
use sunstone::polarimetry::capture::element::Ray;
use sunstone::polarimetry::capture::scheme::Scheme;
use sunstone::polarimetry::reconstruct::estimator::LinearEstimate;
use sunstone::polarimetry::reconstruct::loss::{Estimator, Objective};
use sunstone::polarimetry::reconstruct::product::Weights;
use sunstone::polarimetry::reconstruct::second_moment::{Moment, SecondMoment};

const PIXELS: usize = 1224 * 1024;

/// Returns the sum of `values`. The function keeps 32 partial sums, so that reading the values limits the
/// speed.
fn sum(values: &[f32]) -> f32 {
    let mut sums = [0.0; 32];
    for some in values.as_chunks::<32>().0 {
        for (s, v) in sums.iter_mut().zip(some) {
            *s += v;
        }
    }
    sums.iter().sum()
}

/// Measures the reconstruction of 1224 × 1024 pixels from 36 captures, all in memory.
fn image(c: &mut Criterion) {
    let Ok(scheme) = Scheme::drr(36, false) else {
        return;
    };
    let design = DesignMatrix::new(&scheme, &Ray::axial(550.0));
    let Ok(estimate) = LinearEstimate::least_squares(&design) else {
        return;
    };
    let weights = Weights::<f32>::new(&estimate);
    let intensities: Vec<f32> = (0..36 * PIXELS).map(|i| (i % 977) as f32 * 1e-3).collect();
    let mut out = vec![0.0; 16 * PIXELS];
    let mut group = c.benchmark_group("reconstruction of 1224 x 1024 x 36");
    group.throughput(Throughput::Bytes(4 * intensities.len() as u64)).sample_size(20);
    group.bench_function("least squares", |b| {
        b.iter(|| weights.apply(black_box(&intensities), &mut out));
    });
    group.bench_function("one pass over the input, one thread", |b| {
        b.iter(|| sum(black_box(&intensities)));
    });
    group.bench_function("one pass over the input, all threads", |b| {
        b.iter(|| black_box(&intensities).par_chunks(1 << 16).map(sum).sum::<f32>());
    });
}

/// Measures one evaluation of the reconstruction loss of 16 captures, including the gradient for 64 angles.
fn loss(c: &mut Criterion) {
    let Ok(scheme) = Scheme::qrpr(16, false) else {
        return;
    };
    for estimator in [Estimator::LeastSquares, Estimator::Prior] {
        let objective = Objective {
            sigma: 5e-4,
            angle_error: 0.0,
            second_moment: SecondMoment::new(Moment::identity()),
            estimator,
            rays: vec![Ray::axial(550.0)],
            metric: None,
        };
        c.bench_function(&format!("loss and gradient, {estimator:?}"), |b| {
            b.iter(|| objective.gradient(black_box(&scheme)));
        });
    }
}

criterion_group!(benches, image, loss);
criterion_main!(benches);

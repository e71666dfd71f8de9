//! Random Mueller matrices with known factors, for tests.

use super::cloude::Matrix;
use super::lu_chipman::{Parts, compose};
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use optics::sampling::stream::Stream;
use optics::sampling::warp;

/// A matrix and its factors.
pub struct Sample {
    pub m: Matrix,
    pub parts: Parts,
    pub retardance: f64,
    pub axis: [f64; 3],
}

pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum()))
}

fn direction(stream: &mut Stream) -> Vector3<f64> {
    let d = warp::sphere(stream.uniform2());
    Vector3::new(f64::from(d.x), f64::from(d.y), f64::from(d.z)).normalize()
}

/// Returns `n` matrices with random factors. The diattenuation is at most 0.95. The eigenvalues of m_Δ are at
/// least 0.05 in magnitude, and all positive or all negative. The retardance is 0.05 to π - 0.05.
pub fn samples(n: u32, seed: u64) -> impl Iterator<Item = Sample> {
    (0..n).map(move |k| {
        let mut stream = Stream::new(seed, k, 0);
        let mut uniform = |lo: f64, hi: f64| lo + (hi - lo) * f64::from(stream.uniform());
        let (m00, length, retardance) = (uniform(0.01, 10.0), uniform(0.0, 0.95), uniform(0.05, 3.09));
        let values = Vector3::from_fn(|_, _| uniform(0.05, 1.0));
        let sign = if uniform(0.0, 1.0) < 0.2 { -1.0 } else { 1.0 };
        let (spin, size) = (uniform(0.0, 3.0), uniform(0.0, 0.3));
        let d = direction(&mut stream) * length;
        let axis = direction(&mut stream);
        let turn = Rotation3::from_axis_angle(&Unit::new_normalize(direction(&mut stream)), spin);
        let delta = turn * Matrix3::from_diagonal(&(values * sign)) * turn.inverse();
        // A retarder rotates Stokes vectors about its fast axis, clockwise in the order s1, s2, s3.
        let r = Rotation3::from_axis_angle(&Unit::new_normalize(axis), -retardance);
        let (zero, c) = (Vector3::zeros(), (1.0 - length * length).sqrt());
        let m_d = Matrix3::identity() * c + d * d.transpose() / (1.0 + c);
        let parts = Parts {
            depolarizer: compose(1.0, zero, direction(&mut stream) * size, &delta),
            retarder: compose(1.0, zero, zero, r.matrix()),
            diattenuator: compose(m00, d, d, &m_d),
        };
        let behind = product(&parts.depolarizer, &parts.retarder);
        Sample { m: product(&behind, &parts.diattenuator), parts, retardance, axis: [axis.x, axis.y, axis.z] }
    })
}

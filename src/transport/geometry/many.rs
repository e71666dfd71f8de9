//! Arrays of vectors whose x, y and z components are stored separately.
//!
//! Batches of paths that need the same arithmetic use plain loops over arrays of components, which the
//! compiler vectorizes. If each path were processed separately, the processor would mostly wait for divisions
//! and square roots. The operations and their order are as in `glam`, so the results are bit-identical to
//! those for single vectors.

use glam::{Mat3A, Vec3A};

/// The x, y and z components of `N` vectors.
pub type Many<const N: usize> = [[f32; N]; 3];

pub const fn zero<const N: usize>() -> Many<N> {
    [[0.0; N]; 3]
}

#[inline(always)]
pub fn get<const N: usize>(v: &Many<N>, i: usize) -> Vec3A {
    Vec3A::new(v[0][i], v[1][i], v[2][i])
}

#[inline(always)]
pub fn set<const N: usize>(v: &mut Many<N>, i: usize, value: Vec3A) {
    let [x, y, z] = value.to_array();
    (v[0][i], v[1][i], v[2][i]) = (x, y, z);
}

/// Returns `m · v` for each vector v.
#[inline(always)]
pub fn turned<const N: usize>(m: &Mat3A, v: &Many<N>) -> Many<N> {
    let [a, b, c] = m.to_cols_array_2d();
    let mut out = zero();
    for i in 0..N {
        let (x, y, z) = (v[0][i], v[1][i], v[2][i]);
        out[0][i] = a[0] * x + b[0] * y + c[0] * z;
        out[1][i] = a[1] * x + b[1] * y + c[1] * z;
        out[2][i] = a[2] * x + b[2] * y + c[2] * z;
    }
    out
}

/// Returns `v - w` for each vector v.
#[inline(always)]
pub fn less<const N: usize>(v: &Many<N>, w: Vec3A) -> Many<N> {
    let w = w.to_array();
    let mut out = zero();
    for k in 0..3 {
        for i in 0..N {
            out[k][i] = v[k][i] - w[k];
        }
    }
    out
}

#[inline(always)]
pub fn lengths<const N: usize>(v: &Many<N>) -> [f32; N] {
    let mut out = [0.0; N];
    for i in 0..N {
        let (x, y, z) = (v[0][i], v[1][i], v[2][i]);
        out[i] = (x * x + y * y + z * z).sqrt();
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use optics::sampling::stream::Stream;
    use optics::sampling::warp;

    #[test]
    fn batched_vectors_equal_single_ones() {
        let mut stream = Stream::new(1, 0, 0);
        let mut draw = || warp::sphere(stream.uniform2()) * (0.1 + stream.uniform());
        let m = Mat3A::from_cols(draw(), draw(), draw());
        let w = draw();
        for _ in 0..1000 {
            let alone: [Vec3A; 16] = std::array::from_fn(|_| draw());
            let mut v = zero::<16>();
            for (i, a) in alone.into_iter().enumerate() {
                set(&mut v, i, a);
            }
            let (t, l, n) = (turned(&m, &v), less(&v, w), lengths(&v));
            for (i, a) in alone.into_iter().enumerate() {
                assert_eq!(get(&v, i), a);
                assert_eq!(get(&t, i), m * a);
                assert_eq!(get(&l, i), a - w);
                assert_eq!(n[i], a.length());
            }
        }
    }
}

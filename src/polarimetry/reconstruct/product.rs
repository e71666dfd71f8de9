//! Computes the product of an estimator with whole images. For each pixel, a 16 × M matrix is multiplied by M
//! intensities.
//!
//! Memory bandwidth limits the speed of the product. Every intensity is read once, and every element is
//! written once, in f32 or f64. The 16 × M matrix is rounded from f64. Pixels are processed in blocks whose
//! intensities fit the L1 cache.

use super::estimator::LinearEstimate;
use rayon::prelude::*;
use tensor::number::Number;

const BLOCK: usize = 32;
/// Number of values per SIMD vector.
const LANES: usize = 8;
/// Number of pixels that are read together. These pixels fill several cache lines of every image plane.
const RUN: usize = 512;
/// Number of pixels per task. The number is large enough for memory pages and small enough for the L2 cache.
const TASK: usize = 2048;

/// The matrix of an estimator. For each measurement, the matrix contains the measurement's weights in the 16
/// elements.
#[derive(Clone, Debug)]
pub struct Weights<T>(Vec<[T; 16]>);

impl<T: Number> Weights<T> {
    /// Rounds an estimator's matrix.
    pub fn new(estimate: &LinearEstimate) -> Self {
        let w = &estimate.w;
        let column = |m| std::array::from_fn(|e| T::new(w[(e, m)]));
        Self((0..w.ncols()).map(column).collect())
    }

    /// Returns the Mueller matrix of one pixel (16 elements, row-major) from the intensities of the pixel.
    pub fn one(&self, intensities: impl Iterator<Item = T>) -> [T; 16] {
        let mut out = [T::default(); 16];
        for (column, x) in self.0.iter().zip(intensities) {
            for (o, w) in out.iter_mut().zip(column) {
                *o = w.times_plus(x, *o);
            }
        }
        out
    }

    /// Computes the Mueller matrices of all pixels, and returns whether all matrices are finite.
    /// `intensities` is sorted by measurement, then by pixel. `out` receives 16 elements per pixel,
    /// row-major.
    ///
    /// # Panics
    /// Panics if the lengths of the arguments do not match.
    pub fn apply(&self, intensities: &[T], out: &mut [T]) -> bool {
        let pixels = out.len() / 16;
        assert_eq!(intensities.len(), pixels * self.0.len(), "one per measurement and pixel");
        let tasks = out.par_chunks_mut(TASK * 16).enumerate().map(|(i, out)| {
            let first = i * TASK;
            let end = first + out.len() / 16;
            self.task(|m| &intensities[m * pixels + first..m * pixels + end], out)
        });
        tasks.reduce(|| true, |a, b| a & b)
    }

    fn task<'a>(&self, plane: impl Fn(usize) -> &'a [T], out: &mut [T]) -> bool {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
            // SAFETY: the processor supports the required features.
            return unsafe { self.avx2(plane, out) };
        }
        self.any(plane, out)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn avx2<'a>(&self, plane: impl Fn(usize) -> &'a [T], out: &mut [T]) -> bool {
        self.any(plane, out)
    }

    /// Computes the product with intensities from `plane`. Intensities are read in runs, which is the fastest
    /// way to read memory, and are copied by block. The intensities of a block are then contiguous in the L1
    /// cache. Without the copy, image planes whose distance in memory is a power of two would compete for the
    /// same cache sets.
    #[inline(always)]
    fn any<'a>(&self, plane: impl Fn(usize) -> &'a [T], out: &mut [T]) -> bool {
        let mut finite = true;
        let count = self.0.len();
        let mut x = vec![[[T::default(); LANES]; BLOCK / LANES]; RUN / BLOCK * count];
        for (r, out) in out.chunks_mut(RUN * 16).enumerate() {
            let n = out.len() / 16;
            for m in 0..count {
                let run = &plane(m)[r * RUN..r * RUN + n];
                let (blocks, rest) = run.as_chunks::<BLOCK>();
                for (b, block) in blocks.iter().enumerate() {
                    *x[b * count + m]
                        .as_flattened_mut()
                        .first_chunk_mut()
                        .unwrap_or(&mut [T::default(); BLOCK]) = *block;
                }
                if !rest.is_empty() {
                    x[blocks.len() * count + m].as_flattened_mut()[..rest.len()].copy_from_slice(rest);
                }
            }
            for (x, out) in x.chunks_exact(count).zip(out.chunks_mut(BLOCK * 16)) {
                finite &= self.block(x, out);
            }
        }
        finite
    }

    #[inline(always)]
    fn block(&self, x: &[[[T; LANES]; BLOCK / LANES]], out: &mut [T]) -> bool {
        let zero = [T::default(); LANES];
        let mut all = [[zero; 16]; BLOCK / LANES];
        // The loop processes four elements of two vectors of pixels at a time. Sums and operands therefore
        // fit into registers.
        for pair in 0..BLOCK / LANES / 2 {
            for quarter in 0..4 {
                let mut sums = [[zero; 2]; 4];
                for (x, w) in x.iter().zip(&self.0) {
                    let x = [x[2 * pair], x[2 * pair + 1]];
                    for (e, sum) in sums.iter_mut().enumerate() {
                        let w = w[4 * quarter + e];
                        add_product(w, &x[0], &mut sum[0]);
                        add_product(w, &x[1], &mut sum[1]);
                    }
                }
                for (e, sum) in sums.iter().enumerate() {
                    all[2 * pair][4 * quarter + e] = sum[0];
                    all[2 * pair + 1][4 * quarter + e] = sum[1];
                }
            }
        }
        for (k, pixel) in out.as_chunks_mut::<16>().0.iter_mut().enumerate() {
            let from = &all[k / LANES];
            for (e, o) in pixel.iter_mut().enumerate() {
                *o = from[e][k % LANES];
            }
        }
        // The sum is zero if and only if all values are finite, because zero times a finite number is zero.
        let nothing = T::default();
        let mut odd = zero;
        for v in all[..out.len().div_ceil(16 * LANES)].as_flattened() {
            add_product(nothing, v, &mut odd);
        }
        odd.iter().all(|v| *v == nothing)
    }
}

/// Adds w·x to s for each element. This function uses a loop, because the compiler could compile a closure
/// separately, without the caller's target features.
#[inline(always)]
fn add_product<T: Number>(w: T, x: &[T; LANES], s: &mut [T; LANES]) {
    for k in 0..LANES {
        s[k] = w.times_plus(x[k], s[k]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::design_matrix::DesignMatrix;
    use crate::capture::element::Ray;
    use crate::capture::scheme::Scheme;

    fn check<T: Number>(tolerance: f64) {
        let scheme = Scheme::drr(36, false).expect("a scheme");
        let design = DesignMatrix::new(&scheme, &Ray::axial(550.0));
        let estimate = LinearEstimate::least_squares(&design).expect("rank 16");
        let weights = Weights::<T>::new(&estimate);
        for pixels in [0_usize, 1, 31, 32, 33, 2047, 2049, 5000] {
            let t = |p: usize, e: usize| ((p * 16 + e) as f64 * 0.7).sin();
            let mut intensities = vec![T::default(); 36 * pixels];
            for p in 0..pixels {
                let i = design.intensities(&std::array::from_fn(|e| t(p, e)));
                (0..36).for_each(|k| intensities[k * pixels + p] = T::new(i[k]));
            }
            let mut out = vec![T::default(); 16 * pixels];
            weights.apply(&intensities, &mut out);
            for p in 0..pixels {
                let one = weights.one((0..36).map(|k| intensities[k * pixels + p]));
                for e in 0..16 {
                    let found = out[p * 16 + e].get();
                    assert!((found - t(p, e)).abs() < tolerance, "{pixels} {p} {e}: {found}");
                    assert!((found - one[e].get()).abs() < tolerance);
                }
            }
        }
    }

    #[test]
    fn images_are_recovered() {
        check::<f64>(1e-12);
        check::<f32>(1e-4);
    }
}

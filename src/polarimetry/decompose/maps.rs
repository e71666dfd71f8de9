//! Decomposes images and other arrays of Mueller matrices, on all CPU cores.

use super::batch::{Batch, LANES};
use super::cloude::{Matrix, entropy};
use super::lu_chipman::{DOUBLE, Parts, SINGLE};
use super::properties::Properties;
use rayon::prelude::*;
use tensor::number::Number;

/// Number of matrices per work unit. The number is a multiple of [`LANES`].
const CHUNK: usize = 1024;

/// A number type of arrays. Loops over matrices of this type are compiled in this crate, where the
/// compiler can inline the called functions.
pub trait Real: Number {
    /// Relative rounding error of matrices of this type.
    const ROUNDING: f64;

    /// Computes [`maps`] for this number type.
    fn maps(elements: &[Self], quantities: &[Quantity]) -> (Vec<Vec<Self>>, usize);

    /// Computes [`errors`] for this number type.
    fn errors(elements: &[Self], sigmas: &[Self]) -> Vec<Vec<Self>>;
}

macro_rules! real {
    ($number:ty, $rounding:expr) => {
        impl Real for $number {
            const ROUNDING: f64 = $rounding;

            #[inline(never)]
            fn maps(elements: &[Self], quantities: &[Quantity]) -> (Vec<Vec<Self>>, usize) {
                all_maps(elements, quantities)
            }

            #[inline(never)]
            fn errors(elements: &[Self], sigmas: &[Self]) -> Vec<Vec<Self>> {
                all_errors(elements, sigmas)
            }
        }
    };
}

real!(f32, SINGLE);
real!(f64, DOUBLE);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Degree of polarization of the output for unpolarized input, 0..1.
    Polarizance,
    /// Diattenuation, 0..1. The diattenuation is the difference between the largest and the smallest
    /// transmittance, divided by the sum of these transmittances.
    Diattenuation,
    /// Retardance in radians, 0..π.
    Retardance,
    /// Depolarization power 1 - |tr m_Δ|/3, 0..1, where m_Δ is the lower right 3×3 block of M_Δ. At 0, all
    /// polarization is preserved. At 1, no polarization is preserved.
    Depolarization,
    /// Stokes components of the retarder's fast axis.
    RetardanceAxis,
    /// Cloude's entropy, 0..1.
    Entropy,
    /// The factor M_Δ (depolarizer) of M = M_Δ M_R M_D.
    Depolarizer,
    /// The factor M_R (retarder).
    Retarder,
    /// The factor M_D (diattenuator).
    Diattenuator,
}

impl Quantity {
    pub const ALL: [Self; 9] = [
        Self::Polarizance,
        Self::Diattenuation,
        Self::Retardance,
        Self::Depolarization,
        Self::RetardanceAxis,
        Self::Entropy,
        Self::Depolarizer,
        Self::Retarder,
        Self::Diattenuator,
    ];

    /// Returns the quantity's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Polarizance => "polarizance",
            Self::Diattenuation => "diattenuation",
            Self::Retardance => "retardance",
            Self::Depolarization => "depolarization",
            Self::RetardanceAxis => "retardance_axis",
            Self::Entropy => "entropy",
            Self::Depolarizer => "m_delta",
            Self::Retarder => "m_r",
            Self::Diattenuator => "m_d",
        }
    }

    pub fn shape(self) -> &'static [u64] {
        match self {
            Self::RetardanceAxis => &[3],
            Self::Depolarizer | Self::Retarder | Self::Diattenuator => &[4, 4],
            _ => &[],
        }
    }

    /// Returns the number of elements of one value. The number is 1 for a scalar, 3 for an axis and 16 for a
    /// matrix.
    pub fn size(self) -> usize {
        self.shape().iter().product::<u64>() as usize
    }

    /// Returns whether computing the quantity requires the Lu–Chipman factors.
    fn needs_parts(self) -> bool {
        matches!(self, Self::RetardanceAxis | Self::Depolarizer | Self::Retarder | Self::Diattenuator)
    }

    #[inline(always)]
    fn write<T: Real>(self, m: &Matrix, found: &Found, out: &mut [T]) {
        let Some((parts, p)) = found else {
            out.fill(T::new(f64::NAN));
            return;
        };
        let all: &[f64] = match self {
            Self::Depolarizer => parts.depolarizer.as_flattened(),
            Self::Retarder => parts.retarder.as_flattened(),
            Self::Diattenuator => parts.diattenuator.as_flattened(),
            Self::RetardanceAxis => &p.axis,
            Self::Entropy => &[entropy(m).unwrap_or(f64::NAN)],
            _ => &[self.scalar(p)],
        };
        for (o, e) in out.iter_mut().zip(all) {
            *o = T::new(*e);
        }
    }

    /// Writes the values of the first matrices, up to the length of `out`, for quantities that are not
    /// computed from the factors. The quantity is selected once for all matrices.
    #[inline(always)]
    fn write_scalars<T: Real>(self, m: &[Matrix; LANES], found: &[Option<Properties>; LANES], out: &mut [T]) {
        let fill = |out: &mut [T], f: fn(&Properties) -> f64| {
            for (o, p) in out.iter_mut().zip(found) {
                *o = T::new(p.as_ref().map_or(f64::NAN, f));
            }
        };
        match self {
            Self::Polarizance => fill(out, |p| p.polarizance),
            Self::Diattenuation => fill(out, |p| p.diattenuation),
            Self::Retardance => fill(out, |p| p.retardance),
            Self::Depolarization => fill(out, |p| p.depolarization),
            _ => {
                for ((o, m), p) in out.iter_mut().zip(m).zip(found) {
                    let value = p.as_ref().and_then(|_| entropy(m));
                    *o = T::new(value.unwrap_or(f64::NAN));
                }
            }
        }
    }

    /// Returns one of the four scalars of Lu & Chipman, or NaN for other quantities.
    fn scalar(self, p: &Properties) -> f64 {
        match self {
            Self::Polarizance => p.polarizance,
            Self::Diattenuation => p.diattenuation,
            Self::Retardance => p.retardance,
            Self::Depolarization => p.depolarization,
            _ => f64::NAN,
        }
    }
}

/// The factors and properties of a matrix, or `None` if the matrix has no decomposition.
type Found = Option<(Parts, Properties)>;

fn matrix<T: Real>(values: &[T]) -> Matrix {
    let mut m = [[0.0; 4]; 4];
    for (e, v) in m.as_flattened_mut().iter_mut().zip(values) {
        *e = v.get();
    }
    m
}

/// Returns the maps of quantities over consecutive matrices of 16 elements, `m[out][in]`. Also returns the
/// number of matrices without a decomposition, whose values are NaN.
///
/// # Panics
/// Panics if the number of elements is not a multiple of 16.
pub fn maps<T: Real>(elements: &[T], quantities: &[Quantity]) -> (Vec<Vec<T>>, usize) {
    T::maps(elements, quantities)
}

fn all_maps<T: Real>(elements: &[T], quantities: &[Quantity]) -> (Vec<Vec<T>>, usize) {
    assert_eq!(elements.len() % 16, 0, "whole matrices");
    let n = elements.len() / 16;
    let mut out: Vec<Vec<T>> = quantities.iter().map(|q| vec![T::default(); n * q.size()]).collect();
    // The output slices of each work unit.
    let mut pieces: Vec<Vec<&mut [T]>> = (0..n.div_ceil(CHUNK)).map(|_| vec![]).collect();
    for (values, q) in out.iter_mut().zip(quantities) {
        for (piece, part) in pieces.iter_mut().zip(values.chunks_mut(CHUNK * q.size())) {
            piece.push(part);
        }
    }
    let whole = quantities.iter().any(|q| q.needs_parts());
    let missing = elements
        .par_chunks(CHUNK * 16)
        .zip(pieces)
        .map(|(elements, mut piece)| {
            let mut missing = 0;
            let mut m = [[[0.0; 4]; 4]; LANES];
            for (k, some) in elements.chunks(16 * LANES).enumerate() {
                // Unused lanes of the last batch keep copies of earlier matrices.
                let count = some.len() / 16;
                for (m, elements) in m.iter_mut().zip(some.chunks_exact(16)) {
                    *m = matrix(elements);
                }
                let batch = Batch::new(&m, T::ROUNDING);
                if !whole {
                    let found: [Option<Properties>; LANES] =
                        std::array::from_fn(|i| batch.properties(i, &m[i], T::ROUNDING));
                    missing += found[..count].iter().filter(|p| p.is_none()).count();
                    for (q, values) in quantities.iter().zip(&mut piece) {
                        let at = LANES * k;
                        q.write_scalars(&m, &found, &mut values[at..at + count]);
                    }
                    continue;
                }
                for (i, m) in m.iter().take(count).enumerate() {
                    let parts = batch.parts(i, m, T::ROUNDING);
                    let found: Found = parts.map(|parts| (parts, Properties::of(m, &parts)));
                    missing += usize::from(found.is_none());
                    for (q, values) in quantities.iter().zip(&mut piece) {
                        let (at, size) = (LANES * k + i, q.size());
                        q.write(m, &found, &mut values[at * size..(at + 1) * size]);
                    }
                }
            }
            missing
        })
        .sum();
    (out, missing)
}

/// Quantities with error estimates.
pub const WITH_ERRORS: [Quantity; 4] =
    [Quantity::Polarizance, Quantity::Diattenuation, Quantity::Retardance, Quantity::Depolarization];

/// Returns the standard errors of the quantities [`WITH_ERRORS`] from the standard errors of the elements.
/// The errors of the elements are assumed to be independent:
///
/// > σ² = Σ_ij ((f(m + σ_ij) - f(m - σ_ij))/2)².
///
/// Each difference is between the quantities at one standard error above and below an element. The result is
/// therefore also valid if the quantity is a nonlinear function of the elements.
///
/// # Panics
/// Panics if the numbers of errors and elements differ, or if they are not a multiple of 16.
pub fn errors<T: Real>(elements: &[T], sigmas: &[T]) -> Vec<Vec<T>> {
    T::errors(elements, sigmas)
}

fn all_errors<T: Real>(elements: &[T], sigmas: &[T]) -> Vec<Vec<T>> {
    assert_eq!((elements.len(), elements.len() % 16), (sigmas.len(), 0), "whole matrices");
    let one = |(m, sigmas): (&[T], &[T])| -> [T; 4] {
        let (m, sigmas) = (matrix(m), matrix(sigmas));
        let mut sums = [0.0; 4];
        // Each element is shifted by ± its standard error, with several elements per batch.
        for first in (0..16).step_by(LANES / 2) {
            let mut moved = [m; LANES];
            for (k, moved) in moved.iter_mut().enumerate() {
                let e = first + k / 2;
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                moved[e / 4][e % 4] += sign * sigmas[e / 4][e % 4];
            }
            let batch = Batch::new(&moved, T::ROUNDING);
            for k in (0..LANES).step_by(2) {
                let [up, down] = [k, k + 1].map(|k| batch.properties(k, &moved[k], T::ROUNDING));
                for (sum, q) in sums.iter_mut().zip(WITH_ERRORS) {
                    let value = |f: &Option<Properties>| f.as_ref().map_or(f64::NAN, |p| q.scalar(p));
                    *sum += ((value(&up) - value(&down)) / 2.0).powi(2);
                }
            }
        }
        sums.map(|s| T::new(s.sqrt()))
    };
    let all: Vec<[T; 4]> =
        elements.par_chunks(16).zip(sigmas.par_chunks(16)).with_min_len(256).map(one).collect();
    (0..4).map(|q| all.iter().map(|e| e[q]).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decompose::lu_chipman::decompose;
    use crate::decompose::testing::samples;
    use optics::sampling::stream::Stream;

    fn elements(n: u32) -> Vec<f64> {
        samples(n, 7).flat_map(|s| s.m.into_iter().flatten()).collect()
    }

    /// Verifies that maps of any number of matrices equal the values of single matrices. Values of matrices
    /// without a decomposition are NaN.
    #[test]
    fn maps_equal_single_matrices() {
        for n in [1_u32, 3, 4, 1023, 1025, 2050] {
            let mut all = elements(n);
            let wrong = n as usize / 2;
            all[16 * wrong] = -1.0;
            let (maps, missing) = maps(&all, &Quantity::ALL);
            assert_eq!(missing, 1);
            for (i, m) in all.chunks(16).enumerate() {
                let m = matrix(m);
                let parts = decompose(&m, DOUBLE);
                assert_eq!(parts.is_none(), i == wrong);
                for (q, map) in Quantity::ALL.iter().zip(&maps) {
                    let got = &map[i * q.size()..(i + 1) * q.size()];
                    let Some(parts) = &parts else {
                        assert!(got.iter().all(|v| v.is_nan()));
                        continue;
                    };
                    let mut want = vec![0.0; q.size()];
                    q.write(&m, &Some((*parts, Properties::of(&m, parts))), &mut want);
                    for (g, w) in got.iter().zip(&want) {
                        assert!((g - w).abs() < 1e-6 * (1.0 + w.abs()), "{}: {g}, want {w}", q.name());
                    }
                }
            }
        }
        assert_eq!(maps::<f32>(&[], &Quantity::ALL).1, 0);
    }

    /// Verifies that stated errors equal the scatter of quantities that are computed from noisy elements. The
    /// test uses 4000 samples. The tolerance is 5 standard errors of a standard deviation plus second-order
    /// terms.
    #[test]
    fn errors_of_quantities_match_the_scatter() {
        let all = elements(6);
        let draws = 4000;
        for m in all.chunks(16) {
            let sigmas: Vec<f64> = (0..16).map(|k| 1e-4 * m[0] * (1.0 + f64::from(k % 5))).collect();
            let message = errors(m, &sigmas);
            let mut stream = Stream::new(11, 0, 0);
            let mut noisy = vec![];
            for _ in 0..draws {
                for (e, s) in m.iter().zip(&sigmas) {
                    // The sum of twelve random numbers that are uniform in [0, 1) has variance 1.
                    let g: f64 = (0..12).map(|_| f64::from(stream.uniform())).sum::<f64>() - 6.0;
                    noisy.push(e + s * g);
                }
            }
            let (found, missing) = maps(&noisy, &WITH_ERRORS);
            assert_eq!(missing, 0);
            for ((map, message), q) in found.iter().zip(&message).zip(WITH_ERRORS) {
                let n = f64::from(draws);
                let mean = map.iter().sum::<f64>() / n;
                let sigma = (map.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
                let unsure = 5.0 / (2.0 * n).sqrt() + 0.01;
                assert!(
                    (message[0] / sigma - 1.0).abs() < unsure,
                    "{}: {} is not {sigma}",
                    q.name(),
                    message[0]
                );
            }
        }
    }
}

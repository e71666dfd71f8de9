//! Gray code (Inokuchi et al. 1984; Posdamer & Altschuler 1982). The code has one pattern for each bit of the
//! column's index, and the inverse of each pattern.
//!
//! The Gray code of i is i ⊕ ⌊i/2⌋, so neighbouring columns differ in one bit. A bit is determined by
//! comparing the capture of a pattern with the capture of the inverse pattern. Neither albedo nor a constant
//! background affects this comparison. The contrast |I - Ī|/(I + Ī) of a bit measures the reliability of the
//! bit. If the light of a stripe spreads over many stripes, narrow stripes lose contrast and their bits are
//! random. A pixel with a bit below the minimum contrast has no column. This rule is the simplest form of the
//! classification of Xu & Aliaga (2007).

use super::column_light::{CodeError, Decoded, Patterns};
use crate::map::Map;

pub fn bits(columns: usize) -> usize {
    columns.max(2).next_power_of_two().trailing_zeros() as usize
}

/// Returns bit `k` of the Gray code of column `u`. Bit 0 is the finest bit.
pub fn gray_bit(u: usize, k: usize) -> bool {
    (u ^ (u >> 1)) >> k & 1 == 1
}

/// Returns the column whose Gray code has these bits. The coarsest bit is first.
pub(super) fn column_of(bits: impl IntoIterator<Item = bool>) -> usize {
    let (mut column, mut last) = (0, false);
    for bit in bits {
        last ^= bit;
        column = column << 1 | usize::from(last);
    }
    column
}

/// Returns patterns, each followed by the inverse of the pattern. `bit` returns the bit of a pattern at a
/// column.
pub(super) fn with_inverses(columns: usize, bit: impl Fn(usize, usize) -> bool) -> Patterns {
    Patterns::from_fn(2 * bits(columns), columns, |k, u| f64::from(u8::from(bit(k / 2, u) ^ (k % 2 == 1))))
}

/// Returns the bits of a pixel and the minimum contrast of these bits, from captures of patterns and inverse
/// patterns.
pub(super) fn read_bits(captures: &[f64]) -> (Vec<bool>, f64) {
    let mut least = 1.0_f64;
    let bits = captures.chunks_exact(2).map(|pair| {
        let (difference, sum) = (pair[0] - pair[1], pair[0] + pair[1]);
        let contrast = if sum > 0.0 { difference.abs() / sum } else { 0.0 };
        least = least.min(contrast);
        difference > 0.0
    });
    (bits.collect(), least)
}

/// Returns the coordinate of the column's centre. The result is NaN if the column is outside the projector or
/// if the contrast is too low.
pub(super) fn checked(column: usize, columns: usize, contrast: f64, least: f64) -> f64 {
    if column < columns && contrast > 0.0 && contrast >= least { column as f64 + 0.5 } else { f64::NAN }
}

/// Returns the patterns of the bits, from the coarsest bit to the finest. Each pattern is followed by its
/// inverse.
pub fn patterns(columns: usize) -> Patterns {
    let n = bits(columns);
    with_inverses(columns, |k, u| gray_bit(u, n - 1 - k))
}

/// Decodes captures of [`patterns`]. A pixel has no column if the contrast of a bit is below
/// `least_contrast`.
///
/// # Errors
/// Returns an error if the number of captures does not match the patterns.
pub fn decode(captures: &Map, columns: usize, least_contrast: f64) -> Result<Decoded, CodeError> {
    Decoded::by_pixel(captures, 2 * bits(columns), |pixel| {
        let (read, contrast) = read_bits(pixel);
        (checked(column_of(read), columns, contrast, least_contrast), contrast)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::synthetic::{Light, one_row};

    fn columns_of(light: &Light, n: usize, least: f64) -> Vec<f64> {
        let captures = one_row(n, light).capture(&patterns(n)).expect("captures");
        decode(&captures, n, least).expect("a code").column.data
    }

    #[test]
    fn neighbours_differ_in_one_bit_and_codes_are_read_back() {
        for u in 0..1024_usize {
            let code = |u: usize| (u ^ (u >> 1)) & 1023;
            assert_eq!((code(u) ^ code((u + 1) % 1024)).count_ones(), 1);
            assert_eq!(column_of((0..10).rev().map(|k| gray_bit(u, k))), u);
        }
    }

    #[test]
    fn direct_light_is_decoded_exactly_under_constant_light_too() {
        for (n, ambient) in [(256, 0.0), (200, 0.0), (256, 30.0)] {
            let light = Light::direct(1.0).plus_constant(ambient);
            let got = columns_of(&light, n, 0.0);
            assert!(got.iter().enumerate().all(|(i, c)| *c == i as f64 + 0.5), "{n}");
        }
    }

    /// Indirect light from a column half an image away may be brighter than the direct light. In this case,
    /// the wrong bits are exactly the bits in which the two columns differ. The decoded column is then the
    /// column of the indirect light.
    #[test]
    fn brighter_indirect_light_is_decoded_as_direct() {
        let light = Light::direct(1.0).plus_at(1.5, |c, n| (c + n / 2) % n);
        let got = columns_of(&light, 256, 0.0);
        assert!(got.iter().enumerate().all(|(i, c)| *c == ((i + 128) % 256) as f64 + 0.5));
    }

    /// The finest stripes have a period of 4. Blurred by σ columns, these stripes have a contrast of about
    /// exp(-2π²σ²/16)·4/π, which is 2e-5 for σ = 3. A contrast threshold rejects bits with this contrast.
    /// With a direct component of 1/10, the bits are valid again.
    #[test]
    fn narrow_codes_fade_in_blurred_light() {
        let blurred = Light::direct(0.0).plus_blurred(1.0, 3.0, 0.0);
        let got = columns_of(&blurred, 256, 0.01);
        let inner = 20..236;
        assert!(got[inner.clone()].iter().all(|c| c.is_nan()));
        let got = columns_of(&Light::direct(0.1).plus_blurred(0.9, 3.0, 0.0), 256, 0.01);
        assert!(got[inner].iter().enumerate().filter(|(i, c)| **c == *i as f64 + 20.5).count() > 150);
    }

    /// The test uses 20,000 pixels. With noise of 1/8 of the amplitude, the difference for a bit is 8/√2 =
    /// 5.7 standard errors. None of 160,000 bits is therefore expected to be wrong (probability 8e-9 each).
    /// With noise of 1/2, the difference is √2 standard errors, and 7.9 % of the bits are wrong.
    #[test]
    fn bit_error_rate_matches_theory() {
        let n = 256;
        let clean = one_row(n, &Light::direct(1.0)).capture(&patterns(n)).expect("captures");
        for (sigma, wrong) in [(0.125, 8e-9), (0.5, 0.0786)] {
            let (mut bad, mut all) = (0.0, 0.0);
            for seed in 0..79 {
                let noisy = crate::shape::synthetic::noisy(&clean, sigma, seed);
                for x in 0..n {
                    let (read, _) = read_bits(noisy.at(x, 0));
                    all += read.len() as f64;
                    let right = |k: usize| gray_bit(x, bits(n) - 1 - k);
                    bad += read.iter().enumerate().filter(|(k, b)| **b != right(*k)).count() as f64;
                }
            }
            let error = (wrong * (1.0 - wrong) / all).sqrt();
            assert!((bad / all - wrong).abs() <= 5.0 * error + 1e-12, "{sigma}: {}", bad / all);
        }
    }
}

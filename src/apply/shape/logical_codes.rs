//! XOR codes, which are Gray codes that are robust to long-range indirect light (Gupta, Agrawal,
//! Veeraraghavan & Narasimhan 2011, "Structured light 3D scanning in the presence of global illumination").
//!
//! Strong indirect light from the surroundings of a wide stripe inverts the bits of the stripe's pixels.
//! Every pattern is therefore combined by exclusive OR with one fine pattern, the base. The base itself is
//! also projected. All projected patterns then have narrow stripes. For narrow stripes, long-range indirect
//! light is the same under a pattern and its inverse. Decoding combines the bits with the bit of the base by
//! exclusive OR.
//!
//! The base of XOR-02 has stripes of 2 columns. The base of XOR-04 has stripes of 4 columns, which are more
//! robust to short-range blur. [`consensus`] keeps columns on which two of three codes agree: XOR-02, XOR-04
//! and the conventional Gray code. The ensemble of Gupta et al. contains a fourth code, in which all stripes
//! are wide. The fourth code is omitted.

use super::column_light::{CodeError, Decoded, Patterns};
use super::gray_code::{bits, checked, column_of, gray_bit, read_bits, with_inverses};
use crate::map::Map;

/// The base pattern, whose stripes are combined with all other patterns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {
    /// XOR-02, with a base of stripes of 2 columns.
    Xor02,
    /// XOR-04, with a base of stripes of 4 columns.
    Xor04,
}

impl Base {
    /// Returns the index of the bit that is the base in a code of `bits` bits.
    fn bit(self, bits: usize) -> usize {
        match self {
            Self::Xor02 => 0,
            Self::Xor04 => 1.min(bits - 1),
        }
    }
}

/// Returns the patterns from the coarsest bit to the finest. Each pattern is followed by its inverse.
pub fn patterns(columns: usize, base: Base) -> Patterns {
    let n = bits(columns);
    let base = base.bit(n);
    with_inverses(columns, |k, u| {
        let bit = n - 1 - k;
        gray_bit(u, bit) ^ (bit != base && gray_bit(u, base))
    })
}

/// Decodes captures of [`patterns`]. A pixel has no column if the contrast of a bit is below
/// `least_contrast`.
///
/// # Errors
/// Returns an error if the number of captures does not match the patterns.
pub fn decode(captures: &Map, columns: usize, base: Base, least_contrast: f64) -> Result<Decoded, CodeError> {
    let n = bits(columns);
    let base = base.bit(n);
    Decoded::by_pixel(captures, 2 * n, |pixel| {
        let (read, contrast) = read_bits(pixel);
        let of_base = read[n - 1 - base];
        let true_bits = read.iter().enumerate().map(|(k, bit)| bit ^ (n - 1 - k != base && of_base));
        (checked(column_of(true_bits), columns, contrast, least_contrast), contrast)
    })
}

/// Returns, for each pixel, the mean column of two codes that agree to within one column. If no pair agrees,
/// the result is NaN. If several pairs agree, the pair with the largest confidence is used. The confidence of
/// a pair is the larger of the confidences of its two codes.
pub fn consensus(codes: &[Decoded]) -> Option<Decoded> {
    let mut out = codes.first()?.clone();
    for (i, column) in out.column.data.iter_mut().enumerate() {
        let of = |d: &Decoded| (d.column.data[i], d.confidence.data[i]);
        let pairs =
            codes.iter().enumerate().flat_map(|(k, a)| codes[k + 1..].iter().map(move |b| (of(a), of(b))));
        let agreed = pairs.filter(|(a, b)| (a.0 - b.0).abs() <= 1.0);
        let best = agreed.max_by(|a, b| a.0.1.max(a.1.1).total_cmp(&b.0.1.max(b.1.1)));
        (*column, out.confidence.data[i]) =
            best.map_or((f64::NAN, 0.0), |(a, b)| ((a.0 + b.0) / 2.0, a.1.max(b.1)));
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::gray_code;
    use crate::shape::synthetic::{Light, one_row};

    fn right(light: &Light, base: Base, n: usize) -> usize {
        let captures = one_row(n, light).capture(&patterns(n, base)).expect("captures");
        let got = decode(&captures, n, base, 0.0).expect("a code").column.data;
        got.iter().enumerate().filter(|(i, c)| **c == *i as f64 + 0.5).count()
    }

    #[test]
    fn direct_light_is_decoded_exactly() {
        for base in [Base::Xor02, Base::Xor04] {
            for n in [256, 200] {
                assert_eq!(right(&Light::direct(1.0), base, n), n);
            }
        }
    }

    /// Every projected pattern has stripes that are at most twice as wide as the stripes of the base.
    #[test]
    fn all_stripes_are_narrow() {
        for (base, widest) in [(Base::Xor02, 4), (Base::Xor04, 8)] {
            for drive in patterns(1024, base).drives {
                let longest = drive.chunk_by(|a, b| a == b).map(<[f64]>::len).max();
                assert!(longest.is_some_and(|n| n <= widest), "{base:?}: {longest:?}");
            }
        }
    }

    /// The indirect light is 1.5 times as bright as the direct light. The indirect light is spread widely
    /// around a column a quarter of the image away. The Gray code is wrong in many columns, and the XOR codes
    /// are correct in all columns.
    #[test]
    fn long_range_light_does_not_flip_bits() {
        let n = 256;
        let light = Light::direct(1.0).plus_blurred(1.5, 12.0, 64.0);
        let captures = one_row(n, &light).capture(&gray_code::patterns(n)).expect("captures");
        let gray = gray_code::decode(&captures, n, 0.0).expect("a code").column.data;
        let wrong = gray.iter().enumerate().filter(|(i, c)| **c != *i as f64 + 0.5).count();
        assert!(wrong > 100, "{wrong}");
        for base in [Base::Xor02, Base::Xor04] {
            assert_eq!(right(&light, base, n), n, "{base:?}");
        }
    }

    #[test]
    fn consensus_needs_two_agreeing_codes() {
        let of = |c: f64, clear: f64| Decoded {
            column: Map::from_fn(1, 1, 1, |_, _, o| o[0] = c),
            confidence: Map::from_fn(1, 1, 1, |_, _, o| o[0] = clear),
        };
        let got = consensus(&[of(9.5, 0.9), of(30.5, 0.1), of(31.5, 0.2)]).expect("three");
        assert_eq!((got.column.data[0], got.confidence.data[0]), (31.0, 0.2));
        let got = consensus(&[of(9.5, 0.9), of(f64::NAN, 0.1)]).expect("two");
        assert!(got.column.data[0].is_nan());
        assert!(consensus(&[]).is_none());
    }
}

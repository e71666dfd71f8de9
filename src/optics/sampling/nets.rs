//! Sets of points in the unit square that are spread more evenly than chance would have it: scrambled (0, m, 2)-nets in base 2.
//!
//! Of 2^m points of such a net every box of area 2^-m whose sides are powers of two holds exactly one (Niederreiter 1992), so that
//! integrands which vary slowly in one direction, or in both, are integrated with far less noise. The nets here are those of Sobol's
//! first two dimensions, scrambled digit by digit as Owen (1995) does, in an order of chance. [`super::stream::Stream`] draws a
//! net for each pair of numbers and shifts it by chance once more, digit by digit, so that every number is uniform
//! and what is estimated has no bias, however few nets there are.

use super::mix::mix;
use rand_core::Rng;
use rand_pcg::Pcg32;
use std::array::from_fn;
use std::sync::LazyLock;

/// Most binary digits of a net: 2^6 points.
pub const MOST_BITS: u32 = 6;

/// Points of all nets of one size.
pub const POINTS: usize = 1 << 13;

/// Nets of 2^bits points one after the other: of each point the first `bits` digits of both coordinates, as whole numbers,
/// the second shifted by 8.
pub type Nets = [u16; POINTS];

/// The nets of 2^bits points, 1 ≤ bits ≤ [`MOST_BITS`].
///
/// # Panics
/// If there are none of that size.
#[must_use]
pub fn nets(bits: u32) -> &'static Nets {
    static ALL: LazyLock<[Nets; MOST_BITS as usize]> = LazyLock::new(|| from_fn(|k| make(k as u32 + 1)));
    &ALL[bits as usize - 1]
}

fn make(bits: u32) -> Nets {
    let mut out = [0; POINTS];
    for (number, net) in out.chunks_exact_mut(1 << bits).enumerate() {
        let mut random = Pcg32::new(mix(number as u64), u64::from(bits));
        let scrambles: [u64; 2] = from_fn(|_| random.next_u64());
        for (j, point) in (0..).zip(&mut *net) {
            let [x, y] = [0, 1].map(|axis| scramble(sobol(j, axis, bits), bits, scrambles[axis as usize]));
            *point = (x | y << 8) as u16;
        }
        // Fisher and Yates.
        for last in (1..net.len()).rev() {
            let other = (u64::from(random.next_u32()) * (last as u64 + 1)) >> 32;
            net.swap(last, other as usize);
        }
    }
    out
}

/// Digits of point `j` of Sobol's sequence along one of its first two axes: those of `j` from the last to the first, times
/// Pascal's triangle modulo 2 for the second axis.
fn sobol(j: u32, axis: u32, bits: u32) -> u32 {
    // Digit `row` of the result counts from the most significant one.
    let digit = |row: u32| {
        let chosen = |column: u32| {
            let entry = if axis == 0 {
                u32::from(row == column)
            } else {
                // A binomial coefficient is odd where the lower number's digits are among the upper one's (Lucas).
                u32::from(row & !column == 0)
            };
            entry & j >> column
        };
        (0..bits).fold(0, |sum, column| sum ^ chosen(column)) & 1
    };
    (0..bits).fold(0, |all, row| all | digit(row) << (bits - 1 - row))
}

/// Turns each digit of `x` by chance that depends on the digits before it (Owen 1995).
fn scramble(x: u32, bits: u32, key: u64) -> u32 {
    (0..bits).fold(0, |out, k| {
        let before = u64::from(x >> (bits - k));
        let turn = mix(key ^ (before | 1 << 32 | u64::from(k) << 40)) as u32 & 1;
        out | ((x >> (bits - 1 - k) & 1) ^ turn) << (bits - 1 - k)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every net has one point in every box of its elementary partitions.
    #[test]
    fn nets_are_nets() {
        for bits in 1..=MOST_BITS {
            for net in nets(bits).chunks_exact(1 << bits) {
                for across in 0..=bits {
                    let mut boxes = vec![0; 1 << bits];
                    for p in net {
                        let [x, y] = [p & 0xff, p >> 8].map(u32::from);
                        boxes[(x >> (bits - across) << (bits - across) | y >> across) as usize] += 1;
                    }
                    assert!(boxes.iter().all(|n| *n == 1), "{bits} digits, {across} across");
                }
            }
        }
    }

    /// No two nets of some points are the same.
    #[test]
    fn nets_differ() {
        let mut all: Vec<&[u16]> = nets(4).chunks_exact(16).collect();
        let count = all.len();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), count);
    }
}

//! Low-discrepancy point sets in the unit square: scrambled (0, m, 2)-nets in base 2.
//!
//! A (0, m, 2)-net in base 2 has 2^m points. Every elementary box (area 2^-m, sides that are powers of two,
//! position a multiple of the sides) contains exactly one point (Niederreiter 1992). The nets therefore
//! reduce the variance of integrands that vary slowly in at least one direction. This module provides the
//! nets of Sobol's first two dimensions, scrambled digit by digit (Owen 1995). The points of each net are in
//! random order. [`super::stream::Stream`] selects a random net for each pair of numbers and applies a random
//! digital shift. The random numbers are therefore uniform, and estimates are unbiased for any number of
//! nets.

use super::mix::mix;
use rand_core::Rng;
use rand_pcg::Pcg32;
use std::array::from_fn;
use std::sync::LazyLock;

/// Maximum number of binary digits of a net: 2^6 points.
pub const MOST_BITS: u32 = 6;

/// Total number of points of all nets of one size.
pub const POINTS: usize = 1 << 13;

/// Consecutive nets of 2^bits points. Each point contains the first `bits` digits of both coordinates as
/// integers, with the second coordinate shifted left by 8 bits.
pub type Nets = [u16; POINTS];

/// Returns the nets of 2^bits points, 1 ≤ bits ≤ [`MOST_BITS`].
///
/// # Panics
/// Panics if `bits` is out of range.
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
        // Shuffle the net by the Fisher–Yates algorithm.
        for last in (1..net.len()).rev() {
            let other = (u64::from(random.next_u32()) * (last as u64 + 1)) >> 32;
            net.swap(last, other as usize);
        }
    }
    out
}

/// Returns the digits of point `j` of Sobol's sequence along the first or second axis. The result consists of
/// the reversed digits of `j`, multiplied by Pascal's triangle modulo 2 for the second axis.
fn sobol(j: u32, axis: u32, bits: u32) -> u32 {
    // Digit 0 of the result is the most significant digit.
    let digit = |row: u32| {
        let chosen = |column: u32| {
            let entry = if axis == 0 {
                u32::from(row == column)
            } else {
                // A binomial coefficient is odd if the binary digits of its lower number are a subset of
                // those of the upper number (Lucas).
                u32::from(row & !column == 0)
            };
            entry & j >> column
        };
        (0..bits).fold(0, |sum, column| sum ^ chosen(column)) & 1
    };
    (0..bits).fold(0, |all, row| all | digit(row) << (bits - 1 - row))
}

/// Flips each digit of `x` at random, depending on the digits before it (Owen 1995).
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

    /// Verifies that every net has one point in every box of its elementary partitions.
    #[test]
    fn nets_have_one_point_in_every_elementary_box() {
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

    /// Verifies that all nets of one size differ.
    #[test]
    fn nets_differ() {
        let mut all: Vec<&[u16]> = nets(4).chunks_exact(16).collect();
        let count = all.len();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), count);
    }
}

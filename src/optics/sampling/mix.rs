//! A 64-bit hash for the keys of streams and nets.

/// Hashes a number by SplitMix64's finalizer (Steele, Lea & Flood 2014), a bijection that mixes all bits.
#[inline]
pub fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

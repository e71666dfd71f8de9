//! Writes Zstandard frames of mostly zero bytes directly (RFC 8878, section 3.1.1).
//!
//! If few elements of a large chunk are nonzero, the general encoder spends most of the time on the search
//! for matches among zeros. This encoder therefore writes only runs of zeros, as one repeated byte, and raw
//! bytes between the runs. Every Zstandard decoder reads blocks of repeated bytes and blocks of raw bytes.

use tensor::sink::STRETCH;

/// The result of analysing the bytes of a chunk.
#[derive(Debug, PartialEq)]
pub(super) enum Content {
    Zero,
    /// Mostly zero bytes. The variant contains the complete frame.
    Sparse(Vec<u8>),
    /// Other bytes, which the general encoder compresses.
    Dense,
}

/// Granularity, in bytes, of runs of zeros. Shorter runs do not reduce the size of the frame.
const PIECE: usize = 16;
/// Minimum ratio of all bytes to bytes outside runs of zeros. If more bytes are nonzero, the general encoder
/// writes smaller frames.
const RARITY: usize = 16;
/// Size of the largest block in bytes (Block_Maximum_Size).
const MAX_BLOCK: usize = 1 << 17;

const RAW: u32 = 0;
const REPEATED: u32 = 1;

/// Analyses bytes, and encodes the bytes as a frame if most of them are zero. `touched` has one bit, lowest
/// first, for every [`STRETCH`] bytes. A bit of 0 means that the corresponding bytes are zero.
pub(super) fn encode(bytes: &[u8], touched: Option<&[u64]>) -> Content {
    let Ok(length) = u32::try_from(bytes.len()) else {
        return Content::Dense;
    };
    let found: Vec<u64>;
    let touched = if let Some(touched) = touched {
        touched
    } else {
        found = bytes.chunks(64 * STRETCH).map(|c| filled(c, STRETCH)).collect();
        &found
    };
    // Ends of alternating runs: zeros up to the first end, other bytes up to the second end, and so on.
    let mut ends = Vec::new();
    let (mut in_zeros, mut others) = (true, 0);
    for (n, (stretches, &touched)) in bytes.chunks(64 * STRETCH).zip(touched).enumerate() {
        let mut m = 0;
        while m < stretches.len().div_ceil(STRETCH) {
            let nothing = touched >> m & 1 == 0;
            if nothing && in_zeros {
                // Continue at the next touched stretch.
                m += (touched >> m).trailing_zeros() as usize;
                continue;
            }
            let stretch = &stretches[m * STRETCH..stretches.len().min((m + 1) * STRETCH)];
            let filled = if nothing { 0 } else { filled(stretch, PIECE) };
            others += filled.count_ones() as usize * PIECE;
            // A bit is 1 if exactly one of a piece and the previous piece is zero. The last stretch may have
            // fewer pieces.
            let pieces = (1 << stretch.len().div_ceil(PIECE)) - 1;
            let mut turns = (filled ^ (filled << 1 | u64::from(!in_zeros))) & pieces;
            while turns != 0 {
                ends.push((n * 64 + m) * STRETCH + turns.trailing_zeros() as usize * PIECE);
                turns &= turns - 1;
                in_zeros = !in_zeros;
            }
            m += 1;
        }
        if others * RARITY > bytes.len() {
            return Content::Dense;
        }
    }
    if others == 0 {
        return Content::Zero;
    }
    ends.push(bytes.len());
    // Write the magic number, then the descriptor: four bytes of content size, single segment, no checksum.
    let mut frame = Vec::with_capacity(9 + others + 4 * (ends.len() + bytes.len() / MAX_BLOCK));
    frame.extend([0x28, 0xB5, 0x2F, 0xFD, 0xA0]);
    frame.extend(length.to_le_bytes());
    let mut at = 0;
    for (run, &end) in ends.iter().enumerate() {
        let kind = if run % 2 == 0 { REPEATED } else { RAW };
        while at < end {
            let next = end.min(at + MAX_BLOCK);
            let last = u32::from(next == bytes.len());
            let header = last | kind << 1 | ((next - at) as u32) << 3;
            frame.extend(&header.to_le_bytes()[..3]);
            frame.extend(&bytes[at..if kind == RAW { next } else { at + 1 }]);
            at = next;
        }
    }
    Content::Sparse(frame)
}

/// Returns a bit mask, lowest bit first, with one bit for each of up to 64 parts of `part` bytes. A bit is 1
/// if any byte of its part is nonzero.
#[inline]
fn filled(bytes: &[u8], part: usize) -> u64 {
    let parts = bytes.chunks(part).enumerate();
    parts.fold(0, |bits, (n, part)| bits | u64::from(!is_zero(part)) << n)
}

#[inline]
fn is_zero(bytes: &[u8]) -> bool {
    match bytes.try_into() {
        Ok(piece) => u128::from_ne_bytes(piece) == 0,
        Err(_) => bytes.iter().fold(0, |all, b| all | b) == 0,
    }
}

/// Returns the content size that a Zstandard frame declares, if the bytes are exactly one complete frame
/// and the frame declares the size.
pub(super) fn content_size(bytes: &[u8]) -> Option<u64> {
    let descriptor = *bytes.strip_prefix(&[0x28, 0xB5, 0x2F, 0xFD])?.first()?;
    let single_segment = descriptor & 0x20 != 0;
    let checksum = if descriptor & 4 != 0 { 4 } else { 0 };
    let mut at = 5 + usize::from(!single_segment) + [0, 1, 2, 4][usize::from(descriptor & 3)];
    let size_bytes = match descriptor >> 6 {
        0 => usize::from(single_segment),
        flag => 1 << flag,
    };
    let field = bytes.get(at..at + size_bytes).filter(|f| !f.is_empty())?;
    let little = field.iter().rev().fold(0_u64, |n, &b| (n << 8) | u64::from(b));
    let content = if size_bytes == 2 { little + 256 } else { little };
    at += size_bytes;
    loop {
        let header = bytes.get(at..at + 3)?;
        let header = u32::from(header[0]) | u32::from(header[1]) << 8 | u32::from(header[2]) << 16;
        at += 3 + match (header >> 1) & 3 {
            1 => 1,
            3 => return None,
            _ => (header >> 3) as usize,
        };
        if header & 1 != 0 {
            return (at + checksum == bytes.len()).then_some(content);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn zero_and_dense_content_is_distinguished() {
        assert_eq!(encode(&[], None), Content::Zero);
        assert_eq!(encode(&[0; 1000], None), Content::Zero);
        assert_eq!(encode(&[1; 1000], None), Content::Dense);
    }

    proptest! {
        /// Verifies that the library's decoder returns the original bytes, for nonzero bytes at any position.
        #[test]
        fn the_decoder_returns_the_original_bytes(
            length in 4096_usize..600_000,
            at in prop::collection::vec((any::<prop::sample::Index>(), 1..=u8::MAX), 1..12),
        ) {
            let mut bytes = vec![0; length];
            for (index, value) in &at {
                bytes[index.index(length)] = *value;
            }
            let mut touched = vec![0_u64; length.div_ceil(STRETCH).div_ceil(64)];
            for (n, _) in bytes.chunks(STRETCH).enumerate().filter(|(_, s)| !is_zero(s)) {
                touched[n / 64] |= 1 << (n % 64);
            }
            prop_assert_eq!(encode(&bytes, Some(&touched)), encode(&bytes, None));
            if let Content::Sparse(frame) = encode(&bytes, None) {
                prop_assert!(frame.len() < length / 8);
                prop_assert_eq!(zstd::bulk::decompress(&frame, length).expect("a valid frame"), bytes);
            } else {
                prop_assert!(at.len() * PIECE * RARITY > length);
            }
        }
    }
}

//! Packs and unpacks digital numbers. Packed formats start with the least significant bit (PFNC 2.4).

use super::camera::{PixelFormat, RawFrame};

/// Packs numbers into a format. Numbers above the format's maximum are clamped to the maximum.
pub fn pack(numbers: &[u32], format: PixelFormat) -> Vec<u8> {
    let bits = format.bits();
    let most = (1_u32 << bits) - 1;
    let mut bytes = Vec::with_capacity(format.bytes(numbers.len()));
    let (mut held, mut count) = (0_u64, 0);
    for n in numbers {
        held |= u64::from((*n).min(most)) << count;
        count += bits;
        while count >= 8 {
            bytes.push(held as u8);
            held >>= 8;
            count -= 8;
        }
    }
    if count > 0 {
        bytes.push(held as u8);
    }
    bytes
}

/// Unpacks a frame's numbers, row by row from the top. Returns `None` if the length does not match the region
/// and the format.
pub fn unpack(frame: &RawFrame) -> Option<Vec<u32>> {
    let bits = frame.format.bits();
    let pixels = u128::from(frame.region.width) * u128::from(frame.region.height);
    if frame.bytes.len() as u128 != (pixels * u128::from(bits)).div_ceil(8) {
        return None;
    }
    let pixels = pixels as usize;
    let mask = (1_u64 << bits) - 1;
    let (mut held, mut count) = (0_u64, 0);
    let mut bytes = frame.bytes.iter();
    let number = |_| {
        while count < bits {
            held |= u64::from(*bytes.next()?) << count;
            count += 8;
        }
        let n = (held & mask) as u32;
        held >>= bits;
        count -= bits;
        Some(n)
    };
    (0..pixels).map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::super::camera::Region;
    use super::*;
    use proptest::prelude::*;

    fn frame(bytes: Vec<u8>, format: PixelFormat, width: u32) -> RawFrame {
        RawFrame {
            region: Region { x: 0, y: 0, width, height: 1 },
            format,
            bytes,
            number: 0,
            timestamp_ns: 0,
        }
    }

    /// Tests that Mono12p is packed as in PFNC. The first byte contains the low eight bits of the first
    /// pixel. The low half of the second byte contains the first pixel's high four bits, and its high half
    /// contains the second pixel's low four bits.
    #[test]
    fn packed_bytes_match_the_standard() {
        assert_eq!(pack(&[0xABC, 0x123], PixelFormat::Mono12p), [0xBC, 0x3A, 0x12]);
        assert_eq!(pack(&[0x3FF, 0, 0x3FF, 0], PixelFormat::Mono10p), [0xFF, 0x03, 0xF0, 0x3F, 0x00]);
        assert_eq!(pack(&[0x1234], PixelFormat::Mono16), [0x34, 0x12]);
        assert_eq!(pack(&[7, 300], PixelFormat::Mono8), [7, 255]);
        assert_eq!(unpack(&frame(vec![0; 2], PixelFormat::Mono12p, 2)), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(10_000))]

        /// Tests that a frame of any size with any bytes is unpacked to one number per pixel or to `None`.
        #[test]
        fn arbitrary_frames_never_panic(
            bytes in prop::collection::vec(any::<u8>(), 0..64),
            width in prop_oneof![0..40_u32, any::<u32>()],
            height in prop_oneof![0..4_u32, any::<u32>()],
            which in 0..4_usize,
        ) {
            let format = PixelFormat::ALL[which];
            let mut frame = frame(bytes, format, width);
            frame.region.height = height;
            if let Some(numbers) = unpack(&frame) {
                prop_assert_eq!(numbers.len() as u64, u64::from(width) * u64::from(height));
                prop_assert!(numbers.iter().all(|n| *n < 1 << format.bits()));
            }
        }

        #[test]
        fn numbers_round_trip(numbers in prop::collection::vec(0_u32..256, 0..40), which in 0..4_usize) {
            let format = PixelFormat::ALL[which];
            let numbers: Vec<u32> = numbers.iter().map(|n| n << (format.bits() - 8)).collect();
            let found = unpack(&frame(pack(&numbers, format), format, numbers.len() as u32));
            prop_assert_eq!(found, Some(numbers));
        }
    }
}
